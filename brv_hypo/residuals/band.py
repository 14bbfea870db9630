"""The predictive band: how far the measured moments may lie from a frozen model's, noise included.

What the model's coefficients err by, and what is held of the record's errors within their tolerances, changes what is
fitted along; to first order, what is left of it after that fit widens the band beyond the noise. So does what the model
left where it was found, on stretches that took no part in its fit. What is fitted along takes some of the noise with it
where it is fitted, and brings its own error elsewhere.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.linalg import block_diag

from brv_hypo.arrays import BoolArray, ComplexArray, FloatArray
from brv_hypo.constants import BAND_LEAST_NOISE, BAND_LEVEL, BAND_SIGMAS
from brv_hypo.model.term import Regressor
from brv_hypo.regression.frame import RateFrame
from brv_hypo.regression.linear import lengths
from brv_hypo.regression.problem import Problem
from brv_hypo.regression.residual_moments import ResidualMoments, residual_moments
from brv_hypo.residuals.prediction import Band

# Singular values of what is fitted that count, of the largest.
_CUTOFF = 1e-12
# Samples of the band that are told: a picture has no more.
_MOST_TOLD = 2000


def predictive_sigma(
    problem: Problem,
    frame: RateFrame,
    columns: Sequence[Regressor],
    covariance: FloatArray,
    fitted: BoolArray,
    noise_sigma: FloatArray,
    beyond: FloatArray,
) -> ComplexArray:
    """Standard deviation of the residual moments (rows,), of C_m as real part and of C_n as imaginary one.

    `covariance` is that of the held coefficients (held columns, held columns); `fitted` (columns + nuisances,) what is
    fitted here; `noise_sigma` (rows,) is of the moments' noise, `beyond` (rows,) of what the model lacks.
    """
    constants = 2 * len(problem.rows.part.levels)
    count = len(columns)
    design = problem.whole_design(frame, columns)
    free = np.concatenate([fitted[:count], np.ones(constants, dtype=bool), fitted[count:]])
    scale = lengths(design[:, free])
    solved = np.linalg.pinv(design[:, free] / scale, rcond=_CUTOFF) / scale[:, np.newaxis]
    unknowns = [history.rates for _, history in problem.rows.nuisances.histories.batches()]
    histories = np.column_stack([frame.columns(columns), *unknowns])
    moments = residual_moments(frame, problem.records, histories).body
    of_fitted = np.zeros((moments.shape[0], int(free.sum())), dtype=complex)
    of_fitted[:, ~_constants(free, count, constants)] = moments[:, fitted]
    slopes = moments[:, ~fitted] - of_fitted @ (solved @ design[:, ~free])
    held = block_diag(covariance, np.eye(slopes.shape[1] - covariance.shape[0]))
    factor = _raised(problem) ** -2
    parts = []
    for own, response in ((slopes.real, of_fitted.real @ solved), (slopes.imag, of_fitted.imag @ solved)):
        share = factor * np.sum(response**2, axis=1) / noise_sigma**2
        apart = (noise_sigma**2 + beyond**2) * _after_the_fit(problem, share)
        parts.append(np.sqrt(apart + _variance(own, held)))
    return np.asarray(parts[0] + 1j * parts[1])


def _raised(problem: Problem) -> float:
    """The level of the noise that the rates are weighed with, over that of the gyros."""
    gyros = float(np.median([record.gyro_sigma for record in problem.records]))
    return problem.rows.noise.rates.sigma / gyros


def _after_the_fit(problem: Problem, share: FloatArray) -> FloatArray:
    """Variance (rows,) of what a fit leaves over that before it; `share` (rows,) is that of what was fitted."""
    inside = np.zeros(share.size, dtype=bool)
    inside[problem.rows.part.rows] = True
    return np.where(inside, np.maximum(1.0 - share, BAND_LEAST_NOISE), 1.0 + share)


def _constants(free: BoolArray, count: int, constants: int) -> BoolArray:
    """Which of the fitted unknowns are constants of integration, in which no moment shows."""
    which = np.zeros(free.size, dtype=bool)
    which[count : count + constants] = True
    return which[free]


def _variance(slopes: FloatArray, covariance: FloatArray) -> FloatArray:
    return np.asarray(np.maximum(np.sum((slopes @ covariance) * slopes, axis=1), 0.0), dtype=float)


def band_of(
    time: FloatArray,
    measured: ResidualMoments,
    left: ResidualMoments,
    sigma: ComplexArray,
    model_sigma: FloatArray,
    flown: BoolArray,
) -> Band:
    """The band with the share of the samples that it holds where the model is known (rows,), both axes together.

    `model_sigma` (rows,) is the part of `sigma` that is the model's own error.
    """
    kept, counted = np.flatnonzero(left.usable), left.usable & flown
    inside = [np.abs(getattr(left.body, axis)) <= BAND_SIGMAS * getattr(sigma, axis) for axis in ("real", "imag")]
    told = kept[:: max(1, -(-kept.size // _MOST_TOLD))]
    predicted = measured.body - left.body
    return Band(
        level=BAND_LEVEL,
        inside=float(np.mean([axis[counted] for axis in inside])) if np.any(counted) else 0.0,
        model_error=float(np.sqrt(np.mean(model_sigma[counted] ** 2))) if np.any(counted) else 0.0,
        time_s=tuple(time[told].tolist()),
        measured=pair(measured.body[told]),
        predicted=pair(predicted[told]),
        half_width=pair(BAND_SIGMAS * sigma[told]),
    )


def pair(values: ComplexArray) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Pitch and yaw of moments (n,), as a result holds them."""
    return tuple(values.real.tolist()), tuple(values.imag.tolist())
