"""Physics that no record breaks, and what it shows of how the inertial unit is mounted in the vehicle.

Thrust, drag and spin lie along the nose (`nose_axis`), over the whole record:

    transverse force = tilt * axial force + c V^2 + bias       trim grows with V^2, thrust does not
    transverse rate  = tilt * spin                             coning and swinging average out

Each `tilt` from a first guess of the nose is of least squares, its error from sums over blocks longer than a swing. A
turn about the nose is a convention, which nothing shows. Without thrust (`coasting_axis`), mean spin and drag lean by
the trim as well, the drag k times as much, k being the slope of the normal force over the axial: both together show
tilt and trim apart. How gyros are mounted to accelerometers the flow shows
(`relative_axes`): the transverse force opposes the crossflow that follows from rates and speed (`path_into_force`).

`contradictions` names what breaks the physics of any vehicle, with both numbers:

    climb        |dh/dt| <= speed: no vehicle climbs or falls faster than it flies
    fall         of a coast of unknown speed, gravity and drag bend the altitude, of whatever start
    gain         thrust less gravity, integrated once and twice, makes the speed and the height that are gained
    thinning     drag over speed squared goes with altitude as the Earth's density does
    drag         -ax m / (q_inf S) is the axial coefficient of a body
    sound        the speed over the Mach number is a speed of sound in the Earth's air

and `mounting_fault` and `gyro_fault` a unit that is turned, or whose forces do not follow from its rates.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from brv_hypo import thresholds as limits
from brv_hypo.arrays import ComplexArray, FloatArray, Values
from brv_hypo.flight.clock import joined, runs
from brv_hypo.flight.derived import atmosphere
from brv_hypo.flight.record import ACCELEROMETERS, GYROS, RecordFault, Vehicle

GRAVITY = 9.80665  # m/s^2, standard gravity (CGPM 1901)
THRUST = 1.5 * GRAVITY  # m/s^2 sensed, beyond what any instrument's bias makes of gravity
THRUST_SHORTEST, THRUST_SMOOTHED = 0.2, 0.05  # s
REST_OFF = 0.15 * GRAVITY  # m/s^2 by which a reading at rest may be off, or spread
THRUST_TURNS = 3  # of the force along the axis about a thrust: two stages make no more, a swing does
DRAGGED, DRAGGED_SHARE = 0.5, 0.3  # m/s^2 of drag, and the part of what follows a thrust that senses it
BLOCK = 0.4  # s, about half a swing of a sounding rocket: residuals of blocks further apart are independent
THRUST_OFF = np.radians(0.4)  # rad, 1-sigma between mean thrust, with the crosswind at the rail, and the nose
SPIN_OFF = np.radians(0.3)  # rad, 1-sigma between the axis of spin and the nose: trim, principal axis
GYRATION = (0.1, 0.5)  # diameters: a ring of the diameter has 0.5, and 0.1 a core a quarter as wide
ARM_OFF = 0.002  # m, 1-sigma of the place of the accelerometers (tactical)
LEAST_SPIN, LEAST_TURNED = 0.5, 4.0 * np.pi  # rad/s and rad of roll that show the axis of spin
COAST_ROUNDS, COAST_PARTS = 5, ((0.0, 0.5), (0.25, 0.75), (0.5, 1.0), (0.0, 1.0))  # parts of a coast; the last is all
COAST_UNEXPLAINED = 0.1  # share of the transverse force that need not follow from the rates
COAST_AMBIGUOUS = 0.1  # |k - 1| below which mean spin and drag lean by as much, and tilt is no other than trim
SLOW = 0.35  # of the highest speed, below which a coast shows little
FADED = 0.05  # s after the highest speed, until which thrust fades
RELATIVE_SMOOTHED = 0.02  # s: a mean over this takes vibration out
SWING_MOST = 0.5 * np.pi  # rad, rms, by which the nose turns: more is a tumbling body, or wrong units
SCALE_HEIGHT = 8500.0  # m over which the air's density falls by e
FIT_MOST_SAMPLES = 300  # that a relation is thinned to; bounds the time
CLIMB_INTERVALS, CLIMB_SECONDS = 40, 1.0  # of a record at most, and s at least, over which a climb is averaged
GAIN_FASTEST = 250.0  # m/s, up to which a barometer is trusted: below the transonic
GAIN_LEAST = (20.0, 30.0)  # m/s and m, of speed and height gained, from which they are compared
THINNING_LEAST = 0.3  # logarithm of the change of drag that density does not explain, from which it is no axial trend
FALL_STEEP = 0.95  # mean cosine of the lean of a climb
FALL_LEAST = 10.0  # m by which gravity and drag bend the altitude, from which that is compared
DRAG_USUAL = (0.05, 2.0)  # axial coefficients of cones to capsules (Hoerner, Fluid-Dynamic Drag, 1965)
FEET = 0.3048  # m in a foot (international, 1959)
PSF = 47.88026  # Pa in a lbf/ft^2
# What a dynamic pressure was taken for, and how much of it one Pa that was read is.
MISREAD_PRESSURES = {
    "in lbf/ft^2, tagged Pa": PSF,
    "in kPa, tagged Pa": 1e3,
    "in Pa, tagged lbf/ft^2": 1.0 / PSF,
    "in Pa, tagged kPa": 1e-3,
    "of a speed in ft/s, tagged m/s": FEET**2,
}
SLOWEST_MACH = 0.3  # from which a Mach number is known well
DRAG_LEAST = 1.0  # m/s^2 along the axis, beyond any bias
SUPERSONIC = 500.0  # m/s: above, no axial coefficient changes as at Mach 1 (Hoerner, Fluid-Dynamic Drag, 1965, 16)
Air = tuple[FloatArray, FloatArray, FloatArray, float]
"""Speed (n,) m/s, what is proportional to dynamic pressure (n,), the unit's place (3,) m from the c.g., its 1-sigma."""


@dataclass(frozen=True)
class Tilt:
    """The nose in the unit's axes, (3,), the 1-sigma error of its direction, rad, and what lies along it."""

    nose: FloatArray
    sigma: float
    by: str = "thrust and drag"

    @property
    def angle(self) -> float:
        """Between nose and the x axis of the unit, rad."""
        return float(np.arccos(np.clip(self.nose[0], -1.0, 1.0)))

    @property
    def matrix(self) -> FloatArray:
        """The smallest turn (3, 3) of what the unit reads that brings the nose to x."""
        from scipy.spatial.transform import Rotation

        return np.asarray(Rotation.align_vectors([[1.0, 0.0, 0.0]], [self.nose])[0].as_matrix())


def powered_flight(time: FloatArray, forces: FloatArray) -> tuple[FloatArray, FloatArray, tuple[int, int, int]] | None:
    """Mean direction (3,) of the first thrust in forces (3, n) m/s^2, the speed (n,) m/s it makes, and three samples.
    Those of ignition, highest speed, and where drag has brought it down to a part of that. None without thrust, which
    comes after a rest, that senses gravity, or before a drag the other way: an entry's force does neither.
    """
    from scipy.ndimage import uniform_filter1d

    known, step = np.stack([joined(each) for each in forces]), float(np.median(np.diff(time)))
    width = max(1, round(THRUST_SMOOTHED / step))
    size = uniform_filter1d(np.linalg.norm(known, axis=0), width, mode="nearest")
    least = max(2, round(THRUST_SHORTEST / step))
    for start, stop in (run for run in runs(size > THRUST) if run[1] - run[0] >= least):
        axis = known[:, start:stop].sum(axis=1)
        axis /= np.linalg.norm(axis)
        along = axis @ known
        rest = np.percentile(size[: start - least], (10, 50, 90)) if start > 2 * least else np.array([0.0, 0.0, 1e9])
        rested = abs(rest[1] - GRAVITY) < REST_OFF and rest[2] - rest[0] < REST_OFF
        first, last = max(0, start - 4 * (stop - start)), stop + 4 * (stop - start)
        pushed = uniform_filter1d(along[first:last], width, mode="nearest")
        swings = np.count_nonzero(np.diff(np.sign(pushed[np.abs(pushed) > DRAGGED]))) > THRUST_TURNS
        swings |= float(np.median(size[first : start + 1])) > 0.5 * float(np.median(size[start:stop])) and start > least
        if rested or (not swings and float(np.mean(np.append(along[stop:], 0.0) < -DRAGGED)) > DRAGGED_SHARE):
            speed = integral(time, np.where(np.arange(time.size) < start, 0.0, along - GRAVITY))
            if (top := start + int(np.argmax(speed[start:]))) - start >= least:  # else what is sensed drives nothing
                slow = np.flatnonzero(speed[top:] < SLOW * speed[top])
                return axis, speed, (start, top, top + int(slow[0]) if slow.size else time.size)
    return None


def air_of(channels: Mapping[str, FloatArray]) -> tuple[FloatArray, FloatArray] | None:
    """The first two of `Air`, by the channels (n,), SI; None where they do not give them."""
    name = next((name for name in ("dynamic_pressure", "density", "altitude") if name in channels), None)
    if name is None or "velocity" not in channels:
        return None
    scale = channels[name] if name != "altitude" else np.exp(-channels[name] / SCALE_HEIGHT)
    return channels["velocity"], scale if name == "dynamic_pressure" else scale * channels["velocity"] ** 2


def nose_axis(time: FloatArray, rates: FloatArray, forces: FloatArray, air: Air | None = None) -> Tilt | None:
    """The nose by thrust, drag and much spin of `rates` (3, n) rad/s and `forces` (3, n) m/s^2, else by a coast."""
    flown = powered_flight(time, forces)
    if flown is None:
        return None if air is None else coasting_axis(time, rates, forces, air)
    first, speed, (ignition, top, end) = flown
    used = slice(ignition, end)
    square = (speed[used] / max(speed[top], 1.0)) ** 2
    pushed = _tilted(time[used], first, forces[:, used], (square, np.ones_like(square)), THRUST_OFF)
    spin = joined(pushed.nose @ rates[:, used])
    if abs(float(np.trapezoid(spin, time[used]))) <= LEAST_TURNED or abs(np.median(spin)) <= LEAST_SPIN:
        return pushed
    spun = _tilted(time[used], pushed.nose, rates[:, used], (), SPIN_OFF)
    weights = np.array([pushed.sigma, spun.sigma]) ** -2.0
    nose = weights @ np.stack([pushed.nose, spun.nose]) / np.sum(weights)
    apart = 0.5 * float(np.linalg.norm(pushed.nose - spun.nose))  # where the two disagree, their error is of that size
    return Tilt(nose / np.linalg.norm(nose), max(float(np.sum(weights)) ** -0.5, apart), "thrust, drag and spin")


def _tilted(
    time: FloatArray, first: FloatArray, vectors: FloatArray, beside: tuple[FloatArray, ...], floor: float
) -> Tilt:
    """The axis near `first` along which `vectors` (3, n) lie, but for multiples of `beside` across it."""
    known = np.stack([joined(each) for each in vectors])
    axes = np.linalg.svd(first[None])[2]
    across = (axes[1:] @ known).T
    columns = np.stack([first @ known, *beside], axis=1)
    inverse = np.linalg.pinv(columns.T @ columns)
    answer = inverse @ (columns.T @ across)
    score = columns[:, :, None] * (across - columns @ answer)[:, None]
    edges = np.unique(np.searchsorted(time, np.arange(time[0], time[-1], BLOCK)))
    sums = np.add.reduceat(score, edges, axis=0)
    variance = [(inverse @ (part.T @ part) @ inverse)[0, 0] for part in np.moveaxis(sums, 2, 0)]
    nose = first + axes[1:].T @ answer[0]
    return Tilt(nose / np.linalg.norm(nose), float(np.sqrt(np.mean(variance) + floor**2)))


def coasting_axis(time: FloatArray, rates: FloatArray, forces: FloatArray, air: Air) -> Tilt | None:
    """The nose in the longest part without a gap; None without two turns, or where forces follow from no rates."""
    known = np.isfinite(air[0] + air[1] + np.sum(rates, axis=0) + np.sum(forces, axis=0))
    longest = slice(*max(runs(known), key=lambda run: run[1] - run[0], default=(0, 0)))
    time, rates, forces, speed, scale = (each[..., longest] for each in (time, rates, forces, air[0], air[1]))
    turned = np.trapezoid(rates, time, axis=1) if time.size >= limits.MINIMUM_SAMPLES else np.zeros(3)
    size = float(np.linalg.norm(turned))
    if size < LEAST_TURNED:
        return None
    nose = np.asarray(turned / (-size if turned @ forces.sum(axis=1) > 0.0 else size))  # drag points backward
    tilts, step = np.zeros((len(COAST_PARTS), 2)), np.inf
    for _ in range(COAST_ROUNDS):
        matrix = Tilt(nose, 0.0).matrix
        omega = matrix @ rates
        force = matrix @ forces - np.cross(omega.T, np.cross(omega.T, air[2])).T
        squares, slope = path_into_force(time - time[0], omega, force, speed, scale)
        axial = -float(force[0] @ scale) / float(scale @ scale)
        times = slope / axial if axial > 0.0 else 0.0
        if times <= 0.0 or abs(times - 1.0) < COAST_AMBIGUOUS or squares[1] > COAST_UNEXPLAINED * squares[0]:
            return None
        for k, (start, stop) in enumerate(COAST_PARTS):
            part = slice(round(start * time.size), round(stop * time.size))
            window = np.hanning(part.stop - part.start)
            # On average the transverse rate is p xi, whatever the coning: with p the forces count, with drag the rates.
            spun, dragged = (
                (each[1:, part] @ (window * weight[part])) / (each[0, part] @ (window * weight[part]))
                for each, weight in ((omega, scale), (force, omega[0]))
            )
            tilts[k] = (times * spun - dragged) / (times - 1.0)
        # The whole is twice as long as its parts, and its error half of theirs. Where spin and drag lean nearly alike,
        # their difference magnifies the error of each.
        apart = 0.5 * float(np.max(np.linalg.norm(np.diff(tilts[:-1], axis=0), axis=1)))
        lean = np.hypot(SPIN_OFF, air[3] * float(np.mean(omega[0] ** 2)) / abs(float(np.mean(force[0]))))
        sigma = float(np.hypot(apart, np.hypot(times * SPIN_OFF, lean) / abs(times - 1.0)))
        last, step = step, float(np.linalg.norm(tilts[-1]))
        if step < sigma or step > last:
            break
        nose = np.asarray(matrix.T @ np.array([1.0, *tilts[-1]]))
        nose /= np.linalg.norm(nose)
    return Tilt(nose, sigma if step < sigma else sigma + step, "mean spin and drag")  # else not converged


# ---- Gyros against accelerometers: the transverse force opposes the crossflow that follows from the rates ----


def integral(time: FloatArray, values: Values) -> Values:
    """Integral of `values` (n,) from the first sample on, by trapezoids."""
    from scipy.integrate import cumulative_trapezoid

    return np.asarray(cumulative_trapezoid(values, time, initial=0))


def path_into_force(
    time: FloatArray, rates: FloatArray, forces: FloatArray, speed: FloatArray, scale: FloatArray, noise: float = 0.0
) -> tuple[tuple[float, float, float], float]:
    """Relation 1: the transverse of `forces` (3, n) m/s^2, by the crossflow of `rates` (3, n) rad/s at `speed` (n,).
    `scale` (n,) is proportional to the dynamic pressure, `time` (n,) s begins at nought. Squares and slope as of
    `fitted_slopes`; the path starts anywhere, and gravity and wind bend it slowly.
    """
    turn = np.exp(1j * integral(time, rates[0]))
    force = forces[1] + 1j * forces[2]
    xi = integral(time, (1j * speed * (rates[1] + 1j * rates[2]) + force) * turn) * np.conj(turn) / speed
    tau = 2.0 * time / time[-1] - 1.0
    powers = (np.ones_like(tau), tau, tau**2)
    start = [scale / speed * np.conj(turn) * power for power in powers]
    fixed = [each.astype(complex) for each in (powers[0], forces[0], scale, tau)]
    return fitted_slopes(noise, force, [-scale * xi * power for power in powers], [*start, *fixed])


def fitted_slopes(
    noise: float, observed: ComplexArray, slopes: Sequence[ComplexArray], nuisances: Sequence[ComplexArray]
) -> tuple[tuple[float, float, float], float]:
    """`observed` by real slopes, after complex nuisances: the slope on average, and three squares. Those are of what
    nuisances do not explain, of what slopes do not explain either, and of noise of that variance.
    """
    every = max(1, observed.size // FIT_MOST_SAMPLES)
    table = np.stack([*nuisances, *(1j * column for column in nuisances), *slopes, observed], axis=1)[::every]
    rows = np.concatenate([table.real, table.imag])
    count = 2 * len(nuisances)
    norms = np.linalg.norm(rows, axis=0)
    beside, scaled = np.split(rows / np.where(norms > 0.0, norms, 1.0), [count], axis=1)
    rest = scaled - beside @ np.linalg.lstsq(beside, scaled, rcond=1e-8)[0]
    answer = np.linalg.lstsq(rest[:, :-1], rest[:, -1], rcond=1e-8)[0]
    residual = rest[:, -1] - rest[:, :-1] @ answer
    power = float(norms[-1]) ** 2
    fitted = rows[:, count:-1] @ (answer / np.where(norms[count:-1] > 0.0, norms[count:-1], 1.0))
    first = rows[:, count]
    slope = float(first @ fitted / max(float(first @ first), 1e-300)) * float(norms[-1])
    squares = power * float(rest[:, -1] @ rest[:, -1]), power * float(residual @ residual), noise * table.shape[0]
    return squares, slope


def relative_turns() -> Iterator[FloatArray]:
    """The 16 ways (3, 3) in which gyros can be mounted to accelerometers about an axis: signs, y and z exchanged."""
    for swapped, *signs in product((False, True), (1.0, -1.0), (1.0, -1.0), (1.0, -1.0)):
        yield np.diag(signs)[:, [0, 2, 1] if swapped else [0, 1, 2]]


Mounting = tuple[float, str, FloatArray]  # share of the forces that is unexplained, units and turn (3, 3) of the gyros


def relative_axes(
    time: FloatArray,
    rates: FloatArray,
    forces: FloatArray,
    units: Mapping[str, float | FloatArray],
    air: tuple[FloatArray, FloatArray] | None = None,
) -> list[Mounting]:
    """How gyros may be mounted so that the accelerometers follow from them, the best first. `rates` (3, n) in any of
    `units` (sizes in rad/s) less their biases, `forces` (3, n) m/s^2, x to the nose; `air` as of `air_of`, else what
    thrust makes. Empty without a second of coast after thrust, or of known air.
    """
    from scipy.ndimage import uniform_filter1d

    step = float(np.median(np.diff(time)))
    if air is not None:
        speed, scale = air
        used = slice(*max(runs(np.isfinite(speed + scale)), key=lambda run: run[1] - run[0], default=(0, 0)))
    elif (flown := powered_flight(time, forces)) is not None:
        speed, used = flown[1], slice(flown[2][1] + round(FADED / step), flown[2][2])
        scale = speed**2 * np.exp(-integral(time, speed) / SCALE_HEIGHT)
    else:
        return []
    if (used.stop - used.start) * step < 1.0:
        return []
    width = max(1, round(RELATIVE_SMOOTHED / step))
    smooth = np.stack([uniform_filter1d(joined(each), width)[used] for each in (*rates, *forces)])
    since, speed = time[used] - time[used.start], speed[used]
    found = []
    for name, size in units.items():
        for matrix in relative_turns():
            turned = matrix @ (np.reshape(size, (-1, 1)) * smooth[:3])
            squares, slope = path_into_force(since, turned, smooth[3:], speed, scale[used])
            swing = integral(since, (turned[1] + 1j * turned[2]) * np.exp(1j * integral(since, turned[0])))
            possible = slope > 0.0 and float(np.std(swing)) < SWING_MOST
            found.append((squares[1] / squares[0] if possible else 1.0, name, matrix))
    return sorted(found, key=lambda each: each[0])


def is_sure(found: Sequence[Mounting]) -> bool:
    """Whether the first leaves far less unexplained than the next."""
    return bool(found) and found[0][0] <= limits.GYROS_SURE * found[1][0]


def as_turned(triad: Sequence[str], turn: FloatArray) -> str:
    """What a signed permutation (3, 3) makes of a triad's channels: `p, q, r were -p, -q, r`; empty where nothing."""
    axes = np.argmax(np.abs(turn), axis=1)
    names = [("-" if row[axis] < 0.0 else "") + triad[axis] for axis, row in zip(axes, turn, strict=True)]
    return "" if names == list(triad) else f"{', '.join(triad)} were {', '.join(names)}"


# ---- What breaks the physics of any vehicle, and units that are turned ----


def contradictions(
    time: FloatArray, channels: Mapping[str, FloatArray], vehicle: Vehicle | None = None, earth: bool = False
) -> tuple[RecordFault, ...]:
    """Faults of `channels` (n,), SI, NaN where missing, at `time` (n,) s: rates, climb, gain, drag; of the inertia."""
    found = [impossible_rates(time, channels)]
    found += [_climb(time, channels)] if {"altitude", "velocity"} <= set(channels) else []
    if set(ACCELEROMETERS) <= set(channels):
        forces = np.stack([channels[name] for name in ACCELEROMETERS])
        if "altitude" in channels and "velocity" not in channels:
            found.append(_fall(time, forces, channels["altitude"]))
        for name, (recorded, made) in gains(time, forces, channels).items():
            if not limits.GAIN_WITHIN[0] < recorded / made < limits.GAIN_WITHIN[1]:
                unit = "m/s" if name == "velocity" else "m"
                words = (
                    f"{name} gains {recorded:.4g} {unit} in the burn, where the accelerometers make {made:.4g} {unit}: "
                    f"units of {name} or of the accelerometers; correct the map"
                )
                found.append(RecordFault.over(time, f"{name}, ax", "units", words, decisive=True))
    found += [_thinning(time, channels)] if earth and {"altitude", "velocity", "ax"} <= set(channels) else []
    found += [_sound(time, channels)] if earth and {"mach", "velocity"} <= set(channels) else []
    found += [_drag(time, channels, vehicle)] if vehicle and "dynamic_pressure" in channels else []
    found += [_gyration(time, vehicle)] if vehicle else []
    return tuple(fault for fault in found if fault is not None)


def impossible_rates(time: FloatArray, channels: Mapping[str, FloatArray]) -> RecordFault | None:
    """Gyros among the channels that turn faster than any vehicle."""
    most = {name: float(np.nanmax(np.abs(channels[name]), initial=0.0)) for name in GYROS if name in channels}
    fast = [name for name, rate in most.items() if rate > limits.FASTEST_RATE]
    if not fast:
        return None
    names, rate = ", ".join(fast), max(most.values())
    words = (
        f"up to {rate:.3g} rad/s, expected less than {limits.FASTEST_RATE:.0f}: wrong units; correct those of {names} "
        "in the map of the import, or, in a record made otherwise, their attributes `units`"
    )
    return RecordFault.over(time, names, "units", words, decisive=True)


def _gyration(time: FloatArray, vehicle: Vehicle) -> RecordFault | None:
    """An inertia that goes with no mass and diameter, as in another unit: no fault of the record, but of every N m."""
    radius = (vehicle.ixx / vehicle.mass) ** 0.5 / vehicle.reference_length
    words = (
        f"radius of gyration about the spin axis of {radius:.2g} reference lengths, expected {GYRATION[0]:g} to "
        f"{GYRATION[1]:g} diameters: check the units of ixx, mass and reference_length"
    )
    return None if GYRATION[0] < radius < GYRATION[1] else RecordFault.over(time, "vehicle", "units", words)


def _climb(time: FloatArray, channels: Mapping[str, FloatArray]) -> RecordFault | None:
    """Where the altitude changes faster, by most, than the speed allows."""
    length = max(CLIMB_SECONDS, float(time[-1] - time[0]) / CLIMB_INTERVALS)
    worst, fault = 0.0, None
    for start in np.arange(time[0], time[-1] - 0.9 * length, length):
        part = slice(*np.searchsorted(time, (start, start + length)))
        since, height, speed = time[part] - start, channels["altitude"][part], channels["velocity"][part]
        known = np.isfinite(height) & np.isfinite(speed)
        if np.count_nonzero(known) < 5 or np.ptp(since[known]) < 0.5 * length:
            continue
        (rate, _), covariance = np.polyfit(since[known], height[known], 1, cov=True)
        fastest = float(np.max(speed[known]))
        allowed = limits.CLIMB_WITHIN * fastest + limits.CLIMB_WIND + limits.CLIMB_SIGMAS * np.sqrt(covariance[0, 0])
        if abs(rate) - allowed > worst:
            worst = abs(rate) - allowed
            words = (
                f"the altitude {'rises' if rate > 0.0 else 'falls'} by {abs(rate):.0f} m/s where the speed is "
                f"{fastest:.0f} m/s at most: units of altitude or velocity, or a disturbed barometer; correct the map"
            )
            fault = RecordFault.over(time[part], "altitude, velocity", "units", words, decisive=True)
    return fault


def _thinning(time: FloatArray, channels: Mapping[str, FloatArray]) -> RecordFault | None:
    """Where drag changes by another power of the density at the recorded altitudes than a body's does."""
    with np.errstate(divide="ignore", invalid="ignore"):
        drag = np.log(-channels["ax"] / channels["velocity"] ** 2)
        density = np.log(atmosphere(channels["altitude"], "density"))
    known = np.isfinite(drag + density) & (channels["ax"] < -DRAG_LEAST) & (channels["velocity"] > SUPERSONIC)
    if np.count_nonzero(known) < max(limits.MINIMUM_SAMPLES, 0.5 * time.size):
        return None
    line = np.polyfit(density[known], drag[known], 1)
    power, scatter = float(line[0]), float(np.std(drag[known] - np.polyval(line, density[known])))
    change = float(np.ptp(np.percentile(density[known], (5.0, 95.0))))
    small = limits.THINNING_WITHIN[0] < power < limits.THINNING_WITHIN[1] or abs(power - 1.0) * change < THINNING_LEAST
    if small or scatter > THINNING_LEAST:  # drag of a body that tumbles goes with its attitude, not the density alone
        return None
    words = (
        f"drag over speed squared changes by a factor of {np.exp(abs(power) * change):.3g}, where the density at the "
        f"recorded altitudes changes by {np.exp(change):.3g}: units of altitude; correct the map"
    )
    return RecordFault.over(time, "altitude", "units", words, decisive=True)


def _fall(time: FloatArray, forces: FloatArray, altitude: FloatArray) -> RecordFault | None:
    """Where the altitude of a steep climb without thrust bends otherwise than gravity and drag make it."""
    known = np.isfinite(altitude) & np.isfinite(forces[0])
    known &= np.arange(time.size) <= (np.nanargmax(altitude) if np.any(known) else 0)
    if powered_flight(time, forces) is not None or np.count_nonzero(known) < limits.MINIMUM_SAMPLES:
        return None
    at, bend = time[known] - time[known][0], FALL_STEEP * forces[0][known] - GRAVITY
    table = np.stack([np.ones_like(at), at, integral(at, integral(at, bend)), altitude[known]], axis=1)
    made, left = (table[:, 2:] - table[:, :2] @ np.linalg.lstsq(table[:, :2], table[:, 2:])[0]).T
    power = float(made @ made)
    if at[-1] < CLIMB_SECONDS or power < at.size * FALL_LEAST**2 or np.max(bend) > 0.0:
        return None
    factor = float(made @ left) / power
    sigma = float(np.std(left - factor * made)) * power**-0.5
    if abs(factor - np.clip(factor, *limits.GAIN_WITHIN)) < max(limits.CLIMB_SIGMAS * sigma, 1e-9):
        return None
    words = (
        f"the altitude bends by {-np.mean(bend) * factor:.3g} m/s^2 where gravity and drag make "
        f"{-np.mean(bend):.3g} m/s^2: units of altitude or of the accelerometers; correct the map"
    )
    return RecordFault.over(time, "altitude, ax", "units", words, decisive=True)


def gains(time: FloatArray, forces: FloatArray, channels: Mapping[str, FloatArray]) -> dict[str, tuple[float, float]]:
    """Speed (m/s) and height (m) gained in the first thrust, by channel: recorded, and as the forces (3, n) make them.
    As if vertical: a leaning path gains the more speed and the less height. Empty where too little is gained.
    """
    flown = powered_flight(time, forces)
    if flown is None:
        return {}
    _, speed, (ignition, top, _) = flown
    stop = min(top, int(np.argmax(speed > GAIN_FASTEST)) or time.size)
    made = {"velocity": float(speed[stop]), "altitude": float(integral(time, speed)[stop])}
    ends = {name: joined(channels[name])[[ignition, stop]] for name in made if name in channels}
    least = dict(zip(made, GAIN_LEAST, strict=True))
    return {name: (float(np.diff(each)[0]), made[name]) for name, each in ends.items() if made[name] > least[name]}


def _sound(time: FloatArray, channels: Mapping[str, FloatArray]) -> RecordFault | None:
    """Where the speed over the recorded Mach number, most of the time, is no speed of sound."""
    moving = channels["mach"] > SLOWEST_MACH
    speed = float(np.median(channels["velocity"][moving] / channels["mach"][moving])) if np.any(moving) else np.nan
    least, most = limits.SOUND_WITHIN
    if not np.isfinite(speed) or least < speed < most:
        return None
    words = (
        f"speed over Mach number makes a speed of sound of {speed:.4g} m/s, expected {least:g} to {most:g}: units of "
        "velocity, or the Mach number; correct the map"
    )
    return RecordFault.over(time, "velocity, mach", "units", words, decisive=True)


def _drag(time: FloatArray, channels: Mapping[str, FloatArray], vehicle: Vehicle) -> RecordFault | None:
    """Where the drag, most of the time, is none of a body at this dynamic pressure."""
    axial, pressure = channels["ax"], channels["dynamic_pressure"]
    dragged = (axial < -DRAG_LEAST) & (pressure > 0.0)
    if np.count_nonzero(dragged) < 0.5 * np.count_nonzero(np.isfinite(axial)):
        return None
    force, pressure = -axial[dragged] * vehicle.mass, pressure[dragged]
    coefficient, (least, most) = float(np.median(force / (pressure * vehicle.reference_area))), limits.DRAG_WITHIN
    if least < coefficient < most:
        return None
    usual = [words for words, size in MISREAD_PRESSURES.items() if DRAG_USUAL[0] < coefficient / size < DRAG_USUAL[1]]
    likely = f" (it is usual if the pressure is {' or '.join(usual)})" if usual else ""
    words = (
        f"drag of {np.median(force):.3g} N at a dynamic pressure of {np.median(pressure):.3g} Pa makes an axial "
        f"coefficient of {coefficient:.3g}, expected {least:g} to {most:g}{likely}: units of dynamic pressure, "
        "density, altitude, velocity or ax, mass or reference area; correct the map"
    )
    return RecordFault.over(time, "ax, dynamic_pressure", "units", words, decisive=True)


def mounting_fault(time: FloatArray, tilt: Tilt | None, tolerance: float = 0.0) -> tuple[RecordFault, ...]:
    """A fault where the nose lies off x beyond its error and the 1-sigma `tolerance` of the mounting, rad."""
    if tilt is None:
        return ()
    if tilt.angle < max(limits.MOUNTING_TILT, limits.MOUNTING_SIGMAS * float(np.hypot(tilt.sigma, tolerance))):
        return ()
    words = (
        f"{tilt.by} lie {np.degrees(tilt.angle):.1f} deg off x, known to {np.degrees(tilt.sigma):.1f} deg: the unit is "
        "turned in the vehicle, or accelerometer_position wrong; put rotation: auto into the map of the whole log"
    )
    return (RecordFault.over(time, "p, q, r, ax, ay, az", "mounting", words, decisive=True),)


def gyro_fault(time: FloatArray, rates: FloatArray, forces: FloatArray) -> tuple[RecordFault, ...]:
    """A fault where the forces (3, n) follow from the rates (3, n) in other units, of all or one, turned or reversed;
    where one surely does of those that are of all gyros, with what is of one and as likely.
    """
    degree, of_all = float(np.pi / 180.0), ", ".join(GYROS)
    units: dict[str, float | FloatArray] = {"": 1.0}
    for names in (of_all, *GYROS):
        for read, size in (("deg/s", degree), ("rad/s, read as deg/s", 1.0 / degree)):
            units[f"{names} were in {read}"] = np.where([name in names for name in GYROS], size, 1.0)
    found = relative_axes(time, rates, forces, units)
    same_units = [each for each in found if not each[1] or each[1].startswith(of_all)]

    def mistake(mounting: Mounting) -> str:
        return " and ".join(filter(None, (as_turned(GYROS, mounting[2]), mounting[1])))

    if not any(is_sure(some) and mistake(some[0]) for some in (found, same_units)):
        return ()
    likely = [each for each in found if each is found[0] or found[0][0] > limits.GYROS_SURE * each[0]]
    mistakes = list(map(mistake, likely))
    share = found[0][0] / max(found[len(likely)][0], 1e-300)
    words = (
        f"the forces across the axis follow from the rates as if {', or '.join(mistakes)}, leaving {share:.2f} of what "
        "the next best leaves: correct units, axes and signs of the gyros in the map"
    )
    channels = max((each.partition(" were")[0] for each in mistakes), key=len)
    return (RecordFault.over(time, channels, "units" if found[0][1] else "axes", words, decisive=True),)
