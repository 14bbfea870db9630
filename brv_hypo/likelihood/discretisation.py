"""What the mesh does to the estimate: the dynamics' own errors between samples, in standard errors of theta.

An interval's error is the difference of two quadratures of the slope, Simpson's with the midpoint of the cubic
(`collocation`) and Boole's on a quartic, whose points are had by one Picard step from that cubic. What process noise
adds over the interval is no error of the mesh: the quartic is driven evenly by it, so that both end at the same state.
A change dc of the defects moves the estimate by -H^-1 L' dc, with L the derivatives of the multipliers by theta (see
`band`) and H the information: the elimination of the last step knows both, and no second fit is needed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.likelihood.band import BandSolution
from brv_hypo.likelihood.course import SampledCourse
from brv_hypo.likelihood.derivatives import Points, evaluate
from brv_hypo.likelihood.segment import Grid
from brv_hypo.likelihood.step import Iterate, Problem, Sensitivity

_NODES = np.linspace(0.0, 1.0, 5)
_BOOLE = np.array([7.0, 32.0, 12.0, 32.0, 7.0]) / 90.0


def _partial_weights() -> FloatArray:
    """Integrals of the quartic through five slopes from the start to each node, (5, 5)."""
    powers = np.vander(_NODES, increasing=True)
    integrals = np.stack([_NODES ** (k + 1) / (k + 1) for k in range(5)], axis=1)
    return np.asarray(integrals @ np.linalg.inv(powers))


_PARTIAL = _partial_weights()


def mesh_shift(
    problem: Problem, iterate: Iterate, segments: Sequence[Sensitivity], covariance: FloatArray
) -> FloatArray:
    """How far exact dynamics would move the estimate, (p,), in standard errors; nan where that is not known.

    `covariance` (p, p) is that of theta, nan for parameters that the fit could not move. Known without delays, and
    for segments that were eliminated by a band.
    """
    p = len(problem.parameters.names)
    known = np.isfinite(np.diag(covariance))
    usable = not problem.model.delays and all(isinstance(s.eliminated, BandSolution) for s in segments)
    if not usable or not segments or not known.any():
        return np.full(p, np.nan)
    gradient = np.zeros(p)
    for s, (grid, x, segment) in enumerate(zip(problem.grids, iterate.x, segments, strict=True)):
        with np.errstate(all="ignore"):
            error = interval_errors(problem, grid, x, problem.parameters.of_segment(s, iterate.theta))
        multiplier = segment.eliminated.multiplier[1:, :, 1:]  # type: ignore[attr-defined]
        index = problem.parameters.segment_index[s]
        gradient[index] += np.einsum("km,kmp->p", error.T / problem.size, multiplier)
    block = covariance[np.ix_(known, known)]
    shift = np.full(p, np.nan)
    shift[known] = block @ gradient[known] / np.sqrt(np.diag(block))
    return shift


def interval_errors(problem: Problem, grid: Grid, x: FloatArray, theta: Mapping[str, float]) -> FloatArray:
    """Change of state over each interval less what Simpson's rule makes of it, (n_states, n - 1)."""
    h = grid.step
    corner = _slopes(problem, grid, {0.0: x[:, :-1], 1.0: x[:, 1:]}, theta)
    cubic = {s: _hermite(s, h, x, corner[0.0], corner[1.0]) for s in _NODES[1:-1].tolist()}
    first = corner | _slopes(problem, grid, cubic, theta)
    slopes = np.stack([first[s] for s in _NODES.tolist()])
    simpson = (first[0.0] + 4.0 * first[0.5] + first[1.0]) / 6.0
    # Of a state that nothing drives, what is left is how far the search is from its end.
    noisy = (problem.process_noise > 0.0)[:, np.newaxis]
    driven = np.where(noisy, x[:, 1:] - x[:, :-1] - h * simpson, 0.0)
    better = x[:, :-1] + h * np.einsum("ij,jmn->imn", _PARTIAL, slopes) + _NODES[:, None, None] * driven
    second = corner | _slopes(
        problem, grid, {s: better[i] for i, s in enumerate(_NODES.tolist()) if 0 < i < 4}, theta
    )
    boole = sum(weight * second[s] for weight, s in zip(_BOOLE, _NODES.tolist(), strict=True))
    return np.asarray(h * (boole - simpson))


def _slopes(
    problem: Problem, grid: Grid, states: Mapping[float, FloatArray], theta: Mapping[str, float]
) -> dict[float, FloatArray]:
    """The dynamics at states (n_states, n - 1) at fractions of every interval."""
    found = {}
    for s, x in states.items():
        u = _between(s, *_of_intervals(grid, grid.u))
        courses = tuple(
            SampledCourse(c.name, c.weights, _between(s, *_of_intervals(grid, c.shapes)))
            for c in grid.courses
        )
        points = Points(x, u, grid.t[: grid.n - 1] + s * grid.step, courses=courses)
        found[s] = evaluate(problem.model.dynamics, points, theta)
    return found


def _of_intervals(grid: Grid, signal: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """A signal at the start, the middle and the end of every interval, before the jump where there is one."""
    n = grid.n
    end = signal[:, 2 * n - 1 :] if grid.jumps else signal[:, 1:n]
    return signal[:, : n - 1], signal[:, n : 2 * n - 1], end


def _between(s: float, start: FloatArray, middle: FloatArray, end: FloatArray) -> FloatArray:
    """On the parabola through the three."""
    weights = 2.0 * (s - 0.5) * (s - 1.0), 4.0 * s * (1.0 - s), 2.0 * s * (s - 0.5)
    return np.asarray(weights[0] * start + weights[1] * middle + weights[2] * end)


def _hermite(s: float, h: FloatArray, x: FloatArray, before: FloatArray, after: FloatArray) -> FloatArray:
    """The cubic through states and slopes at both ends, at a fraction of every interval."""
    low, high = x[:, :-1], x[:, 1:]
    return np.asarray(
        low
        + s**2 * (3.0 - 2.0 * s) * (high - low)
        + h * (s * (1.0 - s) ** 2 * before - s**2 * (1.0 - s) * after)
    )
