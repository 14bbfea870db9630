"""What a fit says of its mechanisms in particular, beyond changes of the coefficients that many things bring."""

from __future__ import annotations

from brv_hypo.model.term import Regressor
from brv_hypo.regression.fit import HypothesisFit, settled
from brv_hypo.regression.problem import Problem


def plain_columns(fit: HypothesisFit) -> tuple[Regressor, ...]:
    """The selected columns without those that are characteristic of a mechanism."""
    telling = {(mechanism.name, term) for mechanism in fit.mechanisms for term in mechanism.characteristic}
    return tuple(column for column in fit.selected if (column.mechanism, column.term) not in telling)


def particular_share(problem: Problem, null: HypothesisFit, fit: HypothesisFit) -> float:
    """The share of what a fit explains beyond `null` that is lost without its characteristic columns.

    The knots of what is left move to where they fit best then. None where the fit has none of them; all of it where
    every column is, or no mechanism names any.
    """
    plain = plain_columns(fit)
    if not plain or not any(mechanism.characteristic for mechanism in fit.mechanisms):
        return 1.0
    if plain == fit.selected:
        return 0.0
    without = settled(problem, fit, (*problem.baseline, *plain), plain)
    return (without.rss - fit.rss) / max(null.rss - fit.rss, 1e-300)
