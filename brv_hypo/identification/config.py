"""What a user may choose about an identification."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from brv_hypo.identification.instruments import GROUPS


class IdentificationConfig(BaseModel):
    """Options of `identify`; the defaults suit an unknown flight.

    `force_degree`: Legendre degree of the normal-force slope in time. `instruments`: groups of instrument
    errors that are always estimated; `candidates`: groups that evidence may add, None for all. `evidence`:
    how far twice the log-likelihood must rise, beyond k ln n for k parameters and n measured values, for a
    group to be added. `refine`: delays and knots are estimated too. `quadrature`: how much of the gyros'
    noise the spacing of nodes may cost.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    force_degree: int = Field(default=1, ge=0, le=6)
    instruments: tuple[str, ...] = ()
    candidates: tuple[str, ...] | None = None
    evidence: float = Field(default=6.0, ge=0.0)
    most_added: int = Field(default=4, ge=0)
    refine: bool = True
    quadrature: float = Field(default=0.2, gt=0.0)
    noise: Literal["diagonal", "full"] = "diagonal"
    max_iterations: int = Field(default=30, ge=1)

    def offered(self) -> tuple[str, ...]:
        """Groups that evidence may add."""
        groups = GROUPS if self.candidates is None else self.candidates
        return tuple(group for group in groups if group not in self.instruments)
