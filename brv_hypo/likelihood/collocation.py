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
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from brv_hypo.arrays import FloatArray, IntArray
from brv_hypo.likelihood.derivatives import Delayed, Function, Jacobian, Method, Points, evaluate, jacobian
from brv_hypo.likelihood.elimination import BlockRows, Coupling
from brv_hypo.likelihood.segment import Grid, Stencil

_AT_ONCE = 8192
"""Samples at which the functions are evaluated at a time: what a call needs stays small beside the record."""


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


def parts_of(n: int) -> list[slice]:
    """n samples in parts to be worked on at a time."""
    edges = np.linspace(0, n, -(-n // _AT_ONCE) + 1).astype(np.int64).tolist()
    return [slice(first, last) for first, last in pairwise(edges)]


def evaluate_segment(
    model: Model, grid: Grid, x: FloatArray, theta: Mapping[str, float]
) -> tuple[FloatArray, FloatArray]:
    """Defects (n - 1, n_states) and predicted outputs (n, n_outputs) at states x, (n_states, n)."""
    back = {name: grid.delayed(theta[name]) for name in model.delays}
    defects, outputs = [], []
    for part in parts_of(grid.n):
        there = _There(model, grid, x, theta, back, _Place.of(grid, part))
        f_mid = evaluate(model.dynamics, there.points(there.place.middles, there.halfway), theta)
        defects.append(there.defect(there.slopes[0], f_mid, there.slopes[1]))
        outputs.append(evaluate(model.outputs, there.at_samples, theta)[:, : there.place.own].T)
    return np.concatenate(defects), np.concatenate(outputs)


def linearise_segment(
    model: Model,
    grid: Grid,
    x: FloatArray,
    theta: Mapping[str, float],
    names: tuple[str, ...],
    part: slice = slice(None),
) -> Linearisation:
    """Defects, outputs and their derivatives by states and by the named parameters: those of all samples and
    intervals, or of the samples of a part and of the intervals that begin there.
    """
    back = {name: grid.delayed(theta[name]) for name in model.delays}
    place = _Place.of(grid, part)
    there = _There(model, grid, x, theta, back, place)
    slope = there.jacobian(model.dynamics, there.everywhere, names)
    output = there.jacobian(model.outputs, there.at_samples, names)
    by_state, by_parameter = _defect_derivatives(place, slope, back)
    own = slice(0, place.own)
    return Linearisation(
        defect=there.defect(*(slope.value[:, where] for where in place.of_intervals)),
        defect_by_state=by_state,
        defect_by_parameter=by_parameter,
        output=output.value.T[own],
        output_by_state=_with_delays(
            output.by_state[own, None],
            [(back[d].part(place.samples).part(own), b[own]) for d, b in output.by_delayed.items()],
        ),
        output_by_parameter=output.by_parameter[own],
    )


class _Place(NamedTuple):
    """A part of a grid."""

    samples: IntArray  # its samples and one more, where there is one, for the last interval
    middles: IntArray  # the points halfway
    ends: IntArray  # the intervals' ends, where inputs jump there
    step: FloatArray  # lengths of the intervals, s
    own: int  # how many samples are its own

    @classmethod
    def of(cls, grid: Grid, part: slice) -> _Place:
        first, last, _ = part.indices(grid.n)
        samples = np.arange(first, min(last + 1, grid.n))
        middles = grid.n + samples[:-1]
        ends = middles + grid.n - 1 if grid.jumps else middles[:0]
        return cls(samples, middles, ends, grid.step[samples[:-1]], last - first)

    @property
    def everywhere(self) -> IntArray:
        """Samples, ends, midpoints."""
        return np.concatenate([self.samples, self.ends, self.middles])

    @property
    def of_intervals(self) -> tuple[slice, slice, slice]:
        """Where `everywhere` has the intervals' starts, midpoints and ends; without jumps these are samples."""
        count = self.middles.size
        end = self.samples.size if self.ends.size else 1
        middle = self.samples.size + self.ends.size
        return slice(0, count), slice(middle, middle + count), slice(end, end + count)


@dataclass(frozen=True)
class _There:
    """A part of a segment at some states and parameters."""

    model: Model  # the functions
    grid: Grid  # the segment
    x: FloatArray  # states of the whole segment, (n_states, n)
    theta: Mapping[str, float]  # parameters by name
    back: Mapping[str, Stencil]  # what the delays see, by their names
    place: _Place  # the part

    @cached_property
    def here(self) -> FloatArray:
        """The states at the samples."""
        return self.x[:, self.place.samples]

    @cached_property
    def at_samples(self) -> Points:
        """The samples."""
        return self.points(self.place.samples)

    @cached_property
    def slopes(self) -> tuple[FloatArray, FloatArray]:
        """The dynamics at the starts and at the ends of the intervals."""
        f = evaluate(self.model.dynamics, self.at_samples, self.theta)
        if not self.place.ends.size:
            return f[:, :-1], f[:, 1:]
        ends = self.points(self.place.ends, self.x[:, self.place.samples[1:]])
        return f[:, :-1], evaluate(self.model.dynamics, ends, self.theta)

    @property
    def halfway(self) -> FloatArray:
        """The states at the midpoints."""
        f, f_end = self.slopes
        return np.asarray(0.5 * (self.here[:, :-1] + self.here[:, 1:]) + self.place.step / 8 * (f - f_end))

    @property
    def everywhere(self) -> Points:
        """Samples, ends where inputs jump, and midpoints."""
        jumped = self.here[:, 1:] if self.grid.jumps else self.here[:, :0]
        return self.points(self.place.everywhere, np.concatenate([self.here, jumped, self.halfway], axis=1))

    def defect(self, f: FloatArray, f_mid: FloatArray, f_end: FloatArray) -> FloatArray:
        """Of each interval, (intervals, n_states), by the dynamics at its start, midpoint and end."""
        return np.asarray(np.diff(self.here, axis=1) - self.place.step / 6 * (f + 4 * f_mid + f_end)).T

    def points(self, where: IntArray, at: FloatArray | None = None) -> Points:
        """Some of the samples and midpoints; `at` gives states other than samples."""
        return _points(self.grid, self.x, self.back, where, at)

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


def start_points(grid: Grid, theta: Mapping[str, float], delays: tuple[str, ...]) -> Points:
    """The samples, or some thousand of them, with the states as the segment's start gives them."""
    x = grid.start if grid.start.ndim == 2 else np.repeat(grid.start[:, None], grid.n, axis=1)
    selected = np.unique(np.linspace(0, grid.n - 1, min(grid.n, _AT_ONCE)).astype(np.int64))
    return _points(grid, x, {name: grid.delayed(theta[name]) for name in delays}, selected)


def _points(
    grid: Grid, x: FloatArray, back: Mapping[str, Stencil], where: IntArray, at: FloatArray | None = None
) -> Points:
    """Some of the samples and midpoints, and what the delays see there; `at` gives states other than samples."""
    delayed: dict[str, Delayed] = {}
    rates: dict[str, Delayed] = {}
    u = grid.u[:, : grid.n]
    for name, whole in back.items():
        stencil = whole.part(where)
        delayed[name] = Delayed(stencil.apply(x), stencil.apply(u))
        rates[name] = Delayed(stencil.apply(x, rate=True), stencil.apply(u, rate=True))
    time_varying = tuple(varying.part(where) for varying in grid.time_varying)
    return Points(x[:, where] if at is None else at, grid.u[:, where], grid.t[where], delayed, rates, time_varying)


def _defect_derivatives(place: _Place, slope: Jacobian, back: Mapping[str, Stencil]) -> tuple[BlockRows, FloatArray]:
    h = place.step[:, None, None]
    parts = place.of_intervals
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
            (stencil.part(place.samples[:-1]), -h / 6 * d - h / 4 * (through_mid @ d)),
            (stencil.part(place.samples[1:]), -h / 6 * d_end + h / 4 * (through_mid @ d_end)),
            (stencil.part(place.middles), -2 * h / 3 * d_mid),
        ]
    return _with_delays(local, coupling), by_parameter


def _with_delays(local: FloatArray, coupling: list[tuple[Stencil, FloatArray]]) -> BlockRows:
    """The local blocks, (rows, width, m, n_states), plus those that act on delayed states."""
    return BlockRows(0, local, tuple(Coupling(stencil.index, stencil.value, block) for stencil, block in coupling))
