"""What a user may choose about an identification."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from brv_hypo.constants import IDENTIFIED_FORCE_DEGREE, IDENTIFIED_QUADRATURE, IDENTIFIED_STEPS


class IdentificationConfig(BaseModel):
    """Options of `identify`; the defaults suit an unknown flight.

    `force_degree`: Legendre degree of the normal-force slope in time. `refine`: delays and knots are estimated
    too. `quadrature`: how much of the gyros' noise the spacing of nodes may cost. `begin_anew`: search from the
    data alone where the regression's fit leads nowhere, which takes several times as long.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    force_degree: int = Field(default=IDENTIFIED_FORCE_DEGREE, ge=0, le=6)
    refine: bool = True
    quadrature: float = Field(default=IDENTIFIED_QUADRATURE, gt=0.0)
    noise: Literal["diagonal", "full"] = "diagonal"
    max_iterations: int = Field(default=IDENTIFIED_STEPS, ge=1)
    begin_anew: bool = True
