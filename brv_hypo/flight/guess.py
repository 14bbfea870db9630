"""`guess_map`: a commented map for a foreign record, from the names of its columns and from physics.

Every entry says what it rests on; what is unsure is said in the map and listed beside it. Nothing is hidden: columns
that were not used stand at the end, with their ranges.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import yaml

from brv_hypo.arrays import FloatArray
from brv_hypo.errors import BrvHypoError, UsageError
from brv_hypo.files.printed import one_line
from brv_hypo.flight import guess_physics as physics
from brv_hypo.flight.decimate import LEAST_GAIN, SAMPLES_PER_CYCLE
from brv_hypo.flight.guess_names import MAGNETOMETER, by_name
from brv_hypo.flight.schema import CHANNEL_DIMENSIONS, VEHICLE_DIMENSIONS
from brv_hypo.flight.tables import column_names, read_columns
from brv_hypo.flight.units import SI

GYROS, FORCES = ("p", "q", "r"), ("ax", "ay", "az")
DELIMITERS = (",", ";", "\t")
NOSE_UP = 0.9  # share of gravity that an axis must read at rest to be called the one that stands up
SLOWEST_FAST = 100.0  # Hz: beyond, a log is offered decimation


@dataclass(frozen=True)
class Entry:
    """One channel of the map; `why` it is what it is, and what is `unsure` about it."""

    column: str
    units: str
    why: str
    unsure: tuple[str, ...] = ()
    scale: float = 1.0


@dataclass(frozen=True)
class Guess:
    """The map as YAML text, and what it is unsure of."""

    text: str
    unsure: tuple[str, ...]


@dataclass
class _Table:
    """The numeric columns, what is known of them so far, and the pad, if there is one."""

    columns: dict[str, FloatArray]
    entries: dict[str, Entry] = field(default_factory=dict)
    unsure: list[str] = field(default_factory=list)
    rest_s: tuple[float, float] | None = None

    def values(self, channel: str) -> FloatArray:
        return self.columns[self.entries[channel].column]

    def change(self, channel: str, why: str, *unsure: str, **changes: object) -> None:
        entry = self.entries[channel]
        told = f"{entry.why}; {why}"
        self.entries[channel] = replace(entry, why=told, unsure=(*entry.unsure, *unsure), **changes)  # type: ignore[arg-type]

    def sure(self, channel: str, units: str, why: str) -> None:
        """Units by physics, which stand above those of a name."""
        before = self.entries[channel]
        named = () if before.units == units or before.unsure else (f"its name says {before.units}, {why}",)
        self.entries[channel] = replace(before, units=units, why=f"{before.why}; {why}", unsure=named)


def guess_map(data: str | Path) -> Guess:
    """A map for the csv, parquet or mat file `data`.

    Raises UsageError where the file holds no column that could be time, FlightRecordError where it is unreadable.
    """
    path = Path(data)
    delimiter, columns = _numeric_columns(path)
    table = _Table(columns)
    others = _by_name(table)
    _find_time(table, path)
    time = _seconds(table)
    _find_unnamed(table)
    _stand_upright(table, time)
    _units_of_gyros(table, time)
    _units_of_air(table, time)
    for channel, names in others.items():
        if names and channel in table.entries:
            table.change(channel, "the likeliest name", f"{', '.join(names)} may be {channel} as well")
    return _written(table, path, delimiter, time)


def _numeric_columns(path: Path) -> tuple[str, dict[str, FloatArray]]:
    """The delimiter (of a text table) and every column of numbers."""
    tried = DELIMITERS if path.suffix.lower() == ".csv" else DELIMITERS[:1]
    delimiter = max(tried, key=lambda each: len(column_names(path, each)))
    names = column_names(path, delimiter)
    try:
        return delimiter, dict(read_columns(path, tuple(dict.fromkeys(names)), delimiter))
    except BrvHypoError:
        found: dict[str, FloatArray] = {}
        for name in dict.fromkeys(names):
            try:
                found |= read_columns(path, (name,), delimiter)
            except BrvHypoError:  # text: it is no channel
                continue
        return delimiter, found


def _by_name(table: _Table) -> dict[str, list[str]]:
    chosen, others = by_name(list(table.columns))
    for channel, named in chosen.items():
        if channel in MAGNETOMETER:
            table.entries[channel] = Entry(named.column, "", "by name")
            continue
        si = SI[CHANNEL_DIMENSIONS[channel]]
        told = "by name" if named.units is None else "by name, units in the name"
        doubt = () if named.units else (f"units of {named.column} are nowhere said: {si} is a guess",)
        table.entries[channel] = Entry(named.column, named.units or si, told, doubt)
    return others


def _find_time(table: _Table, path: Path) -> None:
    """The column of time, and its units by the rate that they make."""
    rising = [name for name, values in table.columns.items() if physics.increasing(values)]
    entry = table.entries.get("time")
    if entry is None or entry.column not in rising:
        if not rising:
            raise UsageError(
                f"{path}: no column rises strictly from sample to sample, as time does (there are "
                f"{', '.join(map(one_line, table.columns)) or 'none'}). Likely cause: repeated stamps, or a table "
                "without time. Remedy: keep one row of each stamp, or add a column of sample times."
            )
        taken = {each.column for channel, each in table.entries.items() if channel != "time"}
        free = [name for name in rising if name not in taken] or rising
        table.entries["time"] = Entry(
            free[0], "s", "the first column that rises throughout", ("whether this is time",)
        )
    fitting = physics.time_units(table.values("time"))
    units = table.entries["time"].units
    named = "units in the name" in table.entries["time"].why
    if fitting and (units not in fitting or not named):
        ambiguous = (
            (f"time in {' or '.join(fitting)}: each makes a rate that recorders have",)
            if len(fitting) > 1
            else ()
        )
        told = f"in {fitting[0]} its rate is one that recorders have"
        entry = table.entries["time"]
        doubt = tuple(each for each in entry.unsure if "nowhere said" not in each)
        table.entries["time"] = replace(
            entry, units=fitting[0], why=f"{entry.why}; {told}", unsure=(*doubt, *ambiguous)
        )


def _seconds(table: _Table) -> FloatArray:
    return table.values("time") * physics.TIMES.get(table.entries["time"].units, 60.0)


def _find_unnamed(table: _Table) -> None:
    """Triads whose names say nothing: one that reads gravity at rest, and its neighbours in the table."""
    if "ax" in table.entries:
        return
    taken = {entry.column for entry in table.entries.values()}
    free = [name for name in table.columns if name not in taken]
    rest = physics.find_rest(_seconds(table), [table.columns[name] for name in free])
    if rest is None:
        return
    reads = {name: float(np.mean(table.columns[name][rest.start : rest.stop])) for name in free}
    up = next((name for name in free if physics.gravity_units(abs(reads[name]))), None)
    if up is None:
        return
    names = list(table.columns)
    at = names.index(up)
    doubt = ("taken from the order of the columns: check it",)
    blocks = (
        (FORCES, at),
        (GYROS, at - 3 if all(n in free for n in names[max(at - 3, 0) : at]) and at >= 3 else at + 3),
    )
    for channels, first in blocks:
        for channel, name in zip(channels, names[first : first + 3], strict=False):
            if name in free and channel not in table.entries:
                si = SI[CHANNEL_DIMENSIONS[channel]]
                table.entries[channel] = Entry(name, si, f"beside {up}, which reads gravity at rest", doubt)


def _stand_upright(table: _Table, time: FloatArray) -> None:
    """Units of the accelerometers, and the axis that is up, from gravity at rest."""
    if not set(FORCES) <= set(table.entries):
        return
    known = [table.values(name) for name in (*FORCES, *GYROS) if name in table.entries]
    rest = physics.find_rest(time, known)
    if rest is None:
        doubt = "no rest in the record, at which gravity would tell units and axes of the accelerometers"
        table.unsure.append(doubt)
        return
    reads = np.array([np.mean(table.values(name)[rest.start : rest.stop]) for name in FORCES])
    norm = float(np.linalg.norm(reads))
    units = physics.gravity_units(norm)
    if units is None:
        table.unsure.append(
            f"at rest the accelerometers read {norm:.4g}, which is gravity in no units that are known"
        )
        return
    for name in FORCES:
        table.sure(name, units, f"at rest they read {norm:.4g}, gravity in {units}")
    table.rest_s = (float(time[rest.start]), float(time[rest.stop - 1]))
    _turn_nose_up(table, reads / norm)


def _turn_nose_up(table: _Table, up: FloatArray) -> None:
    """Axes turned, right-handed, so that the one that stands up is x."""
    axis = int(np.argmax(np.abs(up)))
    if axis == 0 and up[0] > 0.0:
        return
    if abs(up[axis]) < NOSE_UP:
        table.unsure.append(
            "at rest gravity lies along none of the axes: the vehicle leans, or the unit is mounted askew"
        )
        return
    sign = float(np.sign(up[axis]))
    order = [(axis + shift) % 3 for shift in range(3)]
    doubt = "if the vehicle did not stand nose up at rest, undo this"
    for channels in (FORCES, GYROS):
        if not set(channels) <= set(table.entries):
            continue
        before = [table.entries[name] for name in channels]
        for place, (channel, source) in enumerate(zip(channels, order, strict=True)):
            flipped = -1.0 if sign < 0.0 and place in (0, 2) else 1.0
            table.entries[channel] = replace(before[source], scale=before[source].scale * flipped)
            table.change(
                channel, "axes turned so that x is up at rest", *([doubt] if channel == "ax" else [])
            )


def _units_of_gyros(table: _Table, time: FloatArray) -> None:
    """Units and sign of the roll rate from a magnetometer, else units by range."""
    if not set(GYROS) <= set(table.entries):
        return
    rate = table.entries["p"].scale * table.values("p")
    if {"my", "mz"} <= set(table.entries):
        found = physics.turning_units(time, rate, (table.values("my"), table.values("mz")))
        if found is not None:
            units, sign = found
            for name in GYROS:
                table.sure(name, units, f"the magnetometer turns as p does in {units}")
            if sign < 0.0:
                doubt = "p turns against the magnetometer: its sign, or one of the magnetometer's axes, is reversed"
                table.change("p", "sign against the magnetometer", doubt)
            return
    if any("nowhere said" in doubt or "order of" in doubt for doubt in table.entries["p"].unsure):
        most = max(float(np.nanmax(np.abs(table.values(name)))) for name in GYROS)
        units = "deg/s" if most > physics.FASTEST_RADIANS else "rad/s"
        for name in GYROS:
            table.change(name, f"{units} by range (up to {most:.3g})", units=units)


def _units_of_air(table: _Table, time: FloatArray) -> None:
    """Units of speed, altitude and pressure against each other and the accelerometer."""
    have = set(table.entries)
    if {"velocity", "ax"} <= have:
        _speed_like_push(table, time)
    if {"dynamic_pressure", "density", "velocity"} <= have:
        speed = table.values("velocity") * physics.SPEEDS[table.entries["velocity"].units]
        units = physics.pressure_units(table.values("dynamic_pressure"), table.values("density"), speed)
        if units is not None:
            table.sure("dynamic_pressure", units, f"in {units} it is half of density times speed squared")


def _speed_like_push(table: _Table, time: FloatArray) -> None:
    """Speed and axial accelerometer in units that agree: as named, else with those that gravity told, else any."""
    pairs = physics.speed_units(time, table.values("velocity"), table.values("ax"))
    named = (table.entries["velocity"].units, table.entries["ax"].units)
    if table.rest_s is not None:
        pairs = tuple(pair for pair in pairs if pair[1] == named[1])
    if not pairs:
        return
    speeds, pushes = named if named in pairs else pairs[0]
    table.sure("velocity", speeds, f"it changes as ax says, in {speeds} and {pushes}")
    table.sure("ax", pushes, f"it changes the speed, in {pushes} and {speeds}")
    _altitude_like_speed(table, time)


def _altitude_like_speed(table: _Table, time: FloatArray) -> None:
    """An altitude that rises by the path of the speed, or nearly, is in the same units of length."""
    length = table.entries["velocity"].units.split("/")[0]
    if "altitude" in table.entries and length in ("m", "ft", "km"):
        factor = physics.climb_factor(time, table.values("altitude"), table.values("velocity"))
        if 0.8 < factor < 1.1:
            table.sure("altitude", length, f"it rises by the path of the speed, in {length}")


def _written(table: _Table, path: Path, delimiter: str, time: FloatArray) -> Guess:
    """The map as text, with a comment for every line that rests on a guess."""
    unsure = list(table.unsure)
    lines = [
        f"# A guess from {one_line(path.name)}. Read every line: what is unsure is marked.",
        'title: ""',
        "planet: earth",
    ]
    lines += [f"delimiter: {_quoted(delimiter)}"] if delimiter != "," else []
    lines.append("channels:")
    for name in CHANNEL_DIMENSIONS:
        entry = table.entries.get(name)
        if entry is None:
            continue
        scale = f", scale: {entry.scale:g}" if entry.scale != 1.0 else ""
        lines += [f"  # UNSURE: {one_line(doubt)}" for doubt in entry.unsure]
        lines.append(
            f"  {name}: {{column: {_quoted(entry.column)}, units: {entry.units}{scale}}}   # {one_line(entry.why)}"
        )
        unsure += [f"{name}: {doubt}" for doubt in entry.unsure]
    missing, asked = _missing(table)
    lines += [f"  # MISSING: {each}" for each in missing]
    lines += _vehicle_lines()
    lines += [
        "instruments: {grade: industrial}   # laboratory, tactical or industrial, and any tolerance that is known"
    ]
    lines += _offers(table, time, asked)
    lines += _unused(table)
    return Guess("\n".join(lines) + "\n", (*missing, *unsure))


def _missing(table: _Table) -> tuple[list[str], list[str]]:
    """What format 1 needs and no column was found for, and lines that may stand in."""
    have = set(table.entries)
    lacking = [f"no column was found for {name}" for name in (*GYROS, *FORCES) if name not in have]
    offers = []
    if "velocity" not in have:
        if {"altitude", "ax"} <= have:
            offers.append("derive: {velocity: ascent}   # speed from ax and altitude: for a steep climb only")
        else:
            lacking.append(
                "no column was found for velocity, and none for altitude, from which a climb would tell it"
            )
    if not have & {"dynamic_pressure", "density", "altitude"}:
        lacking.append("no column was found for dynamic_pressure, density or altitude: one of them is needed")
    return lacking, offers


def _vehicle_lines() -> list[str]:
    lines = ["vehicle:   # no table of samples tells these: fill them in"]
    for name, dimension in VEHICLE_DIMENSIONS.items():
        value = "[0.0, 0.0, 0.0]" if name == "accelerometer_position" else "null"
        lines.append(f"  {name}: {{value: {value}, units: {SI[dimension]}}}")
    return lines


def _offers(table: _Table, time: FloatArray, asked: list[str]) -> list[str]:
    lines = list(asked)
    if table.rest_s is not None:
        start, stop = table.rest_s
        lines.append(f"pad: [{start:.3f}, {stop:.3f}]   # at rest: biases are taken out")
        lines.append("window: coast   # leaves out pad, burn and parachute; or [start, stop]")
    rate = 1.0 / float(np.median(np.diff(time)))
    if rate > SLOWEST_FAST:
        told = f"{SAMPLES_PER_CYCLE:g} samples a cycle of the motion, where the log has over {LEAST_GAIN:g} times that"
        lines.append(f"rate: auto   # {rate:.4g} Hz brought, behind a low-pass, to {told}")
    return lines


def _unused(table: _Table) -> list[str]:
    used = {entry.column for channel, entry in table.entries.items() if channel not in MAGNETOMETER}
    lines = []
    for name, values in table.columns.items():
        if name not in used:
            known = values[np.isfinite(values)]
            span = f"{known.min():.4g} to {known.max():.4g}" if known.size else "empty"
            lines.append(f"# not used: {one_line(name)} ({span})")
    return lines


def _quoted(text: str) -> str:
    """A scalar as YAML writes it in one line."""
    return yaml.safe_dump(text, default_style='"', width=10**6).strip()
