"""What a raw rocket log needs before it is a record: one clock, no biases, a speed, a lower rate.

Two clocks (`clock_offset`): the offset at which the correlation of what both recorders sensed is largest.
Biases from the pad (`take_out_biases`): a gyro at rest reads its bias (the turning of the Earth, 0.004 deg/s, is
below most). An accelerometer at rest reads gravity: along the nose, up to the rail's unknown lean, that gives the
bias; across it, lean and bias are confounded, and what is read there becomes the tolerance of the bias.
Speed of a steep climb (`ascent`): the nose is taken as up and along the path, dh/dt = v, dv/dt = ax - g + d, where
d (lean of the path, bias of the accelerometer) is a slow random walk. Altitude and accelerometer are joined by a
Kalman filter and the smoother of Rauch, Tung and Striebel (AIAA J. 3, 1965); altitudes that leave the climb, as a
barometer's do near Mach 1, have less weight (Student's t).
Lower rate (`decimated`): a linear-phase low-pass, then the rate that the motion needs; nothing is aliased.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.errors import UsageError
from brv_hypo.flight.cleaning import find_spikes, mask_faults, spike_note, without_spikes
from brv_hypo.flight.clock import MAD_TO_SIGMA, regularise, transverse_frequency
from brv_hypo.flight.inspection import AT_REST, GRAVITY
from brv_hypo.flight.record import GYROS, Channels, Record, RecordFault

CLOCK_STEPS_PER_SAMPLE = 2.0  # of the slower recorder: the grid of offsets that are tried
CLOCK_LEAST_OVERLAP = 0.3  # of the shorter record
CLOCK_LEAST_CORRELATION = 0.8  # of what both recorders sensed, below which no offset is believed
PAD_FEWEST_SAMPLES = 20  # from which biases are taken
PAD_LEANING = math.radians(5.0)  # rad, 1-sigma of the rail's lean: launch rails stand within some 5 deg of the vertical
PAD_MOVING = math.radians(2.0)  # rad/s of standard deviation: beyond any wind on a rail
ASCENT_RATE = 20.0  # Hz at which the filter runs: the speed has no faster content that a barometer could tell
ASCENT_WANDERING = 0.3  # m/s^2 per root second: the lean of a path bends as it turns over
ASCENT_HEIGHT_AT_FIRST = 100.0  # m, 1-sigma
ASCENT_SPEED_AT_FIRST = 1e3  # m/s, 1-sigma: unknown
ASCENT_OFF_AT_FIRST = 0.3  # m/s^2, 1-sigma, of what the acceleration is off
ASCENT_LEAN = math.radians(10.0)  # rad, 1-sigma of the path's lean: the speed is that much larger than its climb
ASCENT_LEAST_SIGMA = 1.0  # m: no barometer is better
ASCENT_REPEATS = 6  # rounds of weights
ASCENT_DEGREES_OF_FREEDOM = 4.0  # of Student's t, by which altitudes off the climb count less
ASCENT_FEWEST = 20  # samples with force and altitude
# Samples that a cycle of the transverse oscillation keeps: a moment is differentiated from its rates, and delays are
# shorter than a cycle.
DECIMATED_PER_CYCLE = 30.0
DECIMATED_LEAST_GAIN = 2.0  # times the samples that the motion needs, below which a record is left as it is
DECIMATED_PASS_END = 0.3  # of the new rate
DECIMATED_STOP_BEGIN = 0.5  # of the new rate: nothing is aliased
DECIMATED_STOP_DECIBEL = 60.0  # by which the filter stops
DECIMATED_KNOWN = 0.6  # share of the filter's weight that must lie on samples that are there
VIBRATION = 20.0  # Hz: no rigid vehicle oscillates faster


# ---- Two recorders, two clocks: how late one is, from what both sensed ----


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
    one, two = np.ones_like(first), np.ones_like(second)
    products = ((first, second), (first, two), (one, second), (first**2, two), (one, second**2))
    sums = [correlate(a, b, method="fft") for a, b in products]
    ones = correlate(one, two, method="fft").round()
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


def _peak(score: FloatArray, best: int) -> float:
    """Where between the grid's points the parabola through the three best has its top."""
    if not 0 < best < score.size - 1 or not np.all(np.isfinite(score[best - 1 : best + 2])):
        return 0.0
    left, middle, right = score[best - 1 : best + 2]
    bend = left - 2.0 * middle + right
    return 0.0 if bend >= 0.0 else float(0.5 * (left - right) / bend)


# ---- Biases from the pad: what gyros and accelerometers read of a rocket at rest, nose up ----


def take_out_biases(
    time: FloatArray, channels: Mapping[str, FloatArray], rest: tuple[float, float]
) -> tuple[Channels, dict[str, tuple[float, float, float]], list[str]]:
    """`channels` (n,), SI, less the biases that the samples of `time` (n,) s within `rest` show.

    Also 1-sigma tolerances that follow, SI, and notes. Raises UsageError where the vehicle is not at rest, nose up,
    between those times.
    """
    inside = (time >= rest[0]) & (time <= rest[1])
    held = {name: values[inside] for name, values in channels.items()}
    count = int(np.count_nonzero(inside))
    if count < PAD_FEWEST_SAMPLES:
        raise UsageError(
            f"the map's pad, {rest[0]:g} to {rest[1]:g} s, holds {count} samples, expected at least "
            f"{PAD_FEWEST_SAMPLES}: the record runs from {time[0]:.3f} to {time[-1]:.3f} s."
        )
    axial = float(np.nanmean(held["ax"]))
    swings = max(float(np.nanstd(held[name])) for name in GYROS)
    if abs(axial - GRAVITY) > AT_REST or swings > PAD_MOVING:
        raise UsageError(
            f"the map's pad, {rest[0]:g} to {rest[1]:g} s: ax reads {axial:.3g} m/s^2 and the gyros swing by "
            f"{np.degrees(swings):.2g} deg/s, expected gravity along the nose and rest. Likely cause: times after "
            "ignition, another sign of ax, or wrong units. Remedy: correct the times or the map."
        )
    biases = {name: float(np.nanmean(held[name])) for name in GYROS}
    biases["ax"] = axial - GRAVITY * float(np.exp(-0.5 * PAD_LEANING**2))
    changed = {name: values - biases.get(name, 0.0) for name, values in channels.items()}
    biases_text = ", ".join(f"{name} {np.degrees(biases[name]):.3g} deg/s" for name in GYROS)
    across = [abs(float(np.nanmean(held[name]))) for name in ("ay", "az")]
    lean = 0.5 * GRAVITY * PAD_LEANING**2
    notes = [
        f"biases from the pad taken out: {biases_text}, ax {biases['ax']:.3g} m/s^2",
        f"ay and az read {across[0]:.2g} and {across[1]:.2g} m/s^2 on the pad, bias or lean of the rail: kept, and "
        "within the tolerance of their bias",
    ]
    return changed, {"accel_bias": (lean, across[0], across[1])}, notes


# ---- Speed and altitude of a steep climb ----


def ascent(time: FloatArray, ax: FloatArray, altitude: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, str]:
    """Speed (n,) m/s, altitude (n,) m, the standard deviation (n,) m/s of the speed, and a note.

    From `ax` (n,) m/s^2 and `altitude` (n,) m, NaN where missing, at increasing `time` (n,) s. Raises UsageError where
    too little of either is known.
    """
    from scipy.integrate import cumulative_trapezoid

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
    # Mean acceleration over the interval of the grid that ends at each of its points.
    gained = np.interp(grid, time[known], cumulative_trapezoid(ax[known], time[known], initial=0))
    pushed = np.diff(gained, prepend=0.0) * ASCENT_RATE - GRAVITY
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
    return at(state[:, 1]), at(state[:, 0]), at(sigma), note


def _smoothed(pushed: FloatArray, heights: FloatArray, variances: FloatArray) -> tuple[FloatArray, FloatArray]:
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


# ---- Fewer samples, none of them aliased: a record at the rate that the motion needs ----


def needed_rate(time: FloatArray, channels: Mapping[str, FloatArray]) -> float | None:
    """Samples per second, Hz, that the motion in q and r needs; None where the record has little more."""
    grid, uniform, _ = regularise(time, {name: channels[name] for name in ("q", "r")})
    before = (grid.size - 1) / float(grid[-1] - grid[0])
    thinned, every = list(uniform.values()), 1
    # Vibration is faster than any oscillation, and may be stronger.
    if before > DECIMATED_LEAST_GAIN * VIBRATION / DECIMATED_PASS_END:
        every = int(before * DECIMATED_PASS_END / VIBRATION)
        thinned = [_filtered(values, low_pass(before, before / every))[::every] for values in thinned]
    rate = DECIMATED_PER_CYCLE * transverse_frequency(thinned[0], thinned[1], every / before)
    return float(np.ceil(rate)) if 0.0 < DECIMATED_LEAST_GAIN * rate <= before else None


def decimated(record: Record, rate: float) -> tuple[Record, tuple[RecordFault, ...]]:
    """The record at `rate` Hz, itself where it has no more samples than that; the faults that were masked before.

    Faults are masked and spikes replaced before the filter, which would spread them.
    """
    stamps, masked, faults = mask_faults(record.time, record.channels)
    notes = [f"{one.channel}: {one.fault}, {one.action}" for one in faults]
    clean = {}
    for name, values in masked.items():
        spikes = find_spikes(values)
        clean[name] = without_spikes(stamps, values, spikes) if np.any(spikes) else values
        notes += [spike_note(name, spikes, stamps)] if np.any(spikes) else []
    time, uniform, resampled = regularise(stamps, clean)
    before = (time.size - 1) / float(time[-1] - time[0])
    if rate >= before:
        return record, ()
    taps = low_pass(before, rate)
    grid = np.arange(time[0], time[-1], 1.0 / rate)
    # Between the dense stamps of what is band-limited straight lines do.
    channels = {name: np.interp(grid, time, _filtered(values, taps)) for name, values in uniform.items()}
    notes += [
        *resampled,
        f"decimated from {before:.6g} to {rate:.6g} Hz, behind a linear-phase low-pass that passes "
        f"{DECIMATED_PASS_END * rate:.3g} and stops {DECIMATED_STOP_BEGIN * rate:.3g} Hz",
    ]
    update = {"time": grid, "channels": channels, "notes": (*record.notes, *notes)}
    return record.model_copy(update=update), faults


def low_pass(before: float, after: float) -> FloatArray:
    """Taps (odd,) of the low-pass for decimation from `before` to `after` Hz; they add up to one."""
    from scipy.signal import firwin, kaiserord

    width = (DECIMATED_STOP_BEGIN - DECIMATED_PASS_END) * after
    count, beta = kaiserord(DECIMATED_STOP_DECIBEL, width / (0.5 * before))
    middle = 0.5 * (DECIMATED_PASS_END + DECIMATED_STOP_BEGIN) * after
    return np.asarray(firwin(count | 1, middle, window=("kaiser", beta), fs=before))


def _filtered(values: FloatArray, taps: FloatArray) -> FloatArray:
    """`values` (n,) filtered; NaN where too little is known, and at the ends, where the filter is not full."""
    from scipy.signal import fftconvolve

    half = taps.size // 2
    if values.size <= 2 * half:
        return np.full(values.size, np.nan)
    known = np.isfinite(values)
    total = fftconvolve(known.astype(float), taps, "valid")
    with np.errstate(divide="ignore", invalid="ignore"):
        smooth = fftconvolve(np.where(known, values, 0.0), taps, "valid") / total
    result = np.full(values.size, np.nan)
    result[half : values.size - half] = np.where(total > DECIMATED_KNOWN, smooth, np.nan)
    return result
