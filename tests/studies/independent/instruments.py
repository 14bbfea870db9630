"""Errors of instruments, vehicle and air: their sizes, how they are drawn, what the sensors make of a motion."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from scipy.signal import lfilter

from tests.studies.independent.air import WIND_TERMS

_DEGREE = np.pi / 180.0
GRADES = ("laboratory", "tactical", "industrial")
# 1-sigma, SI, by grade: the table of FLIGHT_FORMAT.
TOLERANCES: dict[str, tuple[float, float, float]] = {
    "gyro_bias": (0.002 * _DEGREE, 0.02 * _DEGREE, 0.2 * _DEGREE),
    "gyro_scale": (1e-4, 5e-4, 3e-3),
    "gyro_misalignment": (1e-4, 5e-4, 3e-3),
    "accel_bias": (0.001, 0.01, 0.05),
    "accel_scale": (1e-4, 1e-3, 5e-3),
    "accel_misalignment": (1e-4, 5e-4, 3e-3),
    "accel_position": (0.0005, 0.002, 0.005),
    "time_skew": (5e-5, 5e-4, 2e-3),
    "cg_offset": (1e-4, 5e-4, 2e-3),
    "principal_axis": (1e-4, 5e-4, 3e-3),
    "wind": (1.0, 3.0, 10.0),
    "dynamic_pressure_scale": (1e-3, 5e-3, 2e-2),
    "inertia_ratio": (1e-3, 5e-3, 2e-2),
    "inertia": (1e-3, 5e-3, 2e-2),
}
# Gyros are not orthogonal: six cross-axis terms (xy, xz, yx, yz, zx, zy). Accelerometers are a block, turned.
SHAPES: dict[str, tuple[int, ...]] = {
    "gyro_bias": (3,),
    "gyro_scale": (3,),
    "gyro_misalignment": (6,),
    "accel_bias": (3,),
    "accel_scale": (3,),
    "accel_misalignment": (3,),
    "accel_position": (3,),
    "cg_offset": (2,),
    "principal_axis": (2,),
    "wind": (3, WIND_TERMS),
}


@dataclass(frozen=True)
class Errors:
    """Actual errors, SI. `time_skew` > 0: the gyros' samples are late; relative ones are true = stated (1 + e).

    `dynamic_pressure_scale` is of the channel: measured = true (1 + e).
    """

    gyro_bias: np.ndarray
    gyro_scale: np.ndarray
    gyro_misalignment: np.ndarray
    accel_bias: np.ndarray
    accel_scale: np.ndarray
    accel_misalignment: np.ndarray
    accel_position: np.ndarray
    time_skew: float
    cg_offset: np.ndarray
    principal_axis: np.ndarray
    wind: np.ndarray
    dynamic_pressure_scale: float
    inertia_ratio: float
    inertia: float

    def values(self) -> dict[str, Any]:
        return {item.name: getattr(self, item.name) for item in fields(self)}

    def changed(self, key: str, place: int, size: float) -> Errors:
        """With one component set, counted along the flat array."""
        if key not in SHAPES:
            return replace(self, **{key: size})
        value = np.array(getattr(self, key))
        value.flat[place] = size
        return replace(self, **{key: value})


def no_errors() -> Errors:
    return Errors(**{key: np.zeros(SHAPES[key]) if key in SHAPES else 0.0 for key in TOLERANCES})


def draw_errors(
    grade: str, factor: float | Mapping[str, float], rng: np.random.Generator, fixed: Mapping[str, Any] | None = None
) -> Errors:
    """N(0, factor * tolerance) each; `factor` may be a mapping by key (1 elsewhere), `fixed` sets values."""
    place = GRADES.index(grade)
    drawn: dict[str, Any] = {}
    for key, sizes in TOLERANCES.items():
        times = factor.get(key, 1.0) if isinstance(factor, Mapping) else factor
        value = times * sizes[place] * rng.standard_normal(SHAPES.get(key, ()))
        drawn[key] = value if key in SHAPES else float(value)
    for key, value in (fixed or {}).items():
        drawn[key] = np.broadcast_to(value, SHAPES[key]).copy() if key in SHAPES else float(value)
    return Errors(**drawn)


@dataclass(frozen=True)
class Noise:
    """Noise, 1-sigma: rad/s, m/s^2, m/s, relative, m; `colour` correlates neighbouring samples of the inertial unit.

    With a colour, gyros and accelerometers have first-order autoregressive noise of the same 1-sigma.
    """

    gyro: float = 0.02 * _DEGREE
    accel: float = 0.05
    velocity: float = 0.5
    dynamic_pressure: float = 1e-3
    altitude: float = 5.0
    colour: float = 0.0

    def times(self, factor: float) -> Noise:
        """The same noise, so many times as large."""
        return Noise(
            factor * self.gyro,
            factor * self.accel,
            factor * self.velocity,
            factor * self.dynamic_pressure,
            factor * self.altitude,
            self.colour,
        )

    def inertial(self, rng: np.random.Generator, samples: int) -> np.ndarray:
        """Noise of unit variance (samples, 3) of three sensors."""
        fresh = rng.standard_normal((samples, 3))
        if self.colour == 0.0:
            return fresh
        fresh[1:] *= np.sqrt(1.0 - self.colour**2)
        return np.asarray(lfilter([1.0], [1.0, -self.colour], fresh, axis=0))


def gyro_matrix(errors: Errors) -> np.ndarray:
    """What the gyros make of the true rates."""
    matrix = np.eye(3) + np.diag(errors.gyro_scale)
    matrix[[0, 0, 1, 1, 2, 2], [1, 2, 0, 2, 0, 1]] = errors.gyro_misalignment
    return matrix


def rotation(angles: np.ndarray) -> np.ndarray:
    """Finite rotation by a vector of angles (3,), rad: turns vectors actively (Rodrigues)."""
    size = float(np.linalg.norm(angles))
    x, y, z = angles
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    if size < 1e-12:
        return np.eye(3) + cross
    return np.eye(3) + np.sin(size) / size * cross + (1.0 - np.cos(size)) / size**2 * cross @ cross


def sensed_rates(rates_at: Callable[[np.ndarray], np.ndarray], time: np.ndarray, errors: Errors) -> np.ndarray:
    """Gyros (n, 3) without noise; `rates_at` gives the true rates (n, 3) at any times."""
    return rates_at(time - errors.time_skew) @ gyro_matrix(errors).T + errors.gyro_bias


def sensed_force(force: np.ndarray, errors: Errors) -> np.ndarray:
    """Accelerometers (n, 3) without noise, of the true specific force at their place."""
    matrix = np.diag(1.0 + errors.accel_scale) @ rotation(errors.accel_misalignment).T
    return force @ matrix.T + errors.accel_bias


def inertia_tensor(ixx: float, iyy: float, errors: Errors) -> np.ndarray:
    """True tensor: stated moments with their errors, axis of inertia tilted about body y and z."""
    transverse = iyy * (1.0 + errors.inertia)
    axial = ixx / iyy * (1.0 + errors.inertia_ratio) * transverse
    turn = rotation(np.array([0.0, *errors.principal_axis]))
    return turn @ np.diag([axial, transverse, transverse]) @ turn.T
