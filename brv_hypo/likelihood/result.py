"""The result of a fit: `FitResult`, a table by parameter with a text in the manner of lmfit; `assess` works it out.

At the end of a search `assess` adds standard errors, likelihood, innovations and warnings. The discretisation's effect
on the estimate is part of it. An interval's error is the difference of two quadratures of the slope, Simpson's with the
midpoint of the collocation's cubic and Boole's on a quartic, whose points come from one Picard step from that cubic;
what process noise adds over the interval is no error of the mesh. A change dc of the defects moves the estimate by
-H^-1 L' dc, with L the derivatives of the multipliers by theta (see `elimination`) and H the information.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from brv_hypo.arrays import FloatArray, IntArray
from brv_hypo.likelihood import statistics
from brv_hypo.likelihood.collocation import Method, Points, Values, evaluate
from brv_hypo.likelihood.elimination import Segments
from brv_hypo.likelihood.filter_error import directions_of, kalman_innovations, noise_errors
from brv_hypo.likelihood.gauss_newton import Iterate, Setup, SingularStatesError, information_factor, sensitivities
from brv_hypo.likelihood.search import Iteration, Options, SearchOutcome, Status, residuals
from brv_hypo.likelihood.segment import Grid
from brv_hypo.likelihood.statistics import Identifiability, Whitened, Whiteness, identifiability, whiteness
from brv_hypo.results import Row, Tabular

_LAGS = 20  # lags of the whiteness test
TOLERATED = 0.1  # shift by the mesh, in standard errors, at which it is fine enough
_NOISE_FREE = 1e-4  # residual over signal (rms) below which what is left and not white is no instrument's noise
_ROUNDING = 1e-12  # the same of rounding
_MOST_JUDGED = 8192  # samples of a segment up to which the mesh is judged: longer ones would take hours on finer ones


@dataclass(frozen=True)
class StartingPoint:
    """One search: where its first noise came from, how it ended, and at which log-likelihood."""

    source: str
    status: Status
    log_likelihood: float


@dataclass(frozen=True, eq=False, repr=False)
class FitResult(Tabular):
    """A maximum-likelihood fit; p free parameters in the order of `names`."""

    status: Status  # how the search ended; equals its text, such as "converged"; `status.remedy` says what to try
    message: str  # cause and remedy where it did not converge
    names: tuple[str, ...]  # the free parameters
    theta: dict[str, float]  # estimate by name, those held included
    std_error: dict[str, float]  # by name, residuals taken as white; nan at a bound, or where not determined
    # for coloured residuals (Morelli and Klein 1997): report this one; with process noise, their model, that above
    std_error_coloured: dict[str, float]
    covariance: FloatArray  # (p, p), residuals taken as white
    # minus the NLLF of Eq. 3.10 (E8), -1/2 sum(v' B^-1 v + log det B): without -1/2 N log(2 pi), as in the report
    log_likelihood: float
    noise_variance: FloatArray  # of the measurement noise, (n_outputs,); in output error diagonal of B, Eq. 3.11
    process_noise: FloatArray  # what drives each state, (n_states,), per root second; zeros in output error
    noise_std_error: FloatArray  # of the roots of `noise_variance`; nan where given or 0, and in output error
    process_noise_std_error: FloatArray  # the same of `process_noise`, (n_states,)
    iterations: int  # Gauss-Newton steps taken in theta
    history: tuple[Iteration, ...]  # NLLF, violation of the dynamics, step length and fraction after each iteration
    identifiability: Identifiability  # condition, and near-null directions by name
    whiteness: tuple[Whiteness, ...]  # test of each output's innovations
    states: tuple[FloatArray, ...]  # by segment, (n_states, n)
    innovations: tuple[FloatArray, ...]  # by segment, measured minus predicted output, (n_outputs, n); nan in gaps
    at_bound: tuple[str, ...]  # parameters at a bound: their errors, and what the others mean, are conditional
    derivatives: Method  # how the functions were differentiated
    samples: int  # number of measured values, all outputs and segments
    mesh_shift: float = float("nan")  # of an estimate by the mesh at most, in standard errors; nan where not known
    mesh_steps: int = 1  # steps of the dynamics between samples
    starting_points: tuple[StartingPoint, ...] = ()  # the searches, the first first; this is the best of them
    remarks: tuple[str, ...] = ()  # what makes the errors mean something else, though the search converged

    def headline(self) -> str:
        """Status, likelihood and size."""
        return (
            f"{self.status} after {self.iterations} iterations, log-likelihood {self.log_likelihood:.6g}, "
            f"{len(self.names)} parameters, {self.samples} values"
        )

    def rows(self) -> Sequence[Row]:
        """One row for each parameter; the standard error is the one for coloured residuals."""
        return [
            {
                "parameter": name,
                "value": value,
                "std_error": self.std_error_coloured.get(name, float("nan")),
                "std_error_white": self.std_error.get(name, float("nan")),
                "free": name in self.names,
                "at_bound": name in self.at_bound,
            }
            for name, value in self.theta.items()
        ]

    def report(self) -> str:
        """The fit as text, in the manner of lmfit's report: status, noise, parameters with their errors, warnings."""
        lines = [
            "[[Fit]]",
            f"    status          = {self.status}: {self.message}",
            f"    iterations      = {self.iterations}, with {self.mesh_steps} steps per sample",
            f"    measured values = {self.samples}",
            f"    log-likelihood  = {self.log_likelihood:.6g} (without its constant)",
            "[[Noise]]",
        ]
        for i, test in enumerate(self.whiteness):
            colour = "white" if test.white else f"not white (p-value {test.p_value:.1g}, lag {test.largest_lag})"
            size = _with_error(np.sqrt(self.noise_variance[i]), self.noise_std_error[i])
            lines.append(f"    output {i}: {size}, innovations {colour}")
        for i in np.flatnonzero(self.process_noise).tolist():
            size = _with_error(self.process_noise[i], self.process_noise_std_error[i])
            lines.append(f"    state {i} is driven by {size} per root second")
        lines.append("[[Parameters]]")
        width = max(len(name) for name in self.theta)
        for row in self.rows():
            note = f" (white {row['std_error_white']:.3g})" if np.isfinite(row["std_error"]) else " (not determined)"
            note = (note if row["free"] else " (held)") + (" (at its bound)" if row["at_bound"] else "")
            lines.append(f"    {row['parameter']:<{width}}  {_with_error(row['value'], row['std_error'])}{note}")
        near_null = [str(self.identifiability)] if self.identifiability.near_null else []
        warnings = [f"    {text}" for text in (*self.remarks, *near_null)]
        return "\n".join([*lines, *(["[[Beware]]", *warnings] if warnings else [])])

    @property
    def converged(self) -> bool:
        """Whether the estimate may be used."""
        return self.status == "converged"

    @property
    def nllf(self) -> float:
        """The negative log-likelihood of Eq. 3.10 with erratum E8."""
        return -self.log_likelihood


def _with_error(value: float, error: float) -> str:
    return f"{value: .6g}" + (f" +/- {error:.3g}" if np.isfinite(error) else "")


def assess(outcome: SearchOutcome, options: Options, steps: int) -> FitResult:
    """The result of a search with so many steps between samples; errors are nan where they cannot be had."""
    problem, iterate = outcome.problem, outcome.iterate
    parameters = problem.parameters
    sampled = slice(None, None, steps)
    noisy = bool(np.any(problem.process_noise))
    if noisy:
        refined, nllf = kalman_innovations(problem, iterate)
    else:
        refined = residuals(problem, iterate)
        nllf = statistics.negative_log_likelihood(np.concatenate(refined, axis=1), iterate.variance)
    innovations = tuple(each[:, sampled] for each in refined)
    together = np.concatenate(innovations, axis=1)
    samples = int(np.isfinite(together).sum())
    at_bound = (iterate.theta <= parameters.lower) | (iterate.theta >= parameters.upper)
    p = len(parameters.names)
    estimated = np.flatnonzero(~at_bound)
    triangle = white = coloured = np.full((p, p), np.nan)
    segments = outcome.segments
    with suppress(SingularStatesError):  # the states are not determined
        segments = segments or sensitivities(problem, iterate)
    rows = () if noisy else tuple(segment.whitened(sampled) for segment in segments)
    if segments:
        triangle = information_factor(segments, p)[:p, :p]
        white, coloured = _covariances(problem, rows, triangle, samples, estimated, options)
    wanted = directions_of(problem, options.estimate_noise, options.estimate_process_noise)
    process, measurement, covariance, vanished = noise_errors(problem, iterate, wanted, segments, white)
    if noisy:
        white = coloured = covariance
    shift = mesh_shift(problem, iterate, segments, white)
    determined = identifiability(np.nan_to_num(triangle), parameters.prior_std, parameters.names)
    hidden = outcome.status == Status.STALLED and bool(determined.near_null)
    tests = whiteness(innovations, min(_LAGS, together.shape[1] // 4))
    measured = np.concatenate([np.where(grid.measured, grid.y, np.nan) for grid in problem.grids], axis=1)
    return FitResult(
        status=outcome.status,
        message=outcome.message if not hidden else f"{outcome.message}. {determined}",
        names=parameters.names,
        theta=parameters.as_mapping(iterate.theta),
        std_error=_by_name(parameters.names, white),
        std_error_coloured=_by_name(parameters.names, coloured),
        covariance=white,
        log_likelihood=-nllf,
        noise_variance=iterate.variance,
        process_noise=problem.process_noise,
        noise_std_error=measurement,
        process_noise_std_error=process,
        iterations=len(outcome.history),
        history=outcome.history,
        identifiability=determined,
        whiteness=tests,
        states=tuple(x[:, sampled] for x in iterate.x),
        innovations=innovations,
        at_bound=tuple(name for name, stuck in zip(parameters.names, at_bound, strict=True) if stuck),
        derivatives=problem.model.method,
        samples=samples,
        mesh_shift=float(np.max(np.abs(shift[estimated]), initial=0.0)) if segments else float("nan"),
        mesh_steps=steps,
        remarks=(*_remarks(together, measured, tests, options), *vanished),
    )


def _covariances(
    problem: Setup, rows: Sequence[Whitened], triangle: FloatArray, samples: int, free: IntArray, options: Options
) -> tuple[FloatArray, FloatArray]:
    """Covariances (p, p) for white and for coloured residuals, degrees of freedom counted; nan where unknown."""
    parameters = problem.parameters
    raw = statistics.covariance_from_information(triangle, parameters.prior_std, free)
    unknowns = len(free) + sum(int(np.isinf(g.start_std).sum()) for g in problem.grids)
    # The likelihood of states that noise drives makes up for it itself (`filter_error`).
    white = raw * (samples / max(samples - unknowns, 1) if options.estimate_noise and rows else 1.0)
    known = np.flatnonzero(np.isfinite(np.diag(raw)))
    if not rows or not known.size:
        return white, white
    block = np.ix_(known, known)
    corrected = statistics.coloured_covariance(np.nan_to_num(raw), 1.0 / parameters.prior_std**2, rows)[block]
    if options.estimate_noise:
        corrected = corrected * statistics.inflation(raw[block], corrected, unknowns, samples)
    coloured = np.full_like(raw, np.nan)
    coloured[block] = corrected
    return white, coloured


def _remarks(together: FloatArray, y: FloatArray, tests: Sequence[Whiteness], options: Options) -> list[str]:
    """Outputs y (n_outputs, n) without a sample, and without noise: what is left of them is smooth, and tiny."""
    found = []
    never = np.flatnonzero(~np.isfinite(y).any(axis=1)).tolist()
    if never:
        found.append(
            f"outputs {never} have no samples in any segment: they had no part in the fit, and what noise_variance "
            "holds for them is no estimate. Likely cause: a channel that is missing from the record. Leave them out of "
            "y and of the outputs if that is meant"
        )
    left, size = (
        np.sqrt(np.nansum(rows**2, axis=1) / np.maximum(np.isfinite(rows).sum(axis=1), 1)) for rows in (together, y)
    )
    quiet = [
        i
        for i, test in enumerate(tests)
        if left[i] < _NOISE_FREE * size[i] and not (test.white and left[i] > _ROUNDING * size[i])
    ]
    if quiet and options.estimate_noise:
        found.append(
            f"outputs {quiet} hold next to no noise: residuals are {np.max(left[quiet] / size[quiet]):.1g} of the "
            "signal, not white or mere rounding, so that they are the model's and the discretisation's errors. "
            "Standard errors say nothing of these; likely cause: simulated data. Give `noise`, or add the "
            "instruments' noise"
        )
    return found


def _by_name(names: Sequence[str], covariance: FloatArray) -> dict[str, float]:
    """Standard errors; nan where by rounding no variance remains, of parameters that are all but dependent."""
    variance = np.diag(covariance)
    return dict(zip(names, np.sqrt(np.where(variance >= 0.0, variance, np.nan)).tolist(), strict=True))


# ---- How far the discretisation moves the estimate ----


_NODES = np.linspace(0.0, 1.0, 5)
_BOOLE = np.array([7.0, 32.0, 12.0, 32.0, 7.0]) / 90.0
_PARTIAL = np.stack([_NODES ** (k + 1) / (k + 1) for k in range(5)], axis=1) @ np.linalg.inv(
    np.vander(_NODES, increasing=True)
)
"""Integrals of the quartic through five slopes from the start to each node, (5, 5)."""


def mesh_shift(problem: Setup, iterate: Iterate, segments: Segments, covariance: FloatArray) -> FloatArray:
    """How far exact dynamics would move the estimate, (p,), in standard errors; nan where that is not known.
    `covariance` (p, p) is that of theta, nan for parameters that the fit could not move. Known without delays, for
    segments of at most _MOST_JUDGED samples.
    """
    p = len(problem.parameters.names)
    shift, known = np.full(p, np.nan), np.isfinite(np.diag(covariance))
    long = any(grid.n > _MOST_JUDGED for grid in problem.grids)
    if problem.model.delays or long or not segments or not known.any():
        return shift
    gradient = np.zeros(p)
    for grid, x, segment in zip(problem.grids, iterate.x, segments, strict=True):
        with np.errstate(all="ignore"):
            error = interval_errors(problem, grid, x, problem.parameters.as_mapping(iterate.theta))
        multiplier = segment.multiplier[1:, :, 1:]
        gradient[segment.problem.own] += np.einsum("km,kmp->p", error.T / problem.size, multiplier)
    block = covariance[np.ix_(known, known)]
    shift[known] = block @ gradient[known] / np.sqrt(np.diag(block))
    return shift


def interval_errors(problem: Setup, grid: Grid, x: FloatArray, theta: Values) -> FloatArray:
    """Change of state over each interval less what Simpson's rule makes of it, (n_states, n - 1)."""
    h, low, high = grid.step, x[:, :-1], x[:, 1:]
    corner = _slopes(problem, grid, {0.0: low, 1.0: high}, theta)
    cubic = {  # through states and slopes at both ends
        s: low
        + s**2 * (3.0 - 2.0 * s) * (high - low)
        + h * (s * (1.0 - s) ** 2 * corner[0.0] - s**2 * (1.0 - s) * corner[1.0])
        for s in _NODES[1:-1].tolist()
    }
    first = corner | _slopes(problem, grid, cubic, theta)
    slopes = np.stack([first[s] for s in _NODES.tolist()])
    simpson = (first[0.0] + 4.0 * first[0.5] + first[1.0]) / 6.0
    # Of a state that nothing drives, what is left is how far the search is from its end.
    driven = np.where((problem.process_noise > 0.0)[:, np.newaxis], high - low - h * simpson, 0.0)
    better = low + h * np.einsum("ij,jmn->imn", _PARTIAL, slopes) + _NODES[:, None, None] * driven
    second = corner | _slopes(problem, grid, {s: better[i] for i, s in enumerate(_NODES.tolist()) if 0 < i < 4}, theta)
    boole = sum(weight * second[s] for weight, s in zip(_BOOLE, _NODES.tolist(), strict=True))
    return np.asarray(h * (boole - simpson))


def _slopes(problem: Setup, grid: Grid, states: Mapping[float, FloatArray], theta: Values) -> dict[float, FloatArray]:
    """The dynamics at states (n_states, n - 1) at fractions of every interval."""
    found = {}
    for s, x in states.items():
        time_varying = tuple(replace(c, shapes=_within(grid, c.shapes, s)) for c in grid.time_varying)
        points = Points(x, _within(grid, grid.u, s), grid.t[: grid.n - 1] + s * grid.step, time_varying=time_varying)
        found[s] = evaluate(problem.model.dynamics, points, theta)
    return found


def _within(grid: Grid, signal: FloatArray, s: float) -> FloatArray:
    """A signal at a fraction of every interval: on the parabola by its start, middle and end, before a jump there."""
    weights = 2.0 * (s - 0.5) * (s - 1.0), 4.0 * s * (1.0 - s), 2.0 * s * (s - 0.5)
    return np.asarray(sum(w * signal[:, where] for w, where in zip(weights, grid.intervals, strict=True)))
