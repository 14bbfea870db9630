"""Derived channels against the U.S. Standard Atmosphere, 1976, and their definitions."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from brv_hypo.flight.derived import derive

# U.S. Standard Atmosphere, 1976 (NOAA-S/T 76-1562), tables I and III, geometric altitude:
# altitude m, density kg/m^3, speed of sound m/s, dynamic viscosity kg/(m s); five digits as printed.
STANDARD = np.array(
    [[0.0, 1.2250, 340.29, 1.7894e-5], [20000.0, 8.8910e-2, 295.07, 1.4216e-5], [50000.0, 1.0269e-3, 329.80, 1.7037e-5]]
)
LENGTH = 0.5


def test_everything_follows_from_altitude_and_velocity_on_earth() -> None:
    altitude, density, sound, viscosity = STANDARD.T
    velocity = np.array([100.0, 1000.0, 5000.0])
    found, notes = derive({"altitude": altitude, "velocity": velocity}, "earth", LENGTH)
    np.testing.assert_allclose(found["density"], density, rtol=1e-4)
    np.testing.assert_allclose(found["dynamic_pressure"], 0.5 * found["density"] * velocity**2)
    np.testing.assert_allclose(found["mach"], velocity / sound, rtol=5e-5)
    np.testing.assert_allclose(found["reynolds"], density * velocity * LENGTH / viscosity, rtol=1.5e-4)
    assert len(notes) == 4


@given(st.lists(st.floats(0.0, 80000.0), min_size=2, max_size=20))
@example([11025.0, 20060.0, 32170.0, 47370.0, 51430.0, 71820.0])
def test_altitude_of_density_inverts_the_atmosphere(heights: list[float]) -> None:
    altitude = np.array(heights)
    velocity = np.full(altitude.size, 2000.0)
    forward, _ = derive({"altitude": altitude, "velocity": velocity}, "earth", LENGTH)
    back, _ = derive({"density": forward["density"], "velocity": velocity}, "earth", LENGTH)
    np.testing.assert_allclose(back["altitude"], altitude, atol=0.2)


def test_density_follows_from_dynamic_pressure_on_any_planet() -> None:
    velocity = np.array([0.0, 1000.0, 2000.0])
    found, notes = derive({"dynamic_pressure": np.array([0.0, 500.0, 2000.0]), "velocity": velocity}, "mars", LENGTH)
    np.testing.assert_allclose(found["density"], [np.nan, 1e-3, 1e-3])
    assert "altitude" not in found
    assert "mach" not in found
    assert "reynolds" not in found
    assert notes[-1].startswith("altitude, mach, reynolds missing and not derived: the planet is mars")


@pytest.mark.parametrize("planet", ["mars", "titan"])
def test_altitude_alone_gives_nothing_elsewhere(planet: str) -> None:
    found, notes = derive({"altitude": np.ones(3), "velocity": np.ones(3)}, planet, LENGTH)
    assert set(found) == {"altitude", "velocity"}
    assert planet in notes[0]


def test_density_is_never_extrapolated_and_the_limit_is_stated() -> None:
    altitude = np.array([70000.0, 80000.0, 90000.0])
    found, notes = derive({"altitude": altitude, "velocity": np.full(3, 5000.0)}, "earth", LENGTH)
    assert np.isnan(found["dynamic_pressure"]).tolist() == [False, False, True]
    assert np.all(np.isfinite(found["mach"]))
    assert any("1 samples lie beyond its range of -5 to 81 km" in note for note in notes)
    assert any("temperature of its end" in note for note in notes)


def test_recorded_channels_are_kept_and_compared() -> None:
    recorded = {
        "velocity": np.full(4, 1000.0),
        "density": np.full(4, 1e-3),
        "dynamic_pressure": np.full(4, 500.0 * 47.88),
        "mach": np.full(4, 3.0),
    }
    found, notes = derive(recorded, "mars", LENGTH)
    for name, values in recorded.items():
        np.testing.assert_array_equal(found[name], values)
    assert notes[0].startswith("recorded dynamic pressure is 47.88 times")
