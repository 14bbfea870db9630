"""What not knowing the variances adds to the errors of theta in filter error.

Process noise is seen through the dynamics, so that theta and the variances err together. Their joint covariance has

    cov theta = V + D W D',    D = d theta / d s = -V dg / ds

with V that of theta with the variances held, W that of the logarithms s of the variances, theta integrated out, and g
the gradient of the NLLF by theta: of the objective, and of the determinant (see `filtering`).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.likelihood.filtering import gradients_elsewhere
from brv_hypo.likelihood.marginal import Marginal
from brv_hypo.likelihood.scoring import Directions, changed_variances
from brv_hypo.likelihood.step import Iterate, Problem, Sensitivity, information_factor

_DIFFERENCE = 1e-3
"""Relative change of a variance for derivatives by it."""
_POOREST = 1.0
"""Variance of the logarithm of a variance that is counted at most: beyond, nothing is linear."""


def with_unknown_variances(
    problem: Problem,
    iterate: Iterate,
    directions: Directions,
    linear: Sequence[Marginal],
    segments: Sequence[Sensitivity],
    spread: FloatArray,
    covariance: FloatArray,
) -> FloatArray:
    """The covariance of theta (p, p), nan where it was; `spread` (unknowns, unknowns) is that of the variances."""
    known = np.flatnonzero(np.isfinite(np.diag(covariance)))
    weight, axes = np.linalg.eigh(spread)
    axes, weight = axes[:, weight > 0.0].T, np.minimum(weight[weight > 0.0], _POOREST)
    if not known.size or not weight.size:
        return covariance
    changes = _DIFFERENCE * np.concatenate([np.zeros((1, axes.shape[1])), axes])
    variances = changed_variances(problem, iterate, directions, changes)
    gradients = gradients_elsewhere(problem, iterate, segments, *variances)
    gradients += [_gradient(problem, linear, *each) for each in zip(*variances, strict=True)]
    if not np.all(np.isfinite(gradients)):
        return covariance
    block = np.ix_(known, known)
    follow = covariance[block] @ (gradients[1:] - gradients[0])[:, known].T / _DIFFERENCE
    found = covariance.copy()
    found[block] += (follow * weight) @ follow.T
    return found


def _gradient(
    problem: Problem, linear: Sequence[Marginal], noise: FloatArray, covariance: FloatArray
) -> FloatArray:
    """Of the objective by theta (p,), the states following; nan where these are not determined."""
    segments = []
    p = len(problem.parameters.names)
    for each in linear:
        integrated = each.integrated(noise, covariance)
        if integrated is None:
            return np.full(p, np.nan)
        segments.append(integrated)
    triangle = information_factor(problem, segments)
    return np.asarray(triangle[:, :p].T @ triangle[:, p])
