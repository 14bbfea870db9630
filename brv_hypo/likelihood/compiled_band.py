"""The matrix of `band` for neighbours in time and process noise, assembled and factored by compiled loops.

    [ J'J   D' ]    with Q, R and so J'J = H' R^-1 H of several guesses of the variances, one after the other
    [ D    -Q  ]

Its few diagonals cost LAPACK's routines a call a column. Row r holds column c at band[r, c - r + half]; rows are
exchanged for the largest pivot, which keeps the elimination stable however fast the motion grows or decays.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from brv_hypo.arrays import FloatArray, IntArray
from brv_hypo.likelihood.compiled import compiled, multiply


class LinearModel(NamedTuple):
    """One segment, linearised, states divided by their size: m states, q outputs, n samples, c columns.

    dynamics (n - 1, 2, m, m): D's blocks at both ends of an interval; observe H (n, q, m); `outputs` (n, q, c) and
    `defects` (n, m, c), the first column what is left, the others by parameters, the first defect that of the initial
    state; `step` (n - 1,) s; `pattern` (n,) which of the patterns of gaps each sample has.
    """

    dynamics: FloatArray
    observe: FloatArray
    outputs: FloatArray
    defects: FloatArray
    step: FloatArray
    pattern: IntArray


class Variances(NamedTuple):
    """`start` (m,) of the initial state, infinite where it is free; `drive` (m,) of the process noise, per s;
    `whitener` (patterns, q, q) with W'W the inverse covariance of what a pattern measured.
    """

    start: FloatArray
    drive: FloatArray
    whitener: FloatArray


@compiled
def _inverses(whitener: FloatArray) -> FloatArray:
    """W'W of each pattern."""
    found = np.zeros_like(whitener)
    for g in range(whitener.shape[0]):
        multiply(whitener[g].T, whitener[g], found[g])
    return found


@compiled
def _assembled(model: LinearModel, variances: Variances) -> tuple[FloatArray, float]:
    """The band, and what its objective is divided by so that all blocks are of one size."""
    n, q, m = model.observe.shape
    half = 2 * m - 1
    band = np.zeros((2 * m * n, 3 * half + 1))
    inverse = _inverses(variances.whitener)
    product = np.zeros((q, m))
    total = 0.0
    for k in range(n):
        r, h = inverse[model.pattern[k]], model.observe[k]
        at = 2 * m * k + m
        multiply(r, h, product)
        for i in range(m):
            for j in range(m):
                value = 0.0
                for a in range(q):
                    value += h[a, i] * product[a, j]
                band[at + i, half + j - i] = value
            total += band[at + i, half]
    weight = total / (n * m) if total > 0.0 else 1.0
    for k in range(n):
        at = 2 * m * k
        for i in range(m):
            for j in range(m):
                band[at + m + i, half + j - i] /= weight
            if k == 0:
                free = np.isinf(variances.start[i])
                band[at + i, half] = 1.0 if free else -variances.start[i] * weight
                band[at + i, half + m] = 0.0 if free else 1.0
                band[at + m + i, half - m] = 0.0 if free else 1.0
                continue
            band[at + i, half] = -variances.drive[i] * model.step[k - 1] * weight
            for j in range(m):
                a, b = model.dynamics[k - 1, 0, i, j], model.dynamics[k - 1, 1, i, j]
                band[at + i, half - m + j - i] = a
                band[at - m + j, half + m + i - j] = a
                band[at + i, half + m + j - i] = b
                band[at + m + j, half - m + i - j] = b
    return band, weight


@compiled
def _factored(band: FloatArray, right: FloatArray) -> float:
    """Both reduced to an upper triangle, in place; log |det|, nan where it is singular."""
    size = band.shape[0]
    half = (band.shape[1] - 1) // 3
    columns = right.shape[1]
    log_det, product = 0.0, 1.0
    for j in range(size):
        last, end = min(j + half, size - 1), min(j + 2 * half, size - 1)
        best, largest = j, abs(band[j, half])
        for r in range(j + 1, last + 1):
            value = abs(band[r, j - r + half])
            if value > largest:
                best, largest = r, value
        if not largest > 0.0:
            return np.nan
        if best != j:
            for c in range(j, end + 1):
                kept = band[j, c - j + half]
                band[j, c - j + half] = band[best, c - best + half]
                band[best, c - best + half] = kept
            for c in range(columns):
                kept = right[j, c]
                right[j, c] = right[best, c]
                right[best, c] = kept
        product *= largest
        if product > 1e100 or product < 1e-100:
            log_det += np.log(product)
            product = 1.0
        for r in range(j + 1, last + 1):
            factor = band[r, j - r + half] / band[j, half]
            if factor != 0.0:
                for c in range(1, end - j + 1):
                    band[r, c + j - r + half] -= factor * band[j, c + half]
                for c in range(columns):
                    right[r, c] -= factor * right[j, c]
    return float(log_det + np.log(product))


@compiled
def log_determinant(model: LinearModel, variances: Variances) -> float:
    """log |det| without the rows of free initial states' multipliers; nan where singular."""
    band, weight = _assembled(model, variances)
    free = np.isinf(variances.start).sum()
    return float(_factored(band, np.zeros((band.shape[0], 0))) + free * np.log(weight))


@compiled
def log_determinants(
    model: LinearModel, start: FloatArray, drive: FloatArray, whitener: FloatArray
) -> FloatArray:
    """The same of several variances, (k,): `drive` (k, m), `whitener` (k, patterns, q, q)."""
    found = np.zeros(len(drive))
    for i in range(len(drive)):
        found[i] = log_determinant(model, Variances(start, drive[i], whitener[i]))
    return found


class Rows(NamedTuple):
    """The whitened outputs (n, q, c) and process noise (n, m, c) that states, best for the variances, leave; and the
    squares of the outputs, (c,), with the states held.
    """

    outputs: FloatArray
    noise: FloatArray
    direct: FloatArray


@compiled
def rows_of(
    model: LinearModel, variances: Variances, states: FloatArray, multipliers: FloatArray
) -> Rows:
    """What states and multipliers of `solved` leave."""
    n, q, m = model.observe.shape
    columns = model.outputs.shape[2]
    outputs, noise, direct = np.zeros((n, q, columns)), np.zeros((n, m, columns)), np.zeros(columns)
    held, left = np.zeros((q, columns)), np.zeros((q, columns))
    for k in range(n):
        whitener = variances.whitener[model.pattern[k]]
        multiply(model.observe[k], states[k], left)
        multiply(whitener, model.outputs[k], held)
        multiply(whitener, left, outputs[k])
        for a in range(q):
            for c in range(columns):
                outputs[k, a, c] += held[a, c]
                direct[c] += held[a, c] ** 2
        for i in range(m):
            variance = variances.start[i] if k == 0 else variances.drive[i] * model.step[k - 1]
            root = np.sqrt(variance) if np.isfinite(variance) else 0.0
            for c in range(columns):
                noise[k, i, c] = root * multipliers[k, i, c]
    return Rows(outputs, noise, direct)


@compiled
def solved(
    model: LinearModel, variances: Variances, probe: FloatArray
) -> tuple[FloatArray, FloatArray, float]:
    """States and multipliers, (n, m, c) each, as `band` has them, and the growth of the `probe` (2 m n,) times the
    norm of the matrix: its condition, infinite where it is singular.
    """
    n, q, m = model.observe.shape
    columns = model.outputs.shape[2]
    band, weight = _assembled(model, variances)
    half = (band.shape[1] - 1) // 3
    right = np.zeros((band.shape[0], columns + 1))
    right[:, columns] = probe
    weighted = np.zeros((q, columns))
    inverse = _inverses(variances.whitener)
    for k in range(n):
        at = 2 * m * k
        multiply(inverse[model.pattern[k]], model.outputs[k], weighted)
        for i in range(m):
            known = k > 0 or not np.isinf(variances.start[i])
            for c in range(columns):
                if known:
                    right[at + i, c] = -model.defects[k, i, c]
                value = 0.0
                for a in range(q):
                    value += model.observe[k, a, i] * weighted[a, c]
                right[at + m + i, c] = -value / weight
    norm = 0.0
    sums = np.zeros(band.shape[0])
    for r in range(band.shape[0]):
        for c in range(max(0, r - half), min(band.shape[0], r + half + 1)):
            sums[c] += abs(band[r, c - r + half])
    norm = sums.max()
    states, multipliers = np.zeros((n, m, columns)), np.zeros((n, m, columns))
    if np.isnan(_factored(band, right)):
        return states, multipliers, np.inf
    for j in range(band.shape[0] - 1, -1, -1):
        for s in range(1, min(2 * half, band.shape[0] - 1 - j) + 1):
            factor = band[j, half + s]
            for c in range(columns + 1):
                right[j, c] -= factor * right[j + s, c]
        for c in range(columns + 1):
            right[j, c] /= band[j, half]
    for k in range(n):
        for i in range(m):
            for c in range(columns):
                multipliers[k, i, c] = right[2 * m * k + i, c] * weight
                states[k, i, c] = right[2 * m * k + m + i, c]
    grown = np.sqrt(np.sum(right[:, columns] ** 2) / np.sum(probe**2))
    return states, multipliers, grown * norm
