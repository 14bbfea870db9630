"""Logs of sounding rockets: one vertical, from two recorders with clocks of their own; others that lean and spin.

`fly` integrates point mass and attitude with wind, gusts, trim and thrust misalignment, `Log.read` is what a unit in
such a rocket writes. Nothing here is taken from the library's own simulator.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache, lru_cache
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

GRAVITY = 9.80665
IGNITION, BURNOUT, PARACHUTE, END = 0.0, 4.0, 16.0, 18.0
SITE = 300.0  # m
BIAS = {"p": 0.002, "q": -0.004, "r": 0.003, "ax": 0.08}
CLOCK = 5000.0  # s that the second recorder is ahead


def climb(time: Any) -> tuple[Any, Any, Any]:
    """Acceleration m/s^2, speed m/s and altitude m of a vertical climb at `time` (n,) s."""
    dense, *histories = _climb()
    return tuple(np.interp(time, dense, each) for each in histories)


@cache
def _climb() -> tuple[Any, ...]:
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


# ---- Rockets that lean and spin: six degrees of freedom from the pad to apogee ----

FLOWN, RAIL = 26.0, 4.0  # s, m
GUST_STEP = 0.1  # s


@dataclass(frozen=True)
class Log:
    """The truth of one flight at 400 Hz, from the pad (ignition at 0 s) to just before apogee; SI, body axes."""

    time: Any
    rates: Any
    """(3, n)"""
    forces: Any
    """(3, n) specific force at the unit."""
    speed: Any
    """(n,) relative to the air."""
    altitude: Any
    vehicle: Mapping[str, float]

    def read(self, rng: Any, mount: Any = None) -> dict[str, Any]:
        """Columns in SI of a barometer and a MEMS unit turned by `mount` (3, 3)."""
        turn = np.eye(3) if mount is None else mount
        gyros = turn @ (np.eye(3) + 3e-3 * rng.standard_normal((3, 3))) @ self.rates
        gyros += 2e-3 * rng.standard_normal(gyros.shape) + np.radians(0.2) * rng.standard_normal((3, 1))
        shaking = (0.05 + 2.0 * ((self.time > 0.0) & (self.forces[0] > 20.0))) * rng.standard_normal(self.forces.shape)
        forces = turn @ ((np.eye(3) + 5e-3 * rng.standard_normal((3, 3))) @ self.forces + shaking)
        forces += 0.05 * rng.standard_normal((3, 1))
        height = self.altitude + rng.uniform(1.0, 4.0) * rng.standard_normal(self.time.size)
        names = ("p", "q", "r", "ax", "ay", "az")
        return {"time": self.time, **dict(zip(names, (*gyros, *forces), strict=True)), "altitude": height}


@lru_cache(maxsize=16)  # it takes two seconds, and tests read the same flights
def fly(seed: int, lean: float | None = None) -> Log:
    """A flight drawn from `seed`; `lean` of the rail in deg, 1 to 15 where it is left open."""
    rng = np.random.default_rng(seed)
    tilt = np.radians(rng.uniform(1, 15) if lean is None else lean)
    rest, spin = rng.uniform(0.3, 3.0), 0.01 * rng.uniform(0.5, 6.0) * rng.choice((-1.0, 1.0))
    (push, burn, mass, size) = rng.uniform((60, 2, 12, 0.09), (120, 4, 30, 0.16))
    (ca, cn, cm, cq, slender) = rng.uniform((0.35, 8, -25, -400, 0.3), (0.7, 14, -12, -150, 0.5))
    trim, skew = cm * rng.uniform(0.0, 6e-3), rng.uniform(0.0, 3e-3)
    area, ixx, iyy = 0.25 * np.pi * size**2, 0.2 * mass * size**2, slender * mass
    arm = np.array([rng.uniform(0.0, 0.5), *rng.uniform(-0.02, 0.02, 2)])
    steps = np.arange(0.0, FLOWN + 1.0, GUST_STEP)
    gusts = np.zeros((steps.size, 3))
    for k in range(1, steps.size):
        gusts[k, :2] = gusts[k - 1, :2] * (1 - GUST_STEP) + 1.2 * np.sqrt(2 * GUST_STEP) * rng.standard_normal(2)
    gusts[:, :2] += rng.uniform(-5.0, 5.0, 2)
    up = np.array([np.cos(tilt), *(np.sin(tilt) * rng.standard_normal(2))])
    up[1:] *= np.sin(tilt) / np.linalg.norm(up[1:])
    pull = np.array([0.0, 0.0, GRAVITY])
    # Attitude from body axes, x to the nose, to those of the ground, z up.
    start = Rotation.align_vectors([[0.0, 0.0, 1.0]], [up])[0].as_quat()

    def change(t: float, state: Any) -> tuple[Any, Any, float]:
        turn, velocity, omega = Rotation.from_quat(state[6:10]).as_matrix(), state[3:6], state[10:]
        blow = gusts[int(t / GUST_STEP)] + (t / GUST_STEP % 1.0) * np.diff(gusts[int(t / GUST_STEP) :][:2], axis=0)[0]
        flow = turn.T @ (velocity - blow)
        speed = max(float(np.linalg.norm(flow)), 0.1)
        scale = 0.575 * np.exp(-state[2] / 8500.0) * speed**2 * area
        drag, normal = ca * scale / mass, cn * scale / mass
        thrust = push * np.clip(t / 0.08, 0, 1) * np.clip((burn - t) / 0.15 + 1, 0, 1)
        beta, alpha = flow[1:] / speed
        force = np.array([thrust - drag, skew * thrust - normal * beta, -normal * alpha])
        p, q, r = omega
        roll, pitch, yaw = 0.5 * size / speed * np.array([20.0 * (spin * speed - p), cq * q, cq * r])
        moment = np.array([roll, pitch + cm * alpha + trim, yaw - cm * beta])
        turned = scale * size * moment / (ixx, iyy, iyy) + (1 - ixx / iyy) * p * np.array([0.0, r, -q])
        gained = turn @ force - pull
        if np.linalg.norm(state[:3]) < RAIL:
            gained, turned = max(float(turn[:, 0] @ gained), 0.0) * turn[:, 0], np.zeros(3)
        sensed = turn.T @ (gained + pull) + np.cross(turned, arm) + np.cross(omega, np.cross(omega, arm))
        x, y, z, w = state[6:10]
        spun = 0.5 * np.array([[w, -z, y], [z, w, -x], [-y, x, w], [-x, -y, -z]]) @ omega
        return np.concatenate([velocity, gained, spun, turned]), sensed, speed

    time = np.arange(0.0, FLOWN, 0.0025)
    begin = np.concatenate([np.zeros(6), start, np.zeros(3)])
    states = solve_ivp(lambda t, x: change(t, x)[0], (0.0, FLOWN), begin, t_eval=time, max_step=0.02, rtol=1e-6).y
    climbing = slice(0, int(np.argmax(states[2])) + 1)
    states, time = states[:, climbing], time[climbing]
    sensed = [change(t, state) for t, state in zip(time, states.T, strict=True)]
    still = round(400 * rest)
    before = np.arange(-still, 0) / 400
    return Log(
        np.concatenate([before, time]),
        np.concatenate([np.zeros((3, still)), states[10:]], axis=1),
        np.concatenate([GRAVITY * np.tile(up[:, None], still), np.transpose([each[1] for each in sensed])], axis=1),
        np.concatenate([np.zeros(still), [each[2] for each in sensed]]),
        100.0 + np.concatenate([np.zeros(still), states[2]]),
        {"mass": mass, "ixx": ixx, "iyy": iyy, "reference_length": size, "reference_area": area},
    )
