"""The standard atmosphere, tabulated once: the integration asks for it thousands of times."""

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
    return CubicSpline(
        altitude, np.stack([np.log(air.density), air.speed_of_sound, air.dynamic_viscosity], axis=-1)
    )
