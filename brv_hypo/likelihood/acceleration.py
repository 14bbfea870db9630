"""Extrapolation of slow Gauss-Newton steps (Anderson, J. ACM 12 (1965) 547).

Where a model is not quite right its residuals stay large, and the steps, which leave the residuals' curvature out,
shrink by a constant factor only. What the last steps did to each other tells that factor in every direction.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.likelihood.step import Iterate, Problem, Step

_NEAR = 0.5
"""Length of a step, in standard errors, below which it is extrapolated: farther away nothing is linear."""
_SLOW = 0.3
"""Ratio of successive lengths above which steps are slow."""
_WORSE = 2.0
"""Ratio above which an extrapolation did harm, and the memory is cleared."""
_MEMORY = 5
"""Steps remembered."""
_INDEPENDENT = 1e-8
"""Singular value, against the largest, of differences of steps below which they tell nothing new."""


@dataclass
class Extrapolation:
    """Remembers iterates and their steps; none where process noise has variances of its own to settle."""

    problem: Problem
    _past: list[tuple[Iterate, Step]] = field(default_factory=list)

    def improved(self, iterate: Iterate, step: Step) -> Step:
        """The step as it is, or the one that the last steps together promise to leave the least of."""
        if np.any(self.problem.process_noise) or step.length > _NEAR:
            self._past.clear()
            return step
        before = self._past[-1][1].length if self._past else np.inf
        if step.length > _WORSE * before:
            self._past.clear()
        self._past = [*self._past[-_MEMORY:], (iterate, step)]
        if len(self._past) < 2 or step.length < _SLOW * before:
            return step
        return self._combined()

    def _combined(self) -> Step:
        _, step = self._past[-1]
        weigh = self._metric(step)
        moves = np.stack([each.theta for _, each in self._past], axis=1)
        differences = weigh @ np.diff(moves, axis=1)
        left, singular, rotation = np.linalg.svd(differences, full_matrices=False)
        kept = singular > _INDEPENDENT * singular.max(initial=0.0)
        share = rotation[kept].T @ ((left[:, kept].T @ (weigh @ step.theta)) / singular[kept])
        theta = step.theta.copy()
        x = [each.copy() for each in step.x]
        for (old, old_step), (new, new_step), weight in zip(self._past, self._past[1:], share, strict=False):
            theta -= weight * (new.theta - old.theta + new_step.theta - old_step.theta)
            for s, into in enumerate(x):
                into -= weight * (new.x[s] - old.x[s] + new_step.x[s] - old_step.x[s])
        if not np.all(np.abs(theta) <= self.problem.reach):
            return step
        return replace(step, theta=theta, x=tuple(x))

    def _metric(self, step: Step) -> FloatArray:
        """What weighs a move of theta by its information, priors in it."""
        return np.concatenate([step.triangle, np.diag(1.0 / self.problem.parameters.prior_std)])
