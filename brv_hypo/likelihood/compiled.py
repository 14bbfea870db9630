"""Loops over samples for process noise, compiled by numba: Kalman filter and banded matrix.

Imported only where process noise is estimated or given: importing numba costs more than most fits. Matrices of a
sample have few rows, for which plain loops are faster than library calls. m states, q outputs, n samples, c columns.

The matrix of `kkt` for neighbours in time is assembled and factored for several guesses of the variances in turn:

    [ J'J   D' ]    with Q, R and so J'J = H' R^-1 H
    [ D    -Q  ]

Row r holds column c at band[r, c - r + half]; rows are exchanged for the largest pivot, which keeps the elimination
stable however fast the motion grows or decays.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar, cast

import numpy as np
from numba import njit

from brv_hypo.arrays import FloatArray, IntArray

# ---- Loops over samples that NumPy cannot run at once, for process noise alone, compiled by numba ----


Compiled = TypeVar("Compiled", bound=Callable[..., Any])


def compiled(function: Compiled) -> Compiled:
    """Compiled on first call, kept on disk."""
    return cast(Compiled, njit(cache=True, nogil=True, error_model="numpy")(function))


def reassociated(function: Compiled) -> Compiled:
    """The same for long sums, whose terms may be added in any order."""
    return cast(Compiled, njit(cache=True, nogil=True, error_model="numpy", fastmath={"reassoc", "contract"})(function))


class Filter(NamedTuple):
    """A Kalman filter's run: `innovation` (n, q), the `inverse` of its covariance (n, q, q), unit rows where nothing
    was measured; `gain` (n, m, q); `before` and `after` (n, m, m), covariance of the state before and after its
    sample; half the sum of log det and of squares of the innovations.
    """

    innovation: FloatArray
    inverse: FloatArray
    gain: FloatArray
    before: FloatArray
    after: FloatArray
    log_det: float
    squares: float


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


_LANES = 8
"""Matrices that are factored side by side, in the processor's vectors."""
_SLAB = 64
"""Rows that are brought to a triangle at a time: they stay in cache."""


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
    size, width = band.shape
    half = (width - 1) // 3
    columns = right.shape[1]
    # Entry (r, c) stands at r (width - 1) + c + half of what lies in one piece: one index, not two, in the inner loop.
    flat, stride = band.ravel(), width - 1
    log_det, product = 0.0, 1.0
    for j in range(size):
        last, end = min(j + half, size - 1), min(j + 2 * half, size - 1)
        here = j * stride + half
        best, largest = j, abs(flat[here + j])
        for r in range(j + 1, last + 1):
            value = abs(flat[r * stride + half + j])
            if value > largest:
                best, largest = r, value
        if not largest > 0.0:
            return np.nan
        if best != j:
            there = best * stride + half
            for c in range(j, end + 1):
                kept = flat[here + c]
                flat[here + c] = flat[there + c]
                flat[there + c] = kept
            for c in range(columns):
                kept = right[j, c]
                right[j, c] = right[best, c]
                right[best, c] = kept
        product *= largest
        if product > 1e100 or product < 1e-100:
            log_det += np.log(product)
            product = 1.0
        for r in range(j + 1, last + 1):
            row = r * stride + half
            factor = flat[row + j] / flat[here + j]
            if factor != 0.0:
                for c in range(j + 1, end + 1):
                    flat[row + c] -= factor * flat[here + c]
                for c in range(columns):
                    right[r, c] -= factor * right[j, c]
    return float(log_det + np.log(product))


@compiled
def log_determinants(
    model: LinearModel, start: FloatArray, drive: FloatArray, whitener: FloatArray
) -> FloatArray:
    """log |det| without the rows of free initial states' multipliers, (k,), of several variances near each other:
    `drive` (k, m), `whitener` (k, patterns, q, q). nan where singular.
    """
    inverse = np.zeros_like(whitener)
    for v in range(len(drive)):
        inverse[v] = _inverses(whitener[v])
    weight = _weights(model, inverse)
    found = np.zeros(len(drive))
    for first in range(0, len(drive), _LANES):
        of_lane = np.minimum(np.arange(first, first + _LANES), len(drive) - 1)
        lanes = _log_determinants(
            model,
            start,
            np.ascontiguousarray(drive[of_lane].T),
            np.ascontiguousarray(inverse[of_lane].transpose(1, 2, 3, 0)),
            weight[of_lane],
        )
        last = min(first + _LANES, len(drive))
        found[first:last] = lanes[: last - first]
    found += np.isinf(start).sum() * np.log(weight)
    return found


@compiled
def _log_determinants(
    model: LinearModel, start: FloatArray, drive: FloatArray, inverse: FloatArray, weight: FloatArray
) -> FloatArray:
    """Those of as many variances as there are lanes, `drive` (m, lanes), `inverse` (patterns, q, q, lanes): matrices
    side by side, pivots those of the first, only the rows of two samples held at a time.
    """
    n, _, m = model.observe.shape
    stage, half = 2 * m, 2 * m - 1
    window = np.zeros((2 * stage, 3 * stage, _LANES))
    found, product, factor = np.zeros(_LANES), np.ones(_LANES), np.zeros(_LANES)
    _put_stage(window, 0, 0, model, start, drive, inverse, weight)
    for k in range(n):
        last = stage - 1
        if k + 1 < n:
            _put_stage(window, k + 1, stage, model, start, drive, inverse, weight)
            last = 2 * stage - 1
        for j in range(stage):
            best = j
            for r in range(j + 1, min(j + half, last) + 1):
                if abs(window[r, j, 0]) > abs(window[best, j, 0]):
                    best = r
            end = min(j + 2 * half, 3 * stage - 1)
            here = window[j]
            if best != j:
                there = window[best]
                for c in range(j, end + 1):
                    for v in range(_LANES):
                        kept = here[c, v]
                        here[c, v] = there[c, v]
                        there[c, v] = kept
            for v in range(_LANES):
                product[v] *= abs(here[j, v])
            if not 1e-100 < product[0] < 1e100:
                found += np.log(product)
                product[:] = 1.0
            for r in range(j + 1, min(j + half, last) + 1):
                row = window[r]
                for v in range(_LANES):
                    factor[v] = row[j, v] / here[j, v]
                for c in range(j + 1, end + 1):
                    for v in range(_LANES):
                        row[c, v] -= factor[v] * here[c, v]
        window[:stage, : 2 * stage] = window[stage:, stage:]
        window[:stage, 2 * stage :] = 0.0
        window[stage:] = 0.0
    found += np.log(product)
    return np.where(np.isfinite(found), found, np.nan)


@compiled
def _weights(model: LinearModel, inverse: FloatArray) -> FloatArray:
    """What the objective is divided by so that all blocks are of one size, of each `inverse` (k, patterns, q, q)."""
    n, q, m = model.observe.shape
    squares = np.zeros(inverse.shape[1:])
    for k in range(n):
        h = model.observe[k]
        for a in range(q):
            for b in range(q):
                for i in range(m):
                    squares[model.pattern[k], a, b] += h[a, i] * h[b, i]
    total = np.zeros(len(inverse))
    for v in range(len(inverse)):
        total[v] = np.sum(inverse[v] * squares) / (n * m)
        if not total[v] > 0.0:
            total[v] = 1.0
    return total


@compiled
def _put_stage(
    window: FloatArray,
    k: int,
    at: int,
    model: LinearModel,
    start: FloatArray,
    drive: FloatArray,
    inverse: FloatArray,
    weight: FloatArray,
) -> None:
    """The rows of sample k: those of its multipliers from row and column `at` on, then those of its states."""
    n, q, m = model.observe.shape
    h, own = model.observe[k], inverse[model.pattern[k]]
    for i in range(m):
        for j in range(i + 1):
            entry = window[at + m + i, at + m + j]
            for a in range(q):
                for b in range(q):
                    size = h[a, i] * h[b, j]
                    for v in range(_LANES):
                        entry[v] += size * own[a, b, v]
            for v in range(_LANES):
                entry[v] /= weight[v]
            if i != j:
                window[at + m + j, at + m + i] = entry
        if k > 0:
            for v in range(_LANES):
                window[at + i, at + i, v] = -drive[i, v] * model.step[k - 1] * weight[v]
            for j in range(m):
                window[at + i, at - m + j] = model.dynamics[k - 1, 0, i, j]
                window[at + i, at + m + j] = window[at + m + j, at + i] = model.dynamics[k - 1, 1, i, j]
        elif np.isinf(start[i]):
            window[at + i, at + i] = 1.0
        else:
            window[at + i, at + i] = -start[i] * weight
            window[at + i, at + m + i] = window[at + m + i, at + i] = 1.0
        if k + 1 < n:
            for j in range(m):
                window[at + m + j, at + 2 * m + i] = model.dynamics[k, 0, i, j]


class Rows(NamedTuple):
    """The whitened outputs (n, q, c) and process noise (n, m, c) that states, best for the variances, leave; the
    squares of the outputs, (c,), with the states held; and the upper triangle (c, c) of all rows, what is left last.
    """

    outputs: FloatArray
    noise: FloatArray
    direct: FloatArray
    triangle: FloatArray


@compiled
def rows_of(
    model: LinearModel, variances: Variances, states: FloatArray, multipliers: FloatArray
) -> Rows:
    """What states and multipliers of `solved` leave."""
    n, q, m = model.observe.shape
    columns = model.outputs.shape[2]
    outputs, noise, direct = np.zeros((n, q, columns)), np.zeros((n, m, columns)), np.zeros(columns)
    held, left = np.zeros((q, columns)), np.zeros((q, columns))
    triangle, slab, filled = np.zeros((columns, columns)), np.zeros((columns, _SLAB)), 0
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
        for j in range(q + m):
            row = outputs[k, j] if j < q else noise[k, j - q]
            for c in range(1, columns):
                slab[c - 1, filled] = row[c]
            slab[columns - 1, filled] = row[0]
            filled += 1
            if filled == _SLAB:
                _absorb(triangle, slab, filled)
                filled = 0
    _absorb(triangle, slab, filled)
    return Rows(outputs, noise, direct, triangle)


@reassociated
def _absorb(triangle: FloatArray, slab: FloatArray, filled: int) -> None:
    """The triangle (c, c) of its own rows and the first `filled` columns of the slab, by reflections, in place."""
    for j in range(triangle.shape[0]):
        mirror = slab[j]
        square = 0.0
        for r in range(filled):
            square += mirror[r] ** 2
        if square == 0.0:
            continue
        head = triangle[j, j]
        length = -np.copysign(np.sqrt(square + head**2), head)
        first = head - length
        triangle[j, j] = length
        for c in range(j + 1, triangle.shape[0]):
            column = slab[c]
            along = first * triangle[j, c]
            for r in range(filled):
                along += mirror[r] * column[r]
            along /= length * first
            triangle[j, c] += first * along
            for r in range(filled):
                column[r] += along * mirror[r]


@compiled
def solved(
    model: LinearModel, variances: Variances, probe: FloatArray
) -> tuple[FloatArray, FloatArray, float, float]:
    """States and multipliers, (n, m, c) each, as `band` has them; the growth of the `probe` (2 m n,) times the norm of
    the matrix: its condition, infinite where it is singular; and log |det| as `log_determinants` has it.
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
    log_det = _factored(band, right) + np.isinf(variances.start).sum() * np.log(weight)
    if np.isnan(log_det):
        return states, multipliers, np.inf, log_det
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
    return states, multipliers, grown * norm, log_det
