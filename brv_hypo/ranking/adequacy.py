"""Whether a hypothesis leaves only what instruments and reconstruction explain, or something outside the list acts.

"Something else" is a moment of any smooth form beside the hypothesis, with a Gaussian prior on its size; the size is
averaged over from the detection limit upwards. Its marginal likelihood competes with the named hypotheses. What is
not smooth shows as rates that are louder than their noise.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import stats
from scipy.special import logsumexp

from brv_hypo.arrays import FloatArray
from brv_hypo.ranking.constants import DETECTABLE, LEVEL_SIGMAS, OTHER_FLOOR, OTHER_SIZES, SECOND_ORDER
from brv_hypo.regression.fit import HypothesisFit
from brv_hypo.regression.linear import lengths
from brv_hypo.regression.noise import free_moment
from brv_hypo.regression.problem import Problem
from brv_hypo.regression.whitening import MEDIAN_EFFICIENCY

# Directions of the free moment that the data see less than this share of the best do not count.
_UNSEEN = 1e-6


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


def misfit(problem: Problem, fit: HypothesisFit, null: HypothesisFit) -> Misfit:
    """Test what a fit leaves against a free, smooth moment beside it, at the noise that the record itself has.

    `null` is the fit of the baseline alone.
    """
    base = problem.design(fit.frame, fit.columns)
    basis = np.linalg.qr(base / lengths(base))[0]
    free = _free_columns(problem)
    free = free - basis @ (basis.T @ free)
    left, seen, _ = np.linalg.svd(free, full_matrices=False)
    kept = seen > _UNSEEN * seen[0]
    seen, found = seen[kept], left[:, kept].T @ fit.residual
    ratio = float(np.sqrt(fit.rss / problem.samples))
    rest = max(fit.rss - float(found @ found), 1e-300)
    free_samples = max(problem.samples - fit.parameters - found.size, 1)
    f_ratio = (float(found @ found) / found.size) / (rest / free_samples)
    share = problem.efficiency
    p_value = float(stats.f.sf(f_ratio, found.size, max(free_samples * share, 1.0)))
    second_order = SECOND_ORDER * share * max(null.rss - fit.rss, 0.0)
    smooth = _gain(found * np.sqrt(share), seen * np.sqrt(share))
    gain = max(smooth, share * _louder(fit.residual[: problem.rows.rates])) - OTHER_FLOOR - second_order
    asked = fit.residual[2 * problem.rows.rates :]
    errors_p_value = stats.chi2.sf(max(float(asked @ asked) - second_order, 0.0), max(asked.size, 1))
    return Misfit(ratio, p_value, gain, float(errors_p_value))


def _louder(rates: FloatArray) -> float:
    """Squares (unit noise) of whitened rates beyond what the noise explains with the errors of its own level."""
    level_error = np.sqrt(2.0 / rates.size * (1.0 + 1.0 / MEDIAN_EFFICIENCY))
    return float(rates @ rates - rates.size * (1.0 + LEVEL_SIGMAS * level_error))


def _gain(found: FloatArray, seen: FloatArray) -> float:
    """2 ln of the marginal likelihood ratio, averaged over sizes of the free moment."""
    weakest = DETECTABLE / float(np.sum(seen**2))
    gains = []
    for power in range(OTHER_SIZES):
        strength = weakest * 4.0**power * seen**2
        gains.append(float(np.sum(strength / (1.0 + strength) * found**2 - np.log1p(strength))))
    return 2.0 * float(logsumexp(0.5 * np.array(gains)) - np.log(len(gains)))


def _free_columns(problem: Problem) -> FloatArray:
    """Columns of the free moment (rows, columns), each of unit rms moment."""
    frame, columns = free_moment(problem)
    sizes = np.sqrt(np.mean(np.abs(frame.moments(columns)) ** 2, axis=0))
    sizes = np.where(sizes > 0.0, sizes, 1.0)
    return np.asarray(problem.design(frame, columns) / sizes, dtype=float)
