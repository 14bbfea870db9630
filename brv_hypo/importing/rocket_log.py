"""What a raw rocket log needs before it is a record: one clock, one inertial unit, no biases, a speed, a lower rate.

Further units (`together`): brought to the axes of the first, and averaged.
Two clocks (`clock_offset`): the offset at which the correlation of what both recorders sensed is largest.
Biases from the pad (`take_out_biases`): a gyro at rest reads its bias (the turning of the Earth, 0.004 deg/s, is
below most). An accelerometer at rest reads gravity: along the nose, up to the rail's unknown lean, that gives the
bias; across it, lean and bias are confounded, and what is read there becomes the tolerance of the bias.
Speed of a climb (`ascent`): dh/dt = V cos(lean), dV/dt = ax - g cos(lean), the nose along the path on average. The
lean is that of the nose by the gyros from the pad on, less a slow random walk; it, scale and bias of the accelerometer
follow from the altitudes, which force and lean together must explain. Altitudes off the climb have less weight
(Student's t), those near Mach 1 none: a shock is at the port.
Lower rate (`decimated`): a linear-phase low-pass, then the rate that the motion needs; nothing is aliased.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.ndimage import uniform_filter1d
from scipy.spatial.transform import Rotation

from brv_hypo.arrays import FloatArray
from brv_hypo.errors import UsageError
from brv_hypo.flight.cleaning import despiked, mask_faults
from brv_hypo.flight.clock import MAD_TO_SIGMA, TIMES_NOISE, joined, less_trend, regularise
from brv_hypo.flight.derived import HIGHEST_ALTITUDE, LOWEST_ALTITUDE, atmosphere
from brv_hypo.flight.plausibility import GRAVITY
from brv_hypo.flight.record import ACCELEROMETERS, GYROS, INERTIAL_CHANNELS, Channels, Record, RecordFault
from brv_hypo.flight.units import Dimension

ATTITUDE: Mapping[str, Dimension] = {"lean": "angle"}  # of the nose from the vertical, as the log has it
SAME_AXES = np.radians(5.0)  # rad between the gyros of two units, below which the difference is misalignment
CLOCK_STEPS_PER_SAMPLE = 2.0  # of the slower recorder: the grid of offsets that are tried
CLOCK_LEAST_OVERLAP = 0.3  # of the shorter record
CLOCK_LEAST_CORRELATION = 0.8  # of what both recorders sensed, below which no offset is accepted
PAD_FEWEST_SAMPLES = 20  # from which biases are taken
PAD_LEANING = math.radians(2.0)  # rad, by which a lean that no accelerometer's bias explains may be one all the same
PAD_MOUNTED = math.radians(1.0)  # rad, 1-sigma between the unit's x axis and the nose
PAD_OFF_GRAVITY = 0.05  # of gravity that a reading at rest may be off: bias and scale of any accelerometer
PAD_UPRIGHT = 0.7  # cosine of the lean, up to 45 deg, that a rail has
PAD_MOVING = math.radians(2.0)  # rad/s of standard deviation: beyond any wind on a rail
ASCENT_RATE, ASCENT_KNOTS = 20.0, 2.0  # Hz at which the climb is computed; s between the knots of lean and bias
ASCENT_LEAN, ASCENT_LEAN_SIGMA = math.radians(12.0), math.radians(8.0)  # rad: of a path without a pad
# rad per root second by which nose and path part, and gyros err; by which a path bends that no gyros follow
ASCENT_DRIFT, ASCENT_TURNING = math.radians(0.7), math.radians(5.0)
ASCENT_SWING, ASCENT_TOP = 1.0, 1.0  # s over which the nose swings about the path; over which the top is found
ASCENT_HEIGHT, ASCENT_AT_REST = 100.0, 0.3  # m and m/s, 1-sigma at the end of the pad
ASCENT_UNKNOWN_SPEED = 0.3  # of the climb, 1-sigma of the speed with which a record without pad begins
ASCENT_BIAS, ASCENT_BIAS_WALK = 0.1, 0.1  # m/s^2 (and per root second), 1-sigma of the axial accelerometer
ASCENT_SCALE = 0.005  # 1-sigma of its scale
ASCENT_SLANT = 0.18  # of the highest speed, 1-sigma of that along the ground where no gyros show the lean
ASCENT_WIND, ASCENT_WIND_ALONG = 5.5, 0.3  # m/s, 1-sigma; the part of it, at most, along the path (17 deg of lean)
ASCENT_LEAST_SIGMA = 1.0  # m: no barometer is better
ASCENT_HELD = 0.5  # share of altitudes that change, below which the others are taken for held
ASCENT_TRANSONIC = (0.85, 1.25)  # Mach numbers at which a shock is at the barometer's port
ASCENT_MOST_TRANSONIC = 0.7  # of the climb, beyond which such altitudes are all there is
ASCENT_STEEP, ASCENT_END = 0.5, 0.25  # cosine of the lean near the top, left out; s before the last altitude
ASCENT_REPEATS, ASCENT_DEGREES_OF_FREEDOM = (8, 4.0)  # rounds; of Student's t: altitudes off the climb count less
ASCENT_GYROS_OFF = 3.0  # times the altitudes are missed by more with the lean of the gyros, which are then in doubt
ASCENT_FEWEST = 20  # samples with force and altitude
# Samples that a transverse cycle keeps: a moment is differentiated from its rates, delays are shorter than a cycle.
DECIMATED_PER_CYCLE = 30.0
DECIMATED_FEWEST = 500.0  # samples of a window, if it has them, before the ends of the filter are left out
DECIMATED_WORTH = 1.3  # times the requested rate, below which a filter costs more than it saves
DECIMATED_LEAST_GAIN = 2.0  # times the samples that the motion needs, below which a record is left as it is
DECIMATED_PASS_END = 0.3  # of the new rate
DECIMATED_STOP_BEGIN = 0.5  # of the new rate: nothing is aliased
DECIMATED_STOP_DECIBEL = 60.0  # by which the filter stops
DECIMATED_REACH = 12.0  # samples of the new rate: half the length of such a filter, and more
DECIMATED_KNOWN = 0.6  # share of the filter's weight that must lie on samples that are there
VIBRATION = 20.0  # Hz: no rigid vehicle oscillates faster
Climb = tuple[FloatArray, FloatArray, FloatArray, list[str]]


def together(first: Channels, further: Sequence[Channels]) -> tuple[Channels, list[str]]:
    """Means of the inertial channels (n,), SI, over all units, and a note on what each further one differs by."""
    units = [first, *(_in_axes_of(first, unit) for unit in further)]
    several = {name: [unit[name] for unit in units if name in unit] for name in INERTIAL_CHANNELS if name in first}
    mean = {name: np.ma.masked_invalid(np.stack(each)).mean(axis=0).filled(np.nan) for name, each in several.items()}
    notes = []
    for number, unit in enumerate(units[1:], 2):
        off = {name: float(np.sqrt(np.nanmean((unit[name] - first[name]) ** 2))) for name in mean if name in unit}
        said = ", ".join(f"{name} {size:.2g}" for name, size in off.items())
        notes.append(f"units {number} and 1 differ by {said} (rms, SI): averaged")
    return first | mean, notes


def _in_axes_of(first: Channels, unit: Channels) -> Channels:
    """The unit in the axes of the first, by the gyros of both where these are elsewhere."""
    rates = [np.stack([each[name] for name in GYROS]) for each in (first, unit) if {*GYROS} <= {*each}]
    if len(rates) < 2:
        return unit
    known = np.all(np.isfinite(rates), axis=(0, 1))
    spread = [each[:, known] - np.mean(each[:, known], axis=1, keepdims=True) for each in rates]
    turn, _ = Rotation.align_vectors(spread[0].T, spread[1].T)
    if turn.magnitude() < SAME_AXES:
        return unit
    triads = [names for names in (GYROS, ACCELEROMETERS) if {*names} <= {*unit}]
    for names in triads:
        unit = unit | dict(zip(names, turn.as_matrix() @ np.stack([unit[name] for name in names]), strict=True))
    return unit


def clock_offset(
    time: FloatArray, values: FloatArray, other_time: FloatArray, other: FloatArray
) -> tuple[float, float]:
    """Seconds to add to `other_time` so that `other` runs as `values` does, and their correlation then. Times (n,) and
    (m,) s, increasing; scale and a constant of the values do not matter. Raises UsageError where the two never agree.
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
    top = 0.0
    around = score[max(best - 1, 0) : best + 2]
    if around.size == 3 and np.all(np.isfinite(around)) and (bend := around[0] - 2.0 * around[1] + around[2]) < 0.0:
        top = 0.5 * (around[0] - around[2]) / bend  # of the parabola through the three best, between the grid's points
    lag = best + top - (second.size - 1)
    return float(time[0] + lag * step - other_time[0]), float(likeness[best])


def _on_grid(time: FloatArray, values: FloatArray, step: float) -> FloatArray:
    known = np.isfinite(values)
    found = np.interp(np.arange(time[0], time[-1], step), time[known], values[known])
    return np.asarray(found - np.mean(found))


@dataclass(frozen=True)
class Rest:
    """What the pad shows: until when the vehicle is at rest (s), the rail's lean and its 1-sigma error, rad."""

    stop_s: float
    lean: float
    lean_sigma: float
    leans: FloatArray | None  # of the nose (n,) rad at the record's samples, from the gyros after the pad


def lean_by_gyros(time: FloatArray, rates: FloatArray, up: FloatArray) -> FloatArray:
    """Lean of the nose (n,) rad from `rates` (3, n) rad/s without biases, `up` (3,) being up in body axes at first."""
    known = np.stack([joined(each) for each in rates])
    turns = Rotation.from_rotvec((-0.5 * (known[:, 1:] + known[:, :-1]) * np.diff(time)).T).as_matrix()
    ups = [up]
    ups += [up := turn @ up for turn in turns]
    return np.asarray(np.arccos(np.clip([each[0] for each in ups], -1.0, 1.0)))


def take_out_biases(
    time: FloatArray, channels: Mapping[str, FloatArray], pad: tuple[float, float], mounting_sigma: float = PAD_MOUNTED
) -> tuple[Channels, Rest, dict[str, tuple[float, float, float]], list[str]]:
    """`channels` (n,), SI, less the biases that the samples of `time` (n,) s within `pad` show, and the rest there.
    Also 1-sigma tolerances that follow, SI, and notes. `mounting_sigma` rad is the error of the nose. Raises UsageError
    where the vehicle is not at rest, nose up, between those times.
    """
    inside = (time >= pad[0]) & (time <= pad[1])
    held = {name: values[inside] for name, values in channels.items()}
    count = int(np.count_nonzero(inside))
    if count < PAD_FEWEST_SAMPLES:
        holds = f"holds {count} samples, expected at least {PAD_FEWEST_SAMPLES}"
        runs = f"the record runs from {time[0]:.3f} to {time[-1]:.3f} s"
        raise UsageError(f"the map's pad, {pad[0]:g} to {pad[1]:g} s, {holds}: {runs}.")
    reads = np.array([float(np.nanmean(held[name])) for name in ACCELEROMETERS])
    norm, swings = float(np.linalg.norm(reads)), max(float(np.nanstd(held[name])) for name in GYROS)
    if abs(norm - GRAVITY) > PAD_OFF_GRAVITY * GRAVITY or reads[0] < PAD_UPRIGHT * norm or swings > PAD_MOVING:
        raise UsageError(
            f"the map's pad, {pad[0]:g} to {pad[1]:g} s: ax reads {reads[0]:.3g} of {norm:.3g} m/s^2 and the gyros "
            f"swing by {np.degrees(swings):.2g} deg/s, expected gravity along the nose and rest. Likely cause: times "
            "after ignition, another axis or sign of ax, or wrong units. Remedy: correct the times or the map."
        )
    biases = {name: float(np.nanmean(held[name])) for name in GYROS}
    biases_text = ", ".join(f"{name} {np.degrees(bias):.3g} deg/s" for name, bias in biases.items())
    biases["ax"] = (norm - GRAVITY) * float(reads[0] / norm)
    changed = {name: values - biases.get(name, 0.0) for name, values in channels.items()}
    lean = float(np.arccos(reads[0] / norm))
    rates = np.where(time < pad[1], 0.0, np.stack([changed[name] for name in GYROS]))
    rest = Rest(pad[1], lean, mounting_sigma, lean_by_gyros(time, rates, reads / norm))
    notes = [
        f"biases from the pad taken out: {biases_text}, ax {biases['ax']:.3g} m/s^2",
        f"ay and az read {reads[1]:.2g} and {reads[2]:.2g} m/s^2 on the pad, bias or a lean of "
        f"{np.degrees(lean):.1f} deg: kept; the tolerance of their bias is as large, or what a usual lean makes",
    ]
    y, z = np.minimum(np.abs(reads[1:]), GRAVITY * PAD_LEANING).tolist()
    along = math.hypot(math.sin(lean) * math.hypot(y, z), 0.5 * GRAVITY * mounting_sigma**2)
    return changed, rest, {"accel_bias": (along, y, z)}, notes


def ascent(
    time: FloatArray, ax: FloatArray, altitude: FloatArray, rest: Rest | None = None, recorded: FloatArray | None = None
) -> Climb:
    """Speed (n,) m/s, altitude (n,) m, the standard deviation (n,) m/s of the speed, and notes; NaN off the climb. From
    `ax` (n,) m/s^2 and `altitude` (n,) m, NaN where missing, at increasing `time` (n,) s, from `rest` on. Without a
    rest, speed and lean at the beginning are open; `recorded` (n,) rad is the lean by the log's own attitude. Raises
    UsageError where too little of either is known.
    """
    free, missed = _climb(time, ax, altitude, rest, None)
    doubts = list[str]()
    known = [("the log's attitude", recorded), ("the gyros", None if rest is None else rest.leans)]
    for by, leans in ((by, leans) for by, leans in known if leans is not None and np.any(np.isfinite(leans))):
        climb, off = _climb(time, ax, altitude, rest, joined(leans))
        if off < ASCENT_GYROS_OFF * missed:
            climb[3].extend([*doubts, *([f"the lean is that of {by}"] if leans is recorded else [])])
            return climb
        doubts.append(
            f"the lean by {by} misses the altitudes by {off:.0f} m, where a path of any lean misses them by "
            f"{missed:.0f} m: axes, signs or units of the gyros are in doubt, and the lean is not theirs"
        )
    free[3].extend(doubts)
    return free


def _climb(
    time: FloatArray, ax: FloatArray, altitude: FloatArray, rest: Rest | None, by_gyros: FloatArray | None
) -> tuple[Climb, float]:
    """As of `ascent`, by one source of the lean (n,) rad, and by how much the altitudes are missed, m."""
    usable = np.isfinite(altitude)
    if np.any(usable):
        width = max(1, round(ASCENT_TOP / float(np.median(np.diff(time)))))
        usable &= time <= time[np.argmax(uniform_filter1d(joined(altitude), width))]
    fresh = usable & (np.diff(altitude, prepend=np.nan) != 0.0)
    if np.count_nonzero(fresh) < ASCENT_HELD * np.count_nonzero(usable):
        usable = fresh  # a value that is held is one of its first sample
    both = np.isfinite(ax) & usable
    if np.count_nonzero(both) < ASCENT_FEWEST:
        raise UsageError(
            f"derive/velocity: ax and altitude are both known at {np.count_nonzero(both)} samples, expected at least "
            f"{ASCENT_FEWEST} of a climb. Likely cause: the altitude falls from the first sample on, as on an entry, "
            "or two recorders' clocks do not overlap. Remedy: map the column of velocity, or correct that offset."
        )
    known = np.isfinite(ax)
    first = time[both][0] if rest is None else max(rest.stop_s, time[known][0])
    grid = np.arange(first, time[both][-1], 1.0 / ASCENT_RATE)
    # Mean acceleration over the interval of the grid that ends at each of its points.
    gained = np.interp(grid, time[known], cumulative_trapezoid(ax[known], time[known], initial=0))
    pushed = np.diff(gained, prepend=gained[0]) * ASCENT_RATE
    heights = np.interp(grid, time[both], altitude[both])
    reached = np.searchsorted(time[both], grid)
    measured = (grid >= time[both][0]) & (np.diff(reached, prepend=reached[0] - 1) > 0)
    lean_first, lean_sigma = (ASCENT_LEAN, ASCENT_LEAN_SIGMA) if rest is None else (rest.lean, rest.lean_sigma)
    nose, drift = np.full(grid.size, lean_first), ASCENT_TURNING
    if by_gyros is not None:
        width = round(ASCENT_SWING * ASCENT_RATE)
        nose, drift = uniform_filter1d(np.interp(grid, time, by_gyros), width, mode="nearest"), ASCENT_DRIFT
    climb = 0.0 if rest else float(np.polyfit(grid[:ASCENT_FEWEST], heights[:ASCENT_FEWEST], 1)[0])
    speed_sigma = ASCENT_AT_REST if rest else max(ASCENT_UNKNOWN_SPEED * abs(climb), ASCENT_AT_REST)
    knots = np.arange(grid[0], grid[-1] + ASCENT_KNOTS, ASCENT_KNOTS)
    walk = np.array([[drift], [ASCENT_BIAS_WALK]]) * np.full((2, knots.size), np.sqrt(ASCENT_KNOTS))
    walk[:, 0] = lean_sigma, ASCENT_BIAS
    sigmas = np.array([ASCENT_HEIGHT, speed_sigma, ASCENT_SCALE, *walk.ravel()])

    def flown(unknown: FloatArray) -> FloatArray:
        """Speed, height and lean (3, n) by height, speed, scale, and random walks of lean and bias, in sigmas."""
        height, speed, scale, *walks = sigmas * unknown
        off = [np.interp(grid, knots, np.cumsum(part)) for part in np.reshape(walks, (2, -1))]
        lean = nose + off[0]
        push = pushed * (1.0 + scale) + off[1] - GRAVITY * np.cos(lean)
        speeds = climb + speed + np.cumsum(push) / ASCENT_RATE
        climbed = cumulative_trapezoid(speeds * np.cos(lean), grid, initial=0)
        return np.stack([speeds, heights[0] + height + climbed, lean])

    unknown, weights = np.zeros(sigmas.size), np.where(measured, ASCENT_LEAST_SIGMA**-2.0, 0.0)
    for _ in range(ASCENT_REPEATS):  # Gauss-Newton
        change = np.array([flown(unknown + step) - flown(unknown) for step in 1e-3 * np.eye(unknown.size)]) / 1e-3
        by_height = change[:, 1] * weights
        inverse = np.linalg.inv(by_height @ change[:, 1].T + np.eye(unknown.size))
        unknown = unknown + inverse @ (by_height @ (heights - flown(unknown)[1]) - unknown)
        speed, height, lean = flown(unknown)
        residual = heights - height
        mach = speed / atmosphere(np.clip(height, LOWEST_ALTITUDE, HIGHEST_ALTITUDE), "speed_of_sound")
        transonic = measured & (mach > ASCENT_TRANSONIC[0]) & (mach < ASCENT_TRANSONIC[1])
        counted = measured & ~transonic if np.sum(transonic) < ASCENT_MOST_TRANSONIC * np.sum(measured) else measured
        spread = max(ASCENT_LEAST_SIGMA, MAD_TO_SIGMA * float(np.median(np.abs(residual[counted]))))
        steps = np.diff(residual[counted])  # white noise steps by twice its variance
        correlation = float(np.clip(1.0 - 0.5 * np.var(steps) / max(np.var(residual[counted]), 1e-12), 0.0, 0.95))
        # Student's t; and what follows the sample before it says less.
        far = (ASCENT_DEGREES_OF_FREEDOM + (residual / spread) ** 2) / (ASCENT_DEGREES_OF_FREEDOM + 1.0)
        weights = np.where(counted, (1.0 - correlation) / (1.0 + correlation) / far / spread**2, 0.0)
    deviations = np.sqrt(np.einsum("ikn,ij,jkn->kn", change, inverse, change))
    # The nose points along the flow, the climb is over the ground: wind along the path is between them. Where no gyros
    # follow the lean from a pad, a steep path cannot be distinguished from a vertical one.
    slant = 0.0 if by_gyros is not None else (ASCENT_SLANT * speed.max()) ** 2 / (2.0 * np.maximum(speed, 1.0))
    wind = ASCENT_WIND * np.minimum(np.hypot(np.sin(lean), deviations[2]), ASCENT_WIND_ALONG)
    sigma = np.sqrt(deviations[0] ** 2 + slant**2 + wind**2)
    leaving = np.flatnonzero((np.cos(lean) < ASCENT_STEEP) & (speed < 0.5 * speed.max()))
    stop = min(grid[-1] - ASCENT_END, grid[leaving[0]] if leaving.size else np.inf)
    inside = (time >= first) & (time <= stop)
    fast = (speed > 0.3 * speed.max()) & (grid <= stop)
    notes = [
        f"velocity derived from ax and altitude on a path that leans by {np.degrees(lean[fast][0]):.0f} to "
        f"{np.degrees(lean[fast][-1]):.0f} deg: known to {np.median(sigma[fast]):.2g} m/s, at worst to "
        f"{np.max(sigma[fast]):.2g} m/s, altitudes to {spread:.2g} m; left out from {stop:.2f} s on"
    ]
    if np.any(transonic):
        when, off = grid[transonic], residual[transonic]
        reads = f"reads up to {off[np.argmax(np.abs(off))]:+.0f} m off the climb"
        fate = "counts" if counted is measured else "is left out"
        notes.append(f"near Mach 1, {when[0]:.2f} to {when[-1]:.2f} s, the barometer {reads}, and {fate}")
    found = [np.where(inside, np.interp(time, grid, values), np.nan) for values in (speed, height, sigma)]
    return (found[0], found[1], found[2], notes), spread


# ---- Fewer samples, none of them aliased: a record at the rate that the motion needs ----


def needed_rate(time: FloatArray, channels: Mapping[str, FloatArray]) -> float | None:
    """Samples per second, Hz, that the motion in q and r needs; None where the record has little more. The motion is
    the strongest per octave, between rates and the moments that change them: a slow trend is none.
    """
    grid, uniform, _ = regularise(time, {name: channels[name] for name in ("q", "r")})
    before = (grid.size - 1) / float(grid[-1] - grid[0])
    q, r = (less_trend(joined(uniform[name])) for name in ("q", "r"))
    power = np.abs(np.fft.fft((q + 1j * r) * np.hanning(grid.size))) ** 2
    frequency = np.abs(np.fft.fftfreq(grid.size, 1.0 / before))
    # Vibration is faster than any oscillation, and may be stronger; noise is level.
    kept = (frequency < VIBRATION) & (power > TIMES_NOISE * np.median(power))
    if not np.any(kept & (power > 0.0)):
        return None
    motion_frequency = float(frequency[np.argmax(np.where(kept, power * frequency, 0.0))])
    rate = max(DECIMATED_PER_CYCLE * motion_frequency, DECIMATED_FEWEST / float(grid[-1] - grid[0]))
    return float(np.ceil(rate)) if 0.0 < DECIMATED_LEAST_GAIN * rate <= before else None


def decimated(record: Record, rate: float) -> tuple[Record, tuple[RecordFault, ...]]:
    """The record at `rate` Hz, or itself if that gains little; the faults, masked before the filter spreads them."""
    stamps, masked, faults = mask_faults(record.time, record.channels)
    clean, _, spike_notes = despiked(stamps, masked)
    notes = [*(f"{one.channel}: {one.fault}, {one.action}" for one in faults), *spike_notes]
    time, uniform, resampled = regularise(stamps, clean)
    before = (time.size - 1) / float(time[-1] - time[0])
    if rate * DECIMATED_WORTH > before:
        return record, ()
    taps = low_pass(before, rate)
    grid = np.arange(time[0], time[-1], 1.0 / rate)
    # Between the dense stamps of what is band-limited straight lines do.
    channels = {name: np.interp(grid, time, _filtered(values, taps)) for name, values in uniform.items()}
    notes += [
        *resampled,
        f"decimated from {before:.6g} to {rate:.6g} Hz by the map's rate (auto: what q and r need), by a linear-phase "
        f"low-pass that passes {DECIMATED_PASS_END * rate:.3g} and stops {DECIMATED_STOP_BEGIN * rate:.3g} Hz",
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
