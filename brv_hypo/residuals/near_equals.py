"""Effects that one flight cannot tell apart, from the angles between their projected columns."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.regression.linear import lengths
from brv_hypo.regression.problem import Problem
from brv_hypo.residuals.candidates import Candidate

# Cosine of the angle between an effect's prediction and the columns of another from which that can take its place.
_NEARLY_EQUAL = 0.95
_SPENT = 1e-6  # singular values of unit columns below which a direction is rounding


def near_equals(problem: Problem, candidates: Sequence[Candidate]) -> dict[str, tuple[str, ...]]:
    """For each candidate the others whose columns hold nearly all that it predicts, the nearest first."""
    base = _basis(problem.design(problem.frame, problem.baseline))
    spans = {c.name: _span(problem, base, c) for c in candidates}
    found = {}
    for candidate in candidates:
        size = float(np.linalg.norm(candidate.contribution))
        cosines = {
            name: float(np.linalg.norm(span.T @ candidate.contribution)) / size
            for name, span in spans.items()
            if name != candidate.name and size > 0.0
        }
        near = sorted((name for name in cosines if cosines[name] > _NEARLY_EQUAL), key=lambda name: -cosines[name])
        found[candidate.name] = tuple(near)
    return found


def _span(problem: Problem, base: FloatArray, candidate: Candidate) -> FloatArray:
    """Orthonormal directions (rows, columns) of a candidate's own columns beyond the baseline and the nuisances."""
    design = problem.design(candidate.fit.frame, candidate.fit.selected)
    return _basis(design - base @ (base.T @ design), lengths(design))


def _basis(columns: FloatArray, scale: FloatArray | None = None) -> FloatArray:
    vectors, sizes, _ = np.linalg.svd(columns / (lengths(columns) if scale is None else scale), full_matrices=False)
    return np.asarray(vectors[:, sizes > _SPENT], dtype=float)
