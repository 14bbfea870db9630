"""Synthetic records for the tests of the flight package: smooth motion, white noise, raw HDF5 files."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from brv_hypo.flight import Flight, Vehicle

VEHICLE = Vehicle(
    mass=120.0, ixx=4.0, iyy=30.0, reference_length=0.5, reference_area=0.2, accelerometer_position=(0.1, 0.0, -0.02)
)

UNITS = {
    "time": "s",
    "p": "rad/s",
    "q": "rad/s",
    "r": "rad/s",
    "ax": "m/s^2",
    "ay": "m/s^2",
    "az": "m/s^2",
    "velocity": "m/s",
    "dynamic_pressure": "Pa",
    "altitude": "m",
    "density": "kg/m^3",
    "mach": "dimensionless",
    "reynolds": "dimensionless",
    "roll_rate_mag": "rad/s",
    "mass": "kg",
    "ixx": "kg*m^2",
    "iyy": "kg*m^2",
    "reference_length": "m",
    "reference_area": "m^2",
    "accelerometer_position": "m",
}
"""SI unit of every dataset of format 1."""

# Units with their exact size in SI (NIST SP 811): foot, pound-force, slug, standard gravity.
FOOT, POUND_FORCE, POUND, GRAVITY = 0.3048, 4.4482216152605, 0.45359237, 9.80665
SLUG = POUND_FORCE / FOOT
ACCEPTED = {
    "rad/s": {"rad/s": 1.0, "deg/s": np.pi / 180, "rpm": np.pi / 30, "mrad/s": 1e-3, "revolution/s": 2 * np.pi},
    "m/s^2": {"m/s^2": 1.0, "ft/s^2": FOOT, "g": GRAVITY, "G": GRAVITY, "m/s**2": 1.0, "mg": GRAVITY / 1000},
    "m/s": {"m/s": 1.0, "ft/s": FOOT, "km/s": 1000.0, "knot": 1852 / 3600},
    "Pa": {"Pa": 1.0, "lbf/ft^2": POUND_FORCE / FOOT**2, "psf": POUND_FORCE / FOOT**2, "kPa": 1000.0},
    "kg/m^3": {"kg/m^3": 1.0, "slug/ft^3": SLUG / FOOT**3, "lb/ft^3": POUND / FOOT**3},
    "m": {"m": 1.0, "ft": FOOT, "km": 1000.0, "inch": 0.0254},
    "m^2": {"m^2": 1.0, "ft^2": FOOT**2},
    "kg": {"kg": 1.0, "slug": SLUG, "lb": POUND},
    "kg*m^2": {"kg*m^2": 1.0, "slug*ft^2": SLUG * FOOT**2, "kg m^2": 1.0},
    "s": {"s": 1.0, "ms": 1e-3, "minute": 60.0},
    "dimensionless": {"dimensionless": 1.0, "1": 1.0, "": 1.0, "-": 1.0},
}
"""Units accepted for an SI unit, by the SI unit, with their size in it."""


def motion(samples: int = 400, rate: float = 100.0, frequency: float = 1.5, seed: int = 0) -> dict[str, Any]:
    """Channels (samples,) of a coning entry with white noise, SI, with `time`."""
    rng = np.random.default_rng(seed)
    time = 10.0 + np.arange(samples) / rate
    angle = 2.0 * np.pi * frequency * time

    def noisy(values: Any, sigma: float) -> Any:
        return values + sigma * rng.standard_normal(samples)

    velocity = 3000.0 - 20.0 * (time - 10.0)
    density = 1e-3 * np.exp(0.05 * (time - 10.0))
    return {
        "time": time,
        "p": noisy(6.0 + 0.0 * time, 1e-3),
        "q": noisy(0.2 * np.cos(angle), 1e-3),
        "r": noisy(0.15 * np.sin(angle), 1e-3),
        "ax": noisy(-30.0 - time, 0.05),
        "ay": noisy(2.0 * np.sin(angle), 0.05),
        "az": noisy(2.0 * np.cos(angle), 0.05),
        "velocity": velocity,
        "dynamic_pressure": 0.5 * density * velocity**2,
    }


def flight(**changes: Any) -> Flight:
    """A flight in memory made of `motion()`, with fields replaced."""
    return Flight(**{**motion(), "vehicle": VEHICLE, **changes})


def write_raw(
    path: Path,
    channels: Mapping[str, Any],
    *,
    units: Mapping[str, str | None] | None = None,
    vehicle: Mapping[str, Any] | None = None,
    attributes: Mapping[str, Any] | None = None,
) -> Path:
    """A format 1 file written without the library; a unit of None leaves the attribute out."""
    unit_of = {**UNITS, **(units or {})}
    fields = {name: getattr(VEHICLE, name) for name in VEHICLE.__dataclass_fields__} if vehicle is None else vehicle
    header = {"format": "brv-flight", "format_version": 1} if attributes is None else attributes
    with h5py.File(path, "w") as file:
        file.attrs.update(header)
        group = file.create_group("vehicle")
        for parent, datasets in ((file, channels), (group, fields)):
            for name, values in datasets.items():
                dataset = parent.create_dataset(name, data=values)
                unit = unit_of.get(name, "dimensionless")
                if unit is not None:
                    dataset.attrs["units"] = unit
    return path
