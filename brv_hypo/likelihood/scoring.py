"""Noise covariances of filter error: Fisher scoring of all variances together.

With the states integrated out the outputs are Gaussian with covariance C(Q, R), linear in the variances, and

    NLLF = objective + 1/2 log det C + const,  log det C = log|det K| + sum log det R   (see `filtering`)

Theta is integrated out too, which adds 1/2 log det I(theta) (restricted likelihood: Patterson & Thompson, Biometrika
58 (1971) 545): variances that are best for the fitted theta are too small by what the fit took out of the residuals,
those of process noise above all, which the dynamics' parameters resemble.

Process and measurement noise explain the same residuals, so that one of them at a time, or the steps of
expectation-maximisation, creep. Here the gradient of the NLLF by the logarithms of all variances and its expected
Hessian, 1/2 tr(C^-1 dC C^-1 dC), come from derivatives of log det C along straight lines, and one step moves all.
Log det C + log det I is that of the contrasts which theta leaves alone, whose covariance is linear in variances too.
Q moves as Q exp(s), R as F exp(S) F' with F its Cholesky factor, so that both stay positive. Free initial states are
integrated out too: fitted, they would take their share of the residuals, and the likelihood of a variance that goes to
0 would have no bound.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from brv_hypo.arrays import BoolArray, FloatArray
from brv_hypo.likelihood.band import log_determinant
from brv_hypo.likelihood.collocation import Linearisation, linearise_segment
from brv_hypo.likelihood.elimination import eliminate
from brv_hypo.likelihood.noise import Shape, log_determinants, whitening
from brv_hypo.likelihood.step import (
    Iterate,
    Problem,
    Sensitivity,
    information_factor,
    quadratic_of,
    sensitivity_of,
)

_DIFFERENCE = 1e-3
"""Relative change of a variance for derivatives of log det C: truncation 2e-7, rounding of the second 1e-6."""
_ROUNDING = 1e-4
"""Information on the logarithm of a variance that is no more than rounding: only its gradient is believed."""
_LARGEST_MOVE = 3.0
"""Largest change of the logarithm of a variance in one step."""
_HALVINGS = 5
_VANISHED = 1e-2
"""NLLF that a variance has left to win on its way to 0 below which it counts as 0."""
_UNSEEN = 1e-10
"""Singular value of the scaled sensitivities, against the largest, of a combination that the data do not see."""
_COUPLED = 12
"""Variances up to which all their cross informations are had; beyond, those of the diagonals of Q and R."""


Measure = Callable[[Problem, Iterate, Sequence[Linearisation]], float]


@dataclass(frozen=True)
class Directions:
    """What is estimated: the variances of the process noise of some states, and entries (a, b) of S."""

    driven: tuple[int, ...]
    entries: tuple[tuple[int, int], ...]

    @property
    def count(self) -> int:
        """Number of unknowns, process noise first."""
        return len(self.driven) + len(self.entries)


@dataclass(frozen=True)
class Score:
    """Gradient of the NLLF (k,) and its expected Hessian (k, k) by the unknowns of `directions`."""

    directions: Directions
    gradient: FloatArray
    information: FloatArray

    @property
    def vanished(self) -> BoolArray:
        """Variances that have next to nothing left to win on their way to 0, (k,)."""
        little = (self.gradient >= 0.0) & (self.gradient < _VANISHED)
        return np.asarray(little & (np.diag(self.information) < _VANISHED))

    def step(self) -> FloatArray:
        """The scoring step, (k,); those that vanished rest."""
        move = np.zeros(self.gradient.size)
        live = ~self.vanished
        if live.any():
            known, gradient = self.information[np.ix_(live, live)].copy(), self.gradient[live]
            weak = np.diag(known) < _ROUNDING
            known[weak] = known[:, weak] = 0.0
            known[weak, weak] = np.abs(gradient[weak]) / _LARGEST_MOVE
            size = np.sqrt(np.maximum(np.diag(known), 1e-300))
            solved = np.linalg.lstsq(known / np.outer(size, size), -gradient / size, rcond=1e-8)[0]
            move[live] = np.clip(solved / size, -_LARGEST_MOVE, _LARGEST_MOVE)
        return move

    def length(self, move: FloatArray) -> float:
        """The largest move in standard errors."""
        return float(np.max(np.abs(move) * np.sqrt(np.maximum(np.diag(self.information), 0.0)), initial=0.0))


def directions_of(
    problem: Problem, shape: Shape, estimate_noise: bool, estimate_process_noise: bool
) -> Directions:
    """The variances to be estimated."""
    driven = np.flatnonzero(problem.process_noise).tolist() if estimate_process_noise else []
    outputs = problem.grids[0].y.shape[0] if estimate_noise else 0
    entries = [(a, b) for a in range(outputs) for b in range(a, outputs if shape == "full" else a + 1)]
    return Directions(tuple(driven), tuple(sorted(entries, key=lambda e: e[0] != e[1])))


@dataclass(frozen=True)
class NoiseErrors:
    """Standard errors of the standard deviations, `process` (n_states,) per root second and `measurement`
    (n_outputs,); nan where they were given or vanished, and in output error. `remarks` name those that vanished.
    """

    process: FloatArray
    measurement: FloatArray
    remarks: tuple[str, ...] = ()


def noise_errors(problem: Problem, iterate: Iterate, directions: Directions) -> NoiseErrors:
    """Errors from the expected Hessian, theta held."""
    states, outputs = problem.process_noise.size, iterate.covariance.shape[0]
    process, measurement = np.full(states, np.nan), np.full(outputs, np.nan)
    asked = directions.count > 0 and bool(np.any(problem.process_noise))
    score = score_of(problem, iterate, directions) if asked else None
    if score is None:
        return NoiseErrors(process, measurement)
    gone = score.vanished
    live = np.flatnonzero(~gone)
    spread = np.zeros((directions.count, directions.count))
    spread[np.ix_(live, live)] = np.linalg.pinv(score.information[np.ix_(live, live)], rcond=1e-12)
    driven = list(directions.driven)
    known = ~gone[: len(driven)]
    error = 0.5 * problem.process_noise[driven] * np.sqrt(np.maximum(np.diag(spread)[: len(driven)], 0.0))
    process[driven] = np.where(known, error, np.nan)
    if directions.entries:
        root = np.linalg.cholesky(iterate.covariance)
        twice = [1.0 if a == b else 2.0 for a, b in directions.entries]
        change = np.stack(
            [w * root[:, a] * root[:, b] for w, (a, b) in zip(twice, directions.entries, strict=True)], 1
        )
        variance = np.einsum("ij,jk,ik->i", change, spread[len(driven) :, len(driven) :], change)
        measurement = np.sqrt(np.maximum(variance, 0.0) / np.diag(iterate.covariance)) / 2.0
        measurement[measurement == 0.0] = np.nan
    return NoiseErrors(process, measurement, _remarks(directions, gone))


def _remarks(directions: Directions, gone: BoolArray) -> tuple[str, ...]:
    """What went to 0, by state and output."""
    states = [state for state, lost in zip(directions.driven, gone, strict=False) if lost]
    lost = gone[len(directions.driven) :]
    outputs = [a for (a, b), each in zip(directions.entries, lost, strict=True) if each and a == b]
    found = []
    if states:
        found.append(
            f"the process noise of states {states} went to 0: their dynamics are exact as far as the data say. Leave "
            "it out (0 in process_noise), where the fit is also faster"
        )
    if outputs:
        found.append(
            f"the measurement noise of outputs {outputs} went to 0: process noise explains all that is left of them. "
            "Likely causes: sensors far better than the motion is smooth, or too slow a rate to tell the two apart. "
            "Give noise_covariance where it is known"
        )
    return tuple(found)


def scored(problem: Problem, iterate: Iterate, directions: Directions) -> tuple[Problem, Iterate, float]:
    """Both after one scoring step, the states still where they were, and the step's length in standard errors.

    The step is that of the likelihood's Hessian, which is had sooner than the restricted one's and nearly as good.
    """
    linear = _linearised(problem, iterate)
    solved = _solved(problem, iterate, linear)
    if solved is None or not directions.count:
        return problem, iterate, 0.0
    score = _score(problem, iterate, directions, linear, solved, _nothing)
    move = score.step()
    before = _value(problem, iterate, linear, solved)
    for _ in range(_HALVINGS):
        trial = moved_noise(problem, iterate, directions, move)
        if _value(*trial, linear, _solved(*trial, linear)) <= before + 1e-10 * abs(before):
            return *trial, score.length(move)
        move = 0.5 * move
    return problem, iterate, 0.0


def score_of(problem: Problem, iterate: Iterate, directions: Directions) -> Score | None:
    """Gradient and expected Hessian; None where the states are not determined."""
    linear = _linearised(problem, iterate)
    solved = _solved(problem, iterate, linear)
    if solved is None:
        return None
    return _score(problem, iterate, directions, linear, solved, _log_det_of_information)


def _linearised(problem: Problem, iterate: Iterate) -> list[Linearisation]:
    """Every segment about its states."""
    parameters = problem.parameters
    return [
        linearise_segment(problem.model, grid, x, parameters.of_segment(s, iterate.theta), parameters.base)
        for s, (grid, x) in enumerate(zip(problem.grids, iterate.x, strict=True))
    ]


def _score(
    problem: Problem,
    iterate: Iterate,
    directions: Directions,
    linear: Sequence[Linearisation],
    solved: _Solved,
    measure: Measure,
) -> Score:
    """The gradient, and the expected Hessian from second differences of `measure`."""
    count, h = directions.count, _DIFFERENCE
    unit = h * np.eye(count)

    def at(change: FloatArray) -> tuple[float, float]:
        changed = _changed(problem, iterate, directions, change)
        plain = _log_det(*changed, linear)
        return plain, plain + measure(*changed, linear)

    middle = at(np.zeros(count))[1]
    ends = np.array([[at(sign * row) for row in unit] for sign in (1, -1)])
    up, down = ends[..., 1]
    second = np.diag((up - 2.0 * middle + down) / h**2)
    coupled = count if count <= _COUPLED else len(directions.driven) + problem.grids[0].y.shape[0]
    for a in range(min(coupled, count)):
        for b in range(a):
            both = at(unit[a] + unit[b])[1]
            second[a, b] = second[b, a] = (both - up[a] - up[b] + middle) / h**2
    slope = (ends[0, :, 0] - ends[1, :, 0]) / (2.0 * h)
    gradient = 0.5 * slope - 0.5 * _squares(problem, iterate, directions, solved)
    return Score(directions, gradient, -0.5 * second)


def moved_noise(
    problem: Problem, iterate: Iterate, directions: Directions, move: FloatArray
) -> tuple[Problem, Iterate]:
    """Q exp(s) and F exp(S) F'."""
    noise = problem.process_noise.copy()
    driven = list(directions.driven)
    noise[driven] *= np.exp(0.5 * move[: len(driven)])
    power, rotation = np.linalg.eigh(_symmetric(directions, move, iterate.covariance.shape[0]))
    root = np.linalg.cholesky(iterate.covariance) @ rotation * np.exp(0.5 * power)
    covariance = iterate.covariance if not directions.entries else np.asarray(root @ root.T)
    return replace(problem, process_noise=noise), replace(iterate, covariance=covariance)


def _symmetric(directions: Directions, move: FloatArray, size: int) -> FloatArray:
    found = np.zeros((size, size))
    for (a, b), value in zip(directions.entries, move[len(directions.driven) :], strict=True):
        found[a, b] = found[b, a] = value
    return found


def _changed(
    problem: Problem, iterate: Iterate, directions: Directions, change: FloatArray
) -> tuple[Problem, Iterate]:
    """Variances changed on straight lines: Q (1 + s), F (1 + S) F'."""
    factor = np.ones_like(problem.process_noise)
    factor[list(directions.driven)] += change[: len(directions.driven)]
    root = np.linalg.cholesky(iterate.covariance)
    covariance = iterate.covariance + root @ _symmetric(directions, change, len(root)) @ root.T
    changed = replace(problem, process_noise=problem.process_noise * np.sqrt(factor))
    return changed, replace(iterate, covariance=covariance)


def _log_det(problem: Problem, iterate: Iterate, linear: Sequence[Linearisation]) -> float:
    """log det C but for a constant."""
    total = 0.0
    for grid, x, each in zip(problem.grids, iterate.x, linear, strict=True):
        total += log_determinant(quadratic_of(problem, grid, x, [(slice(None), each)], iterate.covariance))
        total += log_determinants(grid.measured, iterate.covariance)
    return total


def _log_det_of_information(problem: Problem, iterate: Iterate, linear: Sequence[Linearisation]) -> float:
    """log det I(theta); nan where the states are not determined."""
    solved = _solved(problem, iterate, linear)
    return float("nan") if solved is None else solved.log_det


def _nothing(problem: Problem, iterate: Iterate, linear: Sequence[Linearisation]) -> float:
    return 0.0


@dataclass(frozen=True)
class _Solved:
    """With the states best for the variances, the functions linear: the objective, and log det I(theta).

    The whitened rows of both, of each segment: outputs (n, n_outputs, 1 + k), process noise (n, n_states, 1 + k), the
    initial state's row first; the residual's column, then those of k orthonormal combinations of theta.
    """

    objective: float
    log_det: float
    outputs: tuple[FloatArray, ...]
    noise: tuple[FloatArray, ...]


def _solved(problem: Problem, iterate: Iterate, linear: Sequence[Linearisation]) -> _Solved | None:
    segments = []
    for grid, x, each in zip(problem.grids, iterate.x, linear, strict=True):
        found = eliminate(quadratic_of(problem, grid, x, [(slice(None), each)], iterate.covariance))
        if found is None:
            return None
        segments.append(sensitivity_of(found))
    combinations, log_det = _orthonormal(problem, iterate, segments)
    outputs, noise = [], []
    for segment, index in zip(segments, problem.parameters.segment_index, strict=True):
        seen, driven = segment.eliminated.rows()
        turn = np.zeros((1 + index.size, 1 + combinations.shape[1]))
        turn[0, 0] = 1.0
        turn[1:, 1:] = np.where(segment.void[:, None], 0.0, combinations[index])
        outputs.append(seen @ turn)
        noise.append(
            np.zeros((*segment.eliminated.problem.defect.shape, 1)) if driven is None else driven @ turn
        )
    total = sum(float(np.sum(rows[:, :, 0] ** 2)) for rows in (*outputs, *noise))
    return _Solved(0.5 * total, log_det, tuple(outputs), tuple(noise))


def _orthonormal(
    problem: Problem, iterate: Iterate, segments: Sequence[Sensitivity]
) -> tuple[FloatArray, float]:
    """Combinations of theta (p, k) of unit information, priors in it, and log det I(theta), over what the data and
    the bounds leave free.
    """
    parameters = problem.parameters
    inside = (iterate.theta > parameters.lower) & (iterate.theta < parameters.upper)
    p = inside.size
    data = information_factor(problem, segments)[:p, :p]
    rows = np.concatenate([data, np.diag(1.0 / parameters.prior_std)])
    size = np.linalg.norm(rows, axis=0)
    free = np.flatnonzero(inside & (size > 0.0))
    _, singular, rotation = np.linalg.svd(rows[:, free] / size[free], full_matrices=False)
    kept = singular > _UNSEEN * singular.max(initial=0.0)
    combinations = np.zeros((p, int(kept.sum())))
    combinations[free] = rotation[kept].T / singular[kept] / size[free][:, None]
    return combinations, 2.0 * float(np.sum(np.log(size[free])) + np.sum(np.log(singular[kept])))


def _squares(problem: Problem, iterate: Iterate, directions: Directions, solved: _Solved) -> FloatArray:
    """Minus twice the derivative of objective and 1/2 log det I(theta) by the unknowns, (k,)."""
    driven = sum(np.sum(rows[1:] ** 2, axis=(0, 2)) for rows in solved.noise)
    root = np.linalg.cholesky(iterate.covariance)
    seen = np.zeros_like(root)
    for grid, rows in zip(problem.grids, solved.outputs, strict=True):
        weighted = root.T @ np.einsum(
            "nja,njk->ank", whitening(iterate.covariance, grid.measured), rows
        ).reshape(len(root), -1)
        seen += weighted @ weighted.T
    measured = [seen[a, b] * (1.0 if a == b else 2.0) for a, b in directions.entries]
    return np.concatenate([np.asarray(driven)[list(directions.driven)], measured])


def _value(
    problem: Problem, iterate: Iterate, linear: Sequence[Linearisation], solved: _Solved | None
) -> float:
    """Restricted NLLF but for a constant, priors left out; infinite where the states are not determined."""
    if solved is None:
        return float("inf")
    total = solved.objective + 0.5 * (_log_det(problem, iterate, linear) + solved.log_det)
    return total if np.isfinite(total) else float("inf")
