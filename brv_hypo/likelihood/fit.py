"""`fit`: maximum likelihood of a dynamic model from start values and segments; the entrance of this package."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.errors import UsageError
from brv_hypo.likelihood import starts
from brv_hypo.likelihood.collocation import Function, System, check_shape, choose_method, parameter_scales, start_points
from brv_hypo.likelihood.gauss_newton import Iterate, Setup
from brv_hypo.likelihood.result import FitResult, assess
from brv_hypo.likelihood.search import Options, search
from brv_hypo.likelihood.segment import Grid, Parameters, Segment, build_grid, build_parameters
from brv_hypo.progress import Progress, report_to, silent

_LONGEST = 100_000  # samples up to which a second starting point is tried


def fit(
    dynamics: Function,
    outputs: Function,
    segments: Sequence[Segment],
    theta0: Mapping[str, float],
    process_noise: Sequence[float] | FloatArray | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    *,
    priors: Mapping[str, tuple[float, float]] | None = None,
    delays: Sequence[str] = (),
    reach: Mapping[str, float] | None = None,
    noise: FloatArray | None = None,
    first_noise: FloatArray | None = None,
    estimate_process_noise: bool = False,
    max_iterations: int = 50,
    tolerance: float = 1e-5,
    near_start: bool = False,
    progress: Progress | None = None,
) -> FitResult:
    """Maximum-likelihood parameters of x' = f(x, u, theta, t), y = h(x, u, theta, t) + noise, by collocation.

    The states at all samples are unknowns, tied by the dynamics (Hermite-Simpson defects), so that unstable
    motion and poor starts do no harm; cost per iteration is linear in the samples. Initial states are free,
    each segment's own, unless its `x0_std` says otherwise. Between samples the dynamics take one step, and more until
    the estimated effect of the discretisation is below a tenth of every standard error.

    Parameters
    ----------
    dynamics : callable
        f(x, u, theta, t) -> (n_states, n), vectorised over samples: x (n_states, n), u (n_inputs, n), theta name to
        value, t (n,), s. Analytic functions that accept complex x and theta get exact derivatives; others, and those
        that come as `Differenced`, central differences.
    outputs : callable
        h(x, u, theta, t) -> (n_outputs, n).
    segments, theta0 : sequence of Segment, mapping of str to float
        The record, in one or more continuous stretches; start values by name: 0 is as good a start as any.
    process_noise : array_like, optional
        (n_states,), state units per root second: standard deviation of the white noise that drives each state; None,
        or 0 for a state, makes its dynamics exact (output error). Not together with `delays`.
    bounds, priors : mapping of str to (float, float), optional
        (lower, upper), equal ones holding a parameter at its start value; (mean, standard deviation).
    delays : sequence of str
        Names whose value is a delay in s. Both functions then take a fifth argument, `delayed`, with
        `delayed[name].x` and `delayed[name].u` the states and inputs that much earlier (later, if negative).
    reach : mapping of str to float, optional
        Largest change in one step, for parameters whose effect is linear over a short way only.
    noise : array_like, optional
        (n_outputs,): variances of the outputs' noise, the diagonal of B, where they are known; else they are estimated
        by Eq. 3.11, and where the residuals are not white, the search begins again from other first guesses, and the
        best likelihood wins (`starting_points`).
    estimate_process_noise : bool
        Take `process_noise` as a start and estimate its nonzero entries too.
    max_iterations, tolerance : int, float
        Gauss-Newton steps at most; the step, as a fraction of the standard errors, at which the search ends.
    near_start, first_noise : bool, array, optional
        theta0 and the x0 histories are near the solution, from an earlier fit say: the search begins there, with that
        fit's `noise_variance`, without the steps that bring a poor start near, and with one step between samples.
    progress : callable, rich or tqdm bar, optional
        Called after each iteration with None and a text: `brv_hypo.progress`.

    Returns
    -------
    FitResult
        The estimate, its errors and a status; failure to converge is a status, not an exception.

    Raises
    ------
    UsageError
        Arguments do not fit together: shapes, names, bounds, delays with process noise, infinite at the start.

    Examples
    --------
    >>> import numpy as np
    >>> time = np.arange(40) / 20.0
    >>> segment = Segment(time, np.zeros((0, 40)), np.exp(-0.7 * time)[None], x0=np.ones(1))
    >>> fitted = fit(lambda x, u, theta, t: theta["k"] * x, lambda x, u, theta, t: x, [segment], {"k": 0.0})
    >>> round(fitted.theta["k"], 3)
    -0.7
    """
    options = Options(
        max_iterations=max_iterations,
        tolerance=tolerance,
        estimate_noise=noise is None,
        estimate_process_noise=estimate_process_noise,
        report=silent if progress is None else report_to(progress),
    )
    task = _Task(
        dynamics=dynamics,
        outputs=outputs,
        theta0=theta0,
        process_noise=process_noise,
        bounds=dict(bounds or {}),
        priors=dict(priors or {}),
        delays=tuple(delays),
        reach=dict(reach or {}),
        noise=noise,
        first_noise=first_noise,
        near_start=near_start,
        options=options,
    )
    return task.solve(segments, 1) if near_start else starts.refine(segments, task.solve)


@dataclass(frozen=True)
class _Task:
    """All arguments of `fit` but the segments, which may come on several meshes; see there."""

    dynamics: Function
    outputs: Function
    theta0: Mapping[str, float]
    process_noise: Sequence[float] | FloatArray | None
    bounds: Mapping[str, tuple[float, float]]
    priors: Mapping[str, tuple[float, float]]
    delays: tuple[str, ...]
    reach: Mapping[str, float]
    noise: FloatArray | None  # variances of the measurement noise where they are known
    first_noise: FloatArray | None
    near_start: bool
    options: Options

    def solve(self, segments: Sequence[Segment], steps: int, before: FitResult | None = None) -> FitResult:
        """The fit on a mesh of so many steps between samples, from one on another mesh if there is one, gaps too."""
        if before is not None:
            driving = None if self.process_noise is None else before.process_noise
            near = replace(self._near(before), process_noise=driving, first_noise=before.noise_variance)
            return near._solve(segments, steps)
        found = self._solve(segments, steps)
        driven = self.process_noise is not None and np.any(self.process_noise)
        between = () if self.near_start or self.delays or driven else starts.stretches(segments)
        if not between:
            return found
        pieces = starts.pieces_of(segments, between)
        part = self._solve(pieces, steps)
        if not part.converged:
            return found
        known = [(piece.t[::steps], states) for piece, states in zip(pieces, part.states, strict=True)]
        again = self._near(part)._solve(starts.bridged(segments, between, known), steps)
        return starts.chosen({"the whole record": found, "the stretches between gaps": again})

    def _near(self, found: FitResult) -> _Task:
        return replace(self, theta0={name: found.theta[name] for name in self.theta0}, near_start=True)

    def _solve(self, segments: Sequence[Segment], steps: int) -> FitResult:
        grids = tuple(build_grid(segment, s) for s, segment in enumerate(segments))
        if not grids:
            raise UsageError("no segments were given; expected at least one")
        for what, counts in (
            ("states (rows of x0)", [grid.start.shape[0] for grid in grids]),
            ("inputs (rows of u)", [grid.u.shape[0] for grid in grids]),
            ("outputs (rows of y)", [grid.y.shape[0] for grid in grids]),
        ):
            if len(set(counts)) > 1:
                raise UsageError(
                    f"the segments have {counts} {what}; expected the same number in each, since one model describes "
                    "them all. An output that a segment lacks is a row of NaN"
                )
        # A delay may reach over a quarter of the shortest segment, either way, where the user set no bounds.
        longest = min(float(g.step.sum()) for g in grids) / 4
        limits = dict.fromkeys(self.delays, (-longest, longest)) | dict(self.bounds)
        parameters = build_parameters(self.theta0, limits, self.priors)
        model = self._model(grids, parameters)
        histories = starts.states_from_outputs(model, grids, parameters, parameters.start)
        problem = Setup(
            model=model,
            grids=grids,
            parameters=parameters,
            size=starts.state_sizes(histories),
            process_noise=self._driving(grids[0].start.shape[0]),
            reach=parameters.spread(self.reach, np.inf),
        )
        noises = starts.first_noises(np.concatenate([g.y for g in grids], axis=1))
        known = None if self.noise is None else _variance(self.noise, len(grids[0].y))
        if known is not None:
            noises = {"the noise that was given": known} | noises
        if self.near_start and self.first_noise is not None:
            noises = {"an earlier fit": _variance(self.first_noise, len(grids[0].y))} | noises

        def run(first: FloatArray) -> FitResult:
            begun, iterate = starts.begin(problem, Iterate(histories, parameters.start, first), self.near_start)
            iterate = iterate if known is None else replace(iterate, variance=known)
            return assess(search(begun, iterate, self.options), self.options, steps)

        alone = self.near_start or sum(g.n for g in grids) > _LONGEST
        return starts.best_of(noises, run, alone=alone, known=known is not None)

    def _driving(self, n_states: int) -> FloatArray:
        """Process noise of each state, (n_states,)."""
        driving = np.zeros(n_states) if self.process_noise is None else np.asarray(self.process_noise, dtype=float)
        if driving.shape != (n_states,) or np.any(driving < 0):
            raise UsageError(f"process_noise is {driving}; expected {n_states} values, one per state, none negative")
        if self.delays and np.any(driving):  # the filter's state holds one sample, not all that lies within the delay
            raise UsageError(
                f"delays {list(self.delays)} were given together with process noise {driving}: the likelihood of "
                "delayed states that noise drives is not implemented. Leave process_noise out (output error, whose "
                "coloured residuals std_error_coloured accounts for), or hold the delay: without it in `delays`, pass "
                "the delayed quantity, taken from the measurements, as an input u"
            )
        return driving

    def _model(self, grids: Sequence[Grid], parameters: Parameters) -> System:
        """The functions, checked at the start values, with their way of differentiation."""
        theta = parameters.as_mapping(parameters.start)
        unknown = sorted(set(self.delays) - set(theta))
        if unknown:
            raise UsageError(f"delays names {unknown}, which theta0 does not have; it has {sorted(theta)}")
        model, functions = System(self.dynamics, self.outputs, self.delays), (self.dynamics, self.outputs)
        starts = [start_points(model, grid, theta) for grid in grids]
        for grid, points in zip(grids, starts, strict=True):
            check_shape(self.dynamics, points, theta, grid.start.shape[0], "dynamics")
            check_shape(self.outputs, points, theta, grid.y.shape[0], "outputs")
        priors = {name: std for name, (_, std) in self.priors.items() if np.isfinite(std)}
        scale = parameter_scales(functions, starts[0], theta, parameters.names, priors)
        method = choose_method(functions, starts[0], theta, parameters.names, scale)
        return replace(model, method=method, scale=scale)


def _variance(given: FloatArray, n_outputs: int) -> FloatArray:
    """The variances as given, (n_outputs,)."""
    found = np.asarray(given, dtype=float)
    if found.shape != (n_outputs,) or not np.all((found > 0.0) & np.isfinite(found)):
        raise UsageError(
            f"the noise variances are {found.tolist()}; expected {n_outputs} positive values, one per output. "
            "Noise-free outputs get a small variance, such as that of rounding"
        )
    return found
