"""What an error of the record, of whatever origin, does to what is integrated from it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import astuple, dataclass, replace
from typing import NamedTuple

import numpy as np

from brv_hypo.arrays import ComplexArray, FloatArray
from brv_hypo.flight.record import CHANNELS, OPTIONAL_CHANNELS, Flight, Vehicle
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


def superposed(flight: Flight, variants: Iterable[Flight]) -> Flight:
    """The flight with what each of some variants of it has otherwise: changes of channels, wind and vehicle are added.

    One after the other they would act on each other too: by which axis comes first, and so by how the axes are rolled.
    """
    out = flight
    for variant in variants:
        changed = {}
        for name in (*CHANNELS, *OPTIONAL_CHANNELS, "wind"):
            before, other = getattr(flight, name), getattr(variant, name)
            if other is not before:
                known = getattr(out, name)
                changed[name] = other if known is before else known + _change(before, other)
        out = replace(out, vehicle=_with_change(out.vehicle, flight.vehicle, variant.vehicle), **changed)
    return out


def _change(before: FloatArray | None, other: FloatArray) -> FloatArray:
    """What a channel has otherwise than before; a wind that was not known was none."""
    return other if before is None else other - before


def _with_change(vehicle: Vehicle, before: Vehicle, other: Vehicle) -> Vehicle:
    """The vehicle with what one vehicle has otherwise than the other."""
    if other is before:
        return vehicle
    each = zip(astuple(vehicle), astuple(before), astuple(other), strict=True)
    mass, ixx, iyy, length, area, place = (
        (np.asarray(known) + np.subtract(new, old)).tolist() for known, old, new in each
    )
    return Vehicle(mass, ixx, iyy, length, area, tuple(place))


def perturbed(record: InertialRecord, flights: Sequence[Flight]) -> list[InertialRecord]:
    """The inertial records of flights that differ little from the one of `record`.

    The filter that smooths the rates is not chosen anew: a derivative must not see that choice.
    """
    before = record.flight
    turned = [
        k
        for k, flight in enumerate(flights)
        if any(getattr(flight, name) is not getattr(before, name) for name in _TURNING)
    ]
    turns: dict[int, _Turned] = {}
    if turned:
        measured = np.stack([flights[k].q + 1j * flights[k].r for k in turned], axis=1)
        rolls, attitudes = body_attitude(record.time, np.stack([flights[k].p for k in turned], axis=1), measured)
        more = measured - (before.q + 1j * before.r)[:, np.newaxis]
        rates = record.transverse_rate[:, np.newaxis] + more
        changes = record.rate_change[:, np.newaxis] + np.gradient(more, record.time, axis=0)
        turns = {
            k: _Turned(*(np.ascontiguousarray(each[:, j]) for each in (rolls, attitudes, rates, changes)))
            for j, k in enumerate(turned)
        }
    swing = _swing(before, record.transverse_rate, record.rate_change)
    return [_moved(record, flight, turns.get(k), swing) for k, flight in enumerate(flights)]


class _Turned(NamedTuple):
    """Roll (n,), attitude (n, 3, 3), transverse rate (n,) and its derivative of a record of other rates."""

    roll: FloatArray
    attitude: FloatArray
    rate: ComplexArray
    change: ComplexArray


def _moved(record: InertialRecord, flight: Flight, turned: _Turned | None, swing: FloatArray) -> InertialRecord:
    """The inertial record of one flight; `turned` where its rates differ. `swing` (n, 3) is what the record's was."""
    before = record.flight
    roll, attitude, rate, change = turned or (
        record.roll,
        record.attitude,
        record.transverse_rate,
        record.rate_change,
    )
    force = record.force
    if any(getattr(flight, name) is not getattr(before, name) for name in _SENSED):
        force = force + np.stack([getattr(flight, name) - getattr(before, name) for name in _SENSED], axis=1)
    if turned or flight.vehicle.accelerometer_position != before.vehicle.accelerometer_position:
        force = force + swing
        force -= _swing(flight, rate, change)
    spin_angle = record.spin_angle
    if turned or flight.vehicle.inertia_ratio != before.vehicle.inertia_ratio:
        spin_angle = (1.0 - flight.vehicle.inertia_ratio) * roll
    return replace(
        record,
        flight=flight,
        roll=roll,
        attitude=attitude,
        transverse_rate=rate,
        rate_change=change,
        spin_angle=spin_angle,
        force=force,
    )


def _swing(flight: Flight, rate: ComplexArray, change: ComplexArray) -> FloatArray:
    """Acceleration (n, 3) m/s^2 that the declared arm makes of these rates."""
    arm = np.asarray(flight.vehicle.accelerometer_position, dtype=float)
    return arm_acceleration(flight.p, np.gradient(flight.p, flight.time), rate, change, arm)
