"""Filter error: process noise means that the states are integrated out, not only fitted.

With Q > 0 the least-squares states are the smoothed ones, and the likelihood of theta is theirs times a
determinant. For linear dynamics, and to the order of Laplace's approximation otherwise,

    NLLF = objective + 1/2 sum over samples of log det S - log det R

with S the covariance of the innovations of a Kalman filter about the smoothed states, the initial state held (Schweppe,
IEEE Trans. Information Theory 11 (1965) 61). At Q = 0 the sum vanishes and output error remains. Q and R are found in
`scoring`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.likelihood.collocation import Weights, evaluate_segment, linearise_segment, weighted_change
from brv_hypo.likelihood.noise import log_determinants
from brv_hypo.likelihood.step import Iterate, Problem, Sensitivity

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
            self._gradient, self._way = self._gradient_at(problem, iterate, segments), 0.0
        return self._gradient

    def _gradient_at(self, problem: Problem, iterate: Iterate, segments: Sequence[Sensitivity]) -> FloatArray:
        parameters = problem.parameters
        gradient = np.zeros(len(parameters.names))
        for s, (run, segment) in enumerate(zip(self._runs(problem, iterate), segments, strict=True)):
            theta, index = parameters.of_segment(s, iterate.theta), parameters.segment_index[s]
            by_state, by_theta = weighted_change(
                problem.model, problem.grids[s], iterate.x[s], theta, parameters.base, run.determinant_weights()
            )
            gradient[index] += by_theta
            for parameter in np.flatnonzero(~segment.void).tolist():
                direction = np.zeros(1 + index.size)
                direction[1 + parameter] = 1.0
                follow = segment.eliminated.states(direction) * problem.size
                gradient[index[parameter]] += float(np.sum(by_state * follow))
        return gradient

    def _runs(self, problem: Problem, iterate: Iterate) -> list[_Run]:
        if self._last is None or self._last[0] is not problem or self._last[1] is not iterate:
            self._last = problem, iterate, [_filtered(problem, iterate, s) for s in range(len(problem.grids))]
        return self._last[2]


def disturbance_cost(problem: Problem, iterate: Iterate) -> float:
    """Half the weighted sum of squares of the process noise."""
    return 0.5 * float(np.sum(_disturbance_squares(problem, iterate)))


def _disturbance_squares(problem: Problem, iterate: Iterate) -> FloatArray:
    """Sum of squares of each state's process noise over its variance, (n_states,); 0 where there is none."""
    total = np.zeros_like(problem.process_noise)
    driven = problem.process_noise > 0
    for s, (grid, x) in enumerate(zip(problem.grids, iterate.x, strict=True)):
        defect, _ = evaluate_segment(problem.model, grid, x, problem.parameters.of_segment(s, iterate.theta))
        squares = np.sum(defect**2 / grid.step[:, None], axis=0)
        total[driven] += squares[driven] / problem.process_noise[driven] ** 2
    return total


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
    runs = [_filtered(problem, iterate, s).filter for s in range(len(problem.grids))]
    return tuple(Filtered(run.innovation.T, run.covariance, run.log_det + run.squares) for run in runs)


@dataclass(frozen=True)
class _Run:
    """A filter's run over a segment: `inverse` (n - 1, n_states, n_states) that of the defects' derivatives by the
    state after, `transition` and `driven` (n - 1, n_states, n_states), `observe` (n, n_outputs, n_states).
    """

    inverse: FloatArray
    transition: FloatArray
    driven: FloatArray
    observe: FloatArray
    filter: Filter

    def determinant_weights(self) -> Weights:
        """Derivatives of half the sum of log det S by those of defects and outputs by states."""
        from brv_hypo.likelihood.compiled import determinant_derivatives

        by_transition, by_driven, by_observe = determinant_derivatives(
            self.filter, self.transition, self.driven, self.observe
        )
        turned = -self.inverse.transpose(0, 2, 1)
        through = by_transition @ self.transition.transpose(0, 2, 1) + 2.0 * by_driven @ self.driven
        return Weights(turned @ by_transition, turned @ through, by_observe)


def _filtered(problem: Problem, iterate: Iterate, s: int) -> _Run:
    from brv_hypo.likelihood.compiled import filtered  # here: numba takes long to load

    grid, x = problem.grids[s], iterate.x[s]
    linear = linearise_segment(
        problem.model, grid, x, problem.parameters.of_segment(s, iterate.theta), ()
    )
    before, after = linear.defect_by_state.blocks[:, 0], linear.defect_by_state.blocks[:, 1]
    inverse = np.asarray(np.linalg.inv(after), dtype=float)
    transition = np.asarray(-inverse @ before)
    shift = -(inverse @ linear.defect[:, :, None])[:, :, 0]
    drive = problem.process_noise**2 * grid.step[:, None]
    driven = (inverse * drive[:, None, :]) @ inverse.transpose(0, 2, 1)
    residual = np.where(grid.measured.T, grid.y.T - linear.output, np.nan)
    observe = np.ascontiguousarray(linear.output_by_state.blocks[:, 0])
    run = filtered(transition, shift, driven, residual, observe, iterate.covariance)
    return _Run(inverse, transition, driven, observe, run)
