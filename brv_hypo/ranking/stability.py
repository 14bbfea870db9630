"""How often a comparison ends the same when it is repeated.

Repetitions are without a part of the record, with inertia or dynamic pressure a tolerance off, from other knots, and on
the motion of other reconstruction methods. Coefficients and nuisances are fitted anew in each.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.constants import REPEATED_ERRORS
from brv_hypo.ranking.other_knots import on_other_knots
from brv_hypo.ranking.other_methods import on_other_motions
from brv_hypo.ranking.repeated import Criteria, Repeated, criteria, criteria_at
from brv_hypo.ranking.verdict import Contest, Stability
from brv_hypo.regression.fit import HypothesisFit
from brv_hypo.regression.held_out import FitsWithout
from brv_hypo.regression.problem import Problem


def repetitions(
    problem: Problem, fits: Sequence[HypothesisFit], without: Sequence[FitsWithout], blocks: Sequence[int]
) -> tuple[Repeated, ...]:
    """Every repetition of a comparison of these fits, by kind.

    `without` are the fits of the same columns without blocks, one for each of `fits`; `blocks` says into how many the
    record is divided, of which one is left out in turn.
    """
    return (
        without_blocks(fits, without, blocks),
        within_tolerances(problem, fits),
        on_other_knots(problem, fits),
        on_other_motions(problem, fits),
    )


def stability(contest: Contest, repeated: Sequence[Repeated]) -> Stability:
    """Shares of all repetitions that end as the record does, judged by the same rules, and that have its leader."""
    pairs = [
        (contest.repeated(kind.whole), contest.repeated(each)) for kind in repeated for each in kind.each
    ]
    ends = [(one.outcome, one.winner) == (other.outcome, other.winner) for one, other in pairs]
    leads = [one.leader is other.leader for one, other in pairs]
    return Stability(sum(ends) / max(len(ends), 1), sum(leads) / max(len(leads), 1))


def without_blocks(
    fits: Sequence[HypothesisFit], without: Sequence[FitsWithout], blocks: Sequence[int]
) -> Repeated:
    """Without each block in turn; delays and knots stay.

    The whole record is under the same likelihood, in which rows may be left out (`Problem.untied`).
    """
    whole = {fit.name: each.nothing for fit, each in zip(fits, without, strict=True)}
    left_out = [
        {fit.name: each.rest for fit, each in zip(fits, repetition, strict=True)}
        for number in blocks
        for repetition in zip(*(each.each(number) for each in without), strict=True)
    ]
    return Repeated(criteria_at(fits, whole), [criteria_at(fits, rss) for rss in left_out])


def within_tolerances(problem: Problem, fits: Sequence[HypothesisFit]) -> Repeated:
    """With one of `REPEATED_ERRORS` expected a tolerance higher or lower; delays and knots stay."""
    return Repeated(criteria(fits), list(_expecting_others(problem, fits)))


def _expecting_others(problem: Problem, fits: Sequence[HypothesisFit]) -> Iterator[Criteria]:
    expected = _expected_elsewhere(problem)
    left = {}
    for fit in fits:
        basis = np.linalg.qr(problem.design(fit.frame, fit.columns))[0]
        changes = expected - basis @ (basis.T @ expected)
        left[fit.name] = np.sum((fit.residual[:, np.newaxis] + np.hstack([changes, -changes])) ** 2, axis=0)
    for k in range(2 * expected.shape[1]):
        yield criteria_at(fits, {name: float(rss[k]) for name, rss in left.items()})


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
