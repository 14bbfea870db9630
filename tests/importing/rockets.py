"""A sounding rocket's log: pad, burn, coast and parachute, from two recorders with clocks of their own."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

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
