"""Filter error: with process noise the states are integrated out, not only fitted.

With Q > 0 the least-squares states are the smoothed ones, and the likelihood of theta is theirs times a determinant.
For linear dynamics, and to the order of Laplace's approximation otherwise,

    NLLF = objective + 1/2 sum over samples of log det S - log det R

with S the innovations' covariance of a Kalman filter about the smoothed states, the initial state held (Schweppe,
IEEE Trans. Information Theory 11 (1965) 61). At Q = 0 the sum vanishes and output error remains. `Determinant` is
that sum with its gradient; `Marginal` is a linearised segment with its states integrated out for any variances of
both noises.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from brv_hypo.arrays import BoolArray, FloatArray
from brv_hypo.likelihood.collocation import (
    Linearisation,
    Weights,
    evaluate_segment,
    linearise_segment,
    weighted_change,
)
from brv_hypo.likelihood.gauss_newton import (
    Iterate,
    Problem,
    Sensitivity,
    quadratic_of,
    start_defect,
    unseen_columns,
)
from brv_hypo.likelihood.kkt import SINGULAR, BandSolution
from brv_hypo.likelihood.noise import gap_patterns, log_determinants, pattern_whitening
from brv_hypo.likelihood.segment import Grid

if TYPE_CHECKING:
    from brv_hypo.likelihood.compiled import Filter


# ---- Filter error: process noise means that the states are integrated out, not only fitted ----


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
    for s, (grid, x) in enumerate(zip(problem.grids, iterate.x, strict=True)):
        defect, _ = evaluate_segment(problem.model, grid, x, problem.parameters.of_segment(s, iterate.theta))
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
        theta, index = parameters.of_segment(s, iterate.theta), parameters.segment_index[s]
        by_state, by_theta = weighted_change(
            problem.model, problem.grids[s], iterate.x[s], theta, parameters.base, weight
        )
        gradient[:, index] += by_theta
        for parameter in np.flatnonzero(~segment.void).tolist():
            direction = np.zeros(1 + index.size)
            direction[1 + parameter] = 1.0
            follow = segment.eliminated.states(direction) * problem.size
            gradient[:, index[parameter]] += np.tensordot(by_state, follow, 2)
    return gradient


@dataclass(frozen=True)
class _Motion:
    """A segment as a filter takes it: `inverse` (n - 1, n_states, n_states) that of the defects' derivatives by the
    state after, `transition` (n - 1, n_states, n_states), `shift` (n - 1, n_states), `step` (n - 1,), `residual` (n,
    n_outputs), `observe` (n, n_outputs, n_states).
    """

    inverse: FloatArray
    transition: FloatArray
    shift: FloatArray
    step: FloatArray
    residual: FloatArray
    observe: FloatArray

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
    grid, x = problem.grids[s], iterate.x[s]
    linear = linearise_segment(
        problem.model, grid, x, problem.parameters.of_segment(s, iterate.theta), ()
    )
    before, after = linear.defect_by_state.blocks[:, 0], linear.defect_by_state.blocks[:, 1]
    inverse = np.asarray(np.linalg.inv(after), dtype=float)
    return _Motion(
        inverse,
        transition=np.asarray(-inverse @ before),
        shift=-(inverse @ linear.defect[:, :, None])[:, :, 0],
        step=grid.step,
        residual=np.where(grid.measured.T, grid.y.T - linear.output, np.nan),
        observe=np.ascontiguousarray(linear.output_by_state.blocks[:, 0]),
    )


# ---- A linearised segment whose states are integrated out, for any variances of both noises ----


@dataclass(frozen=True)
class Integrated:
    """With the states best for the variances: `outputs` (n, n_outputs, 1 + p) and process noise `noise` (n, n_states, 1
    + p), both whitened, the initial state's row first; what is left, then derivatives by the segment's parameters.

    `x` and `multiplier` are those of `band.BandSolution`, `triangle` and `void` of `step.Sensitivity`, `log_det` is
    that of `Marginal.log_dets`.
    """

    x: FloatArray
    multiplier: FloatArray
    outputs: FloatArray
    noise: FloatArray
    triangle: FloatArray
    void: BoolArray
    log_det: float


class Marginal:
    """A segment about states x, (n_states, n), linearised part by part."""

    def __init__(
        self, problem: Problem, grid: Grid, x: FloatArray, parts: Sequence[tuple[slice, Linearisation]]
    ) -> None:
        from brv_hypo.likelihood.compiled import LinearModel  # here: numba takes long to load

        size = problem.size
        dynamics, observe, outputs, defects = [], [], [], []
        for part, each in parts:
            left = np.where(grid.measured.T[part], each.output - grid.y.T[part], 0.0)
            dynamics.append(each.defect_by_state.blocks * (size / size[:, None]))
            observe.append(each.output_by_state.blocks[:, 0] * size)
            outputs.append(np.concatenate([left[:, :, None], each.output_by_parameter], axis=2))
            both = np.concatenate([each.defect[:, :, None], each.defect_by_parameter], axis=2)
            defects.append(both / size[:, None])
        first = np.zeros((1, size.size, outputs[0].shape[2]))
        first[:, :, 0] = start_defect(problem, grid, x)
        self._patterns, index = gap_patterns(grid.measured)
        self._samples = np.bincount(index, minlength=len(self._patterns))
        self._grid, self._size, self._x, self._parts = grid, size, x, parts
        self._model = LinearModel(
            np.concatenate(dynamics),
            np.concatenate(observe),
            np.concatenate(outputs),
            np.concatenate([first, *defects]),
            grid.step,
            index,
        )
        self._probe = np.random.default_rng(0).standard_normal(2 * grid.n * size.size)

    def log_dets(self, process_noise: FloatArray, covariance: FloatArray) -> FloatArray:
        """log det of the outputs' covariance, initial states that are free integrated out, but for a constant, (k,).

        Of variances near each other: process noises (k, n_states), and covariances of measurement noise (k, n_outputs,
        n_outputs).
        """
        from brv_hypo.likelihood.compiled import log_determinants

        whitener = pattern_whitening(covariance, self._patterns)
        start, drive = self._variances(process_noise)
        return self._of_noise(whitener) + log_determinants(self._model, start, drive, whitener)

    def _of_noise(self, whitener: FloatArray) -> FloatArray:
        """log det of the measurement noise of all samples, (...,); whitener (..., patterns, n_outputs, n_outputs)."""
        size = np.where(self._patterns, np.diagonal(whitener, axis1=-2, axis2=-1), 1.0)
        return np.asarray(-2.0 * np.log(size).sum(axis=-1) @ self._samples)

    def integrated(self, process_noise: FloatArray, covariance: FloatArray) -> Integrated | None:
        """The states eliminated; None where they are not determined."""
        from brv_hypo.likelihood.compiled import Variances, rows_of, solved

        variances = Variances(
            *self._variances(process_noise), pattern_whitening(covariance, self._patterns)
        )
        x, multiplier, condition, log_det = solved(self._model, variances, self._probe)
        if not condition < SINGULAR or not np.all(np.isfinite(x)):
            return None
        rows = rows_of(self._model, variances, x, multiplier)
        triangle = rows.triangle
        void = unseen_columns(triangle, rows.direct[1:])
        triangle[:, :-1][:, void] = 0.0
        log_det += float(self._of_noise(variances.whitener))
        return Integrated(x, multiplier, rows.outputs, rows.noise, triangle, void, log_det)

    def sensitivity(self, problem: Problem, covariance: FloatArray, found: Integrated) -> Sensitivity:
        """What was integrated with these variances, as a step of theta takes it."""
        quadratic = quadratic_of(problem, self._grid, self._x, self._parts, covariance)
        return Sensitivity(BandSolution(quadratic, found.x, found.multiplier), found.triangle, found.void)

    def weighed(self, rows: FloatArray, covariance: FloatArray) -> FloatArray:
        """Whitened rows (n, n_outputs, k) times the transposed whitener: R^-1 of what they were before."""
        turned = pattern_whitening(covariance, self._patterns).transpose(0, 2, 1)
        return np.asarray(turned[self._model.pattern] @ rows)

    def _variances(self, process_noise: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Of the initial state, and per s of the process noise, (n_states,) each, in scaled states."""
        return self._grid.start_std**2 / self._size**2, process_noise**2 / self._size**2
