"""A fitted hypothesis with the columns of one knot or delay exchanged for the best others, while it gains.

Where two knots are off, each keeps the other where it is: no step of one column from there is an improvement.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from brv_hypo.constants import SEARCH_EXCHANGES
from brv_hypo.model.term import Regressor
from brv_hypo.regression.fit import HypothesisFit, gains, likeliest, plainer, renewed, scanned_finely, settled
from brv_hypo.regression.problem import Problem
from brv_hypo.regression.search import in_place_of


def exchanged(problem: Problem, fit: HypothesisFit) -> HypothesisFit:
    """The likeliest fit that a sequence of exchanges leads to; the fit itself where none gains.

    Bounds of coefficients are left aside, as they are in the search. Two knots that came to one place become one; the
    others may still stand where the grid has them, which a finer scan mends.
    """
    given, fit = fit, renewed(problem, fit)
    for _ in range(SEARCH_EXCHANGES if problem.refine else 0):
        tried = [
            settled(problem, fit, (*problem.baseline, *columns), kept)
            for kept, taken in _without_each(fit.selected)
            for columns in in_place_of(problem, fit.frame, fit.mechanisms, kept, len(taken))
        ]
        best = likeliest([fit, *tried])
        if not gains(best, fit):
            break
        fit = scanned_finely(problem, plainer(problem, best))
    return likeliest([fit, given])


def _without_each(selected: Sequence[Regressor]) -> Iterator[tuple[tuple[Regressor, ...], tuple[Regressor, ...]]]:
    """What is kept and what is taken out, for the columns of each course and delay in turn."""
    for place in dict.fromkeys((column.mechanism, column.theta, column.time_basis) for column in selected):
        taken = tuple(c for c in selected if (c.mechanism, c.theta, c.time_basis) == place)
        yield tuple(column for column in selected if column not in taken), taken
