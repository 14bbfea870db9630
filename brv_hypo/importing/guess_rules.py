"""What names and numbers say of a column: which channel it may be, and in what units.

Names: words that name a channel, the likelier first; stems and axes of triads; units at the end of a name.
Numbers: the rate gives the units of time, gravity at rest those of accelerometers. `ForeignTable` holds the numeric
columns of a file and what has been concluded of each, with the reason and the doubts.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from scipy.ndimage import uniform_filter1d

from brv_hypo.arrays import FloatArray
from brv_hypo.errors import FlightRecordError
from brv_hypo.flight.plausibility import GRAVITY, Tilt
from brv_hypo.flight.record import ACCELEROMETERS, CHANNEL_DIMENSIONS, GYROS
from brv_hypo.flight.units import RECORDED, Dimension, spelled, to_si
from brv_hypo.io.binary import ColumnTable

REST_SECONDS = 0.1
STILL = 0.03  # of a channel's whole spread: what is left of it at rest
WITHIN = 0.06  # relative: a factor is taken for that of units
RATES = (0.5, 2e4)  # Hz that a recorder may have
STATED_ONLY = frozenset(("min", "hour", "day"))  # units of time that no rate suggests: their name has to say so
FASTEST_RADIANS = 35.0  # rad/s, 2000 deg/s: the range of most gyros


def _as_rate(axis: str) -> tuple[tuple[str, ...], ...]:
    """An axis in units of a rate: roll_dps, Pitch [deg/s]."""
    return tuple((axis, *units) for units in (("dps",), ("deg", "s"), ("rad", "s"), ("rps",), ("rpm",)))


# Words that name a channel, or a property of the vehicle that changes in flight, the likelier first; a name
# must hold all words of one entry.
_WORDS: Mapping[str, Sequence[tuple[str, ...]]] = {
    "time": (("time",), ("clock",), ("timestamp",), ("met",), ("t",), ("stamp",), ("epoch",), ("sec",),
             ("gmt",), ("utc",)),
    "mach": (("mach",), ("ma",)),
    "dynamic_pressure": (("dynamic", "pressure"), ("qbar",), ("qinf",), ("dyn", "press"), ("q", "dyn"), ("dynp",),
                         ("pdyn",), ("dynpress",), ("q", "inf"), ("q", "bar"), ("q", "psf"), ("q", "pa"),
                         ("q", "kpa"), ("q", "psi")),
    "roll_rate_mag": (("roll", "rate", "mag"), ("mag", "roll"), ("mag", "spin")),
    "p": (("p",), ("roll", "rate"), ("rollrate",), ("spin", "rate"), ("gyro", "roll"), *_as_rate("roll")),
    "q": (("q",), ("pitch", "rate"), ("pitchrate",), ("gyro", "pitch"), *_as_rate("pitch")),
    "r": (("r",), ("yaw", "rate"), ("yawrate",), ("gyro", "yaw"), *_as_rate("yaw")),
    "ay": (("lateral", "acc"), ("lateral", "accel"), ("ny",)),
    "az": (("normal", "acc"), ("normal", "accel"), ("nz",)),
    "ax": (("axial", "acc"), ("axial", "accel"), ("axial", "force"), ("nx",), ("acc",), ("accel",)),
    "velocity": (("velocity",), ("airspeed",), ("tas",), ("speed",), ("vel",), ("v",), ("vrel",), ("vtrue",),
                 ("vt",), ("vinf",), ("vair",), ("v", "inf"), ("vtas",), ("ktas",), ("v", "true")),
    "altitude": (("altitude",), ("baro", "alt"), ("gps", "alt"), ("alt",), ("height",), ("hgt",), ("h",),
                 ("hbaro",), ("hgps",)),
    "density": (("density",), ("rho",)),
    "lean": (("lean",), ("tilt",)),
    "reynolds": (("reynolds",), ("re",)),
    "mass": (("mass",), ("weight",)),
    "ixx": (("ixx",), ("ix",), ("roll", "inertia"), ("axial", "inertia"), ("longitudinal", "inertia")),
    "iyy": (("iyy",), ("iy",), ("pitch", "inertia"), ("transverse", "inertia"), ("rotational", "inertia")),
}  # fmt: skip
# Words that turn about the sense of a channel, in a column's name.
_AGAINST = {"ax": ("aft",), "az": ("up",), "q": ("down", "dn")} | dict.fromkeys(("ay", "p", "r"), ("port", "left"))
_TRIADS: Mapping[tuple[str, str, str], frozenset[str]] = {
    GYROS: frozenset(("g", "gyro", "gyr", "gyroscope", "w", "omega", "rate", "rot", "om", "angvel")),
    ACCELEROMETERS: frozenset(("a", "acc", "accel", "acceleration", "accelerometer", "f", "force", "n", "sf")),
}


def by_name(columns: Sequence[str]) -> tuple[dict[str, str], dict[str, list[str]]]:
    """The likeliest column of each channel, and others that its name fits as well."""
    ranked: dict[str, list[tuple[int, str]]] = {}
    structs = {column.rpartition(".")[0] for column in columns}
    # A struct that holds all columns of a MATLAB file is no part of their names.
    struct = len(f"{structs.pop()}.") if len(structs) == 1 and structs != {""} else 0
    for column in columns:
        if found := _channel_of(_words(column[struct:])):
            ranked.setdefault(found[0], []).append((found[1], column))
    likeliest = {channel: [c for _, c in sorted(each, key=lambda entry: entry[0])] for channel, each in ranked.items()}
    return {channel: each[0] for channel, each in likeliest.items()}, {c: each[1:] for c, each in likeliest.items()}


def units_in(column: str, dimension: Dimension | None) -> str | None:
    """The units that are at the end of a name, in brackets or not; None where none do."""
    if dimension == "dimensionless":
        return "dimensionless"
    units = RECORDED[dimension].items() if dimension else ()
    column = re.sub(r"(?i)(?<![a-z])per(?![a-z])", " ", spelled(column))
    column = re.sub(r"(?i)(?<![a-z])ktas(?![a-z])", "tas kt", column)
    column = re.sub(r"(?i)(?<![a-z])(sec|seconds?)(?![a-z])", "s", column)
    known = {word: unit for unit, words in units for word in words}
    return _at_end(_parts(column), known) or _at_end(_words(column), known)  # kPa is one word, MassKg two


def stated_units(column: str, table: ColumnTable, dimension: Dimension) -> str | None:
    """The units that a table states for a column, or that are in its name; None where neither does."""
    text = spelled(table.units.get(column, ""))
    units = units_in(f"in [{text}]", dimension)
    with suppress(FlightRecordError):
        if units is None and text:
            to_si(1.0, text, dimension, column)
            units = text
    return units or units_in(column, dimension)


def _at_end(words: Sequence[str], known: Mapping[str, str]) -> str | None:
    for count in (3, 2, 1):
        text = " ".join(words[-count:])
        if len(words) > count and text in known:
            return known[text]
    return None


def _words(column: str) -> list[str]:
    """The words of a name in lower case: at capitals, brackets, points and lines, and a direction after an axis."""
    split = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", column)
    return _parts(re.sub(r"(?i)(?<=[xyz])(?=(up|down|dn|aft|fwd|port|left|right)(?![a-z]))", " ", split))


def sense(channel: str, column: str) -> tuple[int, tuple[str, ...]]:
    """1, or -1 where a column's name says that it counts against its channel (NZUP), and what is unsure."""
    words = {*_words(column)}
    if against := words & {*_AGAINST.get(channel, ())}:
        return -1, (f"its name says {against.pop()}, against {channel}: scale -1",)
    load = channel == "az" and words & {"nz", "normal"} and not words & {"down", "dn"}
    return 1, ("its sign: a normal load factor is often positive up; if so, scale: -1",) if load else ()


def _parts(name: str) -> list[str]:
    """The words of a name in lower case, whatever their capitals."""
    return re.findall(r"[a-z0-9]+", name.lower())


def _channel_of(words: Sequence[str]) -> tuple[str, int] | None:
    """The channel that words name, and how far down the list of its names; None for none."""
    triad = _axis_of(words)
    # A name that begins with one letter may go on with another quantity or its unit: P_BARO1, V_BATT, Q_PSF.
    others = ("bar", "inf", "dyn", "pres", "stat", "temp", "batt", "volt", "motor", "tank")
    of_another = any(word.startswith(others) or word in ("psf", "psi", "pa", "kpa") for word in words)
    for channel, names in _WORDS.items() if words and not triad else ():
        for rank, needed in enumerate(names):
            alone = len(needed) > 1 or len(needed[0]) > 2 or (words[0] == needed[0] and not of_another)
            if alone and {*words} >= {*needed}:
                return channel, rank
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


@cache
def sizes(dimension: Dimension) -> Mapping[str, float]:
    """SI value of one of each unit that a recorder writes, the likelier first."""
    return {unit: float(to_si(1.0, unit, dimension, "units")) for unit in RECORDED[dimension]}


def find_rest(time: FloatArray, channels: Sequence[FloatArray]) -> int | None:
    """Samples from the record's beginning in which every channel (n,) is still; None without. `time` (n,) in s."""
    width = int(np.searchsorted(time, time[0] + REST_SECONDS))
    if width < 5 or width >= time.size // 2:
        return None
    moving = np.zeros(time.size, dtype=np.bool_)
    for values in channels:
        known = np.where(np.isfinite(values), values, np.nanmedian(values))
        mean = uniform_filter1d(known, width, mode="nearest")
        spread = np.sqrt(np.maximum(uniform_filter1d(known**2, width, mode="nearest") - mean**2, 0.0))
        whole = float(np.ptp(np.percentile(known, (0.5, 99.5))))
        moving |= (spread > STILL * whole) | (np.abs(mean - np.mean(known[:width])) > STILL * whole)
    first = int(np.argmax(moving)) if np.any(moving) else time.size
    stop = first - width
    return stop if stop >= width and np.any(moving) else None


def units_of_gravity(reading: float) -> str | None:
    """The units in which gravity reads so; None where it does in none."""
    units = {unit: abs(np.log(max(reading, 1e-300) * size / GRAVITY)) for unit, size in sizes("acceleration").items()}
    best = min(units, key=lambda unit: units[unit])
    return best if units[best] < WITHIN else None


@dataclass(frozen=True)
class MapEntry:
    """One channel of the map, or property of the vehicle: `scale * column + offset`, in `units`."""

    column: str
    units: str
    why: str  # the reasons
    unsure: tuple[str, ...] = ()  # the doubts
    scale: int = 1  # -1 where the column counts the other way
    offset: float = 0.0
    recorder: str | None = None  # the other recorder that it comes from; None for the main table


@dataclass(eq=False)
class ForeignTable:
    """The numeric columns of a file and what is known of them so far."""

    path: Path
    read: ColumnTable  # with the units that the table states
    entries: dict[str, MapEntry] = field(default_factory=dict)  # by channel, or property of the vehicle
    joined: dict[str, FloatArray] = field(default_factory=dict)  # columns of other recorders, on this table's clock
    unsure: list[str] = field(default_factory=list)  # doubts about the table as a whole
    rest_s: tuple[float, float] | None = None  # the pad, if there is one
    tilt: Tilt | None = None  # of the nose, by thrust, in the axes of the entries
    align: MapEntry | None = None  # of another recorder: what it sensed of ax
    recorders: list[ForeignTable] = field(default_factory=list)  # of the main table: files with clocks of their own
    vehicle: ForeignTable | None = None  # of the main table: properties of the vehicle over time

    def values(self, channel: str) -> FloatArray:
        """The column of a channel (n,), as it was read, on the clock of this table."""
        return self.joined[channel] if channel in self.joined else self.read.columns[self.entries[channel].column]

    def in_si(self, channel: str) -> FloatArray:
        """The column of a channel (n,), SI."""
        entry = self.entries[channel]
        return entry.scale * to_si(self.values(channel), entry.units, CHANNEL_DIMENSIONS[channel], channel)

    @property
    def axial(self) -> str:
        """The accelerometer nearest to the nose, as far as that is known."""
        return ACCELEROMETERS[0 if self.tilt is None else int(np.argmax(np.abs(self.tilt.nose)))]

    @property
    def recorder(self) -> str:
        """The name of another recorder in the map."""
        return re.sub(r"\W+", "_", self.path.stem)

    def change(self, channel: str, why: str, *unsure: str, **changes: Any) -> None:
        """Another reason for what a channel is, with doubts and changed fields."""
        entry = self.entries[channel]
        doubts = (*entry.unsure, *unsure)
        self.entries[channel] = replace(entry, **{"why": f"{entry.why}; {why}", "unsure": doubts, **changes})
