"""Interpolation of sampled signals: one cubic spline, its integral, and sparse interpolation matrices.

`SplineGrid` and `running_integral` are cubic splines without a knot at the second and the last but one sample; signals
on the same samples share one factorisation (de Boor, A Practical Guide to Splines, Chapter IV). `lagrange` is the
polynomial through the six nearest nodes as one sparse matrix, with an error of 2e-6 of a sine at 24 nodes a cycle.
By that matrix a `Quadrature` has nodes between the samples, and a `DecimatedGrid` keeps only those that a motion needs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from scipy import sparse
from scipy.interpolate import BSpline, CubicSpline
from scipy.linalg.lapack import dpttrf, dpttrs

from brv_hypo.arrays import FloatArray, IntArray, Values

RESPONSE_FASTEST = 95.0  # percentile of the meridian's rate that is the fastest motion

_FEWEST = 4  # samples from which splines have no knot at the second and the last but one
NEAREST = 6  # nodes that a place lies between: degree 5
_MOST_KEPT = 20_000  # samples up to which all are kept
# Samples at the ends of a piece, at most, that are none of those kept: filters and late clocks make of them what they
# like. They follow by extrapolation over an eighth of the spacing at most.
_END = 4
_BLOCK = 20_000  # samples of many columns that are held at once


@dataclass(frozen=True)
class SplineGrid:
    """Those cubic splines on the samples `time` (m,) s, m > 3; the equations of the slopes are factorised once."""

    time: FloatArray

    @classmethod
    def on(cls, time: FloatArray) -> SplineGrid:
        """Those on these samples; the ones requested last are kept, and their factors with them."""
        return _kept_grid(np.asarray(time, dtype=float).tobytes())

    @cached_property
    def steps(self) -> FloatArray:
        """Distance of neighbouring samples (m - 1, 1), s."""
        return np.diff(self.time)[:, np.newaxis]

    @cached_property
    def _equations(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Factors of the equations of the slopes, and what each has of the rises of the values before and after its
        sample (m, 1); at the ends, of the first two and of the last two. Each equation is over the product of its
        steps: they are symmetric so, and positive.
        """
        h = self.steps
        per_step = 1.0 / h[:, 0]
        both = per_step[:-1] + per_step[1:]
        diagonal = np.concatenate([[per_step[0] ** 2 / both[0]], 2.0 * both, [per_step[-1] ** 2 / both[-1]]])
        factored, off, _ = dpttrf(diagonal, per_step)
        before, after = np.empty((2, self.time.size, 1))
        before[1:-1], after[1:-1] = 3.0 / h[:-1] ** 2, 3.0 / h[1:] ** 2
        first, last = h[0] + h[1], h[-1] + h[-2]
        before[0], after[0] = (h[0] + 2.0 * first) * h[1] / (h[0] * first) ** 2, h[0] / (h[1] * first**2)
        before[-1], after[-1] = h[-1] / (h[-2] * last**2), (2.0 * last + h[-1]) * h[-2] / (h[-1] * last) ** 2
        return factored, off, before, after

    def slopes(self, values: Values) -> Values:
        """Slopes at the samples of the splines through `values` (m, columns), real or complex."""
        factored, off, before, after = self._equations
        rises = np.diff(values, axis=0)
        right = np.empty(values.shape, dtype=rises.dtype)
        np.multiply(before[1:-1], rises[:-1], out=right[1:-1])
        right[1:-1] += after[1:-1] * rises[1:]
        right[0] = before[0] * rises[0] + after[0] * rises[1]
        right[-1] = before[-1] * rises[-2] + after[-1] * rises[-1]
        found, _ = dpttrs(factored, off, right.view(float), overwrite_b=True)
        return np.ascontiguousarray(found).view(right.dtype)

    def integrals(self, values: Values, slopes: Values) -> Values:
        """Integrals (m, columns) from the first sample to each of the splines with these values and slopes."""
        out = np.zeros_like(slopes)
        parts = self.steps / 2.0 * (values[:-1] + values[1:])
        parts += self.steps**2 / 12.0 * (slopes[:-1] - slopes[1:])
        np.cumsum(parts, axis=0, out=out[1:])
        return out


@lru_cache(maxsize=4)
def _kept_grid(time: bytes) -> SplineGrid:
    return SplineGrid(np.frombuffer(time))


def time_splines(time: FloatArray, start: float, stop: float, count: int) -> FloatArray:
    """Cubic B-splines (..., count), even over [start, stop] s, at `time` (...) s: their sum is one. One alone is a
    constant. Outside of the range they are what they are at its ends. Read only.
    """
    times = np.ascontiguousarray(time, dtype=float)
    return _kept_splines(times.tobytes(), start, stop, count).reshape(*times.shape, count)


@lru_cache(maxsize=8)
def _kept_splines(time: bytes, start: float, stop: float, count: int) -> FloatArray:
    place = np.clip((np.frombuffer(time) - start) / (stop - start), 0.0, 1.0 - 1e-12)
    design = np.ones((place.size, 1))
    if count > 1:
        design = BSpline.design_matrix((count - 3) * place, np.arange(-3.0, count + 1.0), 3).toarray()
    design.setflags(write=False)
    return design


def running_integral(time: FloatArray, values: Values) -> Values:
    """Integral of `values` (n, ...), real or complex, from the first sample to each; fourth order."""
    if time.size < _FEWEST:
        return np.asarray(CubicSpline(time, values).antiderivative()(time))
    flat = np.ascontiguousarray(values).reshape(time.size, -1)
    grid = SplineGrid.on(time)
    return grid.integrals(flat, grid.slopes(flat)).reshape(values.shape)


def lagrange(nodes: FloatArray, places: FloatArray) -> sparse.csr_array:
    """Weights (places, nodes) of the values at ascending `nodes` (m,) that make those at `places` (n,)."""
    width = min(NEAREST, nodes.size)
    first = np.clip(np.searchsorted(nodes, places, side="right") - width // 2, 0, nodes.size - width)
    weights = np.ones((places.size, width))
    for own in range(width):
        node = nodes[first + own]
        for other in range(width):
            if other != own:
                weights[:, own] *= (places - nodes[first + other]) / (node - nodes[first + other])
    which = (first[:, np.newaxis] + np.arange(width)).ravel()
    starts = np.arange(places.size + 1) * width
    return sparse.csr_array((weights.ravel(), which, starts), shape=(places.size, nodes.size))


def applied(operator: sparse.csr_array, values: Values) -> Values:
    """A sparse operator (m, n) on values (n, ...), real or complex."""
    flat = np.ascontiguousarray(values).reshape(values.shape[0], -1).view(float)
    return np.asarray(operator @ flat).view(values.dtype).reshape(operator.shape[0], *values.shape[1:])


@dataclass(frozen=True)
class Quadrature:
    """The nodes of a flight, at which what is integrated is evaluated."""

    time: FloatArray  # (m,) s
    samples: IntArray  # which of them the samples are (n,)
    # what makes values at the nodes of those at the samples (m, n); None where the samples are all
    spread: sparse.csr_array | None = None

    def of(self, values: Values) -> Values:
        """Values at the nodes (m, ...) of something smooth at the samples (n, ...), where they are what they were."""
        if self.spread is None:
            return values
        found = applied(self.spread, values)
        found[self.samples] = values
        return found

    def rows(self, first: int, stop: int) -> slice:
        """The nodes from one sample to before another, those after the last of them left out."""
        return slice(int(self.samples[first]), int(self.samples[stop - 1]) + 1)


# ---- What is as slow as the motion, kept on as many samples as the motion needs ----


def blocks(samples: int) -> list[slice]:
    """All samples, as many at once as are held of many columns."""
    return [slice(first, min(first + _BLOCK, samples)) for first in range(0, samples, _BLOCK)]


def spacing(meridian_rate: FloatArray, roll_rate: FloatArray, step: float, per_cycle: int) -> int:
    """Samples from one to the next where a cycle of the fastest motion has `per_cycle`; rates (n,) rad/s, step s."""
    fastest = float(np.percentile(np.abs(meridian_rate), RESPONSE_FASTEST)) + float(np.max(np.abs(roll_rate)))
    return max(1, int(2.0 * np.pi / (fastest * step * per_cycle)))


def turning(meridian_rate: FloatArray, roll_rate: FloatArray, step: float) -> float:
    """Frequency, rad a sample, of the fastest motion in axes that do not roll; what is fixed to the body turns too."""
    crossflow = float(np.percentile(np.abs(roll_rate - meridian_rate), RESPONSE_FASTEST))
    return max(crossflow, float(np.max(np.abs(roll_rate)))) * step


@dataclass(frozen=True)
class DecimatedGrid:
    """Which samples are kept (m,), and what makes all of them of these (n, m); None where all are kept."""

    which: IntArray
    spread: sparse.csr_array | None = None

    @property
    def size(self) -> int:
        """How many are kept."""
        return int(self.which.size)

    def of(self, values: Values) -> Values:
        """Those of `values` (n, ...) that are kept."""
        return values if self.spread is None else values[self.which]

    def all_of(self, kept: Values, rows: slice = slice(None)) -> Values:
        """All samples, or these `rows`, of what was kept (m, ...)."""
        if self.spread is None:
            return kept[rows]
        return applied(self.spread[rows], kept)


def decimated_grid(pieces: Sequence[tuple[int, int]], stride: int) -> DecimatedGrid:
    """About every `stride`-th sample of each piece [a, b), in order, ends left out; all of short records and pieces."""
    count = pieces[-1][1] if pieces else 0
    if count <= _MOST_KEPT or stride < 2:
        return DecimatedGrid(np.arange(count))
    end, which, spreads = min(_END, stride // 8), [], []
    for a, b in pieces:
        own = np.arange(b - a)
        if own.size >= 2 * _END + NEAREST * stride:
            own = np.round(np.linspace(end, own.size - 1 - end, -(-own.size // stride))).astype(np.int64)
        which.append(a + own)
        spreads.append(lagrange(own.astype(float), np.arange(b - a, dtype=float)))
    return DecimatedGrid(np.concatenate(which), sparse.csr_array(sparse.block_diag(spreads, format="csr")))
