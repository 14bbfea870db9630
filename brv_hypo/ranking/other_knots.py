"""Repetitions from other knots.

The grid of knots is the analyst's choice; that of another lies half a spacing off at most. A search moves every knot
from its place on the grid to where the data want it, so that another grid matters only where it leads elsewhere: to
another minimum, in which another mechanism may fit better. That a knot is not known exactly is no repetition: the
criterion of a knot a standard error off is higher by about one, whichever hypothesis it belongs to.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from brv_hypo.constants import CONVERGED_FALL, KNOT_SHIFTS, REPEATED_WITHIN
from brv_hypo.model.term import Regressor
from brv_hypo.ranking.repeated import Repeated, criteria
from brv_hypo.regression.fit import HypothesisFit, scanned_finely, settled
from brv_hypo.regression.problem import Problem


def on_other_knots(problem: Problem, fits: Sequence[HypothesisFit]) -> Repeated:
    """All knots moved by each of `KNOT_SHIFTS` and refined from there as in the search, delays with them.

    Hypotheses `REPEATED_WITHIN` behind the leader stay as they are. None where nothing has a knot that may move.
    """
    whole = criteria(fits)
    reach = min(whole.values()) + REPEATED_WITHIN
    moving = [fit for fit in fits if fit.information <= reach and any(p.kind == "knot" for p in fit.nonlinear)]
    shifts = KNOT_SHIFTS if moving else ()
    return Repeated(
        whole, [{**whole, **{fit.name: _refined(problem, fit, shift) for fit in moving}} for shift in shifts]
    )


def _refined(problem: Problem, fit: HypothesisFit, shift: float) -> float:
    """The criterion of a fit that was refined from knots so many spacings later; finely where that ends elsewhere."""
    found = replace(settled(problem, fit, _shifted(fit, shift), ()), bound_cost=fit.bound_cost)
    if found.information > fit.information + CONVERGED_FALL:
        found = replace(scanned_finely(problem, found), bound_cost=fit.bound_cost)
    return found.information


def _shifted(fit: HypothesisFit, shift: float) -> tuple[Regressor, ...]:
    """The columns of a fit with its knots so many spacings later, within the record."""
    columns = fit.columns
    for parameter in fit.nonlinear:
        if parameter.kind == "knot":
            low, high = parameter.bounds
            reach = high - parameter.value if shift > 0.0 else parameter.value - low
            columns = parameter.moved(columns, parameter.value + shift * reach)
    return columns
