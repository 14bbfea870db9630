"""`guess_map`: a commented map for a foreign record, from the names of its columns and from physics.

Every entry gives its reason; what is unsure is marked in the map and listed beside it. Nothing is hidden: columns
that were not used are listed at the end, with their ranges. Other files may go with the first: recorders with
clocks of their own, and tables of the vehicle over time. The rules are in guess_rules.py; here they are applied,
joined over the files and written as YAML.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import yaml

from brv_hypo.arrays import FloatArray
from brv_hypo.errors import UsageError
from brv_hypo.flight.inspection import find_phases
from brv_hypo.flight.record import (
    ACCELEROMETERS,
    CHANNEL_DIMENSIONS,
    GYROS,
    INERTIAL_CHANNELS,
    VEHICLE_DIMENSIONS,
)
from brv_hypo.flight.units import SI
from brv_hypo.importing import guess_rules as rules
from brv_hypo.importing.guess_rules import (
    MAGNETOMETER,
    ForeignTable,
    MapEntry,
    by_name,
    numeric_table,
    vehicle_property,
    vehicle_units,
)
from brv_hypo.importing.rocket_log import DECIMATED_LEAST_GAIN, DECIMATED_PER_CYCLE, clock_offset
from brv_hypo.io.text import one_line

# ---- A guessed map as commented YAML ----


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

_GRADE = "instruments: their grade is taken as industrial; their accuracy decides what the record can show"


@dataclass(frozen=True)
class Guess:
    """The map as YAML text, and what it is unsure of."""

    text: str
    unsure: tuple[str, ...]


@dataclass(frozen=True)
class OtherRecorder:
    """A second file with a clock of its own; `align` the entry of what it sensed of ax, None without one."""

    name: str
    table: ForeignTable
    align: MapEntry | None


@dataclass(frozen=True)
class VehicleTable:
    """Properties of the vehicle over time."""

    table: ForeignTable
    properties: dict[str, MapEntry]


@dataclass(frozen=True)
class Guessed:
    """The main table with what other files add to it; `zero_s` is what its clock reads at the map's zero."""

    table: ForeignTable
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
    missing, substitutes = _missing(table)
    lines += [f"  # MISSING: {each}" for each in missing]
    lines += _recorder_lines(found)
    vehicle, unknown = _vehicle_lines(found)
    lines += vehicle
    lines.append(
        "instruments: {grade: industrial}   # laboratory, tactical (fibre-optic or ring-laser gyros), industrial "
        "(MEMS), and any tolerance that is known"
    )
    lines += _offers(found, substitutes)
    lines += _unused(found)
    return Guess("\n".join(lines) + "\n", (*missing, *unknown, *doubts, _GRADE))


def file_of(table: ForeignTable, main: ForeignTable) -> str:
    """How a map names another file: by its name where it lies beside the main one."""
    beside = table.path.resolve().parent == main.path.resolve().parent
    return table.path.name if beside else str(table.path)


def _entry_lines(name: str, entry: MapEntry) -> list[str]:
    lines = [f"# UNSURE: {one_line(doubt)}" for doubt in entry.unsure]
    return [*lines, f"{name}: {{{_mapped(entry)}}}   # {one_line(entry.why)}"]


def _mapped(entry: MapEntry) -> str:
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
            comment = one_line(align.why)
            lines.append(f"    align: {{column: {_quoted(align.column)}, units: {align.units}, to: ax}}   # {comment}")
    return lines


def _missing(table: ForeignTable) -> tuple[list[str], list[str]]:
    """What format 1 needs and no column was found for, and lines that may stand in."""
    have = set(table.entries)
    lacking = [f"no column was found for {name}" for name in INERTIAL_CHANNELS if name not in have]
    offers = []
    if "velocity" not in have:
        if {"altitude", "ax"} <= have:
            offers.append("derive: {velocity: ascent}   # speed from ax and altitude: for a steep climb only")
        else:
            lacking.append(
                "no column was found for velocity, and none for altitude, from which a climb would give it: if another "
                "recorder has one, name its file too"
            )
    if not have & {"dynamic_pressure", "density", "altitude"}:
        lacking.append("no column was found for dynamic_pressure, density or altitude: one of them is needed")
    return lacking, offers


def _vehicle_lines(found: Guessed) -> tuple[list[str], list[str]]:
    """The vehicle's lines, and in words what no table gives."""
    unknown = []
    lines = ["vehicle:   # what no table gives is null: fill it in"]
    known = found.vehicle.properties if found.vehicle is not None else {}
    for name, dimension in VEHICLE_DIMENSIONS.items():
        comment = f"   # {_OF_VEHICLE[name]}" if _OF_VEHICLE.get(name) else ""
        if found.vehicle is not None and name in known:
            file = _quoted(file_of(found.vehicle.table, found.table))
            time = _mapped(found.vehicle.table.entries["time"])
            lines += [f"  # UNSURE: {one_line(doubt)}" for doubt in known[name].unsure]
            lines.append(f"  {name}: {{file: {file}, {_mapped(known[name])}, time: {{{time}}}}}{comment}")
            continue
        value = "[0.0, 0.0, 0.0]" if name == "accelerometer_position" else "null"
        unknown.append(name)
        lines.append(f"  {name}: {{value: {value}, units: {SI[dimension]}}}{comment}")
    return lines, [f"no table gives these properties of the vehicle: {', '.join(unknown)}"] if unknown else []


def _offers(found: Guessed, substitutes: list[str]) -> list[str]:
    table, lines = found.table, list(substitutes)
    if table.rest_s is not None:
        start, stop = (each - found.zero_s for each in table.rest_s)
        lines.append(f"pad: [{start:.3f}, {stop:.3f}]   # at rest: biases are taken out")
        lines.append("window: coast   # leaves out pad, burn and parachute; or [start, stop]")
    rate = 1.0 / float(np.median(np.diff(table.seconds)))
    if rate > SLOWEST_FAST:
        comment = f"{DECIMATED_PER_CYCLE:g} samples a cycle of the motion, where the log has over "
        comment += f"{DECIMATED_LEAST_GAIN:g} times that"
        lines.append(f"rate: auto   # {rate:.4g} Hz brought, behind a low-pass, to {comment}")
    return lines


def _unused(found: Guessed) -> list[str]:
    tables: list[tuple[ForeignTable, set[str]]] = [(found.table, _used(found.table, None))]
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


def _used(table: ForeignTable, recorder: str | None) -> set[str]:
    return {
        entry.column
        for channel, entry in table.entries.items()
        if channel not in MAGNETOMETER and entry.recorder == recorder
    }


def _quoted(text: str) -> str:
    """A scalar as YAML writes it in one line."""
    return yaml.safe_dump(text, default_style='"', width=10**6).strip()


AIR = ("altitude", "velocity", "dynamic_pressure", "density", "mach")  # what a second recorder may add
ABOVE_GROUND = 30.0  # m: an altitude that begins within this counts from the ground
FAR = 60.0  # s: clocks that begin further apart have another zero


def with_others(table: ForeignTable, others: Sequence[ForeignTable]) -> Guessed:
    """The main table with the channels, clocks and properties that `others` hold."""
    found = Guessed(table)
    for other in others:
        properties = _properties(other)
        vehicle = VehicleTable(other, properties)
        found = replace(found, vehicle=vehicle) if properties else _with_recorder(found, other)
    return _at_liftoff(found)


def _properties(table: ForeignTable) -> dict[str, MapEntry]:
    found = {}
    for column in table.columns:
        name = vehicle_property(column)
        if name is not None and name not in found:
            units = vehicle_units(column, VEHICLE_DIMENSIONS[name])
            si = SI[VEHICLE_DIMENSIONS[name]]
            doubt = () if units else (f"units of {column} are nowhere said: {si} is a guess",)
            found[name] = MapEntry(column, units or si, "by name", doubt)
    return found


def _with_recorder(found: Guessed, other: ForeignTable) -> Guessed:
    """The channels that the main table lacks, and the clock by what both sensed along the axis."""
    name = re.sub(r"\W+", "_", other.path.stem)
    align = _alignment(found.table, other)
    doubts = [*found.unsure, *(f"{name}: {each}" for each in other.unsure if "no rest" not in each)]
    if align is None:
        doubts.append(
            f"{name}: it has no acceleration along the axis that runs as ax does, which would put its clock on the "
            "main one: give its time an offset, if the two differ"
        )
    for channel in AIR:
        if channel in other.entries and channel not in found.table.entries and not _derived(found, channel):
            entry = replace(other.entries[channel], recorder=name)
            found.table.entries[channel] = _from_sea(entry, other) if channel == "altitude" else entry
    return replace(found, recorders=(*found.recorders, OtherRecorder(name, other, align)), unsure=doubts)


def _derived(found: Guessed, channel: str) -> bool:
    """Speed is better made of ax and altitude than taken from a recorder's own integral."""
    return channel == "velocity" and {"ax", "altitude"} <= set(found.table.entries)


def _alignment(main: ForeignTable, other: ForeignTable) -> MapEntry | None:
    if "ax" not in main.entries or "ax" not in other.entries:
        return None
    entry = other.entries["ax"]
    scale = main.entries["ax"].scale
    try:
        _, likeness = clock_offset(main.seconds, scale * main.values("ax"), other.seconds, other.values("ax"))
    except UsageError:
        return None
    return replace(entry, why=f"{entry.why}; it runs as ax does, correlation {likeness:.3f}")


def _from_sea(entry: MapEntry, table: ForeignTable) -> MapEntry:
    """A doubt about an altitude that begins at nought."""
    begins = float(np.nanmedian(table.columns[entry.column][:5])) * rules.LENGTHS.get(entry.units, 1.0)
    if abs(begins) > ABOVE_GROUND:
        return entry
    doubt = f"it begins at nought, above the ground: add the site's height above the sea as offset, in {entry.units}"
    return replace(entry, unsure=(*entry.unsure, doubt))


def _at_liftoff(found: Guessed) -> Guessed:
    """The main clock set to zero at lift-off, where a table of the vehicle counts from there and the log does not."""
    table = found.table
    if found.vehicle is None or not {"ax", "ay", "az"} <= set(table.entries):
        return found
    time = table.seconds
    begins = float(found.vehicle.table.seconds[0])
    if abs(time[0] - begins) < FAR:
        return found
    sizes = [
        rules.ACCELERATIONS[table.entries[name].units] * table.entries[name].scale for name in ACCELEROMETERS
    ]
    forces = [size * table.values(name) for size, name in zip(sizes, ACCELEROMETERS, strict=True)]
    burn = next((phase for phase in find_phases(time, *forces) if phase.name == "burn"), None)
    if burn is None:
        doubt = f"{found.vehicle.table.path.name} counts time from another zero than the log: give its time an offset"
        return replace(found, unsure=(*found.unsure, doubt))
    zero = burn.start_s
    size = rules.TIMES.get(table.entries["time"].units, 60.0)
    reason = f"zero set to the ignition, found at {zero:.3f} s, from which {found.vehicle.table.path.name} counts"
    table.change("time", reason, "whether that table counts from ignition", offset=-zero / size)
    return replace(found, zero_s=zero)


# ---- `guess_map`: a commented map for a foreign record, from the names of its columns and from physics ----


NOSE_UP = 0.9  # share of gravity that an axis must read at rest to be called the one that stands up
_NOWHERE = "nowhere said"  # in a doubt of units
NOT_EARTHS = 2.0  # factor between a density and the Earth's at its altitude from which the planet is in doubt


def guess_map(data: str | Path, *others: str | Path) -> Guess:
    """A map for the csv, parquet or mat file `data`, and `others` that were recorded, or tabulated, beside it.

    Raises UsageError where a file holds no column that could be time, FlightRecordError where it is unreadable.
    """
    table = _examined(Path(data))
    found = with_others(table, [_examined(Path(other)) for other in others])
    return written(found)


def _examined(path: Path) -> ForeignTable:
    """The channels of a file, by name and by physics."""
    table = numeric_table(path)
    others = _by_name(table)
    _find_time(table)
    time = table.seconds
    _find_unnamed(table)
    _stand_upright(table, time)
    _units_of_gyros(table, time)
    _units_of_air(table, time)
    for channel, names in others.items():
        if names and channel in table.entries:
            table.change(channel, "the likeliest name", f"{', '.join(names)} may be {channel} as well")
    return table


def _by_name(table: ForeignTable) -> dict[str, list[str]]:
    chosen, others = by_name(list(table.columns))
    for channel, named in chosen.items():
        if channel in MAGNETOMETER:
            table.entries[channel] = MapEntry(named.column, "", "by name")
            continue
        si = SI[CHANNEL_DIMENSIONS[channel]]
        evidence = "by name" if named.units is None else "by name, units in the name"
        doubt = () if named.units else (_nowhere_said(named.column, si),)
        table.entries[channel] = MapEntry(named.column, named.units or si, evidence, doubt)
    return others


def _nowhere_said(column: str, units: str) -> str:
    return f"units of {column} are {_NOWHERE}: {units} is a guess"


def _find_time(table: ForeignTable) -> None:
    """The column of time, and its units by the rate that they make."""
    rising = [name for name, values in table.columns.items() if rules.increasing(values)]
    entry = table.entries.get("time")
    if entry is None or entry.column not in rising:
        if not rising:
            raise UsageError(
                f"{table.path}: no column rises strictly from sample to sample, as time does (there are "
                f"{', '.join(map(one_line, table.columns)) or 'none'}). Likely cause: repeated stamps, or a table "
                "without time. Remedy: keep one row of each stamp, or add a column of sample times."
            )
        used_columns = {each.column for channel, each in table.entries.items() if channel != "time"}
        free = [name for name in rising if name not in used_columns] or rising
        table.entries["time"] = MapEntry(
            free[0], "s", "the first column that rises throughout", ("whether this is time",)
        )
    fitting = rules.time_units(table.values("time"))
    units = table.entries["time"].units
    named = "units in the name" in table.entries["time"].why
    if fitting and (units not in fitting or not named):
        ambiguous = (
            (f"time in {' or '.join(fitting)}: each makes a rate that recorders have",)
            if len(fitting) > 1
            else ()
        )
        evidence = f"in {fitting[0]} its rate is one that recorders have"
        entry = table.entries["time"]
        doubt = tuple(each for each in entry.unsure if _NOWHERE not in each)
        table.entries["time"] = replace(
            entry, units=fitting[0], why=f"{entry.why}; {evidence}", unsure=(*doubt, *ambiguous)
        )


def _find_unnamed(table: ForeignTable) -> None:
    """Triads whose names say nothing: one that reads gravity at rest, and its neighbours in the table."""
    if "ax" in table.entries:
        return
    used_columns = {entry.column for entry in table.entries.values()}
    free = [name for name in table.columns if name not in used_columns]
    rest = rules.find_rest(table.seconds, [table.columns[name] for name in free])
    if rest is None:
        return
    reads = {name: float(np.mean(table.columns[name][rest.start : rest.stop])) for name in free}
    up = next((name for name in free if rules.gravity_units(abs(reads[name]))), None)
    if up is None:
        return
    names = list(table.columns)
    at = names.index(up)
    doubt = ("taken from the order of the columns: check it",)
    blocks = (
        (ACCELEROMETERS, at),
        (GYROS, at - 3 if all(n in free for n in names[max(at - 3, 0) : at]) and at >= 3 else at + 3),
    )
    for channels, first in blocks:
        for channel, name in zip(channels, names[first : first + 3], strict=False):
            if name in free and channel not in table.entries:
                si = SI[CHANNEL_DIMENSIONS[channel]]
                table.entries[channel] = MapEntry(name, si, f"beside {up}, which reads gravity at rest", doubt)


def _stand_upright(table: ForeignTable, time: FloatArray) -> None:
    """Units of the accelerometers, and the axis that is up, from gravity at rest."""
    if not set(ACCELEROMETERS) <= set(table.entries):
        return
    known = [table.values(name) for name in (*ACCELEROMETERS, *GYROS) if name in table.entries]
    rest = rules.find_rest(time, known)
    if rest is None:
        doubt = "no rest in the record, at which gravity would tell units and axes of the accelerometers"
        table.unsure.append(doubt)
        return
    reads = np.array([np.mean(table.values(name)[rest.start : rest.stop]) for name in ACCELEROMETERS])
    norm = float(np.linalg.norm(reads))
    units = rules.gravity_units(norm)
    if units is None:
        table.unsure.append(
            f"at rest the accelerometers read {norm:.4g}, which is gravity in no units that are known"
        )
        return
    for name in ACCELEROMETERS:
        table.sure(name, units, f"at rest they read {norm:.4g}, gravity in {units}")
    table.rest_s = (float(time[rest.start]), float(time[rest.stop - 1]))
    _turn_nose_up(table, reads / norm)


def _turn_nose_up(table: ForeignTable, up: FloatArray) -> None:
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
    for channels in (ACCELEROMETERS, GYROS):
        if not set(channels) <= set(table.entries):
            continue
        before = [table.entries[name] for name in channels]
        for place, (channel, source) in enumerate(zip(channels, order, strict=True)):
            flipped = -1.0 if sign < 0.0 and place in (0, 2) else 1.0
            table.entries[channel] = replace(before[source], scale=before[source].scale * flipped)
            table.change(
                channel, "axes turned so that x is up at rest", *([doubt] if channel == "ax" else [])
            )


def _units_of_gyros(table: ForeignTable, time: FloatArray) -> None:
    """Units and sign of the roll rate from a magnetometer, else units by range."""
    if not set(GYROS) <= set(table.entries):
        return
    rate = table.entries["p"].scale * table.values("p")
    if {"my", "mz"} <= set(table.entries):
        found = rules.turning_units(time, rate, (table.values("my"), table.values("mz")))
        if found is not None:
            units, sign = found
            for name in GYROS:
                table.sure(name, units, f"the magnetometer turns as p does in {units}")
            if sign < 0.0:
                doubt = "p turns against the magnetometer: its sign, or one of the magnetometer's axes, is reversed"
                table.change("p", "sign against the magnetometer", doubt)
            return
    if any(_NOWHERE in doubt or "order of" in doubt for doubt in table.entries["p"].unsure):
        most = max(float(np.nanmax(np.abs(table.values(name)))) for name in GYROS)
        units = "deg/s" if most > rules.FASTEST_RADIANS else "rad/s"
        for name in GYROS:
            entry = table.entries[name]
            doubts = tuple(_nowhere_said(entry.column, units) if _NOWHERE in each else each for each in entry.unsure)
            table.entries[name] = replace(entry, unsure=doubts)
            table.change(name, f"{units} by range (up to {most:.3g})", units=units)


def _units_of_air(table: ForeignTable, time: FloatArray) -> None:
    """Units of speed, altitude and pressure against each other and the accelerometer."""
    have = set(table.entries)
    if {"velocity", "ax"} <= have:
        _speed_like_push(table, time)
    if {"dynamic_pressure", "density", "velocity"} <= have:
        speed = table.values("velocity") * rules.SPEEDS[table.entries["velocity"].units]
        units = rules.pressure_units(table.values("dynamic_pressure"), table.values("density"), speed)
        if units is not None:
            table.sure("dynamic_pressure", units, f"in {units} it is half of density times speed squared")
    if {"density", "altitude"} <= have:
        _density_like_earths(table)


def _density_like_earths(table: ForeignTable) -> None:
    """A doubt about the planet, where the density at the record's altitudes is none of the Earth's."""
    units = (table.entries["altitude"].units, table.entries["density"].units)
    if units[0] not in rules.LENGTHS or units[1] != "kg/m^3":
        return
    share = rules.density_share(rules.LENGTHS[units[0]] * table.values("altitude"), table.values("density"))
    if share is not None and not 1.0 / NOT_EARTHS < share < NOT_EARTHS:
        table.unsure.append(f"the planet: the density is {share:.2g} of the Earth's at its altitudes")


def _speed_like_push(table: ForeignTable, time: FloatArray) -> None:
    """Speed and axial accelerometer in units that agree: as named, else with those that gravity gave, else any."""
    pairs = rules.speed_units(time, table.values("velocity"), table.values("ax"))
    named = (table.entries["velocity"].units, table.entries["ax"].units)
    if table.rest_s is not None:
        pairs = tuple(pair for pair in pairs if pair[1] == named[1])
    if not pairs:
        return
    speeds, pushes = named if named in pairs else pairs[0]
    table.sure("velocity", speeds, f"it changes as ax says, in {speeds} and {pushes}")
    for name in ACCELEROMETERS:
        beside = table.entries.get(name)
        if name == "ax":
            table.sure(name, pushes, f"it changes the speed, in {pushes} and {speeds}")
        elif beside is not None and beside.units == named[1]:
            table.sure(name, pushes, f"as ax, in {pushes}")
    _altitude_like_speed(table, time)


def _altitude_like_speed(table: ForeignTable, time: FloatArray) -> None:
    """An altitude that rises by the path of the speed, or nearly, is in the same units of length."""
    length = table.entries["velocity"].units.split("/")[0]
    if "altitude" in table.entries and length in ("m", "ft", "km"):
        factor = rules.climb_factor(time, table.values("altitude"), table.values("velocity"))
        if 0.8 < factor < 1.1:
            table.sure("altitude", length, f"it rises by the path of the speed, in {length}")
