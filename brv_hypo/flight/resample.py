"""Uniform time without gaps: the rules by which a record is resampled, bridged or cut.

Uniform: every stamp lies within 1 % of the step from the grid that fits them best; such a record keeps its
stamps. Missing rows in an otherwise uniform record become missing samples. Any other record is resampled to
its mean step (of intervals up to 2.5 times the median) by a cubic spline through the samples that it has; a
grid point between two samples further apart than 1.5 steps, or beside a missing sample, is missing.

Bridged (cubic spline): a gap of at most `longest_gap`, that is 5 samples and an eighth of the dominant
transverse oscillation, where a cubic is within 1 % of the amplitude; 1 s in the slowly varying air data.
Longer gaps cut.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from brv_hypo.arrays import BoolArray, FloatArray, IntArray
from brv_hypo.constants import (
    BRIDGED_CYCLES,
    BRIDGED_SAMPLES,
    CROSSED_CYCLES,
    CROSSED_FLANK,
    CROSSED_ORDER,
    GAP_BEYOND_MEDIANS,
    LARGEST_GROWTH,
    MISSING_BEYOND_STEPS,
    UNIFORM_WITHIN,
)
from brv_hypo.flight.refusal import refusal

Channels = dict[str, FloatArray]


def regularise(
    time: FloatArray, channels: Mapping[str, FloatArray]
) -> tuple[FloatArray, Channels, tuple[str, ...]]:
    """Uniform time (m,), the channels (m,) on it with NaN where missing, and a note on what was done.

    Raises FlightRecordError where `time` jumps so far that a uniform grid would be mostly empty.
    """
    step = float(np.median(np.diff(time)))
    index = np.concatenate(([0], np.cumsum(np.maximum(np.rint(np.diff(time) / step), 1.0)))).astype(np.int64)
    if max(index[-1] + 1, (time[-1] - time[0]) / step) > LARGEST_GROWTH * time.size:
        raise refusal(
            "time",
            f"a span of {time[-1] - time[0]:.6g} s with {time.size} samples {step:.6g} s apart",
            "a record without jumps that dwarf it",
            "a wrong stamp, a clock reset, or two flights in one record",
            "correct the stamps, or split the record",
        )
    slope, offset = np.polyfit(index, time - time[0], 1)
    deviation = float(np.max(np.abs(time - time[0] - offset - slope * index)) / slope)
    if deviation > UNIFORM_WITHIN:
        return _resampled(time, channels, deviation)
    if index[-1] + 1 == time.size:
        return time, dict(channels), ()
    grid = time[0] + offset + slope * np.arange(index[-1] + 1)
    note = f"{grid.size - time.size} rows are missing from the uniform time axis and count as missing samples"
    return grid, {name: _placed(values, index, grid.size) for name, values in channels.items()}, (note,)


def places_with_gaps(time: FloatArray, longest: int) -> IntArray:
    """Where each sample (n,) lies on an axis that has a place for what its gaps miss, `longest` at most in each."""
    steps = np.diff(time) / float(np.median(np.diff(time)))
    missing = np.where(steps > MISSING_BEYOND_STEPS, np.clip(np.rint(steps) - 1.0, 1.0, longest), 0.0)
    return np.concatenate(([0], np.cumsum(1 + missing.astype(np.int64))))


def bridge(time: FloatArray, values: FloatArray, longest: int) -> FloatArray:
    """`values` (n,) at `time` (n,), gaps of at most `longest` samples filled by a cubic spline."""
    from scipy.interpolate import CubicSpline

    missing = np.isnan(values)
    known = np.flatnonzero(~missing)
    if known.size == values.size or known.size < 4:
        return values
    short = np.zeros_like(missing)
    for start, stop in runs(missing):
        short[start:stop] = start > 0 and stop < values.size and stop - start <= longest
    filled = values.copy()
    filled[short] = CubicSpline(time[known], values[known])(time[short])
    return filled


def longest_gap(step: float, q: FloatArray, r: FloatArray) -> int:
    """The longest gap, in samples and at least 1, that may be bridged in the gyros and accelerometers."""
    return int(np.clip(BRIDGED_CYCLES * _cycle(step, q, r), 1, BRIDGED_SAMPLES))


def longest_crossed(step: float, q: FloatArray, r: FloatArray) -> int:
    """The longest gap, in samples, across which the rates are known well enough to carry the attitude."""
    return int(min(CROSSED_CYCLES * _cycle(step, q, r), q.size))


def _cycle(step: float, q: FloatArray, r: FloatArray) -> float:
    """Samples of a cycle of the transverse motion."""
    frequency = max(dominant_frequency(q, step), dominant_frequency(r, step))
    return np.inf if frequency == 0.0 else 1.0 / (frequency * step)


def runs(chosen: BoolArray) -> tuple[tuple[int, int], ...]:
    """The index ranges [start, stop) over which `chosen` (n,) is true."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], chosen, [False])).astype(np.int8)))
    return tuple((int(a), int(b)) for a, b in edges.reshape(-1, 2))


def joined(values: FloatArray) -> FloatArray:
    """`values` (n,) with every NaN replaced along straight lines, ends held: placeholders."""
    known = np.flatnonzero(np.isfinite(values))
    return values if known.size == values.size else np.interp(np.arange(values.size), known, values[known])


def crossed(values: FloatArray, longest: int) -> FloatArray:
    """`values` (n,) with placeholders for every NaN: quintics through the samples about gaps of at most `longest`.

    The attitude is carried across a gap by what the rates were in it. As many samples count on either side as are
    missing, eight at least, so that their noise hardly shows; longer gaps are replaced along straight lines.
    """
    whole = joined(values)
    missing = np.isnan(values)
    for start, stop in runs(missing):
        flank = max(CROSSED_FLANK, stop - start)
        about = np.arange(max(0, start - flank), min(values.size, stop + flank))
        known = about[~missing[about]]
        if stop - start > longest or np.sum(known < start) <= CROSSED_ORDER or np.sum(known >= stop) <= CROSSED_ORDER:
            continue
        middle, reach = 0.5 * (start + stop), 0.5 * (stop - start) + flank
        course = np.polynomial.Polynomial.fit((known - middle) / reach, values[known], CROSSED_ORDER)
        whole[start:stop] = course((np.arange(start, stop) - middle) / reach)
    return whole


def _resampled(
    time: FloatArray, channels: Mapping[str, FloatArray], deviation: float
) -> tuple[FloatArray, Channels, tuple[str, ...]]:
    intervals = np.diff(time)
    step = float(np.mean(intervals[intervals <= GAP_BEYOND_MEDIANS * np.median(intervals)]))
    grid = time[0] + step * np.arange(int((time[-1] - time[0]) / step * (1.0 + 1e-12)) + 1)
    note = (
        f"time is not uniform (a stamp is {100.0 * deviation:.2g} % of the step off): resampled to "
        f"{1.0 / step:.6g} Hz, the mean rate, by a cubic spline"
    )
    return grid, {name: _interpolated(time, values, grid, step) for name, values in channels.items()}, (note,)


def _interpolated(time: FloatArray, values: FloatArray, grid: FloatArray, step: float) -> FloatArray:
    """Spline values on the grid, NaN wherever the record has no sample close by on either side."""
    from scipy.interpolate import CubicSpline

    known = np.flatnonzero(np.isfinite(values))
    if known.size < 4:
        return np.full(grid.size, np.nan)
    after = np.clip(np.searchsorted(time, grid), 1, time.size - 1)
    apart = time[after] - time[after - 1] > MISSING_BEYOND_STEPS * step
    beside = np.isnan(values[after]) | np.isnan(values[after - 1])
    result: FloatArray = CubicSpline(time[known], values[known])(grid)
    result[apart | beside] = np.nan
    return result


def _placed(values: FloatArray, index: np.typing.NDArray[np.int64], size: int) -> FloatArray:
    grid = np.full(size, np.nan)
    grid[index] = values
    return grid


def strongest_frequency(q: FloatArray, r: FloatArray, step: float, segments: Sequence[tuple[int, int]]) -> float:
    """Frequency of the strongest transverse motion, Hz, over the longest of `segments`; 0 where nothing varies.

    `q` and `r` (n,), `step` in s.
    """
    start, stop = max(segments, key=lambda segment: segment[1] - segment[0])
    return max(dominant_frequency(rate[start:stop], step) for rate in (q, r))


def dominant_frequency(values: FloatArray, step: float) -> float:
    """Frequency of the highest peak of the periodogram, Hz; 0 where nothing varies."""
    if np.count_nonzero(np.isfinite(values)) < 4:
        return 0.0
    whole = joined(values)
    spectrum = np.abs(np.fft.rfft((whole - np.mean(whole)) * np.hanning(whole.size)))
    return float(np.argmax(spectrum) / (whole.size * step)) if spectrum.max() > 0.0 else 0.0
