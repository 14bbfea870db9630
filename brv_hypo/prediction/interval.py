"""The prediction interval: how far the measured moments may lie from a frozen model's, noise included.

What the model's coefficients err by, and the record's errors fixed within their tolerances, change what is fitted
along; to first order, what is left of it after that fit widens the interval beyond the noise. So does the model's own
error (`ModelError`), as measured on stretches that took no part in its fit: a record's noise says how far its moments
lie from a model that is right, and one that is only the best that was found errs besides. What is fitted along takes
some of the noise with it where it is fitted, and brings its own error elsewhere.

The attitude is the integral of the very noise that the rates show, and the static moment follows the attitude: of noise
at a frequency f, the difference of measured and modelled moment has 1 - (f_n / f)^2, f_n being that of the motion
(`noise_share`).
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import block_diag

from brv_hypo.arrays import BoolArray, ComplexArray, FloatArray
from brv_hypo.constants import BAND_FREQUENCIES, BAND_LEAST_NOISE, BAND_LEVEL, BAND_SIGMAS
from brv_hypo.inference.uncertainty import ResidualMoments
from brv_hypo.linearisation.linear import lengths
from brv_hypo.motion.inertial import InertialRecord
from brv_hypo.motion.signals import middle_weights
from brv_hypo.prediction.result import Band
from brv_hypo.tracing.final_model import pair, slopes_at
from brv_hypo.tracing.fit import Fit

# Singular values of what is fitted that count, of the largest.
_CUTOFF = 1e-12
# Samples of the band that are reported: a picture has no more.
_MOST_SHOWN = 2000


def noise_share(record: InertialRecord, stiffness: FloatArray, modes: int) -> FloatArray:
    """Variance of the residual moments' noise over that of the measured ones' (n,).

    `stiffness` (n,) 1/s^2 is the static moment's slope, times its scale; negative where it restores. Slower than the
    `modes` of the walk that is fitted, the noise is dealt with there.
    """
    spin, flight = record.spin_rate, record.flight
    frequency = np.pi * (np.arange(BAND_FREQUENCIES) + 0.5) / BAND_FREQUENCIES
    weights = middle_weights(spin.order, spin.half_width)
    power = np.abs(np.exp(1j * np.outer(frequency, np.arange(weights.size))) @ weights) ** 2
    faster = frequency > np.pi * modes * flight.step / record.time[-1]
    first, second = (float(np.sum((power / frequency**k)[faster]) / np.sum(power)) for k in (2, 4))
    turned = stiffness * flight.step**2
    return np.asarray(1.0 + 2.0 * first * turned + second * turned**2, dtype=float)


def noise_of(fit: Fit, measured: ResidualMoments, values: FloatArray) -> FloatArray:
    """1-sigma (rows,) of the gyros' noise in the residual moments, the coefficients being `values` (columns,)."""
    record, motion = fit.problem.records[0], fit.data.reconstructions[0].motion
    slopes = slopes_at(fit.data, motion, fit.model.columns, 0, motion.alpha) @ values
    stiffness = (slopes * record.moment_scale)[fit.data.samples_of(0)]
    modes = fit.problem.rows.nuisances.correlated.size // 2
    return np.asarray(measured.noise * np.sqrt(noise_share(record, stiffness, modes)), dtype=float)


def predictive_sigma(
    fit: Fit, covariance: FloatArray, fitted: BoolArray, noise_sigma: FloatArray, beyond: FloatArray
) -> ComplexArray:
    """Standard deviation of the residual moments (rows,), of C_m as real part and of C_n as imaginary one.

    `covariance` is that of the fixed coefficients (fixed columns, fixed columns); `fitted` (columns + nuisances,) what
    is fitted here; `noise_sigma` (rows,) is of the moments' noise, `beyond` (rows,) of what the model lacks.
    """
    problem, frame, count = fit.problem, fit.data.frame, len(fit.model.columns)
    constants = 2 * len(problem.rows.part.levels)
    design = problem.whole_design(frame, fit.model.columns)
    free = np.concatenate([fitted[:count], np.ones(constants, dtype=bool), fitted[count:]])
    scale = lengths(design[:, free])
    solved = np.linalg.pinv(design[:, free] / scale, rcond=_CUTOFF) / scale[:, np.newaxis]
    unknowns = [history.rates for _, history in problem.rows.nuisances.histories.batches()]
    moments = fit.data.moments(np.column_stack([frame.columns(fit.model.columns), *unknowns])).body
    of_columns, of_others = moments[:, :count][:, fitted[:count]], moments[:, count:][:, fitted[count:]]
    none = np.zeros((len(moments), constants))  # constants of integration show in no moment
    of_fitted = np.column_stack([of_columns, none, of_others])
    slopes = moments[:, ~fitted] - of_fitted @ (solved @ design[:, ~free])
    known = block_diag(covariance, np.eye(slopes.shape[1] - covariance.shape[0]))
    # The level of the noise that the rates are weighed with, over that of the gyros.
    raised = problem.rows.noise.rates.sigma / float(np.median([record.gyro_sigma for record in problem.records]))
    inside = np.zeros(noise_sigma.size, dtype=bool)
    inside[problem.rows.part.rows] = True
    parts = []
    for own, response in ((slopes.real, of_fitted.real @ solved), (slopes.imag, of_fitted.imag @ solved)):
        share = raised**-2 * np.sum(response**2, axis=1) / noise_sigma**2  # of the noise, that what was fitted has
        after = np.where(inside, np.maximum(1.0 - share, BAND_LEAST_NOISE), 1.0 + share)
        variance = (noise_sigma**2 + beyond**2) * after
        parts.append(np.sqrt(variance + np.maximum(np.sum((own @ known) * own, axis=1), 0.0)))
    return np.asarray(parts[0] + 1j * parts[1])


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
    shown = kept[:: max(1, -(-kept.size // _MOST_SHOWN))]
    return Band(
        level=BAND_LEVEL,
        inside=float(np.mean([axis[counted] for axis in inside])) if np.any(counted) else 0.0,
        model_error=float(np.sqrt(np.mean(model_sigma[counted] ** 2))) if np.any(counted) else 0.0,
        time_s=tuple(time[shown].tolist()),
        measured=pair(measured.body[shown]),
        predicted=pair((measured.body - left.body)[shown]),
        half_width=pair(BAND_SIGMAS * sigma[shown]),
    )
