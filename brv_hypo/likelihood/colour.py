"""Covariance of the estimate where the residuals are coloured (Morelli and Klein, J. Aircraft 34, 1997).

    C = D [sum_i sum_j S_i' B^-1 R(i - j) B^-1 S_j] D

with D the covariance for white residuals, S the sensitivities of the outputs and R the autocorrelation of
the residuals. R is taken up to the lag where it sinks into its own noise, and tapered from there on
(flat-top window; Politis, J. Nonparametric Statistics 15, 2003): a white residual is left nearly as it is.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from brv_hypo.arrays import FloatArray

_LONGEST = 200
"""Longest lag looked at, samples."""
_QUIET = 5
"""Lags in a row that must be insignificant for the autocorrelation to have ended."""


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
    correlation = autocorrelation(residual, min(_LONGEST, max(len(v) for v in residual) // 4))
    end = _last_significant_lag(correlation, sum(len(v) for v in residual))
    flat = np.clip(2.0 - np.arange(2 * end + 1) / max(end, 1), 0.0, 1.0)
    triangular = 1.0 - np.arange(2 * end + 1) / (2.0 * end + 1.0)
    corrected = np.full_like(white, np.nan)
    for taper in (flat, triangular):  # the second is positive whatever the residuals
        middle = _middle(sensitivity, correlation, taper) + np.diag(prior_information)
        corrected = white @ middle @ white
        if np.all(np.linalg.eigvalsh(middle) > 0):
            break
    return np.asarray(corrected)


def inflation(white: FloatArray, corrected: FloatArray, unknowns: int, samples: int) -> float:
    """Factor for what the fit took out of the residuals' variance.

    In white noise that is one sample per unknown, in coloured noise as many more as the variance of the
    unknowns is
    larger: N / (N - unknowns tr(D^-1 C) / p).
    """
    ratio = float(np.trace(np.linalg.solve(white, corrected))) / len(white)
    return samples / max(samples - unknowns * max(ratio, 1.0), 0.5 * samples)


def autocorrelation(residual: Sequence[FloatArray], longest: int) -> FloatArray:
    """R(lag), (longest + 1, n_outputs, n_outputs): mean of v(i) v(i + lag)' over all segments."""
    n_outputs = residual[0].shape[1]
    total = np.zeros((longest + 1, n_outputs, n_outputs))
    seen = np.zeros((n_outputs, n_outputs))
    for v in residual:
        for lag in range(min(longest, len(v) - 1) + 1):
            total[lag] += v[: len(v) - lag].T @ v[lag:]
        measured = np.count_nonzero(v, axis=0)
        seen += np.sqrt(np.outer(measured, measured))
    return total / np.maximum(seen, 1.0)


def _last_significant_lag(correlation: FloatArray, samples: int) -> int:
    """The lag after which no output's autocorrelation is significant for several lags in a row; at most half
    of all.
    """
    power = np.maximum(np.einsum("kaa->ka", correlation)[0], np.finfo(float).tiny)
    loud = np.abs(np.einsum("kaa->ka", correlation) / power).max(axis=1) > 2 * np.sqrt(
        np.log10(samples) / samples
    )
    most = (len(loud) - 1) // 2
    for lag in range(most):
        if not loud[lag + 1 : lag + 1 + _QUIET].any():
            return lag
    return most


def _middle(sensitivity: Sequence[FloatArray], correlation: FloatArray, taper: FloatArray) -> FloatArray:
    p = sensitivity[0].shape[2]
    total = np.zeros((p, p))
    for s in sensitivity:
        for lag in range(min(len(taper), len(s))):
            n = len(s) - lag
            turned = (correlation[lag] @ s[lag:]).reshape(-1, p)
            block = s[:n].reshape(-1, p).T @ turned
            total += taper[lag] * (block if lag == 0 else block + block.T)
    return total
