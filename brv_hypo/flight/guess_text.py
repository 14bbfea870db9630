"""A guessed map as commented YAML."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import yaml

from brv_hypo.constants import DECIMATED_LEAST_GAIN, DECIMATED_PER_CYCLE
from brv_hypo.files.printed import one_line
from brv_hypo.flight.guess_names import MAGNETOMETER
from brv_hypo.flight.guess_table import Entry, Table
from brv_hypo.flight.record import INERTIAL_CHANNELS
from brv_hypo.flight.schema import CHANNEL_DIMENSIONS, VEHICLE_DIMENSIONS
from brv_hypo.flight.units import SI

SLOWEST_FAST = 100.0  # Hz: beyond, a log is offered decimation
_OF_VEHICLE = {
    "mass": "",
    "ixx": "about the spin axis",
    "iyy": "about either transverse axis",
    "reference_length": "the one length of all moment coefficients: the diameter",
    "reference_area": "",
    "accelerometer_position": "from the centre of gravity, x to the nose; unknown: zeros, and its "
    "size as instruments/accel_position",
}
"""What a property of the vehicle is, for whom its name does not say."""

_GRADE = "instruments: their grade is taken as industrial; what they are worth decides what can be told from the record"


@dataclass(frozen=True)
class Guess:
    """The map as YAML text, and what it is unsure of."""

    text: str
    unsure: tuple[str, ...]


@dataclass(frozen=True)
class OtherRecorder:
    """A second file with a clock of its own; `align` the entry of what it sensed of ax, None without one."""

    name: str
    table: Table
    align: Entry | None


@dataclass(frozen=True)
class VehicleTable:
    """Properties of the vehicle over time."""

    table: Table
    properties: dict[str, Entry]


@dataclass(frozen=True)
class Guessed:
    """The main table with what other files add to it; `zero_s` is what its clock reads at the map's zero."""

    table: Table
    recorders: Sequence[OtherRecorder] = ()
    vehicle: VehicleTable | None = None
    zero_s: float = 0.0
    unsure: Sequence[str] = field(default=())


def written(found: Guessed) -> Guess:
    """The map as text, with a comment for every line that rests on a guess."""
    table = found.table
    doubts = [*table.unsure, *found.unsure]
    tables = [table, *(each.table for each in found.recorders), *([found.vehicle.table] if found.vehicle else [])]
    names = ", ".join(one_line(each.path.name) for each in tables)
    lines = [f"# A guess from {names}. Read every line: what is unsure is marked.", 'title: ""']
    planet = [each for each in doubts if each.startswith("the planet")]
    lines += [f"# UNSURE: {each}" for each in planet]
    lines.append("planet: earth   # or mars, venus, titan: only the Earth's atmosphere fills missing air data")
    lines += [f"delimiter: {_quoted(table.delimiter)}"] if table.delimiter != "," else []
    lines.append("channels:")
    for name in CHANNEL_DIMENSIONS:
        entry = table.entries.get(name)
        if entry is not None:
            lines += [f"  {line}" for line in _entry_lines(name, entry)]
            doubts += [f"{name}: {doubt}" for doubt in entry.unsure]
    missing, asked = _missing(table)
    lines += [f"  # MISSING: {each}" for each in missing]
    lines += _recorder_lines(found)
    vehicle, unknown = _vehicle_lines(found)
    lines += vehicle
    lines.append(
        "instruments: {grade: industrial}   # laboratory, tactical (fibre-optic or ring-laser gyros), industrial "
        "(MEMS), and any tolerance that is known"
    )
    lines += _offers(found, asked)
    lines += _unused(found)
    return Guess("\n".join(lines) + "\n", (*missing, *unknown, *doubts, _GRADE))


def file_of(table: Table, main: Table) -> str:
    """How a map names another file: by its name where it lies beside the main one."""
    beside = table.path.resolve().parent == main.path.resolve().parent
    return table.path.name if beside else str(table.path)


def _entry_lines(name: str, entry: Entry) -> list[str]:
    lines = [f"# UNSURE: {one_line(doubt)}" for doubt in entry.unsure]
    return [*lines, f"{name}: {{{_mapped(entry)}}}   # {one_line(entry.why)}"]


def _mapped(entry: Entry) -> str:
    recorder = f"recorder: {entry.recorder}, " if entry.recorder is not None else ""
    scale = f", scale: {entry.scale:g}" if entry.scale != 1.0 else ""
    offset = f", offset: {entry.offset:.10g}" if entry.offset != 0.0 else ""
    return f"{recorder}column: {_quoted(entry.column)}, units: {entry.units}{scale}{offset}"


def _recorder_lines(found: Guessed) -> list[str]:
    lines = ["recorders:"] if found.recorders else []
    for recorder in found.recorders:
        lines.append(f"  {recorder.name}:")
        lines.append(f"    file: {_quoted(file_of(recorder.table, found.table))}")
        lines += [f"    {line}" for line in _entry_lines("time", recorder.table.entries["time"])]
        if recorder.align is not None:
            align = recorder.align
            lines += [f"    # UNSURE: {one_line(doubt)}" for doubt in align.unsure]
            told = one_line(align.why)
            lines.append(f"    align: {{column: {_quoted(align.column)}, units: {align.units}, to: ax}}   # {told}")
    return lines


def _missing(table: Table) -> tuple[list[str], list[str]]:
    """What format 1 needs and no column was found for, and lines that may stand in."""
    have = set(table.entries)
    lacking = [f"no column was found for {name}" for name in INERTIAL_CHANNELS if name not in have]
    offers = []
    if "velocity" not in have:
        if {"altitude", "ax"} <= have:
            offers.append("derive: {velocity: ascent}   # speed from ax and altitude: for a steep climb only")
        else:
            lacking.append(
                "no column was found for velocity, and none for altitude, from which a climb would tell it: if another "
                "recorder has one, name its file too"
            )
    if not have & {"dynamic_pressure", "density", "altitude"}:
        lacking.append("no column was found for dynamic_pressure, density or altitude: one of them is needed")
    return lacking, offers


def _vehicle_lines(found: Guessed) -> tuple[list[str], list[str]]:
    """The vehicle's lines, and in words what no table tells of it."""
    unknown = []
    lines = ["vehicle:   # what no table tells is null: fill it in"]
    known = found.vehicle.properties if found.vehicle is not None else {}
    for name, dimension in VEHICLE_DIMENSIONS.items():
        told = f"   # {_OF_VEHICLE[name]}" if _OF_VEHICLE.get(name) else ""
        if found.vehicle is not None and name in known:
            file = _quoted(file_of(found.vehicle.table, found.table))
            time = _mapped(found.vehicle.table.entries["time"])
            lines += [f"  # UNSURE: {one_line(doubt)}" for doubt in known[name].unsure]
            lines.append(f"  {name}: {{file: {file}, {_mapped(known[name])}, time: {{{time}}}}}{told}")
            continue
        value = "[0.0, 0.0, 0.0]" if name == "accelerometer_position" else "null"
        unknown.append(name)
        lines.append(f"  {name}: {{value: {value}, units: {SI[dimension]}}}{told}")
    return lines, [f"no table tells of the vehicle: {', '.join(unknown)}"] if unknown else []


def _offers(found: Guessed, asked: list[str]) -> list[str]:
    table, lines = found.table, list(asked)
    if table.rest_s is not None:
        start, stop = (each - found.zero_s for each in table.rest_s)
        lines.append(f"pad: [{start:.3f}, {stop:.3f}]   # at rest: biases are taken out")
        lines.append("window: coast   # leaves out pad, burn and parachute; or [start, stop]")
    rate = 1.0 / float(np.median(np.diff(table.seconds)))
    if rate > SLOWEST_FAST:
        told = f"{DECIMATED_PER_CYCLE:g} samples a cycle of the motion, where the log has over "
        told += f"{DECIMATED_LEAST_GAIN:g} times that"
        lines.append(f"rate: auto   # {rate:.4g} Hz brought, behind a low-pass, to {told}")
    return lines


def _unused(found: Guessed) -> list[str]:
    tables: list[tuple[Table, set[str]]] = [(found.table, _used(found.table, None))]
    for recorder in found.recorders:
        own = {recorder.table.entries["time"].column, *([recorder.align.column] if recorder.align else [])}
        tables.append((recorder.table, own | _used(found.table, recorder.name)))
    if found.vehicle is not None:
        own = {found.vehicle.table.entries["time"].column}
        tables.append((found.vehicle.table, own | {entry.column for entry in found.vehicle.properties.values()}))
    lines = []
    for table, used in tables:
        where = "" if table is found.table else f"{one_line(table.path.name)}: "
        for name, values in table.columns.items():
            if name not in used:
                known = values[np.isfinite(values)]
                span = f"{known.min():.4g} to {known.max():.4g}" if known.size else "empty"
                lines.append(f"# not used: {where}{one_line(name)} ({span})")
    return lines


def _used(table: Table, recorder: str | None) -> set[str]:
    return {
        entry.column
        for channel, entry in table.entries.items()
        if channel not in MAGNETOMETER and entry.recorder == recorder
    }


def _quoted(text: str) -> str:
    """A scalar as YAML writes it in one line."""
    return yaml.safe_dump(text, default_style='"', width=10**6).strip()
