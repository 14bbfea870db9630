"""Covariance of the estimate where the residuals are coloured (Morelli and Klein, J. Aircraft 34, 1997).

    C = D [sum_i sum_j S_i' B^-1 R(i - j) B^-1 S_j] D

with D the covariance for white residuals, S the sensitivities of the outputs and R the autocorrelation of
the residuals. Sampled autocorrelations at long lags are mostly noise, and the sum needs them all; R is
therefore that of an autoregressive model of each output's residuals, its order chosen by Akaike's
criterion. The double sum is done over frequencies: with G the spectrum of the residuals,

    sum_i sum_j S_i' R(i - j) S_j = mean over f of conj(S_f)' G_f S_f,

which cannot turn negative.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from brv_hypo.arrays import FloatArray

_HIGHEST_ORDER = 20
_LEAST_SAMPLES_PER_ORDER = 10
_LEAST_POLYNOMIAL = 1e-6
_BLOCK = 32768
"""Samples transformed at a time. What is correlated across the edges of blocks this long is left out."""
_LARGEST_REFLECTION = 0.999
"""Keeps an autoregression stable where gaps make its autocorrelations inconsistent."""


def coloured_covariance(
    white: FloatArray,
    prior_information: FloatArray,
    sensitivity: Sequence[FloatArray],
    residual: Sequence[FloatArray],
) -> FloatArray:
    """The corrected covariance, (p, p).

    Args:
        white: D, (p, p), not inflated for degrees of freedom.
        prior_information: inverse variances of the priors, (p,), 0 where there is none.
        sensitivity: by segment, whitened, the states following, (n, n_outputs, p).
        residual: by segment, whitened, zero in gaps, (n, n_outputs).
    """
    correlation = autocorrelation(residual)
    samples = sum(len(v) for v in residual)
    models = [autoregression(correlation[:, a, a], samples) for a in range(correlation.shape[1])]
    middle = np.diag(prior_information)
    for s in sensitivity:
        for first in range(0, len(s), _BLOCK):
            middle = middle + _weighted_products(s[first : first + _BLOCK], models, correlation[0])
    return np.asarray(white @ middle @ white)


def white_covariance(
    white: FloatArray,
    prior_information: FloatArray,
    sensitivity: Sequence[FloatArray],
    residual: Sequence[FloatArray],
) -> FloatArray:
    """The same of residuals that are white, but of another variance than 1, (p, p)."""
    variance = np.diag(autocorrelation(residual)[0])
    middle = np.diag(prior_information)
    for s in sensitivity:
        middle = middle + np.einsum("nap,a,naq->pq", s, variance, s, optimize=True)
    return np.asarray(white @ middle @ white)


def _weighted_products(s: FloatArray, models: Sequence[FloatArray], turn: FloatArray) -> FloatArray:
    """Sum over i and j of S_i' R(i - j) S_j, (p, p), S (n, n_outputs, p)."""
    length = 1 << (2 * len(s) - 1).bit_length()
    gain = np.stack([_gain(model, length) for model in models], axis=1)
    shaped = np.fft.rfft(s, length, axis=0) * gain[:, :, None]
    turned = turn @ shaped
    both_sides = np.full(len(gain), 2.0)
    both_sides[[0, -1]] = 1.0
    product = np.einsum("f,fap,faq->pq", both_sides, shaped.conj(), turned, optimize=True).real
    return np.asarray(product / length)


def inflation(white: FloatArray, corrected: FloatArray, unknowns: int, samples: int) -> float:
    """Factor for what the fit took out of the residuals' variance.

    In white noise that is one sample per unknown, in coloured noise as many more as the variance of the
    unknowns is larger: N / (N - unknowns tr(D^-1 C) / p).
    """
    ratio = float(np.trace(np.linalg.solve(white, corrected))) / len(white)
    return samples / max(samples - unknowns * max(ratio, 1.0), 0.5 * samples)


def autocorrelation(residual: Sequence[FloatArray]) -> FloatArray:
    """R(lag), (orders + 1, n_outputs, n_outputs): mean of v(i) v(i + lag)' over what was measured."""
    n_outputs = residual[0].shape[1]
    longest = min(_HIGHEST_ORDER, sum(len(v) for v in residual) // _LEAST_SAMPLES_PER_ORDER)
    total = np.zeros((longest + 1, n_outputs, n_outputs))
    pairs = np.zeros_like(total)
    for v in residual:
        seen = (v != 0).astype(float)
        for lag in range(min(longest, len(v) - 1) + 1):
            total[lag] += v[: len(v) - lag].T @ v[lag:]
            pairs[lag] += seen[: len(v) - lag].T @ seen[lag:]
    return total / np.maximum(pairs, 1.0)


def autoregression(correlation: FloatArray, samples: int) -> FloatArray:
    """Coefficients of v(i) = sum a_k v(i - k) + white noise, (order,).

    By Levinson's recursion, the order by Akaike's criterion. `correlation` (orders + 1,) is the
    autocorrelation, lag 0 first.
    """
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


def _gain(coefficients: FloatArray, length: int) -> FloatArray:
    """Square root of the model's spectrum, of unit variance, at the frequencies of a real transform."""
    polynomial = np.abs(np.fft.rfft(np.concatenate([[1.0], -coefficients]), length))
    response = 1.0 / np.maximum(polynomial, _LEAST_POLYNOMIAL)
    power = np.concatenate([response**2, response[-2:0:-1] ** 2])
    return np.asarray(response / np.sqrt(power.mean()))
