"""One Gauss-Newton step in parameters and states, and how far to go along it.

The states of each segment are eliminated first (`elimination`), which leaves a small bounded least-squares problem in
theta with its priors; the states then follow. The line search weighs the objective against the violation of the
dynamics. Slow steps, which a model that is not quite right makes, are extrapolated from what the last steps did to each
other (Anderson, J. ACM 12 (1965) 547). Entrances: `linearised`, `gauss_newton_step`, `line_search`, `Extrapolation`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.likelihood.collocation import Linearisation, System, evaluate_segment, linearise_segment
from brv_hypo.likelihood.elimination import Quadratic, Segments, block_rows, eliminate, upper_triangle
from brv_hypo.likelihood.segment import Grid, Parameters
from brv_hypo.likelihood.statistics import whitening

if TYPE_CHECKING:
    from scipy.sparse import csr_array


_RANK_TOLERANCE = 1e-10  # of the largest: directions of the column-scaled sensitivities below are left at rest
_STIFF = 1e6
"""Derivative of a state by the one a step earlier, in their sizes, from which the slow motion is lost beside the fast.
"""
_ANCHOR = 10.0  # standard deviation, in sizes of the state, by which an anchored initial state may move in one step
_HALVINGS = 12
_SUFFICIENT = 1e-4  # fraction of the promised decrease that must come true


@dataclass(frozen=True)
class Setup:
    """All that stays the same during a fit."""

    model: System  # the user's functions
    grids: tuple[Grid, ...]  # the segments
    parameters: Parameters  # the free parameters
    size: FloatArray  # magnitude of each state, (n_states,)
    process_noise: FloatArray  # what drives each state, (n_states,), per root second; 0: its dynamics hold exactly
    reach: FloatArray  # largest change of each parameter in one step, (p,); mostly infinite


@dataclass(frozen=True)
class Iterate:
    """An iterate of the search: states by segment, (n_states, n), theta, (p,), variances of the noise, (n_outputs,)."""

    x: tuple[FloatArray, ...]
    theta: FloatArray
    variance: FloatArray


@dataclass(frozen=True)
class NewtonStep:
    """A Gauss-Newton step, and what it promises."""

    theta: FloatArray  # change of the parameters, (p,)
    x: tuple[FloatArray, ...]  # change of the states of each segment, (n_states, n)
    triangle: FloatArray  # factor T of the information matrix T'T, priors left out, (p, p)
    length: float  # length of the step in standard errors (root mean square)
    multiplier: float  # largest scaled multiplier of the dynamics
    decrease: float  # promised change of the objective, <= 0
    cost: float  # objective where the step begins
    violation: float  # violation of the dynamics there


class SingularStatesError(ArithmeticError):
    """The states of a segment cannot be determined from its outputs, if `stiff` perhaps for rounding alone."""

    def __init__(self, segment: int, stiff: bool = False) -> None:
        what = "lost in rounding, its dynamics being stiff" if stiff else "not determined by its outputs"
        super().__init__(f"the states of segment {segment} are {what}")
        self.stiff = stiff


def linearised(problem: Setup, iterate: Iterate) -> tuple[Linearisation, ...]:
    """Every segment about the iterate."""
    theta, names = problem.parameters.as_mapping(iterate.theta), problem.parameters.names
    segments = zip(problem.grids, iterate.x, strict=True)
    return tuple(linearise_segment(problem.model, grid, x, theta, names) for grid, x in segments)


def sensitivities(
    problem: Setup, iterate: Iterate, linear: Sequence[Linearisation] | None = None, *, anchored: bool = False
) -> Segments:
    """Every segment with its states eliminated; `linear` is the linearisation about the iterate, where it is known.
    `anchored` ties a free initial state loosely to its value, for a start at which no output observes it yet. Raises
    SingularStatesError where the outputs leave a state undetermined.
    """
    linear = linearised(problem, iterate) if linear is None else linear
    found = []
    for s, (grid, x, each) in enumerate(zip(problem.grids, iterate.x, linear, strict=True)):
        quadratic = quadratic_of(problem, grid, x, each, iterate.variance)
        if anchored:
            free = np.isinf(quadratic.variance)
            defect, variance = np.where(free, 0.0, quadratic.defect), np.where(free, _ANCHOR**2, quadratic.variance)
            quadratic = replace(quadratic, defect=defect, variance=variance)
        eliminated = eliminate(quadratic)
        if eliminated is None:
            raise SingularStatesError(s, float(abs(quadratic.defect_by_state).max()) > _STIFF)
        found.append(eliminated)
    return tuple(found)


def information_factor(segments: Segments, p: int) -> FloatArray:
    """Upper triangle of [J_p r] over all segments, (p + 1, p + 1), of all p parameters."""
    if len(segments) == 1:
        return segments[0].triangle
    rows = [np.zeros((len(segment.triangle), p + 1)) for segment in segments]
    for into, segment in zip(rows, segments, strict=True):
        into[:, np.append(segment.problem.own, p)] = segment.triangle
    return upper_triangle(np.concatenate(rows))


def gauss_newton_step(
    problem: Setup, iterate: Iterate, segments: Segments, gradient: FloatArray | None = None, frozen: bool = False
) -> NewtonStep:
    """The linearised problem's least step within bounds; `gradient` (p,): of a further term; `frozen`: theta stays."""
    parameters = problem.parameters
    p = len(parameters.names)
    data = information_factor(segments, p)
    weight = 1.0 / parameters.prior_std
    deviation = np.where(weight > 0.0, iterate.theta - parameters.prior_mean, 0.0)
    prior = np.column_stack([np.diag(weight), weight * deviation])
    system = np.concatenate([data, prior[weight > 0.0]])
    slope = np.zeros(p) if gradient is None else gradient
    tilted = system.copy()
    if gradient is not None:
        tilted[:p, p] += np.linalg.lstsq(data[:p, :p].T, slope, rcond=None)[0]
    change = np.zeros(p) if frozen else _bounded_least_squares(tilted, problem, iterate.theta)
    x, multiplier = [], 0.0
    for segment in segments:
        weights = np.append(1.0, change[segment.problem.own])
        x.append((segment.x @ weights).T * problem.size[:, None])
        multiplier = max(multiplier, float(np.abs(segment.multiplier @ weights).max()))
    promised = 0.5 * float(np.sum((system[:, :p] @ change + system[:, p]) ** 2)) + float(slope @ change)
    cost, violation = objective(problem, iterate)
    return NewtonStep(
        theta=change,
        x=tuple(x),
        triangle=data[:p, :p],
        length=float(np.linalg.norm(system[:, :p] @ change) / np.sqrt(p)),
        multiplier=multiplier,
        decrease=promised - cost,
        cost=cost,
        violation=violation,
    )


def objective(problem: Setup, iterate: Iterate) -> tuple[float, float]:
    """Half the sum of squares of outputs, process noise and priors; violation of the constraints, L1 norm, scaled."""
    total, violation = 0.0, 0.0
    for grid, x in zip(problem.grids, iterate.x, strict=True):
        theta = problem.parameters.as_mapping(iterate.theta)
        defect, output = evaluate_segment(problem.model, grid, x, theta)
        residual = _whitened(whitening(iterate.variance, grid.measured), grid, output)
        scaled = np.concatenate([start_defect(problem, grid, x), defect / problem.size])
        variance = _variance(problem, grid)
        tight = variance == 0
        loose = ~tight & np.isfinite(variance)
        total += 0.5 * float(np.sum(residual**2)) + 0.5 * float(np.sum(scaled[loose] ** 2 / variance[loose]))
        violation += float(np.sum(np.abs(scaled[tight])))
    parameters = problem.parameters
    deviation = (iterate.theta - parameters.prior_mean) / parameters.prior_std
    return total + 0.5 * float(np.sum(deviation**2)), violation


def moved(problem: Setup, iterate: Iterate, step: NewtonStep, fraction: float) -> Iterate:
    """The iterate a fraction of the step further, inside the bounds."""
    theta = np.clip(iterate.theta + fraction * step.theta, problem.parameters.lower, problem.parameters.upper)
    return replace(iterate, theta=theta, x=tuple(x + fraction * dx for x, dx in zip(iterate.x, step.x, strict=True)))


def quadratic_of(problem: Setup, grid: Grid, x: FloatArray, linear: Linearisation, variance: FloatArray) -> Quadratic:
    """One segment's linearisation with outputs whitened, by their `variance`, and states divided by their size. Delays
    meet process noise on the way to a start only, whose states are near: what they see is fixed then.
    """
    size, weight = problem.size, whitening(variance, grid.measured)
    dynamics = block_rows(linear.defect_by_state / size[:, None] * size)
    outputs = block_rows((weight[:, :, None] * linear.output_by_state * size)[:, None])
    delayed = not np.any(problem.process_noise)
    if delayed and linear.defect_by_delayed is not None:
        dynamics = dynamics + _turned(linear.defect_by_delayed, np.tile(1.0 / size, grid.n - 1), size)
    if delayed and linear.output_by_delayed is not None:
        outputs = outputs + _turned(linear.output_by_delayed, weight.ravel(), size)
    by_parameter = linear.defect_by_parameter / size[:, None]
    return Quadratic(
        own=linear.own,
        residual=_whitened(weight, grid, linear.output),
        by_state=outputs,
        by_parameter=weight[:, :, None] * linear.output_by_parameter,
        defect=np.concatenate([start_defect(problem, grid, x), linear.defect / size]),
        defect_by_state=dynamics,
        defect_by_parameter=np.concatenate([np.zeros_like(by_parameter[:1]), by_parameter]),
        variance=_variance(problem, grid),
        delayed=delayed and bool(problem.model.delays),
    )


def _turned(matrix: csr_array[np.float64], left: FloatArray, size: FloatArray) -> csr_array[np.float64]:
    """The rows times `left`, the columns times the size of their state."""
    from scipy.sparse import csr_array, diags_array  # here, for a cheap import of the package

    right = np.tile(size, matrix.shape[1] // size.size)
    return csr_array(diags_array(left) @ matrix @ diags_array(right))


def _whitened(weight: FloatArray, grid: Grid, output: FloatArray) -> FloatArray:
    """Whitened predicted minus measured output, (n, n_outputs), zero in gaps."""
    return weight * np.where(grid.measured.T, output - grid.y.T, 0.0)


def start_defect(problem: Setup, grid: Grid, x: FloatArray) -> FloatArray:
    """Initial state less its guess, in its size, (1, n_states)."""
    return ((x[:, 0] - grid.first) / problem.size)[None]


def _variance(problem: Setup, grid: Grid) -> FloatArray:
    """Diagonal of Q in scaled states, (n, n_states); row 0 is the initial state's."""
    noise = problem.process_noise**2 * grid.step[:, None]
    return np.concatenate([grid.start_std[None] ** 2, noise]) / problem.size**2


def _bounded_least_squares(system: FloatArray, problem: Setup, theta: FloatArray) -> FloatArray:
    """Minimise |A d + b|, [A b] = `system`, within the bounds and the reach of a step; near-null directions rest."""
    from scipy.linalg import lstsq  # here, for a cheap import of the package

    p = theta.size
    norm = np.linalg.norm(system[:, :p], axis=0)
    norm[norm == 0] = 1.0
    matrix, right = system[:, :p] / norm, -system[:, p]
    change = lstsq(matrix, right, _RANK_TOLERANCE, lapack_driver="gelsy")[0] / norm
    lower = np.maximum(problem.parameters.lower - theta, -problem.reach)
    upper = np.minimum(problem.parameters.upper - theta, problem.reach)
    if np.all(change >= lower) and np.all(change <= upper):
        return np.asarray(change)
    from scipy.optimize import lsq_linear

    # Few are bounded: the others follow them, so that every step within the bounds is of those few alone.
    held = np.isfinite(lower) | np.isfinite(upper)
    both = np.column_stack([right, matrix[:, held]])
    follow = lstsq(matrix[:, ~held], both, _RANK_TOLERANCE, lapack_driver="gelsy")[0]
    rest = both - matrix[:, ~held] @ follow
    bounds = (np.minimum(lower, 0.0) * norm)[held], (np.maximum(upper, 0.0) * norm)[held]
    change[held] = lsq_linear(rest[:, 1:], rest[:, 0], bounds, method="bvls").x
    change[~held] = follow @ np.append(1.0, -change[held])
    return np.asarray(change / norm)


def line_search(
    problem: Setup, iterate: Iterate, step: NewtonStep, penalty: float, term: Callable[[Iterate], float] = lambda _: 0.0
) -> tuple[Iterate, float]:
    """Halve the step until the merit (objective, penalty times violation, `term`) falls enough; fraction 0 if never."""
    merit = step.cost + penalty * step.violation + term(iterate)
    slope = step.decrease - penalty * step.violation
    slack = 1e-10 * (1.0 + abs(merit))
    for fraction in 0.5 ** np.arange(_HALVINGS):
        trial = moved(problem, iterate, step, fraction)
        with np.errstate(all="ignore"):
            trial_cost, trial_violation = objective(problem, trial)
            trial_merit = trial_cost + penalty * trial_violation + term(trial)
        if np.isfinite(trial_merit) and trial_merit <= merit + _SUFFICIENT * fraction * slope + slack:
            return trial, float(fraction)
    return iterate, 0.0


# ---- Extrapolation of slow Gauss-Newton steps (Anderson, J. ACM 12 (1965) 547) ----


_NEAR = 0.5  # length of a step, in standard errors, below which it is extrapolated: farther away nothing is linear
_SLOW = 0.3  # ratio of successive lengths above which steps are slow
_WORSE = 2.0  # ratio above which an extrapolation did harm, and the memory is cleared
_MEMORY = 5  # steps remembered
_INDEPENDENT = 1e-8  # singular value, against the largest, of differences of steps below which they add nothing new


@dataclass
class Extrapolation:
    """Remembers iterates and their steps; none where process noise has variances of its own to converge."""

    problem: Setup
    _past: list[tuple[Iterate, NewtonStep]] = field(default_factory=list)

    def improved(self, iterate: Iterate, step: NewtonStep) -> NewtonStep:
        """The step as it is, or the one that the last steps together promise to leave the least of."""
        before = self._past[-1][1].length if self._past else np.inf
        far = bool(np.any(self.problem.process_noise)) or step.length > _NEAR
        if far or step.length > _WORSE * before:
            self._past.clear()
        if far:
            return step
        self._past = [*self._past[-_MEMORY:], (iterate, step)]
        if len(self._past) < 2 or step.length < _SLOW * before:
            return step
        weigh = np.concatenate([step.triangle, np.diag(1.0 / self.problem.parameters.prior_std)])  # by information
        differences = weigh @ np.diff(np.stack([each.theta for _, each in self._past], axis=1), axis=1)
        left, singular, rotation = np.linalg.svd(differences, full_matrices=False)
        kept = singular > _INDEPENDENT * singular.max(initial=0.0)
        share = rotation[kept].T @ ((left[:, kept].T @ (weigh @ step.theta)) / singular[kept])
        theta, x = step.theta.copy(), [each.copy() for each in step.x]
        for (old, old_step), (new, new_step), weight in zip(self._past, self._past[1:], share, strict=False):
            theta -= weight * (new.theta - old.theta + new_step.theta - old_step.theta)
            for s, into in enumerate(x):
                into -= weight * (new.x[s] - old.x[s] + new_step.x[s] - old_step.x[s])
        within = np.all(np.abs(theta) <= self.problem.reach)
        return replace(step, theta=theta, x=tuple(x)) if within else step
