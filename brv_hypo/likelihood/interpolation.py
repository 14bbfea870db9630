"""Local cubic interpolation of sampled signals: weights on nearby samples, and their rate of change.

The interpolant is the cubic Hermite polynomial whose nodal slopes are those of the quartic through five
neighbouring samples: fourth-order accurate and continuous in its first derivative, so that a cost built
on x(t - tau) is smooth as tau slides past a sample.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from brv_hypo.arrays import FloatArray, IntArray

WIDTH = 6
"""Samples that take part in one interpolated value."""

_SLOPE_WIDTH = 5


@dataclass(frozen=True)
class Stencil:
    """Interpolation at n query times as weights on samples.

    `index` (n, WIDTH) are sample numbers, `value` (n, WIDTH) the weights of the signal and `rate`
    (n, WIDTH), 1/s, those of its time derivative. Outside the samples the end value is held, rate 0.
    """

    index: IntArray
    value: FloatArray
    rate: FloatArray

    def part(self, where: slice | IntArray) -> Stencil:
        """The stencil of some of the query times."""
        return Stencil(self.index[where], self.value[where], self.rate[where])

    def apply(self, signal: FloatArray) -> FloatArray:
        """The signal, (m, n_samples), at the query times, (m, n)."""
        return self._apply(signal, self.value)

    def apply_rate(self, signal: FloatArray) -> FloatArray:
        """The time derivative of the signal, (m, n_samples), at the query times, (m, n)."""
        return self._apply(signal, self.rate)

    def _apply(self, signal: FloatArray, weights: FloatArray) -> FloatArray:
        found = np.zeros((signal.shape[0], self.index.shape[0]), dtype=signal.dtype)
        for index, weight in zip(self.index.T, weights.T, strict=True):
            found += signal[:, index] * weight
        return found


class Interpolator:
    """Builds stencils on one time base t, (n_samples,), s, increasing, at least six samples."""

    def __init__(self, t: FloatArray) -> None:
        self.t = t
        n = t.size
        nodes = np.arange(n)
        self._slope_start = np.clip(nodes - _SLOPE_WIDTH // 2, 0, n - _SLOPE_WIDTH)
        self._slope = _slope_weights(t, nodes, self._slope_start)

    def part(self, first: int, last: int) -> Interpolator:
        """The interpolator of some of the samples."""
        return Interpolator(self.t[first:last])

    def stencil(self, query: FloatArray) -> Stencil:
        """Weights at the query times, (n,), s."""
        t = self.t
        clipped = np.clip(query, t[0], t[-1])
        left = np.clip(np.searchsorted(t, clipped, side="right") - 1, 0, t.size - 2)
        step = t[left + 1] - t[left]
        s = (clipped - t[left]) / step
        hermite = (1 + 2 * s) * (1 - s) ** 2, s**2 * (3 - 2 * s), s * (1 - s) ** 2, s**2 * (s - 1)
        slopes = 6 * s * (s - 1), -6 * s * (s - 1), (1 - s) * (1 - 3 * s), s * (3 * s - 2)
        start = np.clip(left - 2, 0, t.size - WIDTH)
        value = self._combine(left, start, (hermite[0], hermite[1], hermite[2] * step, hermite[3] * step))
        rate = self._combine(left, start, (slopes[0] / step, slopes[1] / step, slopes[2], slopes[3]))
        rate[query != clipped] = 0.0
        return Stencil(start[:, None] + np.arange(WIDTH), value, rate)

    def _combine(self, left: IntArray, start: IntArray, basis: tuple[FloatArray, ...]) -> FloatArray:
        """Hermite basis (left and right values, left and right slopes) spread over the samples."""
        weights = np.zeros((left.size, WIDTH))
        rows = np.arange(left.size)
        for node, at_node, at_slope in ((left, basis[0], basis[2]), (left + 1, basis[1], basis[3])):
            weights[rows, node - start] += at_node
            first = self._slope_start[node] - start
            for j in range(_SLOPE_WIDTH):
                weights[rows, first + j] += at_slope * self._slope[node, j]
        return np.asarray(weights)


def _slope_weights(t: FloatArray, nodes: IntArray, start: IntArray) -> FloatArray:
    """Weights, (n, 5), 1/s, of the derivative at each node of the quartic through five samples."""
    z = t[start[:, None] + np.arange(_SLOPE_WIDTH)]
    apart = z[:, :, None] - z[:, None, :]
    apart[:, range(_SLOPE_WIDTH), range(_SLOPE_WIDTH)] = 1.0
    barycentric = 1.0 / apart.prod(axis=2)
    rows = np.arange(nodes.size)
    here = nodes - start
    distance = t[nodes][:, None] - z
    distance[rows, here] = 1.0
    weights = barycentric / barycentric[rows, here][:, None] / distance
    weights[rows, here] = 0.0
    weights[rows, here] = -weights.sum(axis=1)
    return np.asarray(weights)
