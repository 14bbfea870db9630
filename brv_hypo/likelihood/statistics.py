"""Statistics of the fit: the noise's variances, and how well the parameters are known.

Noise, that of outputs independent of each other: whitening with gaps, Eq. 3.11 and Eq. 3.10. White residuals: the
covariance of the estimate is the inverse of the information, with near-null directions by name. Coloured residuals
(Morelli and Klein, J. Aircraft 34, 1997):

    C = D [sum_i sum_j S_i' B^-1 R(i - j) B^-1 S_j] D

with D the covariance for white residuals, S the outputs' sensitivities, R the residuals' autocorrelation by an
autoregressive model, its order by Akaike's criterion; the double sum is done over frequencies and cannot turn negative.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from brv_hypo.arrays import BoolArray, FloatArray, IntArray

_ROUNDING = 1e-14
_FIRST_GUESS = 100.0  # least first guess of a noise variance over the least plausible one
_THIRD_DIFFERENCE = 20.0  # variance of the third difference of unit white noise: 1 + 9 + 9 + 1
_NEAR_NULL = 1e-3  # singular value of column-scaled sensitivities, against the largest, of a near-null direction
_NULL = 1e-13  # the same of a direction that is not observed at all: its value is rounding
_TOUCHED = 1e-8  # square of a parameter's weight in such directions from which it is not determined
_NAMED = 0.1  # least weight with which a parameter is named in a near-null direction
_HIGHEST_ORDER = 20
_LEAST_SAMPLES_PER_ORDER = 10
_LEAST_POLYNOMIAL = 1e-6
_LARGEST_REFLECTION = 0.999  # keeps an autoregression stable where gaps make its autocorrelations inconsistent


def whitening(variance: FloatArray, measured: BoolArray) -> FloatArray:
    """One over the noise of what was measured, (n, n_outputs), 0 in gaps; `measured` is (n_outputs, n)."""
    return np.where(measured.T, 1.0 / np.sqrt(variance), 0.0)


def estimate_variance(residual: FloatArray, floor: FloatArray) -> FloatArray:
    """Diagonal of B of Eq. 3.11, (n_outputs,), at least `floor`, of residuals (n_outputs, n), nan in gaps."""
    count = np.maximum(np.isfinite(residual).sum(axis=1), 1)
    return np.asarray(np.maximum(np.nansum(residual**2, axis=1) / count, floor))


def negative_log_likelihood(residual: FloatArray, variance: FloatArray) -> float:
    """NLLF of Eq. 3.10 with erratum E8: 1/2 sum(v' B^-1 v + log det B), over what was measured, nan in gaps."""
    squares = np.nansum(residual**2, axis=1) / variance
    return 0.5 * (float(np.sum(squares)) + log_determinant_of(variance, np.isfinite(residual)))


def log_determinant_of(variance: FloatArray, measured: BoolArray) -> float:
    """Sum over samples of log det of the covariance of what was `measured` (n_outputs, n)."""
    return float(measured.sum(axis=1) @ np.log(variance))


def noise_from_differences(y: FloatArray) -> FloatArray:
    """First guesses of the noise variances (n_outputs,) of y (n_outputs, n): third differences are blind to motion."""
    variance = least_variance(y) * _FIRST_GUESS
    for i, row in enumerate(y):
        differences = np.diff(row, 3)
        if np.count_nonzero(np.isfinite(differences)) < row.size / 10:  # slower than the rest: samples far apart
            differences = np.diff(row[np.isfinite(row)], 3)
        if np.isfinite(differences).any():
            variance[i] = max(variance[i], float(np.nanmean(differences**2)) / _THIRD_DIFFERENCE)
    return variance


def least_variance(y: FloatArray) -> FloatArray:
    """The least plausible noise variance of each output, (n_outputs,): that of rounding."""
    mean_square = np.array([np.mean(row[np.isfinite(row)] ** 2) if np.isfinite(row).any() else 1.0 for row in y])
    return np.asarray(_ROUNDING * np.where(mean_square > 0, mean_square, 1.0))


# ---- How well the parameters are known: covariance, near-null directions, whiteness ----


@dataclass(frozen=True)
class NearNull:
    """A combination of parameters that the data hardly see."""

    weights: dict[str, float]  # by parameter, each scaled by its own information
    relative: float  # singular value against the largest


@dataclass(frozen=True)
class Identifiability:
    """Condition of the column-scaled sensitivities, and what the data hardly see, worst first."""

    condition: float
    near_null: tuple[NearNull, ...]

    def __str__(self) -> str:
        if not self.near_null:
            return f"all parameters are seen by the data (condition {self.condition:.3g})"
        parts = [" ".join(f"{w:+.2f} {name}" for name, w in d.weights.items()) for d in self.near_null]
        return f"hardly seen by the data (condition {self.condition:.3g}): " + "; ".join(parts)


@dataclass(frozen=True)
class Whiteness:
    """Ljung-Box test of one output's innovations."""

    p_value: float
    largest_lag: int  # lag of the largest autocorrelation

    @property
    def white(self) -> bool:
        """Whether whiteness is accepted at the 1 % level."""
        return self.p_value >= 0.01


def covariance_from_information(triangle: FloatArray, prior_std: FloatArray, estimated: IntArray) -> FloatArray:
    """Inverse of the information matrix T'T plus priors, (p, p). nan for parameters not in `estimated` (at a bound),
    and for those that a direction moves which the data do not see.
    """
    p = prior_std.size
    covariance = np.full((p, p), np.nan)
    norm, singular, rotation = _directions(triangle, prior_std, estimated)
    kept = singular > _NULL * singular.max(initial=0.0)
    lost = 1.0 - np.sum(rotation[kept] ** 2, axis=0)
    determined = np.flatnonzero((norm > 0) & (lost < _TOUCHED))
    root = rotation[kept][:, determined].T / singular[kept]
    where = estimated[determined]
    covariance[np.ix_(where, where)] = root @ root.T / np.outer(norm[determined], norm[determined])
    return covariance


def _directions(triangle: FloatArray, prior_std: FloatArray, parameters: IntArray) -> tuple[FloatArray, ...]:
    """Lengths, singular values and right singular vectors (a row each) of column-scaled sensitivities with priors."""
    system = np.concatenate([triangle, np.diag(1.0 / prior_std)])[:, parameters]
    norm = np.linalg.norm(system, axis=0)
    _, singular, rotation = np.linalg.svd(np.linalg.qr(system / np.where(norm > 0, norm, 1.0), mode="r"))
    return norm, singular, rotation


def identifiability(triangle: FloatArray, prior_std: FloatArray, names: Sequence[str]) -> Identifiability:
    """Near-null directions of the column-scaled sensitivities, by the names of their parameters."""
    _, singular, rotation = _directions(triangle, prior_std, np.arange(prior_std.size))
    relative = singular / singular[0] if singular[0] > 0 else np.zeros_like(singular)
    directions = []
    for value, direction in sorted(zip(relative, rotation, strict=True), key=lambda pair: float(pair[0])):
        if value < _NEAR_NULL:
            order = np.argsort(-np.abs(direction))
            weights = {names[i]: float(direction[i]) for i in order if abs(direction[i]) >= _NAMED}
            directions.append(NearNull(weights, float(value)))
    return Identifiability(float(1.0 / relative[-1]) if relative[-1] > 0 else float("inf"), tuple(directions))


def whiteness(innovations: Sequence[FloatArray], lags: int) -> tuple[Whiteness, ...]:
    """Ljung-Box test for each output over all segments; `innovations` (n_outputs, n) each, nan in gaps."""
    from scipy.special import gammaincc

    tests = []
    for i in range(innovations[0].shape[0]):
        rows = [v[i] - np.nanmean(v[i]) if np.isfinite(v[i]).any() else np.zeros(0) for v in innovations]
        rows = [np.where(np.isfinite(row), row, 0.0) for row in rows]
        count = sum(int(np.count_nonzero(row)) for row in rows)
        power = sum(float(row @ row) for row in rows)
        sums = [sum(float(row[: row.size - k] @ row[k:]) for row in rows if row.size > k) for k in range(1, lags + 1)]
        r = np.array(sums) / power if power > 0 else np.zeros(lags)
        statistic = float(count * (count + 2) * np.sum(r**2 / np.maximum(count - np.arange(1, lags + 1), 1)))
        p_value = float(gammaincc(lags / 2, statistic / 2))
        tests.append(Whiteness(p_value, int(np.argmax(np.abs(r))) + 1))
    return tuple(tests)


# ---- Errors corrected for coloured residuals ----


class Whitened(NamedTuple):
    """One segment's residuals (n, n_outputs), whitened, zero in gaps, and their derivatives, the states following, by
    its own parameters (n, n_outputs, own): `own` (own,) are the places of those among all p.
    """

    own: IntArray
    residual: FloatArray
    by_parameter: FloatArray


def coloured_covariance(white: FloatArray, prior_information: FloatArray, segments: Sequence[Whitened]) -> FloatArray:
    """The corrected covariance, (p, p), of D = `white`, (p, p), not inflated for degrees of freedom, 0 of what is not
    estimated. `prior_information`: inverse variances (p,), 0 without prior; `segments`: the residuals.
    """
    residual = [segment.residual for segment in segments]
    correlation = autocorrelation(residual)
    samples = sum(len(v) for v in residual)
    models = [autoregression(correlation[:, a, a], samples) for a in range(correlation.shape[1])]
    middle = np.diag(prior_information)
    for segment in segments:
        own = np.ix_(segment.own, segment.own)
        middle[own] += _weighted_products(segment.by_parameter, models, correlation[0])
    return np.asarray(white @ middle @ white)


def _weighted_products(s: FloatArray, models: Sequence[FloatArray], turn: FloatArray) -> FloatArray:
    """Sum over i and j of S_i' R(i - j) S_j, (p, p), S (n, n_outputs, p)."""
    length, gains = 1 << (2 * len(s) - 1).bit_length(), []
    for model in models:  # the square root of the spectrum, of unit variance, at the frequencies of a real transform
        polynomial = np.abs(np.fft.rfft(np.concatenate([[1.0], -model]), length))
        response = 1.0 / np.maximum(polynomial, _LEAST_POLYNOMIAL)
        gains.append(response / np.sqrt(np.concatenate([response**2, response[-2:0:-1] ** 2]).mean()))
    shaped = np.fft.rfft(s, length, axis=0) * np.stack(gains, axis=1)[:, :, None]
    both_sides = np.full(len(shaped), 2.0)
    both_sides[[0, -1]] = 1.0
    product = np.einsum("f,fap,faq->pq", both_sides, shaped.conj(), turn @ shaped, optimize=True).real
    return np.asarray(product / length)


def inflation(white: FloatArray, corrected: FloatArray, unknowns: int, samples: int) -> float:
    """Factor for what the fit took out of the residuals' variance: N / (N - unknowns tr(D^-1 C) / p), 1 if white."""
    ratio = float(np.trace(np.linalg.solve(white, corrected))) / len(white)
    return samples / max(samples - unknowns * max(ratio, 1.0), 0.5 * samples)


def autocorrelation(residual: Sequence[FloatArray]) -> FloatArray:
    """R(lag), (orders + 1, n_outputs, n_outputs): mean of v(i) v(i + lag)' over what was measured."""
    n_outputs = residual[0].shape[1]
    longest = min(_HIGHEST_ORDER, sum(len(v) for v in residual) // _LEAST_SAMPLES_PER_ORDER)
    total = np.zeros((longest + 1, n_outputs, n_outputs))
    pairs = np.zeros_like(total)
    for v in residual:
        observed = (v != 0).astype(float)
        for lag in range(min(longest, len(v) - 1) + 1):
            total[lag] += v[: len(v) - lag].T @ v[lag:]
            pairs[lag] += observed[: len(v) - lag].T @ observed[lag:]
    return total / np.maximum(pairs, 1.0)


def autoregression(correlation: FloatArray, samples: int) -> FloatArray:
    """Coefficients (order,) of v(i) = sum a_k v(i - k) + white noise by Levinson's recursion, order by Akaike."""
    coefficients = chosen = np.zeros(0)
    variance = float(correlation[0])
    if variance <= 0:
        return chosen
    least = samples * np.log(variance)
    for order in range(1, len(correlation)):
        reflection = (correlation[order] - coefficients @ correlation[order - 1 : 0 : -1]) / variance
        reflection = float(np.clip(reflection, -_LARGEST_REFLECTION, _LARGEST_REFLECTION))
        coefficients = np.append(coefficients - reflection * coefficients[::-1], reflection)
        variance *= 1.0 - reflection**2
        criterion = samples * np.log(variance) + 2 * order
        if criterion < least:
            least, chosen = criterion, coefficients
    return chosen
