"""The search: Gauss-Newton steps, a merit function that weighs fit against violated dynamics, and B by Eq. 3.11."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.likelihood.collocation import evaluate_segment
from brv_hypo.likelihood.merit import line_search
from brv_hypo.likelihood.noise import Shape, estimate_covariance, negative_log_likelihood
from brv_hypo.likelihood.step import (
    Iterate,
    Problem,
    Sensitivity,
    SingularStatesError,
    gauss_newton_step,
    objective,
    sensitivities,
)

Status = Literal["converged", "iteration limit", "stalled", "undetermined", "diverged"]

_FEASIBLE = 1e-7
"""Largest mean scaled defect of a converged trajectory."""


@dataclass(frozen=True)
class Progress:
    """What the progress callback sees after each iteration."""

    iteration: int
    cost: float
    violation: float
    step_length: float
    fraction: float


@dataclass(frozen=True)
class Options:
    """How the search runs; see `fit`."""

    max_iterations: int
    tolerance: float
    noise: Shape
    estimate_noise: bool
    floor: FloatArray
    progress: Callable[[Progress], None] | None = None


@dataclass(frozen=True)
class Outcome:
    """Where the search ended and how."""

    iterate: Iterate
    status: Status
    message: str
    history: tuple[Progress, ...]


def search(problem: Problem, iterate: Iterate, options: Options) -> Outcome:
    """Iterate until the step is a small fraction of the standard errors and the dynamics hold."""
    history: list[Progress] = []
    penalty = 0.0
    for iteration in range(1, options.max_iterations + 1):
        try:
            segments, unseen = _sensitivities(problem, iterate)
        except SingularStatesError as error:
            return Outcome(iterate, "undetermined", _undetermined(error), tuple(history))
        step = gauss_newton_step(problem, iterate, segments)
        if not np.isfinite(step.length):
            return Outcome(iterate, "diverged", _DIVERGED, tuple(history))
        penalty = max(penalty, 1.5 * step.multiplier)
        following, fraction = line_search(problem, iterate, step, penalty)
        if fraction == 0.0:
            return Outcome(iterate, "stalled", _STALLED, tuple(history))
        following, change = _update_noise(problem, following, options)
        cost, violation = likelihood_and_violation(problem, following)
        history.append(Progress(iteration, cost, violation, step.length, fraction))
        if options.progress is not None:
            options.progress(history[-1])
        iterate = following
        settled = step.length < options.tolerance and change < np.sqrt(options.tolerance)
        if settled and fraction == 1.0 and violation < _FEASIBLE:
            if unseen is not None:
                return Outcome(iterate, "undetermined", _undetermined(unseen), tuple(history))
            return Outcome(iterate, "converged", "the step is negligible against the standard errors", tuple(history))
    return Outcome(iterate, "iteration limit", _LIMIT.format(options.max_iterations), tuple(history))


def residuals(problem: Problem, iterate: Iterate) -> tuple[FloatArray, ...]:
    """Measured minus predicted output of each segment, (n_outputs, n); nan in gaps."""
    found = []
    for s, (grid, x) in enumerate(zip(problem.grids, iterate.x, strict=True)):
        _, output = evaluate_segment(problem.model, grid, x, problem.parameters.of_segment(s, iterate.theta))
        found.append(grid.y - output.T)
    return tuple(found)


def likelihood_and_violation(problem: Problem, iterate: Iterate) -> tuple[float, float]:
    """NLLF of Eq. 3.10 (E8) of the residuals, and the mean violation of the dynamics, scaled."""
    difference = np.concatenate(residuals(problem, iterate), axis=1)
    count = sum(x.size for x in iterate.x)
    violation = objective(problem, iterate)[1] / count
    return negative_log_likelihood(difference, np.isfinite(difference), iterate.covariance), violation


def _sensitivities(
    problem: Problem, iterate: Iterate
) -> tuple[tuple[Sensitivity, ...], SingularStatesError | None]:
    """The sensitivities, initial states anchored where no output sees them yet; and in that case why."""
    try:
        return sensitivities(problem, iterate), None
    except SingularStatesError as error:
        return sensitivities(problem, iterate, anchored=True), error


def _update_noise(problem: Problem, iterate: Iterate, options: Options) -> tuple[Iterate, float]:
    """Eq. 3.11, and the largest relative change of a variance."""
    if not options.estimate_noise:
        return iterate, 0.0
    difference = np.concatenate(residuals(problem, iterate), axis=1)
    old = iterate.covariance
    new = estimate_covariance(difference, np.isfinite(difference), options.noise, old, options.floor)
    return replace(iterate, covariance=new), float(np.max(np.abs(np.diag(new) / np.diag(old) - 1.0)))


def _undetermined(error: SingularStatesError) -> str:
    return (
        f"{error}: a state neither shows in an output nor drives one that does. "
        "Measure it, leave it out of the states, or give x0_std so that its start is known"
    )


_DIVERGED = (
    "the step is not finite: the functions overflowed or returned nan. Start nearer to the solution, set bounds, "
    "or check the dynamics for divisions by zero"
)
_STALLED = (
    "no fraction of the step improves the fit: the derivatives are wrong (a function that is not smooth, or not "
    "vectorised over samples) or the start is too far away. Check the functions, or start nearer"
)
_LIMIT = (
    "{} iterations were not enough. Look at the near-null directions in identifiability: parameters that the data do "
    "not separate; fix or bound some, or raise max_iterations"
)
