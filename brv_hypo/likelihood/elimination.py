"""Eliminates the states of one segment from a Gauss-Newton step: one banded solve, linear in the samples.

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
from scipy.linalg import lapack

from brv_hypo.arrays import FloatArray, IntArray
from brv_hypo.likelihood.collocation import BlockRows

_SINGULAR = 1e-15
"""Reciprocal condition at which the states count as undetermined."""


@dataclass(frozen=True)
class Quadratic:
    """The quadratic problem of one segment: n samples, p parameters.

    Attributes:
        residual: r, (n, n_outputs), whitened. by_state: J. by_parameter: J_p, (n, n_outputs, p).
        defect: c, (n, n_states); row 0 is that of the initial state. defect_by_state: D without row 0, which is the unit matrix.
        defect_by_parameter: C, (n, n_states, p).
        variance: diagonal of Q, (n, n_states); row 0 infinite where the initial state is free.
    """

    residual: FloatArray
    by_state: BlockRows
    by_parameter: FloatArray
    defect: FloatArray
    defect_by_state: BlockRows
    defect_by_parameter: FloatArray
    variance: FloatArray


@dataclass(frozen=True)
class Eliminated:
    """States and multipliers as affine functions of dp: dx = x[..., 0] + x[..., 1:] dp, likewise the multipliers.

    `x` and `multiplier` are (n, n_states, 1 + p); `log_determinant` is log |det| of the matrix, nan if singular.
    """

    x: FloatArray
    multiplier: FloatArray
    log_determinant: float

    @property
    def singular(self) -> bool:
        """Whether the states could not be determined."""
        return not np.isfinite(self.log_determinant)


def eliminate(problem: Quadratic) -> Eliminated:
    """Solve for the states and multipliers, as affine functions of the parameter step."""
    n, n_states = problem.defect.shape
    weight = _balance(problem.by_state)
    band, width = _assemble(problem, weight)
    right = _right_hand_side(problem, weight)
    norm = float(np.abs(band).sum(axis=0).max())
    lu, pivots, info = lapack.dgbtrf(band, width, width, overwrite_ab=1)
    if info != 0 or lapack.dgbcon(width, width, lu, pivots, norm)[0] < _SINGULAR:
        return Eliminated(np.zeros(0), np.zeros(0), float("nan"))
    solution, _ = lapack.dgbtrs(lu, width, width, right, pivots, overwrite_b=1)
    if not np.all(np.isfinite(solution)):
        return Eliminated(np.zeros(0), np.zeros(0), float("nan"))
    stages = solution.reshape(n, 2, n_states, -1)
    log_determinant = float(np.sum(np.log(np.abs(lu[2 * width]))))
    return Eliminated(stages[:, 1], stages[:, 0] * weight, log_determinant)


def _balance(by_state: BlockRows) -> float:
    """Divides the objective, so that the blocks of the matrix are of one size."""
    blocks = by_state.blocks
    size = float(np.sum(blocks**2)) / (blocks.shape[0] * blocks.shape[3])
    return size if size > 0 else 1.0


def _assemble(problem: Quadratic, weight: float) -> tuple[FloatArray, int]:
    """Band storage of LAPACK for the matrix, the objective divided by `weight`, and the half bandwidth."""
    n, n_states = problem.defect.shape
    dynamics, outputs = problem.defect_by_state, problem.by_state
    span = outputs.blocks.shape[1] - 1
    reach = dynamics.offset + dynamics.blocks.shape[1]
    width = n_states * max(2 * (1 - dynamics.offset), 2 * (reach - 1), 2 * span + 1) - 1
    band = np.zeros((3 * width + 1, 2 * n_states * n), order="F")
    stage = np.arange(n)

    def add(row_stage: IntArray, row_part: int, column_stage: IntArray, column_part: int, blocks: FloatArray) -> None:
        inside = (row_stage >= 0) & (row_stage < n) & (column_stage >= 0) & (column_stage < n)
        rows = 2 * n_states * row_stage[inside] + row_part * n_states
        columns = 2 * n_states * column_stage[inside] + column_part * n_states
        for i in range(blocks.shape[1]):
            for j in range(blocks.shape[2]):
                band[2 * width + rows + i - columns - j, columns + j] += blocks[inside, i, j]

    free = np.isinf(problem.variance)
    diagonal = np.where(free, 1.0, -problem.variance * weight)
    unit = np.where(free[:1], 0.0, 1.0)[:, :, None] * np.eye(n_states)
    add(stage, 0, stage, 0, diagonal[:, :, None] * np.eye(n_states))
    add(stage[:1], 0, stage[:1], 1, unit)
    add(stage[:1], 1, stage[:1], 0, unit)
    for w in range(dynamics.blocks.shape[1]):
        at = stage[:-1] + dynamics.offset + w
        add(stage[1:], 0, at, 1, dynamics.blocks[:, w])
        add(at, 1, stage[1:], 0, dynamics.blocks[:, w].transpose(0, 2, 1))
    for v in range(span + 1):
        for w in range(span + 1):
            product = outputs.blocks[:, v].transpose(0, 2, 1) @ outputs.blocks[:, w]
            add(stage + outputs.offset + v, 1, stage + outputs.offset + w, 1, product / weight)
    return band, width


def _right_hand_side(problem: Quadratic, weight: float) -> FloatArray:
    n, n_states = problem.defect.shape
    outputs = problem.by_state
    columns = np.concatenate([problem.residual[:, :, None], problem.by_parameter], axis=2)
    right = np.zeros((n, 2, n_states, columns.shape[2]))
    right[:, 0, :, 0] = -problem.defect
    right[:, 0, :, 1:] = -problem.defect_by_parameter
    right[:, 0][np.isinf(problem.variance)] = 0.0
    for w in range(outputs.blocks.shape[1]):
        at = np.arange(n) + outputs.offset + w
        inside = (at >= 0) & (at < n)
        gradient = outputs.blocks[:, w].transpose(0, 2, 1) @ columns
        right[at[inside], 1] -= gradient[inside] / weight
    return np.asfortranarray(right.reshape(2 * n_states * n, -1))
