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
from typing import TYPE_CHECKING

import numpy as np

from brv_hypo.arrays import BoolArray, FloatArray
from brv_hypo.likelihood.derivatives import Delayed, Function, Jacobian, Method, Points, evaluate, jacobian
from brv_hypo.likelihood.interpolation import Stencil
from brv_hypo.likelihood.segment import Grid, History, LookBack

if TYPE_CHECKING:
    from scipy.sparse import csr_array

_MANY = 6
"""Filled places along the width from which a sparse matrix is faster than one product for each."""


@dataclass(frozen=True)
class Model:
    """The user's functions and how they are differentiated; `delays` names the parameters that are delays,
    `affine` those in which both functions are affine.
    """

    dynamics: Function
    outputs: Function
    delays: tuple[str, ...] = ()
    method: Method = "complex"
    scale: Mapping[str, float] | None = None
    affine: frozenset[str] = frozenset()


@dataclass(frozen=True)
class BlockRows:
    """A sparse matrix of block rows: row k acts on the states of samples k + offset, k + offset + 1, ...

    `blocks` is (n_rows, width, m, n_states); blocks that would stand outside the samples are zero.
    """

    offset: int
    blocks: FloatArray

    @cached_property
    def filled(self) -> tuple[int, ...]:
        """Where along the width any block is not zero: a delay looks at few of the samples that it spans."""
        return tuple(np.flatnonzero(self._nonzero.any(axis=0)).tolist())

    @cached_property
    def _nonzero(self) -> BoolArray:
        """Which blocks are not zero, (n_rows, width)."""
        return np.asarray(self.blocks.reshape(*self.blocks.shape[:2], -1).any(axis=2))

    def dot(self, x: FloatArray) -> FloatArray:
        """The product with states x, (n, n_states) or (n, n_states, p), as (n_rows, m) or (n_rows, m, p)."""
        n = x.shape[0]
        columns = x.reshape(n, x.shape[1], -1)
        if len(self.filled) > _MANY:
            flat = self.matrix(n) @ columns.reshape(n * x.shape[1], -1)
            return np.asarray(flat).reshape(*self.blocks.shape[::2], *x.shape[2:])
        product = np.zeros((*self.blocks.shape[::2], columns.shape[2]))
        for w in self.filled:
            column = np.clip(np.arange(self.blocks.shape[0]) + self.offset + w, 0, n - 1)
            product += self.blocks[:, w] @ columns[column]
        return product.reshape(*self.blocks.shape[::2], *x.shape[2:])

    def matrix(self, n: int) -> csr_array[np.float64]:
        """The whole, (n_rows m, n n_states), without its zeros."""
        from scipy.sparse import csr_array  # here, for a cheap import of the package

        count, _, m, n_states = self.blocks.shape
        k, w = np.nonzero(self._nonzero)
        rows = (k * m)[:, None, None] + np.arange(m)[:, None]
        columns = ((k + self.offset + w) * n_states)[:, None, None] + np.arange(n_states)
        rows, columns = np.broadcast_arrays(rows, columns)
        return csr_array(
            (self.blocks[k, w].ravel(), (rows.ravel(), columns.ravel())), shape=(count * m, n * n_states)
        )


@dataclass(frozen=True)
class Linearisation:
    """One segment about states x and parameters theta; p parameters of the segment.

    Attributes:
        defect: (n - 1, n_states). defect_by_state: BlockRows. defect_by_parameter: (n - 1, n_states, p).
        output: (n, n_outputs). output_by_state: BlockRows. output_by_parameter: (n, n_outputs, p).
    """

    defect: FloatArray
    defect_by_state: BlockRows
    defect_by_parameter: FloatArray
    output: FloatArray
    output_by_state: BlockRows
    output_by_parameter: FloatArray


def evaluate_segment(
    model: Model, grid: Grid, x: FloatArray, theta: Mapping[str, float]
) -> tuple[FloatArray, FloatArray]:
    """Defects (n - 1, n_states) and predicted outputs (n, n_outputs) at states x, (n_states, n)."""
    back = _look_back(model.delays, grid, theta)
    at_samples = _points(grid, x, back, grid.samples)
    f = evaluate(model.dynamics, at_samples, theta)
    middle = slice(grid.n, None)
    f_mid = evaluate(model.dynamics, _points(grid, x, back, middle, _midpoints(grid, x, f)), theta)
    output = evaluate(model.outputs, at_samples, theta)
    return _defect(grid, x, f, f_mid).T, output.T


def linearise_segment(
    model: Model, grid: Grid, x: FloatArray, theta: Mapping[str, float], names: tuple[str, ...]
) -> Linearisation:
    """Defects, outputs and their derivatives by states and by the named parameters."""
    back = _look_back(model.delays, grid, theta)
    at_samples = _points(grid, x, back, grid.samples)
    f = evaluate(model.dynamics, at_samples, theta)
    everywhere = _points(grid, x, back, slice(None), np.concatenate([x, _midpoints(grid, x, f)], axis=1))
    slope, output = (
        _jacobian(model, function, points, theta, names, grid.ignores)
        for function, points in ((model.dynamics, everywhere), (model.outputs, at_samples))
    )
    by_state, by_parameter = _defect_derivatives(grid, slope, back)
    n = grid.n
    return Linearisation(
        defect=_defect(grid, x, slope.value[:, :n], slope.value[:, n:]).T,
        defect_by_state=by_state,
        defect_by_parameter=by_parameter,
        output=output.value.T,
        output_by_state=_with_delays(
            n,
            0,
            output.by_state[:, None],
            [(back[d].stencil, slice(0, n), b) for d, b in output.by_delayed.items()],
        ),
        output_by_parameter=output.by_parameter,
    )


def _jacobian(
    model: Model,
    function: Function,
    points: Points,
    theta: Mapping[str, float],
    names: tuple[str, ...],
    ignored: frozenset[str],
) -> Jacobian:
    """Derivatives by the named parameters, zero by those that are ignored."""
    seen = np.array([name not in ignored for name in names], dtype=np.bool_)
    own = tuple(name for name in names if name not in ignored)
    found = jacobian(function, points, theta, own, model.method, model.scale or {}, model.affine)
    if seen.all():
        return found
    by_parameter = np.zeros((*found.by_parameter.shape[:2], seen.size))
    by_parameter[:, :, seen] = found.by_parameter
    return found._replace(by_parameter=by_parameter)


def start_points(grid: Grid, theta: Mapping[str, float], delays: tuple[str, ...]) -> Points:
    """The samples, with the states as the segment's start gives them."""
    x = grid.start if grid.start.ndim == 2 else np.repeat(grid.start[:, None], grid.n, axis=1)
    return _points(grid, x, _look_back(delays, grid, theta), grid.samples)


def _look_back(delays: tuple[str, ...], grid: Grid, theta: Mapping[str, float]) -> dict[str, LookBack]:
    return {name: grid.look_back(theta[name]) for name in delays}


def _points(
    grid: Grid, x: FloatArray, back: Mapping[str, LookBack], part: slice, at: FloatArray | None = None
) -> Points:
    """The samples, midpoints or both, and what the delays see there; `at` gives states other than samples."""
    delayed: dict[str, Delayed] = {}
    rates: dict[str, Delayed] = {}
    u = grid.u[:, : grid.n]
    for name, whole in back.items():
        stencil = whole.stencil.part(part)
        delayed[name] = _with_history(stencil.apply(x), stencil.apply(u), whole.before, part)
        rates[name] = _with_history(stencil.apply_rate(x), stencil.apply_rate(u), whole.before_rate, part)
    courses = tuple(course.part(part) for course in grid.courses)
    return Points(x if at is None else at, grid.u[:, part], grid.t[part], delayed, rates, courses)


def _with_history(x: FloatArray, u: FloatArray, before: History | None, part: slice) -> Delayed:
    return Delayed(x, u) if before is None else Delayed(x + before.x[:, part], u + before.u[:, part])


def _midpoints(grid: Grid, x: FloatArray, f: FloatArray) -> FloatArray:
    return np.asarray(0.5 * (x[:, :-1] + x[:, 1:]) + grid.step / 8 * (f[:, :-1] - f[:, 1:]))


def _defect(grid: Grid, x: FloatArray, f: FloatArray, f_mid: FloatArray) -> FloatArray:
    return np.asarray(np.diff(x, axis=1) - grid.step / 6 * (f[:, :-1] + 4 * f_mid + f[:, 1:]))


def _defect_derivatives(
    grid: Grid, slope: Jacobian, back: Mapping[str, LookBack]
) -> tuple[BlockRows, FloatArray]:
    n, n_states = grid.n, slope.by_state.shape[1]
    h = grid.step[:, None, None]
    a, a_mid = slope.by_state[:n], slope.by_state[n:]
    b, b_mid = slope.by_parameter[:n], slope.by_parameter[n:]
    by_parameter = -h / 6 * (b[:-1] + 4 * b_mid + b[1:]) - h**2 / 12 * (a_mid @ (b[:-1] - b[1:]))
    through_mid = h / 3 * a_mid
    here = -through_mid - h / 6 * a[:-1] - h / 4 * (through_mid @ a[:-1])
    after = -through_mid - h / 6 * a[1:] + h / 4 * (through_mid @ a[1:])
    unit = np.eye(n_states)
    local = np.stack([here - unit, after + unit], axis=1)
    coupling = []
    for name, by_delayed in slope.by_delayed.items():
        d, d_mid = by_delayed[:n], by_delayed[n:]
        stencil = back[name].stencil
        coupling += [
            (stencil, slice(0, n - 1), -h / 6 * d[:-1] - h / 4 * (through_mid @ d[:-1])),
            (stencil, slice(1, n), -h / 6 * d[1:] + h / 4 * (through_mid @ d[1:])),
            (stencil, slice(n, 2 * n - 1), -2 * h / 3 * d_mid),
        ]
    return _with_delays(n, 0, local, coupling), by_parameter


def _with_delays(
    n: int, offset: int, local: FloatArray, coupling: list[tuple[Stencil, slice, FloatArray]]
) -> BlockRows:
    """The local blocks, (rows, width, m, n_states), plus blocks spread over interpolation weights."""
    coupling = [entry for entry in coupling if np.any(entry[2])]
    if not coupling:
        return BlockRows(offset, local)
    rows = np.arange(local.shape[0])
    reach = [s.index[part] - rows[:, None] for s, part, _ in coupling]
    first = min(offset, *(int(r.min()) for r in reach))
    last = max(offset + local.shape[1] - 1, *(int(r.max()) for r in reach))
    blocks = np.zeros((rows.size, last - first + 1, *local.shape[2:]))
    blocks[:, offset - first : offset - first + local.shape[1]] = local
    for (stencil, part, by_delayed), distance in zip(coupling, reach, strict=True):
        weights = stencil.value[part]
        for j in range(weights.shape[1]):
            blocks[rows, distance[:, j] - first] += weights[:, j, None, None] * by_delayed
    return BlockRows(first, blocks)
