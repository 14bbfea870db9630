"""What a trace may be told; every default fits a flight that nobody has seen yet."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from brv_hypo.constants import TRACED_BLOCKS, TRACED_KNOTS, TRACED_SIGNIFICANCE, TRACED_STEPS, TRACED_TERMS
from brv_hypo.model.aero_table import AeroTable
from brv_hypo.motion.config import Method
from brv_hypo.residuals.saved import SavedModel

Baseline = Literal["scheduled", "constant"]


class TraceConfig(BaseModel):
    """Settings of `trace`.

    `start`: what the model holds from the start: a hypothesis as in `compare` ('none', 'lag+trim', a mechanism
    file), or the model of an earlier trace. `baseline`: whether the stiffness that it starts from follows Mach and
    Reynolds number, or is constant, so that such a change is for the loop to find. `aero`: a table of the slope, which
    stands in its place, and to which increments within its uncertainty are estimated. `effects`: the effects to try;
    None tries all that are installed.
    `method`: of reconstruction, as in `reconstruct`.
    `discover`: search the dictionary of generic terms too. `blocks`: parts that the record is cut into; every
    fourth is held out. `max_steps`: effects that may be added. `significance`: adjusted p-value below which an
    effect counts. `knot_count`, `max_terms`: as in `compare`. `maximum_likelihood`: refine the final model by
    maximum likelihood.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    start: str | SavedModel = "none"
    baseline: Baseline = "scheduled"
    aero: AeroTable | None = None
    effects: tuple[str, ...] | None = None
    discover: bool = True
    method: Method = "joint"
    blocks: int = Field(default=TRACED_BLOCKS, ge=8, le=200)
    max_steps: int = Field(default=TRACED_STEPS, ge=1, le=30)
    significance: float = Field(default=TRACED_SIGNIFICANCE, gt=0.0, lt=0.5)
    knot_count: int = Field(default=TRACED_KNOTS, ge=0, le=40)
    max_terms: int = Field(default=TRACED_TERMS, ge=1, le=20)
    maximum_likelihood: bool = True
