"""Where the search starts: smoothed states, several starting points, long gaps, finer meshes.

States are read off the outputs, then smoothed with the dynamics held loosely. A model that is not quite right has more
than one optimum: the search is started from several guesses of the noise, and the best likelihood wins. Across a long
gap the outputs give no states: theta is fitted on the record between gaps first, and the model carries the motion
across. Where the mesh moves the estimate by more than is tolerable, the fit is repeated on a finer one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.likelihood import gauss_newton
from brv_hypo.likelihood.collocation import System, linearise_segment
from brv_hypo.likelihood.gauss_newton import Iterate, Setup, gauss_newton_step, moved, objective, sensitivities
from brv_hypo.likelihood.result import TOLERATED, FitResult, StartingPoint
from brv_hypo.likelihood.search import Status
from brv_hypo.likelihood.segment import WIDTH, Grid, Parameters, Segment, build_grid, inputs_at, inputs_of
from brv_hypo.likelihood.statistics import least_variance, noise_from_differences

_SMOOTHING_STEPS = 2
_TIGHTENING = (1.0, 0.3, 0.1)
_WAITING = 1e-9  # reach of a delay while it waits, s
_LEAST_LOOSENESS = 1e-2  # least change of a state between samples that smoothing grants it, as a fraction of its size
_POOR = 3.0  # mean square of whitened residuals above which a starting point fits so poorly that another is tried
_FAR_LESS = 0.5  # violation of the dynamics, against that of the start values, at which 0 is the better start
_LONG = 8  # times the usual distance of measured samples from which a gap is bridged
_LEAST = 2 * WIDTH  # samples of a stretch at least
_SUSPECT = 1e-3  # p-value of an output's whiteness below which a second starting point is worth its time
_APART = 1.0  # difference of log-likelihoods from which two ends are different optima
_POOR_LIKELIHOOD = 3.0  # mean square of residuals, over the known noise, above which a second start is worth its time
_WINDOW = 9  # samples of the running mean whose residual is the third guess of the noise
MOST_STEPS = 32  # steps between samples at most
_ORDER = 4.0  # order of the collocation: how the error falls with the step
_NEAR = 1.0  # shift by the mesh, in standard errors, up to which a fit on a finer one begins where the coarser ended
_LARGEST_RAISE = 8  # factor by which steps are raised at once: far from fine the error does not follow its order


def begin(problem: Setup, iterate: Iterate, near: bool) -> tuple[Setup, Iterate]:
    """Where the search begins: smoothed states, parameters brought near, and the scales that follow from them. An
    output that the start values make far too small a function of a state makes that state far too large. Where the
    start fits poorly, 0 is tried too, and taken where it violates the dynamics far less. `near` is that of `fit`.
    """
    first = _prepared(problem, iterate, near)
    given = all(grid.start.ndim == 2 for grid in problem.grids)
    measured = sum(int(grid.measured.sum()) for grid in problem.grids)
    if near or given or 2.0 * objective(*first)[0] < _POOR * max(measured, 1):
        return first
    zero = _at_zero(problem, iterate)
    if zero is None:
        return first
    second = _prepared(replace(problem, size=state_sizes(zero.x)), zero, near)
    size, exact = np.minimum(first[0].size, second[0].size), np.zeros_like(problem.process_noise)
    here, there = (  # violations of the dynamics
        np.nan_to_num(objective(replace(p, size=size, process_noise=exact), i)[1], nan=np.inf)
        for p, i in (first, second)
    )
    return second if there < _FAR_LESS * here else first


def _at_zero(problem: Setup, iterate: Iterate) -> Iterate | None:
    """Parameters at 0 but for delays, or near by bounds, and their states; None where functions are not defined."""
    parameters = problem.parameters
    local = np.isfinite(parameters.spread(dict.fromkeys(problem.model.delays, 0.0), np.inf))
    local |= np.isfinite(problem.reach)
    theta = np.where(local, iterate.theta, np.clip(0.0, parameters.lower, parameters.upper))
    with np.errstate(all="ignore"), suppress(np.linalg.LinAlgError):
        histories = states_from_outputs(problem.model, problem.grids, parameters, theta)
        if all(np.all(np.isfinite(x)) for x in histories):
            return replace(iterate, x=histories, theta=theta)
    return None


def states_from_outputs(
    model: System, grids: Sequence[Grid], parameters: Parameters, vector: FloatArray
) -> tuple[FloatArray, ...]:
    """State histories (n_states, n) at parameters `vector` (p,): given, or the initial state moved to the outputs."""
    histories = []
    for grid in grids:
        if grid.start.ndim == 2:
            histories.append(grid.start.copy())
            continue
        x, t, measured = np.repeat(grid.start[:, None], grid.n, axis=1), grid.t[: grid.n], grid.y.copy()
        for row, observed in zip(measured, grid.measured, strict=True):
            row[~observed] = np.interp(t[~observed], t[observed], row[observed]) if observed.any() else 0.0
        linear = linearise_segment(model, grid, x, parameters.as_mapping(vector), ())
        pseudo_inverse = np.linalg.pinv(linear.output_by_state, rcond=1e-6)
        histories.append(x + np.einsum("nij,jn->in", pseudo_inverse, measured - linear.output.T))
    return tuple(histories)


def state_sizes(histories: Sequence[FloatArray]) -> FloatArray:
    """Magnitude of each state, (n_states,): root mean square over all segments, 1 where it is 0."""
    size = np.sqrt(np.mean(np.concatenate(histories, axis=1) ** 2, axis=1))
    return np.where(size > 0, size, 1.0)


def smooth(problem: Setup, iterate: Iterate, loose: FloatArray) -> Iterate:
    """States moved between outputs and model, theta held, the dynamics loose by the process noise `loose`."""
    loosened = replace(problem, process_noise=loose)
    for _ in range(_SMOOTHING_STEPS):
        segments = sensitivities(loosened, iterate, anchored=True)
        iterate = moved(loosened, iterate, gauss_newton_step(loosened, iterate, segments, frozen=True), 1.0)
    return iterate


def _prepared(problem: Setup, iterate: Iterate, near: bool) -> tuple[Setup, Iterate]:
    """States smoothed and parameters brought near; as they are where the outputs leave a state undetermined."""
    changes = np.concatenate([np.diff(x, axis=1) for x in iterate.x], axis=1)
    interval = np.median(np.concatenate([g.step for g in problem.grids]))
    change = np.maximum(np.sqrt(np.mean(changes**2, axis=1)), _LEAST_LOOSENESS * problem.size)
    loose = change / np.sqrt(interval)  # process noise that lets the states follow the outputs, not the model
    with suppress(gauss_newton.SingularStatesError):  # the search says so if they stay undetermined
        if any(g.start.ndim == 1 for g in problem.grids):
            iterate = smooth(problem, iterate, loose)
        # Largest step of a delay: half the time scale of the fastest state.
        steps = zip(iterate.x, problem.grids, strict=True)
        rates = np.concatenate([np.diff(x, axis=1) / g.step for x, g in steps], axis=1)
        rms, spread = np.sqrt(np.mean(rates**2, axis=1)), np.std(np.concatenate(iterate.x, axis=1), axis=1)
        times = spread[rms > 0] / rms[rms > 0]
        short = 0.5 * float(times.min()) if times.size and times.min() > 0 else np.inf
        reach = problem.parameters.spread(dict.fromkeys(problem.model.delays, short), np.inf)
        problem = replace(problem, size=state_sizes(iterate.x), reach=np.minimum(problem.reach, reach))
        # A few steps in theta and the states while the dynamics are tightened, from equation to output error. With the
        # states near the outputs the problem is nearly linear in theta, which is why a poor theta0 does no harm. Delays
        # wait: with loose dynamics the data hardly know them, and a wrong one is hard to leave again.
        nearer, waiting = iterate, np.where(np.isfinite(problem.reach), _WAITING, problem.reach)
        for fraction in () if near else _TIGHTENING:
            noise = np.hypot(problem.process_noise, fraction * loose)
            loosened = replace(problem, process_noise=noise, reach=waiting)
            step = gauss_newton_step(loosened, nearer, sensitivities(loosened, nearer, anchored=True))
            nearer, _ = gauss_newton.line_search(loosened, nearer, step, penalty=0.0)
        iterate = nearer
    return problem, iterate


# ---- Long gaps, in which nothing was measured: fitted around first, then across ----


def stretches(segments: Sequence[Segment]) -> list[list[slice]]:
    """What lies between long gaps, by segment, from a measured sample to a measured one; empty without such gaps."""
    found, gaps = [], 0
    for segment in segments:
        observed = np.flatnonzero(np.isfinite(np.atleast_2d(segment.y)).any(axis=0))
        apart = np.diff(observed)
        wide = np.flatnonzero(apart > _LONG * np.median(apart)) if apart.size else apart
        gaps += wide.size
        spans = [slice(int(run[0]), int(run[-1]) + 1) for run in np.split(observed, wide + 1) if run.size]
        found.append([span for span in spans if span.stop - span.start >= _LEAST])
    return found if gaps else []


def pieces_of(segments: Sequence[Segment], between: Sequence[Sequence[slice]]) -> list[Segment]:
    """The stretches as segments, their initial states free but where a segment's own is known."""
    found = []
    for segment, spans in zip(segments, between, strict=True):
        x0 = np.asarray(segment.x0, dtype=float)
        found += [
            replace(
                segment,
                t=np.asarray(segment.t, dtype=float)[where],
                u=inputs_of(segment)[:, where],
                y=np.atleast_2d(segment.y)[:, where],
                x0=x0[:, where] if x0.ndim == 2 else x0,
                x0_std=segment.x0_std if where.start == 0 else np.inf,
                u_mid=None if segment.u_mid is None else segment.u_mid[:, where.start : where.stop - 1],
            )
            for where in spans
        ]
    return found


def bridged(
    segments: Sequence[Segment], between: Sequence[Sequence[slice]], known: Sequence[tuple[FloatArray, FloatArray]]
) -> list[Segment]:
    """The segments with histories: `known` of each stretch, times and states (n_states, n), straight lines between."""
    found, following = [], iter(known)
    for segment, spans in zip(segments, between, strict=True):
        own = [next(following) for _ in spans]
        if own:
            at, states = (np.concatenate(each, axis=-1) for each in zip(*own, strict=True))
            t = np.asarray(segment.t, dtype=float)
            segment = begun(segment, np.stack([np.interp(t, at, row) for row in states]))
        found.append(segment)
    return found


# ---- Several starting points of one fit: a model that is not quite right has more than one optimum ----


def first_noises(y: FloatArray) -> dict[str, FloatArray]:
    """Guesses of noise variances (n_outputs,), by source, of outputs (n_outputs, n), nan in gaps; smallest first."""
    variances = [1.0 if np.isnan(row).all() else np.nanvar(row) for row in y]
    unsmooth = np.zeros(len(y))  # about the running mean
    for i, row in enumerate(y):
        finite = row[np.isfinite(row)]
        if finite.size >= _WINDOW:
            smooth = np.convolve(finite, np.full(_WINDOW, 1.0 / _WINDOW), mode="valid")
            unsmooth[i] = np.var(finite[_WINDOW // 2 : -(_WINDOW // 2)] - smooth)
    return {
        "differences of the outputs": noise_from_differences(y),
        "residual of smoothed outputs": np.maximum(unsmooth, least_variance(y)),
        "variances of the outputs": np.maximum(variances, least_variance(y)),
    }


def best_of(
    noises: Mapping[str, FloatArray], run: Callable[[FloatArray], FitResult], *, alone: bool, known: bool
) -> FitResult:
    """The fit of the greatest likelihood; others than the first are tried, unless `alone` has residuals of noise."""
    (source, first), *others = noises.items()
    ends = {source: run(first)}
    found = ends[source]
    if known:  # residuals no larger than the noise that they are weighed by, or process noise that explains them
        squares = np.nanmean(np.concatenate(found.innovations, axis=1) ** 2, axis=1) / found.noise_variance
        sound = bool(np.any(found.process_noise)) or not np.mean(squares) > _POOR_LIKELIHOOD
    else:
        sound = all(test.p_value >= _SUSPECT for test in found.whiteness)
    if not alone and not (found.converged and sound):
        ends |= {source: run(noise) for source, noise in others}
    return chosen(ends)


def chosen(ends: Mapping[str, FitResult]) -> FitResult:
    """The end of the greatest likelihood, by source; among those as good as it, one that converged."""
    likelihoods = np.array([found.log_likelihood for found in ends.values()])
    greatest = np.max(likelihoods, initial=-np.inf, where=np.isfinite(likelihoods))
    best = min(
        (found for found, value in zip(ends.values(), likelihoods, strict=True) if not value < greatest - _APART),
        key=lambda found: (not found.converged, -found.log_likelihood),
    )
    starting_points = tuple(StartingPoint(source, found.status, found.log_likelihood) for source, found in ends.items())
    apart = [each for each in starting_points if not each.log_likelihood >= greatest - _APART]
    message = best.message
    if apart:
        others = "; ".join(f"{b.log_likelihood:.6g} ({b.status}, from {b.source})" for b in apart)
        message += (
            f". Starting points disagree: log-likelihood {best.log_likelihood:.6g} here, elsewhere {others}. The model "
            "has several optima on these data: compare their residuals, and start from values that are known"
        )
    return replace(best, message=message, starting_points=starting_points)


def refine(segments: Sequence[Segment], run: Callable[..., FitResult]) -> FitResult:
    """Fits on finer meshes until the shift is tolerable, or the steps are at their limit: then the status says so.
    `run` fits segments on a mesh of so many steps between samples; with a result as third argument it begins where that
    ended, the segments' histories being its states.
    """
    steps = 1
    found = run(segments, steps)
    while found.mesh_shift > TOLERATED and steps < MOST_STEPS:
        before = found
        wanted = (before.mesh_shift / TOLERATED) ** (1.0 / _ORDER) if np.isfinite(before.mesh_shift) else np.inf
        steps = min(steps * int(min(2.0 ** np.ceil(np.log2(max(wanted, 2.0))), _LARGEST_RAISE)), MOST_STEPS)
        if before.converged and before.mesh_shift <= _NEAR:
            known = [begun(segment, x) for segment, x in zip(segments, before.states, strict=True)]
            found = run([finer(segment, i, steps) for i, segment in enumerate(known)], steps, before)
            if found.converged:
                found = replace(found, starting_points=(*before.starting_points, *found.starting_points))
                continue
        found = run([finer(segment, number, steps) for number, segment in enumerate(segments)], steps)
    if not found.mesh_shift > TOLERATED:
        return found
    size = f"an estimate is off by {found.mesh_shift:.2g} standard errors with {steps} steps between samples"
    if found.converged:
        return replace(found, status=Status.COARSE, message=f"{size}: {Status.COARSE.message}")
    mesh = f"The mesh is a likely cause: {size}. {Status.COARSE.remedy}"
    return replace(found, message=f"{found.message}. {mesh}")


def begun(segment: Segment, x: FloatArray) -> Segment:
    """The segment with states (n_states, n) to begin with, what is known of its initial state as it was."""
    history = x.copy()
    first = np.asarray(segment.x0, dtype=float).reshape(len(x), -1)[:, 0]
    history[:, 0] = np.where(np.isinf(segment.x0_std), x[:, 0], first)
    return replace(segment, x0=history)


def finer(segment: Segment, number: int, steps: int) -> Segment:
    """The segment with `steps` - 1 samples between each two, at which nothing was measured."""
    build_grid(segment, number)  # refuses what is unfit
    t = np.asarray(segment.t, dtype=float)
    inside = np.append((t[:-1, None] + np.diff(t)[:, None] * np.arange(steps) / steps).ravel(), t[-1])
    middle = 0.5 * (inside[:-1] + inside[1:])
    y = np.atleast_2d(np.asarray(segment.y, dtype=float))
    fine = np.full((y.shape[0], inside.size), np.nan)
    fine[:, ::steps] = y
    x0 = np.asarray(segment.x0, dtype=float)
    if x0.ndim == 2:
        x0 = np.stack([np.interp(inside, t, row) for row in x0])
    return replace(segment, t=inside, y=fine, u=inputs_at(segment, inside), u_mid=inputs_at(segment, middle), x0=x0)
