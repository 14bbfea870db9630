"""The quadratic problem of one segment, and its solution by one banded solve.

The linearised dynamics and outputs are sparse rows of blocks (`BlockRows`): neighbours in time, and delayed states by
a few weights a row. A Gauss-Newton step minimises 1/2 |r + J dx + J_p dp|^2 + 1/2 w' Q^-1 w subject to c + D dx + C
dp = w, for every dp at once. With multipliers l = Q^-1 w its stationary point solves

    [ J'J   D' ] [dx]     [J'r]   [J'J_p]
    [ D    -Q  ] [ l] = - [ c ] - [ C   ] dp

Output error is Q = 0, a constraint; filter error Q > 0. Ordered sample by sample the matrix is banded, and pivoting
keeps the elimination stable however fast the motion grows or decays. Stage k holds the multipliers of the constraint
that ends at sample k (k = 0: the initial state), then the states of sample k. `eliminate_by_band` is the entrance.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Protocol

import numpy as np

from brv_hypo.arrays import BoolArray, FloatArray, IntArray

if TYPE_CHECKING:
    from scipy.sparse import csr_array


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

    @cached_property
    def _nonzero(self) -> BoolArray:
        """Which blocks are not zero, (n_rows, width)."""
        return np.asarray(self.blocks.reshape(*self.blocks.shape[:2], -1).any(axis=2))

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

    def without_couplings(self) -> BlockRows:
        """The neighbours in time alone."""
        return replace(self, couplings=())

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

    def extent(self, n: int) -> tuple[IntArray, IntArray]:
        """First and last sample that each row acts on, (n_rows,) each, of n samples."""
        rows = np.arange(self.blocks.shape[0])
        lowest, highest = np.full(rows.size, n), np.full(rows.size, -1)
        for w in self.filled:
            acts = self._nonzero[:, w]
            at = rows[acts] + self.offset + w
            lowest[acts], highest[acts] = np.minimum(lowest[acts], at), np.maximum(highest[acts], at)
        for coupling in self.couplings:
            for index, weight in zip(coupling.index.T, coupling.weight.T, strict=True):
                acts = weight != 0.0
                lowest[acts] = np.minimum(lowest[acts], index[acts])
                highest[acts] = np.maximum(highest[acts], index[acts])
        return lowest, highest

    def span(self, n: int) -> tuple[int, int]:
        """Distance from a row's own number to the first and to the last of n samples that any row acts on."""
        if not self.couplings:
            return self.offset, self.offset + self.blocks.shape[1] - 1
        rows = np.arange(self.blocks.shape[0])
        lowest, highest = self.extent(n)
        acts = highest >= 0
        return int(np.min((lowest - rows)[acts], initial=0)), int(np.max((highest - rows)[acts], initial=0))

    def matrix(self, n: int, part: slice = slice(None)) -> csr_array[np.float64]:
        """Some of the rows, (n_rows m, n n_states), without the zeros."""
        from scipy.sparse import coo_array  # here, for a cheap import of the package

        rows = np.arange(self.blocks.shape[0])[part]
        m, n_states = self.blocks.shape[2:]
        values, down, along = [np.zeros(0)], [np.zeros(0, dtype=np.int64)], [np.zeros(0, dtype=np.int64)]
        for row, sample, blocks in self._entries(part):
            at = (row * m)[:, None, None] + np.arange(m)[:, None]
            column = (sample * n_states)[:, None, None] + np.arange(n_states)
            at, column = np.broadcast_arrays(at, column)
            values.append(blocks.ravel())
            down.append(at.ravel())
            along.append(column.ravel())
        entries = (np.concatenate(values), (np.concatenate(down), np.concatenate(along)))
        return coo_array(entries, shape=(rows.size * m, n * n_states)).tocsr()

    def _entries(self, part: slice) -> Iterator[tuple[IntArray, IntArray, FloatArray]]:
        """Rows counted from the first of the part, samples, and the blocks that stand there."""
        start = part.indices(self.blocks.shape[0])[0]
        own, nonzero = self.blocks[part], self._nonzero[part]
        for w in self.filled:
            row = np.flatnonzero(nonzero[:, w])
            yield row, row + start + self.offset + w, own[row, w]
        for coupling in self.couplings:
            here = coupling.part(part)
            for index, weight in zip(here.index.T, here.weight.T, strict=True):
                row = np.flatnonzero(weight)
                yield row, index[row], weight[row, None, None] * here.blocks[row]

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

    def widened(self, n: int) -> BlockRows:
        """The same matrix with couplings spread over the width: for those that reach a few samples only."""
        if not self.couplings:
            return self
        first, last = self.span(n)
        first, last = min(first, self.offset), max(last, self.offset + self.blocks.shape[1] - 1)
        blocks = np.zeros((self.blocks.shape[0], last - first + 1, *self.blocks.shape[2:]))
        for row, sample, block in self._entries(slice(None)):
            blocks[row, sample - row - first] += block
        return BlockRows(first, blocks)


# ---- The quadratic problem of one segment, and what its answer can be asked ----


@dataclass(frozen=True)
class Quadratic:
    """The quadratic problem of one segment: n samples, p parameters."""

    residual: FloatArray
    """r, (n, n_outputs), whitened."""
    by_state: BlockRows
    """J."""
    by_parameter: FloatArray
    """J_p, (n, n_outputs, p)."""
    defect: FloatArray
    """c, (n, n_states); row 0 is that of the initial state."""
    defect_by_state: BlockRows
    """D without row 0, which is the unit matrix."""
    defect_by_parameter: FloatArray
    """C, (n, n_states, p)."""
    variance: FloatArray
    """Diagonal of Q, (n, n_states); row 0 infinite where the initial state is free."""

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


class Eliminated(Protocol):
    """The states as affine functions of the parameter step dp.

    `weights` (1 + p,) are 1 and dp, or a derivative's 0 and direction.
    """

    @property
    def problem(self) -> Quadratic:
        """What was eliminated from."""

    def states(self, weights: FloatArray) -> FloatArray:
        """dx, (n, n_states)."""

    def step(self, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
        """dx and the multipliers of the dynamics, (n, n_states) each; row 0 of these is the initial state's."""

    def residuals(self) -> FloatArray:
        """r + J dx + J_p dp, (n, n_outputs, 1 + p): the constant part and the derivative by dp."""

    def triangle(self) -> FloatArray:
        """Upper triangle of the same rows and of the whitened process noise, the constant part as last column, (1 + p,
        1 + p).
        """


# ---- Upper triangles of tall matrices by QR, a slab at a time ----


_SLAB = 8
"""Rows of a slab over its columns: small slabs stay in cache, and below what a threaded BLAS would split."""


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


def residual_last(columns: FloatArray) -> FloatArray:
    """(n, m, 1 + p) with the constant part first, as rows (n m, p + 1) with it last."""
    rows = columns.reshape(-1, columns.shape[2])
    return np.concatenate([rows[:, 1:], rows[:, :1]], axis=1)


# ---- The states eliminated by one banded solve ----


_SINGULAR = 1e13
"""Condition, from the growth of a random right-hand side, at which states count as undetermined."""


@dataclass(frozen=True)
class BandSolution:
    """States and multipliers as affine functions of dp, kept whole: `x` and `multiplier` (n, n_states, 1 + p);
    `log_det` is that of the matrix, see `log_determinant`.
    """

    problem: Quadratic
    x: FloatArray
    multiplier: FloatArray
    log_det: float

    def states(self, weights: FloatArray) -> FloatArray:
        """See `Eliminated`."""
        return np.asarray(self.x @ weights)

    def step(self, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
        """See `Eliminated`."""
        return np.asarray(self.x @ weights), np.asarray(self.multiplier @ weights)

    def residuals(self) -> FloatArray:
        """See `Eliminated`."""
        return self.problem.direct() + self.problem.by_state.dot(self.x)

    def noise(self) -> FloatArray:
        """The whitened process noise, (n, n_states, 1 + p), the initial state's row first."""
        variance = np.where(np.isfinite(self.problem.variance), self.problem.variance, 0.0)
        return np.asarray(np.sqrt(variance)[:, :, None] * self.multiplier)

    def triangle(self) -> FloatArray:
        """See `Eliminated`."""
        rows = [residual_last(self.residuals())]
        if np.any(self.problem.variance[np.isfinite(self.problem.variance)]):
            rows.append(residual_last(self.noise()))
        return upper_triangle(np.concatenate(rows))


def eliminate_by_band(problem: Quadratic) -> BandSolution | None:
    """Couplings, where there are any, make the band as wide as they reach.

    None where the outputs leave a state undetermined.
    """
    from scipy.linalg import lapack  # here, for a cheap import of the package

    n, n_states = problem.defect.shape
    weight = _balance(problem.by_state)
    band, width = _assemble(problem, weight)
    right = _right_hand_side(problem, weight)
    norm = float(np.abs(band).sum(axis=0).max())
    factor, pivots, log_det = _factored(problem, band, weight)
    if not np.isfinite(log_det):
        return None
    probe = np.random.default_rng(0).standard_normal((right.shape[0], 1))
    solution, _ = lapack.dgbtrs(factor, width, width, np.append(right, probe, axis=1), pivots, overwrite_b=1)
    growth = float(np.linalg.norm(solution[:, -1]) / np.linalg.norm(probe))
    if not growth * norm < _SINGULAR or not np.all(np.isfinite(solution)):
        return None
    stages = solution[:, :-1].reshape(n, 2, n_states, -1)
    return BandSolution(problem, stages[:, 1], stages[:, 0] * weight, log_det)


def log_determinant(problem: Quadratic) -> float:
    """log |det| of the matrix without the rows of free initial states' multipliers; nan where it is singular."""
    weight = _balance(problem.by_state)
    return _factored(problem, _assemble(problem, weight)[0], weight)[2]


def _factored(problem: Quadratic, band: FloatArray, weight: float) -> tuple[FloatArray, IntArray, float]:
    """LU factor and pivots of the assembled band, and `log_determinant`."""
    from scipy.linalg import lapack

    width = (band.shape[0] - 1) // 3
    factor, pivots, info = lapack.dgbtrf(band, width, width, overwrite_ab=1)
    if info != 0:
        return factor, pivots, float("nan")
    free = np.count_nonzero(np.isinf(problem.variance[0]))
    return factor, pivots, float(np.sum(np.log(np.abs(factor[2 * width]))) + free * np.log(weight))


def _balance(by_state: BlockRows) -> float:
    """Divides the objective, so that the blocks of the matrix are of one size."""
    blocks = by_state.blocks
    squares = float(np.sum(blocks**2)) + sum(float(np.sum(c.blocks**2)) for c in by_state.couplings)
    size = squares / (blocks.shape[0] * blocks.shape[3])
    return size if size > 0 else 1.0


class _Band:
    """LAPACK band storage of a matrix of stages, each of two parts (multipliers, states) of m rows."""

    def __init__(self, n: int, m: int, width: int) -> None:
        self.n, self.m, self.width = n, m, width
        self.storage = np.zeros((3 * width + 1, 2 * m * n), order="F")

    def add(self, row: tuple[int, int], column: tuple[int, int], blocks: FloatArray) -> None:
        """Add blocks (count, m, m) along the diagonal.

        The first stands at (stage, part) `row` and `column`, each next one a stage further.
        """
        first = max(0, -row[0], -column[0])
        last = min(blocks.shape[0], self.n - row[0], self.n - column[0])
        if last <= first:
            return
        m = self.m
        below = 2 * m * (row[0] - column[0]) + m * (row[1] - column[1])
        start = 2 * m * (column[0] + first) + m * column[1]
        stop = start + 2 * m * (last - first)
        for i in range(m):
            for j in range(m):
                line = self.storage[2 * self.width + below + i - j]
                line[start + j : stop : 2 * m] += blocks[first:last, i, j]


def band_size(problem: Quadratic) -> int:
    """Numbers that the band holds."""
    n, n_states = problem.defect.shape
    return int((3 * _half_width(problem.defect_by_state, problem.by_state, n) + 1) * 2 * n_states * n)


def _half_width(dynamics: BlockRows, outputs: BlockRows, n: int) -> int:
    """Diagonals on either side of the middle."""
    (back, ahead), (first, last) = dynamics.span(n), outputs.span(n)
    return int(dynamics.blocks.shape[3]) * max(2 * (1 - back), 2 * ahead, 2 * (last - first) + 1) - 1


def _assemble(problem: Quadratic, weight: float) -> tuple[FloatArray, int]:
    """Band storage of LAPACK for the matrix, the objective divided by `weight`, and the half bandwidth."""
    n, n_states = problem.defect.shape
    dynamics, outputs = problem.defect_by_state.widened(n), problem.by_state.widened(n)
    width = _half_width(dynamics, outputs, n)
    band = _Band(n, n_states, width)
    free = np.isinf(problem.variance)
    diagonal = np.where(free, 1.0, -problem.variance * weight)
    unit = np.where(free[:1], 0.0, 1.0)[:, :, None] * np.eye(n_states)
    band.add((0, 0), (0, 0), diagonal[:, :, None] * np.eye(n_states))
    band.add((0, 0), (0, 1), unit)
    band.add((0, 1), (0, 0), unit)
    for w in dynamics.filled:
        block = dynamics.blocks[:, w]
        band.add((1, 0), (dynamics.offset + w, 1), block)
        band.add((dynamics.offset + w, 1), (1, 0), block.transpose(0, 2, 1))
    for v in outputs.filled:
        for w in outputs.filled:
            product = outputs.blocks[:, v].transpose(0, 2, 1) @ outputs.blocks[:, w]
            band.add((outputs.offset + v, 1), (outputs.offset + w, 1), product / weight)
    return band.storage, width


def _right_hand_side(problem: Quadratic, weight: float) -> FloatArray:
    n, n_states = problem.defect.shape
    outputs = problem.by_state.widened(n)
    columns = problem.direct()
    right = np.zeros((n, 2, n_states, columns.shape[2]))
    right[:, 0] = -problem.defects()
    for w in outputs.filled:
        at = np.arange(n) + outputs.offset + w
        inside = (at >= 0) & (at < n)
        gradient = outputs.blocks[:, w].transpose(0, 2, 1) @ columns
        right[at[inside], 1] -= gradient[inside] / weight
    return np.asfortranarray(right.reshape(2 * n_states * n, -1))
