"""Physics that no record breaks, whatever the vehicle: climb, speed, thrust and drag against one another.

    climb        |dh/dt| <= speed                  no vehicle climbs or falls faster than it flies
    gain         what thrust less gravity makes, integrated once and twice, is speed and height gained
    drag         -ax m / (q_inf S) is the axial coefficient of a body
    mounting     thrust, drag and spin lie along x (brv_hypo/flight/mounting.py)

`contradictions` names what breaks one, with both numbers. Units of altitude, speed and force, and axes, show there.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from brv_hypo import thresholds as limits
from brv_hypo.arrays import FloatArray
from brv_hypo.flight.clock import joined
from brv_hypo.flight.mounting import GRAVITY, Tilt, integral, relative_axes, thrust_span
from brv_hypo.flight.record import ACCELEROMETERS, GYROS, RecordFault, Vehicle

CLIMB_SECONDS = 1.0  # over which a climb is averaged, at least
CLIMB_INTERVALS = 40  # of a record, at most
GAIN_FASTEST = 250.0  # m/s, up to which a barometer is trusted: below the transonic
GAIN_LEAST = (20.0, 30.0)  # m/s and m, of speed and height gained, from which they are compared
DRAG_LEAST = 1.0  # m/s^2 along the axis, beyond any bias


def contradictions(
    time: FloatArray, channels: Mapping[str, FloatArray], vehicle: Vehicle | None = None
) -> tuple[RecordFault, ...]:
    """What in `channels` (n,), SI, NaN where missing, at `time` (n,) s, contradicts itself: decisive faults."""
    drag = [] if vehicle is None else _drag(time, channels, vehicle)
    return (*_climbs(time, channels), *_gains(time, channels), *drag)


def _fault(channel: str, kind: str, time: FloatArray, words: str) -> RecordFault:
    return RecordFault(channel, kind, float(time[0]), float(time[-1]), words, decisive=True)


def _climbs(time: FloatArray, channels: Mapping[str, FloatArray]) -> list[RecordFault]:
    """Where the altitude changes faster than the speed allows."""
    if not {"altitude", "velocity"} <= set(channels):
        return []
    height, speed = channels["altitude"], channels["velocity"]
    length = max(CLIMB_SECONDS, float(time[-1] - time[0]) / CLIMB_INTERVALS)
    worst: tuple[float, slice, float, float] | None = None
    for start in np.arange(time[0], time[-1] - 0.9 * length, length):
        part = slice(*np.searchsorted(time, (start, start + length)))
        known = np.isfinite(height[part]) & np.isfinite(speed[part])
        if np.count_nonzero(known) < 5 or np.ptp(time[part][known]) < 0.5 * length:
            continue
        since = time[part][known] - start
        (rate, _), covariance = np.polyfit(since, height[part][known], 1, cov="unscaled")
        residual = height[part][known] - np.polyval(np.polyfit(since, height[part][known], 2), since)
        sigma = float(np.std(residual) * np.sqrt(covariance[0, 0]))
        fastest = float(np.max(speed[part][known]))
        excess = abs(rate) - limits.CLIMB_WITHIN * fastest - limits.CLIMB_WIND - limits.CLIMB_SIGMAS * sigma
        if excess > 0.0 and (worst is None or excess > worst[0]):
            worst = (excess, part, float(rate), fastest)
    if worst is None:
        return []
    _, part, rate, fastest = worst
    words = (
        f"the altitude {'rises' if rate > 0.0 else 'falls'} by {abs(rate):.0f} m/s where the speed is {fastest:.0f} "
        "m/s at most: units of altitude or velocity (feet for metres?), or a disturbed barometer; correct the map"
    )
    return [_fault("altitude, velocity", "units", time[part], words)]


def gains(time: FloatArray, forces: FloatArray, channels: Mapping[str, FloatArray]) -> dict[str, tuple[float, float]]:
    """Speed (m/s) and height (m) gained in the first thrust, by channel: recorded, and as the forces (3, n) make them.

    Vertical and along the sum of forces: a leaning path gains the more speed and the less height. Empty without
    thrust, or where too little is gained.
    """
    thrust = thrust_span(time, forces)
    if thrust is None:
        return {}
    size = np.linalg.norm([joined(each) for each in forces], axis=0)
    moving = (np.arange(time.size) >= thrust[0]) & (np.arange(time.size) < thrust[1])
    speed = integral(time, np.where(moving, size - GRAVITY, 0.0))
    stop = min(thrust[1], int(np.argmax(speed > GAIN_FASTEST)) or time.size) - 1
    made = {"velocity": float(speed[stop]), "altitude": float(integral(time, speed)[stop])}
    found = {}
    for (name, expected), least in zip(made.items(), GAIN_LEAST, strict=True):
        values = channels.get(name)
        if values is not None and expected > least and np.isfinite(ends := values[[thrust[0], stop]]).all():
            found[name] = (float(ends[1] - ends[0]), expected)
    return found


def _gains(time: FloatArray, channels: Mapping[str, FloatArray]) -> list[RecordFault]:
    if not set(ACCELEROMETERS) <= set(channels):
        return []
    forces = np.stack([channels[name] for name in ACCELEROMETERS])
    found = []
    for name, (recorded, made) in gains(time, forces, channels).items():
        low, high = limits.GAIN_WITHIN
        if not low < recorded / made < high:
            units = "m/s" if name == "velocity" else "m"
            words = (
                f"{name} gains {recorded:.4g} {units} in the burn, where the accelerometers make {made:.4g} {units}: "
                f"units of {name} or of the accelerometers; correct the map"
            )
            found.append(_fault(f"{name}, ax", "units", time, words))
    return found


def axial_coefficient(channels: Mapping[str, FloatArray], vehicle: Vehicle) -> tuple[float, float, float] | None:
    """Median drag (N), dynamic pressure (Pa) and axial coefficient where drag acts; None where it seldom does."""
    axial, pressure = channels["ax"], channels["dynamic_pressure"]
    dragged = (axial < -DRAG_LEAST) & (pressure > 0.0)
    if np.count_nonzero(dragged) < 0.5 * np.count_nonzero(np.isfinite(axial)):
        return None
    force, pressure = -axial[dragged] * vehicle.mass, pressure[dragged]
    coefficient = float(np.median(force / (pressure * vehicle.reference_area)))
    return float(np.median(force)), float(np.median(pressure)), coefficient


def _drag(time: FloatArray, channels: Mapping[str, FloatArray], vehicle: Vehicle) -> list[RecordFault]:
    known = axial_coefficient(channels, vehicle) if {"ax", "dynamic_pressure"} <= set(channels) else None
    if known is None or limits.DRAG_WITHIN[0] < known[2] < limits.DRAG_WITHIN[1]:
        return []
    words = (
        f"drag of {known[0]:.3g} N at a dynamic pressure of {known[1]:.3g} Pa makes an axial coefficient of "
        f"{known[2]:.3g}, expected {limits.DRAG_WITHIN[0]:g} to {limits.DRAG_WITHIN[1]:g}: units of altitude, density, "
        "velocity or ax, mass or reference area; correct the map"
    )
    return [_fault("ax, dynamic_pressure", "units", time, words)]


def mounting_fault(time: FloatArray, tilt: Tilt | None, tolerance: float = 0.0) -> list[RecordFault]:
    """A fault where the nose lies off x beyond its error and the 1-sigma `tolerance` of the mounting, rad."""
    if tilt is None:
        return []
    sigma = float(np.hypot(tilt.sigma, tolerance))
    if tilt.angle < max(limits.MOUNTING_TILT, limits.MOUNTING_SIGMAS * sigma):
        return []
    words = (
        f"{tilt.by} lie {np.degrees(tilt.angle):.1f} deg off x, known to {np.degrees(tilt.sigma):.1f} deg: the unit is "
        "turned in the vehicle; put rotation: auto into the map of the whole log"
    )
    return [_fault("p, q, r, ax, ay, az", "mounting", time, words)]


def gyro_fault(time: FloatArray, rates: FloatArray, forces: FloatArray) -> list[RecordFault]:
    """A fault where the forces (3, n) follow from the rates (3, n) in other units, turned or reversed."""
    degree = float(np.pi / 180.0)
    found = relative_axes(time, rates, forces, {"": 1.0, " in deg/s": degree, " in rad/s, read as deg/s": 1.0 / degree})
    if found is None or found[2] > limits.GYROS_SURE or (found[0] == "" and np.array_equal(found[1], np.eye(3))):
        return []
    axes = [int(np.argmax(np.abs(row))) for row in found[1]]
    names = [("-" if row[axis] < 0.0 else "") + GYROS[axis] for axis, row in zip(axes, found[1], strict=True)]
    words = (
        f"the forces across the axis follow from the rates as if p, q, r were {', '.join(names)}{found[0]} (what "
        f"they leave unexplained is {found[2]:.2f} of the next best): correct units, axes and signs of the gyros in the map"
    )
    return [_fault("p, q, r", "axes" if found[0] == "" else "units", time, words)]
