"""Signals in time: uniform stamps without gaps, steps of the clock, and the one estimate of white noise.

Uniform: every stamp lies within 1 % of the step from the grid that fits them best; such a record keeps its
stamps. One whose stamps lie there within the rounding of their last digit gets the grid. Missing rows in an
otherwise uniform record become missing samples. Any other record is resampled to its mean step (of intervals up to
2.5 times the median) by a cubic spline through the samples that it has; a grid point between two samples further
apart than 1.5 steps, or beside a missing sample, is missing.

Bridged (cubic spline): a gap of at most `longest_gap`, that is 5 samples and an eighth of the dominant
transverse oscillation, where a cubic is within 1 % of the amplitude; 1 s in the slowly varying air data.
Longer gaps cut the record into segments.

Clock steps: stamps that jump where the motion is continuous (`stamped_steps`, corrected), and motion that jumps
in gyros and accelerometers together where the stamps are even (`joint_jumps`, which no force or moment does).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.polynomial import Polynomial

import brv_hypo.thresholds as limits
from brv_hypo.arrays import BoolArray, ComplexArray, FloatArray
from brv_hypo.flight.record import ACCELEROMETERS, GYROS, INERTIAL_CHANNELS, Channels
from brv_hypo.io.text import refusal

# Differences of this order, for a channel's white noise, cut a motion of 14 samples per cycle by five decades.
NOISE_DIFFERENCES = 8

MAD_TO_SIGMA = 1.4826
MEDIAN_LENGTH_TO_SIGMA = 1.0 / math.sqrt(2.0 * math.log(2.0))  # of a vector of two such values: Rayleigh
ROUNDED_WITHIN = 0.6  # last digits of stamps, from an even clock: half of one, and some for what was rounded twice
ROUNDED_FINELY = 0.25  # steps: a coarser digit tells no rate
CLOCK_FLANK = 6  # samples on either side of an odd interval
# A channel jumps where the parabolas before and after, of so many samples, miss each other by so many robust standard
# deviations, and by so many times the misses up to so many flanks away: parabolas miss fast motion all the time.
JUMP_FLANK = 8
JUMP_AROUND = 5
# Cycles of the transverse motion that a quintic crosses, its flanks as long as the gap, to 1e-3 of the amplitude.
CROSSED_CYCLES = 1.0 / 8.0
CROSSED_FLANK = 8  # samples on either side at least
CROSSED_ORDER = 5  # of the polynomial
TIMES_NOISE = 20.0  # median power of a spectrum, beyond which a peak is no noise: chance gives 10 in 1000 lines
TREND = 3  # degree of the polynomial through a rate that is no motion
ONE_CYCLE = 1.5  # cycles in a record up to which its spectrum's peak is that of one: no period repeats


def sigma_of_differences(pieces: Sequence[FloatArray | ComplexArray]) -> float:
    """White-noise sigma of a channel from its `pieces`, each (n,), NaN where missing; NaN where all are too short. The
    difference of order k scales white noise by sqrt(binomial(2 k, k)) and a sinusoid by (2 sin(w h / 2))^k; the median
    of its absolute value keeps spikes and jumps out. A complex channel is two real ones of one sigma.
    """
    differences = np.concatenate([np.diff(piece, NOISE_DIFFERENCES) for piece in pieces]) if pieces else np.zeros(0)
    finite = differences[np.isfinite(differences)]
    if not finite.size:
        return float("nan")
    scale = MEDIAN_LENGTH_TO_SIGMA if np.iscomplexobj(finite) else MAD_TO_SIGMA
    return scale * float(np.median(np.abs(finite))) / math.sqrt(math.comb(2 * NOISE_DIFFERENCES, NOISE_DIFFERENCES))


def regularise(time: FloatArray, channels: Mapping[str, FloatArray]) -> tuple[FloatArray, Channels, tuple[str, ...]]:
    """Uniform time (m,), channels (m,) with NaN where missing, notes; FlightRecordError if it would be mostly empty."""
    step = float(np.median(np.diff(time)))
    index = np.concatenate(([0], np.cumsum(np.maximum(np.rint(np.diff(time) / step), 1.0)))).astype(np.int64)
    if max(index[-1] + 1, (time[-1] - time[0]) / step) > limits.LARGEST_GROWTH * time.size:
        found = f"a span of {time[-1] - time[0]:.6g} s with {time.size} samples {step:.6g} s apart"
        expected = "a record without jumps that dwarf it"
        cause = "a wrong stamp, a clock reset, or two flights in one record"
        remedy = "correct the stamps, or split the record"
        raise refusal("time", found, expected, cause, remedy)
    slope, offset = np.polyfit(index, time - time[0], 1)
    deviation = float(np.max(np.abs(time - time[0] - offset - slope * index)) / slope)
    grid, notes = time[0] + offset + slope * np.arange(index[-1] + 1), list[str]()
    if deviation > limits.UNIFORM_WITHIN:
        digit = _last_digit(time)
        if digit > ROUNDED_FINELY * slope or deviation * slope > ROUNDED_WITHIN * digit:
            return _resampled(time, channels, deviation)
        notes = [f"stamps are rounded to {digit:g} s: those of an even clock of {1.0 / slope:.6g} Hz are taken"]
    if grid.size == time.size:
        return (grid if notes else time), dict(channels), tuple(notes)
    notes.append(f"{grid.size - time.size} rows are missing from the uniform time axis and count as missing samples")
    placed = {}
    for name, values in channels.items():
        placed[name] = np.full(grid.size, np.nan)
        placed[name][index] = values
    return grid, placed, tuple(notes)


def _last_digit(time: FloatArray) -> float:
    """The decimal digit, s, that all stamps (n,) are whole multiples of; 0 where they have too many."""
    rounding = 4.0 * np.spacing(np.max(np.abs(time)))
    digits = (10.0**-places for places in range(9))
    return next((each for each in digits if np.all(np.abs(time - each * np.rint(time / each)) <= rounding)), 0.0)


def bridge(time: FloatArray, values: FloatArray, longest: int) -> FloatArray:
    """`values` (n,) at `time` (n,), gaps of at most `longest` samples filled by a cubic spline."""
    from scipy.interpolate import CubicSpline

    missing = np.isnan(values)
    known = np.flatnonzero(~missing)
    if known.size == values.size or known.size < 4:
        return values
    filled, spline = values.copy(), CubicSpline(time[known], values[known])
    for start, stop in runs(missing):
        if start > 0 and stop < values.size and stop - start <= longest:
            filled[start:stop] = spline(time[start:stop])
    return filled


def longest_gap(step: float, q: FloatArray, r: FloatArray) -> int:
    """The longest gap, in samples and at least 1, that may be bridged in the gyros and accelerometers."""
    return int(np.clip(limits.BRIDGED_CYCLES * _cycle(step, q, r), 1, limits.BRIDGED_SAMPLES))


def longest_crossed(step: float, q: FloatArray, r: FloatArray) -> int:
    """The longest gap, in samples, across which the rates are known well enough to carry the attitude."""
    return int(min(CROSSED_CYCLES * _cycle(step, q, r), q.size))


def _cycle(step: float, q: FloatArray, r: FloatArray) -> float:
    """Samples of a cycle of the transverse motion."""
    frequency = transverse_frequency(q, r, step)
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
    """`values` (n,) with placeholders for every NaN: quintics through the samples about gaps of at most `longest`. The
    attitude is carried across a gap by what the rates were in it. As many samples count on either side as are missing,
    eight at least, so that their noise hardly shows; longer gaps are replaced along straight lines.
    """
    whole = joined(values)
    missing = np.isnan(values)
    for start, stop in runs(missing):
        flank = max(CROSSED_FLANK, stop - start)
        about = np.arange(max(0, start - flank), min(values.size, stop + flank))
        known = about[~missing[about]]
        if stop - start > longest or np.sum(known < start) <= CROSSED_ORDER or np.sum(known >= stop) <= CROSSED_ORDER:
            continue
        whole[start:stop] = Polynomial.fit(known, values[known], CROSSED_ORDER)(np.arange(start, stop))
    return whole


def _resampled(
    time: FloatArray, channels: Mapping[str, FloatArray], deviation: float
) -> tuple[FloatArray, Channels, tuple[str, ...]]:
    """As of `regularise`, by splines: NaN wherever the record has no sample close by on either side."""
    from scipy.interpolate import CubicSpline

    intervals = np.diff(time)
    step = float(np.mean(intervals[intervals <= limits.GAP_BEYOND_MEDIANS * np.median(intervals)]))
    grid = time[0] + step * np.arange(int((time[-1] - time[0]) / step * (1.0 + 1e-12)) + 1)
    after = np.clip(np.searchsorted(time, grid), 1, time.size - 1)
    apart = time[after] - time[after - 1] > limits.MISSING_BEYOND_STEPS * step
    resampled = {}
    for name, values in channels.items():
        known = np.isfinite(values)
        resampled[name] = np.full(grid.size, np.nan)
        if np.count_nonzero(known) >= 4:
            near = ~(apart | np.isnan(values[after]) | np.isnan(values[after - 1]))
            resampled[name][near] = CubicSpline(time[known], values[known])(grid)[near]
    note = (
        f"time is not uniform (a stamp is {100.0 * deviation:.2g} % of the step off): resampled to "
        f"{1.0 / step:.6g} Hz, the mean rate, by a cubic spline"
    )
    return grid, resampled, (note,)


def transverse_frequency(q: FloatArray, r: FloatArray, step: float, times_noise: float = 0.0) -> float:
    """Frequency of the strongest motion in q and r (n,), Hz; 0 without power of `times_noise` the median."""
    frequencies = [0.0]
    for rate in (q, r):
        if np.count_nonzero(np.isfinite(rate)) >= 4:
            whole = joined(rate)
            spectrum = np.abs(np.fft.rfft((whole - np.mean(whole)) * np.hanning(whole.size)))
            peak = spectrum.max() ** 2 > times_noise * np.median(spectrum**2)
            frequencies.append(float(np.argmax(spectrum) / (whole.size * step)) if peak else 0.0)
    return max(frequencies)


def less_trend(rate: FloatArray) -> FloatArray:
    """A rate (n,) without gaps, less a polynomial of degree `TREND` in time."""
    place = np.arange(rate.size)
    return np.asarray(rate - Polynomial.fit(place, rate, min(TREND, rate.size - 1))(place))


def strongest_frequency(q: FloatArray, r: FloatArray, step: float, segments: Sequence[tuple[int, int]]) -> float:
    """`transverse_frequency` over the longest of `segments`, less a trend; 0 where no motion is periodic."""
    start, stop = max(segments, key=lambda segment: segment[1] - segment[0])
    frequency = transverse_frequency(less_trend(q[start:stop]), less_trend(r[start:stop]), step, TIMES_NOISE)
    return frequency if frequency * (stop - start) * step > ONE_CYCLE else 0.0


def stamped_steps(time: FloatArray, channels: Mapping[str, FloatArray]) -> tuple[tuple[int, float], ...]:
    """Indices of samples before which the clock was set ahead, and by how much, s. Only in a record of otherwise
    uniform stamps: the samples on either side of the interval lie on one smooth course if it is closed, else on none.
    """
    intervals = np.diff(time)
    step = float(np.median(intervals))
    odd = np.flatnonzero(np.abs(intervals - step) > limits.UNIFORM_WITHIN * step)
    if not 0 < odd.size <= limits.CLOCK_MOST_STEPS:
        return ()
    places = [int(place) for place in odd if intervals[place] > limits.MISSING_BEYOND_STEPS * step]
    steps = [(place + 1, float(intervals[place] - step)) for place in places]
    return tuple((at, excess) for at, excess in steps if _runs_on(time, channels, at, excess))


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
            # Whether the trend of the channel would carry it, in `excess` s, well beyond its noise.
            centred = closed - closed.mean()
            slope = abs(float(centred @ values)) / float(centred @ centred)
            known = slope > limits.CLOCK_SLOPE_SIGMAS * sigma / float(np.linalg.norm(centred))
            moved += known and slope * excess > limits.CLOCK_MOVED_SIGMAS * sigma
    if moved < limits.CLOCK_FEWEST_MOVED:
        return False
    most = max(limits.CLOCK_RUNS_ON, limits.CLOCK_FAR_BETTER * float(np.mean(stamped)))
    return float(np.mean(misfits)) < most and max(misfits) < limits.CLOCK_WORST_CHANNEL * most


def _misfit(time: FloatArray, values: FloatArray, sigma: float) -> float:
    """Mean square residual of a cubic, per degree of freedom, over `sigma` squared."""
    residual = values - Polynomial.fit(time, values, 3)(time)
    return float(residual @ residual) / (time.size - 4) / sigma**2


def joint_jumps(channels: Mapping[str, FloatArray]) -> tuple[int, ...]:
    """Indices before which gyros and accelerometers jump together: samples lost, or repeated, without a trace. No force
    or moment does that: a rate cannot jump. All channels jump by what they change by in one time: forces that turn
    about in a step, as the wind passes the nose, do not.
    """
    found_in = {name: _jumps(values) for name, values in channels.items()}
    gyros, accelerometers = (
        [each for name in triad if (each := found_in.get(name)) is not None] for triad in (GYROS, ACCELEROMETERS)
    )
    if not gyros or not accelerometers:
        return ()
    both = np.minimum(*(np.max([np.abs(jump) for jump, _ in some], axis=0) for some in (gyros, accelerometers)))
    left, found = both.copy(), list[int]()
    while left.size and float(left.max()) > limits.JUMP_SIGMAS and len(found) <= limits.CLOCK_MOST_STEPS:
        at = int(np.argmax(left))
        left[max(0, at - JUMP_FLANK) : at + JUMP_FLANK + 1] = 0.0
        before = both[max(0, at - JUMP_AROUND * JUMP_FLANK) : max(0, at - JUMP_FLANK)]
        after = both[at + JUMP_FLANK + 1 : at + JUMP_AROUND * JUMP_FLANK]
        around = max(float(part.max(initial=0.0)) for part in (before, after))
        jumps, slopes = np.array([(jump[at], slope[at]) for jump, slope in (*gyros, *accelerometers)]).T
        explained = float(jumps @ slopes) ** 2 / max(float(slopes @ slopes) * float(jumps @ jumps), 1e-300)
        if (
            min(before.size, after.size) > JUMP_FLANK
            and both[at] > limits.JUMP_TIMES_AROUND * around
            and explained > limits.JUMP_EXPLAINED
        ):
            found.append(at)
    return tuple(sorted(found)) if len(found) <= limits.CLOCK_MOST_STEPS else ()


def _jumps(values: FloatArray) -> tuple[FloatArray, FloatArray] | None:
    """Jump (n,) before each sample and its change a step, in robust sigmas; None if short or constant."""
    # Of the samples about a place, half a step away: slope and value of the parabola after it less that before.
    _, slope, value = np.linalg.pinv(np.vander(np.arange(JUMP_FLANK) + 0.5, 3))
    bends, weights = np.concatenate([slope[::-1], slope]), np.concatenate([-value[::-1], value])
    inside = slice(JUMP_FLANK, values.size - JUMP_FLANK + 1)
    if values.size < 4 * JUMP_FLANK:
        return None
    jump, rate = np.full(values.size, np.nan), np.zeros(values.size)
    jump[inside] = np.correlate(values, weights, "valid")
    finite = jump[np.isfinite(jump)]
    scale = MAD_TO_SIGMA * float(np.median(np.abs(finite))) if finite.size else 0.0
    if scale == 0.0:
        return None
    # A kink (a moment that sets in) lies within half a step, and makes no more of a jump than this.
    kink = np.abs(np.correlate(values, bends, "valid"))
    jump[inside][np.abs(jump[inside]) < kink] = 0.0
    rate[inside] = 0.5 * np.correlate(values, np.concatenate([-slope[::-1], slope]), "valid")
    return np.nan_to_num(jump) / scale, np.nan_to_num(rate) / scale
