"""Noise covariances of filter error: Fisher scoring of all variances together, and how well they are known.

With the states integrated out the outputs are Gaussian with covariance C(Q, R), linear in the variances, and

    NLLF = objective + 1/2 log det C + const,  log det C = log|det K| + sum log det R   (K: the matrix of `elimination`)

Theta is integrated out too, which adds 1/2 log det I(theta) (restricted likelihood: Patterson and Thompson, Biometrika
58 (1971) 545): variances that are best for the fitted theta are too small by what the fit took out of the residuals.
The gradient by the logarithms of all variances and its expected Hessian, 1/2 tr(C^-1 dC C^-1 dC), give one step for
all: Q moves as Q exp(s), R as F exp(S) F' with F its Cholesky factor. Free initial states are integrated out too.

Not knowing the variances adds to the covariance of theta: cov theta = V + D W D', D = d theta / d s = -V dg / ds,
with V that of theta with the variances held, W that of s, and g the gradient of the NLLF by theta. Entrances:
`scored` and `noise_errors`, which also says which variances went to 0.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from brv_hypo.arrays import BoolArray, FloatArray
from brv_hypo.likelihood.filter_error import Integrated, Marginal, gradients_elsewhere
from brv_hypo.likelihood.gauss_newton import Iterate, Parts, Problem, Sensitivity, information_factor, linearised
from brv_hypo.likelihood.noise import Shape

# ---- Noise covariances of filter error: Fisher scoring of all variances together ----


_DIFFERENCE = 1e-3
"""Relative change of a variance for second derivatives of log det C: truncation 2e-7, rounding 1e-6."""
_SMALL_DIFFERENCE = 1e-5
"""The same for first derivatives, one-sided: truncation 1e-5 of the second, rounding 1e-6."""
_ROUNDING = 1e-4
"""Information on the logarithm of a variance that is no more than rounding: only its gradient is used."""
_LARGEST_MOVE = 3.0
"""Largest change of the logarithm of a variance in one step."""
_HALVINGS = 5
_SCORINGS = 6
"""Steps on one linearisation at most."""
_CURVED = 0.1
"""Least curvature of the likelihood along a step, against that expected, from which the Hessian learns."""
_VANISHED = 1e-2
"""NLLF that a variance has left to win on its way to 0 below which it counts as 0."""
_UNSEEN = 1e-10
"""Singular value of the scaled sensitivities, against the largest, of a combination that the data do not see."""
_COUPLED = 12
"""Variances up to which all their cross informations are had; beyond, those of the diagonals of Q and R."""


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


def directions_of(problem: Problem, shape: Shape, estimate_noise: bool, estimate_process_noise: bool) -> Directions:
    """The variances to be estimated."""
    driven = np.flatnonzero(problem.process_noise).tolist() if estimate_process_noise else []
    outputs = problem.grids[0].y.shape[0] if estimate_noise else 0
    entries = [(a, b) for a in range(outputs) for b in range(a, outputs if shape == "full" else a + 1)]
    return Directions(tuple(driven), tuple(sorted(entries, key=lambda e: e[0] != e[1])))


@dataclass(frozen=True)
class Scored:
    """Where scoring led."""

    problem: Problem
    """With the process noise that was found."""
    iterate: Iterate
    """With the measurement noise that was found."""
    first: float = 0.0
    """Length of the first step, in standard errors."""
    last: float = 0.0
    """The same of the last."""
    information: FloatArray | None = None
    """The Hessian that it ended with, (k, k)."""
    segments: tuple[Sensitivity, ...] = ()
    """The sensitivities there, none where the states are not determined."""


def scored(
    problem: Problem,
    iterate: Iterate,
    directions: Directions,
    enough: float,
    held: Sequence[Parts] | None = None,
    information: FloatArray | None = None,
) -> Scored:
    """Scoring steps, the states and their linearisation still where they were, until one is shorter than `enough`.

    `held` is the linearisation, where it is known, `information` the Hessian from near by. It is that of the
    likelihood, which is had sooner than the restricted one's and nearly as good, kept up by the gradients (BFGS).
    """
    linear = marginals(problem, iterate, held)
    solved = _solved(problem, iterate, linear)
    if solved is None:
        return Scored(problem, iterate)
    lengths = []
    score: Score | None = None
    move = np.zeros(directions.count)
    value = solved.nllf
    for _ in range(_SCORINGS if directions.count else 0):
        gradient = _gradient(problem, iterate, directions, linear, solved)
        if information is None:
            information = _information(problem, iterate, directions, linear)
        if score is not None:
            information = _updated(information, gradient - score.gradient, move)
        score = Score(directions, gradient, information)
        problem, iterate, solved, value, move = _moved(problem, iterate, score, linear, solved, value)
        lengths.append(score.length(move))
        if lengths[-1] < enough:
            break
    first, last = (lengths[0], lengths[-1]) if lengths else (0.0, 0.0)
    return Scored(
        problem=problem, iterate=iterate, first=first, last=last, information=information, segments=solved.segments
    )


def _updated(information: FloatArray, change: FloatArray, move: FloatArray) -> FloatArray:
    """The Hessian that agrees with the change of the gradient over a move, where it is positive-definite then."""
    along, pull = float(change @ move), information @ move
    if not along > _CURVED * float(pull @ move):
        return information
    return np.asarray(information + np.outer(change, change) / along - np.outer(pull, pull) / float(pull @ move))


def _moved(
    problem: Problem, iterate: Iterate, score: Score, linear: Sequence[Marginal], solved: _Solved, value: float
) -> tuple[Problem, Iterate, _Solved, float, FloatArray]:
    """As far along the score's step as the likelihood rises, its negative there, and the move."""
    move = score.step()
    for _ in range(_HALVINGS):
        trial = moved_noise(problem, iterate, score.directions, move)
        found = _solved(*trial, linear)
        after = np.inf if found is None else found.nllf
        if found is not None and after <= value + 1e-10 * abs(value):
            return *trial, found, after, move
        move = 0.5 * move
    return problem, iterate, solved, value, np.zeros_like(move)


def marginals(problem: Problem, iterate: Iterate, held: Sequence[Parts] | None = None) -> tuple[Marginal, ...]:
    """Every segment about its states."""
    known = linearised(problem, iterate) if held is None else held
    return tuple(
        Marginal(problem, grid, x, parts) for grid, x, parts in zip(problem.grids, iterate.x, known, strict=True)
    )


def _gradient(
    problem: Problem, iterate: Iterate, directions: Directions, linear: Sequence[Marginal], solved: _Solved
) -> FloatArray:
    changes = _SMALL_DIFFERENCE * np.concatenate([np.zeros((1, directions.count)), np.eye(directions.count)])
    middle, *up = _log_dets(problem, iterate, directions, changes, linear)
    squares = _squares((problem, iterate), (problem, iterate), directions, linear, solved)
    return np.asarray(0.5 * (np.array(up) - middle) / _SMALL_DIFFERENCE - 0.5 * np.sum(squares, axis=1))


def _information(problem: Problem, iterate: Iterate, directions: Directions, linear: Sequence[Marginal]) -> FloatArray:
    """The expected Hessian, from second differences of log det C."""
    count, unit = directions.count, _DIFFERENCE * np.eye(directions.count)
    coupled = count if count <= _COUPLED else len(directions.driven) + problem.grids[0].y.shape[0]
    pairs = np.array([(a, b) for a in range(min(coupled, count)) for b in range(a)], dtype=int).reshape(-1, 2)
    both = unit[pairs[:, 0]] + unit[pairs[:, 1]]
    changes = np.concatenate([np.zeros((1, count)), unit, -unit, both])
    found = _log_dets(problem, iterate, directions, changes, linear)
    middle, up, down = found[0], found[1 : 1 + count], found[1 + count : 1 + 2 * count]
    second = np.diag(up - 2.0 * middle + down)
    for (a, b), value in zip(pairs, found[1 + 2 * count :], strict=True):
        second[a, b] = second[b, a] = value - up[a] - up[b] + middle
    return np.asarray(-0.5 * second / _DIFFERENCE**2)


def _further_information(
    problem: Problem, iterate: Iterate, directions: Directions, linear: Sequence[Marginal], solved: _Solved
) -> FloatArray:
    """What integrating theta out adds: the same of log det I(theta), from differences of its gradient."""
    here = (problem, iterate)
    before = _squares(here, here, directions, linear, solved)[:, 1:].sum(axis=1)
    rows = []
    for row in _DIFFERENCE * np.eye(directions.count):
        noise, covariance = changed_variances(problem, iterate, directions, row[None])
        there = replace(problem, process_noise=noise[0]), replace(iterate, covariance=covariance[0])
        found = _solved(*there, linear)
        after = before if found is None else _squares(there, here, directions, linear, found)[:, 1:].sum(axis=1)
        rows.append(0.5 * (after - before) / _DIFFERENCE)
    return np.asarray(0.5 * (np.array(rows) + np.array(rows).T))


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


def changed_variances(
    problem: Problem, iterate: Iterate, directions: Directions, changes: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Process noises (k, n_states) and covariances (k, n_outputs, n_outputs) after changes (k, unknowns) of the
    variances on straight lines: Q (1 + s), F (1 + S) F'.
    """
    factor = np.ones((len(changes), problem.process_noise.size))
    factor[:, list(directions.driven)] += changes[:, : len(directions.driven)]
    root = np.linalg.cholesky(iterate.covariance)
    turned = np.array([_symmetric(directions, change, len(root)) for change in changes])
    return problem.process_noise * np.sqrt(factor), iterate.covariance + root @ turned @ root.T


def _log_dets(
    problem: Problem, iterate: Iterate, directions: Directions, changes: FloatArray, linear: Sequence[Marginal]
) -> FloatArray:
    """log det C after changes (k, unknowns), but for a constant, (k,)."""
    changed = changed_variances(problem, iterate, directions, changes)
    return np.array([sum(each.log_det(q, r) for each in linear) for q, r in zip(*changed, strict=True)])


@dataclass(frozen=True)
class _Solved:
    """With the states best for the variances, the functions linear. Columns of rows are those of the residual, then
    those of k orthonormal combinations of theta.
    """

    objective: float
    """Half the weighted sum of squares."""
    log_det: float
    """log det I(theta)."""
    outputs: tuple[FloatArray, ...]
    """Whitened outputs of each segment, (n, n_outputs, 1 + k)."""
    noise: tuple[FloatArray, ...]
    """Whitened process noise, (n, n_states, 1 + k), the initial state's row first."""
    segments: tuple[Integrated, ...]
    """The segments, states integrated out."""

    @property
    def nllf(self) -> float:
        """Restricted NLLF but for a constant, priors left out; infinite where it is not finite."""
        total = self.objective + 0.5 * (sum(each.log_det for each in self.segments) + self.log_det)
        return total if np.isfinite(total) else float("inf")


def _solved(problem: Problem, iterate: Iterate, linear: Sequence[Marginal]) -> _Solved | None:
    segments = []
    for each in linear:
        found = each.integrated(problem.process_noise, iterate.covariance)
        if found is None:
            return None
        segments.append(found)
    combinations, log_det = _orthonormal(problem, iterate, segments)
    outputs, noise = [], []
    for segment in segments:
        turn = np.zeros((1 + len(combinations), 1 + combinations.shape[1]))
        turn[0, 0] = 1.0
        turn[1:, 1:] = np.where(segment.void[:, None], 0.0, combinations)
        outputs.append(segment.outputs @ turn)
        noise.append(segment.noise @ turn)
    total = sum(float(np.sum(rows[:, :, 0] ** 2)) for rows in (*outputs, *noise))
    return _Solved(
        objective=0.5 * total, log_det=log_det, outputs=tuple(outputs), noise=tuple(noise), segments=tuple(segments)
    )


def _orthonormal(problem: Problem, iterate: Iterate, segments: Sequence[Sensitivity]) -> tuple[FloatArray, float]:
    """Combinations of theta (p, k) of unit information, priors in it, and log det I(theta), over what the data and
    the bounds leave free.
    """
    parameters = problem.parameters
    inside = (iterate.theta > parameters.lower) & (iterate.theta < parameters.upper)
    p = inside.size
    data = information_factor(segments)[:p, :p]
    informed = np.isfinite(parameters.prior_std)
    rows = np.concatenate([data, np.diag(1.0 / parameters.prior_std)[informed]])
    size = np.linalg.norm(rows, axis=0)
    free = np.flatnonzero(inside & (size > 0.0))
    _, singular, rotation = np.linalg.svd(rows[:, free] / size[free], full_matrices=False)
    kept = singular > _UNSEEN * singular.max(initial=0.0)
    combinations = np.zeros((p, int(kept.sum())))
    combinations[free] = rotation[kept].T / singular[kept] / size[free][:, None]
    return combinations, 2.0 * float(np.sum(np.log(size[free])) + np.sum(np.log(singular[kept])))


def _squares(
    there: tuple[Problem, Iterate],
    here: tuple[Problem, Iterate],
    directions: Directions,
    linear: Sequence[Marginal],
    solved: _Solved,
) -> FloatArray:
    """Minus twice the derivative of the objective (first column), and minus that of log det I(theta) (the sum of the
    others), by the unknowns of `here`, (unknowns, 1 + k), at the variances of `there`, for which `solved` is.
    """
    ratio = here[0].process_noise[list(directions.driven)] / there[0].process_noise[list(directions.driven)]
    driven = sum(np.sum(rows[1:] ** 2, axis=0) for rows in solved.noise)
    root = np.linalg.cholesky(here[1].covariance)
    projected = np.zeros((*root.shape, solved.outputs[0].shape[2]))
    for each, rows in zip(linear, solved.outputs, strict=True):
        weighed = root.T @ each.weighed(rows, there[1].covariance)
        projected += np.einsum("nak,nbk->abk", weighed, weighed)
    measured = [projected[a, b] * (1.0 if a == b else 2.0) for a, b in directions.entries]
    return np.array([*(ratio[:, None] ** 2 * np.asarray(driven)[list(directions.driven)]), *measured])


# ---- What not knowing the variances adds to the errors of theta in filter error ----


_LOG_VARIANCE_STEP = 1e-3
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
    changes = _LOG_VARIANCE_STEP * np.concatenate([np.zeros((1, axes.shape[1])), axes])
    variances = changed_variances(problem, iterate, directions, changes)
    gradients = gradients_elsewhere(problem, iterate, segments, *variances)
    gradients += [_theta_gradient(problem, linear, *each) for each in zip(*variances, strict=True)]
    if not np.all(np.isfinite(gradients)):
        return covariance
    block = np.ix_(known, known)
    follow = covariance[block] @ (gradients[1:] - gradients[0])[:, known].T / _LOG_VARIANCE_STEP
    found = covariance.copy()
    found[block] += (follow * weight) @ follow.T
    return found


def _theta_gradient(
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
    triangle = information_factor(segments)
    return np.asarray(triangle[:, :p].T @ triangle[:, p])


# ---- How well the variances of filter error are known, and which of them went to 0 ----


@dataclass(frozen=True)
class NoiseErrors:
    """Standard errors of the standard deviations, `process` (n_states,) per root second and `measurement`
    (n_outputs,); nan where they were given or vanished, and in output error. `covariance` (p, p) is that of theta, what
    not knowing the variances adds to it included. `remarks` name those that vanished.
    """

    process: FloatArray
    measurement: FloatArray
    covariance: FloatArray
    remarks: tuple[str, ...] = ()

    @classmethod
    def unknown(cls, problem: Problem, iterate: Iterate, covariance: FloatArray) -> NoiseErrors:
        """None, `covariance` as it is."""
        return cls(
            np.full(problem.process_noise.size, np.nan), np.full(iterate.covariance.shape[0], np.nan), covariance
        )


def noise_errors(
    problem: Problem, iterate: Iterate, directions: Directions, segments: Sequence[Sensitivity], covariance: FloatArray
) -> NoiseErrors:
    """Errors from the expected Hessian; `covariance` (p, p) is that of theta with the variances as they are."""
    unknown = NoiseErrors.unknown(problem, iterate, covariance)
    process, measurement = unknown.process, unknown.measurement
    if not directions.count or not np.any(problem.process_noise):
        return unknown
    linear = marginals(problem, iterate)
    solved = _solved(problem, iterate, linear)
    if solved is None:
        return unknown
    score = Score(
        directions,
        _gradient(problem, iterate, directions, linear, solved),
        _information(problem, iterate, directions, linear)
        + _further_information(problem, iterate, directions, linear, solved),
    )
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
        change = np.stack([w * root[:, a] * root[:, b] for w, (a, b) in zip(twice, directions.entries, strict=True)], 1)
        variance = np.einsum("ij,jk,ik->i", change, spread[len(driven) :, len(driven) :], change)
        measurement = np.sqrt(np.maximum(variance, 0.0) / np.diag(iterate.covariance)) / 2.0
        measurement[measurement == 0.0] = np.nan
    if segments:
        covariance = with_unknown_variances(problem, iterate, directions, linear, segments, spread, covariance)
    never_measured = ~np.any([grid.measured.any(axis=1) for grid in problem.grids], axis=0)
    return NoiseErrors(process, measurement, covariance, _remarks(directions, gone, never_measured))


def _remarks(directions: Directions, gone: BoolArray, never_measured: BoolArray) -> tuple[str, ...]:
    """What went to 0, by state and output; outputs that were never measured have no noise that could."""
    states = [state for state, lost in zip(directions.driven, gone, strict=False) if lost]
    lost = gone[len(directions.driven) :]
    outputs = [
        a for (a, b), each in zip(directions.entries, lost, strict=True) if each and a == b and not never_measured[a]
    ]
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
