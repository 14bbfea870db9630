"""What a trace may be told; every default fits a flight that nobody has seen yet."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, TypedDict

from pydantic import BaseModel, ConfigDict, Field

from brv_hypo.constants import TRACED_BLOCKS, TRACED_KNOTS, TRACED_SIGNIFICANCE, TRACED_STEPS, TRACED_TERMS
from brv_hypo.model.aero_table import AeroTable
from brv_hypo.motion.config import Method
from brv_hypo.residuals.saved import SavedModel

Baseline = Literal["scheduled", "constant"]


class TraceConfig(BaseModel):
    """Settings of `trace`."""

    model_config = ConfigDict(frozen=True, extra="forbid", use_attribute_docstrings=True)

    start: str | SavedModel = "none"
    """What the model holds from the start: a hypothesis as in `compare` ('none', 'lag+trim', a mechanism file), or
    the model of an earlier trace."""
    baseline: Baseline = "scheduled"
    """Whether the stiffness that it starts from follows Mach and Reynolds number ("scheduled"), or is constant, so
    that such a change is for the loop to find."""
    aero: AeroTable | None = None
    """A table of the slope, which replaces the baseline's, and to which increments within its uncertainty are
    estimated."""
    effects: tuple[str, ...] | None = None
    """The effects to try; None tries all that are installed."""
    discover: bool = True
    """Whether the dictionary of generic terms is searched too."""
    method: Method = "joint"
    """Of reconstruction, as in `reconstruct`."""
    blocks: int = Field(default=TRACED_BLOCKS, ge=8, le=200)
    """Blocks of time that the record is cut into; every fourth is held out."""
    max_steps: int = Field(default=TRACED_STEPS, ge=1, le=30)
    """Effects that may be added."""
    significance: float = Field(default=TRACED_SIGNIFICANCE, gt=0.0, lt=0.5)
    """Adjusted p-value below which an effect is significant."""
    knot_count: int = Field(default=TRACED_KNOTS, ge=0, le=40)
    """As in `compare`."""
    max_terms: int = Field(default=TRACED_TERMS, ge=1, le=20)
    """As in `compare`."""
    maximum_likelihood: bool = True
    """Whether the final model is refined by maximum likelihood."""


TraceSettings = TypedDict("TraceSettings", {  # noqa: UP013
    "start": str | SavedModel, "baseline": Baseline, "aero": AeroTable | None, "effects": Sequence[str] | None,
    "discover": bool, "method": str, "blocks": int, "max_steps": int, "significance": float, "knot_count": int,
    "max_terms": int, "maximum_likelihood": bool,
}, total=False)  # fmt: skip
"""The fields of `TraceConfig` as keywords."""
