"""Eliminates the states of a segment whose dynamics are exact and look far back: sparse forward substitution.

A delay couples every sample to some far earlier ones. The band of the optimality conditions then spans the
delay twice and fills, although few of its entries are not zero. With exact dynamics (Q = 0)

    dx = s + S dp + E w,    D (s, S, E) = -(c, C, -I_0)

where w are the free parts of the initial state: D alone is factored, which its order in time leaves nearly as
sparse as it is, and w follows by least squares. Recursion in time loses as many digits as the motion grows
by; where that is too many there is no answer, and the band remains.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.likelihood.collocation import BlockRows
from brv_hypo.likelihood.quadratic import Eliminated, Quadratic

if TYPE_CHECKING:
    from scipy.sparse import csc_array

_GROWTH = 1e7
"""Growth of the motion over a segment from which recursion in time is not believed."""
_SEEN = 1e-8
"""Singular value of what the outputs see of the initial state, against the largest, below which it is unseen."""


def condense(problem: Quadratic) -> Eliminated | None:
    """States and multipliers as affine functions of the parameter step; None where recursion is no way."""
    from scipy.sparse.linalg import splu  # here, for a cheap import of the package

    n, n_states = problem.defect.shape
    free = problem.variance[0] > 0.0
    start = np.eye(n_states)[:, free]
    right = np.concatenate([-problem.defect[:, :, None], -problem.defect_by_parameter], axis=2)
    right[0, np.isinf(problem.variance[0])] = 0.0
    unit = np.zeros((n, n_states, start.shape[1]))
    unit[0] = start
    columns = np.concatenate([right, unit], axis=2).reshape(n * n_states, -1)
    try:
        factor = splu(
            _matrix(problem.defect_by_state, n, n_states),
            permc_spec="NATURAL",
            diag_pivot_thresh=0.0,
        )
    except RuntimeError:  # exactly singular
        return None
    paths = np.asarray(factor.solve(columns), dtype=float).reshape(n, n_states, -1)
    if not np.all(np.isfinite(paths)) or np.abs(paths[:, :, right.shape[2] :]).max(initial=0.0) > _GROWTH:
        return None
    count, known = right.shape[2], paths.reshape(n * n_states, -1)
    outputs = problem.by_state.matrix(n)
    direct = np.concatenate([problem.residual[:, :, None], problem.by_parameter], axis=2)
    seen = np.asarray(outputs @ known)
    seen[:, :count] += direct.reshape(seen.shape[0], -1)
    follow = _initial_state(seen[:, :count], seen[:, count:], problem.variance[0, free])
    if follow is None:
        return None
    x = (known[:, :count] + known[:, count:] @ follow).reshape(n, n_states, -1)
    residual = seen[:, :count] + seen[:, count:] @ follow
    transposed = factor.solve(-(outputs.T @ residual), trans="T")  # type: ignore[call-overload] # the stubs lack it
    multiplier = np.array(transposed, dtype=np.float64).reshape(n, n_states, -1)
    multiplier[0, np.isinf(problem.variance[0])] = 0.0
    shape = problem.residual.shape
    return Eliminated(
        np.asarray(x), multiplier, residual.reshape(*shape, -1), seen[:, count:].reshape(*shape, -1)
    )


def _matrix(rows: BlockRows, n: int, n_states: int) -> csc_array[np.float64]:
    """D with the unit matrix of the initial state as its first rows, in compressed columns."""
    from scipy.sparse import eye_array, vstack

    return vstack([eye_array(n_states, n * n_states), rows.matrix(n)], format="csc")


def _initial_state(rest: FloatArray, unit: FloatArray, variance: FloatArray) -> FloatArray | None:
    """The free parts of the initial state (free, 1 + p) that the outputs ask for, and what was known of it.

    `rest` are the residuals without them, `unit` what the outputs see of each, `variance` (free,) the prior.
    """
    count = unit.shape[1]
    if count == 0:
        return np.zeros((0, rest.shape[1]))
    matrix = np.concatenate([unit, np.diag(1.0 / np.sqrt(variance))])
    right = np.concatenate([rest, np.zeros((count, rest.shape[1]))])
    norm = np.linalg.norm(matrix, axis=0)
    if not np.all(norm > 0.0):
        return None
    left, singular, rotation = np.linalg.svd(matrix / norm, full_matrices=False)
    if singular[-1] < _SEEN * singular[0]:
        return None
    return np.asarray(-(rotation.T @ ((left.T @ right) / singular[:, None])) / norm[:, None])
