"""Direction of the velocity in the axes of the first sample, and what it depends on (Eq. 3.1, with gravity).

In axes that do not turn, Eq. 3.1 is a quadrature: V(t) = V_0 + integral of specific force + g t. It is linear
in the velocity at the start and in gravity. Its size is the speed through still air; what turns the air's flow is
divided by the speed relative to the air, the record's `velocity` channel, which a wind along the track changes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from brv_hypo.arrays import ComplexArray, FloatArray
from brv_hypo.constants import FREE_GRAVITY, LEAST_CYCLES
from brv_hypo.flight.record import Flight
from brv_hypo.motion.inertial import InertialRecord
from brv_hypo.motion.splines import running_integral

# Surface gravity m/s^2 and mean radius m.
_PLANETS = {
    "earth": (9.80665, 6.371e6),
    "mars": (3.721, 3.3895e6),
    "venus": (8.87, 6.0518e6),
    "titan": (1.352, 2.5747e6),
}


@dataclass(frozen=True)
class WindStart:
    """Unit velocity (3,) at the first sample and gravity (3,) m/s^2, both in the body axes of that sample."""

    direction: FloatArray
    gravity: FloatArray


def gravity_magnitude(flight: Flight) -> float | None:
    """Gravity in m/s^2 at the record's mean altitude; None for a planet that is not known."""
    if flight.planet not in _PLANETS:
        return None
    surface, radius = _PLANETS[flight.planet]
    height = 0.0 if flight.altitude is None else float(np.nanmean(flight.altitude))
    return surface * (radius / (radius + height)) ** 2


def wind_direction(record: InertialRecord, start: WindStart, *, forces: bool = True) -> FloatArray:
    """Unit velocity (n, 3) in the axes of the first sample; `forces` False: turned by gravity alone."""
    if forces:
        return direction_by_impulse(record, start, force_impulse(record))
    turned = running_integral(record.time, start.gravity / record.flight.velocity[:, None])
    velocity = start.direction + turned - np.outer(turned @ start.direction, start.direction)
    return np.asarray(velocity / np.linalg.norm(velocity, axis=1, keepdims=True))


def direction_by_impulse(record: InertialRecord, start: WindStart, impulse: FloatArray) -> FloatArray:
    """The same turned by forces, whose impulse (n, 3) m/s is known."""
    velocity = _velocity(record, start, impulse)
    return np.asarray(velocity / np.linalg.norm(velocity, axis=1, keepdims=True))


def propagated_crossflows(moved: Sequence[tuple[InertialRecord, WindStart]]) -> list[ComplexArray]:
    """Open-loop crossflow (n,) of records of the same times, each from its start; forces are integrated at once."""
    distinct = {(id(record.force), id(record.attitude)): record for record, _ in moved}
    forces = np.stack([record.force_inertial for record in distinct.values()], axis=2)
    impulses = np.moveaxis(running_integral(moved[0][0].time, forces), 2, 0)
    found = dict(zip(distinct, impulses, strict=True))
    crossflows = []
    for record, start in moved:
        impulse = _with_wind(record, found[id(record.force), id(record.attitude)])
        velocity = _velocity(record, start, impulse)
        crossflows.append(body_crossflow(record, velocity) / np.sqrt(np.einsum("ni,ni->n", velocity, velocity)))
    return crossflows


def _velocity(record: InertialRecord, start: WindStart, impulse: FloatArray) -> FloatArray:
    """Velocity (n, 3) m/s relative to the air in the axes of the first sample."""
    first = record.flight.velocity[0] * start.direction
    return _at_airspeed(first + impulse + record.time[:, None] * start.gravity, record.flight.velocity)


def _at_airspeed(velocity: FloatArray, airspeed: FloatArray) -> FloatArray:
    """A velocity (n, 3) that forces and gravity have turned, had it turned at this speed (n,).

    What changes the speed acts along the velocity: v' = |v| u' + |v|' u has V' in place of |v|', and the integral of
    V' u + |v| u' is V u less that of (V - |v|) u'.
    """
    size = np.linalg.norm(velocity, axis=1)
    direction, more = velocity / size[:, None], airspeed - size
    steps = 0.5 * (more[1:] + more[:-1])[:, None] * np.diff(direction, axis=0)
    out = np.asarray(airspeed[:, None] * direction, dtype=float)
    out[1:] -= np.cumsum(steps, axis=0)
    return out


def across_impulse(direction: FloatArray, impulse: FloatArray) -> FloatArray:
    """The part of impulses (n, 3, k) m/s that acted across the velocity, of direction (n, 3), and has turned it."""
    steps, along = np.diff(impulse, axis=0), 0.5 * (direction[1:] + direction[:-1])
    steps -= along[:, :, np.newaxis] * np.einsum("ni,nik->nk", along, steps)[:, np.newaxis]
    out = np.zeros_like(impulse)
    np.cumsum(steps, axis=0, out=out[1:])
    return out


def force_impulse(record: InertialRecord) -> FloatArray:
    """Velocity (n, 3) m/s gained by forces and by changes of wind, in the axes of the first sample."""
    return _with_wind(record, running_integral(record.time, record.force_inertial))


def _with_wind(record: InertialRecord, impulse: FloatArray) -> FloatArray:
    wind = record.flight.wind
    return impulse if wind is None else impulse - (wind - wind[0])


def body_crossflow(record: InertialRecord, direction: FloatArray) -> ComplexArray:
    """Crossflow (v + i w) / V (n,) of a velocity direction (n, 3)."""
    body = record.to_body(direction)
    return np.asarray(body[:, 1] + 1j * body[:, 2])


def transverse_axes(direction: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Two axes (n, 3) across the velocity, carried along with it by the smallest turn."""
    first = direction[0]
    helper = np.eye(3)[int(np.argmin(np.abs(first)))]
    third = np.cross(first, helper)
    third /= np.linalg.norm(third)
    second = np.cross(third, first)
    both = first + direction
    size = 1.0 + direction @ first
    return (
        second - ((direction @ second) / size)[:, None] * both,
        third - ((direction @ third) / size)[:, None] * both,
    )


def cycles(record: InertialRecord) -> float:
    """How often the nose goes round or to and fro in the record, by the length of its path; at least 0.5."""
    nose = record.attitude[:, 1:, 0] - record.attitude[:, 1:, 0].mean(axis=0)
    path = float(np.sum(np.linalg.norm(np.diff(nose, axis=0), axis=1)))
    size = float(np.sqrt(np.mean(np.sum(nose**2, axis=1))))
    return max(path / (2.0 * np.pi * max(size, 1e-12)), LEAST_CYCLES)


def start_from_nose(record: InertialRecord, gravity_size: float | None, *, forces: bool = True) -> WindStart:
    """Start by the angular rate method, Section 3.2.1: the nose circles about the velocity.

    The report takes the mean Euler angles over a cycle; here the mean offset of the nose from a velocity
    that gravity and forces turn is made least. `gravity_size` m/s^2 is how large gravity may be; 0 leaves
    it out.
    """
    speed = record.flight.velocity
    nose = record.attitude[:, :, 0]
    if forces:
        target, course = nose * speed[:, None] - force_impulse(record), record.time
    else:
        target, course = nose, running_integral(record.time, 1.0 / speed)
    if gravity_size == 0.0:
        direction = target.sum(axis=0)
        return WindStart(direction / np.linalg.norm(direction), np.zeros(3))
    spread = float(np.mean(np.abs(target - target.mean(axis=0)) ** 2))
    per_sample = record.time.size / (2.0 * cycles(record))
    columns = np.column_stack([np.ones(record.time.size), course])
    normal = columns.T @ columns + np.diag([0.0, per_sample * spread / (gravity_size or FREE_GRAVITY) ** 2])
    velocity, gravity = np.linalg.solve(normal, columns.T @ target)
    return WindStart(velocity / np.linalg.norm(velocity), gravity)
