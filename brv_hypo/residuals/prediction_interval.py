"""The prediction interval: how far the measured moments may lie from a frozen model's, noise included.

What the model's coefficients err by, and what is held of the record's errors within their tolerances, changes what is
fitted along; to first order, what is left of it after that fit widens the interval beyond the noise. So does the
model's own error (`model_error`), as measured on stretches that took no part in its fit: a record's noise says how far
its moments lie from a model that is right, and one that is only the best that was found errs besides. What is fitted
along takes some of the noise with it where it is fitted, and brings its own error elsewhere.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy import stats
from scipy.linalg import block_diag

from brv_hypo.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from brv_hypo.constants import BAND_LEAST_NOISE, BAND_LEVEL, BAND_SIGMAS, MODEL_ERROR_CHANCE, MODEL_ERROR_WEIGHTS
from brv_hypo.mechanisms.contract import Mechanism
from brv_hypo.mechanisms.yaml_mechanism import YamlMechanism
from brv_hypo.model.term import Regressor
from brv_hypo.regression.frame import RateFrame
from brv_hypo.regression.linear import lengths
from brv_hypo.regression.problem import Problem
from brv_hypo.regression.uncertainty import ResidualMoments, residual_moments
from brv_hypo.regression.whitening import effective_samples
from brv_hypo.residuals.linearisation import Corrected
from brv_hypo.residuals.prediction import Band
from brv_hypo.residuals.saved import ModelError


def lasting(columns: Sequence[Regressor], mechanisms: Mapping[str, Mechanism]) -> BoolArray:
    """Which columns do not belong to the times of one record, and mean the same on another (columns,)."""
    return np.array([not _follows_time(column, mechanisms[column.mechanism]) for column in columns], dtype=bool)


def _follows_time(column: Regressor, mechanism: Mechanism) -> bool:
    terms = mechanism.definition if isinstance(mechanism, YamlMechanism) else ()
    return column.time_basis.kind != "constant" or any(t.name == column.term and t.follows_time for t in terms)


def model_error(data: Corrected, own: ResidualMoments, elsewhere: ResidualMoments) -> ModelError:
    """What the model leaves on the held-out part, and what it leaves there without what belongs to its own flights.

    Nothing where that is no more than the noise may leave by chance.
    """
    pieces = [rows for a, b in data.held_out.pieces if np.any(own.usable[rows := data.held_out.rows[a:b]])]
    mach = np.concatenate([rec.motion.mach[data.samples_of(k)] for k, rec in enumerate(data.reconstructions)])
    places = np.array([float(np.mean(mach[rows])) for rows in pieces])
    apart = bool(np.all(np.isfinite(places))) and np.unique(places).size == places.size
    order = np.argsort(places) if apart else np.arange(places.size)
    pieces = [pieces[k] for k in order]
    weights = _near(len(pieces)) if apart else np.ones((1, len(pieces)))
    found = (_beyond(left, pieces, weights) for left in (own, elsewhere))
    sigmas = dict(zip(("own", "elsewhere"), (tuple(np.sqrt(each).tolist()) for each in found), strict=True))
    return ModelError(mach=tuple(places[order].tolist()) if apart else (), **sigmas)


def _beyond(left: ResidualMoments, pieces: Sequence[IntArray], weights: FloatArray) -> FloatArray:
    """Mean square of either coefficient beyond that of the noise, by weighted means (means, pieces) of pieces."""
    kept = [rows[left.usable[rows]] for rows in pieces]
    weights = weights * [rows.size for rows in kept]
    weights = weights / weights.sum(axis=1, keepdims=True)
    squares = np.array([np.mean(np.abs(left.body[rows]) ** 2) / 2.0 for rows in kept])
    noises = np.array([np.mean(left.noise[rows] ** 2) for rows in kept])
    parts = [part(left.body[rows] / left.noise[rows]) for part in (np.real, np.imag) for rows in kept]
    share = effective_samples(parts) / sum(part.size for part in parts)
    # Of a mean square with so many degrees of freedom, were it noise alone.
    errors = noises * np.sqrt(2.0 / np.maximum([2.0 * share * rows.size for rows in kept], 1.0))
    found, noise, error = weights @ squares, weights @ noises, np.sqrt(weights**2 @ errors**2)
    # Weighted means are nearly such a mean square again (Satterthwaite, Biometrics 2:110, 1946); of all of them, the
    # largest exceeds what chance gives one.
    freedom = 2.0 * (noise / error) ** 2
    most = noise * stats.chi2.isf(MODEL_ERROR_CHANCE / len(weights), freedom) / freedom
    return np.asarray(np.where(found > most, found - noise, 0.0), dtype=float)


def _near(count: int) -> FloatArray:
    """Weights (count, count) of every stretch's neighbours."""
    before, here, after = MODEL_ERROR_WEIGHTS
    off = np.ones(max(count - 1, 0))
    return np.asarray(here * np.eye(count) + np.diag(before * off, -1) + np.diag(after * off, 1), dtype=float)


def error_at(error: ModelError | None, mach: FloatArray, *, elsewhere: bool) -> FloatArray:
    """Its 1-sigma (n,) at the Mach numbers of a flight (n,); where these are unknown, the rms of all."""
    if error is None:
        return np.zeros(mach.shape)
    values = np.array(error.elsewhere if elsewhere else error.own)
    whole = float(np.sqrt(np.mean(values**2)))
    if not error.mach:
        return np.full(mach.shape, whole)
    known = np.isfinite(mach)
    found = np.sqrt(np.interp(np.where(known, mach, error.mach[0]), error.mach, values**2))
    return np.where(known, found, whole)


# ---- The predictive band: how far the measured moments may lie from a frozen model's, noise included ----


# Singular values of what is fitted that count, of the largest.
_CUTOFF = 1e-12
# Samples of the band that are told: a picture has no more.
_MOST_SHOWN = 2000


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
        parts.append(np.sqrt(apart + np.maximum(np.sum((own @ held) * own, axis=1), 0.0)))
    return np.asarray(parts[0] + 1j * parts[1])


def _raised(problem: Problem) -> float:
    """The level of the noise that the rates are weighed with, over that of the gyros."""
    return problem.rows.noise.rates.sigma / float(np.median([record.gyro_sigma for record in problem.records]))


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
    predicted = measured.body - left.body
    return Band(
        level=BAND_LEVEL,
        inside=float(np.mean([axis[counted] for axis in inside])) if np.any(counted) else 0.0,
        model_error=float(np.sqrt(np.mean(model_sigma[counted] ** 2))) if np.any(counted) else 0.0,
        time_s=tuple(time[shown].tolist()),
        measured=pair(measured.body[shown]),
        predicted=pair(predicted[shown]),
        half_width=pair(BAND_SIGMAS * sigma[shown]),
    )


def pair(values: ComplexArray) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Pitch and yaw of moments (n,), as a result holds them."""
    return tuple(values.real.tolist()), tuple(values.imag.tolist())
