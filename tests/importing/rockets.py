"""Logs of sounding rockets: one vertical, from two recorders with clocks of their own; others that lean and spin.

`fly` integrates point mass and attitude of many rockets at once, with wind, gusts, trim and thrust misalignment, and
`Log.read` is what a unit in such a rocket writes. Nothing here is taken from the library's own simulator.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

GRAVITY = 9.80665
IGNITION, BURNOUT, PARACHUTE, END = 0.0, 4.0, 16.0, 18.0
SITE = 300.0  # m
BIAS = {"p": 0.002, "q": -0.004, "r": 0.003, "ax": 0.08}
CLOCK = 5000.0  # s that the second recorder is ahead


def climb(time: Any) -> tuple[Any, Any, Any]:
    """Acceleration m/s^2, speed m/s and altitude m of a vertical climb at `time` (n,) s."""
    dense, *course = _course()
    return tuple(np.interp(time, dense, each) for each in course)


@cache
def _course() -> tuple[Any, ...]:
    """Times, accelerations, speeds and altitudes of the climb, every millisecond."""
    dense = np.arange(-10.0, END + 1.0, 1e-3)
    thrust = np.where((dense >= IGNITION) & (dense < BURNOUT), 70.0, 0.0)
    speed, speeds, pushes = 0.0, [], []
    for push in thrust:
        gained = push - (GRAVITY + 2.0e-4 * speed * speed if push or speed > 0.0 else 0.0)
        pushes.append(gained)
        speed = max(speed + 1e-3 * gained, 0.0)
        speeds.append(speed)
    altitude = SITE + np.cumsum(speeds) * 1e-3
    return dense, pushes, speeds, altitude


def inertial_unit(rate: float = 800.0, seed: int = 0) -> dict[str, Any]:
    """Its columns, SI: jittered stamps `time`, a gap of 0.05 s while coasting, and vibration above 100 Hz."""
    rng = np.random.default_rng(seed)
    time = np.arange(-5.0, END, 1.0 / rate)
    time = time + rng.uniform(-0.2, 0.2, time.size) / rate
    acceleration, speed, _ = climb(time)
    moving = np.clip(speed / 50.0, 0.0, 1.0)
    swing = 2.0 * np.pi * 1.2 * time
    shaking = moving * np.sin(2.0 * np.pi * 130.0 * time)
    columns = {
        "p": 0.8 * moving + 0.05 * shaking,
        "q": 0.06 * moving * np.cos(swing) + 0.05 * shaking,
        "r": 0.05 * moving * np.sin(swing) + 0.05 * shaking,
        "ax": acceleration + GRAVITY,
        "ay": 0.5 * moving * np.sin(swing) + shaking,
        "az": 0.5 * moving * np.cos(swing) + shaking,
    }
    columns["ax"] = np.where(time > PARACHUTE, 80.0 * np.exp(PARACHUTE - time), columns["ax"])
    noisy = {
        name: values + BIAS.get(name, 0.0) + 1e-3 * rng.standard_normal(time.size) for name, values in columns.items()
    }
    kept = ~((time > 8.0) & (time < 8.05))
    return {"time": time[kept], **{name: values[kept] for name, values in noisy.items()}}


def altimeter(seed: int = 1) -> dict[str, Any]:
    """Its columns, SI, at 40 Hz from ignition, on a clock that is `CLOCK` ahead; disturbed for a second."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, PARACHUTE, 0.025)
    acceleration, _, altitude = climb(time)
    disturbed = np.where(np.abs(time - 3.0) < 0.5, 200.0, 0.0)
    return {
        "time": time + CLOCK,
        "acceleration": acceleration + 0.2 * rng.standard_normal(time.size),
        "altitude": altitude + disturbed + 5.0 * rng.standard_normal(time.size),
    }


# ---- Rockets that lean and spin: six degrees of freedom from the pad to apogee, all flights at once ----

STEP, FLOWN, RAIL = 0.0025, 26.0, 4.0  # s, s, m
Array = Any


@dataclass(frozen=True)
class Log:
    """The truth of one flight at 400 Hz, from the pad (ignition at 0 s) to just before apogee; SI, body axes."""

    time: Array
    rates: Array
    """(3, n)"""
    forces: Array
    """(3, n) specific force at the unit."""
    speed: Array
    """(n,) relative to the air."""
    altitude: Array
    vehicle: Mapping[str, float]
    lean: float
    """Of the rail, rad."""

    def read(self, rng: Any, mount: Array | None = None, errors: float = 1.0) -> dict[str, Array]:
        """Columns in SI of a barometer and a unit turned by `mount` (3, 3), with `errors` times those of MEMS."""
        turn = np.eye(3) if mount is None else mount
        cross = np.eye(3) + errors * 3e-3 * rng.standard_normal((3, 3))
        gyros = turn @ (cross @ self.rates) + errors * np.radians(0.2) * rng.standard_normal((3, 1))
        cross = np.eye(3) + errors * 5e-3 * rng.standard_normal((3, 3))
        shaking = 0.05 + 2.0 * ((self.time > 0.0) & (self.forces[0] > 20.0))
        forces = turn @ (cross @ self.forces + shaking * errors * rng.standard_normal(self.forces.shape))
        forces += errors * 0.05 * rng.standard_normal((3, 1))
        gyros += errors * 2e-3 * rng.standard_normal(gyros.shape)
        height = self.altitude + rng.uniform(1.0, 4.0) * errors * rng.standard_normal(self.time.size)
        names = ("p", "q", "r", "ax", "ay", "az")
        return {"time": self.time, **dict(zip(names, (*gyros, *forces), strict=True)), "altitude": height}


def fly(seed: int, count: int, **fixed: float) -> list[Log]:
    """`count` flights drawn from `seed`; `fixed` sets lean (deg), rest (s) or spin (rad/s per 100 m/s) of all."""
    rng = np.random.default_rng(seed)

    def drawn(low: float, high: float, name: str = "") -> Array:
        values = rng.uniform(low, high, count)
        return np.full(count, fixed[name]) if name in fixed else values

    lean, rest, spin = np.radians(drawn(1, 15, "lean")), drawn(0.3, 3.0, "rest"), drawn(0.5, 6.0, "spin")
    spin = spin * rng.choice((-1.0, 1.0), count)
    push, burn, mass, size = drawn(60, 120), drawn(2, 4), drawn(12, 30), drawn(0.09, 0.16)
    area = 0.25 * np.pi * size**2
    ixx, iyy = 0.2 * mass * size**2, mass * drawn(0.3, 0.5)
    ca, cn, cm, cq = drawn(0.35, 0.7), drawn(8, 14), -drawn(12, 25), -drawn(150, 400)
    trim, skew = drawn(0.0, 6e-3) * cm, drawn(0.0, 3e-3)
    arm = np.stack([drawn(0.0, 0.5), *rng.uniform(-0.02, 0.02, (2, count))])
    steps = int(FLOWN / STEP)
    gust = np.zeros((steps + 1, 2, count))
    for k in range(steps):
        gust[k + 1] = gust[k] * (1 - STEP) + 1.2 * np.sqrt(2 * STEP) * rng.standard_normal((2, count))
    bearing = rng.uniform(0, 2 * np.pi, count)
    breeze = drawn(0, 7) * np.stack([np.cos(bearing), np.sin(bearing)])
    heading = rng.uniform(0, 2 * np.pi, count)
    nose = np.stack([np.sin(lean) * np.cos(heading), np.sin(lean) * np.sin(heading), np.cos(lean)])
    side = np.cross(nose.T, [0.3, -0.5, 0.8]).T
    side /= np.linalg.norm(side, axis=0)
    turn = np.stack([nose, side, np.cross(nose.T, side.T).T], axis=1)  # (3, 3, K): columns are body axes
    quaternion = Rotation.from_matrix(np.moveaxis(turn, 2, 0)).as_quat().T
    state = np.concatenate([np.zeros((6, count)), quaternion, np.zeros((3, count))])

    def change(t: float, state: Array, wind: Array) -> tuple[Array, Array, Array, Array]:
        place, velocity, q, omega = state[:3], state[3:6], state[6:10], state[10:]
        axes = Rotation.from_quat(q.T).as_matrix()
        flow = np.einsum("kij,ik->jk", axes, velocity - np.concatenate([wind, np.zeros((1, count))]))
        speed = np.maximum(np.linalg.norm(flow, axis=0), 0.1)
        pressure = 0.5 * 1.15 * np.exp(-place[2] / 8500.0) * speed**2
        thrust = push * np.clip(t / 0.08, 0, 1) * np.clip((burn - t) / 0.15 + 1, 0, 1)
        scale, cross = pressure * area / mass, flow[1:] / speed
        force = np.stack([thrust - ca * scale, -cn * scale * cross[0] + skew * thrust, -cn * scale * cross[1]])
        rate = omega[1:] * size / (2 * speed)
        pitch = cm * cross[1] + cq * rate[0] + trim
        yaw = -cm * cross[0] + cq * rate[1]
        roll = 20.0 * (spin * 0.01 * speed - omega[0]) * size / (2 * speed)
        moment = pressure * area * size * np.stack([roll / ixx, pitch / iyy, yaw / iyy])
        gyro = (1 - ixx / iyy) * omega[0]
        turned = moment + np.stack([np.zeros(count), gyro * omega[2], -gyro * omega[1]])
        pull = np.einsum("kij,jk->ik", axes, force)
        pull[2] -= GRAVITY
        railed = np.linalg.norm(place, axis=0) < RAIL
        along = np.maximum(np.einsum("kj,jk->k", axes[:, :, 0], pull), 0.0)
        pull = np.where(railed, along * axes[:, :, 0].T, pull)
        turned = np.where(railed, 0.0, turned)
        x, y, z, w = q
        p, r, s = omega
        spun = 0.5 * np.stack(
            [w * p + y * s - z * r, w * r + z * p - x * s, w * s + x * r - y * p, -x * p - y * r - z * s]
        )
        sensed = np.einsum("kij,ik->jk", axes, pull + np.array([[0], [0], [GRAVITY]]))
        sensed += np.cross(turned.T, arm.T).T + np.cross(omega.T, np.cross(omega.T, arm.T)).T
        return np.concatenate([velocity, pull, spun, turned]), sensed, speed, pressure

    states, forces, speeds = [], [], []
    for k in range(steps):
        wind = breeze + gust[k]
        first, sensed, speed, _ = change(k * STEP, state, wind)
        states.append(state)
        forces.append(sensed)
        speeds.append(speed)
        second = change((k + 0.5) * STEP, state + 0.5 * STEP * first, wind)[0]
        third = change((k + 0.5) * STEP, state + 0.5 * STEP * second, wind)[0]
        fourth = change((k + 1) * STEP, state + STEP * third, wind)[0]
        state = state + STEP / 6 * (first + 2 * second + 2 * third + fourth)
        state[6:10] /= np.linalg.norm(state[6:10], axis=0)
    history, sensed, speed = np.array(states), np.array(forces), np.array(speeds)
    logs = []
    for k in range(count):
        fallen = np.flatnonzero(history[:, 5, k] < -0.5)
        stop = int(fallen[0]) if fallen.size else steps
        still = round(rest[k] / STEP)
        at_rest = np.repeat(sensed[0, :, k : k + 1] * 0 + GRAVITY * turn[2, :, k : k + 1], still, axis=1)
        vehicle = {
            "mass": mass[k],
            "ixx": ixx[k],
            "iyy": iyy[k],
            "reference_length": size[k],
            "reference_area": area[k],
        }
        logs.append(
            Log(
                STEP * np.arange(-still, stop),
                np.concatenate([np.zeros((3, still)), history[:stop, 10:, k].T], axis=1),
                np.concatenate([at_rest, sensed[:stop, :, k].T], axis=1),
                np.concatenate([np.zeros(still), speed[:stop, k]]),
                np.concatenate([np.zeros(still), history[:stop, 2, k]]) + 100.0,
                vehicle,
                float(lean[k]),
            )
        )
    return logs
