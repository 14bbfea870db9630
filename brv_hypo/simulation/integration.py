"""Runge-Kutta integration of a flight, with the past of the motion by cubic Hermite interpolation.

Nodes are uniform, with every jump and kink of the moments added; steps are cut where the windward meridian turns
fast. Mechanisms that look back ask `History` while the integration goes on.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from brv_hypo.arrays import BoolArray, FloatArray, IntArray
from brv_hypo.errors import UsageError
from brv_hypo.motion.motion import Motion
from brv_hypo.progress import Report, silent
from brv_hypo.simulation.vehicle import ATTITUDE, STATES, System, dot


class History:
    """States and their rates at the nodes passed so far.

    At a break the rate jumps: the interval before it ends with the rate before the jump, the one after begins
    with the rate after it.
    """

    def __init__(self, system: System, nodes: FloatArray, breaks: BoolArray) -> None:
        """Room for nodes (n,) s; `breaks` (n,) marks where rates may jump."""
        self.system = system
        self.nodes = nodes
        self.states = np.zeros((nodes.size, STATES, 1))
        self.rates = np.zeros_like(self.states)
        """That follow each node; `rates_before` lead up to it, which differ at a break."""
        self.rates_before = np.zeros_like(self.states)
        self.meridians = np.zeros((nodes.size, 1))
        self._breaks = breaks
        self._last = 0
        self._recent: dict[bytes, Motion] = {}

    def store(self, node: int, state: FloatArray, rate: FloatArray, meridian: FloatArray) -> None:
        """The state of a node with the rate that follows it."""
        self.states[node], self.rates[node], self.meridians[node] = state, rate, meridian
        if not self._breaks[node]:
            self.rates_before[node] = rate
        self._last = node
        self._recent.clear()

    def past(self, time: FloatArray) -> Motion:
        """The motion at `time` (1,) s; before the start it is steady (see `Motion.delayed`)."""
        key = time.tobytes()
        if key not in self._recent:
            self._recent[key] = self._motion(time)
        return self._recent[key]

    def _motion(self, time: FloatArray) -> Motion:
        begin, end = self.nodes[0], self.nodes[self._last]
        if np.any(time > end + 1e-9):
            raise UsageError(
                f"a planted mechanism asked for the motion at {float(np.max(time)):.6g} s, but the "
                f"integration has only reached {float(end):.6g} s: its delay is shorter than the step. "
                "Reduce `step` to the delay or less."
            )
        inside = np.maximum(time, begin)
        left = min(max(int(np.searchsorted(self.nodes, inside[0], side="right")) - 1, 0), max(self._last - 1, 0))
        state = self._interpolated(inside, left)
        air = self.system.air_data(time, state)
        motion = self.system.motion(time, state, air, self.meridians[left], self.past)
        if np.all(time >= begin):
            return motion
        turned = motion.windward_meridian + (time - inside) * motion.windward_meridian_rate
        return replace(motion, windward_meridian=turned)

    def _interpolated(self, time: FloatArray, left: int) -> FloatArray:
        """State (13, 1) in the interval after a node."""
        right = left + 1
        step = self.nodes[right] - self.nodes[left]
        s = (time - self.nodes[left]) / step
        s2, s3 = s * s, s * s * s
        return np.asarray(
            (2.0 * s3 - 3.0 * s2 + 1.0) * self.states[left]
            + (s3 - 2.0 * s2 + s) * step * self.rates[left]
            + (3.0 * s2 - 2.0 * s3) * self.states[right]
            + (s3 - s2) * step * self.rates_before[right],
            dtype=float,
        )


# ---- Nodes, and the classical Runge-Kutta steps from one to the next ----


# Time (s) by which a stage steps aside from a jump, to see the moments on its own side of it.
_ASIDE = 1e-10
_SAME = 1e-9
# Angle (rad) by which the meridian may turn in one step, and into how many parts a step is cut at most.
_TURN = 0.1
_MOST_PARTS = 64


@dataclass(frozen=True)
class Grid:
    """When the motion is integrated."""

    nodes: FloatArray  # (n,) s
    breaks: BoolArray  # nodes where the moments may jump or kink (n,)
    samples: IntArray  # nodes that are samples of the record (m,)


@dataclass(frozen=True)
class Trajectory(Grid):
    """An integrated flight on its grid."""

    states: FloatArray  # (n, 13, 1)
    rates: FloatArray  # their changes per s, after a break


def grid(start: float, step: float, samples: int, steps_per_sample: int, breaks: FloatArray) -> Grid:
    """Uniform nodes from `start`, `step` apart, with `breaks` (s) inserted where they do not fall on one."""
    uniform = start + step * np.arange((samples - 1) * steps_per_sample + 1)
    inside = np.unique(breaks[(breaks >= start - _SAME) & (breaks <= uniform[-1] + _SAME)])
    offset = np.abs(inside - uniform[np.clip(np.rint((inside - start) / step).astype(int), 0, uniform.size - 1)])
    extra = inside[offset > _SAME]
    extra = extra[np.diff(extra, prepend=-np.inf) > _SAME]
    nodes = np.sort(np.concatenate([uniform, extra]))
    marked = np.zeros(nodes.size, dtype=np.bool_)
    nearest = np.clip(np.searchsorted(nodes, inside - _SAME), 0, nodes.size - 1)
    marked[nearest] = True
    return Grid(nodes, marked, np.searchsorted(nodes, uniform[::steps_per_sample]).astype(np.int64))


def break_times(system: System, start: float) -> FloatArray:
    """Where moments jump or kink (s): region edges, a wind step, and what follows one and two delays later."""
    step = system.config.environment.wind_step
    delays = np.unique([0.0, *(delay for item in system.planted for delay in item.delays())])
    edges = [edge for item in system.planted for edge in item.edges()]
    first = np.unique(np.array([*edges, *([] if step is None else [step.time])], dtype=float))
    # The start is a kink only for those who look back at it.
    kinks = np.concatenate([first, [start]]) if delays.size > 1 else first
    later = np.unique(kinks[:, None] + delays)
    return np.unique(np.concatenate([first, np.ravel(later), np.ravel(later[:, None] + delays)]))


def integrate(system: System, state: FloatArray, on: Grid, report: Report = silent) -> Trajectory:
    """The trajectory from `state` (13, 1); `report` is called now and then."""
    nodes = on.nodes
    history = History(system, nodes, on.breaks)

    def rate(time: float, value: FloatArray, near: FloatArray) -> tuple[FloatArray, Motion]:
        instant = np.full(1, time)
        air = system.air_data(instant, value)
        motion = system.motion(instant, value, air, near, history.past)
        return system.state_rate(value, air, motion), motion

    near = np.zeros(1)
    history.store(0, state, np.zeros_like(state), near)  # the first stage may look back already
    for node in range(nodes.size - 1):
        begin, end = nodes[node], nodes[node + 1]
        after = begin + _ASIDE if on.breaks[node] else begin
        before = end - _ASIDE if on.breaks[node + 1] else end
        k1, motion = rate(after, state, near)
        near = motion.windward_meridian
        history.store(node, state, k1, near)
        parts = _parts(motion, end - begin)
        step = (end - begin) / parts
        for part in range(parts):
            now = begin + part * step
            if part > 0:
                k1, motion = rate(now, state, near)
                near = motion.windward_meridian
            k2, _ = rate(now + 0.5 * step, state + (0.5 * step) * k1, near)
            k3, _ = rate(now + 0.5 * step, state + (0.5 * step) * k2, near)
            k4, _ = rate(before if part == parts - 1 else now + step, state + step * k3, near)
            state = state + (step / 6.0) * (k1 + 2.0 * (k2 + k3) + k4)
            state[ATTITUDE] /= np.sqrt(dot(state[ATTITUDE], state[ATTITUDE]))
        if on.breaks[node + 1]:
            history.rates_before[node + 1] = rate(before, state, near)[0]
        if node % 64 == 0:
            report(node / nodes.size, "simulating")
    final = nodes[-1] + _ASIDE if on.breaks[-1] else nodes[-1]
    k1, motion = rate(final, state, near)
    history.store(nodes.size - 1, state, k1, motion.windward_meridian)
    return Trajectory(**vars(on), states=history.states, rates=history.rates)


def _parts(motion: Motion, step: float) -> int:
    """Into how many parts a step (s) is cut, by how fast the meridian turns.

    The crossflow is taken to go on in a straight line; it turns fastest where that is nearest to zero.
    """
    alpha, turning = motion.alpha, motion.alpha * motion.windward_meridian_rate
    speed_squared = np.maximum(motion.alpha_rate**2 + turning**2, 1e-300)
    ahead = np.clip(-alpha * motion.alpha_rate / speed_squared, 0.0, step)
    nearest = (alpha + motion.alpha_rate * ahead) ** 2 + (turning * ahead) ** 2
    turn = np.abs(alpha * turning) / np.maximum(nearest, 1e-16) * step
    largest = float(np.max(np.minimum(np.fmax(turn, 0.0), np.pi), initial=0.0))  # fmax: 0 where it is NaN
    return min(max(int(np.ceil(largest / _TURN)), 1), _MOST_PARTS)
