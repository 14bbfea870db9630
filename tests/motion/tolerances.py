"""Flights whose instruments, air data and vehicle err as FLIGHT_FORMAT's tolerances allow, by formulas of their own."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicSpline

from brv_hypo.flight.record import Flight
from brv_hypo.flight.tolerances import of_grade
from tests.motion.truth import Scenario, Truth, fly

_CLOCK_MARGIN = 4  # samples at each end that late clocks may need


@dataclass(frozen=True)
class Errors:
    """What a flight's record errs by: triads (3,), clocks s late, relative errors of pressure and inertias."""

    gyro_bias: np.ndarray
    gyro_scale: np.ndarray
    gyro_turn: np.ndarray
    accel_bias: np.ndarray
    accel_scale: np.ndarray
    accel_turn: np.ndarray
    accel_offset: np.ndarray
    gyros_late: float
    pressure: float
    inertia_ratio: float
    inertia: float


def draw(rng: np.random.Generator, grade: str, factor: float = 1.0) -> Errors:
    """Errors of one flight, each of the size that the grade states, times `factor`."""
    known = of_grade(grade)

    def normal(key: str, size: int | None = 3) -> np.ndarray:
        return factor * getattr(known, key)[0] * rng.standard_normal(size)

    return Errors(
        normal("gyro_bias"),
        normal("gyro_scale"),
        normal("gyro_misalignment"),
        normal("accel_bias"),
        normal("accel_scale"),
        normal("accel_misalignment"),
        normal("accel_position"),
        float(normal("time_skew", None)),
        float(normal("dynamic_pressure_scale", None)),
        float(normal("inertia_ratio", None)),
        float(normal("inertia", None)),
    )


def off_design(scenario: Scenario, rng: np.random.Generator, grade: str, factor: float = 1.0) -> Scenario:
    """The scenario with a c.g. off the stated one and an axis of inertia that is tilted, as the grade states."""
    offset, tilt = (
        factor * np.array(getattr(of_grade(grade), key)[1:]) * rng.standard_normal(2)
        for key in ("cg_offset", "principal_axis")
    )
    return replace(scenario, cg_offset=tuple(offset.tolist()), axis_tilt=tuple(tilt.tolist()))


def windy(scenario: Scenario, rng: np.random.Generator, grade: str, factor: float = 1.0) -> Scenario:
    """The scenario in a slowly changing wind, half waves each half as large as the one before, rms as stated."""
    shares = 0.5 ** np.arange(4)
    shares *= np.sqrt(2.0 / np.sum(shares**2))
    size = factor * of_grade(grade).wind[0]
    waves = size * shares[:, None] * rng.standard_normal((4, 3))
    return replace(scenario, wind=tuple((float(x), float(y), float(z)) for x, y, z in waves))


def erring(scenario: Scenario, seed: int, grade: str, factor: float = 1.0) -> tuple[Truth, Flight]:
    """What was flown and the record of it; its tolerances are the grade's, its errors `factor` times as large."""
    rng = np.random.default_rng([seed, 20])
    errors = draw(rng, grade, factor)
    truth = fly(off_design(windy(scenario, rng, grade, factor), rng, grade, factor))
    return _without_margin(truth), record(truth, errors, rng, grade)


def record(truth: Truth, errors: Errors, rng: np.random.Generator, grade: str) -> Flight:
    """The record of a truth by erring instruments."""
    s = truth.scenario
    rates = CubicSpline(truth.time, truth.rates)
    change = rates.derivative()(truth.time)
    offset = np.broadcast_to(errors.accel_offset, change.shape)
    swing = np.cross(change, offset) + np.cross(truth.rates, np.cross(truth.rates, offset))
    late = rates(truth.time - errors.gyros_late)
    gyros = _triad(late, errors.gyro_turn, errors.gyro_scale, errors.gyro_bias)
    accels = _triad(truth.force + swing, errors.accel_turn, errors.accel_scale, errors.accel_bias)
    gyros = gyros + s.gyro_noise * rng.standard_normal(gyros.shape)
    accels = accels + s.accel_noise * rng.standard_normal(accels.shape)
    grown = 1.0 + errors.inertia
    vehicle = replace(s.vehicle, ixx=s.vehicle.ixx * (1.0 + errors.inertia_ratio) * grown, iyy=s.vehicle.iyy * grown)
    inside = slice(_CLOCK_MARGIN, -_CLOCK_MARGIN)
    p, q, r = gyros[inside].T
    ax, ay, az = accels[inside].T
    return Flight(
        time=100.0 + truth.time[inside],
        p=p,
        q=q,
        r=r,
        ax=ax,
        ay=ay,
        az=az,
        velocity=truth.velocity[inside],
        dynamic_pressure=truth.pressure[inside] * (1.0 + errors.pressure),
        vehicle=vehicle,
        altitude=truth.altitude[inside],
        planet=s.planet,
        instruments=of_grade(grade),
    )


def _triad(true: np.ndarray, turn: np.ndarray, scale: np.ndarray, bias: np.ndarray) -> np.ndarray:
    """Three sensors (n, 3) on axes that are turned by a small rotation, scaled and biased."""
    return (1.0 + scale) * (true - np.cross(np.broadcast_to(turn, true.shape), true)) + bias


def _without_margin(truth: Truth) -> Truth:
    inside = slice(_CLOCK_MARGIN, -_CLOCK_MARGIN)
    names = ("time", "rates", "force", "velocity", "altitude", "pressure", "alpha", "meridian", "moment")
    return replace(truth, **{name: getattr(truth, name)[inside] for name in names})
