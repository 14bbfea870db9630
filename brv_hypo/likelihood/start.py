"""Where the search starts: states read off the outputs, then smoothed with the dynamics held loosely."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.likelihood.collocation import Model, linearise_segment, parts_of
from brv_hypo.likelihood.cutting import cut, joined
from brv_hypo.likelihood.merit import line_search
from brv_hypo.likelihood.parameters import Parameters
from brv_hypo.likelihood.segment import Grid
from brv_hypo.likelihood.step import (
    Iterate,
    Problem,
    SingularStatesError,
    gauss_newton_step,
    moved,
    objective,
    sensitivities,
)

_SMOOTHING_STEPS = 2
_TIGHTENING = (1.0, 0.3, 0.1)
_WAITING = 1e-9
"""Reach of a delay while it waits, s."""
_LEAST_LOOSENESS = 1e-2
"""Least change of a state between samples that smoothing grants it, as a fraction of its size."""
_POOR = 3.0
"""Mean square of whitened residuals above which a beginning fits so poorly that another is tried."""
_FAR_LESS = 0.5
"""Violation of the dynamics, against that of the start values, at which 0 is the better start."""


def begin(problem: Problem, iterate: Iterate, near: bool) -> tuple[Problem, Iterate]:
    """Where the search begins: smoothed states, parameters brought near, and the scales that follow from them.

    An output that the start values make far too small a function of a state makes that state far too large. Where
    the start fits poorly, 0 is tried too, and taken where it violates the dynamics far less. `near` is that of `fit`.
    """
    first = _prepared(problem, iterate, near)
    given = all(grid.start.ndim == 2 for grid in problem.grids)
    if near or given or _mean_square(*first) < _POOR:
        return first
    zero = _at_zero(problem, iterate)
    if zero is None:
        return first
    second = _prepared(replace(problem, size=state_sizes(zero.x)), zero, near)
    size = np.minimum(first[0].size, second[0].size)
    here, there = (_violation(replace(p, size=size), i) for p, i in (first, second))
    return second if there < _FAR_LESS * here else first


def _at_zero(problem: Problem, iterate: Iterate) -> Iterate | None:
    """Parameters at 0, or as near as their bounds let them, and the states that the outputs then show.

    Delays, and what else acts alike over a short way only, stay. None where the functions are not defined there.
    """
    parameters = problem.parameters
    local = np.isfinite(parameters.spread(dict.fromkeys(problem.model.delays, 0.0), np.inf))
    local |= np.isfinite(problem.reach)
    theta = np.where(local, iterate.theta, np.clip(0.0, parameters.lower, parameters.upper))
    with np.errstate(all="ignore"):
        try:
            histories = states_from_outputs(problem.model, problem.grids, parameters, theta)
        except np.linalg.LinAlgError:
            return None
    if not all(np.all(np.isfinite(x)) for x in histories):
        return None
    return replace(iterate, x=histories, theta=theta)


def states_from_outputs(
    model: Model, grids: Sequence[Grid], parameters: Parameters, vector: FloatArray
) -> tuple[FloatArray, ...]:
    """A state history for each segment, (n_states, n), with the parameters at `vector`, (p,).

    The one given, or the initial state moved to meet the outputs.

    A state that the outputs do not show at a sample stays at its initial value.
    """
    histories = []
    for s, grid in enumerate(grids):
        if grid.start.ndim == 2:
            histories.append(grid.start.copy())
            continue
        x = np.repeat(grid.start[:, None], grid.n, axis=1)
        measured = _without_gaps(grid)
        moved = np.empty_like(x)
        for part in parts_of(grid.n):
            linear = linearise_segment(model, grid, x, parameters.of_segment(s, vector), (), part)
            pseudo_inverse = np.linalg.pinv(linear.output_by_state.own(part.start), rcond=1e-6)
            difference = measured[:, part] - linear.output.T
            moved[:, part] = x[:, part] + np.einsum("nij,jn->in", pseudo_inverse, difference)
        histories.append(moved)
    return tuple(histories)


def state_sizes(histories: Sequence[FloatArray]) -> FloatArray:
    """Magnitude of each state, (n_states,): root mean square over all segments, 1 where it is 0."""
    size = np.sqrt(np.mean(np.concatenate(histories, axis=1) ** 2, axis=1))
    return np.where(size > 0, size, 1.0)


def looseness(grids: Sequence[Grid], histories: Sequence[FloatArray], size: FloatArray) -> FloatArray:
    """Process noise, (n_states,), per root second, that lets the states follow the outputs, not the model."""
    steps = np.concatenate([np.diff(x, axis=1) for x in histories], axis=1)
    interval = np.median(np.concatenate([g.step for g in grids]))
    change = np.maximum(np.sqrt(np.mean(steps**2, axis=1)), _LEAST_LOOSENESS * size)
    return np.asarray(change / np.sqrt(interval))


def delay_reach(
    delays: Sequence[str], parameters: Parameters, grids: Sequence[Grid], histories: Sequence[FloatArray]
) -> FloatArray:
    """Largest change of each parameter in one step, (p,).

    For a delay, half the time scale of the fastest state.
    """
    rates = np.concatenate(
        [np.diff(x, axis=1) / g.step for x, g in zip(histories, grids, strict=True)], axis=1
    )
    spread = np.std(np.concatenate(histories, axis=1), axis=1)
    rms = np.sqrt(np.mean(rates**2, axis=1))
    times = spread[rms > 0] / rms[rms > 0]
    short = 0.5 * float(times.min()) if times.size and times.min() > 0 else np.inf
    return parameters.spread(dict.fromkeys(delays, short), np.inf)


def smooth(problem: Problem, iterate: Iterate, loose: FloatArray) -> Iterate:
    """States moved between outputs and model, theta held, the dynamics loose by the process noise `loose`."""
    loosened = replace(problem, process_noise=loose)
    for _ in range(_SMOOTHING_STEPS):
        segments = sensitivities(loosened, iterate, anchored=True)
        iterate = moved(loosened, iterate, gauss_newton_step(loosened, iterate, segments, frozen=True), 1.0)
    return iterate


def approach(problem: Problem, iterate: Iterate, loose: FloatArray) -> Iterate:
    """A few steps in theta and the states while the dynamics are tightened, from equation to output error.

    With the states near the outputs the problem is nearly linear in theta, which is why a poor theta0 does no
    harm. Delays wait: with loose dynamics the data hardly know them, and a wrong one is hard to leave again.
    """
    reach = np.where(np.isfinite(problem.reach), _WAITING, problem.reach)
    for fraction in _TIGHTENING:
        noise = np.hypot(problem.process_noise, fraction * loose)
        loosened = replace(problem, process_noise=noise, reach=reach)
        step = gauss_newton_step(loosened, iterate, sensitivities(loosened, iterate, anchored=True))
        iterate, _ = line_search(loosened, iterate, step, penalty=0.0)
    return iterate


def _prepared(problem: Problem, iterate: Iterate, near: bool) -> tuple[Problem, Iterate]:
    """States smoothed and parameters brought near; as they are where the outputs leave a state undetermined."""
    pieces, part = cut(problem, iterate)
    loose = looseness(problem.grids, iterate.x, problem.size)
    try:
        if any(g.start.ndim == 1 for g in problem.grids):
            part = smooth(pieces, part, loose)
        reach = delay_reach(problem.model.delays, pieces.parameters, pieces.grids, part.x)
        reach = np.minimum(problem.reach, reach)
        pieces = replace(pieces, size=state_sizes(part.x), reach=reach)
        if not near:
            part = approach(pieces, part, loose)
    except SingularStatesError:
        pass  # the search says so if they stay undetermined
    found = replace(part, x=joined(problem, part.x))
    return replace(problem, size=pieces.size, reach=pieces.reach), found


def _mean_square(problem: Problem, iterate: Iterate) -> float:
    """Of the whitened residuals, priors and process noise among them."""
    measured = sum(int(grid.measured.sum()) for grid in problem.grids)
    return 2.0 * objective(problem, iterate)[0] / max(measured, 1)


def _violation(problem: Problem, iterate: Iterate) -> float:
    """How far the states are from exact dynamics, in their sizes; infinite where that is not finite."""
    exact = replace(problem, process_noise=np.zeros_like(problem.process_noise))
    violation = objective(exact, iterate)[1]
    return violation if np.isfinite(violation) else np.inf


def _without_gaps(grid: Grid) -> FloatArray:
    filled = grid.y.copy()
    t = grid.t[: grid.n]
    for row, seen in zip(filled, grid.measured, strict=True):
        row[~seen] = np.interp(t[~seen], t[seen], row[seen]) if seen.any() else 0.0
    return filled
