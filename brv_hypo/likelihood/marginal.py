"""A linearised segment whose states are integrated out, for any variances of both noises.

What depends on the variances is compiled (`compiled_band`), so that their derivatives can be had from differences.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from brv_hypo.arrays import BoolArray, FloatArray
from brv_hypo.likelihood.band import SINGULAR, BandSolution
from brv_hypo.likelihood.collocation import Linearisation
from brv_hypo.likelihood.noise import gap_patterns, pattern_whitening
from brv_hypo.likelihood.segment import Grid
from brv_hypo.likelihood.step import Problem, Sensitivity, quadratic_of, start_defect, unseen_columns


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
        from brv_hypo.likelihood.compiled_band import LinearModel  # here: numba takes long to load

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
        from brv_hypo.likelihood.compiled_band import log_determinants

        whitener = pattern_whitening(covariance, self._patterns)
        start, drive = self._variances(process_noise)
        return self._of_noise(whitener) + log_determinants(self._model, start, drive, whitener)

    def _of_noise(self, whitener: FloatArray) -> FloatArray:
        """log det of the measurement noise of all samples, (...,); whitener (..., patterns, n_outputs, n_outputs)."""
        size = np.where(self._patterns, np.diagonal(whitener, axis1=-2, axis2=-1), 1.0)
        return np.asarray(-2.0 * np.log(size).sum(axis=-1) @ self._samples)

    def integrated(self, process_noise: FloatArray, covariance: FloatArray) -> Integrated | None:
        """The states eliminated; None where they are not determined."""
        from brv_hypo.likelihood.compiled_band import Variances, rows_of, solved

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
