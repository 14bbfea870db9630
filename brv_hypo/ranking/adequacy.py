"""Whether a hypothesis leaves only what instruments and reconstruction explain, or something outside the list acts.

"Something else" is a moment beside the hypothesis that is smooth in time, of one shape that a body may have or of all
ordinary ones together, with a Gaussian prior on its size; shape and size, from the detection limit upwards, are
averaged over. Its marginal likelihood competes with the named hypotheses. What has none of these shapes shows as
rates that are louder than their noise.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy import stats
from scipy.special import logsumexp

from brv_hypo.arrays import FloatArray
from brv_hypo.constants import (
    DETECTABLE,
    LEVEL_SIGMAS,
    OTHER_FLOOR,
    OTHER_SIZES,
    OTHER_UNSEEN,
    SECOND_ORDER,
    SECOND_ORDER_VALUES,
)
from brv_hypo.regression.fit import HypothesisFit
from brv_hypo.regression.free_moment import ORDINARY, SHAPES, free_moment
from brv_hypo.regression.linear import lengths
from brv_hypo.regression.problem import Problem
from brv_hypo.regression.whitening import MEDIAN_EFFICIENCY


@dataclass(frozen=True)
class Misfit:
    """What a hypothesis leaves: `ratio` residual rms over the noise, `p_value` that no smooth moment is left in it.

    `gain` is twice the logarithm of the marginal likelihood of "something else" beside it over its own, or what the
    rates hold beyond the noise, smooth or not, where that is more; less what errors of second order may bring.
    `errors_p_value`: how probable the errors of record and vehicle that it asks for are under their tolerances, but for
    the same.
    """

    ratio: float
    p_value: float
    gain: float
    errors_p_value: float = 1.0


class _Beside(NamedTuple):
    """A free moment beside a fit: how well each direction of it is seen, and what the residual has there."""

    seen: FloatArray
    found: FloatArray


def misfit(problem: Problem, fit: HypothesisFit, null: HypothesisFit) -> Misfit:
    """Test what a fit leaves against free, smooth moments beside it, at the noise that the record itself has.

    `null` is the fit of the baseline alone.
    """
    beside = list(_beside(problem, fit))
    found = beside[0].found
    ratio = float(np.sqrt(fit.rss / problem.samples))
    rest = max(fit.rss - float(found @ found), 1e-300)
    free_samples = max(problem.samples - fit.parameters - found.size, 1)
    f_ratio = (float(found @ found) / found.size) / (rest / free_samples)
    share = problem.efficiency
    p_value = float(stats.f.sf(f_ratio, found.size, max(free_samples * share, 1.0)))
    brought = share * max(null.rss - fit.rss, 0.0)
    smooth = _gain([_Beside(np.sqrt(share) * each.seen, np.sqrt(share) * each.found) for each in beside])
    gain = max(smooth, share * _louder(fit.residual[: problem.rows.rates])) - OTHER_FLOOR
    gain -= SECOND_ORDER * brought
    asked = fit.residual[2 * problem.rows.rates :]
    squares = max(float(asked @ asked) - SECOND_ORDER_VALUES * brought, 0.0)
    errors_p_value = stats.chi2.sf(squares, max(asked.size, 1))
    return Misfit(ratio, p_value, gain, float(errors_p_value))


def _beside(problem: Problem, fit: HypothesisFit) -> Iterator[_Beside]:
    """The ordinary shapes together, then every shape alone, each of unit rms moment."""
    base = problem.design(fit.frame, fit.columns)
    basis = np.linalg.qr(base / lengths(base))[0]
    for shapes in (ORDINARY, *((shape,) for shape in SHAPES)):
        frame, columns = free_moment(problem, shapes)
        sizes = np.sqrt([np.mean(np.abs(frame.moments((column,))) ** 2) for column in columns])
        free = problem.design(frame, columns) / np.where(sizes > 0.0, sizes, 1.0)
        left, seen, _ = np.linalg.svd(free - basis @ (basis.T @ free), full_matrices=False)
        kept = seen > OTHER_UNSEEN * seen[0]
        yield _Beside(seen[kept], left[:, kept].T @ fit.residual)


def _louder(rates: FloatArray) -> float:
    """Squares (unit noise) of whitened rates beyond what the noise explains with the errors of its own level."""
    level_error = np.sqrt(2.0 / rates.size * (1.0 + 1.0 / MEDIAN_EFFICIENCY))
    return float(rates @ rates - rates.size * (1.0 + LEVEL_SIGMAS * level_error))


def _gain(beside: Sequence[_Beside]) -> float:
    """2 ln of the marginal likelihood ratio, averaged over shapes and sizes of the free moment."""
    gains = []
    for seen, found in beside:
        weakest = DETECTABLE / float(np.sum(seen**2))
        for power in range(OTHER_SIZES):
            strength = weakest * 4.0**power * seen**2
            gains.append(float(np.sum(strength / (1.0 + strength) * found**2 - np.log1p(strength))))
    return 2.0 * float(logsumexp(0.5 * np.array(gains)) - np.log(len(gains)))
