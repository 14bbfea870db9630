"""Physics that no record breaks, whatever the vehicle: `contradictions` names what breaks it, with both numbers.

climb        |dh/dt| <= speed: no vehicle climbs or falls faster than it flies
fall         of a coast of unknown speed, gravity and drag bend the altitude, of whatever start
gain         thrust less gravity, integrated once and twice, makes the speed and the height that are gained
thinning     drag over speed squared goes with altitude as the Earth's density does
drag         -ax m / (q_inf S) is the axial coefficient of a body
mounting     thrust, drag and spin lie along x, and forces follow from rates (brv_hypo/flight/mounting.py)
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from brv_hypo import thresholds as limits
from brv_hypo.arrays import FloatArray
from brv_hypo.flight.clock import joined
from brv_hypo.flight.derived import atmosphere
from brv_hypo.flight.mounting import GRAVITY, Tilt, integral, powered_flight, relative_axes
from brv_hypo.flight.record import ACCELEROMETERS, GYROS, RecordFault, Vehicle

CLIMB_INTERVALS, CLIMB_SECONDS = 40, 1.0  # of a record at most, and s at least, over which a climb is averaged
GAIN_FASTEST = 250.0  # m/s, up to which a barometer is trusted: below the transonic
GAIN_LEAST = (20.0, 30.0)  # m/s and m, of speed and height gained, from which they are compared
THINNING_LEAST = 0.3  # logarithm of the change of drag that density does not explain, from which it is no axial trend
FALL_STEEP = 0.95  # mean cosine of the lean of a climb
FALL_LEAST = 10.0  # m by which gravity and drag bend the altitude, from which that is compared
DRAG_LEAST = 1.0  # m/s^2 along the axis, beyond any bias
SUPERSONIC = 500.0  # m/s: above, no axial coefficient changes as at Mach 1 (Hoerner, Fluid-Dynamic Drag, 1965, 16)


def contradictions(
    time: FloatArray, channels: Mapping[str, FloatArray], vehicle: Vehicle | None = None, earth: bool = False
) -> tuple[RecordFault, ...]:
    """Decisive faults of `channels` (n,), SI, NaN where missing, at `time` (n,) s: climb, gain and drag."""
    found = [_climb(time, channels)] if {"altitude", "velocity"} <= set(channels) else []
    if set(ACCELEROMETERS) <= set(channels):
        forces = np.stack([channels[name] for name in ACCELEROMETERS])
        found += (
            [_fall(time, forces, channels["altitude"])]
            if {"altitude", "velocity"} & {*channels} == {"altitude"}
            else []
        )
        for name, (recorded, made) in gains(time, forces, channels).items():
            if not limits.GAIN_WITHIN[0] < recorded / made < limits.GAIN_WITHIN[1]:
                unit = "m/s" if name == "velocity" else "m"
                words = (
                    f"{name} gains {recorded:.4g} {unit} in the burn, where the accelerometers make {made:.4g} {unit}: "
                    f"units of {name} or of the accelerometers; correct the map"
                )
                found.append(_fault(f"{name}, ax", "units", time, words))
    found += [_thinning(time, channels)] if earth and {"altitude", "velocity", "ax"} <= set(channels) else []
    drag = _axial_coefficient(channels, vehicle) if vehicle and "dynamic_pressure" in channels else None
    if drag is not None and not limits.DRAG_WITHIN[0] < drag[2] < limits.DRAG_WITHIN[1]:
        words = (
            f"drag of {drag[0]:.3g} N at a dynamic pressure of {drag[1]:.3g} Pa makes an axial coefficient of "
            f"{drag[2]:.3g}, expected {limits.DRAG_WITHIN[0]:g} to {limits.DRAG_WITHIN[1]:g}: units of altitude, "
            "density, velocity or ax, mass or reference area; correct the map"
        )
        found.append(_fault("ax, dynamic_pressure", "units", time, words))
    return tuple(fault for fault in found if fault is not None)


def _fault(channel: str, kind: str, time: FloatArray, words: str) -> RecordFault:
    return RecordFault(channel, kind, float(time[0]), float(time[-1]), words, decisive=True)


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
            fault = _fault("altitude, velocity", "units", time[part], words)
    return fault


def _thinning(time: FloatArray, channels: Mapping[str, FloatArray]) -> RecordFault | None:
    """Where drag changes by another power of the density at the recorded altitudes than a body's does."""
    with np.errstate(divide="ignore", invalid="ignore"):
        drag = np.log(-channels["ax"] / channels["velocity"] ** 2)
        density = np.log(atmosphere(channels["altitude"], "density"))
    known = np.isfinite(drag + density) & (channels["ax"] < -DRAG_LEAST) & (channels["velocity"] > SUPERSONIC)
    if np.count_nonzero(known) < max(limits.MINIMUM_SAMPLES, 0.5 * time.size):
        return None
    power, _ = np.polyfit(density[known], drag[known], 1)
    change = float(np.ptp(np.percentile(density[known], (5.0, 95.0))))
    if limits.THINNING_WITHIN[0] < power < limits.THINNING_WITHIN[1] or abs(power - 1.0) * change < THINNING_LEAST:
        return None
    words = (
        f"drag over speed squared changes by a factor of {np.exp(abs(power) * change):.3g}, where the density at the "
        f"recorded altitudes changes by {np.exp(change):.3g}: units of altitude; correct the map"
    )
    return _fault("altitude", "units", time, words)


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
    return _fault("altitude, ax", "units", time, words)


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


def _axial_coefficient(channels: Mapping[str, FloatArray], vehicle: Vehicle) -> tuple[float, float, float] | None:
    """Median drag (N), dynamic pressure (Pa) and axial coefficient where drag acts; None where it seldom does."""
    axial, pressure = channels["ax"], channels["dynamic_pressure"]
    dragged = (axial < -DRAG_LEAST) & (pressure > 0.0)
    if np.count_nonzero(dragged) < 0.5 * np.count_nonzero(np.isfinite(axial)):
        return None
    force, pressure = -axial[dragged] * vehicle.mass, pressure[dragged]
    coefficient = float(np.median(force / (pressure * vehicle.reference_area)))
    return float(np.median(force)), float(np.median(pressure)), coefficient


def mounting_fault(time: FloatArray, tilt: Tilt | None, tolerance: float = 0.0) -> tuple[RecordFault, ...]:
    """A fault where the nose lies off x beyond its error and the 1-sigma `tolerance` of the mounting, rad."""
    if tilt is None:
        return ()
    if tilt.angle < max(limits.MOUNTING_TILT, limits.MOUNTING_SIGMAS * float(np.hypot(tilt.sigma, tolerance))):
        return ()
    words = (
        f"{tilt.by} lie {np.degrees(tilt.angle):.1f} deg off x, known to {np.degrees(tilt.sigma):.1f} deg: the unit is "
        "turned in the vehicle; put rotation: auto into the map of the whole log"
    )
    return (_fault("p, q, r, ax, ay, az", "mounting", time, words),)


def gyro_fault(time: FloatArray, rates: FloatArray, forces: FloatArray) -> tuple[RecordFault, ...]:
    """A fault where the forces (3, n) follow from the rates (3, n) in other units, turned or reversed."""
    degree = float(np.pi / 180.0)
    found = relative_axes(time, rates, forces, {"": 1.0, " in deg/s": degree, " in rad/s, read as deg/s": 1.0 / degree})
    if found is None or found[2] > limits.GYROS_SURE or (found[0] == "" and np.array_equal(found[1], np.eye(3))):
        return ()
    axes = [int(np.argmax(np.abs(row))) for row in found[1]]
    names = [("-" if row[axis] < 0.0 else "") + GYROS[axis] for axis, row in zip(axes, found[1], strict=True)]
    words = (
        f"the forces across the axis follow from the rates as if p, q, r were {', '.join(names)}{found[0]}, leaving "
        f"{found[2]:.2f} of what the next best leaves: correct units, axes and signs of the gyros in the map"
    )
    return (_fault("p, q, r", "axes" if found[0] == "" else "units", time, words),)
