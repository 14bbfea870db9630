"""Kalman filter over the samples, and derivatives of its determinant, compiled by numba.

Imported only where process noise is estimated or given: importing numba costs more than most fits. Matrices of a
sample have few rows, for which plain loops are faster than library calls. m states, q outputs, n samples.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar, cast

import numpy as np
from numba import njit

from brv_hypo.arrays import FloatArray

Compiled = TypeVar("Compiled", bound=Callable[..., Any])


def compiled(function: Compiled) -> Compiled:
    """Compiled on first call, kept on disk."""
    return cast(Compiled, njit(cache=True, nogil=True, error_model="numpy")(function))


class Filter(NamedTuple):
    """A Kalman filter's run."""

    innovation: FloatArray
    """Innovations, (n, q), nan where nothing was measured."""
    inverse: FloatArray
    """Inverse of their covariance, (n, q, q), unit rows where nothing was measured."""
    gain: FloatArray
    """Gains, (n, m, q)."""
    before: FloatArray
    """Covariance of the state before its sample, (n, m, m)."""
    after: FloatArray
    """The same after it."""
    log_det: float
    """Half the sum of log det of the innovations' covariance."""
    squares: float
    """Half the sum of the innovations' weighted squares."""


@compiled
def multiply(a: FloatArray, b: FloatArray, out: FloatArray) -> None:
    """out = a b."""
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            total = 0.0
            for k in range(a.shape[1]):
                total += a[i, k] * b[k, j]
            out[i, j] = total


@compiled
def inverted(a: FloatArray, out: FloatArray, root: FloatArray) -> float:
    """out = inverse of a positive-definite a; its log det, nan where it is not. `root` is overwritten."""
    size = a.shape[0]
    log_det = 0.0
    for i in range(size):
        for j in range(i + 1):
            total = a[i, j]
            for k in range(j):
                total -= root[i, k] * root[j, k]
            if i == j:
                if not total > 0.0:
                    return np.nan
                log_det += np.log(total)
                root[i, i] = np.sqrt(total)
            else:
                root[i, j] = total / root[j, j]
    for column in range(size):
        for i in range(size):
            total = 1.0 if i == column else 0.0
            for k in range(i):
                total -= root[i, k] * out[k, column]
            out[i, column] = total / root[i, i]
        for i in range(size - 1, -1, -1):
            total = out[i, column]
            for k in range(i + 1, size):
                total -= root[k, i] * out[k, column]
            out[i, column] = total / root[i, i]
    return log_det


@compiled
def filtered(
    transition: FloatArray,
    shift: FloatArray,
    driven: FloatArray,
    residual: FloatArray,
    observe: FloatArray,
    noise: FloatArray,
) -> Filter:
    """Kalman filter from a first state that is known to be 0; `residual` (n, q) is nan where nothing was measured.

    transition, driven (n - 1, m, m); shift (n - 1, m); observe (n, q, m); noise (q, q). Joseph's form.
    """
    n, q, m = observe.shape
    innovation = np.full((n, q), np.nan)
    covariance, inverse, gain = np.zeros((q, q)), np.zeros((n, q, q)), np.zeros((n, m, q))
    before, after = np.zeros((n, m, m)), np.zeros((n, m, m))
    mean, kept = np.zeros(m), np.zeros(m)
    projected, left, keep, root = np.zeros((q, m)), np.zeros((m, m)), np.zeros((m, m)), np.zeros((q, q))
    log_det, squares = 0.0, 0.0
    for k in range(n):
        if k > 0:
            f = transition[k - 1]
            multiply(f, after[k - 1], left)
            multiply(left, f.T, before[k])
            for i in range(m):
                kept[i] = mean[i]
                for j in range(m):
                    before[k, i, j] += driven[k - 1, i, j]
            for i in range(m):
                mean[i] = shift[k - 1, i]
                for j in range(m):
                    mean[i] += f[i, j] * kept[j]
        h, p = observe[k], before[k]
        multiply(h, p, projected)
        for a in range(q):
            innovation[k, a] = residual[k, a]
            for i in range(m):
                innovation[k, a] -= h[a, i] * mean[i]
            for b in range(q):
                total = noise[a, b]
                for i in range(m):
                    total += projected[a, i] * h[b, i]
                both = np.isfinite(residual[k, a]) and np.isfinite(residual[k, b])
                covariance[a, b] = total if both else (1.0 if a == b else 0.0)
        log_det += 0.5 * inverted(covariance, inverse[k], root)
        for i in range(m):
            for a in range(q):
                total = 0.0
                for b in range(q):
                    if np.isfinite(residual[k, b]):
                        total += projected[b, i] * inverse[k, b, a]
                gain[k, i, a] = total if np.isfinite(residual[k, a]) else 0.0
        for i in range(m):
            for j in range(m):
                keep[i, j] = 1.0 if i == j else 0.0
                for a in range(q):
                    keep[i, j] -= gain[k, i, a] * h[a, j]
        multiply(keep, p, left)
        multiply(left, keep.T, after[k])
        for a in range(q):
            if not np.isfinite(residual[k, a]):
                continue
            for i in range(m):
                mean[i] += gain[k, i, a] * innovation[k, a]
            for b in range(q):
                if not np.isfinite(residual[k, b]):
                    continue
                squares += 0.5 * innovation[k, a] * inverse[k, a, b] * innovation[k, b]
                for i in range(m):
                    for j in range(m):
                        after[k, i, j] += gain[k, i, a] * noise[a, b] * gain[k, j, b]
    return Filter(innovation, inverse, gain, before, after, log_det, squares)


@compiled
def determinant_derivatives(
    run: Filter, transition: FloatArray, driven: FloatArray, observe: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Derivatives of the filter's `log_det` by transition, driven (n - 1, m, m) and observe (n, q, m), backwards.

    The gain being optimal, its own change does not count; see Bryson & Frazier, Proc. Optimum System Synthesis Conf.
    (1963), for the same recursion of states.
    """
    n, q, m = observe.shape
    by_transition, by_driven = np.zeros((n - 1, m, m)), np.zeros((n - 1, m, m))
    by_observe = np.zeros((n, q, m))
    later, left, keep = np.zeros((m, m)), np.zeros((m, m)), np.zeros((m, m))
    by_after, passed, weighted = np.zeros((m, m)), np.zeros((m, m)), np.zeros((q, m))
    for k in range(n - 1, -1, -1):
        if k < n - 1:
            f = transition[k]
            by_driven[k] = later
            multiply(later, f, left)
            multiply(f.T, left, by_after)
            multiply(left, run.after[k], by_transition[k])
            by_transition[k] *= 2.0
        h, gain, p = observe[k], run.gain[k], run.before[k]
        for i in range(m):
            for j in range(m):
                keep[i, j] = 1.0 if i == j else 0.0
                for a in range(q):
                    keep[i, j] -= gain[i, a] * h[a, j]
        multiply(by_after, keep, left)
        multiply(left, p, passed)
        multiply(keep.T, left, later)
        multiply(run.inverse[k], h, weighted)
        for a in range(q):
            if not np.isfinite(run.innovation[k, a]):
                continue
            for j in range(m):
                for i in range(m):
                    by_observe[k, a, j] += weighted[a, i] * p[i, j] - 2.0 * gain[i, a] * passed[i, j]
            for i in range(m):
                for j in range(m):
                    later[i, j] += 0.5 * h[a, i] * weighted[a, j]
    return by_transition, by_driven, by_observe
