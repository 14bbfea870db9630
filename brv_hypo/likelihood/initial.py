"""How well the initial state of each segment is known, and what the outputs make of it.

With the initial state a held and made a parameter beside theta, its information given theta is M = S_a' S_a, S_a
the whitened sensitivities of outputs and process noise, the other states following. Then

    cov a = M^-1 + F (cov theta) F',    F = da / dtheta as the fit lets it follow.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from brv_hypo.arrays import FloatArray, IntArray
from brv_hypo.likelihood.elimination import eliminate
from brv_hypo.likelihood.leave_out import Linearised, LinearRows
from brv_hypo.likelihood.step import Iterate, Problem, Sensitivity
from brv_hypo.likelihood.uncertainty import covariance_from_information

Starts = tuple[tuple[FloatArray, FloatArray] | None, ...]
"""For each segment, derivatives of the whitened outputs (n, n_outputs, n_states) and process noise (n, n_states,
n_states) by the scaled initial state, the other states following; None where they are not determined."""


def by_initial_states(problem: Problem, segments: Sequence[Sensitivity]) -> Starts:
    """What the initial states do, theta held."""
    return tuple(_by_initial_state(problem, segment) for segment in segments)


def initial_state_errors(
    problem: Problem,
    starts: Starts,
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
        given_theta = taken_out * _variance_given_theta(problem, starts[s], s)
        follow = segments[s].eliminated.at_start()[:, 1:] * problem.size[:, None]
        moved = np.isfinite(np.diag(covariance)[index])
        block = covariance[np.ix_(index[moved], index[moved])]
        by_theta = np.einsum("ip,pq,iq->i", follow[:, moved], block, follow[:, moved])
        variance = given_theta + by_theta
        found.append(np.sqrt(np.where(variance >= 0.0, variance, np.nan)))
    return tuple(found)


def linearised(
    problem: Problem,
    iterate: Iterate,
    starts: Starts,
    residual: Sequence[FloatArray],
    estimated: IntArray,
) -> Linearised | None:
    """The linear model at the solution from each segment's `Sensitivity.residual`, none where the states are not
    determined; None also with process noise, which couples what is left out to the rest.
    """
    if not residual or np.any(problem.process_noise):
        return None
    rows = []
    for s, grid in enumerate(problem.grids):
        by_start = starts[s]
        if by_start is None:
            return None
        free = grid.start_std > 0.0
        rows.append(
            LinearRows(
                residual=residual[s][:, :, 0],
                by_parameter=residual[s][:, :, 1:],
                by_start=by_start[0][:, :, free],
                index=problem.parameters.segment_index[s],
                known=problem.size[free] / grid.start_std[free],
                strayed=(iterate.x[s][free, 0] - grid.first[free]) / grid.start_std[free],
            )
        )
    parameters = problem.parameters
    informed = np.isfinite(parameters.prior_std)
    precision = np.where(informed, 1.0 / parameters.prior_std**2, 0.0)
    away = np.where(informed, iterate.theta - parameters.prior_mean, 0.0)
    return Linearised(tuple(rows), precision, away, estimated)


def _variance_given_theta(
    problem: Problem, found: tuple[FloatArray, FloatArray] | None, number: int
) -> FloatArray:
    """Diagonal of M^-1, (n_states,), with what was known of the initial state before."""
    grid, size = problem.grids[number], problem.size
    if found is None:
        return np.full(size.size, np.nan)
    rows = np.concatenate([part.reshape(-1, size.size) for part in found])
    known = grid.start_std / size
    estimated = np.flatnonzero(known > 0.0)
    before = np.where(known > 0.0, known, np.inf)
    triangle = np.asarray(np.linalg.qr(rows, mode="r"))
    given = covariance_from_information(triangle, before, estimated)
    return np.where(known > 0.0, np.diag(given), 0.0) * size**2


def _by_initial_state(problem: Problem, segment: Sensitivity) -> tuple[FloatArray, FloatArray] | None:
    free = segment.eliminated.problem
    size = problem.size.size
    by_start = np.zeros((*free.defect.shape, size))
    by_start[0] = -np.eye(size)
    variance = free.variance.copy()
    variance[0] = 0.0
    held = replace(
        free,
        by_parameter=np.zeros((*free.residual.shape, size)),
        defect_by_parameter=by_start,
        variance=variance,
    )
    eliminated = eliminate(held)
    if eliminated is None:
        return None
    outputs, noise = eliminated.rows()
    disturbance = np.zeros((*free.defect.shape, size)) if noise is None else noise[:, :, 1:]
    return outputs[:, :, 1:], disturbance
