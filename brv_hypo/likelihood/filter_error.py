"""Filter error: with process noise the states are integrated out, not only fitted.

With Q > 0 the least-squares states are the smoothed ones, and the likelihood of theta is theirs times a determinant.
For linear dynamics, and to the order of Laplace's approximation otherwise,

    NLLF = objective + 1/2 sum over samples of log det S - log det R

with S the innovations' covariance of a Kalman filter about the smoothed states, the initial state held (Schweppe, IEEE
Trans. Information Theory 11 (1965) 61). At Q = 0 the sum vanishes and output error remains. `Determinant` is that sum
with its gradient; `Marginal` is a linearised segment with its states integrated out for any variances of both noises.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.likelihood.collocation import Weights, evaluate_segment, linearise_segment, weighted_change
from brv_hypo.likelihood.elimination import Quadratic, log_determinant, solve_saddle
from brv_hypo.likelihood.gauss_newton import Iterate, Parts, Problem, Sensitivity, quadratic_of, sensitivity_of
from brv_hypo.likelihood.noise import log_determinants, whitening
from brv_hypo.likelihood.segment import Grid

if TYPE_CHECKING:
    from brv_hypo.likelihood.compiled import Filter


_FAR = 1e-3
"""Way in standard errors over which the gradient is held. It turns with the logarithm of the information, so that the
estimate is off by that way over the root of the samples.
"""


class Determinant:
    """What integrating the states out adds to the objective; knows the filter's run where it was asked for last, and
    the gradient from near by.
    """

    def __init__(self) -> None:
        self._last: tuple[Problem, Iterate, list[_Run]] | None = None
        self._moves: tuple[Iterate, list[_Motion]] | None = None
        self._gradient: FloatArray | None = None
        self._way = 0.0

    def moved(self, length: float) -> None:
        """The search takes a step of this length, in standard errors."""
        self._way += length

    def term(self, problem: Problem, iterate: Iterate) -> float:
        """It; 0 for output error."""
        if not np.any(problem.process_noise):
            return 0.0
        return sum(
            run.filter.log_det - 0.5 * log_determinants(grid.measured, iterate.covariance)
            for run, grid in zip(self._runs(problem, iterate), problem.grids, strict=True)
        )

    def gradient(self, problem: Problem, iterate: Iterate, segments: Sequence[Sensitivity]) -> FloatArray:
        """Its derivative by theta, (p,), the states following."""
        if self._gradient is None or self._way > _FAR:
            weights = [run.determinant_weights() for run in self._runs(problem, iterate)]
            self._gradient, self._way = _by_theta(problem, iterate, segments, weights)[0], 0.0
        return self._gradient

    def _runs(self, problem: Problem, iterate: Iterate) -> list[_Run]:
        if self._last is None or self._last[0] is not problem or self._last[1] is not iterate:
            motions = self._motions(problem, iterate)
            self._last = problem, iterate, [m.run(problem.process_noise, iterate.covariance) for m in motions]
        return self._last[2]

    def _motions(self, problem: Problem, iterate: Iterate) -> list[_Motion]:
        """They do not change as the variances do."""
        known = self._moves
        if known is None or known[0].x is not iterate.x or known[0].theta is not iterate.theta:
            known = iterate, [_motion(problem, iterate, s) for s in range(len(problem.grids))]
            self._moves = known
        return known[1]


def disturbance_cost(problem: Problem, iterate: Iterate) -> float:
    """Half the weighted sum of squares of the process noise."""
    total = np.zeros_like(problem.process_noise)
    driven = problem.process_noise > 0
    for grid, x in zip(problem.grids, iterate.x, strict=True):
        defect, _ = evaluate_segment(problem.model, grid, x, problem.parameters.as_mapping(iterate.theta))
        squares = np.sum(defect**2 / grid.step[:, None], axis=0)
        total[driven] += squares[driven] / problem.process_noise[driven] ** 2
    return 0.5 * float(np.sum(total))


def kalman_innovations(problem: Problem, iterate: Iterate) -> tuple[tuple[FloatArray, ...], float]:
    """Innovations of the Kalman filter about the smoothed states, from the estimated initial state on, and their NLLF.

    By segment, (n_outputs, n), nan in gaps; the NLLF of Eq. 3.10 (E8).
    """
    noises = problem.process_noise, iterate.covariance
    runs = [_motion(problem, iterate, s).run(*noises).filter for s in range(len(problem.grids))]
    return tuple(run.innovation.T for run in runs), sum(run.log_det + run.squares for run in runs)


def gradients_elsewhere(
    problem: Problem,
    iterate: Iterate,
    segments: Sequence[Sensitivity],
    process_noise: FloatArray,
    covariance: FloatArray,
) -> FloatArray:
    """The determinant's derivatives by theta with other variances, process noises (k, n_states) and covariances (k,
    n_outputs, n_outputs): (k, p).
    """
    weights = []
    for s in range(len(problem.grids)):
        motion = _motion(problem, iterate, s)
        each = [motion.run(q, r).determinant_weights() for q, r in zip(process_noise, covariance, strict=True)]
        weights.append(Weights(*(np.concatenate(part) for part in zip(*each, strict=True))))
    return _by_theta(problem, iterate, segments, weights)


def _by_theta(
    problem: Problem, iterate: Iterate, segments: Sequence[Sensitivity], weights: Sequence[Weights]
) -> FloatArray:
    """Derivatives of weighted sums (k) by theta, the states following, (k, p)."""
    parameters = problem.parameters
    gradient = np.zeros((len(weights[0].before), len(parameters.names)))
    for s, (segment, weight) in enumerate(zip(segments, weights, strict=True)):
        theta = parameters.as_mapping(iterate.theta)
        by_state, by_theta = weighted_change(
            problem.model, problem.grids[s], iterate.x[s], theta, parameters.names, weight
        )
        gradient += by_theta
        for parameter in np.flatnonzero(~segment.void).tolist():
            direction = np.eye(1, 1 + len(parameters.names), 1 + parameter)[0]
            follow = segment.eliminated.states(direction) * problem.size
            gradient[:, parameter] += np.tensordot(by_state, follow, 2)
    return gradient


@dataclass(frozen=True)
class _Motion:
    """A segment as a filter takes it."""

    inverse: FloatArray
    """That of the defects' derivatives by the state after, (n - 1, n_states, n_states)."""
    transition: FloatArray
    """From state to state, (n - 1, n_states, n_states)."""
    shift: FloatArray
    """What the dynamics add to the states, (n - 1, n_states)."""
    step: FloatArray
    """Lengths of the intervals, (n - 1,), s."""
    residual: FloatArray
    """Measured less predicted outputs, (n, n_outputs), nan in gaps."""
    observe: FloatArray
    """The outputs' derivatives by the states, (n, n_outputs, n_states)."""

    def run(self, process_noise: FloatArray, covariance: FloatArray) -> _Run:
        """The filter's, with these variances."""
        from brv_hypo.likelihood.compiled import filtered  # here: numba takes long to load

        drive = process_noise**2 * self.step[:, None]
        driven = (self.inverse * drive[:, None, :]) @ self.inverse.transpose(0, 2, 1)
        found = filtered(self.transition, self.shift, driven, self.residual, self.observe, covariance)
        return _Run(self, driven, found)


@dataclass(frozen=True)
class _Run:
    """A filter's run over a segment, `driven` (n - 1, n_states, n_states) by process noise."""

    motion: _Motion
    driven: FloatArray
    filter: Filter

    def determinant_weights(self) -> Weights:
        """Derivatives of half the sum of log det S by those of defects and outputs by states, one set."""
        from brv_hypo.likelihood.compiled import determinant_derivatives

        motion = self.motion
        by_transition, by_driven, by_observe = determinant_derivatives(
            self.filter, motion.transition, self.driven, motion.observe
        )
        turned = -motion.inverse.transpose(0, 2, 1)
        through = by_transition @ motion.transition.transpose(0, 2, 1) + 2.0 * by_driven @ self.driven
        return Weights((turned @ by_transition)[None], (turned @ through)[None], by_observe[None])


def _motion(problem: Problem, iterate: Iterate, s: int) -> _Motion:
    grid = problem.grids[s]
    linear = linearise_segment(problem.model, grid, iterate.x[s], problem.parameters.as_mapping(iterate.theta), ())
    before, after = linear.defect_by_state.blocks[:, 0], linear.defect_by_state.blocks[:, 1]
    inverse = np.asarray(np.linalg.inv(after), dtype=float)
    return _Motion(
        inverse=inverse,
        transition=np.asarray(-inverse @ before),
        shift=-(inverse @ linear.defect[:, :, None])[:, :, 0],
        step=grid.step,
        residual=np.where(grid.measured.T, grid.y.T - linear.output, np.nan),
        observe=np.ascontiguousarray(linear.output_by_state.blocks[:, 0]),
    )


# ---- A linearised segment whose states are integrated out, for any variances of both noises ----


@dataclass(frozen=True)
class Integrated(Sensitivity):
    """With the states best for some variances: what is left, then derivatives by the segment's parameters."""

    outputs: FloatArray
    """(n, n_outputs, 1 + p), whitened."""
    noise: FloatArray
    """Process noise (n, n_states, 1 + p), whitened, the initial state's row first."""
    log_det: float
    """That of `Marginal.log_det`."""


@dataclass(frozen=True)
class Marginal:
    """A segment about states x, (n_states, n), linearised part by part."""

    problem: Problem
    grid: Grid
    x: FloatArray
    parts: Parts

    def log_det(self, process_noise: FloatArray, covariance: FloatArray) -> float:
        """log det of the outputs' covariance, initial states that are free integrated out, but for a constant.

        Of variances of the process noise, (n_states,) per root second, and of the measurement noise.
        """
        return self._of_noise(covariance) + log_determinant(self._quadratic(process_noise, covariance))

    def integrated(self, process_noise: FloatArray, covariance: FloatArray) -> Integrated | None:
        """The states eliminated; None where they are not determined."""
        solution = solve_saddle(self._quadratic(process_noise, covariance))
        if solution is None:
            return None
        found = sensitivity_of(solution)
        return Integrated(
            eliminated=solution,
            triangle=found.triangle,
            void=found.void,
            outputs=solution.residuals(),
            noise=solution.noise(),
            log_det=self._of_noise(covariance) + solution.log_det,
        )

    def weighed(self, rows: FloatArray, covariance: FloatArray) -> FloatArray:
        """Whitened rows (n, n_outputs, k) times the transposed whitener: R^-1 of what they were before."""
        return np.asarray(whitening(covariance, self.grid.measured).transpose(0, 2, 1) @ rows)

    def _quadratic(self, process_noise: FloatArray, covariance: FloatArray) -> Quadratic:
        problem = replace(self.problem, process_noise=process_noise)
        return quadratic_of(problem, self.grid, self.x, self.parts, covariance)

    def _of_noise(self, covariance: FloatArray) -> float:
        """log det of the measurement noise of all samples."""
        return log_determinants(self.grid.measured, covariance)
