"""Standard errors that depend on the estimate itself, which they do where a fast transient is over within a sample.

An error of one sigma then changes sigma: estimates that come out low claim to be good, and their scatter in units of
their own sigma exceeds one. With sigma changing by a fraction c for each sigma of the estimate, the scatter of
z / (1 + c z), z standard normal, is about sqrt(1 + 9 c^2).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from brv_hypo.arrays import FloatArray, IntArray
from brv_hypo.likelihood.step import (
    Iterate,
    Problem,
    Sensitivity,
    SingularStatesError,
    information_factor,
    sensitivities,
)
from brv_hypo.likelihood.uncertainty import covariance_from_information

MARK = "hold for this estimate alone"
"""Words by which such a remark is known."""
_CHANGE = 0.2
"""Relative change of a standard error with its estimate moved by one that is told: a scatter of 1.17."""
_LOOSE = 0.05
"""Standard error over estimate below which no more can come of it than the functions' curvature over a twentieth."""


def changing_errors(
    problem: Problem,
    iterate: Iterate,
    segments: Sequence[Sensitivity],
    covariance: FloatArray,
    estimated: IntArray,
) -> tuple[str, ...]:
    """A remark where a standard error changes much within itself: sigma is taken again one sigma to either side.

    The other parameters and the states go along as the fit lets them follow. `covariance` (p, p) is that of theta.
    """
    sigma = np.sqrt(np.diag(covariance))
    changes = {}
    for j in estimated.tolist():
        if not sigma[j] > _LOOSE * abs(iterate.theta[j]):
            continue
        way = np.nan_to_num(covariance[:, j] / sigma[j])
        sides = [_variance(problem, _moved(problem, iterate, segments, s * way), j, estimated) for s in (1.0, -1.0)]
        change = 0.25 * abs(float(np.log(sides[0] / sides[1])))
        if change > _CHANGE:
            changes[problem.parameters.names[j]] = change
    if not changes:
        return ()
    most = float(np.exp(max(changes.values())))
    return (
        f"standard errors of {list(changes)} {MARK}: one sigma away they are {most:.2g} times as large or small, so "
        "that estimates scatter by a fifth more than they say, or worse. Likely cause: motion that is over within few "
        "samples. Take profile_interval instead, sample faster, or measure with less noise",
    )


def _moved(problem: Problem, iterate: Iterate, segments: Sequence[Sensitivity], way: FloatArray) -> Iterate:
    """The iterate with theta changed by `way` (p,) and the states following."""
    x = []
    for states, segment, index in zip(iterate.x, segments, problem.parameters.segment_index, strict=True):
        following = segment.eliminated.states(np.append(0.0, way[index]))
        x.append(states + following.T * problem.size[:, None])
    return replace(iterate, theta=iterate.theta + way, x=tuple(x))


def _variance(problem: Problem, iterate: Iterate, j: int, estimated: IntArray) -> float:
    """Variance of parameter j as it would be stated there; nan where it cannot be had."""
    p = len(problem.parameters.names)
    try:
        with np.errstate(all="ignore"):
            triangle = information_factor(problem, sensitivities(problem, iterate))[:p, :p]
    except SingularStatesError:
        return float("nan")
    if not np.all(np.isfinite(triangle)):
        return float("nan")
    return float(covariance_from_information(triangle, problem.parameters.prior_std, estimated)[j, j])
