"""The quadratic problem of one segment, and the elimination of its states.

The linearised dynamics and outputs are sparse rows of blocks: neighbours in time, and delayed states by a few weights
a row. A Gauss-Newton step minimises 1/2 |r + J dx + J_p dp|^2 + 1/2 w' Q^-1 w subject to c + D dx + C
dp = w, for every dp at once. With multipliers l = Q^-1 w its stationary point solves

    [ J'J   D' ] [dx]     [J'r]   [J'J_p]
    [ D    -Q  ] [ l] = - [ c ] - [ C   ] dp

Output error is Q = 0, a constraint; filter error Q > 0. `solve_saddle` factors the matrix, ordered sample by sample
(stage k holds the multipliers of the constraint that ends at sample k, k = 0: the initial state, then the states of
sample k): its factors are sparse, and pivoting keeps it stable however fast the motion grows or decays. A delay fills
them, as far as the ordering of its columns cannot help it. Entrances: `eliminate`, `log_determinant`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from brv_hypo.arrays import BoolArray, FloatArray, IntArray
from brv_hypo.likelihood.statistics import Whitened

if TYPE_CHECKING:
    from scipy.sparse import csc_array, csr_array
    from scipy.sparse.linalg import SuperLU


def block_rows(blocks: FloatArray) -> csr_array[np.float64]:
    """The sparse matrix whose row k of `blocks` (rows, width, m, n_states) acts on states of samples k, k + 1, ..."""
    from scipy.sparse import bsr_array, csr_array  # here, for a cheap import of the package

    count, width, m, n_states = blocks.shape
    sample = np.arange(count)[:, None] + np.arange(width)
    shape = (count * m, (count + width - 1) * n_states)
    rows = bsr_array((blocks.reshape(-1, m, n_states), sample.ravel(), width * np.arange(count + 1)), shape=shape)
    found = csr_array(rows.tocsr())
    found.eliminate_zeros()
    return found


@dataclass(frozen=True)
class Quadratic:
    """The quadratic problem of one segment: n samples, p parameters that act in it."""

    own: IntArray  # places of those parameters among all, (p,)
    residual: FloatArray  # r, (n, n_outputs), whitened
    by_state: csr_array[np.float64]  # J, (n n_outputs, n n_states)
    by_parameter: FloatArray  # J_p, (n, n_outputs, p)
    defect: FloatArray  # c, (n, n_states); row 0 is that of the initial state
    defect_by_state: csr_array[np.float64]  # D without row 0, which is the unit matrix
    defect_by_parameter: FloatArray  # C, (n, n_states, p)
    variance: FloatArray  # diagonal of Q, (n, n_states); row 0 infinite where the initial state is free
    delayed: bool = False  # whether states act on samples further away than the next

    def direct(self) -> FloatArray:
        """[r J_p], (n, n_outputs, 1 + p)."""
        return np.concatenate([self.residual[:, :, None], self.by_parameter], axis=2)

    def moved(self, x: FloatArray) -> FloatArray:
        """[r J_p] + J x of states x, (n, n_states, 1 + p)."""
        direct = self.direct()
        return direct + (self.by_state @ x.reshape(self.by_state.shape[1], -1)).reshape(direct.shape)

    def defects(self) -> FloatArray:
        """[c C], (n, n_states, 1 + p); zero where the initial state is free."""
        found = np.concatenate([self.defect[:, :, None], self.defect_by_parameter], axis=2)
        found[np.isinf(self.variance)] = 0.0
        return found


def upper_triangle(rows: FloatArray) -> FloatArray:
    """R of a matrix, (columns, columns), of fewer rows too."""
    columns = rows.shape[1]
    padded = np.concatenate([rows, np.zeros((columns, columns))])
    return np.asarray(np.linalg.qr(padded, mode="r"))


def _residual_last(columns: FloatArray) -> FloatArray:
    """(n, m, 1 + p) with the constant part first, as rows (n m, p + 1) with it last."""
    rows = columns.reshape(-1, columns.shape[2])
    return np.concatenate([rows[:, 1:], rows[:, :1]], axis=1)


# ---- The states as affine functions of the parameter step ----


_SINGULAR = 1e13  # condition, from the growth of a random right-hand side, at which states count as undetermined
_FOLLOWED = 1e-7  # a parameter whose sensitivity shrinks by this factor as the states follow it is not in the data


@dataclass(frozen=True)
class Eliminated:
    """One segment with its states as affine functions of the step dp of its own parameters: all by 1 and dp."""

    problem: Quadratic
    x: FloatArray  # change of the states, (n, n_states, 1 + p)
    multiplier: FloatArray  # of the dynamics, (n, n_states, 1 + p); row 0 is the initial state's
    triangle: FloatArray  # that of residuals and whitened process noise, constant part last, (1 + p, 1 + p)
    void: BoolArray  # the parameters that the states can follow entirely, (p,): only rounding is left, and set to zero
    log_det: float  # see `log_determinant`

    def whitened(self, sampled: slice) -> Whitened:
        """r + J dx + J_p dp at some of the samples."""
        found = self.problem.moved(self.x)[sampled]
        by_parameter = found[:, :, 1:]
        by_parameter[:, :, self.void] = 0.0
        return Whitened(self.problem.own, found[:, :, 0], by_parameter)


Segments = tuple[Eliminated, ...]


def eliminate(problem: Quadratic) -> Eliminated | None:
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
    pull = np.asarray(problem.by_state.T @ direct.reshape(-1, direct.shape[2]))
    right[:, 1, :, :-1] = -pull.reshape(n, m, -1) / weight
    probe = np.random.default_rng(0).standard_normal((n, 2, m))
    right[..., -1] = probe
    solution = np.asarray(factor.solve(right.reshape(2 * n * m, -1))).reshape(right.shape)
    growth = float(np.linalg.norm(solution[..., -1]) / np.linalg.norm(probe))
    norm = float(abs(matrix).sum(axis=0).max())
    if not growth * norm < _SINGULAR or not np.all(np.isfinite(solution)):
        return None
    multiplier, x = solution[:, 0, :, :-1] * weight, solution[:, 1, :, :-1]
    residuals = problem.moved(x)
    noise = np.sqrt(np.where(np.isfinite(problem.variance), problem.variance, 0.0))[:, :, None] * multiplier
    rows = [_residual_last(residuals), *([_residual_last(noise)] if np.any(noise) else [])]
    triangle = upper_triangle(np.concatenate(rows))
    by_parameter = problem.by_parameter
    left = np.sum(triangle[:, :-1] ** 2, axis=0)
    void = left <= _FOLLOWED**2 * np.einsum("nap,nap->p", by_parameter, by_parameter)
    triangle[:, :-1][:, void] = 0.0
    return Eliminated(problem, x, multiplier, triangle, void, _log_det(factor, problem, weight))


def log_determinant(problem: Quadratic) -> float:
    """log |det| of the matrix without the rows of free initial states' multipliers; nan where it is singular."""
    weight = _balance(problem.by_state)
    factor = _factored(_saddle_matrix(problem, weight), problem)
    return float("nan") if factor is None else _log_det(factor, problem, weight)


def _log_det(factor: SuperLU, problem: Quadratic, weight: float) -> float:
    free = np.count_nonzero(np.isinf(problem.variance[0]))
    return float(np.sum(np.log(np.abs(factor.U.diagonal()))) + free * np.log(weight))


def _balance(by_state: csr_array[np.float64]) -> float:
    """Divides the objective, so that the blocks of the matrix are of one size."""
    size = float(np.sum(by_state.data**2)) / by_state.shape[1]
    return size if size > 0 else 1.0


def _saddle_matrix(problem: Quadratic, weight: float) -> csc_array[np.float64]:
    """The matrix in the order of stages, the objective divided by `weight`."""
    from scipy.sparse import block_array, csc_array, csr_array, diags_array, vstack

    n, m = problem.defect.shape
    free = np.isinf(problem.variance)
    start = diags_array(np.where(free[0], 0.0, 1.0), shape=(m, n * m))
    dynamics: csr_array[np.float64] = csr_array(vstack([start, problem.defect_by_state]))
    outputs = problem.by_state
    noise = diags_array(np.where(free, 1.0, -problem.variance * weight).ravel())
    whole = block_array([[noise, dynamics], [dynamics.T, (outputs.T @ outputs) / weight]], format="coo")
    place = np.arange(2 * n * m).reshape(n, 2, m).transpose(1, 0, 2).ravel()
    data: FloatArray = np.asarray(whole.data, dtype=float)
    return csc_array((data, (place[whole.row], place[whole.col])), shape=whole.shape)


def _factored(matrix: csc_array[np.float64], problem: Quadratic) -> SuperLU | None:
    """None where it is exactly singular, or not finite."""
    from scipy.sparse.linalg import splu

    ordering: Literal["COLAMD", "NATURAL"] = "COLAMD" if problem.delayed else "NATURAL"
    if not np.all(np.isfinite(matrix.data)):
        return None
    try:
        return splu(matrix, permc_spec=ordering, diag_pivot_thresh=1.0, options={"Equil": False})
    except RuntimeError:
        return None
