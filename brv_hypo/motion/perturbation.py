"""What an error of the record, of whatever origin, does to what is integrated from it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from brv_hypo.arrays import ComplexArray, FloatArray
from brv_hypo.flight.record import Flight
from brv_hypo.motion.attitude import body_attitude
from brv_hypo.motion.inertial import InertialRecord, arm_acceleration

_TURNING = ("p", "q", "r")
_SENSED = ("ax", "ay", "az")


@dataclass(frozen=True)
class Perturbation:
    """One component of an error that a record may have, as likely as N(0, size^2) in SI `units`.

    `apply(flight, value)` is the record as it would read had the error the value more.
    """

    effect: str
    component: str
    units: str
    size: float
    apply: Callable[[Flight, float], Flight]


def perturbed(record: InertialRecord, flight: Flight) -> InertialRecord:
    """The inertial record of a flight that differs little from the one of `record`.

    The filter that smooths the rates is not chosen anew: a derivative must not see that choice.
    """
    before = record.flight
    turned = any(getattr(flight, name) is not getattr(before, name) for name in _TURNING)
    roll, attitude, rate, change = record.roll, record.attitude, record.transverse_rate, record.rate_change
    if turned:
        measured = flight.q + 1j * flight.r
        roll, attitude = body_attitude(record.time, flight.p, measured)
        more = measured - (before.q + 1j * before.r)
        rate, change = rate + more, change + np.gradient(more, record.time)
    force = record.force
    if any(getattr(flight, name) is not getattr(before, name) for name in _SENSED):
        force = force + np.stack([getattr(flight, name) - getattr(before, name) for name in _SENSED], axis=1)
    if turned or flight.vehicle.accelerometer_position != before.vehicle.accelerometer_position:
        force = force + _swing(before, record.transverse_rate, record.rate_change)
        force -= _swing(flight, rate, change)
    return replace(
        record,
        flight=flight,
        roll=roll,
        attitude=attitude,
        transverse_rate=rate,
        rate_change=change,
        spin_angle=(1.0 - flight.vehicle.inertia_ratio) * roll,
        force=force,
    )


def _swing(flight: Flight, rate: ComplexArray, change: ComplexArray) -> FloatArray:
    """Acceleration (n, 3) m/s^2 that the declared arm makes of these rates."""
    arm = np.asarray(flight.vehicle.accelerometer_position, dtype=float)
    return arm_acceleration(flight.p, np.gradient(flight.p, flight.time), rate, change, arm)
