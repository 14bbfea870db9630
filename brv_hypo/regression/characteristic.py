"""What a fit says of its mechanisms in particular, beyond changes of the coefficients that many things bring."""

from __future__ import annotations

from brv_hypo.model.columns import Column
from brv_hypo.regression.fit import HypothesisFit, solved
from brv_hypo.regression.problem import Problem
from brv_hypo.regression.reduced import Reduced


def plain_columns(fit: HypothesisFit) -> tuple[Column, ...]:
    """The selected columns without those that are characteristic of a mechanism."""
    telling = {(mechanism.name, term) for mechanism in fit.mechanisms for term in mechanism.characteristic}
    return tuple(column for column in fit.selected if (column.mechanism, column.term) not in telling)


def particular_share(problem: Problem, null: HypothesisFit, fit: HypothesisFit) -> float:
    """The share of what a fit explains beyond `null` that is lost without its characteristic columns.

    None where it has none of them; all of it where every column is, or no mechanism names any.
    """
    plain = plain_columns(fit)
    if not plain or not any(mechanism.characteristic for mechanism in fit.mechanisms):
        return 1.0
    if plain == fit.selected:
        return 0.0
    without = solved(Reduced(problem, fit.frame), fit.name, fit.mechanisms, (*problem.baseline, *plain), 0)
    return (without.rss - fit.rss) / max(null.rss - fit.rss, 1e-300)
