"""Filter error: process noise means that the states are integrated out, not only fitted.

With Q > 0 the least-squares states are the smoothed ones, and the likelihood of theta is theirs times a
determinant. For linear dynamics, and to the order of Laplace's approximation otherwise,

    NLLF = objective + 1/2 log|det K(Q)| - 1/2 log|det K(0)| + 1/2 sum log det R

with K the matrix of `band` and the initial state held. The last determinant is that of the dynamics
alone: the square of that of D, which without delays is block triangular. At Q = 0 the two cancel and output
error remains. Q and R are found in `scoring`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.likelihood.band import log_determinant
from brv_hypo.likelihood.collocation import Linearisation, evaluate_segment, linearise_segment
from brv_hypo.likelihood.quadratic import Quadratic
from brv_hypo.likelihood.step import Iterate, Problem, Sensitivity, information_factor, quadratic_of

_STEP = 1e-2
"""Central difference in standard errors of a parameter."""


def determinant_term(problem: Problem, iterate: Iterate) -> float:
    """What integrating the states out adds to the objective; 0 for output error."""
    if not np.any(problem.process_noise):
        return 0.0
    linear = linearised_states(problem, iterate)
    exact = sum(2.0 * float(np.linalg.slogdet(each.defect_by_state.blocks[:, 1])[1].sum()) for each in linear)
    return 0.5 * (_determinant(_held(problem, iterate, linear)) - exact)


def disturbance_cost(problem: Problem, iterate: Iterate) -> float:
    """Half the weighted sum of squares of the process noise."""
    return 0.5 * float(np.sum(_disturbance_squares(problem, iterate)))


def determinant_gradient(problem: Problem, iterate: Iterate, segments: Sequence[Sensitivity]) -> FloatArray:
    """Its derivative by theta, (p,), the states following."""
    parameters = problem.parameters
    p = len(parameters.names)
    norm = np.linalg.norm(information_factor(problem, segments)[:, :p], axis=0)
    gradient = np.zeros(p)
    for i in np.flatnonzero(norm > 0).tolist():
        step = _STEP / norm[i]
        ends = [
            determinant_term(problem, _displaced(problem, iterate, segments, i, sign * step))
            for sign in (1, -1)
        ]
        gradient[i] = (ends[0] - ends[1]) / (2 * step)
    return gradient


def _disturbance_squares(problem: Problem, iterate: Iterate) -> FloatArray:
    """Sum of squares of each state's process noise over its variance, (n_states,); 0 where there is none."""
    total = np.zeros_like(problem.process_noise)
    driven = problem.process_noise > 0
    for s, (grid, x) in enumerate(zip(problem.grids, iterate.x, strict=True)):
        defect, _ = evaluate_segment(problem.model, grid, x, problem.parameters.of_segment(s, iterate.theta))
        squares = np.sum(defect**2 / grid.step[:, None], axis=0)
        total[driven] += squares[driven] / problem.process_noise[driven] ** 2
    return total


def _determinant(held: Sequence[Quadratic]) -> float:
    """log|det K| over all segments."""
    return float(sum(log_determinant(q) for q in held))


def linearised_states(problem: Problem, iterate: Iterate) -> list[Linearisation]:
    """Every segment about its states, without derivatives by theta."""
    return [
        linearise_segment(problem.model, grid, x, problem.parameters.of_segment(s, iterate.theta), ())
        for s, (grid, x) in enumerate(zip(problem.grids, iterate.x, strict=True))
    ]


def _held(problem: Problem, iterate: Iterate, linear: Sequence[Linearisation]) -> list[Quadratic]:
    """The quadratic problem of every segment, its initial state held."""
    found = []
    for grid, x, linearisation in zip(problem.grids, iterate.x, linear, strict=True):
        quadratic = quadratic_of(problem, grid, x, [(slice(None), linearisation)], iterate.covariance)
        variance = quadratic.variance.copy()
        variance[0] = 0.0
        found.append(replace(quadratic, variance=variance))
    return found


def _displaced(
    problem: Problem, iterate: Iterate, segments: Sequence[Sensitivity], parameter: int, step: float
) -> Iterate:
    """The iterate with one parameter moved and the states following."""
    theta = iterate.theta.copy()
    theta[parameter] += step
    states = []
    for x, segment, index in zip(iterate.x, segments, problem.parameters.segment_index, strict=True):
        direction = np.concatenate([[0.0], (index == parameter).astype(float)])
        follow = segment.eliminated.states(direction).T * problem.size[:, None]
        states.append(x + step * follow)
    return replace(iterate, theta=theta, x=tuple(states))


@dataclass(frozen=True)
class Filtered:
    """One-step predictions of a segment.

    `innovations` (n_outputs, n), nan in gaps, their `covariance` (n, n_outputs, n_outputs), and the NLLF of
    Eq. 3.10 (E8).
    """

    innovations: FloatArray
    covariance: FloatArray
    nllf: float


def kalman_innovations(problem: Problem, iterate: Iterate) -> tuple[Filtered, ...]:
    """Innovations of the Kalman filter about the smoothed states, from the estimated initial state on."""
    found = []
    for grid, linear in zip(problem.grids, linearised_states(problem, iterate), strict=True):
        after = np.linalg.inv(linear.defect_by_state.blocks[:, 1])
        transition = -after @ linear.defect_by_state.blocks[:, 0]
        shift = -(after @ linear.defect[:, :, None])[:, :, 0]
        drive = problem.process_noise**2 * grid.step[:, None]
        driven = (after * drive[:, None, :]) @ after.transpose(0, 2, 1)
        residual = grid.y.T - linear.output
        observe = linear.output_by_state.blocks[:, 0]
        found.append(_filter(transition, shift, driven, residual, observe, iterate.covariance))
    return tuple(found)


def _filter(
    transition: FloatArray,
    shift: FloatArray,
    driven: FloatArray,
    residual: FloatArray,
    observe: FloatArray,
    noise: FloatArray,
) -> Filtered:
    n, n_outputs = residual.shape
    n_states = transition.shape[1]
    mean, spread = np.zeros(n_states), np.zeros((n_states, n_states))
    innovations = np.full((n, n_outputs), np.nan)
    covariance = np.empty((n, n_outputs, n_outputs))
    total = 0.0
    for k in range(n):
        if k > 0:
            mean = transition[k - 1] @ mean + shift[k - 1]
            spread = transition[k - 1] @ spread @ transition[k - 1].T + driven[k - 1]
        h = observe[k]
        covariance[k] = h @ spread @ h.T + noise
        innovations[k] = residual[k] - h @ mean
        seen = np.isfinite(innovations[k])
        if not seen.any():
            continue
        b, v, h = covariance[k][np.ix_(seen, seen)], innovations[k][seen], h[seen]
        gain = np.linalg.solve(b, h @ spread).T
        mean = mean + gain @ v
        keep = np.eye(n_states) - gain @ h
        spread = keep @ spread @ keep.T + gain @ noise[np.ix_(seen, seen)] @ gain.T
        total += 0.5 * float(v @ np.linalg.solve(b, v) + np.linalg.slogdet(b)[1])
    return Filtered(innovations.T, covariance, total)
