"""First derivatives of the user's functions, and the dynamics as Hermite-Simpson defects, a whole segment at once.

The complex step is exact to rounding (Squire and Trapp, SIAM Review 40, 1998) for functions that accept complex arrays
and are analytic: no abs, no comparison of complex values, no arctan2. Else, and for a function that is `Differenced`,
central differences are taken, each step scaled by the variable that it changes. For the interval from sample k to k + 1
of length h (Hargraves and Paris, J. Guidance 10, 1987)

    x_mid  = (x_k + x_k+1) / 2 + h / 8 (f_k - f_k+1)
    defect = x_k+1 - x_k - h / 6 (f_k + 4 f_mid + f_k+1)

which is fourth-order accurate and, each state being an unknown, never integrates an unstable motion.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, reduce
from operator import add
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np

from brv_hypo.arrays import FloatArray, IntArray
from brv_hypo.errors import UsageError
from brv_hypo.likelihood.elimination import block_rows
from brv_hypo.likelihood.segment import Grid, SampledParameter, Weights

if TYPE_CHECKING:
    from scipy.sparse import csr_array


@dataclass(frozen=True)
class Differenced:
    """A function (x, u, theta, t[, delayed]) -> (m, n) whose derivatives are central differences."""

    function: Callable[..., Any]
    affine: frozenset[str] = frozenset()  # in which the function is affine, all else held: one difference is exact

    def __call__(self, *arguments: Any) -> Any:
        """The function."""
        return self.function(*arguments)


Method = Literal["complex", "central"]
Function = Callable[..., Any]
Values = Mapping[str, Any]  # of parameters, by name

_COMPLEX_STEP = 1e-30
_CENTRAL_STEP = float(np.finfo(float).eps) ** (1 / 3)
_AGREEMENT = 1e-4  # largest relative difference to central differences at which the complex step is accepted
_BLOCK_ROUNDING = 1e-8  # rounding of central differences, against the largest derivative of a block

_NEXT_TO_ZERO = 1e-8  # magnitude of a start value below which it may be meant as 0
_NEGLIGIBLE = 1e-6  # magnitude of a parameter, against what moves a function by its own size, too small for a step


class Delayed(NamedTuple):
    """States (n_states, n) and inputs (n_inputs, n) a delay earlier, as the user's functions see them."""

    x: FloatArray
    u: FloatArray


@dataclass(frozen=True)
class Points:
    """Where a function is evaluated."""

    x: FloatArray  # states, (n_states, n)
    u: FloatArray  # inputs, (n_inputs, n)
    t: FloatArray  # times, (n,), s
    delayed: Mapping[str, Delayed] = field(default_factory=dict)  # x(t - delay) and u(t - delay) by the delay's name
    rates: Mapping[str, Delayed] = field(default_factory=dict)  # their derivatives by time
    time_varying: tuple[SampledParameter, ...] = ()  # the parameters that vary along the samples


class Jacobian(NamedTuple):
    """Value and derivatives by states, parameters and, by the name of their delay, delayed states."""

    value: FloatArray  # (m, n)
    by_state: FloatArray  # (n, m, n_states)
    by_parameter: FloatArray  # (n, m, p)
    by_delayed: dict[str, FloatArray]  # (n, m, n_states)


def evaluate(function: Function, points: Points, theta: Values) -> FloatArray:
    """The function's value, (m, n)."""
    return np.asarray(_call(function, points.x, points, _with_time_varying(points, theta), points.delayed))


def jacobian(
    function: Function, points: Points, theta: Values, names: tuple[str, ...], method: Method, scale: Values
) -> Jacobian:
    """Value and derivatives at all points by the named parameters, of sizes `scale`; weights through what they vary."""
    n_states = points.x.shape[0]
    theta = _with_time_varying(points, theta)
    kind: type = complex if method == "complex" else float
    x: Any = points.x.astype(kind)
    delayed = {name: Delayed(d.x.astype(kind), d.u) for name, d in points.delayed.items()}
    value = np.asarray(_call(function, points.x, points, theta, points.delayed))
    affine = function.affine if isinstance(function, Differenced) else frozenset[str]()

    def derivative(move: Callable[[Any], Any], size: float, straight: bool = False) -> FloatArray:
        if method == "complex":
            return np.asarray(np.imag(move(1j * _COMPLEX_STEP)).T / _COMPLEX_STEP)
        if straight:
            return np.asarray((np.asarray(move(size), dtype=float) - value).T / size)
        step = _CENTRAL_STEP * size
        return np.asarray((np.array(move(step), dtype=float) - np.array(move(-step), dtype=float)).T / (2 * step))

    def along_row(array: FloatArray, row: int) -> Callable[[Any], Any]:
        def move(step: Any) -> Any:
            kept = array[row].copy()
            array[row] += step
            moved = np.array(_call(function, x, points, theta, delayed))  # a copy: it may be a view of x
            array[row] = kept
            return moved

        return move

    def along_parameter(name: str) -> Callable[[Any], Any]:
        def move(step: Any) -> Any:
            delayed_then = delayed
            if name in delayed:
                rate, now = points.rates[name], points.delayed[name]
                delayed_then = delayed | {name: Delayed(now.x - step * rate.x, now.u - step * rate.u)}
            return _call(function, x, points, dict(theta) | {name: theta[name] + step}, delayed_then)

        return move

    columns = [derivative(along_row(x, row), _size(points.x[row])) for row in range(n_states)]
    through: dict[str, FloatArray] = {}
    for varying in points.time_varying:
        if any(weight in names for weight in varying.weights):
            size = _largest_size(varying.weights, theta, scale)
            own = derivative(along_parameter(varying.name), size, varying.name in affine)
            for w, shape in zip(varying.weights, varying.shapes, strict=True):
                part = own * shape[:, None]
                through[w] = through[w] + part if w in through else part
    columns += [
        through[name]
        if name in through
        else derivative(along_parameter(name), _largest_size((name,), theta, scale), name in affine)
        for name in names
    ]
    for name, before in delayed.items():
        columns += [derivative(along_row(before.x, row), _size(points.delayed[name].x[row])) for row in range(n_states)]
    ends = np.cumsum([n_states, len(names), *(n_states for _ in delayed)])
    by_state, by_parameter, *late = np.split(np.stack(columns, axis=-1), ends[:-1], axis=2)
    return Jacobian(value, by_state, by_parameter, dict(zip(delayed, late, strict=True)))


def choose_method(
    functions: tuple[Function, ...], points: Points, theta: Values, names: tuple[str, ...], scale: Mapping[str, float]
) -> Method:
    """The complex step where every function takes it and central differences agree; else those."""
    if any(isinstance(function, Differenced) for function in functions):
        return "central"
    for function in functions:
        central = jacobian(function, points, theta, names, "central", scale)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error", np.exceptions.ComplexWarning)
                exact = jacobian(function, points, theta, names, "complex", scale)
        except (TypeError, np.exceptions.ComplexWarning):
            return "central"
        for a, b in zip((*exact[1:3], *exact[3].values()), (*central[1:3], *central[3].values()), strict=True):
            # Each entry, (n, m, columns), over the samples, rounding of the whole block aside.
            size = np.abs(b).max(axis=0, initial=0.0)
            allowed = _AGREEMENT * size + _BLOCK_ROUNDING * size.max(initial=0.0)
            if not (np.all(np.isfinite(a)) and np.all(np.abs(a - b) <= allowed)):
                return "central"
    return "complex"


def parameter_scales(
    functions: tuple[Function, ...], points: Points, theta: Values, names: tuple[str, ...], known: Values | None = None
) -> dict[str, float]:
    """A size for each parameter, so that one that starts at 0, or next to it, gets a sensible difference step. Its own
    magnitude, or, where that is next to nothing against it, the change that would move a function by as much as the
    function's own size, at most 1. `known` gives the size of some beforehand.
    """
    known = known or {}
    scale = {name: max(abs(theta[name]), known.get(name, 0.0)) for name in names}
    small = [name for name in names if scale[name] < _NEGLIGIBLE]
    if not small:
        return scale
    origin = dict(theta) | {name: 0.0 for name in small if scale[name] < _NEXT_TO_ZERO}
    reference = [evaluate(f, points, origin) for f in functions]
    for name in small:
        change = origin | {name: origin[name] + _CENTRAL_STEP}
        ratios = [1.0]
        for function, value in zip(functions, reference, strict=True):
            moved, size = np.linalg.norm(evaluate(function, points, change) - value), np.linalg.norm(value)
            if 0 < moved < np.inf and size > 0:
                ratios.append(float(_CENTRAL_STEP * size / moved))
        if scale[name] < _NEGLIGIBLE * min(ratios):
            scale[name] = min(ratios)
    return scale


def check_shape(function: Function, points: Points, theta: Values, rows: int, what: str) -> None:
    """UsageError for a function whose value has the wrong shape or is not finite at the start."""
    value = evaluate(function, points, theta)
    expected = (rows, points.t.size)
    if value.shape != expected:
        raise UsageError(
            f"{what} returned an array of shape {value.shape}; expected {expected}, one row per "
            f"{'state' if what == 'dynamics' else 'output'} and one column per sample"
        )
    if not np.all(np.isfinite(value)):
        raise UsageError(f"{what} is not finite at the start values; check theta0, x0 and u, or start nearer")


def _with_time_varying(points: Points, theta: Values) -> dict[str, Any]:
    """The parameters, and the time-varying ones at their values."""
    return {varying.name: varying.at(theta) for varying in points.time_varying} | dict(theta)


def _call(function: Function, x: FloatArray, points: Points, theta: Values, delayed: Mapping[str, Delayed]) -> Any:
    return function(x, points.u, theta, points.t, *((delayed,) if delayed else ()))


def _largest_size(names: Collection[str], theta: Values, scale: Mapping[str, float]) -> float:
    return float(max(max(abs(theta[name]), scale.get(name, 1.0)) for name in names))


def _size(row: FloatArray) -> float:
    size = float(np.sqrt(np.mean(row**2)))
    return size if size > 0 else 1.0


# ---- The dynamics as defects between samples, linearised over a whole segment ----


@dataclass(frozen=True)
class System:
    """The user's functions and how they are differentiated."""

    dynamics: Function  # f(x, u, theta, t[, delayed]) -> (n_states, n)
    outputs: Function  # h(x, u, theta, t[, delayed]) -> (n_outputs, n)
    delays: tuple[str, ...] = ()  # names of the parameters that are delays, s
    method: Method = "complex"  # step by which they are differentiated
    scale: Mapping[str, float] = field(default_factory=dict)  # size of each parameter, for central differences


@dataclass(frozen=True)
class Linearisation:
    """One segment about states x and those p parameters that act in it."""

    own: IntArray  # their places among all, (p,)
    defect: FloatArray  # defects, (n - 1, n_states)
    defect_by_state: FloatArray  # by the states before and after, (n - 1, 2, n_states, n_states)
    # by all states that delays add, all defects one after the other, ((n - 1) n_states, n n_states); None without any
    defect_by_delayed: csr_array[np.float64] | None
    defect_by_parameter: FloatArray  # (n - 1, n_states, p)
    output: FloatArray  # predicted outputs, (n, n_outputs)
    output_by_state: FloatArray  # by the state of the sample, (n, n_outputs, n_states)
    output_by_delayed: csr_array[np.float64] | None  # the same of outputs, (n n_outputs, n n_states)
    output_by_parameter: FloatArray  # (n, n_outputs, p)


def evaluate_segment(model: System, grid: Grid, x: FloatArray, theta: Values) -> tuple[FloatArray, FloatArray]:
    """Defects (n - 1, n_states) and predicted outputs (n, n_outputs) at states x, (n_states, n)."""
    there = _There(model, grid, x, theta)
    f, f_end = there.slopes
    f_mid = evaluate(model.dynamics, there.points(grid.intervals[1], there.halfway), theta)
    return there.defect(f, f_mid, f_end), evaluate(model.outputs, there.at_samples, theta).T


def linearise_segment(model: System, grid: Grid, x: FloatArray, theta: Values, names: tuple[str, ...]) -> Linearisation:
    """Defects, outputs and their derivatives by states and by those of the named parameters that act there."""
    there = _There(model, grid, x, theta)
    jumped = x[:, 1:] if grid.jumps else x[:, :0]
    everywhere = there.points(slice(None), np.concatenate([x, there.halfway, jumped], axis=1))
    own = [k for k, name in enumerate(names) if name not in grid.ignores]
    acting = tuple(names[k] for k in own)
    slope = jacobian(model.dynamics, everywhere, theta, acting, model.method, model.scale)
    output = jacobian(model.outputs, there.at_samples, theta, acting, model.method, model.scale)
    h, parts = grid.step[:, None, None], grid.intervals
    a, a_mid, a_end = (slope.by_state[where] for where in parts)
    b, b_mid, b_end = (slope.by_parameter[where] for where in parts)
    through_mid, unit = h / 3 * a_mid, np.eye(a.shape[1])
    here = -through_mid - h / 6 * a - h / 4 * (through_mid @ a)
    after = -through_mid - h / 6 * a_end + h / 4 * (through_mid @ a_end)
    late = []
    for name, by_delayed in slope.by_delayed.items():
        d, d_mid, d_end = (by_delayed[where] for where in parts)
        weights, _ = there.back[name]
        late += [
            (weights[: grid.n - 1], -h / 6 * d - h / 4 * (through_mid @ d)),
            (weights[1 : grid.n], -h / 6 * d_end + h / 4 * (through_mid @ d_end)),
            (weights[parts[1]], -2 * h / 3 * d_mid),
        ]
    return Linearisation(
        own=np.array(own, dtype=np.int64),
        defect=there.defect(*(slope.value[:, where] for where in parts)),
        defect_by_state=np.stack([here - unit, after + unit], axis=1),
        defect_by_delayed=_by_delayed(late),
        defect_by_parameter=-h / 6 * (b + 4 * b_mid + b_end) - h**2 / 12 * (a_mid @ (b - b_end)),
        output=output.value.T,
        output_by_state=output.by_state,
        output_by_delayed=_by_delayed([(there.back[name][0][: grid.n], d) for name, d in output.by_delayed.items()]),
        output_by_parameter=output.by_parameter,
    )


@dataclass(frozen=True)
class _There:
    model: System  # the functions
    grid: Grid  # the segment
    x: FloatArray  # its states, (n_states, n)
    theta: Values  # parameters by name

    @cached_property
    def back(self) -> Mapping[str, Weights]:
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

    def defect(self, f: FloatArray, f_mid: FloatArray, f_end: FloatArray) -> FloatArray:
        """Of each interval, (intervals, n_states), by the dynamics at its start, midpoint and end."""
        return np.asarray(np.diff(self.x, axis=1) - self.grid.step / 6 * (f + 4 * f_mid + f_end)).T

    def points(self, where: slice, at: FloatArray) -> Points:
        """Some of the grid's times, with the states `at` them, and what the delays see there."""
        late: dict[str, tuple[Delayed, Delayed]] = {}  # values and their rates
        u = self.grid.u[:, : self.grid.n]
        for name, weights in self.back.items():
            value, rate = (Delayed(np.asarray(self.x @ w[where].T), np.asarray(u @ w[where].T)) for w in weights)
            late[name] = value, rate
        delayed, rates = ({name: each[k] for name, each in late.items()} for k in (0, 1))
        time_varying = tuple(varying.part(where) for varying in self.grid.time_varying)
        return Points(at, self.grid.u[:, where], self.grid.t[where], delayed, rates, time_varying)


def start_points(model: System, grid: Grid, theta: Values) -> Points:
    """The samples, with the states as the segment's start gives them."""
    x = grid.start if grid.start.ndim == 2 else np.repeat(grid.start[:, None], grid.n, axis=1)
    return _There(model, grid, x, theta).at_samples


def _by_delayed(late: Sequence[tuple[csr_array[np.float64], FloatArray]]) -> csr_array[np.float64] | None:
    """Blocks (n_rows, m, n_states), each acting on its row of weighted samples (n_rows, n): their sum, row by row."""
    from scipy.sparse import eye_array, kron  # here, for a cheap import of the package

    acting = [
        block_rows(blocks[:, None]) @ kron(weights, eye_array(blocks.shape[2]), format="csr")
        for weights, blocks in late
        if np.any(blocks)
    ]
    return reduce(add, acting) if acting else None
