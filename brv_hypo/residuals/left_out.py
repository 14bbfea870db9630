"""Errors on stretches left out of the fit in turn, without fitting again.

With Q an orthonormal basis of all columns and e the residual of the whole fit, the error on the rows B when they are
left out is (I - Q_B Q_B')^-1 e_B. Baseline and nuisances are the same for every candidate: their inverse is kept, and a
candidate's few columns are a change of low rank to it. Errors are weighed by I - Q_B Q_B', what baseline and nuisances
leave uncertain of the stretch: a drift that no fit predicts would drown all else.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from brv_hypo.arrays import FloatArray, IntArray
from brv_hypo.regression.fit import HypothesisFit
from brv_hypo.regression.linear import lengths
from brv_hypo.regression.problem import Problem

# Share of a candidate's direction outside a stretch below which nothing but the stretch tells its coefficient.
_UNTOLD = 1e-6
# What keeps a stretch's matrix regular where the baseline is told by it alone.
_RIDGE = 1e-9
_SPENT = 1e-6  # singular values of unit columns below which a direction is rounding


@dataclass(frozen=True)
class LeftOut:
    """The left-out errors of fits to one problem."""

    problem: Problem

    @cached_property
    def _basis(self) -> FloatArray:
        """Basis (rows, unknowns) of baseline, constants and nuisances."""
        design = self.problem.whole_design(self.problem.frame, self.problem.baseline)
        vectors, sizes, _ = np.linalg.svd(design / lengths(design), full_matrices=False)
        return np.asarray(vectors[:, sizes > 1e-10 * sizes[0]], dtype=float)

    @cached_property
    def _stretches(self) -> list[tuple[IntArray, tuple[FloatArray, bool]]]:
        """The rows of each stretch, in all channels, with the factor of its matrix."""
        problem = self.problem
        n = problem.rows.part.thinned_rows(problem.rows.noise)
        found = []
        for a, b in problem.rows.part.thinned_pieces(problem.rows.noise):
            rows = np.concatenate([np.arange(channel * n + a, channel * n + b) for channel in range(4)])
            own = self._basis[rows]
            found.append((rows, cho_factor((1.0 + _RIDGE) * np.eye(rows.size) - own @ own.T)))
        return found

    def error(self, fit: HypothesisFit) -> float:
        """Sum of squared errors, weighed, on every stretch, each from a fit of everything to the others."""
        extra = self._directions(fit)
        parts = extra.T @ self.problem.response
        total = 0.0
        for rows, factor in self._stretches:
            error, own = fit.residual[rows], extra[rows]
            solved = cho_solve(factor, np.column_stack([error, own]))
            outside, turn = np.linalg.eigh(np.eye(own.shape[1]) - own.T @ solved[:, 1:])
            told = outside > _UNTOLD
            # A direction that the other stretches cannot tell is not predicted at all.
            silent = own @ turn[:, ~told] @ (turn[:, ~told].T @ parts)
            left = solved[:, 0] + cho_solve(factor, silent)
            weights = turn[:, told].T @ own.T @ left / outside[told]
            predicted = left + solved[:, 1:] @ turn[:, told] @ weights
            total += float(np.sum((np.triu(factor[0]) @ predicted) ** 2))
        return total

    def explained(self, null: HypothesisFit, fit: HypothesisFit) -> float:
        """Share of the null's left-out error, weighed, that the fit saves."""
        return 1.0 - self.error(fit) / self.error(null)

    def _directions(self, fit: HypothesisFit) -> FloatArray:
        """Orthonormal directions (rows, columns) that the fit's own columns add to the basis."""
        if not fit.selected:
            return np.zeros((self.problem.rows.size, 0))
        return directions_beyond(self._basis, self.problem.design(fit.frame, fit.selected))


def directions_beyond(basis: FloatArray, design: FloatArray) -> FloatArray:
    """Orthonormal directions (rows, rank) of columns beyond a basis; what is mere rounding of unit columns is none."""
    free = design - basis @ (basis.T @ design)
    vectors, sizes, _ = np.linalg.svd(free / lengths(design), full_matrices=False)
    return np.asarray(vectors[:, sizes > _SPENT], dtype=float)
