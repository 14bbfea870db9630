"""Eliminates the states of one segment from a Gauss-Newton step: one banded solve.

The step minimises 1/2 |r + J dx + J_p dp|^2 + 1/2 w' Q^-1 w subject to c + D dx + C dp = w, for every dp at
once. With multipliers l = Q^-1 w its stationary point solves

    [ J'J   D' ] [dx]     [J'r]   [J'J_p]
    [ D    -Q  ] [ l] = - [ c ] - [ C   ] dp

Output error is Q = 0, a constraint; filter error Q > 0. Ordered sample by sample the matrix is banded, and
pivoting keeps the elimination stable however fast the motion grows or decays, which forward recursion of
sensitivities does not. Stage k holds the multipliers of the constraint that ends at sample k (k = 0: the
initial state) and then the states of sample k.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.likelihood.blocks import BlockRows
from brv_hypo.likelihood.quadratic import Quadratic
from brv_hypo.likelihood.triangle import residual_last, upper_triangle

SINGULAR = 1e13
"""Condition, from the growth of a random right-hand side, at which states count as undetermined."""


@dataclass(frozen=True)
class BandSolution:
    """States and multipliers as affine functions of dp, kept whole: `x` and `multiplier` (n, n_states, 1 + p)."""

    problem: Quadratic
    x: FloatArray
    multiplier: FloatArray

    def states(self, weights: FloatArray) -> FloatArray:
        """See `Eliminated`."""
        return np.asarray(self.x @ weights)

    def step(self, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
        """See `Eliminated`."""
        return np.asarray(self.x @ weights), np.asarray(self.multiplier @ weights)

    def at_start(self) -> FloatArray:
        """See `Eliminated`."""
        return np.asarray(self.x[0])

    def rows(self) -> tuple[FloatArray, FloatArray | None]:
        """See `Eliminated`."""
        residual = self.problem.direct() + self.problem.by_state.dot(self.x)
        variance = np.where(np.isfinite(self.problem.variance), self.problem.variance, 0.0)
        return residual, np.sqrt(variance)[:, :, None] * self.multiplier if np.any(variance) else None

    def triangle(self) -> FloatArray:
        """See `Eliminated`."""
        return upper_triangle(
            np.concatenate([residual_last(part) for part in self.rows() if part is not None])
        )


def eliminate_by_band(problem: Quadratic) -> BandSolution | None:
    """Couplings, where there are any, make the band as wide as they reach.

    None where the outputs leave a state undetermined.
    """
    n, n_states = problem.defect.shape
    weight = _balance(problem.by_state)
    band, width = _assemble(problem, weight)
    right = _right_hand_side(problem, weight)
    norm = float(np.abs(band).sum(axis=0).max())
    from scipy.linalg import lapack  # here, for a cheap import of the package

    lu, pivots, info = lapack.dgbtrf(band, width, width, overwrite_ab=1)
    if info != 0:
        return None
    probe = np.random.default_rng(0).standard_normal((right.shape[0], 1))
    solution, _ = lapack.dgbtrs(lu, width, width, np.append(right, probe, axis=1), pivots, overwrite_b=1)
    growth = float(np.linalg.norm(solution[:, -1]) / np.linalg.norm(probe))
    if not growth * norm < SINGULAR or not np.all(np.isfinite(solution)):
        return None
    stages = solution[:, :-1].reshape(n, 2, n_states, -1)
    return BandSolution(problem, stages[:, 1], stages[:, 0] * weight)


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
