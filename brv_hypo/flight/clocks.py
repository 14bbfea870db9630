"""Two recorders, two clocks: how late one is, from what both sensed."""

from __future__ import annotations

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.constants import CLOCK_LEAST_CORRELATION, CLOCK_LEAST_OVERLAP, CLOCK_STEPS_PER_SAMPLE
from brv_hypo.errors import UsageError


def clock_offset(
    time: FloatArray, values: FloatArray, other_time: FloatArray, other: FloatArray
) -> tuple[float, float]:
    """Seconds to add to `other_time` so that `other` runs as `values` does, and their correlation then.

    Times (n,) and (m,) s, increasing; scale and a constant of the values do not matter. Raises UsageError where the
    two never agree.
    """
    from scipy.signal import correlate

    step = max(float(np.median(np.diff(each))) for each in (time, other_time)) / CLOCK_STEPS_PER_SAMPLE
    first, second = _on_grid(time, values, step), _on_grid(other_time, other, step)
    ones = correlate(np.ones_like(first), np.ones_like(second), method="fft").round()
    sums = [correlate(a, b, method="fft") for a, b in _products(first, second)]
    with np.errstate(divide="ignore", invalid="ignore"):
        mean_1, mean_2 = sums[1] / ones, sums[2] / ones
        together = sums[0] / ones - mean_1 * mean_2
        apart = np.sqrt((sums[3] / ones - mean_1**2) * (sums[4] / ones - mean_2**2))
        likeness = np.where(ones > CLOCK_LEAST_OVERLAP * min(first.size, second.size), together / apart, -np.inf)
    # Where either is at rest any other course fits as well: what agrees must also be most of what there is.
    spoken = np.sqrt(np.clip((sums[3] / ones - mean_1**2) / max(float(np.var(first)), 1e-300), 0.0, 1.0))
    score = np.where(np.isfinite(likeness), likeness, -np.inf) * np.maximum(spoken, 1e-9)
    best = int(np.argmax(score))
    if not likeness[best] >= CLOCK_LEAST_CORRELATION:
        raise UsageError(
            f"the second recorder's clock cannot be found: the two records agree to a correlation of "
            f"{max(float(likeness[best]), 0.0):.2f} at best, expected {CLOCK_LEAST_CORRELATION} or more. Likely "
            "cause: align names columns that do not sense the same, or one of opposite sign. Remedy: give the offset "
            "of its time."
        )
    lag = best + _peak(score, best) - (second.size - 1)
    return float(time[0] + lag * step - other_time[0]), float(likeness[best])


def _on_grid(time: FloatArray, values: FloatArray, step: float) -> FloatArray:
    known = np.isfinite(values)
    found = np.interp(np.arange(time[0], time[-1], step), time[known], values[known])
    return np.asarray(found - np.mean(found))


def _products(first: FloatArray, second: FloatArray) -> list[tuple[FloatArray, FloatArray]]:
    one, two = np.ones_like(first), np.ones_like(second)
    return [(first, second), (first, two), (one, second), (first**2, two), (one, second**2)]


def _peak(score: FloatArray, best: int) -> float:
    """Where between the grid's points the parabola through the three best has its top."""
    if not 0 < best < score.size - 1 or not np.all(np.isfinite(score[best - 1 : best + 2])):
        return 0.0
    left, middle, right = score[best - 1 : best + 2]
    bend = left - 2.0 * middle + right
    return 0.0 if bend >= 0.0 else float(0.5 * (left - right) / bend)
