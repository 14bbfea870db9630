"""Covariance of the measurement noise: whitening with gaps, Eq. 3.11 and Eq. 3.10."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal

import numpy as np

from brv_hypo.arrays import BoolArray, FloatArray, IntArray

Shape = Literal["diagonal", "full"]  # of the noise covariance: outputs independent or not

_ROUNDING = 1e-14
_BITS = 62  # outputs whose pattern of gaps fits one integer
_FIRST_GUESS = 100.0  # least first guess of a noise variance over the least plausible one
_THIRD_DIFFERENCE = 20.0  # variance of the third difference of unit white noise: 1 + 9 + 9 + 1


def whitening(covariance: FloatArray, measured: BoolArray) -> FloatArray:
    """W (n, n_outputs, n_outputs) with W'W the inverse covariance of what was measured at each sample.

    `covariance` (n_outputs, n_outputs), `measured` (n_outputs, n). Rows of gaps are zero.
    """
    n_outputs = len(covariance)
    variance = np.diag(covariance)
    if np.count_nonzero(covariance) == np.count_nonzero(variance):  # of outputs that are independent
        return np.where(measured.T, 1.0 / np.sqrt(variance), 0.0)[:, :, None] * np.eye(n_outputs)
    weights = np.zeros((measured.shape[1], n_outputs, n_outputs))
    for pattern, where in _patterns(measured):
        block = np.ix_(pattern, pattern)
        of_pattern = np.zeros((n_outputs, n_outputs))
        of_pattern[block] = np.linalg.inv(np.linalg.cholesky(covariance[block]))
        weights[where] = of_pattern
    return weights


def estimate_covariance(
    residual: FloatArray, measured: BoolArray, shape: Shape, previous: FloatArray, floor: FloatArray
) -> FloatArray:
    """B of Eq. 3.11, the mean of v v', (n_outputs, n_outputs), full or diagonal.

    Args:
        residual: v, (n_outputs, n); its value where nothing was measured is ignored.
        measured: (n_outputs, n).
        shape: "diagonal" averages each output over its own samples; "full" fills gaps by their conditional
            expectation under `previous` (one step of expectation-maximisation; exact where there are none).
        previous: the covariance before, (n_outputs, n_outputs).
        floor: least variance of each output, (n_outputs,): noise-free data must not end in a division by
            zero.
    """
    n_outputs = residual.shape[0]
    v = np.where(measured, residual, 0.0)
    if shape == "diagonal":
        count = np.maximum(measured.sum(axis=1), 1)
        return np.diag(np.maximum((v**2).sum(axis=1) / count, floor))
    total = np.zeros((n_outputs, n_outputs))
    for pattern, where in _patterns(measured):
        observed, gap = np.flatnonzero(pattern), np.flatnonzero(~pattern)
        filled = v[:, where].copy()
        if gap.size:
            gain = np.linalg.solve(previous[np.ix_(observed, observed)], previous[np.ix_(observed, gap)]).T
            filled[gap] = gain @ filled[observed]
            remaining = previous[np.ix_(gap, gap)] - gain @ previous[np.ix_(observed, gap)]
            total[np.ix_(gap, gap)] += where.sum() * remaining
        total += filled @ filled.T
    covariance = total / max(int(measured.any(axis=0).sum()), 1)
    covariance[np.diag_indices(n_outputs)] = np.maximum(np.diag(covariance), floor)
    return np.asarray(covariance)


def negative_log_likelihood(residual: FloatArray, measured: BoolArray, covariance: FloatArray) -> float:
    """NLLF of Eq. 3.10 with erratum E8: 1/2 sum(v' B^-1 v + log det B), over what was measured."""
    v = np.where(measured, residual, 0.0)
    total = 0.5 * log_determinants(measured, covariance)
    for pattern, where in _patterns(measured):
        part = v[pattern][:, where]
        total += 0.5 * float(np.sum(part * np.linalg.solve(covariance[np.ix_(pattern, pattern)], part)))
    return total


def log_determinants(measured: BoolArray, covariance: FloatArray) -> float:
    """Sum over samples of log det of the covariance of what was measured, `measured` (n_outputs, n)."""
    return float(
        sum(
            where.sum() * np.linalg.slogdet(covariance[np.ix_(pattern, pattern)])[1]
            for pattern, where in _patterns(measured)
        )
    )


def noise_from_differences(y: FloatArray) -> FloatArray:
    """A first guess of the noise covariance, diagonal, from third differences: blind to smooth motion.

    `y` is (n_outputs, n), nan in gaps.
    """
    variance = least_variance(y) * _FIRST_GUESS
    for i, row in enumerate(y):
        across = np.diff(row, 3)
        differences = across[np.isfinite(across)]
        if differences.size < row.size / 10:  # slower than the rest: its own samples are far apart
            differences = np.diff(row[np.isfinite(row)], 3)
        if differences.size:
            variance[i] = max(variance[i], float(np.mean(differences**2)) / _THIRD_DIFFERENCE)
    return np.diag(variance)


def least_variance(y: FloatArray) -> FloatArray:
    """The least plausible noise variance of each output, (n_outputs,): that of rounding."""
    mean_square = np.array([np.mean(row[np.isfinite(row)] ** 2) if np.isfinite(row).any() else 1.0 for row in y])
    return np.asarray(_ROUNDING * np.where(mean_square > 0, mean_square, 1.0))


def _patterns(measured: BoolArray) -> Iterator[tuple[BoolArray, BoolArray]]:
    """Each distinct set of outputs measured together, (n_outputs,), and the samples where it holds, (n,)."""
    if measured.all():
        yield np.ones(measured.shape[0], bool), np.ones(measured.shape[1], bool)
        return
    codes = _codes(measured)
    for code, first in zip(*np.unique(codes, return_index=True), strict=True):
        pattern = measured[:, first]
        if pattern.any():
            yield pattern, codes == code


def _codes(measured: BoolArray) -> IntArray:
    """A number for each sample, the same where the same outputs were measured, (n,)."""
    codes = np.zeros(measured.shape[1], dtype=np.int64)
    for first in range(0, len(measured), _BITS):
        part = measured[first : first + _BITS]
        value = (np.int64(1) << np.arange(len(part), dtype=np.int64)) @ part
        codes = np.unique(np.stack([codes, value]), axis=1, return_inverse=True)[1].reshape(-1) if first else value
    return codes
