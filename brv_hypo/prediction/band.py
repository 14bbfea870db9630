"""The prediction interval: how far the measured moments may lie from a frozen model's, noise included.

It has the noise, what coefficients, times and the record's errors within tolerances make to first order beside all that
is fitted along, and the model's own error (`ModelError`) on stretches that took no part in its fit. What is fitted
along takes some of the noise with it where it is fitted, and brings its own error elsewhere.

The attitude integrates the noise that the rates show, and the static moment follows it: of noise at a frequency f, the
difference of measured and modelled moment has 1 - (f_n / f)^2, f_n being that of the motion (`noise_share`).
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import block_diag

from brv_hypo.arrays import ComplexArray, FloatArray
from brv_hypo.inference.derivatives import per_coefficient, slope
from brv_hypo.linearisation.frame import ResidualMoments
from brv_hypo.linearisation.linear import lengths
from brv_hypo.motion.inertial import InertialRecord
from brv_hypo.motion.signals import middle_weights
from brv_hypo.prediction.frozen import CUTOFF, FrozenModel
from brv_hypo.prediction.result import PredictionBand
from brv_hypo.tracing.final_model import pair

# Held by `tests.studies.independent.sisters`: what the frozen model explains, and what its band holds.
BAND_SIGMAS = 1.96  # standard deviations on either side of the prediction
BAND_LEVEL = 0.95  # share of a normal distribution between them
BAND_LEAST_NOISE = 0.1  # share of the noise that a fit leaves at least
BAND_FREQUENCIES = 2048  # up to half the sample rate, that the noise of moments is summed over
_MOST_SHOWN = 2000  # samples of the interval that are reported: a picture has no more


def band_of(model: FrozenModel, measured: ResidualMoments) -> PredictionBand:
    """The band and the share of samples in it where the model is known."""
    data, left, error = model.fit.data, model.within.left, model.content.error
    motion, samples = data.frame.motions[0], data.frame.samples(0)
    beyond = np.zeros(samples.size) if error is None else error.at(motion.mach[samples])
    slopes = per_coefficient(data.frame, model.fit.model.columns, 0, motion, motion.alpha, slope) @ model.within.values
    stiffness, nuisances = slopes * data.records[0].moment_scale, model.fit.problem.rows.nuisances
    modes = nuisances.flights[0].walks.size // 2
    noise = measured.noise * np.sqrt(noise_share(data.records[0], stiffness[samples], modes))
    sigma = _predictive_sigma(model, noise, beyond)
    kept, counted = np.flatnonzero(left.usable), left.usable & model.flown
    inside = [np.abs(getattr(left.body, axis)) <= BAND_SIGMAS * getattr(sigma, axis) for axis in ("real", "imag")]
    shown = kept[:: max(1, -(-kept.size // _MOST_SHOWN))]
    return PredictionBand(
        level=BAND_LEVEL,
        inside=float(np.mean([axis[counted] for axis in inside])) if np.any(counted) else 0.0,
        model_error=float(np.sqrt(np.mean(beyond[counted] ** 2))) if np.any(counted) else 0.0,
        time_s=tuple(data.frame.time[shown].tolist()),
        measured=pair(measured.body[shown]),
        predicted=pair((measured.body - left.body)[shown]),
        half_width=pair(BAND_SIGMAS * sigma[shown]),
    )


def noise_share(record: InertialRecord, stiffness: FloatArray, modes: int) -> FloatArray:
    """Variance of the residual moments' noise over that of the measured ones' (n,). `stiffness` (n,) 1/s^2 is the
    static moment's slope, times its scale; negative where it restores. Slower than `modes` it is fitted.
    """
    spin, flight = record.spin_rate, record.flight
    frequency = np.pi * (np.arange(BAND_FREQUENCIES) + 0.5) / BAND_FREQUENCIES
    weights = middle_weights(spin.order, spin.half_width)
    power = np.abs(np.exp(1j * np.outer(frequency, np.arange(weights.size))) @ weights) ** 2
    faster = frequency > np.pi * modes * flight.step / record.time[-1]
    first, second = (float(np.sum((power / frequency**k)[faster]) / np.sum(power)) for k in (2, 4))
    turned = stiffness * flight.step**2
    return np.asarray(1.0 + 2.0 * first * turned + second * turned**2, dtype=float)


def _predictive_sigma(model: FrozenModel, noise_sigma: FloatArray, beyond: FloatArray) -> ComplexArray:
    """Standard deviation of the residual moments (rows,), of C_m as real part and of C_n as imaginary one.
    `noise_sigma` (rows,) is of the moments' noise, `beyond` (rows,) of what the model lacks.
    """
    fit, moved = model.within, model.moved_by_times
    # What processes make of the model's errors is in what it left on blocks held out.
    count = len(fit.model.columns)
    covariance = fit.covariance[:count, :count].copy()
    covariance[np.ix_(model.known, model.known)] = model.covariances[1]
    remain = np.flatnonzero(np.isfinite(fit.known[:count]))
    covariance = covariance[np.ix_(remain, remain)]
    problem, frame, (design, _, free) = fit.problem, fit.data.frame, fit.all_unknowns
    scale = lengths(design[:, free])
    solved = np.linalg.pinv(design[:, free] / scale, rcond=CUTOFF) / scale[:, np.newaxis]
    constants = np.zeros((frame.observed.size, 2 * len(problem.rows.part.levels)))  # show in no moment
    nuisances = problem.rows.nuisances.histories(np.eye(len(fit.nuisances))).rates
    moments = fit.data.moments(np.column_stack([frame.columns(fit.model.columns), constants, nuisances, moved])).body
    design = np.column_stack([design, problem.rows.of_moments(moved)])
    fixed = np.append(~free, np.ones(moved.shape[1], dtype=bool))
    of_fitted = moments[:, ~fixed]
    slopes = moments[:, fixed] - of_fitted @ (solved @ design[:, fixed])
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
