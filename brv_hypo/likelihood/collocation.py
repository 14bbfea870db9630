"""The dynamics as Hermite-Simpson defects between samples, linearised over a whole segment at once.

For the interval from sample k to k + 1 of length h (Hargraves and Paris, J. Guidance 10, 1987)

    x_mid  = (x_k + x_k+1) / 2 + h / 8 (f_k - f_k+1)
    defect = x_k+1 - x_k - h / 6 (f_k + 4 f_mid + f_k+1)

which is fourth-order accurate and, each state being an unknown, never integrates an unstable motion.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.likelihood.derivatives import Delayed, Function, Jacobian, Method, Points, evaluate, jacobian
from brv_hypo.likelihood.elimination import BlockRows, Coupling
from brv_hypo.likelihood.segment import Grid, Stencil


@dataclass(frozen=True)
class Model:
    """The user's functions and how they are differentiated."""

    dynamics: Function  # f(x, u, theta, t[, delayed]) -> (n_states, n)
    outputs: Function  # h(x, u, theta, t[, delayed]) -> (n_outputs, n)
    delays: tuple[str, ...] = ()  # names of the parameters that are delays, s
    method: Method = "complex"  # step by which they are differentiated
    scale: Mapping[str, float] | None = None  # size of each parameter, for central differences


@dataclass(frozen=True)
class Linearisation:
    """One segment about states x and parameters theta, p of them."""

    defect: FloatArray  # defects, (n - 1, n_states)
    defect_by_state: BlockRows  # their derivatives by the states
    defect_by_parameter: FloatArray  # their derivatives by the parameters, (n - 1, n_states, p)
    output: FloatArray  # predicted outputs, (n, n_outputs)
    output_by_state: BlockRows  # their derivatives by the states
    output_by_parameter: FloatArray  # their derivatives by the parameters, (n, n_outputs, p)


def evaluate_segment(
    model: Model, grid: Grid, x: FloatArray, theta: Mapping[str, float]
) -> tuple[FloatArray, FloatArray]:
    """Defects (n - 1, n_states) and predicted outputs (n, n_outputs) at states x, (n_states, n)."""
    there = _There(model, grid, x, theta)
    f, f_end = there.slopes
    f_mid = evaluate(model.dynamics, there.points(grid.intervals[1], there.halfway), theta)
    return there.defect(f, f_mid, f_end), evaluate(model.outputs, there.at_samples, theta).T


def linearise_segment(
    model: Model, grid: Grid, x: FloatArray, theta: Mapping[str, float], names: tuple[str, ...]
) -> Linearisation:
    """Defects, outputs and their derivatives by states and by the named parameters."""
    there = _There(model, grid, x, theta)
    slope = there.jacobian(model.dynamics, there.everywhere, names)
    output = there.jacobian(model.outputs, there.at_samples, names)
    by_state, by_parameter = _defect_derivatives(grid, slope, there.back)
    late = [(there.back[name].part(slice(grid.n)), block) for name, block in output.by_delayed.items()]
    return Linearisation(
        defect=there.defect(*(slope.value[:, where] for where in grid.intervals)),
        defect_by_state=by_state,
        defect_by_parameter=by_parameter,
        output=output.value.T,
        output_by_state=_with_delays(output.by_state[:, None], late),
        output_by_parameter=output.by_parameter,
    )


@dataclass(frozen=True)
class _There:
    """A segment at some states and parameters."""

    model: Model  # the functions
    grid: Grid  # the segment
    x: FloatArray  # its states, (n_states, n)
    theta: Mapping[str, float]  # parameters by name

    @cached_property
    def back(self) -> Mapping[str, Stencil]:
        """What the delays see, by their names."""
        return {name: self.grid.delayed(self.theta[name]) for name in self.model.delays}

    @cached_property
    def at_samples(self) -> Points:
        """The samples."""
        return self.points(slice(self.grid.n), self.x)

    @cached_property
    def slopes(self) -> tuple[FloatArray, FloatArray]:
        """The dynamics at the starts and at the ends of the intervals."""
        f = evaluate(self.model.dynamics, self.at_samples, self.theta)
        if not self.grid.jumps:
            return f[:, :-1], f[:, 1:]
        ends = self.points(self.grid.intervals[2], self.x[:, 1:])
        return f[:, :-1], evaluate(self.model.dynamics, ends, self.theta)

    @property
    def halfway(self) -> FloatArray:
        """The states at the midpoints."""
        f, f_end = self.slopes
        return np.asarray(0.5 * (self.x[:, :-1] + self.x[:, 1:]) + self.grid.step / 8 * (f - f_end))

    @property
    def everywhere(self) -> Points:
        """Samples, midpoints and ends where inputs jump."""
        jumped = self.x[:, 1:] if self.grid.jumps else self.x[:, :0]
        return self.points(slice(None), np.concatenate([self.x, self.halfway, jumped], axis=1))

    def defect(self, f: FloatArray, f_mid: FloatArray, f_end: FloatArray) -> FloatArray:
        """Of each interval, (intervals, n_states), by the dynamics at its start, midpoint and end."""
        return np.asarray(np.diff(self.x, axis=1) - self.grid.step / 6 * (f + 4 * f_mid + f_end)).T

    def points(self, where: slice, at: FloatArray) -> Points:
        """Some of the grid's times, with the states `at` them, and what the delays see there."""
        delayed: dict[str, Delayed] = {}
        rates: dict[str, Delayed] = {}
        u = self.grid.u[:, : self.grid.n]
        for name, whole in self.back.items():
            stencil = whole.part(where)
            delayed[name] = Delayed(stencil.apply(self.x), stencil.apply(u))
            rates[name] = Delayed(stencil.apply(self.x, rate=True), stencil.apply(u, rate=True))
        time_varying = tuple(varying.part(where) for varying in self.grid.time_varying)
        return Points(at, self.grid.u[:, where], self.grid.t[where], delayed, rates, time_varying)

    def jacobian(self, function: Function, points: Points, names: tuple[str, ...]) -> Jacobian:
        """Derivatives by the named parameters, zero by those that the segment ignores."""
        selected = np.array([name not in self.grid.ignores for name in names], dtype=np.bool_)
        own = tuple(name for name in names if name not in self.grid.ignores)
        model = self.model
        found = jacobian(function, points, self.theta, own, model.method, model.scale or {})
        if selected.all():
            return found
        by_parameter = np.zeros((*found.by_parameter.shape[:2], selected.size))
        by_parameter[:, :, selected] = found.by_parameter
        return found._replace(by_parameter=by_parameter)


def start_points(model: Model, grid: Grid, theta: Mapping[str, float]) -> Points:
    """The samples, with the states as the segment's start gives them."""
    x = grid.start if grid.start.ndim == 2 else np.repeat(grid.start[:, None], grid.n, axis=1)
    return _There(model, grid, x, theta).at_samples


def _defect_derivatives(grid: Grid, slope: Jacobian, back: Mapping[str, Stencil]) -> tuple[BlockRows, FloatArray]:
    h = grid.step[:, None, None]
    parts = grid.intervals
    a, a_mid, a_end = (slope.by_state[where] for where in parts)
    b, b_mid, b_end = (slope.by_parameter[where] for where in parts)
    by_parameter = -h / 6 * (b + 4 * b_mid + b_end) - h**2 / 12 * (a_mid @ (b - b_end))
    through_mid = h / 3 * a_mid
    here = -through_mid - h / 6 * a - h / 4 * (through_mid @ a)
    after = -through_mid - h / 6 * a_end + h / 4 * (through_mid @ a_end)
    unit = np.eye(a.shape[1])
    local = np.stack([here - unit, after + unit], axis=1)
    coupling = []
    for name, by_delayed in slope.by_delayed.items():
        d, d_mid, d_end = (by_delayed[where] for where in parts)
        stencil = back[name]
        coupling += [
            (stencil.part(slice(grid.n - 1)), -h / 6 * d - h / 4 * (through_mid @ d)),
            (stencil.part(slice(1, grid.n)), -h / 6 * d_end + h / 4 * (through_mid @ d_end)),
            (stencil.part(parts[1]), -2 * h / 3 * d_mid),
        ]
    return _with_delays(local, coupling), by_parameter


def _with_delays(local: FloatArray, coupling: list[tuple[Stencil, FloatArray]]) -> BlockRows:
    """The local blocks, (rows, width, m, n_states), plus those that act on delayed states."""
    acting = ((stencil, block) for stencil, block in coupling if np.any(block))
    return BlockRows(local, tuple(Coupling(stencil.index, stencil.value, block) for stencil, block in acting))
