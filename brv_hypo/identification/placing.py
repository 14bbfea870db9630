"""Where the likelihood's nodes stand: far apart where the motion is slow, close where the meridian turns fast.

Near alpha = 0 the windward meridian turns by most of pi between two samples, and moments that follow it turn
with it. States are wanted closer there than the instruments measure.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from brv_hypo.arrays import ComplexArray, FloatArray, IntArray
from brv_hypo.constants import (
    IDENTIFIED_FEWEST_NODES,
    IDENTIFIED_LARGEST_BLOCK,
    IDENTIFIED_PARTS,
    IDENTIFIED_TURN,
)
from brv_hypo.model.columns import Column
from brv_hypo.model.common_time import OwnTime
from brv_hypo.motion.frames import crossflow
from brv_hypo.motion.splines import running_integral
from brv_hypo.regression.frame import RateFrame
from brv_hypo.regression.weakform import WeakSegment


def block_size(frame: RateFrame, columns: Sequence[Column], values: FloatArray, tolerance: float) -> int:
    """Samples in a block: the most at which collocation integrates the model's moment as well as the samples
    do.

    The largest difference between the two angular rates may be `tolerance` times the gyros' white noise,
    stretches left out that have nodes in between. The number is odd, so that a sample stands in the middle.
    """
    moments = frame.moments(columns) @ values
    meridians = [Meridian(derolled_crossflow(frame, part), delays_of(columns)) for part in frame.segments]
    longest = max(segment.time.size for segment in frame.segments)
    size = 1
    for trial in range(3, min(IDENTIFIED_LARGEST_BLOCK, longest // IDENTIFIED_FEWEST_NODES) + 1, 2):
        for part, (a, b), meridian in zip(frame.segments, frame.pieces, meridians, strict=True):
            allowed = tolerance * frame.reconstructions[part.flight].gyro_sigma
            knots = knots_of(columns, frame.own_time(part.flight))
            if _quadrature_error(part, moments[a:b], trial, knots, meridian) > allowed:
                return size
        size = trial
    return size


def knots_of(columns: Sequence[Column], own: OwnTime | None) -> list[float]:
    """Times (s) at which a column has a jump or a kink, on a flight whose own time goes so with the common one."""
    edges = {edge for c in columns for edge in (c.course.start, c.course.stop) if np.isfinite(edge)}
    return sorted(edges if own is None else {own.own_at(edge) for edge in edges})


def delays_of(columns: Sequence[Column]) -> tuple[float, ...]:
    """The delays (s) in a model."""
    return tuple(sorted({delay for column in columns for delay in column.delays if delay}))


@dataclass(frozen=True)
class Meridian:
    """How fast the meridian turns in de-rolled axes: `crossflow` is xi there over time, `delays` s how much
    earlier it matters too.
    """

    crossflow: CubicSpline
    delays: tuple[float, ...]

    def with_nodes_between(self, nodes: FloatArray) -> FloatArray:
        """The nodes (n,) s and more between them where the meridian turns fast, or did so a delay earlier."""
        parts = self.parts(nodes)
        steps = np.diff(nodes) / parts
        first = np.repeat(nodes[:-1], parts)
        within = np.arange(first.size) - np.repeat(np.cumsum(parts) - parts, parts)
        return np.append(first + within * np.repeat(steps, parts), nodes[-1])

    def parts(self, nodes: FloatArray) -> IntArray:
        """Into how many each interval is to be cut (n - 1,), 16 at most."""
        step = np.diff(nodes)
        inside = nodes[:-1, None] + step[:, None] * np.linspace(0.0, 1.0, IDENTIFIED_PARTS + 1)
        xi, xi_rate = self.crossflow(inside), self.crossflow(inside, 1)
        rate = (xi_rate * np.conj(xi)).imag / np.maximum(np.abs(xi) ** 2, 1e-16)
        turned = np.max(np.abs(rate), axis=1) * step
        wanted = np.maximum(turned, max(self.delays, default=0.0) * np.ptp(rate, axis=1))
        for delay in self.delays:
            earlier = np.floor(np.interp(nodes - delay, nodes, np.arange(nodes.size))).astype(np.int64)
            for place in (earlier[:-1], earlier[1:]):
                wanted = np.maximum(wanted, turned[np.minimum(place, turned.size - 1)])
        return np.asarray(np.clip(np.ceil(wanted / IDENTIFIED_TURN), 1, IDENTIFIED_PARTS), dtype=np.int64)


def derolled_crossflow(frame: RateFrame, part: WeakSegment) -> CubicSpline:
    """(v + i w) / V of a segment in de-rolled axes, over time."""
    flight, motion = frame.reconstructions[part.flight].flight, frame.motions[part.flight]
    xi = crossflow(motion.alpha, motion.windward_meridian) * np.exp(
        1j * running_integral(flight.time, flight.p)
    )
    return CubicSpline(part.time, xi[part.rows])


def _quadrature_error(
    part: WeakSegment, moments: ComplexArray, size: int, knots: Sequence[float], meridian: Meridian
) -> float:
    """Largest error of the angular rate, rad/s, by Simpson's rule on every `size`-th sample; intervals with
    knots, or with nodes in between, left out.
    """
    acceleration = CubicSpline(part.time, part.factor * moments)
    nodes = part.time[size // 2 :: size]
    if nodes.size < 2:
        return 0.0
    step = nodes[1] - nodes[0]
    values, between = acceleration(nodes), acceleration(0.5 * (nodes[1:] + nodes[:-1]))
    simpson = step / 6.0 * (values[:-1] + 4.0 * between + values[1:])
    error = simpson - np.diff(acceleration.antiderivative()(nodes))
    error[meridian.parts(nodes) > 1] = 0.0
    for knot in knots:
        error[(nodes[:-1] - step <= knot) & (knot <= nodes[1:] + step)] = 0.0
    return float(np.max(np.abs(np.cumsum(error))))
