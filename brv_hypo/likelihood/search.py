"""The search: Gauss-Newton steps until they are negligible against the standard errors, and B by Eq. 3.11 beside them.

A merit function weighs the fit against violated dynamics. `search` is the entrance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import partial

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.likelihood import gauss_newton
from brv_hypo.likelihood.collocation import Linearisation, evaluate_segment
from brv_hypo.likelihood.elimination import Segments
from brv_hypo.likelihood.filter_error import determinant, determinant_gradients, directions_of, disturbance_cost, scored
from brv_hypo.likelihood.gauss_newton import Iterate, Setup, SingularStatesError, moved, objective, sensitivities
from brv_hypo.likelihood.statistics import estimate_variance, least_variance, negative_log_likelihood
from brv_hypo.progress import Report, silent


class Status(StrEnum):
    """The value is what is shown and compared; each knows its `cause`, and its `remedy`, empty where none is needed."""

    cause: str
    remedy: str

    def __new__(cls, value: str, cause: str, remedy: str = "") -> Status:
        """A status by its value, which alone is its text."""
        status = str.__new__(cls, value)
        status._value_, status.cause, status.remedy = value, cause, remedy
        return status

    CONVERGED = "converged", "the step is negligible against the standard errors"
    COARSE = (
        "coarse mesh",
        "the search converged, but the motion is too fast for the mesh, so that estimates and errors are wrong",
        "Sample faster, or eliminate the fastest state (let it follow the others at once)",
    )
    ITERATION_LIMIT = (
        "iteration limit",
        "the iterations were not enough",
        "Look at the near-null directions in identifiability: parameters that the data do not separate; fix or bound "
        "some, or raise max_iterations",
    )
    STALLED = (
        "stalled",
        "no fraction of the step improves the fit: the derivatives are wrong (a function that is not smooth, or not "
        "vectorised over samples) or the start is too far away",
        "Check the functions, or start nearer",
    )
    UNDETERMINED = (
        "undetermined",
        "a state neither shows in an output nor drives one that does",
        "Measure it, leave it out of the states, or give x0_std so that its start is known",
    )
    STIFF = (
        "too stiff",
        "between two samples the fastest state settles so many times over that rounding hides the slow ones",
        "Let that state follow the others at once (set its rate to 0 and solve for it), or sample faster",
    )
    DIVERGED = (
        "diverged",
        "the step is not finite: the functions overflowed or returned nan",
        "Start nearer to the solution, set bounds, or check the dynamics for divisions by zero",
    )

    @property
    def message(self) -> str:
        """Cause and remedy in one text."""
        return f"{self.cause}. {self.remedy}" if self.remedy else self.cause


_FEASIBLE = 1e-7  # largest mean scaled defect of a converged trajectory
_CONVERGED_CHANGE = 2e-3  # relative change of a noise variance that counts as converged
_CONVERGED_MOVE = 0.05  # the same with process noise, in standard errors of the variances' logarithms
_LINEAR = 0.5  # change of the objective against the promised one at which the states are where the variances want them
_FEW, _FRACTION = 1e-4, 1e-2
"""Step, in the same, that ends them for one linearisation, or as a fraction of the step before."""
_NOISE_STEPS = 10  # that bring process noise near its estimate before theta moves
_NEAR_NOISE = 1.0  # how near, in standard errors
_CREEP = 0.1  # fraction of a step shorter than one standard error that counts as no progress
_CREEPING_STEPS = 3  # of these in a row
_NEAR = 0.3
_KEPT = 2.5
"""Way, in tolerances, over which derivatives are kept: with them the search ends where residuals are orthogonal to the
derivatives of another place, off by less than that way. Beside process noise, whose states may follow anything, none.
"""
_FAR = 1e-3
"""Way, in standard errors, over which the gradient of what integrating the states out adds is kept: it turns with the
logarithm of the information, so that the estimate is off by that way over the root of the samples.
"""
_TOO_SHORT = 1e-2
"""Length of a step, in standard errors, below which the merit cannot judge it beside process noise: the states follow
the objective alone, and where they are not quite there the determinant may rise as they go.
"""
_BLIND_STEPS = 4
"""Steps shorter than _NEAR standard errors that are taken against the merit (watchdog technique,
Chamberlain et al. 1982): a kink, such as a knot that passes a sample, raises the violation for one step only.
"""


@dataclass(frozen=True)
class Iteration:
    """One step of the search."""

    iteration: int  # number of the step, from 1
    cost: float  # NLLF of Eq. 3.10 (E8) after it
    violation: float  # mean violation of the dynamics, in sizes of the states
    step_length: float  # length of the step, in standard errors (root mean square)
    fraction: float  # fraction of the step that was taken


@dataclass(frozen=True)
class Options:
    """How the search runs; see `fit`."""

    max_iterations: int  # limit of Gauss-Newton steps
    tolerance: float  # step, as a fraction of the standard errors, at which the search ends
    estimate_noise: bool  # whether the measurement noise is estimated
    estimate_process_noise: bool  # whether the process noise is, too
    report: Report = silent  # called after each iteration


@dataclass(frozen=True)
class SearchOutcome:
    """Where the search ended and how."""

    problem: Setup  # the problem, with the process noise as estimated
    iterate: Iterate  # where the search ended
    status: Status  # how it ended
    message: str  # the same in words, with cause and remedy
    history: tuple[Iteration, ...]  # every iteration
    segments: Segments = ()  # the sensitivities of the last step, where it was negligible and they still hold


def search(problem: Setup, iterate: Iterate, options: Options) -> SearchOutcome:
    """Iterate until the step is a small fraction of the standard errors and the dynamics hold."""
    if options.estimate_process_noise:
        problem, iterate = _noise_first(problem, iterate, options)
    history: list[Iteration] = []
    penalty, blind, creeping = 0.0, _BLIND_STEPS, 0
    noisy = bool(np.any(problem.process_noise))
    near: tuple[Linearisation, ...] = ()
    gradient = None  # of the determinant; how far, in standard errors, the search has gone since it and `near`
    since_gradient = since_near = np.inf
    extrapolation = gauss_newton.Extrapolation(problem)
    known: Segments = ()  # the sensitivities where the search is, if the noise needed them

    def ended(status: Status, detail: str = "") -> SearchOutcome:
        message = f"{detail}: {status.message}" if detail else status.message
        return SearchOutcome(problem, iterate, status, message, tuple(history))

    for iteration in range(1, options.max_iterations + 1):
        try:
            if not (known or (since_near <= _KEPT * options.tolerance and not noisy)):
                near, since_near = gauss_newton.linearised(problem, iterate), 0.0
            segments, unseen = (known, None) if known else _sensitivities(problem, iterate, near)
        except SingularStatesError as error:
            return ended(_singular(error), str(error))
        if noisy and not since_gradient <= _FAR:
            here = [(problem.process_noise, iterate.variance)]
            gradient, since_gradient = determinant_gradients(problem, iterate, segments, here)[0], 0.0
        step = gauss_newton.gauss_newton_step(problem, iterate, segments, gradient)
        since_gradient, since_near = since_gradient + step.length, since_near + step.length
        if not np.isfinite(step.length):
            return ended(Status.DIVERGED)
        penalty = max(penalty, 1.5 * step.multiplier)
        further = extrapolation.improved(iterate, step)
        if further is not step or (noisy and step.length < _TOO_SHORT):  # the merit cannot resolve it
            following, fraction = moved(problem, iterate, further, 1.0), 1.0
        else:
            terms = (partial(determinant, problem),) if noisy else ()
            following, fraction = gauss_newton.line_search(problem, iterate, step, penalty, *terms)
        if fraction == 0.0:
            if step.length > _NEAR or blind == 0:
                return ended(Status.STALLED)
            blind -= 1
            following, fraction = moved(problem, iterate, step, 1.0), 1.0
        creeping = creeping + 1 if fraction < _CREEP and step.length < 1.0 else 0
        if creeping == _CREEPING_STEPS:
            return ended(Status.STALLED)
        problem, iterate, known, noise_converged = _with_noise(problem, following, options, step.length)
        violation = objective(problem, iterate)[1] / sum(x.size for x in iterate.x)
        cost = negative_log_likelihood(np.concatenate(residuals(problem, iterate), axis=1), iterate.variance)
        if noisy:  # of the states integrated out
            cost += disturbance_cost(problem, iterate) + determinant(problem, iterate)
        history.append(Iteration(iteration, cost, violation, step.length, fraction))
        options.report(None, f"iteration {iteration}: NLLF {history[-1].cost:.6g}, step {step.length:.2g}")
        if step.length < options.tolerance and noise_converged and violation < _FEASIBLE:
            if unseen is not None:
                return ended(_singular(unseen), str(unseen))
            return replace(ended(Status.CONVERGED), segments=segments)
        del segments, step  # not kept beside the next
    return ended(Status.ITERATION_LIMIT)


def _singular(error: SingularStatesError) -> Status:
    return Status.STIFF if error.stiff else Status.UNDETERMINED


def residuals(problem: Setup, iterate: Iterate) -> tuple[FloatArray, ...]:
    """Measured minus predicted output of each segment, (n_outputs, n); nan in gaps."""
    theta, segments = problem.parameters.as_mapping(iterate.theta), zip(problem.grids, iterate.x, strict=True)
    return tuple(grid.y - evaluate_segment(problem.model, grid, x, theta)[1].T for grid, x in segments)


def _sensitivities(
    problem: Setup, iterate: Iterate, near: Sequence[Linearisation]
) -> tuple[Segments, SingularStatesError | None]:
    """The sensitivities by derivatives from `near`, initial states anchored where no output sees them yet; and why."""
    theta, segments = problem.parameters.as_mapping(iterate.theta), zip(problem.grids, iterate.x, near, strict=True)
    here = ((each, evaluate_segment(problem.model, grid, x, theta)) for grid, x, each in segments)
    linear = [replace(each, defect=defect, output=output) for each, (defect, output) in here]
    try:
        return sensitivities(problem, iterate, linear), None
    except SingularStatesError as error:
        return sensitivities(problem, iterate, linear, anchored=True), error


def _noise_first(problem: Setup, iterate: Iterate, options: Options) -> tuple[Setup, Iterate]:
    """Variances brought near with theta fixed, process noise first: beside too much of it, no other shows."""
    for estimate_noise in (False, options.estimate_noise):
        for _ in range(_NOISE_STEPS):
            linear = gauss_newton.linearised(problem, iterate)
            try:
                wanted = directions_of(problem, estimate_noise, options.estimate_process_noise)
                found, lengths = scored(problem, iterate, wanted, _NEAR_NOISE, linear)
            except SingularStatesError:
                return problem, iterate  # the search says so if they stay undetermined
            problem = found.problem
            step = gauss_newton.gauss_newton_step(problem, found.iterate, found.segments, frozen=True)
            iterate = moved(problem, found.iterate, step, 1.0)
            unforeseen = abs(objective(problem, iterate)[0] - step.cost - step.decrease)
            if lengths[-1] < _NEAR_NOISE and unforeseen < _LINEAR:
                break
    return problem, iterate


def _with_noise(
    problem: Setup, iterate: Iterate, options: Options, length: float
) -> tuple[Setup, Iterate, Segments, bool]:
    """Both with new variances after a step of this length; the sensitivities there, if known; whether converged."""
    if not np.any(problem.process_noise):
        if not options.estimate_noise:
            return problem, iterate, (), True
        floor = least_variance(np.concatenate([grid.y for grid in problem.grids], axis=1))
        new = estimate_variance(np.concatenate(residuals(problem, iterate), axis=1), floor)
        change = float(np.max(np.abs(new / iterate.variance - 1.0)))
        return problem, replace(iterate, variance=new), (), change < _CONVERGED_CHANGE
    wanted = directions_of(problem, options.estimate_noise, options.estimate_process_noise)
    if not wanted.count:
        return problem, iterate, (), True
    try:
        found, lengths = scored(
            problem, iterate, wanted, max(_FEW, _FRACTION * length), gauss_newton.linearised(problem, iterate)
        )
    except SingularStatesError:
        return problem, iterate, (), True
    return found.problem, found.iterate, found.segments, lengths[0] < _CONVERGED_MOVE
