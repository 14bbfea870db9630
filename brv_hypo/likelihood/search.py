"""The search: Gauss-Newton steps, a merit function that weighs fit against violated dynamics, and B by Eq.
3.11.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.likelihood.acceleration import Extrapolation
from brv_hypo.likelihood.collocation import evaluate_segment
from brv_hypo.likelihood.filtering import (
    determinant_gradient,
    determinant_term,
    disturbance_cost,
)
from brv_hypo.likelihood.merit import line_search
from brv_hypo.likelihood.noise import Shape, estimate_covariance, negative_log_likelihood
from brv_hypo.likelihood.scoring import directions_of, scored
from brv_hypo.likelihood.status import Status
from brv_hypo.likelihood.step import (
    Iterate,
    Parts,
    Problem,
    Sensitivity,
    SingularStatesError,
    Step,
    gauss_newton_step,
    linearised,
    moved,
    objective,
    sensitivities,
)

_FEASIBLE = 1e-7
"""Largest mean scaled defect of a converged trajectory."""
_SETTLED_CHANGE = 2e-3
"""Relative change of a noise variance that counts as settled."""
_SETTLED_MOVE = 0.05
"""The same with process noise, in standard errors of the variances' logarithms."""
_NOISE_STEPS = 10
_NEAR_NOISE = 1.0
"""Steps that bring process noise near its estimate before theta moves, and how near, in standard errors."""
_CREEP = 0.1
_CREEPING_STEPS = 3
"""Fraction of a step shorter than one standard error, and how many of them in a row, that count as no progress."""
_NEAR = 0.3
_HELD = 2.5
"""Way, in tolerances, over which derivatives are held: with them the search ends where residuals are orthogonal to the
derivatives of another place, off by less than that way."""
_HELD_VALUES = 4_000_000
"""Samples times parameters up to which derivatives are kept for that."""
_BLIND_STEPS = 4
"""Steps shorter than _NEAR standard errors that are taken against the merit (watchdog technique,
Chamberlain et al. 1982): a kink, such as a knot that passes a sample, raises the violation for one step only.
"""


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
    estimate_process_noise: bool
    progress: Callable[[Progress], None] | None = None
    mesh_steps: int = 1
    floor: FloatArray = field(default_factory=lambda: np.zeros(0))


@dataclass(frozen=True)
class Outcome:
    """Where the search ended and how; `problem` carries the process noise as estimated.

    `segments` are the sensitivities from which the last step came, where that step was negligible and they
    still hold.
    """

    problem: Problem
    iterate: Iterate
    status: Status
    message: str
    history: tuple[Progress, ...]
    segments: tuple[Sensitivity, ...] = ()


def search(problem: Problem, iterate: Iterate, options: Options) -> Outcome:
    """Iterate until the step is a small fraction of the standard errors and the dynamics hold."""
    if options.estimate_process_noise:
        problem, iterate = _noise_first(problem, iterate, options)
    history: list[Progress] = []
    penalty, blind, creeping = 0.0, _BLIND_STEPS, 0
    derivatives = _HeldDerivatives(problem, _HELD * options.tolerance)
    extrapolation = Extrapolation(problem)

    def ended(status: Status, detail: str = "") -> Outcome:
        message = f"{detail}: {status.message}" if detail else status.message
        return Outcome(problem, iterate, status, message, tuple(history))

    for iteration in range(1, options.max_iterations + 1):
        try:
            segments, unseen = _sensitivities(problem, iterate, derivatives.at(iterate))
        except SingularStatesError as error:
            return ended(_singular(error), str(error))
        step = _step(problem, iterate, segments)
        derivatives.moved(step.length)
        if not np.isfinite(step.length):
            return ended(Status.DIVERGED)
        penalty = max(penalty, 1.5 * step.multiplier)
        term = partial(determinant_term, problem) if np.any(problem.process_noise) else None
        following, fraction = _advanced(problem, iterate, step, extrapolation, penalty, term)
        if fraction == 0.0:
            if step.length > _NEAR or blind == 0:
                return ended(Status.STALLED)
            blind -= 1
            following, fraction = moved(problem, iterate, step, 1.0), 1.0
        creeping = creeping + 1 if fraction < _CREEP and step.length < 1.0 else 0
        if creeping == _CREEPING_STEPS:
            return ended(Status.STALLED)
        problem, iterate, noise_settled = _update_noise(problem, following, options)
        violation = objective(problem, iterate)[1] / sum(x.size for x in iterate.x)
        history.append(
            Progress(
                iteration, negative_log_likelihood_of(problem, iterate), violation, step.length, fraction
            )
        )
        if options.progress is not None:
            options.progress(history[-1])
        if step.length < options.tolerance and noise_settled and violation < _FEASIBLE:
            if unseen is not None:
                return ended(_singular(unseen), str(unseen))
            return replace(ended(Status.CONVERGED), segments=segments)
        del segments, step  # not kept beside the next
    return ended(Status.ITERATION_LIMIT, f"{options.max_iterations} iterations")


def _singular(error: SingularStatesError) -> Status:
    return Status.STIFF if error.stiff else Status.UNDETERMINED


def _advanced(
    problem: Problem,
    iterate: Iterate,
    step: Step,
    extrapolation: Extrapolation,
    penalty: float,
    term: Callable[[Iterate], float] | None,
) -> tuple[Iterate, float]:
    """The whole of a slow step's extrapolation; else as far along the step as the merit falls."""
    further = extrapolation.improved(iterate, step)
    if further is not step:
        return moved(problem, iterate, further, 1.0), 1.0
    return line_search(problem, iterate, step, penalty, term)


def residuals(problem: Problem, iterate: Iterate) -> tuple[FloatArray, ...]:
    """Measured minus predicted output of each segment, (n_outputs, n); nan in gaps."""
    found = []
    for s, (grid, x) in enumerate(zip(problem.grids, iterate.x, strict=True)):
        _, output = evaluate_segment(problem.model, grid, x, problem.parameters.of_segment(s, iterate.theta))
        found.append(grid.y - output.T)
    return tuple(found)


def negative_log_likelihood_of(problem: Problem, iterate: Iterate) -> float:
    """NLLF of Eq. 3.10 (E8) of the residuals; with process noise, of the states integrated out."""
    difference = np.concatenate(residuals(problem, iterate), axis=1)
    fit = negative_log_likelihood(difference, np.isfinite(difference), iterate.covariance)
    if not np.any(problem.process_noise):
        return fit
    return fit + disturbance_cost(problem, iterate) + determinant_term(problem, iterate)


def _step(problem: Problem, iterate: Iterate, segments: tuple[Sensitivity, ...]) -> Step:
    gradient = determinant_gradient(problem, iterate, segments) if np.any(problem.process_noise) else None
    return gauss_newton_step(problem, iterate, segments, gradient)


class _HeldDerivatives:
    """Derivatives of dynamics and outputs, taken anew once the search has gone `far` (standard errors) since.

    Each costs as much as many evaluations. None are held beside process noise, whose states may follow anything.
    """

    def __init__(self, problem: Problem, far: float) -> None:
        self._problem, self._far = problem, far
        samples = sum(grid.n for grid in problem.grids)
        small = samples * len(problem.parameters.base) <= _HELD_VALUES
        self._holds = small and not np.any(problem.process_noise)
        self._known: tuple[Parts, ...] | None = None
        self._way = 0.0

    def at(self, iterate: Iterate) -> tuple[Parts, ...] | None:
        """Those that hold at the iterate; None where none are held."""
        if self._holds and (self._known is None or not self._way < self._far):
            self._known, self._way = linearised(self._problem, iterate), 0.0
        return self._known

    def moved(self, length: float) -> None:
        """The search takes a step of this length, in standard errors."""
        self._way += length


def _sensitivities(
    problem: Problem, iterate: Iterate, held: tuple[Parts, ...] | None
) -> tuple[tuple[Sensitivity, ...], SingularStatesError | None]:
    """The sensitivities, initial states anchored where no output sees them yet; and in that case why."""
    try:
        return sensitivities(problem, iterate, held=held), None
    except SingularStatesError as error:
        return sensitivities(problem, iterate, anchored=True, held=held), error


def _noise_first(problem: Problem, iterate: Iterate, options: Options) -> tuple[Problem, Iterate]:
    """Variances brought near with theta held: far too loose or tight dynamics would lead theta astray.

    Process noise alone at first: beside one that is far too large, measurement noise seems to be none.
    """
    for how in (replace(options, estimate_noise=False), options):
        for _ in range(_NOISE_STEPS):
            try:
                segments = sensitivities(problem, iterate)
            except SingularStatesError:
                return problem, iterate  # the search says so if they stay undetermined
            iterate = moved(problem, iterate, gauss_newton_step(problem, iterate, segments, frozen=True), 1.0)
            problem, iterate, near = _update_noise(problem, iterate, how, _NEAR_NOISE)
            if near:
                break
    return problem, iterate


def _update_noise(
    problem: Problem, iterate: Iterate, options: Options, enough: float = _SETTLED_MOVE
) -> tuple[Problem, Iterate, bool]:
    """Noise covariance by Eq. 3.11 or, with process noise, the variances of both; and whether they have settled."""
    if np.any(problem.process_noise):
        wanted = directions_of(problem, options.noise, options.estimate_noise, options.estimate_process_noise)
        problem, iterate, move = scored(problem, iterate, wanted)
        return problem, iterate, move < enough
    if not options.estimate_noise:
        return problem, iterate, True
    difference = np.concatenate(residuals(problem, iterate), axis=1)
    old = iterate.covariance
    new = estimate_covariance(difference, np.isfinite(difference), options.noise, old, options.floor)
    change = float(np.max(np.abs(np.diag(new) / np.diag(old) - 1.0)))
    return problem, replace(iterate, covariance=new), change < _SETTLED_CHANGE
