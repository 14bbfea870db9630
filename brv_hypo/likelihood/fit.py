"""The entrance: `fit`."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import get_args

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.errors import UsageError
from brv_hypo.likelihood.assessment import assess
from brv_hypo.likelihood.collocation import Model, start_points
from brv_hypo.likelihood.derivatives import (
    AnalyticJacobian,
    Derivatives,
    Function,
    Method,
    check_jacobian,
    check_shape,
    choose_method,
    parameter_scales,
    with_jacobian,
)
from brv_hypo.likelihood.gauss_newton import Iterate, Problem
from brv_hypo.likelihood.noise import Kind, least_variance
from brv_hypo.likelihood.parameters import Parameters, build_parameters
from brv_hypo.likelihood.result import FitResult
from brv_hypo.likelihood.search import Options, Progress, search
from brv_hypo.likelihood.segment import Grid, Segment, build_grid, check_consistent, stepped_inputs
from brv_hypo.likelihood.standard_form import (
    Constraint,
    check_constraints,
    completed_result,
    stateless,
    still,
    with_constraints,
    with_still_state,
    without_still_state,
)
from brv_hypo.likelihood.starts import (
    MOST_STEPS,
    FirstNoise,
    begin,
    best_of,
    bridged,
    chosen,
    finer,
    first_noises,
    pieces_of,
    refine,
    state_sizes,
    states_from_outputs,
    stretches,
)


def fit(
    dynamics: Function | None,
    outputs: Function,
    segments: Sequence[Segment],
    theta0: Mapping[str, float],
    process_noise: Sequence[float] | FloatArray | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    *,
    fixed: Collection[str] = (),
    per_segment: Collection[str] = (),
    priors: Mapping[str, tuple[float, float]] | None = None,
    delays: Sequence[str] = (),
    reach: Mapping[str, float] | None = None,
    affine: Collection[str] = (),
    noise: Kind = "diagonal",
    noise_covariance: FloatArray | None = None,
    first_noise: FloatArray | None = None,
    estimate_process_noise: bool = False,
    derivatives: str = "auto",
    dynamics_jacobian: Derivatives | None = None,
    outputs_jacobian: Derivatives | None = None,
    max_iterations: int = 50,
    tolerance: float = 1e-5,
    near_start: bool = False,
    mesh_steps: int | None = None,
    errors: bool = True,
    constraints: Mapping[str, Constraint] | None = None,
    progress: Callable[[Progress], None] | None = None,
) -> FitResult:
    """Maximum-likelihood parameters of x' = f(x, u, theta, t), y = h(x, u, theta, t) + noise, by collocation.

    The states at all samples are unknowns, tied by the dynamics (Hermite-Simpson defects), so that unstable
    motion and poor starts do no harm; cost per iteration is linear in the samples. Initial states are free,
    each segment's own, unless its `x0_std` says otherwise.

    Args:
        dynamics: f(x, u, theta, t) -> (n_states, n), vectorised over samples: x (n_states, n), u (n_inputs,
            n), theta name to value, t (n,), s. Analytic functions that accept complex x and theta get exact
            derivatives; others central differences. None where the model has no states: then x0 is empty, and
            outputs sees x of shape (0, n).
        outputs: h(x, u, theta, t) -> (n_outputs, n).
        segments: the record, in one or more continuous stretches.
        theta0: start values by name; 0 is as good a start as any.
        process_noise: standard deviation of the white noise that drives each state, (n_states,), state units
            per root second; None, or 0 for a state, makes its dynamics exact (output error). Not together with
            `delays`.
        bounds: (lower, upper) by name.
        fixed: names held at their start value.
        per_segment: names that take a value of their own in each segment.
        priors: (mean, standard deviation) by name.
        delays: names whose value is a delay in s. Both functions then take a fifth argument, `delayed`, with
            `delayed[name].x` and `delayed[name].u` the states and inputs that much earlier (later, if
            negative); the derivatives by the delay and by the earlier states are carried in full. Not together
            with process noise.
        reach: largest change in one step by name, for parameters whose effect is linear over a short way only.
        affine: names, time-varying parameters among them, in which both functions are affine, all else held:
        one evaluation gives their
            derivative.
        noise: shape of B, "diagonal" or "full"; or "student": noise with tails, outliers among it, Student's t with
            scale and degrees of freedom of each output found. Not together with process noise.
        noise_covariance: B where it is known, (n_outputs, n_outputs); else it is estimated by Eq. 3.11. Where the
            residuals are then not white, the search begins again from other first guesses of it, and the best
            likelihood wins (`starting_points`).
        first_noise: B that the search begins from with `near_start`, as an earlier fit left it.
        estimate_process_noise: take `process_noise` as a start and estimate its nonzero entries too.
        derivatives: "auto", "complex" or "central".
        dynamics_jacobian: derivatives of the dynamics, where they are known: (x, u, theta, t) -> pair of those by
            states (n_states, n_states, n), and a mapping of parameters, time-varying and constrained ones among
            them, to (n_states, n). By parameters that are left out differences are taken. Checked against
            differences at the start. Not together with delays.
        outputs_jacobian: the same of the outputs.
        max_iterations: limit of Gauss-Newton steps.
        tolerance: step, as a fraction of the standard errors, at which the search ends.
        near_start: theta0 and the x0 histories are near the solution, from an earlier fit say: the search
            begins there, without the steps that bring a poor start near.
        mesh_steps: steps of the dynamics between samples; None raises them from 1 until the estimated effect of the
            discretisation is below a tenth of every standard error, and says so in the status where 32 are not
            enough; with `near_start` it stays at 1.
        errors: False leaves the errors of the estimates unknown, which saves a linearisation where the search ends
            before it converges.
        constraints: parameters that follow from others, constrained ones before them included, name to function
        of the others by
            name; the functions see them in theta, the result carries them with their errors.
        progress: called after each iteration.

    Returns:
        The estimate, its errors and a status; failure to converge is a status, not an exception.

    Raises:
        UsageError: arguments that do not fit together: shapes, names, bounds, delays or tails with process noise,
            jacobians that differ from differences, functions that are not finite at the start.
    """
    if mesh_steps is not None and mesh_steps < 1:
        raise UsageError(f"mesh_steps is {mesh_steps}; expected at least 1, or None to have it chosen")

    _check_noise(noise, process_noise)
    options = Options(
        max_iterations=max_iterations,
        tolerance=tolerance,
        noise="full" if noise == "full" else "diagonal",
        student=noise == "student",
        errors=errors,
        estimate_noise=noise_covariance is None,
        estimate_process_noise=estimate_process_noise,
        progress=progress,
    )
    constraints = dict(constraints or {})
    check_constraints(constraints, theta0, per_segment)
    if delays and not (dynamics_jacobian is None and outputs_jacobian is None):
        raise UsageError(
            f"jacobians were given together with delays {list(delays)}: they know nothing of delayed states. Leave "
            "them out"
        )
    motion = with_jacobian(dynamics or still, dynamics_jacobian, "dynamics")
    observation = with_jacobian(outputs, outputs_jacobian, "outputs")
    if dynamics is None:
        segments, observation = with_still_state(segments), stateless(observation)
    task = _Task(
        with_constraints(motion, constraints), with_constraints(observation, constraints), theta0,
        process_noise, dict(bounds or {}),
        tuple(fixed), tuple(per_segment), dict(priors or {}), tuple(delays), dict(reach or {}), frozenset(affine),
        noise_covariance, first_noise, derivatives, near_start, options,
    )  # fmt: skip
    if mesh_steps is None and not near_start:
        task = replace(task, options=replace(options, draft=True))
        result = refine(segments, task.solve, None if per_segment else task.follow)
    else:
        steps = mesh_steps or 1
        meshed = [finer(s, i, steps) for i, s in enumerate(segments)] if steps > 1 else segments
        result = task.solve(meshed, steps)
    result = replace(result, remarks=(*result.remarks, *stepped_inputs(segments)))
    return completed_result(result if dynamics is not None else without_still_state(result), constraints)


@dataclass(frozen=True)
class _Task:
    """All that `fit` was asked for but the segments, which may come on several meshes."""

    dynamics: Function
    outputs: Function
    theta0: Mapping[str, float]
    process_noise: Sequence[float] | FloatArray | None
    bounds: Mapping[str, tuple[float, float]]
    fixed: tuple[str, ...]
    per_segment: tuple[str, ...]
    priors: Mapping[str, tuple[float, float]]
    delays: tuple[str, ...]
    reach: Mapping[str, float]
    affine: frozenset[str]
    noise_covariance: FloatArray | None
    first_noise: FloatArray | None
    derivatives: str
    near_start: bool
    options: Options

    def follow(self, segments: Sequence[Segment], steps: int, before: FitResult) -> FitResult:
        """The fit from where one on another mesh ended."""
        theta = {name: before.theta[name] for name in self.theta0}
        driving = None if self.process_noise is None else before.process_noise
        near = replace(self, theta0=theta, process_noise=driving, first_noise=before.noise_covariance, near_start=True)
        return near._solve(segments, steps)[0]

    def solve(self, segments: Sequence[Segment], steps: int) -> FitResult:
        """The fit on one mesh; across long gaps once more from the stretches between them."""
        found, model = self._solve(segments, steps)
        smoothed = self.process_noise is not None and bool(np.any(self.process_noise))  # bridges gaps itself
        plain = not (self.near_start or self.per_segment or self.delays or smoothed)
        between = stretches(segments) if plain else ()
        if not between:
            return found
        pieces = pieces_of(segments, between)
        part, _ = self._solve(pieces, steps)
        if not part.converged:
            return found
        times = [np.asarray(piece.t, dtype=float)[::steps] for piece in pieces]
        theta = {name: part.theta[name] for name in self.theta0}
        whole = bridged(segments, between, times, part.states, model, theta)
        again, _ = replace(self, theta0=theta, near_start=True)._solve(whole, steps)
        return chosen([("the whole record", found), ("the stretches between gaps", again)])

    def _solve(self, segments: Sequence[Segment], steps: int) -> tuple[FitResult, Model]:
        grids = tuple(build_grid(segment, s) for s, segment in enumerate(segments))
        if not grids:
            raise UsageError("no segments were given; expected at least one")
        check_consistent(grids)
        limits = _delay_bounds(self.delays, grids) | dict(self.bounds)
        parameters = build_parameters(
            self.theta0, len(grids), limits, self.priors, self.fixed, self.per_segment
        )
        model = _model(
            self.dynamics, self.outputs, grids, parameters, self.delays, self.derivatives, self.affine
        )
        histories = states_from_outputs(model, grids, parameters, parameters.start)
        n_states = grids[0].start.shape[0]
        driving = _driving(self.process_noise, n_states)
        _refuse_late_process_noise(self.delays, driving)
        problem = Problem(
            model, grids, parameters, state_sizes(histories), driving, parameters.spread(self.reach, np.inf)
        )
        y = np.concatenate([g.y for g in grids], axis=1)
        draft = self.options.draft and steps < MOST_STEPS
        options = replace(self.options, floor=least_variance(y), mesh_steps=steps, draft=draft)

        known = None if self.noise_covariance is None else _known_covariance(self.noise_covariance, len(y))

        def run(first: FloatArray) -> FitResult:
            begun, iterate = begin(problem, Iterate(histories, parameters.start, first), self.near_start)
            if known is not None:
                iterate = replace(iterate, covariance=known)
            return assess(search(begun, iterate, options), options)

        noises = first_noises(y)
        if known is not None:
            noises = (FirstNoise("the noise that was given", known), *noises)
        if self.near_start and self.first_noise is not None:
            noises = (FirstNoise("an earlier fit", _known_covariance(self.first_noise, len(y))), *noises)
        tried = noises[:1] if self.near_start else noises
        return best_of(tried, run, y.shape[1], known is not None), model


def _check_noise(noise: str, process_noise: Sequence[float] | FloatArray | None) -> None:
    if noise not in get_args(Kind):
        raise UsageError(f"noise is {noise!r}; expected one of {list(get_args(Kind))}")
    if noise == "student" and process_noise is not None and np.any(process_noise):
        raise UsageError(
            f"noise 'student' was given together with process noise {process_noise}: the likelihood of states that "
            "noise drives is had for Gaussian noise only. Leave process_noise out, or mark outliers as nan in y"
        )


def _driving(process_noise: Sequence[float] | FloatArray | None, n_states: int) -> FloatArray:
    """Process noise of each state, (n_states,)."""
    driving = np.zeros(n_states) if process_noise is None else np.asarray(process_noise, dtype=float)
    if driving.shape != (n_states,) or np.any(driving < 0):
        raise UsageError(
            f"process_noise is {driving}; expected {n_states} values, one per state, none negative"
        )
    return driving


def _known_covariance(given: FloatArray, n_outputs: int) -> FloatArray:
    """B as given, (n_outputs, n_outputs)."""
    found = np.asarray(given, dtype=float)
    square = (
        found.shape == (n_outputs, n_outputs) and np.all(np.isfinite(found)) and np.allclose(found, found.T)
    )
    if not square or np.linalg.eigvalsh(found)[0] <= 0.0:
        raise UsageError(
            f"noise_covariance is {found.tolist()}; expected a symmetric positive-definite matrix of shape "
            f"{(n_outputs, n_outputs)}: variances of the outputs' noise on the diagonal. Noise-free outputs get a "
            "small variance, such as that of rounding"
        )
    return found


def _refuse_late_process_noise(delays: Sequence[str], driving: FloatArray) -> None:
    """The filter's state would have to hold all that lies within the delay; it holds one sample."""
    if delays and np.any(driving):
        raise UsageError(
            f"delays {list(delays)} were given together with process noise {driving}: the likelihood of delayed "
            "states that noise drives is not implemented. Leave process_noise out (output error, whose coloured "
            "residuals std_error_coloured accounts for), or hold the delay: without it in `delays`, pass the "
            "delayed quantity, taken from the measurements, as an input u"
        )


def _delay_bounds(delays: Sequence[str], grids: tuple[Grid, ...]) -> dict[str, tuple[float, float]]:
    """A delay may reach over a quarter of the shortest segment, either way, where the user set no bounds."""
    longest = min(float(g.step.sum()) for g in grids) / 4
    return dict.fromkeys(delays, (-longest, longest))


def _model(
    dynamics: Function,
    outputs: Function,
    grids: tuple[Grid, ...],
    parameters: Parameters,
    delays: tuple[str, ...],
    derivatives: str,
    affine: frozenset[str],
) -> Model:
    """The functions, checked at the start values, with their way of differentiation."""
    theta = parameters.of_segment(0, parameters.start)
    unknown = sorted(set(delays) - set(theta))
    if unknown:
        raise UsageError(f"delays names {unknown}, which theta0 does not have; it has {sorted(theta)}")
    if derivatives not in ("auto", "complex", "central"):
        raise UsageError(f"derivatives is {derivatives!r}; expected 'auto', 'complex' or 'central'")
    for s, grid in enumerate(grids):
        points = start_points(grid, parameters.of_segment(s, parameters.start), delays)
        check_shape(dynamics, points, theta, grid.start.shape[0], "dynamics")
        check_shape(outputs, points, theta, grid.y.shape[0], "outputs")
    functions = (dynamics, outputs)
    points = start_points(grids[0], theta, delays)
    scale = parameter_scales(functions, points, theta, parameters.base, parameters.priors)
    method: Method = "central" if derivatives == "central" else "complex"
    if derivatives == "auto":
        method = choose_method(functions, points, theta, parameters.base, scale)
    for function in functions:
        if isinstance(function, AnalyticJacobian):
            check_jacobian(function, points, theta, parameters.base, method, scale)
    return Model(dynamics, outputs, delays, method, scale, affine)
