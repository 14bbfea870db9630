"""What names and numbers say of a column: which channel it may be, and in what units.

Names: words that stand for a channel, the likelier first; stems and axes of triads; units at the end of a name.
Numbers: gravity at rest gives the units of accelerometers; the field across the axis, as a magnetometer sees it
turn, those of the roll rate; slopes of one channel against another those of speed, altitude and pressure.
`ForeignTable` holds the numeric columns of a file and what has been concluded of each, with the reason and the
doubts.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.ndimage import uniform_filter1d

from brv_hypo.arrays import FloatArray
from brv_hypo.errors import BrvHypoError
from brv_hypo.flight.derived import standard_density
from brv_hypo.flight.inspection import GRAVITY
from brv_hypo.flight.record import ACCELEROMETERS, CHANNEL_DIMENSIONS, GYROS
from brv_hypo.flight.units import Dimension
from brv_hypo.importing.tables import column_names, read_columns

# ---- What a column's name says: which channel it may be, and in what units ----


MAGNETOMETER = ("mx", "my", "mz")  # no channels of format 1: they tell the roll rate

# Words that stand for a channel, the likelier first; a name must hold all words of one entry.
_WORDS: Mapping[str, Sequence[tuple[str, ...]]] = {
    "time": (("time",), ("clock",), ("timestamp",), ("met",), ("t",), ("stamp",), ("epoch",), ("sec",)),
    "roll_rate_mag": (("roll", "rate", "mag"), ("mag", "roll"), ("mag", "spin")),
    "p": (("p",), ("roll", "rate"), ("rollrate",), ("spin", "rate")),
    "q": (("q",), ("pitch", "rate"), ("pitchrate",)),
    "r": (("r",), ("yaw", "rate"), ("yawrate",)),
    "ax": (("axial", "acc"), ("axial", "accel"), ("axial", "force"), ("nx",), ("acc",), ("accel",)),
    "ay": (("lateral", "acc"), ("lateral", "accel"), ("ny",)),
    "az": (("normal", "acc"), ("normal", "accel"), ("nz",)),
    "dynamic_pressure": (("dynamic", "pressure"), ("qbar",), ("qinf",), ("dyn", "press"), ("q", "dyn"), ("dynp",)),
    "velocity": (("velocity",), ("airspeed",), ("tas",), ("speed",), ("vel",), ("v",), ("vrel",)),
    "altitude": (("altitude",), ("baro", "alt"), ("gps", "alt"), ("alt",), ("height",), ("h",)),
    "density": (("density",), ("rho",)),
    "mach": (("mach",), ("ma",)),
    "reynolds": (("reynolds",), ("re",)),
}  # fmt: skip
_TRIADS: Mapping[tuple[str, str, str], frozenset[str]] = {
    GYROS: frozenset(
        ("g", "gyro", "gyr", "gyroscope", "w", "omega", "rate", "rot", "om", "angvel")
    ),
    ACCELEROMETERS: frozenset(("a", "acc", "accel", "acceleration", "accelerometer", "f", "force", "n")),
    MAGNETOMETER: frozenset(("m", "mag", "magn", "magnetometer", "b")),
}
_UNITS: Mapping[Dimension, Mapping[str, str]] = {
    "time": {"s": "s", "sec": "s", "ms": "ms", "msec": "ms", "us": "us", "usec": "us", "ns": "ns", "min": "min"},
    "angular rate": {
        **dict.fromkeys(("dps", "degs", "degps", "deg s", "deg"), "deg/s"),
        **dict.fromkeys(("radps", "rads", "rad s", "rad"), "rad/s"),
        **{"rpm": "rpm", "rps": "revolution/s", "hz": "revolution/s"},
    },
    "acceleration": {
        **dict.fromkeys(("mps2", "ms2", "mpss", "m s2", "mps 2", "m s 2"), "m/s^2"),
        **dict.fromkeys(("fps2", "ftps2", "ft s2", "ft s 2"), "ft/s^2"),
        **{"g": "g", "gs": "g", "gee": "g", "mg": "mg"},
    },
    "speed": {
        **dict.fromkeys(("mps", "ms", "m s"), "m/s"),
        **dict.fromkeys(("fps", "ftps", "ft s"), "ft/s"),
        **dict.fromkeys(("kmps", "kms", "km s"), "km/s"),
        **dict.fromkeys(("kmh", "kph", "km h"), "km/hour"),
        **dict.fromkeys(("kt", "kts", "kn"), "knot"),
    },
    "length": {"m": "m", "ft": "ft", "feet": "ft", "km": "km", "kft": "kft"},
    "pressure": {"pa": "Pa", "hpa": "hPa", "kpa": "kPa", "psf": "psf", "psi": "psi", "mbar": "mbar"},
    "density": {"kgm3": "kg/m^3", "kg m3": "kg/m^3", "slugft3": "slug/ft^3"},
}  # fmt: skip
_VEHICLE: Mapping[str, Sequence[tuple[str, ...]]] = {
    "mass": (("mass",), ("weight",)),
    "ixx": (("ixx",), ("ix",), ("roll", "inertia"), ("axial", "inertia"), ("longitudinal", "inertia")),
    "iyy": (("iyy",), ("iy",), ("pitch", "inertia"), ("transverse", "inertia"), ("rotational", "inertia")),
}
_VEHICLE_UNITS: Mapping[Dimension, Mapping[str, str]] = {
    "mass": {"kg": "kg", "g": "g", "lb": "lb", "lbm": "lb", "slug": "slug"},
    "moment of inertia": {
        **dict.fromkeys(("kgm2", "kg m2", "kg m 2"), "kg*m^2"),
        **dict.fromkeys(("slugft2", "slug ft2", "slug ft 2"), "slug*ft^2"),
    },
}


@dataclass(frozen=True)
class NamedColumn:
    """A column that its name gives to `channel`; `units` None where the name tells none."""

    column: str
    channel: str
    units: str | None


def by_name(columns: Sequence[str]) -> tuple[dict[str, NamedColumn], dict[str, list[str]]]:
    """The likeliest column of each channel (and of a magnetometer), and others that its name fits as well."""
    ranked: dict[str, list[tuple[int, str]]] = {}
    struct = len(_struct_of(columns))
    for column in columns:
        found = _channel_of(_words(column[struct:]))
        if found is not None:
            ranked.setdefault(found[0], []).append((found[1], column))
    chosen, others = {}, {}
    for channel, candidates in ranked.items():
        candidates.sort(key=lambda entry: entry[0])
        column = candidates[0][1]
        chosen[channel] = NamedColumn(column, channel, units_in(column, channel))
        others[channel] = [name for _, name in candidates[1:]]
    return chosen, others


def units_in(column: str, channel: str) -> str | None:
    """The units that stand at the end of a name, in brackets or not; None where none do."""
    dimension = CHANNEL_DIMENSIONS.get(channel)
    if dimension == "dimensionless":
        return "dimensionless"
    known = _UNITS.get(dimension, {}) if dimension else {}
    return _at_end(_parts(column), known) or _at_end(_words(column), known)  # kPa is one word, MassKg two


def vehicle_property(column: str) -> str | None:
    """The property of the vehicle, of those that change in flight, that a name stands for; None for none."""
    held = set(_words(column))
    return next((name for name, names in _VEHICLE.items() if any(held.issuperset(each) for each in names)), None)


def vehicle_units(column: str, dimension: Dimension) -> str | None:
    """The units at the end of the name of a vehicle's property; None where none stand there."""
    known = _VEHICLE_UNITS.get(dimension, {})
    return _at_end(_parts(column), known) or _at_end(_words(column), known)


def _at_end(words: Sequence[str], known: Mapping[str, str]) -> str | None:
    for count in (3, 2, 1):
        text = " ".join(words[-count:])
        if len(words) > count and text in known:
            return known[text]
    return None


def _struct_of(columns: Sequence[str]) -> str:
    """The struct, with its point, that holds all columns of a MATLAB file; empty where none does."""
    structs = {column.rpartition(".")[0] for column in columns}
    only = structs.pop() if len(structs) == 1 else ""
    return f"{only}." if only else ""


def _words(column: str) -> list[str]:
    """The words of a name in lower case: at capitals, brackets, points and lines."""
    return _parts(re.sub(r"(?<=[a-z])(?=[A-Z])", " ", column))


def _parts(name: str) -> list[str]:
    """The words of a name in lower case, whatever their capitals."""
    return [word for word in re.split(r"[^a-z0-9]+", name.lower()) if word]


def _channel_of(words: Sequence[str]) -> tuple[str, int] | None:
    """The channel that words stand for, and how far down the list of its names; None for none."""
    held = set(words)
    for channel, names in _WORDS.items():
        for rank, needed in enumerate(names):
            alone = len(needed) > 1 or len(needed[0]) > 2 or words[0] == needed[0]
            if alone and held.issuperset(needed) and not _axis_of(words):
                return channel, rank
    triad = _axis_of(words)
    return (triad, 0) if triad else None


def _axis_of(words: Sequence[str]) -> str | None:
    """The channel of a triad: a stem and an axis, in one word or two."""
    for channels, stems in _TRIADS.items():
        for place, word in enumerate(words):
            axis = "xyz".find(word[-1])
            beside = {each for each in words if len(each) > 1} | set(words[max(place - 1, 0) : place])
            if axis >= 0 and (word[:-1] in stems or (len(word) == 1 and stems & beside)):
                return channels[axis]
    return None


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


# ---- A foreign table that is being guessed at: its columns, and what is known of each so far ----


DELIMITERS = (",", ";", "\t")


@dataclass(frozen=True)
class MapEntry:
    """One channel of the map; `why` it is what it is, and what is `unsure` about it. `recorder`: of another file."""

    column: str
    units: str
    why: str
    unsure: tuple[str, ...] = ()
    scale: float = 1.0
    offset: float = 0.0
    recorder: str | None = None


@dataclass
class ForeignTable:
    """The numeric columns, what is known of them so far, and the pad, if there is one."""

    path: Path
    delimiter: str
    columns: dict[str, FloatArray]
    entries: dict[str, MapEntry] = field(default_factory=dict)
    unsure: list[str] = field(default_factory=list)
    rest_s: tuple[float, float] | None = None

    def values(self, channel: str) -> FloatArray:
        """The column of a channel (n,), as it was read."""
        return self.columns[self.entries[channel].column]

    @property
    def seconds(self) -> FloatArray:
        """The table's times (n,), s."""
        return self.values("time") * TIMES.get(self.entries["time"].units, 60.0)

    def change(self, channel: str, why: str, *unsure: str, **changes: Any) -> None:
        """Another reason for what a channel is, with doubts and changed fields."""
        entry = self.entries[channel]
        reason = f"{entry.why}; {why}"
        self.entries[channel] = replace(entry, why=reason, unsure=(*entry.unsure, *unsure), **changes)

    def sure(self, channel: str, units: str, why: str) -> None:
        """Units by physics, which stand above those of a name."""
        before = self.entries[channel]
        named = () if before.units == units or before.unsure else (f"its name says {before.units}, {why}",)
        self.entries[channel] = replace(before, units=units, why=f"{before.why}; {why}", unsure=named)


def numeric_table(path: Path) -> ForeignTable:
    """Every column of numbers of a file, under the delimiter that parts most.

    Raises UsageError and FlightRecordError as `read_columns`.
    """
    tried = DELIMITERS if path.suffix.lower() == ".csv" else DELIMITERS[:1]
    delimiter = max(tried, key=lambda each: len(column_names(path, each)))
    names = tuple(dict.fromkeys(column_names(path, delimiter)))
    try:
        return ForeignTable(path, delimiter, dict(read_columns(path, names, delimiter)))
    except BrvHypoError:
        found: dict[str, FloatArray] = {}
        for name in names:
            try:
                found |= read_columns(path, (name,), delimiter)
            except BrvHypoError:  # text: it is no channel
                continue
        return ForeignTable(path, delimiter, found)
