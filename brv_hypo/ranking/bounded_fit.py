"""A hypothesis at its likeliest among models whose values a body may have."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

from brv_hypo.model.columns import Column
from brv_hypo.ranking.constants import BOUND_SIGMAS
from brv_hypo.ranking.intervals import within_bounds
from brv_hypo.regression.fit import HypothesisFit, likeliest, settled, with_errors
from brv_hypo.regression.problem import Problem


def bounded_fit(problem: Problem, fit: HypothesisFit) -> HypothesisFit:
    """The fit with its errors; where values lie outside their bounds, likelier ones of fewer columns take its place.

    The search knows no bounds, and a stretch that follows noise may have any value. One column, or two (a stretch
    begins and ends), are left out at a time, while what is left is likelier than values held at their bounds.
    """
    fit = within_bounds(with_errors(problem, fit))
    while fit.bound_cost > BOUND_SIGMAS**2:
        fewer = [_without(problem, fit, left_out) for left_out in _left_out(fit.selected)]
        if not fewer or likeliest(fewer).information >= fit.information:
            break
        fit = likeliest(fewer)
    return fit


def _left_out(selected: tuple[Column, ...]) -> list[set[Column]]:
    """One or two columns of those selected, of which one at least is kept."""
    counts = range(1, min(2, len(selected) - 1) + 1)
    return [set(columns) for count in counts for columns in combinations(selected, count)]


def _without(problem: Problem, fit: HypothesisFit, left_out: set[Column]) -> HypothesisFit:
    kept = tuple(column for column in fit.selected if column not in left_out)
    found = settled(problem, replace(fit, bound_cost=0.0), (*problem.baseline, *kept), ())
    return within_bounds(with_errors(problem, found))
