"""The air: standard atmosphere, a step of the wind, and the wind that record effects leave unaccounted for."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.interpolate import CubicSpline

from brv_hypo.arrays import FloatArray

LOWEST, HIGHEST = -5000.0, 81000.0
_SPACING = 50.0


@dataclass(frozen=True)
class Air:
    """Density kg/m^3, speed of sound m/s, dynamic viscosity Pa s."""

    density: FloatArray
    speed_of_sound: FloatArray
    viscosity: FloatArray


def standard_air(altitude: FloatArray) -> Air:
    """Air at `altitude` (m, any shape), within 1e-6 of the ICAO tables; held at -5 and 81 km beyond them."""
    values = _table()(np.minimum(np.maximum(altitude, LOWEST), HIGHEST))
    return Air(np.exp(values[..., 0]), values[..., 1], values[..., 2])


@lru_cache(maxsize=1)
def _table() -> CubicSpline:
    from ambiance import Atmosphere

    altitude = np.arange(LOWEST, HIGHEST + 1.0, _SPACING)
    air = Atmosphere(altitude)
    return CubicSpline(altitude, np.stack([np.log(air.density), air.speed_of_sound, air.dynamic_viscosity], axis=-1))


@dataclass(frozen=True)
class WindStep:
    """`EnvironmentConfig.wind_step` for a batch: at time (flights,) s the air begins to move.

    `after` (3, flights) m/s, in the frame, is its velocity from then on.
    """

    time: FloatArray
    after: FloatArray

    def velocity(self, time: FloatArray) -> FloatArray:
        """Velocity of the air in the frame, (3, ...) m/s, at `time` (..., flights) s."""
        shape = (3,) + (1,) * (time.ndim - 1) + self.after.shape[1:]
        return np.asarray(self.after.reshape(shape) * (time >= self.time), dtype=float)


@dataclass(frozen=True)
class WindProfile:
    """A wind along the record: `samples` (3, n, flights) m/s in the frame, `spacing` s apart from `begin` s on.

    Straight between its samples, and held before the first and after the last.
    """

    begin: float
    spacing: float
    samples: FloatArray

    def at(self, time: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Velocity of the air in the frame and its change, (3, ...) m/s and m/s^2, at `time` (..., flights) s."""
        last = self.samples.shape[1] - 1
        place = (time - self.begin) / self.spacing
        held = np.minimum(np.maximum(place, 0.0), last)
        left = np.minimum(held.astype(np.intp), last - 1)
        flight = np.arange(self.samples.shape[2])
        before = self.samples[:, left, flight]
        change = self.samples[:, left + 1, flight] - before
        return before + (held - left) * change, change * ((held == place) / self.spacing)
