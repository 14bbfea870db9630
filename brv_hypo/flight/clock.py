"""Steps of the clock: stamps that jump where the motion runs on, and motion that jumps where the stamps run on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.constants import (
    CLOCK_FAR_BETTER,
    CLOCK_FEWEST_MOVED,
    CLOCK_FLANK,
    CLOCK_MOST_STEPS,
    CLOCK_MOVED_SIGMAS,
    CLOCK_RUNS_ON,
    CLOCK_SLOPE_SIGMAS,
    CLOCK_WORST_CHANNEL,
    JUMP_AROUND,
    JUMP_FLANK,
    JUMP_SIGMAS,
    JUMP_TIMES_AROUND,
    MISSING_BEYOND_STEPS,
    UNIFORM_WITHIN,
)
from brv_hypo.flight.noise import MAD_TO_SIGMA, sigma_of_differences
from brv_hypo.flight.record import ACCELEROMETERS, GYROS, INERTIAL_CHANNELS


def stamped_steps(time: FloatArray, channels: Mapping[str, FloatArray]) -> tuple[tuple[int, float], ...]:
    """Indices of samples before which the clock was set ahead, and by how much, s.

    Only in a record of otherwise uniform stamps: the samples on either side of the interval lie on one smooth
    course if it is closed, and on none as it is stamped.
    """
    intervals = np.diff(time)
    step = float(np.median(intervals))
    odd = np.flatnonzero(np.abs(intervals - step) > UNIFORM_WITHIN * step)
    if not 0 < odd.size <= CLOCK_MOST_STEPS:
        return ()
    found = []
    for place in odd:
        excess = float(intervals[place] - step)
        if intervals[place] > MISSING_BEYOND_STEPS * step and _runs_on(
            time, channels, int(place) + 1, excess
        ):
            found.append((int(place) + 1, excess))
    return tuple(found)


def _runs_on(time: FloatArray, channels: Mapping[str, FloatArray], at: int, excess: float) -> bool:
    """Whether the samples lie on one course with the interval closed, though in its time they would have moved."""
    part = slice(max(0, at - CLOCK_FLANK), at + CLOCK_FLANK)
    closed = np.where(np.arange(time.size)[part] >= at, time[part] - excess, time[part])
    if closed.size < 2 * CLOCK_FLANK:
        return False
    misfits, stamped, moved = [], [], 0
    for name in INERTIAL_CHANNELS:
        values = channels[name][part] if name in channels else np.array([np.nan])
        sigma = sigma_of_differences([channels[name]]) if name in channels else 0.0
        if sigma > 0.0 and np.all(np.isfinite(values)):
            misfits.append(_misfit(closed, values, sigma))
            stamped.append(_misfit(time[part], values, sigma))
            moved += _would_move(closed, values, sigma, excess)
    if moved < CLOCK_FEWEST_MOVED:
        return False
    most = max(CLOCK_RUNS_ON, CLOCK_FAR_BETTER * float(np.mean(stamped)))
    return float(np.mean(misfits)) < most and max(misfits) < CLOCK_WORST_CHANNEL * most


def _would_move(time: FloatArray, values: FloatArray, sigma: float, excess: float) -> bool:
    """Whether the trend of a channel would carry it, in `excess` s, well beyond its noise."""
    centred = time - time.mean()
    slope = abs(float(centred @ values)) / float(centred @ centred)
    known = slope > CLOCK_SLOPE_SIGMAS * sigma / float(np.linalg.norm(centred))
    return known and slope * excess > CLOCK_MOVED_SIGMAS * sigma


def _misfit(time: FloatArray, values: FloatArray, sigma: float) -> float:
    """Mean square residual of a cubic, per degree of freedom, over `sigma` squared."""
    columns = np.vander(2.0 * (time - time[0]) / (time[-1] - time[0]) - 1.0, 4)
    residual = values - columns @ np.linalg.lstsq(columns, values, rcond=None)[0]
    return float(residual @ residual) / (time.size - 4) / sigma**2


def joint_jumps(channels: Mapping[str, FloatArray]) -> tuple[int, ...]:
    """Indices before which gyros and accelerometers jump together: samples lost, or repeated, without a trace.

    No force or moment does that: a rate cannot jump.
    """
    gyros = _jumping([channels[name] for name in GYROS if name in channels])
    accelerometers = _jumping([channels[name] for name in ACCELEROMETERS if name in channels])
    both = np.minimum(gyros, accelerometers)
    left, found = both.copy(), list[int]()
    while left.size and float(left.max()) > JUMP_SIGMAS and len(found) <= CLOCK_MOST_STEPS:
        at = int(np.argmax(left))
        left[max(0, at - JUMP_FLANK) : at + JUMP_FLANK + 1] = 0.0
        before = both[max(0, at - JUMP_AROUND * JUMP_FLANK) : max(0, at - JUMP_FLANK)]
        after = both[at + JUMP_FLANK + 1 : at + JUMP_AROUND * JUMP_FLANK]
        around = max(float(part.max(initial=0.0)) for part in (before, after))
        if min(before.size, after.size) > JUMP_FLANK and both[at] > JUMP_TIMES_AROUND * around:
            found.append(at)
    return tuple(sorted(found)) if len(found) <= CLOCK_MOST_STEPS else ()


def _jumping(channels: Sequence[FloatArray]) -> FloatArray:
    """The largest jump (n,) of some channels before each sample, in robust standard deviations."""
    largest = np.zeros(channels[0].size if channels else 0)
    slopes, weights = _weights()
    for values in channels:
        if values.size < 4 * JUMP_FLANK:
            continue
        jump = np.full(values.size, np.nan)
        inside = slice(JUMP_FLANK, values.size - JUMP_FLANK + 1)
        jump[inside] = np.correlate(values, weights, "valid")
        finite = jump[np.isfinite(jump)]
        scale = MAD_TO_SIGMA * float(np.median(np.abs(finite))) if finite.size else 0.0
        if scale > 0.0:
            # A kink (a moment that sets in) lies within half a step, and makes no more of a jump than this.
            kink = np.abs(np.correlate(values, slopes, "valid"))
            jump[inside][np.abs(jump[inside]) < kink] = 0.0
            largest = np.maximum(largest, np.nan_to_num(np.abs(jump)) / scale)
    return largest


def _weights() -> tuple[FloatArray, FloatArray]:
    """Of the samples about a place, half a step away: slope and value of the parabola after it less that before."""
    columns = np.vander(np.arange(JUMP_FLANK) + 0.5, 3)
    _, slope, value = np.linalg.pinv(columns)
    return np.concatenate([slope[::-1], slope]), np.concatenate([-value[::-1], value])
