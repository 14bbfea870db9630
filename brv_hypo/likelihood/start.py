"""Where the search starts: states read off the outputs, then smoothed with the dynamics held loosely."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.likelihood.collocation import Model, linearise_segment
from brv_hypo.likelihood.merit import line_search
from brv_hypo.likelihood.parameters import Parameters
from brv_hypo.likelihood.segment import Grid
from brv_hypo.likelihood.step import Iterate, Problem, gauss_newton_step, moved, sensitivities

_SMOOTHING_STEPS = 2
_TIGHTENING = (1.0, 0.3, 0.1)
_WAITING = 1e-9
"""Reach of a delay while it waits, s."""
_LEAST_LOOSENESS = 1e-2
"""Least change of a state between samples that smoothing grants it, as a fraction of its size."""


def states_from_outputs(
    model: Model, grids: Sequence[Grid], parameters: Parameters
) -> tuple[FloatArray, ...]:
    """A state history for each segment, (n_states, n).

    The one given, or the initial state moved to meet the outputs.

    A state that the outputs do not show at a sample stays at its initial value.
    """
    histories = []
    for s, grid in enumerate(grids):
        if grid.start.ndim == 2:
            histories.append(grid.start.copy())
            continue
        x = np.repeat(grid.start[:, None], grid.n, axis=1)
        theta = parameters.of_segment(s, parameters.start)
        linear = linearise_segment(model, grid, x, theta, ())
        here = -linear.output_by_state.offset
        difference = _without_gaps(grid) - linear.output.T
        pseudo_inverse = np.linalg.pinv(linear.output_by_state.blocks[:, here], rcond=1e-6)
        histories.append(x + np.einsum("nij,jn->in", pseudo_inverse, difference))
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
    late = [name.split("[")[0] in delays for name in parameters.names]
    return np.where(late, short, np.inf)


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


def _without_gaps(grid: Grid) -> FloatArray:
    filled = grid.y.copy()
    t = grid.t[: grid.n]
    for row, seen in zip(filled, grid.measured, strict=True):
        row[~seen] = np.interp(t[~seen], t[seen], row[seen]) if seen.any() else 0.0
    return filled
