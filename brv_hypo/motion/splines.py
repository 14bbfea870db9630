"""Cubic splines through samples, and their integrals: one factorisation for all that is sampled at the same times."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import TypeVar

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.linalg.lapack import dpttrf, dpttrs

from brv_hypo.arrays import ComplexArray, FloatArray, IntArray

Values = TypeVar("Values", FloatArray, ComplexArray)

# Samples from which splines have no knot at the second and the last but one.
_FEWEST = 4
# Values that are worked on at once.
_AT_ONCE = 1_000_000


@dataclass(frozen=True)
class SplineGrid:
    """Cubic splines without a knot at the second and the last but one sample, on the samples `time` (m,), m > 3.

    The equations of the slopes are factorised once (de Boor, A Practical Guide to Splines, Chapter IV).
    """

    time: FloatArray

    @classmethod
    def on(cls, time: FloatArray) -> SplineGrid:
        """Those on these samples; the ones asked for last are kept, and their factors with them."""
        return _kept_grid(np.asarray(time, dtype=float).tobytes())

    @cached_property
    def steps(self) -> FloatArray:
        """Distance of neighbouring samples (m - 1, 1), s."""
        return np.diff(self.time)[:, np.newaxis]

    @cached_property
    def _factors(self) -> tuple[FloatArray, FloatArray]:
        """Of the equations of the slopes, each over the product of its steps: they are symmetric so, and positive."""
        per_step = 1.0 / self.steps[:, 0]
        both = per_step[:-1] + per_step[1:]
        diagonal = np.concatenate([[per_step[0] ** 2 / both[0]], 2.0 * both, [per_step[-1] ** 2 / both[-1]]])
        factored, off, _ = dpttrf(diagonal, per_step)
        return factored, off

    @cached_property
    def _weights(self) -> tuple[FloatArray, FloatArray]:
        """What the equation of each slope has of the rises of the values before and after its sample (m, 1); at the
        ends, of the first two and of the last two.
        """
        h = self.steps
        before, after = np.empty((2, self.time.size, 1))
        before[1:-1], after[1:-1] = 3.0 / h[:-1] ** 2, 3.0 / h[1:] ** 2
        first, last = h[0] + h[1], h[-1] + h[-2]
        before[0], after[0] = (h[0] + 2.0 * first) * h[1] / (h[0] * first) ** 2, h[0] / (h[1] * first**2)
        before[-1], after[-1] = h[-1] / (h[-2] * last**2), (2.0 * last + h[-1]) * h[-2] / (h[-1] * last) ** 2
        return before, after

    def slopes(self, values: Values) -> Values:
        """Slopes at the samples of the splines through `values` (m, columns), real or complex."""
        return self._by_columns(self._slopes, values)

    def integrals(self, values: Values, slopes: Values) -> Values:
        """Integrals (m, columns) from the first sample to each of the splines with these values and slopes."""
        return self._by_columns(self._integrals, values, slopes)

    def _by_columns(self, call: Callable[..., Values], *arrays: Values) -> Values:
        """What `call` makes of arrays (m, columns), so many columns at once that what it needs stays small."""
        count = arrays[0].shape[1]
        width = max(1, _AT_ONCE // self.time.size)
        if width >= count:
            return call(*arrays)
        out = np.empty_like(arrays[-1])
        for first in range(0, count, width):
            some = slice(first, first + width)
            out[:, some] = call(*(each[:, some] for each in arrays))
        return out

    def _slopes(self, values: Values) -> Values:
        before, after = self._weights
        rises = np.diff(values, axis=0)
        right = np.empty(values.shape, dtype=rises.dtype)
        np.multiply(before[1:-1], rises[:-1], out=right[1:-1])
        right[1:-1] += after[1:-1] * rises[1:]
        for own, (one, other) in ((0, (0, 1)), (-1, (-2, -1))):
            right[own] = before[own] * rises[one] + after[own] * rises[other]
        found, _ = dpttrs(*self._factors, right.view(float), overwrite_b=True)
        return np.ascontiguousarray(found).view(right.dtype)

    def _integrals(self, values: Values, slopes: Values) -> Values:
        half, twelfth = self._shares
        out = np.zeros_like(slopes)
        pieces = half * (values[:-1] + values[1:])
        pieces += twelfth * (slopes[:-1] - slopes[1:])
        np.cumsum(pieces, axis=0, out=out[1:])
        return out

    @cached_property
    def _shares(self) -> tuple[FloatArray, FloatArray]:
        """What a step's integral has of the values at its ends and of the difference of their slopes (m - 1, 1)."""
        return self.steps / 2.0, self.steps**2 / 12.0


@lru_cache(maxsize=4)
def _kept_grid(time: bytes) -> SplineGrid:
    return SplineGrid(np.frombuffer(time))


class Spline:
    """Cubic spline through `values` (m, ...), made when it is first asked for."""

    def __init__(self, time: FloatArray, values: FloatArray) -> None:
        self._samples: tuple[FloatArray, FloatArray] | None = (time, values)
        self._powers: tuple[FloatArray, ...] = ()

    def __call__(self, places: Places) -> FloatArray:
        """Values (n, ...) at these places."""
        if self._samples is not None:
            self._powers, self._samples = _powers(*self._samples), None
        i, u = places.interval, places.since
        c0, c1, c2, c3 = (each.take(i, axis=-1) for each in self._powers)
        return np.asarray((c0 + u * (c1 + u * (c2 + u * c3))).T, dtype=float)


@dataclass(frozen=True)
class Places:
    """Times (n,) s by the interval of samples that holds each, and the time since its first sample."""

    interval: IntArray
    since: FloatArray

    @classmethod
    def among(cls, samples: FloatArray, time: FloatArray) -> Places:
        """Where `time` (n,) lies among the samples; outside of them the outermost interval counts."""
        interval = samples[1:-1].searchsorted(time, side="right")
        return cls(interval, time - samples[interval])


def _powers(time: FloatArray, values: FloatArray) -> tuple[FloatArray, ...]:
    """Coefficients (..., m - 1) of the powers of the time since each sample, the constant first."""
    if time.size < _FEWEST:
        return tuple(np.moveaxis(c, 0, -1).copy() for c in CubicSpline(time, values).c[::-1])
    flat = np.ascontiguousarray(values).reshape(time.size, -1)
    grid = SplineGrid.on(time)
    slopes, h = grid.slopes(flat), grid.steps
    chord = np.diff(flat, axis=0) / h
    bend = (slopes[:-1] + slopes[1:] - 2.0 * chord) / h
    found = (flat[:-1], slopes[:-1], (chord - slopes[:-1]) / h - bend, bend / h)
    return tuple(np.ascontiguousarray(c.T).reshape(*values.shape[1:], time.size - 1) for c in found)


def running_integral(time: FloatArray, values: Values) -> Values:
    """Integral of `values` (n, ...), real or complex, from the first sample to each; fourth order."""
    if time.size < _FEWEST:
        return np.asarray(CubicSpline(time, values).antiderivative()(time))
    flat = np.ascontiguousarray(values).reshape(time.size, -1)
    grid = SplineGrid.on(time)
    return grid.integrals(flat, grid.slopes(flat)).reshape(values.shape)
