"""What a comparison may be told; every default fits a flight that nobody has seen yet."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from brv_hypo.constants import (
    COMPARED_BLOCKS,
    COMPARED_EXACT_TERMS,
    COMPARED_KNOTS,
    COMPARED_TERMS,
    OTHER_PRIOR,
)
from brv_hypo.motion.config import Method


class CompareConfig(BaseModel):
    """Settings of `compare`.

    `mechanisms`: hypotheses, a plus joining several; None compares all that are installed; the name of a nuisance
    effect of another package puts it into every hypothesis. `options`: options by mechanism name. `method`: of
    reconstruction, as in `reconstruct`. `knots` s: where coefficients may change; None
    spreads knots evenly. `knot_count`: how many. `max_terms`: columns that a hypothesis may add. `exact_terms`: up to
    so many the search is exact, then it goes on from the best refined model. `offset_degree`, `slope_degree`: Legendre
    degree of the slow drift of C_m0 and C_malpha; None is 1 and 3. `refine`: delays and knots become continuous.
    `accept_record`: go on with a record that contradicts itself. `held_out_blocks`: blocks of time of which each is
    held out in turn, for the prediction error. `maximum_likelihood`: hypotheses that stand are
    refined on the original measurements, with the errors of record, vehicle and air within their tolerances; "quick"
    leaves out records with warnings, and those that none explains: they take several seconds each. `other_prior`:
    prior probability that something outside the list moved the vehicle.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    mechanisms: Annotated[tuple[str, ...], Field(min_length=1)] | None = None
    options: dict[str, dict[str, Any]] = Field(default_factory=dict)
    method: Method = "joint"
    knots: tuple[float, ...] | None = None
    knot_count: int = Field(default=COMPARED_KNOTS, ge=0, le=40)
    max_terms: int = Field(default=COMPARED_TERMS, ge=1, le=20)
    offset_degree: int | None = Field(default=None, ge=0, le=6)
    slope_degree: int | None = Field(default=None, ge=0, le=8)
    exact_terms: int = Field(default=COMPARED_EXACT_TERMS, ge=1, le=20)
    refine: bool = True
    accept_record: bool = False
    held_out_blocks: int = Field(default=COMPARED_BLOCKS, ge=2, le=50)
    maximum_likelihood: Literal["quick", "full", "none"] = "quick"
    other_prior: float = Field(default=OTHER_PRIOR, gt=0.0, lt=1.0)
