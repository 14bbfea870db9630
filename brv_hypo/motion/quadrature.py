"""Where the moments of a flight are evaluated to be integrated: at its samples, and between them where the motion asks.

The crossflow is smooth, but what acts in its plane turns with the windward meridian, by half a turn in no time where
alpha passes by zero. There samples are too far apart for any rule of integration, however accurate the motion.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from scipy import sparse

from brv_hypo.arrays import ComplexArray, FloatArray, IntArray
from brv_hypo.constants import NODE_HALVINGS, NODE_LATE, NODE_MOST, NODE_TURN, NODE_WOUND
from brv_hypo.motion.angles import crossflow_rate, with_crossflow
from brv_hypo.motion.frames import crossflow, windward_meridian
from brv_hypo.motion.history import recorded
from brv_hypo.motion.lagrange import lagrange
from brv_hypo.motion.motion import Motion

Values = TypeVar("Values", FloatArray, ComplexArray)


@dataclass(frozen=True)
class Quadrature:
    """The nodes of a flight: `time` (m,) s, which of them the samples are (n,), and what makes values there of those at
    the samples (m, n); None where the samples are all.
    """

    time: FloatArray
    samples: IntArray
    spread: sparse.csr_array | None = None

    def of(self, values: Values) -> Values:
        """Values at the nodes (m, ...) of something smooth at the samples (n, ...), where they are what they were."""
        if self.spread is None:
            return values
        flat = np.ascontiguousarray(values).reshape(self.samples.size, -1).view(float)
        found = np.asarray(self.spread @ flat)
        found[self.samples] = flat
        return found.view(values.dtype).reshape(-1, *values.shape[1:])

    def rows(self, first: int, stop: int) -> slice:
        """The nodes from one sample to before another, those after the last of them left out."""
        return slice(int(self.samples[first]), int(self.samples[stop - 1]) + 1)


def quadrature(motion: Motion, segments: Sequence[tuple[int, int]]) -> Quadrature:
    """The nodes of a motion over segments [a, b) of its samples, between which nothing is added."""
    xi = crossflow(motion.alpha, motion.windward_meridian)
    delay = _usual_delay(motion.time, xi)
    parts = [_nodes_between(motion.time[a:b], xi[a:b], delay) for a, b in segments]
    between = np.concatenate([np.zeros(0), *parts])
    if not between.size:
        return Quadrature(motion.time, np.arange(motion.time.size))
    time = np.union1d(motion.time, between)
    samples = np.searchsorted(time, motion.time)
    own = [lagrange(motion.time[a:b], time[samples[a] : samples[b - 1] + 1]).tocoo() for a, b in segments]
    starts = zip(own, segments, strict=True)
    rows, columns = np.hstack([(part.coords[0] + samples[a], part.coords[1] + a) for part, (a, _) in starts])
    weights = np.concatenate([part.data for part in own])
    spread = sparse.csr_array((weights, (rows, columns)), shape=(time.size, motion.time.size))
    return Quadrature(time, samples, spread)


def _usual_delay(time: FloatArray, xi: ComplexArray) -> float:
    """Time in which the crossflow moves by so much of its own size, s."""
    speed = np.linalg.norm(np.diff(xi) / np.diff(time))
    return NODE_LATE * float(np.linalg.norm(xi) / max(float(speed), 1e-300))


def _nodes_between(time: FloatArray, xi: ComplexArray, delay: float) -> FloatArray:
    """Times to add to those of a stretch: halves of what is between two, wherever the crossflow goes too far there, or
    the meridian's rate changes by too much for what is late by `delay` s.
    """
    found: list[FloatArray] = []
    begin, end, low, high = time[:-1], time[1:], xi[:-1], xi[1:]
    for _ in range(NODE_HALVINGS):
        way, least = np.abs(high - low), _least_distance(low, high)
        most = np.maximum(np.abs(low), np.abs(high))
        wound = delay * way / (end - begin) * (1.0 / np.maximum(least, 1e-300) - least / np.maximum(most, 1e-300) ** 2)
        far = (way > NODE_TURN * least) | (wound > NODE_WOUND)
        if not np.any(far) or sum(map(len, found)) + np.count_nonzero(far) > NODE_MOST * time.size:
            break
        begin, end, low, high = begin[far], end[far], low[far], high[far]
        middle = 0.5 * (begin + end)
        at = np.asarray(lagrange(time, middle) @ xi)
        found.append(middle)
        begin, end = np.concatenate([begin, middle]), np.concatenate([middle, end])
        low, high = np.concatenate([low, at]), np.concatenate([at, high])
    return np.concatenate([np.zeros(0), *found])


def _least_distance(low: ComplexArray, high: ComplexArray) -> FloatArray:
    """Least distance from zero of the straight ways (n,) from one number to another."""
    way = high - low
    size = np.maximum(np.abs(way) ** 2, 1e-300)
    share = np.clip(-(np.conj(way) * low).real / size, 0.0, 1.0)
    return np.asarray(np.abs(low + share * way), dtype=float)


def at_nodes(motion: Motion, nodes: Quadrature) -> Motion:
    """The motion at the nodes, able to tell its past; itself where these are its samples."""
    if nodes.spread is None:
        return motion
    xi = crossflow(motion.alpha, motion.windward_meridian)
    there, rate = nodes.of(xi), nodes.of(crossflow_rate(motion, xi))
    moved = replace(
        motion,
        time=nodes.time,
        windward_meridian=np.unwrap(windward_meridian(there)),
        p=nodes.of(motion.p),
        q=nodes.of(motion.q),
        r=nodes.of(motion.r),
        velocity=nodes.of(motion.velocity),
        dynamic_pressure=nodes.of(motion.dynamic_pressure),
        mach=nodes.of(motion.mach),
        reynolds=nodes.of(motion.reynolds),
        in_plane_moment=nodes.of(motion.in_plane_moment),
        roll_acceleration=_known(motion.roll_acceleration, nodes),
        axial_share=_known(motion.axial_share, nodes),
        common_time=_known(motion.common_time, nodes),
        history=None,
    )
    return recorded(with_crossflow(moved, there, rate))


def _known(values: FloatArray | None, nodes: Quadrature) -> FloatArray | None:
    return None if values is None else nodes.of(values)
