"""Errors of record and vehicle that the data want larger than their tolerances let expect."""

from __future__ import annotations

from brv_hypo.constants import BEYOND_TOLERANCE_NAMED, IMPROBABLE_ERRORS
from brv_hypo.io.text import hypothesis
from brv_hypo.ranking.fitting import Fitted
from brv_hypo.ranking.result import Verdict
from brv_hypo.regression.fit import likeliest


def tolerance_warnings(fitted: Fitted, verdict: Verdict) -> tuple[str, ...]:
    """A sentence on those of the leader; none where it is not adequate for other reasons, for what it lacks poses as
    errors.
    """
    if verdict.outcome == "none adequate" and fitted.left.errors_p_value >= IMPROBABLE_ERRORS:
        return ()
    leader, problem = likeliest(fitted.fits), fitted.problem
    found = problem.rows.nuisances.beyond_tolerance(leader.others, len(problem.records))
    if not found:
        return ()
    more = len(found) - BEYOND_TOLERANCE_NAMED
    told = "; ".join(found[:BEYOND_TOLERANCE_NAMED]) + (f"; and {more} more" if more > 0 else "")
    return (f"with {hypothesis(leader.name)}, errors exceed the tolerances of the record: {told} (see --instruments)",)
