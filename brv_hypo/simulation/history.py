"""The past of a running integration: states at its nodes, cubic Hermite between them (fourth order)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from brv_hypo.arrays import BoolArray, FloatArray
from brv_hypo.errors import UsageError
from brv_hypo.motion.motion import Motion
from brv_hypo.simulation.dynamics import STATES, System


class History:
    """States and their rates at the nodes passed so far.

    At a break the rate jumps: the interval before it ends with the rate before the jump, the one after begins
    with the rate after it.
    """

    def __init__(self, system: System, nodes: FloatArray, breaks: BoolArray, flights: int) -> None:
        """Room for nodes (n,) s of `flights` flights; `breaks` (n,) marks where rates may jump."""
        self.system = system
        self.nodes = nodes
        self.states = np.zeros((nodes.size, STATES, flights))
        self.rates = np.zeros_like(self.states)
        self.meridians = np.zeros((nodes.size, flights))
        self._before = np.zeros((int(np.count_nonzero(breaks)), STATES, flights))
        self._break_row = np.where(breaks, np.cumsum(breaks) - 1, -1)
        self._columns = np.arange(flights)
        self._last = 0
        self._recent: dict[bytes, Motion] = {}

    def store(self, node: int, state: FloatArray, rate: FloatArray, meridian: FloatArray) -> None:
        """The state of a node with the rate that follows it."""
        self.states[node], self.rates[node], self.meridians[node] = state, rate, meridian
        self._last = node
        self._recent.clear()

    def store_before(self, node: int, rate: FloatArray) -> None:
        """The rate that leads up to a break."""
        self._before[self._break_row[node]] = rate

    def past(self, time: FloatArray) -> Motion:
        """The motion at `time` (flights,) s; before the start it is steady (see `Motion.delayed`)."""
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
        left = np.clip(np.searchsorted(self.nodes, inside, side="right") - 1, 0, max(self._last - 1, 0))
        state = self._interpolated(inside, left)
        air = self.system.air_data(time, state)
        motion = self.system.motion(time, state, air, self.meridians[left, self._columns], self.past)
        if np.all(time >= begin):
            return motion
        turned = motion.windward_meridian + (time - inside) * motion.windward_meridian_rate
        return replace(motion, windward_meridian=turned)

    def _interpolated(self, time: FloatArray, left: np.typing.NDArray[np.intp]) -> FloatArray:
        """State (13, flights): each flight in its own interval."""
        right = left + 1
        step = self.nodes[right] - self.nodes[left]
        s = (time - self.nodes[left]) / step
        rows = self._break_row[right]
        rate_right = self.rates[right, :, self._columns].T
        if np.any(rows >= 0):
            rate_right = np.where(rows >= 0, self._before[rows, :, self._columns].T, rate_right)
        s2, s3 = s * s, s * s * s
        return np.asarray(
            (2.0 * s3 - 3.0 * s2 + 1.0) * self.states[left, :, self._columns].T
            + (s3 - 2.0 * s2 + s) * step * self.rates[left, :, self._columns].T
            + (3.0 * s2 - 2.0 * s3) * self.states[right, :, self._columns].T
            + (s3 - s2) * step * rate_right,
            dtype=float,
        )
