"""What the numbers say: gravity at rest, turning against a magnetometer, slopes of one channel against another."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter1d

from brv_hypo.arrays import FloatArray
from brv_hypo.flight.derive import standard_density
from brv_hypo.flight.phases import GRAVITY

REST_SECONDS = 0.5
STILL = 0.03  # of a channel's whole spread: what is left of it at rest
WITHIN = 0.06  # relative: a factor is taken for that of units
DEGREE = float(np.pi / 180.0)
FOOT = 0.3048
RATES = (0.5, 2e4)  # Hz that a recorder may have
# SI value of one of each unit: those that a recorder writes, the likelier first.
ACCELERATIONS = {"m/s^2": 1.0, "g": GRAVITY, "ft/s^2": FOOT, "mg": 1e-3 * GRAVITY}
ANGULAR_RATES = {"rad/s": 1.0, "deg/s": DEGREE, "revolution/s": 2.0 * np.pi, "rpm": np.pi / 30.0}
SPEEDS = {"m/s": 1.0, "ft/s": FOOT, "km/s": 1e3, "km/hour": 1.0 / 3.6, "knot": 0.514444}
PRESSURES = {"Pa": 1.0, "psf": 47.880259, "kPa": 1e3, "hPa": 1e2, "psi": 6894.757}
LENGTHS = {"m": 1.0, "ft": FOOT, "km": 1e3, "kft": 1e3 * FOOT}
TIMES = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
FASTEST_RADIANS = 35.0  # rad/s, 2000 deg/s: the range of most gyros


@dataclass(frozen=True)
class Rest:
    """A stretch at rest, as indices [start, stop)."""

    start: int
    stop: int


def increasing(values: FloatArray) -> bool:
    """Whether a column could be time."""
    return values.size > 1 and bool(np.all(np.isfinite(values)) and np.all(np.diff(values) > 0.0))


def time_units(time: FloatArray) -> tuple[str, ...]:
    """Units in which the stamps make a rate that recorders have, the likelier first."""
    step = float(np.median(np.diff(time)))
    return tuple(unit for unit, size in TIMES.items() if RATES[0] <= 1.0 / (step * size) <= RATES[1])


def find_rest(time: FloatArray, channels: Sequence[FloatArray]) -> Rest | None:
    """The stretch from the record's beginning in which every channel (n,) is still; None without one.

    `time` (n,) in s.
    """
    width = int(np.searchsorted(time, time[0] + REST_SECONDS))
    if width < 5 or width >= time.size // 2:
        return None
    moving = np.zeros(time.size, dtype=np.bool_)
    for values in channels:
        known = np.where(np.isfinite(values), values, np.nanmedian(values))
        mean = uniform_filter1d(known, width, mode="nearest")
        spread = np.sqrt(np.maximum(uniform_filter1d(known**2, width, mode="nearest") - mean**2, 0.0))
        whole = float(np.ptp(np.percentile(known, (0.5, 99.5))))
        away = np.abs(mean - np.mean(known[:width]))
        moving |= (spread > STILL * whole) | (away > STILL * whole)
    first = int(np.argmax(moving)) if np.any(moving) else time.size
    stop = first - width
    return Rest(0, stop) if stop >= width and np.any(moving) else None


def gravity_units(norm: float) -> str | None:
    """The units in which a reading at rest, `norm`, is gravity; None where in none."""
    return _units_of_factor(norm and GRAVITY / norm, ACCELERATIONS)


def turning_units(
    time: FloatArray, rate: FloatArray, across: tuple[FloatArray, FloatArray]
) -> tuple[str, float] | None:
    """Units of a roll rate (n,) and its sign, from the field across the axis as a magnetometer sees it turn.

    The field stands still: its bearing in the body, atan2(m_z, m_y), turns by minus the roll rate. None where the field
    hardly turns, or no units fit. `time` (n,) in s.
    """
    centred = [values - 0.5 * (np.nanmax(values) + np.nanmin(values)) for values in across]
    bearing = np.unwrap(np.arctan2(centred[1], centred[0]))
    turned = -(bearing - bearing[0])
    if not np.all(np.isfinite(turned)) or np.ptp(turned) < 4.0 * np.pi:
        return None
    angle = np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(time))])
    factor = _slope(angle, turned)
    units = _units_of_factor(abs(factor), ANGULAR_RATES)
    return None if units is None else (units, float(np.sign(factor)))


def speed_units(time: FloatArray, speed: FloatArray, push: FloatArray) -> tuple[tuple[str, str], ...]:
    """Pairs of units of a speed (n,) and of the acceleration (n,) that changes it, as their ratio allows.

    What the accelerometer senses differs from the change of speed by gravity, or a part of it: a constant. Empty where
    the one does not follow from the other.
    """
    gained = np.concatenate([[0.0], np.cumsum(0.5 * (push[1:] + push[:-1]) * np.diff(time))])
    columns = np.stack([gained, time - time[0], np.ones_like(time)], axis=1)
    known = np.all(np.isfinite(columns), axis=1) & np.isfinite(speed)
    found, *_ = np.linalg.lstsq(columns[known], speed[known], rcond=None)
    left = speed[known] - columns[known] @ found
    if float(np.std(left)) > 0.1 * float(np.std(speed[known])):
        return ()
    fits = [
        (abs(np.log(abs(found[0]) * v / a)), v_name, a_name)
        for v_name, v in SPEEDS.items()
        for a_name, a in ACCELERATIONS.items()
    ]
    return tuple((speeds, pushes) for off, speeds, pushes in sorted(fits) if off < WITHIN)


def climb_factor(time: FloatArray, altitude: FloatArray, speed: FloatArray) -> float:
    """Change of an altitude over the path that a speed makes: 1 on a vertical climb in like units."""
    path = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(time))])
    return abs(_slope(path, altitude))


def pressure_units(pressure: FloatArray, density: FloatArray, speed: FloatArray) -> str | None:
    """Units in which a dynamic pressure is half of density (kg/m^3) times speed (m/s) squared."""
    made = 0.5 * density * speed**2
    usable = np.isfinite(made) & (pressure > 0.0)
    return (
        _units_of_factor(float(np.median(made[usable] / pressure[usable])), PRESSURES)
        if np.any(usable)
        else None
    )


def density_share(altitude: FloatArray, density: FloatArray) -> float | None:
    """Median ratio of a density (n,) kg/m^3 to the Earth's at `altitude` (n,) m; None where no model reaches."""
    share = density / standard_density(altitude)
    known = np.isfinite(share)
    return float(np.median(share[known])) if np.any(known) else None


def _slope(x: FloatArray, y: FloatArray) -> float:
    known = np.isfinite(x) & np.isfinite(y)
    centred = x[known] - np.mean(x[known])
    return float(centred @ y[known]) / max(float(centred @ centred), 1e-300)


def _units_of_factor(factor: float, units: Mapping[str, float]) -> str | None:
    """The unit of that size in SI."""
    if not np.isfinite(factor) or factor <= 0.0:
        return None
    name, size = min(units.items(), key=lambda item: abs(np.log(factor / item[1])))
    return name if abs(np.log(factor / size)) < WITHIN else None
