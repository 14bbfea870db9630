"""Speed and altitude of a steep climb, from the axial accelerometer and a barometric or satellite altitude.

The nose is taken as up and along the path: dh/dt = v, dv/dt = ax - g + d, where d (the lean of the path, the bias of
the accelerometer) wanders slowly. The altitudes, whose errors are large but do not grow, and the accelerometer, whose
errors are small but add up, are joined by a Kalman filter and the smoother of Rauch, Tung and Striebel (AIAA J. 3,
1965). Altitudes that leave the climb, as a barometer's do near Mach 1, count less (weights of Student's t).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.constants import (
    ASCENT_DEGREES_OF_FREEDOM,
    ASCENT_FEWEST,
    ASCENT_HEIGHT_AT_FIRST,
    ASCENT_LEAN,
    ASCENT_LEAST_SIGMA,
    ASCENT_OFF_AT_FIRST,
    ASCENT_RATE,
    ASCENT_REPEATS,
    ASCENT_SPEED_AT_FIRST,
    ASCENT_WANDERING,
)
from brv_hypo.errors import UsageError
from brv_hypo.flight.noise import MAD_TO_SIGMA
from brv_hypo.flight.phases import GRAVITY


@dataclass(frozen=True)
class Ascent:
    """`velocity` (n,) m/s and `altitude` (n,) m, with the standard deviation `sigma` (n,) m/s of the speed."""

    velocity: FloatArray
    altitude: FloatArray
    sigma: FloatArray
    note: str


def ascent(time: FloatArray, ax: FloatArray, altitude: FloatArray) -> Ascent:
    """Speed from `ax` (n,) m/s^2 and `altitude` (n,) m, NaN where missing, at increasing `time` (n,) s.

    Raises UsageError where too little of either is known.
    """
    both = np.isfinite(ax) & np.isfinite(altitude)
    if np.count_nonzero(both) < ASCENT_FEWEST:
        raise UsageError(
            f"derive/velocity: ax and altitude are both known at {np.count_nonzero(both)} samples, expected at least "
            f"{ASCENT_FEWEST}. Likely cause: the recorders' clocks do not overlap. Remedy: correct offset or align of "
            "the second recorder's time."
        )
    first, last = time[both][0], time[both][-1]
    grid = np.arange(first, last, 1.0 / ASCENT_RATE)
    known = np.isfinite(ax)
    pushed = _mean_between(grid, time[known], ax[known]) - GRAVITY
    heights = np.interp(grid, time[both], altitude[both])
    weights = np.ones(grid.size)
    spread = ASCENT_LEAST_SIGMA
    for _ in range(ASCENT_REPEATS):
        state, variance = _smoothed(pushed, heights, spread**2 / weights)
        residual = heights - state[:, 0]
        spread = max(ASCENT_LEAST_SIGMA, MAD_TO_SIGMA * float(np.median(np.abs(residual))))
        weights = (ASCENT_DEGREES_OF_FREEDOM + 1.0) / (ASCENT_DEGREES_OF_FREEDOM + (residual / spread) ** 2)
    leaning = 0.5 * ASCENT_LEAN**2 * np.abs(state[:, 1])
    sigma = np.sqrt(variance[:, 1] + leaning**2)
    inside = (time >= first) & (time <= grid[-1])

    def at(values: FloatArray) -> FloatArray:
        return np.where(inside, np.interp(time, grid, values), np.nan)

    note = (
        f"velocity derived from ax and altitude on a steep climb: known to {np.median(sigma):.2g} m/s (a lean of the "
        f"path of {np.degrees(ASCENT_LEAN):.0f} deg included), altitudes to {spread:.2g} m"
    )
    return Ascent(at(state[:, 1]), at(state[:, 0]), at(sigma), note)


def _mean_between(grid: FloatArray, time: FloatArray, values: FloatArray) -> FloatArray:
    """Mean of `values` over the interval of `grid` (m,) that ends at each of its points."""
    area = np.concatenate([[0.0], np.cumsum(0.5 * (values[1:] + values[:-1]) * np.diff(time))])
    return np.asarray(np.diff(np.interp(grid, time, area), prepend=0.0) * ASCENT_RATE)


def _smoothed(
    pushed: FloatArray, heights: FloatArray, variances: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """States (n, 3) of height, speed and what the acceleration is off, and their variances (n, 3)."""
    step = 1.0 / ASCENT_RATE
    moves = np.array([[1.0, step, 0.5 * step**2], [0.0, 1.0, step], [0.0, 0.0, 1.0]])
    enters = np.array([0.5 * step**2, step, 0.0])
    wanders = np.diag([0.0, 0.0, ASCENT_WANDERING**2 * step])
    count = heights.size
    before, spread_before = np.empty((count, 3)), np.empty((count, 3, 3))
    after, spread_after = np.empty((count, 3)), np.empty((count, 3, 3))
    state = np.array([heights[0], 0.0, 0.0])
    spread = np.diag([ASCENT_HEIGHT_AT_FIRST**2, ASCENT_SPEED_AT_FIRST**2, ASCENT_OFF_AT_FIRST**2])
    for k in range(count):
        if k:
            state = moves @ state + enters * pushed[k]
            spread = moves @ spread @ moves.T + wanders
        before[k], spread_before[k] = state, spread
        gain = spread[:, 0] / (spread[0, 0] + variances[k])
        state = state + gain * (heights[k] - state[0])
        spread = spread - np.outer(gain, spread[0])
        after[k], spread_after[k] = state, spread
    for k in range(count - 2, -1, -1):
        back = np.linalg.solve(spread_before[k + 1], moves @ spread_after[k]).T
        after[k] += back @ (after[k + 1] - before[k + 1])
        spread_after[k] += back @ (spread_after[k + 1] - spread_before[k + 1]) @ back.T
    return after, np.einsum("nii->ni", spread_after)
