"""What a column's name says: which channel it may be, and in what units."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from brv_hypo.flight.record import ACCELEROMETERS, GYROS
from brv_hypo.flight.schema import CHANNEL_DIMENSIONS
from brv_hypo.flight.units import Dimension

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
