"""The settings of a comparison; every default is for a flight not yet known."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Literal, TypedDict

from pydantic import BaseModel, ConfigDict, Field, field_validator

from brv_hypo.motion.methods import Method
from brv_hypo.thresholds import OTHER_PRIOR


class CompareConfig(BaseModel):
    """Settings of `compare`."""

    model_config = ConfigDict(frozen=True, extra="forbid")  # attribute docstrings would be read at each import

    mechanisms: Annotated[tuple[str, ...], Field(min_length=1)] | None = Field(
        default=None,
        description="Hypotheses by name, as text (`brv-hypo mechanisms` lists them), a plus joining several "
        "mechanisms; None: the five, and those of files (`--plugin`); `installed`: all of kind mechanism. "
        "The name of a nuisance effect of another package puts it into every hypothesis.",
    )
    options: dict[str, dict[str, Any]] = Field(default={}, description="By name of mechanism, effect or process.")
    method: Method = Field(default="joint", description="Of reconstruction, as in `reconstruct`.")
    knots: tuple[float, ...] | None = Field(default=None, description="When coefficients may change, s; None: even.")
    knot_count: int = Field(default=11, ge=0, le=40, description="How many knots are spread evenly.")
    max_terms: int = Field(default=6, ge=1, le=20, description="Coefficients that a hypothesis may add.")
    exact_terms: int = Field(default=4, ge=1, le=20, description="So many are searched exactly, more one by one.")
    refine: bool = Field(default=True, description="Whether delays and knots become continuous.")
    accept_record: bool = Field(default=False, description="Whether to go on with a record that contradicts itself.")
    held_out_blocks: int = Field(default=8, ge=2, le=50, description="Blocks of time, each held out in turn.")
    maximum_likelihood: Literal["quick", "full", "none"] = Field(
        default="quick",
        description="Which hypotheses are refined on the original measurements, with errors of record, vehicle and air "
        'within their tolerances: the leader and its closest rival in the credible set ("full"); these, but not on '
        'records with warnings or that no hypothesis explains ("quick": each takes several seconds); none.',
    )
    other_prior: float = Field(default=OTHER_PRIOR, gt=0.0, lt=1.0, description="Of what is not on the list.")

    @field_validator("mechanisms", mode="before")
    @classmethod
    def _listed(cls, value: Any) -> Any:
        """Names in one text, as on the command line, one by one."""
        return tuple(name.strip() for name in value.split(",")) if isinstance(value, str) else value


CompareSettings = TypedDict("CompareSettings", {  # noqa: UP013
    "mechanisms": Sequence[str] | str | None, "options": Mapping[str, Mapping[str, Any]], "method": str,
    "knots": Sequence[float] | None, "knot_count": int, "max_terms": int, "exact_terms": int, "refine": bool,
    "accept_record": bool, "held_out_blocks": int,
    "maximum_likelihood": Literal["quick", "full", "none"], "other_prior": float,
}, total=False)  # fmt: skip
"""The fields of `CompareConfig` as keywords."""
