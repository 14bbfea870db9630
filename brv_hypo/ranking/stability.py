"""How often the same hypothesis leads: without a part of the record, with other inertia or dynamic pressure."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.ranking.constants import REPEATED_ERRORS
from brv_hypo.regression.fit import HypothesisFit
from brv_hypo.regression.held_out import FitsWithout
from brv_hypo.regression.problem import Problem


def stability(
    problem: Problem, fits: Sequence[HypothesisFit], without: Sequence[FitsWithout], blocks: Sequence[int]
) -> float:
    """Share of repetitions that have the same leader as the record as it is.

    Each is without one of `blocks` blocks, or with an error of `REPEATED_ERRORS` expected a tolerance higher or lower.
    `without` are the fits of the same columns without blocks, one for each of `fits`. Coefficients and nuisances are
    fitted anew; knots and delays stay.
    """
    same = [*_without_blocks(fits, without, blocks), *_within_tolerances(problem, fits)]
    return sum(same) / max(len(same), 1)


def _without_blocks(
    fits: Sequence[HypothesisFit], without: Sequence[FitsWithout], blocks: Sequence[int]
) -> Iterator[bool]:
    """Whether the whole record's leader leads, by repetition.

    It is that of the same likelihood, in which rows may be left out (`Problem.untied`).
    """
    leader = _leader(fits, {fit.name: each.nothing for fit, each in zip(fits, without, strict=True)})
    for number in blocks:
        for repetition in zip(*(each.each(number) for each in without), strict=True):
            rests = {fit.name: each.rest for fit, each in zip(fits, repetition, strict=True)}
            yield _leader(fits, rests) == leader


def _within_tolerances(problem: Problem, fits: Sequence[HypothesisFit]) -> Iterator[bool]:
    """Whether the record's leader leads where the priors of errors have another centre, by repetition."""
    expected = _expected_elsewhere(problem)
    leader = _leader(fits, {fit.name: fit.rss for fit in fits})
    left = {}
    for fit in fits:
        basis = np.linalg.qr(problem.design(fit.frame, fit.columns))[0]
        changes = expected - basis @ (basis.T @ expected)
        left[fit.name] = np.sum((fit.residual[:, np.newaxis] + np.hstack([changes, -changes])) ** 2, axis=0)
    for k in range(2 * expected.shape[1]):
        yield _leader(fits, {name: float(rss[k]) for name, rss in left.items()}) == leader


def _expected_elsewhere(problem: Problem) -> FloatArray:
    """What the rows change by as one error of the record is expected a tolerance higher (rows, errors)."""
    nuisances = problem.rows.nuisances
    prior_rows = [
        2 * problem.rows.rates + row
        for row, item in enumerate(nuisances.items[k] for k in nuisances.bounded)
        if item.name in REPEATED_ERRORS
    ]
    changes = np.zeros((problem.rows.size, len(prior_rows)))
    changes[prior_rows, np.arange(len(prior_rows))] = 1.0
    return problem.rows.projected(changes)


def _leader(fits: Sequence[HypothesisFit], rss: Mapping[str, float]) -> str:
    """The hypothesis of the least criterion with these residual sums of squares."""
    criteria = {fit.name: replace(fit, residual=np.array([np.sqrt(rss[fit.name])])).information for fit in fits}
    return min(criteria, key=lambda name: criteria[name])
