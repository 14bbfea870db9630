"""How well the initial state of each segment is known.

With the initial state a held and made a parameter beside theta, its information given theta is M = S_a' S_a, S_a
the whitened sensitivities of outputs and process noise, the other states following. Then

    cov a = M^-1 + F (cov theta) F',    F = da / dtheta as the fit lets it follow.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.likelihood.elimination import eliminate
from brv_hypo.likelihood.noise import whitening
from brv_hypo.likelihood.step import Iterate, Problem, Sensitivity, quadratic_of
from brv_hypo.likelihood.uncertainty import covariance_from_information


def initial_state_errors(
    problem: Problem,
    iterate: Iterate,
    segments: Sequence[Sensitivity],
    covariance: FloatArray,
    taken_out: float,
) -> tuple[FloatArray, ...]:
    """Standard errors of the initial states, (n_states,) a segment; 0 where one is held, nan where not determined.

    `covariance` (p, p) of theta, nan for parameters that the fit could not move; `taken_out` multiplies the
    variance given theta; `covariance` contains it.
    """
    if not segments:
        return tuple(np.full(grid.start.shape[0], np.nan) for grid in problem.grids)
    found = []
    for s, index in enumerate(problem.parameters.segment_index):
        given_theta = taken_out * _variance_given_theta(problem, iterate, segments[s], s)
        follow = segments[s].eliminated.x[0, :, 1:] * problem.size[:, None]
        moved = np.isfinite(np.diag(covariance)[index])
        block = covariance[np.ix_(index[moved], index[moved])]
        by_theta = np.einsum("ip,pq,iq->i", follow[:, moved], block, follow[:, moved])
        found.append(np.sqrt(given_theta + by_theta))
    return tuple(found)


def _variance_given_theta(
    problem: Problem, iterate: Iterate, segment: Sensitivity, number: int
) -> FloatArray:
    """Diagonal of M^-1, (n_states,), with what was known of the initial state before."""
    grid, x, size = problem.grids[number], iterate.x[number], problem.size
    whitener = whitening(iterate.covariance, grid.measured)
    free = quadratic_of(problem, grid, x, segment.linearisation, whitener)
    by_start = np.zeros((*free.defect.shape, size.size))
    by_start[0] = -np.eye(size.size)
    variance = free.variance.copy()
    variance[0] = 0.0
    held = replace(
        free,
        by_parameter=np.zeros((*free.residual.shape, size.size)),
        defect_by_parameter=by_start,
        variance=variance,
    )
    eliminated = eliminate(held)
    if eliminated is None:
        return np.full(size.size, np.nan)
    outputs = held.by_state.dot(eliminated.x)[:, :, 1:]
    disturbance = np.sqrt(variance)[:, :, None] * eliminated.multiplier[:, :, 1:]
    rows = np.concatenate([part.reshape(-1, size.size) for part in (outputs, disturbance)])
    known = grid.start_std / size
    estimated = np.flatnonzero(known > 0.0)
    before = np.where(known > 0.0, known, np.inf)
    triangle = np.asarray(np.linalg.qr(rows, mode="r"))
    given = covariance_from_information(triangle, before, estimated)
    return np.where(known > 0.0, np.diag(given), 0.0) * size**2
