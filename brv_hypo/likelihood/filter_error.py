"""Filter error: with process noise the states are integrated out, not only fitted.

With Q > 0 the least-squares states are the smoothed ones, and the likelihood of theta is theirs times a determinant.
For linear dynamics, and to the order of Laplace's approximation otherwise,

    NLLF = objective + 1/2 log det C + const,   log det C = log|det K| - 2 log|det D| + sum log det R

with C(Q, R) the covariance of the outputs and K, D the matrices of `elimination` (Schweppe, IEEE Trans. Information
Theory 11 (1965) 61). At Q = 0 it is that of R and output error remains. `determinant` is what C adds, the initial state
held; `determinant_gradients` their derivatives by theta, the states following.

C is linear in the variances. They are estimated by Fisher scoring of their logarithms, free initial states and theta
integrated out, which adds 1/2 log det I(theta) (restricted likelihood: Patterson and Thompson, Biometrika 58 (1971)
545): variances that are best for the fitted theta are too small by what the fit took out of the residuals. The expected
Hessian is minus half the second derivative of log det C + log det I.

Not knowing the variances adds to the covariance of theta: cov theta = V + D W D', D = d theta / d s = -V dg / ds,
with V that of theta with the variances held, W that of s, and g the gradient of the NLLF by theta.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from brv_hypo.arrays import BoolArray, FloatArray
from brv_hypo.likelihood import gauss_newton
from brv_hypo.likelihood.collocation import Linearisation, evaluate_segment, linearise_segment
from brv_hypo.likelihood.elimination import Segments, log_determinant
from brv_hypo.likelihood.gauss_newton import Iterate, Setup, SingularStatesError, information_factor, sensitivities
from brv_hypo.likelihood.statistics import log_determinant_of

Variances = Sequence[tuple[FloatArray, FloatArray]]  # process noise (n_states,) and variances (n_outputs,)

# ---- The determinant that integrating the states out adds, and its gradient ----


_THETA_STEP = 1e-4  # change of a parameter, in its size, for the gradient: third derivative 1e-8, rounding 1e-6
_DIFFERENCE = 1e-3  # relative change of a variance for second derivatives: truncation 2e-7, rounding 1e-6
_SMALL_DIFFERENCE = 1e-5  # the same for first derivatives, one-sided: truncation 1e-5 of the second, rounding 1e-6
_ROUNDING = 1e-4  # information on the logarithm of a variance that is no more than rounding: only its gradient is used
_LARGEST_MOVE = 3.0  # largest change of the logarithm of a variance in one step
_HALVINGS = 5
_SCORINGS = 6  # steps on one linearisation at most
_CURVED = 0.1  # least curvature of the likelihood along a step, against that expected, from which the Hessian learns
_VANISHED = 1e-2  # NLLF that a variance has left to win on its way to 0 below which it counts as 0
_UNSEEN = 1e-10  # singular value of scaled sensitivities, against the largest, that the data do not see
_LOG_VARIANCE_STEP = 1e-3  # relative change of a variance for derivatives by it
_POOREST = 1.0  # variance of the logarithm of a variance that is counted at most: beyond, nothing is linear


def determinant(problem: Setup, iterate: Iterate) -> float:
    """What integrating the states out adds to the objective."""
    return float(_determinants(problem, iterate, [(problem.process_noise, iterate.variance)])[0])


def _determinants(problem: Setup, iterate: Iterate, variances: Variances) -> FloatArray:
    """It with several variances, (k,)."""
    total = np.zeros(len(variances))
    theta = problem.parameters.as_mapping(iterate.theta)
    for grid, x in zip(problem.grids, iterate.x, strict=True):
        linear = linearise_segment(problem.model, grid, x, theta, ())
        of_dynamics = np.sum(np.linalg.slogdet(linear.defect_by_state[:, 1])[1])
        for k, (noise, of_outputs) in enumerate(variances):
            quadratic = gauss_newton.quadratic_of(replace(problem, process_noise=noise), grid, x, linear, of_outputs)
            variance = quadratic.variance.copy()
            variance[0] = 0.0
            total[k] += 0.5 * log_determinant(replace(quadratic, variance=variance)) - of_dynamics
    return total


def determinant_gradients(problem: Setup, iterate: Iterate, segments: Segments, variances: Variances) -> FloatArray:
    """Derivatives of the determinants with several variances by theta, the states following, (k, p)."""
    names = problem.parameters.names
    gradients = np.zeros((len(variances), len(names)))
    for i, name in enumerate(names):
        step = _THETA_STEP * max(abs(iterate.theta[i]), problem.model.scale.get(name, 1.0))
        direction = np.eye(1, len(names), i)[0]
        turned = [np.append(0.0, np.where(s.void, 0.0, direction[s.problem.own])) for s in segments]
        follow = [(s.x @ along).T * problem.size[:, None] for s, along in zip(segments, turned, strict=True)]
        up, down = (
            _determinants(
                problem,
                replace(
                    iterate,
                    theta=iterate.theta + move * direction,
                    x=tuple(x + move * along for x, along in zip(iterate.x, follow, strict=True)),
                ),
                variances,
            )
            for move in (step, -step)
        )
        gradients[:, i] = (up - down) / (2.0 * step)
    return gradients


def disturbance_cost(problem: Setup, iterate: Iterate) -> float:
    """Half the weighted sum of squares of the process noise."""
    total = np.zeros_like(problem.process_noise)
    driven = problem.process_noise > 0
    for grid, x in zip(problem.grids, iterate.x, strict=True):
        defect, _ = evaluate_segment(problem.model, grid, x, problem.parameters.as_mapping(iterate.theta))
        squares = np.sum(defect**2 / grid.step[:, None], axis=0)
        total[driven] += squares[driven] / problem.process_noise[driven] ** 2
    return 0.5 * float(np.sum(total))


def kalman_innovations(problem: Setup, iterate: Iterate) -> tuple[tuple[FloatArray, ...], float]:
    """Innovations (n_outputs, n) of the Kalman filter about smoothed states, nan in gaps; NLLF (Eq. 3.10, E8)."""
    from statsmodels.tsa.statespace.kalman_filter import KalmanFilter  # here: it takes long to load

    theta, innovations, nllf = problem.parameters.as_mapping(iterate.theta), [], 0.0
    for grid, x in zip(problem.grids, iterate.x, strict=True):
        linear = linearise_segment(problem.model, grid, x, theta, ())
        before, after = linear.defect_by_state[:, 0], linear.defect_by_state[:, 1]
        inverse = np.linalg.inv(after)
        drive = (inverse * (problem.process_noise**2 * grid.step[:, None])[:, None]) @ inverse.transpose(0, 2, 1)
        residual = np.where(grid.measured, grid.y - linear.output.T, np.nan)

        def by_sample(values: FloatArray) -> FloatArray:
            """Of each interval, then zero for the one after the last sample: (..., n)."""
            return np.moveaxis(np.concatenate([values, np.zeros_like(values[:1])]), 0, -1)

        model = KalmanFilter(k_endog=len(grid.y), k_states=len(x), selection=np.eye(len(x)))
        model.bind(residual.T.copy())
        model["design"] = np.moveaxis(linear.output_by_state, 0, -1)
        model["obs_cov"] = np.diag(iterate.variance)
        model["transition"] = by_sample(-inverse @ before)
        model["state_intercept"] = by_sample(-(inverse @ linear.defect[:, :, None])[:, :, 0])
        model["state_cov"] = by_sample(drive)
        model.initialize_known(np.zeros(len(x)), np.zeros((len(x), len(x))))
        found = model.filter()
        innovations.append(np.where(grid.measured, found.forecasts_error, np.nan))
        nllf -= float(found.llf) + 0.5 * np.log(2.0 * np.pi) * np.count_nonzero(grid.measured)
    return tuple(innovations), nllf


# ---- Noise variances: Fisher scoring of all variances together ----


@dataclass(frozen=True)
class Directions:
    """The states whose process noise, and the outputs whose measurement noise is estimated, in this order."""

    driven: tuple[int, ...]
    outputs: tuple[int, ...]

    @property
    def count(self) -> int:
        """Number of unknown variances."""
        return len(self.driven) + len(self.outputs)


@dataclass(frozen=True)
class Score:
    """Gradient of the NLLF (k,) and its expected Hessian (k, k) by the unknowns."""

    gradient: FloatArray
    information: FloatArray

    @property
    def vanished(self) -> BoolArray:
        """Variances that have next to nothing left to win on their way to 0, (k,)."""
        little = (self.gradient >= 0.0) & (self.gradient < _VANISHED)
        return np.asarray(little & (np.diag(self.information) < _VANISHED))

    @cached_property
    def spread(self) -> FloatArray:
        """Covariance of the logarithms of the variances (k, k), 0 for those that vanished."""
        found = np.zeros_like(self.information)
        live = np.ix_(~self.vanished, ~self.vanished)
        found[live] = np.linalg.pinv(self.information[live], rcond=1e-12)
        return found

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


def directions_of(problem: Setup, estimate_noise: bool, estimate_process_noise: bool) -> Directions:
    """The variances to be estimated."""
    driven = np.flatnonzero(problem.process_noise).tolist() if estimate_process_noise else []
    return Directions(tuple(driven), tuple(range(problem.grids[0].y.shape[0])) if estimate_noise else ())


def scored(
    problem: Setup, iterate: Iterate, directions: Directions, enough: float, linear: Sequence[Linearisation]
) -> tuple[Solved, list[float]]:
    """Scoring steps, the states and their linearisation still where they were, until one is shorter than `enough`.
    Where they led, and the lengths of the steps in standard errors, 0 for none. Raises SingularStatesError where the
    outputs leave a state undetermined.
    """
    solved = Solved(problem, iterate, directions, linear)
    lengths = []
    information = solved.information() if directions.count else np.zeros((0, 0))
    gradient = move = np.zeros(0)
    for number in range(_SCORINGS if directions.count else 0):
        before, gradient = gradient, solved.gradient()
        if number:
            # The Hessian that agrees (BFGS) with the change of the gradient, if it is positive-definite then.
            change, pull = gradient - before, information @ move
            along, expected = float(change @ move), float(pull @ move)
            if along > _CURVED * expected:
                information = information + np.outer(change, change) / along - np.outer(pull, pull) / expected
        score = Score(gradient, information)
        solved, move = solved.along(score.step())
        lengths.append(score.length(move))
        if lengths[-1] < enough:
            break
    return solved, lengths or [0.0]


@dataclass(frozen=True)
class Solved:
    """The functions linear, with the states best for the variances; SingularStatesError where these do not exist."""

    problem: Setup  # with the process noise
    iterate: Iterate  # with the measurement noise, the states where they are linear about
    directions: Directions  # what is estimated
    linear: Sequence[Linearisation]  # the linearisation

    @cached_property
    def segments(self) -> Segments:
        """The segments, states integrated out."""
        return sensitivities(self.problem, self.iterate, self.linear)

    @cached_property
    def log_det(self) -> float:
        """log det C + log det I(theta), but for a constant."""
        measured = sum(log_determinant_of(self.iterate.variance, grid.measured) for grid in self.problem.grids)
        states = sum(segment.log_det for segment in self.segments)
        # I(theta), priors in it, over what the data and the bounds leave free.
        parameters, theta = self.problem.parameters, self.iterate.theta
        inside = (theta > parameters.lower) & (theta < parameters.upper)
        p = inside.size
        rows = np.concatenate([information_factor(self.segments, p)[:p, :p], np.diag(1.0 / parameters.prior_std)])
        size = np.linalg.norm(rows, axis=0)
        free = np.flatnonzero(inside & (size > 0.0))
        _, singular, rotation = np.linalg.svd(rows[:, free] / size[free], full_matrices=False)
        kept = singular > _UNSEEN * singular.max(initial=0.0)
        unseen = rotation[~kept] / size[free]  # what the scaling added along it is taken out again
        known = 2.0 * (np.sum(np.log(size[free])) + np.sum(np.log(singular[kept])))
        return float(measured + states + (known + np.linalg.slogdet(unseen @ unseen.T)[1]))

    @cached_property
    def nllf(self) -> float:
        """Restricted NLLF but for a constant, priors left out; infinite where it is not finite."""
        squares = sum(float(np.sum(segment.triangle[:, -1] ** 2)) for segment in self.segments)
        total = 0.5 * (squares + self.log_det)
        return total if np.isfinite(total) else float("inf")

    def gradient(self) -> FloatArray:
        """Of the restricted NLLF, by differences."""
        found = self.with_factors(1.0 + _SMALL_DIFFERENCE * np.eye(self.directions.count))
        return np.array([each.nllf - self.nllf for each in found]) / _SMALL_DIFFERENCE

    def information(self) -> FloatArray:
        """The expected Hessian, from second differences."""
        count, unit = self.directions.count, _DIFFERENCE * np.eye(self.directions.count)
        pairs = np.array([(a, b) for a in range(count) for b in range(a)], dtype=int).reshape(-1, 2)
        changes = np.concatenate([unit, -unit, unit[pairs[:, 0]] + unit[pairs[:, 1]]])
        differences = np.array([each.log_det - self.log_det for each in self.with_factors(1.0 + changes)])
        up, down, both = np.split(differences, [count, 2 * count])
        second = np.diag(up + down)
        for (a, b), value in zip(pairs, both, strict=True):
            second[a, b] = second[b, a] = value - up[a] - up[b]
        return np.asarray(-0.5 * second / _DIFFERENCE**2)

    def along(self, move: FloatArray) -> tuple[Solved, FloatArray]:
        """As far along the move of the logarithms as the likelihood rises, and that move."""
        for _ in range(_HALVINGS):
            found = next(self.with_factors(np.exp(move)[None]))
            with suppress(SingularStatesError):
                if found.nllf <= self.nllf + 1e-10 * abs(self.nllf):
                    return found, move
            move = 0.5 * move
        return self, np.zeros_like(move)

    def variances(self, factors: FloatArray) -> Variances:
        """The estimated variances times each of several factors (k, unknowns)."""
        found, driven = [], list(self.directions.driven)
        for factor in factors:
            noise, variance = self.problem.process_noise.copy(), self.iterate.variance.copy()
            noise[driven] *= np.sqrt(factor[: len(driven)])
            variance[list(self.directions.outputs)] *= factor[len(driven) :]
            found.append((noise, variance))
        return found

    def with_factors(self, factors: FloatArray) -> Iterator[Solved]:
        """The same with such variances, one at a time: their segments are large."""
        for noise, variance in self.variances(factors):
            problem, iterate = replace(self.problem, process_noise=noise), replace(self.iterate, variance=variance)
            yield Solved(problem, iterate, self.directions, self.linear)


def with_unknown_variances(here: Solved, score: Score, segments: Segments, covariance: FloatArray) -> FloatArray:
    """The covariance of theta (p, p), nan where it was."""
    known = np.flatnonzero(np.isfinite(np.diag(covariance)))
    weight, axes = np.linalg.eigh(score.spread)
    axes, weight = axes[:, weight > 0.0].T, np.minimum(weight[weight > 0.0], _POOREST)
    if not known.size or not weight.size:
        return covariance
    factors = 1.0 + _LOG_VARIANCE_STEP * np.concatenate([np.zeros((1, axes.shape[1])), axes])
    gradients = determinant_gradients(here.problem, here.iterate, segments, here.variances(factors))
    for row, solved in zip(gradients, here.with_factors(factors), strict=True):
        triangle = information_factor(solved.segments, row.size)
        row += triangle[:, :-1].T @ triangle[:, -1]  # of the objective, the states following
    if not np.all(np.isfinite(gradients)):
        return covariance
    block = np.ix_(known, known)
    follow = covariance[block] @ (gradients[1:] - gradients[0])[:, known].T / _LOG_VARIANCE_STEP
    found = covariance.copy()
    found[block] += (follow * weight) @ follow.T
    return found


def noise_errors(
    problem: Setup, iterate: Iterate, directions: Directions, segments: Segments, covariance: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, tuple[str, ...]]:
    """Standard errors of the noises' standard deviations, from the expected Hessian, and covariance of theta (p, p).

    Those of process noise (n_states,) per root second and of outputs (n_outputs,): nan where given or vanished, and in
    output error. To the `covariance` with the variances as they are comes what not knowing them adds. Last, remarks
    that name those that vanished.
    """
    process, measurement = np.full(problem.process_noise.size, np.nan), np.full(iterate.variance.size, np.nan)
    unknown = process, measurement, covariance, ()
    if not directions.count or not np.any(problem.process_noise):
        return unknown
    solved = Solved(problem, iterate, directions, gauss_newton.linearised(problem, iterate))
    try:
        score = Score(solved.gradient(), solved.information())
        if segments:
            covariance = with_unknown_variances(solved, score, segments, covariance)
    except SingularStatesError:
        return unknown
    relative = 0.5 * np.sqrt(np.maximum(np.diag(score.spread), 0.0))
    of_driven, of_outputs = np.split(np.where(score.vanished, np.nan, relative), [len(directions.driven)])
    driven, outputs = list(directions.driven), list(directions.outputs)
    process[driven] = problem.process_noise[driven] * of_driven
    measurement[outputs] = np.sqrt(iterate.variance[outputs]) * of_outputs
    return process, measurement, covariance, _remarks(problem, directions, score.vanished)


def _remarks(problem: Setup, directions: Directions, gone: BoolArray) -> tuple[str, ...]:
    """What went to 0, by state and output; outputs that were never measured have no noise that could."""
    measured = np.any([grid.measured.any(axis=1) for grid in problem.grids], axis=0)
    lost = gone[len(directions.driven) :]
    states = [state for state, each in zip(directions.driven, gone, strict=False) if each]
    outputs = [a for a, each in zip(directions.outputs, lost, strict=True) if each and measured[a]]
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
            "Give `noise` where it is known"
        )
    return tuple(found)
