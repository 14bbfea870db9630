"""A compact 6-DOF truth, independent of the package: body axes, flat planet, DOP853 to 1e-10.

The aerodynamics are those of CONVENTIONS, linear in alpha: axial force, normal force, static moment, pitch
damping.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cache

import numpy as np
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from brv_hypo.flight.record import Flight, Vehicle


@dataclass(frozen=True)
class Scenario:
    """A vehicle, its flight and its instruments, SI; angles in rad.

    `wind` m/s, in the axes of the ground: amplitudes of cosines of 1, 2, ... half waves over the flight. `cg_offset` m:
    where the c.g. lies from the stated one, along y and z; `axis_tilt`: the turn of the axis of inertia about y and z.
    """

    name: str
    vehicle: Vehicle
    axial: float
    normal_slope: float
    static_slope: float
    damping: float
    speed: float
    altitude: float
    flight_path: float
    roll_rate: float
    alpha: float
    precession: float
    trim: complex = 0.0
    gravity: float = 9.80665
    density: float = 1.225
    scale_height: float = 7200.0
    planet: str = "earth"
    wind: tuple[tuple[float, float, float], ...] = ()
    cg_offset: tuple[float, float] = (0.0, 0.0)
    axis_tilt: tuple[float, float] = (0.0, 0.0)
    duration: float = 5.4
    sample_rate: float = 200.0
    gyro_noise: float = np.radians(0.02)
    accel_noise: float = 0.05
    gyro_bias: tuple[float, float, float] = (0.0, 0.0, 0.0)
    accel_bias: tuple[float, float, float] = (0.0, 0.0, 0.0)


# axial force, normal and static slopes, damping; speed, altitude, flight path; roll rate, alpha, precession
_CONE = Vehicle(110.0, 2.2, 24.0, 0.5, 0.19635, (0.05, 0.02, -0.03))
CONE = Scenario("cone", _CONE, 0.12, 1.8, -0.55, -2.0, 7000.0, 22000.0, -0.5, 6.0, np.radians(2.0), 0.6)
_CAPSULE = Vehicle(50.0, 2.6, 2.2, 0.83, 0.541, (0.0, 0.0, 0.0))
CAPSULE = Scenario(
    "capsule", _CAPSULE, 1.5, 0.15, -0.12, -0.3, 4000.0, 45000.0, -0.3, 1.0, np.radians(4.0), 0.5, duration=20.0
)
_SLENDER = Vehicle(180.0, 4.0, 160.0, 0.438, 0.1507, (0.3, 0.0, 0.05))
SLENDER = Scenario(
    "slender", _SLENDER, 0.3, 4.0, -3.0, -60.0, 1200.0, 25000.0, -1.0, 8.0, np.radians(3.0), 0.4, duration=20.0
)
SCENARIOS = (CONE, CAPSULE, SLENDER)


@dataclass(frozen=True)
class Truth:
    """Exact channels at the sample times, before the instruments; `moment` is the shape's, about the stated c.g."""

    scenario: Scenario
    time: np.ndarray
    rates: np.ndarray
    force: np.ndarray
    velocity: np.ndarray
    altitude: np.ndarray
    pressure: np.ndarray
    alpha: np.ndarray
    meridian: np.ndarray
    moment: np.ndarray
    gravity_body: np.ndarray


@cache
def fly(scenario: Scenario) -> Truth:
    """Integrate the equations of motion: each scenario once."""
    time = np.arange(round(scenario.duration * scenario.sample_rate) + 1) / scenario.sample_rate
    pitch = scenario.flight_path
    velocity = scenario.speed * np.array([np.cos(pitch), 0.0, -np.sin(pitch)])
    along = velocity / scenario.speed
    side = np.array([0.0, 1.0, 0.0])
    up = np.cross(side, along)
    # The nose is off the velocity by alpha; the transverse rate precesses it about the velocity.
    nose = np.cos(scenario.alpha) * along + np.sin(scenario.alpha) * (0.6 * side + 0.8 * up)
    body_y = np.cross(up, nose)
    body_y /= np.linalg.norm(body_y)
    matrix = np.stack([nose, body_y, np.cross(nose, body_y)], axis=1)
    density = scenario.density * np.exp(-scenario.altitude / scenario.scale_height)
    stiffness = np.sqrt(0.5 * density * scenario.speed**2 * scenario.vehicle.moment_scale * abs(scenario.static_slope))
    turn = scenario.precession * stiffness * scenario.alpha * matrix.T @ (0.6 * side + 0.8 * up)
    state = np.concatenate(
        [velocity, [0.0, 0.0, -scenario.altitude], matrix.ravel(), [scenario.roll_rate, turn[1], turn[2]]]
    )
    answer = solve_ivp(
        lambda t, x: _derivative(scenario, t, x)[0],
        (0.0, time[-1]),
        state,
        method="DOP853",
        t_eval=time,
        rtol=1e-10,
        atol=1e-10,
    )
    rows = [_derivative(scenario, t, column)[1] for t, column in zip(time, answer.y.T, strict=True)]
    columns = [np.array(column) for column in zip(*rows, strict=True)]
    force, speed, pressure, xi, moment, omega, change, gravity = columns
    r = np.array(scenario.vehicle.accelerometer_position)
    sensed = force + np.cross(change, r) + np.cross(omega, np.cross(omega, r))
    return Truth(
        scenario,
        time,
        omega,
        sensed,
        speed,
        -answer.y[5],
        pressure,
        np.arcsin(np.abs(xi)),
        np.unwrap(np.arctan2(xi.real, xi.imag)),
        moment,
        gravity[0],
    )


def thinned(truth: Truth, every: int) -> Truth:
    """The same flight sampled `every` times more seldom."""
    kept = {field.name: getattr(truth, field.name)[::every] for field in fields(truth) if field.name != "scenario"}
    rate = truth.scenario.sample_rate / every
    return Truth(scenario=replace(truth.scenario, sample_rate=rate), **kept)


@cache
def _inertia(s: Scenario) -> np.ndarray:
    """The tensor of inertia (3, 3) in the stated axes, kg m^2."""
    turn = Rotation.from_rotvec([0.0, *s.axis_tilt]).as_matrix()
    return turn @ np.diag([s.vehicle.ixx, s.vehicle.iyy, s.vehicle.iyy]) @ turn.T


def _cross(a: Sequence[float] | np.ndarray, b: np.ndarray) -> np.ndarray:
    """Of two vectors alone: `np.cross` takes ten times as long, and is called 30 000 times a flight."""
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def _derivative(s: Scenario, t: float, x: np.ndarray) -> tuple[np.ndarray, tuple]:
    velocity, matrix, omega = x[:3], x[6:15].reshape(3, 3), x[15:]
    relative = velocity - sum(
        np.array(amplitude) * np.cos(np.pi * wave * t / s.duration) for wave, amplitude in enumerate(s.wind, start=1)
    )
    speed = np.linalg.norm(relative)
    body = matrix.T @ relative
    alpha = np.arctan2(np.hypot(body[1], body[2]), body[0])
    meridian = np.arctan2(body[1], body[2])
    pressure = 0.5 * s.density * np.exp(x[5] / s.scale_height) * speed**2
    v = s.vehicle
    windward = np.array([np.sin(meridian), np.cos(meridian)])
    force = pressure * v.reference_area / v.mass * np.concatenate([[-s.axial], -s.normal_slope * alpha * windward])
    d = v.reference_length
    moment = (
        s.static_slope * alpha * np.exp(-1j * meridian)
        + s.damping * (omega[1] + 1j * omega[2]) * d / (2 * speed)
        + s.trim
    )
    inertia = _inertia(s)
    torque = pressure * v.reference_area * d * np.array([0.0, moment.real, moment.imag])
    torque -= v.mass * _cross((0.0, *s.cg_offset), force)
    change = np.linalg.solve(inertia, torque - _cross(omega, inertia @ omega))
    gravity = np.array([0.0, 0.0, s.gravity])
    skew = np.array([[0, -omega[2], omega[1]], [omega[2], 0, -omega[0]], [-omega[1], omega[0], 0]])
    rate = np.concatenate([matrix @ force + gravity, velocity, (matrix @ skew).ravel(), change])
    xi = (body[1] + 1j * body[2]) / speed
    return rate, (force, speed, pressure, xi, moment, omega.copy(), change, matrix.T @ gravity)


def observe(truth: Truth, seed: int, **changes: object) -> Flight:
    """The record that noisy, biased instruments make of it."""
    s = replace(truth.scenario, **changes)
    rng = np.random.default_rng(seed)
    rates = truth.rates + np.array(s.gyro_bias) + s.gyro_noise * rng.standard_normal(truth.rates.shape)
    force = truth.force + np.array(s.accel_bias) + s.accel_noise * rng.standard_normal(truth.force.shape)
    return Flight(
        time=100.0 + truth.time,
        p=rates[:, 0],
        q=rates[:, 1],
        r=rates[:, 2],
        ax=force[:, 0],
        ay=force[:, 1],
        az=force[:, 2],
        velocity=truth.velocity,
        dynamic_pressure=truth.pressure,
        vehicle=s.vehicle,
        altitude=truth.altitude,
        planet=s.planet,
    )
