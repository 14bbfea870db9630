"""The air that the independent flights cross: U.S. Standard Atmosphere 1976 to 84 km, and a slow wind."""

from __future__ import annotations

import math
from bisect import bisect_right
from dataclasses import dataclass

import numpy as np

GAS_CONSTANT = 287.053  # J/(kg K), U.S. Standard Atmosphere 1976
HEAT_RATIO = 1.4
GRAVITY = 9.80665  # m/s^2
EARTH_RADIUS = 6356766.0  # m, of geopotential altitude
# Geopotential altitude of a layer's foot (m), lapse rate (K/m).
_LAYERS = (
    (0.0, -6.5e-3),
    (11000.0, 0.0),
    (20000.0, 1e-3),
    (32000.0, 2.8e-3),
    (47000.0, 0.0),
    (51000.0, -2.8e-3),
    (71000.0, -2e-3),
)
# Angular frequencies of the wind in turns over the record: slow against the vehicle's motion.
_WIND_TURNS = (0.5, 1.0)
WIND_TERMS = 1 + 2 * len(_WIND_TURNS)


def _feet() -> list[tuple[float, float, float, float]]:
    """(altitude, temperature, pressure, lapse rate) at the foot of every layer."""
    temperature, pressure, feet = 288.15, 101325.0, []
    for (height, lapse), above in zip(_LAYERS, [*_LAYERS[1:], (84852.0, 0.0)], strict=True):
        feet.append((height, temperature, pressure, lapse))
        thickness = above[0] - height
        pressure *= _pressure_ratio(temperature, lapse, thickness)
        temperature += lapse * thickness
    return feet


def _pressure_ratio(temperature: float, lapse: float, height: float) -> float:
    if lapse == 0.0:
        return math.exp(-GRAVITY * height / (GAS_CONSTANT * temperature))
    return float((1.0 + lapse * height / temperature) ** (-GRAVITY / (GAS_CONSTANT * lapse)))


_FEET = _feet()
_HEIGHTS = [foot[0] for foot in _FEET]


def atmosphere(altitude: float) -> tuple[float, float]:
    """Density (kg/m^3) and temperature (K) at a geometric altitude (m)."""
    height = EARTH_RADIUS * altitude / (EARTH_RADIUS + altitude)
    foot, temperature, pressure, lapse = _FEET[max(bisect_right(_HEIGHTS, height) - 1, 0)]
    above = height - foot
    pressure *= _pressure_ratio(temperature, lapse, above)
    temperature += lapse * above
    return pressure / (GAS_CONSTANT * temperature), temperature


def sound_speed(temperature: float) -> float:
    """m/s at a temperature (K)."""
    return math.sqrt(HEAT_RATIO * GAS_CONSTANT * temperature)


def viscosity(temperature: float) -> float:
    """Sutherland's law, Pa s."""
    return 1.458e-6 * temperature**1.5 / (temperature + 110.4)


@dataclass(frozen=True)
class Wind:
    """A linear trend and slow sinusoids: `sizes` (3, WIND_TERMS) m/s in earth axes over `duration` s.

    Where every size is N(0, sigma^2), the mean square over the record is sigma^2 in expectation. `gust`: the time (s)
    of a step, and by how much (3,).
    """

    sizes: np.ndarray
    duration: float
    gust: tuple[float, np.ndarray] | None = None

    @property
    def still(self) -> bool:
        """Whether there is none."""
        return self.gust is None and not np.any(self.sizes)

    def at(self, time: float) -> tuple[np.ndarray, np.ndarray]:
        """Wind (3,) m/s and its rate (3,) m/s^2."""
        share = time / self.duration
        trend, turn = math.sqrt(0.5), math.sqrt(0.5 / len(_WIND_TURNS))
        value = [trend * math.sqrt(3.0) * (2.0 * share - 1.0)]
        rate = [trend * math.sqrt(3.0) * 2.0 / self.duration]
        for turns in _WIND_TURNS:
            frequency = 2.0 * math.pi * turns / self.duration
            cosine, sine = math.cos(frequency * time), math.sin(frequency * time)
            value += [turn * cosine, turn * sine]
            rate += [-turn * frequency * sine, turn * frequency * cosine]
        steady = self.sizes @ value
        if self.gust is not None and time >= self.gust[0]:
            steady = steady + self.gust[1]
        return steady, self.sizes @ rate
