"""The quadratic problem of one segment, and the elimination of its states.

The linearised dynamics and outputs are sparse rows of blocks (`BlockRows`): neighbours in time, and delayed states by
a few weights a row. A Gauss-Newton step minimises 1/2 |r + J dx + J_p dp|^2 + 1/2 w' Q^-1 w subject to c + D dx + C
dp = w, for every dp at once. With multipliers l = Q^-1 w its stationary point solves

    [ J'J   D' ] [dx]     [J'r]   [J'J_p]
    [ D    -Q  ] [ l] = - [ c ] - [ C   ] dp

Output error is Q = 0, a constraint; filter error Q > 0. `solve_saddle` factors the matrix, ordered sample by sample
(stage k holds the multipliers of the constraint that ends at sample k, k = 0: the initial state, then the states of
sample k): its factors are sparse, and pivoting keeps it stable however fast the motion grows or decays. A delay would
fill them: exact dynamics with delays are condensed, as long as the motion does not grow beyond its digits: the states
follow from the first one by forward substitution,

    D dx = -(c, C) dp,    dx = s + S dp + E a,    a the first state, by least squares of the outputs.

`eliminate` is the entrance.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Literal

import numpy as np

from brv_hypo.arrays import FloatArray, IntArray

if TYPE_CHECKING:
    from scipy.sparse import csc_array, csr_array
    from scipy.sparse.linalg import SuperLU


@dataclass(frozen=True)
class Coupling:
    """What one delay adds: row k acts by `blocks[k]` on the sum over j of weight[k, j] x[index[k, j]].

    `index` and `weight` are (n_rows, points), `blocks` (n_rows, m, n_states).
    """

    index: IntArray
    weight: FloatArray
    blocks: FloatArray

    def part(self, where: slice) -> Coupling:
        """Some of the rows."""
        return Coupling(self.index[where], self.weight[where], self.blocks[where])


@dataclass(frozen=True)
class BlockRows:
    """A sparse matrix of block rows: row k acts on the states of samples k + offset, k + offset + 1, ...

    `blocks` is (n_rows, width, m, n_states); blocks that would stand outside the samples are zero. `couplings` act
    on samples further away.
    """

    offset: int
    blocks: FloatArray
    couplings: tuple[Coupling, ...] = ()

    @staticmethod
    def joined(parts: Sequence[BlockRows]) -> BlockRows:
        """Rows of several parts, one after the other; couplings that act on nothing are dropped."""
        if len(parts) == 1 and all(np.any(c.blocks) for c in parts[0].couplings):
            return parts[0]
        couplings = [
            Coupling(*(np.concatenate([getattr(c, name) for c in each]) for name in ("index", "weight", "blocks")))
            for each in zip(*(part.couplings for part in parts), strict=True)
        ]
        return BlockRows(
            parts[0].offset,
            np.concatenate([part.blocks for part in parts]),
            tuple(c for c in couplings if np.any(c.blocks)),
        )

    @cached_property
    def filled(self) -> tuple[int, ...]:
        """Where along the width any block is not zero."""
        return tuple(w for w in range(self.blocks.shape[1]) if self.blocks[:, w].any())

    def turned(self, left: FloatArray, right: FloatArray) -> BlockRows:
        """Every block B as left B diag(right); left (m,) is a diagonal, (n_rows, m', m) one matrix a row."""

        def turn(blocks: FloatArray, one_a_row: FloatArray) -> FloatArray:
            turned = one_a_row @ blocks if left.ndim == 3 else left[:, None] * blocks
            return np.asarray(turned * right)

        return replace(
            self,
            blocks=turn(self.blocks, left[:, None]),
            couplings=tuple(replace(c, blocks=turn(c.blocks, left)) for c in self.couplings),
        )

    def dot(self, x: FloatArray) -> FloatArray:
        """The product with states x, (n, n_states) or (n, n_states, p), as (n_rows, m) or (n_rows, m, p)."""
        n = x.shape[0]
        columns = x.reshape(n, x.shape[1], -1)
        product = np.zeros((*self.blocks.shape[::2], columns.shape[2]))
        for w in self.filled:
            column = np.clip(np.arange(self.blocks.shape[0]) + self.offset + w, 0, n - 1)
            product += self.blocks[:, w] @ columns[column]
        for coupling in self.couplings:
            delayed = np.zeros((coupling.index.shape[0], *columns.shape[1:]))
            for index, weight in zip(coupling.index.T, coupling.weight.T, strict=True):
                delayed += weight[:, None, None] * columns[index]
            product += coupling.blocks @ delayed
        return product.reshape(*self.blocks.shape[::2], *x.shape[2:])

    def matrix(self, n: int) -> csr_array[np.float64]:
        """All of it, (n_rows m, n n_states), without the blocks of zeros."""
        from scipy.sparse import coo_array  # here, for a cheap import of the package

        m, n_states = self.blocks.shape[2:]
        values, down, along = [np.zeros(0)], [np.zeros(0, dtype=np.int64)], [np.zeros(0, dtype=np.int64)]
        for row, sample, blocks in self._entries():
            at = (row * m)[:, None, None] + np.arange(m)[:, None]
            column = (sample * n_states)[:, None, None] + np.arange(n_states)
            at, column = np.broadcast_arrays(at, column)
            values.append(blocks.ravel())
            down.append(at.ravel())
            along.append(column.ravel())
        entries = (np.concatenate(values), (np.concatenate(down), np.concatenate(along)))
        return coo_array(entries, shape=(self.blocks.shape[0] * m, n * n_states)).tocsr()

    def _entries(self) -> Iterator[tuple[IntArray, IntArray, FloatArray]]:
        """Rows, samples, and the blocks that stand there."""
        for w in self.filled:
            row = np.flatnonzero(self.blocks[:, w].any(axis=(1, 2)))
            yield row, row + self.offset + w, self.blocks[row, w]
        for coupling in self.couplings:
            for index, weight in zip(coupling.index.T, coupling.weight.T, strict=True):
                row = np.flatnonzero(weight)
                yield row, index[row], weight[row, None, None] * coupling.blocks[row]

    def own(self, first: int = 0) -> FloatArray:
        """How each row acts on the sample of its own number, (n_rows, m, n_states); `first` is that of row 0."""
        found = np.zeros((self.blocks.shape[0], *self.blocks.shape[2:]))
        if 0 <= -self.offset < self.blocks.shape[1]:
            found += self.blocks[:, -self.offset]
        rows = np.arange(first, first + self.blocks.shape[0])
        for coupling in self.couplings:
            for index, weight in zip(coupling.index.T, coupling.weight.T, strict=True):
                found += np.where(index == rows, weight, 0.0)[:, None, None] * coupling.blocks
        return found


@dataclass(frozen=True)
class Quadratic:
    """The quadratic problem of one segment: n samples, p parameters."""

    residual: FloatArray  # r, (n, n_outputs), whitened
    by_state: BlockRows  # J
    by_parameter: FloatArray  # J_p, (n, n_outputs, p)
    defect: FloatArray  # c, (n, n_states); row 0 is that of the initial state
    defect_by_state: BlockRows  # D without row 0, which is the unit matrix
    defect_by_parameter: FloatArray  # C, (n, n_states, p)
    variance: FloatArray  # diagonal of Q, (n, n_states); row 0 infinite where the initial state is free

    @property
    def exact(self) -> bool:
        """Whether no noise drives the states."""
        return not np.any(self.variance[1:])

    def direct(self, part: slice = slice(None)) -> FloatArray:
        """[r J_p] of some samples, (samples, n_outputs, 1 + p)."""
        return np.concatenate([self.residual[part, :, None], self.by_parameter[part]], axis=2)

    def defects(self, part: slice = slice(None)) -> FloatArray:
        """[c C] of some samples, (samples, n_states, 1 + p); zero where the initial state is free."""
        found = np.concatenate([self.defect[part, :, None], self.defect_by_parameter[part]], axis=2)
        found[np.isinf(self.variance[part])] = 0.0
        return found


_SLAB = 8  # rows of a slab over its columns: small slabs stay in cache, and below what a threaded BLAS would split


def upper_triangle(rows: FloatArray) -> FloatArray:
    """R of a tall matrix, (columns, columns): QR of slabs, then of their triangles (TSQR)."""
    columns = rows.shape[1]
    slab = _SLAB * columns
    while rows.shape[0] > slab:
        spare = -rows.shape[0] % slab
        padded = np.concatenate([rows, np.zeros((spare, columns))]) if spare else rows
        rows = np.asarray(np.linalg.qr(padded.reshape(-1, slab, columns), mode="r")).reshape(-1, columns)
    padded = np.concatenate([rows, np.zeros((columns, columns))])
    return np.asarray(np.linalg.qr(padded, mode="r"))


def _residual_last(columns: FloatArray) -> FloatArray:
    """(n, m, 1 + p) with the constant part first, as rows (n m, p + 1) with it last."""
    rows = columns.reshape(-1, columns.shape[2])
    return np.concatenate([rows[:, 1:], rows[:, :1]], axis=1)


# ---- The states as affine functions of the parameter step ----


_SINGULAR = 1e13  # condition, from the growth of a random right-hand side, at which states count as undetermined
_GROWTH = 1e6
"""Growth of the motion from the first state beyond which it is not condensed: states lose so many digits, multipliers,
of which only the size matters, the square of it.
"""
_OBSERVABLE = 1e-8
"""Singular value of what the outputs see of the first state, against the largest, below which one is unseen."""


@dataclass(frozen=True)
class Eliminated(ABC):
    """The states as affine functions of the parameter step dp, `x` (n, n_states, 1 + p) by 1 and dp.

    `weights` (1 + p,) are 1 and dp, or a derivative's 0 and direction.
    """

    problem: Quadratic
    x: FloatArray
    triangle: FloatArray
    """That of `residuals` and of the whitened process noise, the constant part as last column, (1 + p, 1 + p)."""

    def states(self, weights: FloatArray) -> FloatArray:
        """dx, (n, n_states)."""
        return np.asarray(self.x @ weights)

    @abstractmethod
    def multipliers(self, weights: FloatArray) -> FloatArray:
        """The multipliers of the dynamics, (n, n_states); row 0 is the initial state's."""

    def residuals(self) -> FloatArray:
        """r + J dx + J_p dp, (n, n_outputs, 1 + p): the constant part and the derivative by dp."""
        return self.problem.direct() + self.problem.by_state.dot(self.x)


@dataclass(frozen=True)
class SaddlePoint(Eliminated):
    """By the factors of the whole matrix: `multiplier` (n, n_states, 1 + p); `log_det`: see `log_determinant`."""

    multiplier: FloatArray
    log_det: float

    def multipliers(self, weights: FloatArray) -> FloatArray:
        """See `Eliminated`."""
        return np.asarray(self.multiplier @ weights)


@dataclass(frozen=True)
class Condensed(Eliminated):
    """By forward substitution; `dynamics` has the factors of D."""

    dynamics: SuperLU

    def multipliers(self, weights: FloatArray) -> FloatArray:
        """See `Eliminated`: D' l = -J' (r + J dx + J_p dp)."""
        n, m = self.problem.defect.shape
        pull = -(self.problem.by_state.matrix(n).T @ (self.residuals() @ weights).ravel())
        found = np.asarray(self.dynamics.solve(pull, trans="T")).reshape(n, m)  # type: ignore[call-overload]
        found[0, np.isinf(self.problem.variance[0])] = 0.0
        return found


def eliminate(problem: Quadratic) -> Eliminated | None:
    """The states eliminated; None where the outputs leave one undetermined."""
    condensed = condense(problem) if problem.exact and problem.defect_by_state.couplings else None
    return solve_saddle(problem) if condensed is None else condensed


def condense(problem: Quadratic) -> Condensed | None:
    """The states of exact dynamics as they follow from the first one; None where that is unstable or undetermined."""
    from scipy.sparse.linalg import splu

    n, m = problem.defect.shape
    columns = 1 + problem.by_parameter.shape[2]
    try:
        dynamics = splu(_dynamics(problem, np.ones(m)).tocsc(), permc_spec="NATURAL", diag_pivot_thresh=0.0)
    except RuntimeError:  # exactly singular
        return None
    right = np.zeros((n, m, columns + m))
    right[1:, :, :columns] = -problem.defects(slice(1, None))
    right[0, :, columns:] = np.eye(m)
    paths = np.asarray(dynamics.solve(right.reshape(n * m, -1))).reshape(right.shape)
    x, units = paths[:, :, :columns], paths[:, :, columns:]
    if not np.all(np.isfinite(paths)) or np.abs(units).max() > _GROWTH:
        return None
    first = np.zeros((m, columns))
    start, variance = problem.defects(slice(0, 1))[0], problem.variance[0]
    first[variance == 0.0] = -start[variance == 0.0]
    free, known = variance > 0.0, np.isfinite(variance) & (variance > 0.0)
    observed = problem.by_state.dot(paths)
    rest = problem.direct() + observed[:, :, :columns] + observed[:, :, columns:] @ first
    count = int(free.sum())
    outputs = np.concatenate([observed[:, :, columns:][:, :, free], rest], axis=2).reshape(-1, count + columns)
    prior = np.concatenate([np.eye(m)[known][:, free], start[known]], axis=1) / np.sqrt(variance[known])[:, None]
    # The constant part goes last: the triangle below the first state's rows is that of what is left.
    order = np.array([*range(count), *range(count + 1, count + columns), count])
    triangle = upper_triangle(np.concatenate([outputs, prior])[:, order])
    singular = np.linalg.svd(triangle[:count, :count], compute_uv=False)
    if count and not singular[-1] > _OBSERVABLE * singular[0]:
        return None
    first[free] = -np.linalg.solve(triangle[:count, :count], triangle[:count, count:])[:, [-1, *range(columns - 1)]]
    return Condensed(problem, x + units @ first, triangle[count:, count:], dynamics)


def solve_saddle(problem: Quadratic) -> SaddlePoint | None:
    """The stationary point by the factors of the whole matrix; None where the outputs leave a state undetermined."""
    n, m = problem.defect.shape
    weight = _balance(problem.by_state)
    matrix = _saddle_matrix(problem, weight)
    factor = _factored(matrix, problem)
    if factor is None:
        return None
    direct = problem.direct()
    right = np.zeros((n, 2, m, direct.shape[2] + 1))
    right[:, 0, :, :-1] = -problem.defects()
    pull = np.asarray(problem.by_state.matrix(n).T @ direct.reshape(-1, direct.shape[2]))
    right[:, 1, :, :-1] = -pull.reshape(n, m, -1) / weight
    probe = np.random.default_rng(0).standard_normal((n, 2, m))
    right[..., -1] = probe
    solution = np.asarray(factor.solve(right.reshape(2 * n * m, -1))).reshape(right.shape)
    growth = float(np.linalg.norm(solution[..., -1]) / np.linalg.norm(probe))
    norm = float(abs(matrix).sum(axis=0).max())
    if not growth * norm < _SINGULAR or not np.all(np.isfinite(solution)):
        return None
    multiplier, x = solution[:, 0, :, :-1] * weight, solution[:, 1, :, :-1]
    residuals = direct + problem.by_state.dot(x)
    noise = np.sqrt(np.where(np.isfinite(problem.variance), problem.variance, 0.0))[:, :, None] * multiplier
    rows = [_residual_last(residuals), *([_residual_last(noise)] if np.any(noise) else [])]
    return SaddlePoint(problem, x, upper_triangle(np.concatenate(rows)), multiplier, _log_det(factor, problem, weight))


def log_determinant(problem: Quadratic) -> float:
    """log |det| of the matrix without the rows of free initial states' multipliers; nan where it is singular."""
    weight = _balance(problem.by_state)
    factor = _factored(_saddle_matrix(problem, weight), problem)
    return float("nan") if factor is None else _log_det(factor, problem, weight)


def _log_det(factor: SuperLU, problem: Quadratic, weight: float) -> float:
    free = np.count_nonzero(np.isinf(problem.variance[0]))
    return float(np.sum(np.log(np.abs(factor.U.diagonal()))) + free * np.log(weight))


def _balance(by_state: BlockRows) -> float:
    """Divides the objective, so that the blocks of the matrix are of one size."""
    blocks = by_state.blocks
    squares = float(np.sum(blocks**2)) + sum(float(np.sum(c.blocks**2)) for c in by_state.couplings)
    size = squares / (blocks.shape[0] * blocks.shape[3])
    return size if size > 0 else 1.0


def _dynamics(problem: Quadratic, start: FloatArray) -> csr_array[np.float64]:
    """D with the rows of the initial state, `start` (n_states,) on their diagonal."""
    from scipy.sparse import csr_array, diags_array, vstack

    n, m = problem.defect.shape
    first = diags_array(start, shape=(m, n * m))
    return csr_array(vstack([first, problem.defect_by_state.matrix(n)], format="csr"))


def _saddle_matrix(problem: Quadratic, weight: float) -> csc_array[np.float64]:
    """The matrix in the order of stages, the objective divided by `weight`."""
    from scipy.sparse import block_array, csc_array, diags_array

    n, m = problem.defect.shape
    free = np.isinf(problem.variance)
    dynamics, outputs = _dynamics(problem, np.where(free[0], 0.0, 1.0)), problem.by_state.matrix(n)
    noise = diags_array(np.where(free, 1.0, -problem.variance * weight).ravel())
    whole = block_array([[noise, dynamics], [dynamics.T, (outputs.T @ outputs) / weight]], format="coo")
    place = np.arange(2 * n * m).reshape(n, 2, m).transpose(1, 0, 2).ravel()
    data: FloatArray = np.asarray(whole.data, dtype=float)
    return csc_array((data, (place[whole.row], place[whole.col])), shape=whole.shape)


def _factored(matrix: csc_array[np.float64], problem: Quadratic) -> SuperLU | None:
    """None where it is exactly singular, or not finite."""
    from scipy.sparse.linalg import splu

    ordering: Literal["COLAMD", "NATURAL"] = (
        "COLAMD" if problem.defect_by_state.couplings or problem.by_state.couplings else "NATURAL"
    )
    if not np.all(np.isfinite(matrix.data)):
        return None
    try:
        return splu(matrix, permc_spec=ordering, diag_pivot_thresh=1.0, options={"Equil": False})
    except RuntimeError:
        return None
