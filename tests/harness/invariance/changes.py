"""The same flight expressed otherwise: in other units, other axes, from another origin of time, in a mirror."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import fields, replace
from pathlib import Path

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.flight import load_flight
from brv_hypo.flight.record import CHANNELS, Flight, Vehicle
from tests.flight.records import ACCEPTED, UNITS, write_raw

EXACTLY = (1e-9, 1e-9, 1e-9)  # a tolerance that is none
NAMES = ("time", *CHANNELS, *(field.name for field in fields(Vehicle)))
SI_UNITS = {name: UNITS[name] for name in NAMES}


def written(flight: Flight, units: Mapping[str, str], path: Path) -> Flight:
    """The flight as it comes back from a record in these units, by name."""

    def in_units(holder: object, name: str) -> FloatArray:
        size = ACCEPTED[UNITS[name]][units[name]]
        return np.asarray(getattr(holder, name), dtype=float) / size

    channels = {name: in_units(flight, name) for name in ("time", *CHANNELS)}
    vehicle = {field.name: in_units(flight.vehicle, field.name) for field in fields(Vehicle)}
    return load_flight(write_raw(path, channels, units=units, vehicle=vehicle))


def shifted(flight: Flight, seconds: float) -> Flight:
    """The flight with its clock set forward."""
    return replace(flight, time=flight.time + seconds)


def rolled(flight: Flight, angle: float) -> Flight:
    """The flight in body axes rolled back by `angle` rad about x: phi_w and phi_b grow by it."""
    cosine, sine = np.cos(angle), np.sin(angle)

    def turned(x: FloatArray, y: FloatArray, z: FloatArray) -> tuple[FloatArray, ...]:
        return x, cosine * y + sine * z, cosine * z - sine * y

    return _with_vectors(flight, turned, turned)


def mirrored(flight: Flight) -> Flight:
    """The flight in a mirror across the plane of x and z."""
    return _with_vectors(flight, lambda x, y, z: (x, -y, z), lambda x, y, z: (-x, y, -z))


def with_isotropic_errors(flight: Flight) -> Flight:
    """The flight with tolerances that rolled axes have too.

    Scales of gyros are as likely as their shears, into which rolled axes turn them; those of accelerometers, whose
    block has no shears, are known exactly.
    """
    tolerances = flight.instruments
    known = replace(tolerances, gyro_scale=tolerances.gyro_misalignment, accel_scale=EXACTLY)
    return replace(flight, instruments=known)


Turn = Callable[[FloatArray, FloatArray, FloatArray], tuple[FloatArray, ...]]


def _with_vectors(flight: Flight, polar: Turn, axial: Turn) -> Flight:
    """`polar` is done to forces, places and the wind, `axial` to rates of turn."""
    place = polar(*(np.array(value) for value in flight.vehicle.accelerometer_position))
    return replace(
        flight,
        **dict(zip(("p", "q", "r"), axial(flight.p, flight.q, flight.r), strict=True)),  # type: ignore[arg-type]
        **dict(zip(("ax", "ay", "az"), polar(flight.ax, flight.ay, flight.az), strict=True)),
        wind=None if flight.wind is None else np.column_stack(polar(*flight.wind.T)),
        vehicle=replace(flight.vehicle, accelerometer_position=tuple(map(float, place))),
    )
