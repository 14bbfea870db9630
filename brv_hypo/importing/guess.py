"""`guess_map`: a commented map for a foreign record, from the names of its columns and from physics.

Every entry gives its reason; what is unsure is marked in the map and listed beside it. Nothing is hidden: columns
that were not used are listed at the end, with their ranges. Other files may go with the first: recorders with
clocks of their own, and tables of the vehicle over time. The rules are in guess_rules.py; here they are applied,
joined over the files and written as YAML by a template.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import yaml
from jinja2 import Environment, PackageLoader
from scipy.integrate import cumulative_trapezoid

from brv_hypo import thresholds as limits
from brv_hypo.arrays import FloatArray
from brv_hypo.errors import UsageError
from brv_hypo.flight.derived import atmosphere
from brv_hypo.flight.inspection import find_phases
from brv_hypo.flight.plausibility import GRAVITY, air_of, as_turned, gains, mounting_fault, nose_axis, relative_axes
from brv_hypo.flight.record import ACCELEROMETERS, CHANNEL_DIMENSIONS, GYROS, INERTIAL_CHANNELS, VEHICLE_DIMENSIONS
from brv_hypo.flight.units import SI, Dimension
from brv_hypo.importing import guess_rules as rules
from brv_hypo.importing.formats import clock_fault, read_all
from brv_hypo.importing.guess_rules import ForeignTable, MapEntry, stated_units
from brv_hypo.importing.rocket_log import ATTITUDE, PAD_FEWEST_SAMPLES, clock_offset
from brv_hypo.io.text import one_line

NOSE_UP = 0.9  # share of gravity that an axis must read at rest to be called the one that stands up
NOSE_UP_THRUST = 0.7  # cosine between thrust and up at rest: no rail leans by more than 45 deg
GAINED_WITHIN = 0.45  # logarithm within which a gain shows units: a path leans, feet are 0.3 m
NOT_EARTHS = 2.0  # factor between a density and the Earth's at its altitude from which the planet is in doubt
AIR = ("altitude", "velocity", "dynamic_pressure", "density", "mach")  # what a second recorder may add
ABOVE_GROUND = 30.0  # m: an altitude that begins within this counts from the ground
FAR = 60.0  # s: clocks that begin further apart have another zero
SLOWEST_FAST = 100.0  # Hz: beyond, a log is offered decimation
_NOT_STATED = "not stated"  # in a doubt of units


@dataclass(frozen=True)
class Guess:
    """The map as YAML text, and what it is unsure of."""

    text: str
    unsure: tuple[str, ...]


def guess_map(data: str | Path, *others: str | Path) -> Guess:
    """A map for the csv, parquet or mat file `data`, and `others` that were recorded, or tabulated, beside it.

    Raises UsageError where a file holds no column that could be time, FlightRecordError where it is unreadable.
    """
    main = _examined(Path(data))
    for other in others:
        _add(main, _examined(Path(other)))
    _count_from_liftoff(main)
    return _written(main)


# ---- One file: its channels, by name and by physics ----


def _examined(path: Path) -> ForeignTable:
    table = ForeignTable(path, read_all(path))
    known = [name for name, values in table.read.columns.items() if np.any(np.isfinite(values))]
    chosen, others = rules.by_name(known)
    for channel, column in chosen.items():
        dimension = {**CHANNEL_DIMENSIONS, **ATTITUDE}.get(channel)
        table.entries[channel] = _named(column, dimension, table) if dimension else MapEntry(column, "", "by name")
    _find_time(table)
    _stand_upright(table)
    _units_of_gyros(table)
    _units_of_air(table)
    _check_axes(table)
    for channel, names in others.items():
        if names and channel in table.entries:
            table.change(channel, "the likeliest name", f"{', '.join(names)} may be {channel} as well")
    return table


def _named(column: str, dimension: Dimension, table: ForeignTable) -> MapEntry:
    """A column that its name gives to a channel or property, in the units of the table or its name, or SI."""
    units = stated_units(column, table.read, dimension)
    if units is None:
        return MapEntry(column, SI[dimension], "by name", (_not_stated(column, SI[dimension]),))
    return MapEntry(column, units, "by name, units in the name")


def _not_stated(column: str, units: str) -> str:
    return f"units of {column} are {_NOT_STATED}: {units} is a guess"


def _find_time(table: ForeignTable) -> None:
    """The column of time, and its units by the rate that they make."""
    finite = {name: values for name, values in table.read.columns.items() if np.all(np.isfinite(values))}
    rising = [name for name, values in finite.items() if values.size > 1 and np.all(np.diff(values) > 0.0)]
    entry = table.entries.get("time")
    if entry is None or entry.column not in rising:
        if not rising:
            raise UsageError(f"{table.path}: {_no_clock(table)}")
        used = {each.column for channel, each in table.entries.items() if channel != "time"}
        first = next((name for name in rising if name not in used), rising[0])
        entry = MapEntry(first, "s", "the first column that rises throughout", ("whether this is time",))
        table.entries["time"] = entry
    fitting = rules.time_units(table.values("time"))
    if fitting and (entry.units not in fitting or "units in the name" not in entry.why):
        doubts = [each for each in entry.unsure if _NOT_STATED not in each]
        if len(fitting) > 1:
            doubts.append(f"time in {' or '.join(fitting)}: each makes a rate that recorders have")
        why = f"in {fitting[0]} its rate is one that recorders have"
        table.change("time", why, units=fitting[0], unsure=tuple(doubts))


def _no_clock(table: ForeignTable) -> str:
    """Why no column is time, by the one that is called so or rises most."""
    rises = {name: np.mean(np.diff(values) > 0.0) for name, values in table.read.columns.items() if values.size > 1}
    time = table.entries.get("time")
    named = time.column if time is not None else max(rises, key=lambda each: rises[each], default="")
    fault = clock_fault(table.read, named) if rises.get(named, 0.0) > 0.3 else None
    known = ", ".join(map(one_line, table.read.columns)) or "none"
    return fault or (
        f"no column rises strictly from sample to sample, as time does (there are {known}). Likely cause: a table "
        "without time. Remedy: add a column of sample times."
    )


def _stand_upright(table: ForeignTable) -> None:
    """Units of the accelerometers from gravity at rest; the axis of the nose from thrust, else from gravity."""
    if not set(ACCELEROMETERS) <= set(table.entries):
        return
    time = table.in_si("time")
    known = [table.values(name) for name in (*ACCELEROMETERS, *GYROS) if name in table.entries]
    rest = rules.find_rest(time, known)
    up = None
    if rest is None:
        doubt = "no rest in the record, at which gravity would tell units and axes of the accelerometers"
        table.unsure.append(doubt)
    else:
        reads = np.array([np.mean(table.values(name)[:rest]) for name in ACCELEROMETERS])
        norm = float(np.linalg.norm(reads))
        units = rules.units_of_factor(GRAVITY / max(norm, 1e-300), "acceleration")
        if units is None:
            doubt = f"at rest the accelerometers read {norm:.4g}, which is gravity in no units that are known"
            table.unsure.append(doubt)
            return
        for name in ACCELEROMETERS:
            table.sure(name, units, f"at rest they read {norm:.4g}, gravity in {units}")
        up = reads / norm
        if rest >= PAD_FEWEST_SAMPLES:
            table.rest_s = (float(time[0]), float(time[rest - 1]))
    forces = table.triad(ACCELEROMETERS)
    thrust = nose_axis(time, np.zeros_like(forces), forces)
    if thrust is not None:
        _turn_nose_up(table, thrust.nose, "along thrust")
        table.tilt = nose_axis(time, np.zeros_like(forces), table.triad(ACCELEROMETERS))
        if up is not None and float(up @ thrust.nose) < NOSE_UP_THRUST:
            angle = np.degrees(np.arccos(float(up @ thrust.nose)))
            table.unsure.append(f"thrust lies {angle:.0f} deg off what gravity shows to be up at rest")
    elif up is not None:
        _turn_nose_up(table, up, "up at rest")


def _turn_nose_up(table: ForeignTable, nose: FloatArray, how: str) -> None:
    """Axes turned, right-handed, so that the one nearest to the nose (3,) is x."""
    axis = int(np.argmax(np.abs(nose)))
    if abs(nose[axis]) < NOSE_UP and how != "along thrust":
        doubt = "at rest gravity lies along none of the axes: the vehicle leans, or the unit is mounted askew"
        table.unsure.append(doubt)
        return
    if axis == 0 and nose[0] > 0.0:
        return
    signs = (1.0, 1.0, 1.0) if nose[axis] > 0.0 else (-1.0, 1.0, -1.0)
    matrix = np.roll(np.eye(3), axis, axis=1) * np.array(signs)[:, None]
    for channels in (ACCELEROMETERS, GYROS):
        table.turn(channels, matrix, f"axes turned so that x is {how}")
    if how != "along thrust":
        table.change("ax", "by gravity", "if the vehicle did not stand nose up at rest, undo this")


def _axes_of_gyros(table: ForeignTable) -> bool:
    """Units, axes and signs of the gyros by the forces that follow from them; whether the record tells them."""
    if not {*GYROS, *ACCELEROMETERS} <= set(table.entries) or table.tilt is None:
        return False
    time, doubtful = table.in_si("time"), any(_NOT_STATED in doubt for doubt in table.entries["p"].unsure)
    rates = np.stack([table.entries[name].scale * table.values(name) for name in GYROS])
    if table.rest_s is not None:
        rates = rates - rates[:, time <= table.rest_s[1]].mean(axis=1, keepdims=True)
    matrix = table.tilt.matrix
    found = relative_axes(time, matrix @ rates, matrix @ table.triad(ACCELEROMETERS), rules.sizes("angular rate"))
    if found is None or found[2] > limits.GYROS_SURE:
        if not doubtful:
            table.unsure.append("axes and signs of the gyros: the forces do not tell them, and they are taken as named")
        return False
    units, turn, _ = found
    for name in GYROS:
        table.sure(name, units, f"the forces across the axis follow from the rates in {units}")
    if not np.allclose(turn, np.eye(3)):
        table.turn(GYROS, turn, "axes and signs by which the forces follow from the rates")
        table.unsure.append("the gyros' axes are not those of the accelerometers: turned, or reversed, by the forces")
    return True


def _units_of_gyros(table: ForeignTable) -> None:
    """Units of the gyros by the forces, else, where nothing states them, by range."""
    if not set(GYROS) <= set(table.entries) or _axes_of_gyros(table):
        return
    if any(_NOT_STATED in doubt for doubt in table.entries["p"].unsure):
        most = max(float(np.nanmax(np.abs(table.values(name)))) for name in GYROS)
        units = "deg/s" if most > rules.FASTEST_RADIANS else "rad/s"
        for name in GYROS:
            entry = table.entries[name]
            said = _not_stated(entry.column, units)
            doubts = tuple(said if _NOT_STATED in each else each for each in entry.unsure)
            table.change(name, f"{units} by range (up to {most:.3g})", units=units, unsure=doubts)


def _check_axes(table: ForeignTable) -> None:
    """Signs and axes of a log without thrust, by its own air data: doubts, as gyros and accelerometers may be wrong."""
    if table.tilt is not None or not {*GYROS, *ACCELEROMETERS} <= set(table.entries):
        return
    given = ("velocity", "dynamic_pressure", "density", "altitude")
    air = air_of({name: table.in_si(name) for name in given if name in table.entries})
    found = None
    if air is not None:
        found = relative_axes(table.in_si("time"), table.triad(GYROS), table.triad(ACCELEROMETERS), {"": 1.0}, air)
    if found is None or found[2] > limits.GYROS_SURE:
        why = "speed and air data in the same file would show them" if air is None else "the forces do not show them"
        table.unsure.append(f"signs and axes of gyros and accelerometers were not checked: {why}")
        return
    turn = found[1]
    # Both triads turned together, or mirrored, read the same: the accelerometers may be the ones at fault.
    mirrored = turn[0, 0] * turn
    triads = [(GYROS, turn), *([(ACCELEROMETERS, mirrored)] if np.linalg.det(turn) > 0.0 else [])]
    triads.sort(key=lambda each: int(np.count_nonzero(each[1] != np.eye(3))))
    wrong = np.flatnonzero((triads[0][1] != np.eye(3)).any(axis=1))
    if wrong.size:
        said = ", or ".join(as_turned(*each) for each in triads)
        doubt = f"the forces across the axis follow from the rates as if {said}: correct one of them"
        table.change(triads[0][0][wrong[0]], "its sign or axis in doubt", doubt)


def _gained(table: ForeignTable) -> None:
    """Units of speed and altitude by what the thrust gains."""
    recorded: dict[str, FloatArray] = {n: table.values(n) for n in ("velocity", "altitude") if n in table.entries}
    for name, (rise, made) in gains(table.in_si("time"), table.triad(ACCELEROMETERS), recorded).items():
        units = rules.units_of_factor(made / max(rise, 1e-9), CHANNEL_DIMENSIONS[name], GAINED_WITHIN)
        said = f"in the burn it gains {rise:.4g}, and the forces make {made:.4g} {SI[CHANNEL_DIMENSIONS[name]]}"
        if units is not None:
            table.sure(name, units, f"{said}: it is in {units}")
        else:
            table.change(name, "against the thrust", f"{said}: in no units that are known")


def _units_of_air(table: ForeignTable) -> None:
    """Units of speed, altitude and pressure against each other and the accelerometer."""
    have = set(table.entries)
    if set(ACCELEROMETERS) <= have and table.rest_s is not None:
        _gained(table)
    if {"velocity", "ax"} <= have:
        _speed_like_push(table)
    if {"dynamic_pressure", "density", "velocity"} <= have:
        pressure, density = table.values("dynamic_pressure"), table.values("density")
        units = rules.pressure_units(pressure, density, table.in_si("velocity"))
        if units is not None:
            table.sure("dynamic_pressure", units, f"in {units} it is half of density times speed squared")
    if {"density", "altitude"} <= have and table.entries["density"].units == SI["density"]:
        ratios = table.values("density") / atmosphere(table.in_si("altitude"), "density")
        share = float(np.median(ratios[np.isfinite(ratios)])) if np.any(np.isfinite(ratios)) else 1.0
        if not 1.0 / NOT_EARTHS < share < NOT_EARTHS:
            table.unsure.append(f"the planet: the density is {share:.2g} of the Earth's at its altitudes")


def _speed_like_push(table: ForeignTable) -> None:
    """Speed and axial accelerometer in units that agree: as named, else with those that gravity gave, else any.

    An altitude that rises by the path of the speed, or nearly, is in the same units of length.
    """
    time = table.in_si("time")
    pairs, reversed_sign = rules.speed_units(time, table.values("velocity"), table.values("ax"))
    named = (table.entries["velocity"].units, table.entries["ax"].units)
    if table.rest_s is not None:
        pairs = tuple(pair for pair in pairs if pair[1] == named[1])
    if not pairs:
        return
    speeds, pushes = named if named in pairs else pairs[0]
    table.sure("velocity", speeds, f"it changes as ax says, in {speeds} and {pushes}")
    table.sure("ax", pushes, f"it changes the speed, in {pushes} and {speeds}")
    if reversed_sign and table.tilt is None:
        table.change("ax", "against the speed", "the speed changes as if ax had the other sign")
    for name in ("ay", "az"):
        if name in table.entries and table.entries[name].units == named[1]:
            table.sure(name, pushes, f"as ax, in {pushes}")
    length = speeds.split("/")[0]
    if "altitude" in table.entries and length in ("m", "ft", "km"):
        path = cumulative_trapezoid(table.values("velocity"), time, initial=0)
        if 0.8 < abs(rules.slope(path, table.values("altitude"))) < 1.1:
            table.sure("altitude", length, f"it rises by the path of the speed, in {length}")


def _add(table: ForeignTable, other: ForeignTable) -> None:
    """What another file adds: properties of the vehicle; else channels that the main table lacks, on its own clock."""
    properties: dict[str, MapEntry] = {}
    for column in other.read.columns:
        name = rules.vehicle_property(column)
        if name is not None and name not in properties:
            properties[name] = replace(_named(column, VEHICLE_DIMENSIONS[name], other), why="by name")
    if properties:
        other.entries = {"time": other.entries["time"], **properties}
        table.vehicle = other
        return
    main, name = table.entries, other.recorder
    if "ax" in main and "ax" in other.entries:  # what the other sensed of ax, if it runs as that of the main table
        axial, entry = main["ax"].scale * table.values("ax"), other.entries["ax"]
        with suppress(UsageError):
            _, likeness = clock_offset(table.in_si("time"), axial, other.in_si("time"), other.values("ax"))
            other.align = replace(
                entry, scale=1.0, offset=0.0, why=f"{entry.why}; it runs as ax does, correlation {likeness:.3f}"
            )
    table.unsure += [f"{name}: {each}" for each in other.unsure if "no rest" not in each]
    if other.align is None:
        table.unsure.append(
            f"{name}: it has no acceleration along the axis that runs as ax does, which would put its clock on the "
            "main one: give its time an offset, if the two differ"
        )
    for channel in AIR:
        # Speed is better made of ax and altitude than taken from a recorder's own integral.
        derived = channel == "velocity" and {"ax", "altitude"} <= set(main)
        if channel in other.entries and channel not in main and not derived:
            entry = replace(other.entries[channel], recorder=name)
            if channel == "altitude" and abs(float(np.nanmedian(other.in_si("altitude")[:5]))) <= ABOVE_GROUND:
                doubt = "it begins at nought, above the ground: add the site's height above the sea as offset, in "
                entry = replace(entry, unsure=(*entry.unsure, doubt + entry.units))
            main[channel] = entry
    table.recorders.append(other)


def _count_from_liftoff(table: ForeignTable) -> None:
    """The main clock set to zero at lift-off, where a table of the vehicle counts from there and the log does not."""
    if table.vehicle is None or not set(ACCELEROMETERS) <= set(table.entries):
        return
    time, name = table.in_si("time"), table.vehicle.path.name
    if abs(time[0] - float(table.vehicle.in_si("time")[0])) < FAR:
        return
    burn = next((phase for phase in find_phases(time, *table.triad(ACCELEROMETERS)) if phase.name == "burn"), None)
    if burn is None:
        table.unsure.append(f"{name} counts time from another zero than the log: give its time an offset")
        return
    if table.rest_s is not None:
        table.rest_s = (table.rest_s[0] - burn.start_s, table.rest_s[1] - burn.start_s)
    reason = f"zero set to the ignition, found at {burn.start_s:.3f} s, from which {name} counts"
    offset = -burn.start_s / rules.sizes("time")[table.entries["time"].units]
    table.change("time", reason, "whether that table counts from ignition", offset=offset)


# ---- The map as commented YAML: `map.yaml.j2`, and what it needs ----


# What a property of the vehicle is, for whom its name does not say.
_OF_VEHICLE = {
    "ixx": "about the spin axis",
    "iyy": "about either transverse axis",
    "reference_length": "the one length of all moment coefficients: the diameter",
    "accelerometer_position": "from the centre of gravity, x to the nose",
}
_NO_POSITION = (
    "accelerometer_position: zeros are assumed; if it stays unknown, state its size as instruments/accel_position"
)
_GRADE = "instruments: their grade is taken as industrial; their accuracy decides what the record can show"


def _written(table: ForeignTable) -> Guess:
    """The map as text, with a comment for every line that rests on a guess."""
    vehicle = table.vehicle
    tables = [table, *table.recorders, *([vehicle] if vehicle else [])]
    channels = {name: table.entries[name] for name in (*CHANNEL_DIMENSIONS, *ATTITUDE) if name in table.entries}
    missing = _missing(channels)
    unknown = [name for name in VEHICLE_DIMENSIONS if vehicle is None or name not in vehicle.entries]
    said = [f"no table gives these properties of the vehicle: {', '.join(unknown)}", _NO_POSITION] if unknown else []
    unsure = [f"{name}: {doubt}" for name, entry in channels.items() for doubt in entry.unsure]

    rate = 1.0 / float(np.median(np.diff(table.in_si("time"))))

    def file_of(other: ForeignTable) -> str:
        """By its name where it lies beside the main table."""
        beside = other.path.resolve().parent == table.path.resolve().parent
        return _quoted(other.path.name if beside else str(other.path))

    loader = PackageLoader("brv_hypo.importing", "")
    templates = Environment(loader=loader, trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True)
    templates.filters |= {"one_line": one_line, "quoted": _quoted}
    text = templates.get_template("map.yaml.j2").render(
        main=table,
        tables=tables,
        vehicle=vehicle,
        channels=channels,
        missing=missing,
        properties={name: SI[dimension] for name, dimension in VEHICLE_DIMENSIONS.items()},
        meanings=_OF_VEHICLE,
        no_position=_NO_POSITION,
        ascends="velocity" not in channels and {"altitude", "ax"} <= set(channels),
        degrees=np.degrees,
        turned=bool(mounting_fault(table.in_si("time"), table.tilt)),
        rate=rate if rate > SLOWEST_FAST else None,
        unused=_unused(tables),
        flow=_flow,
        file_of=file_of,
    )
    return Guess(text, (*missing, *said, *table.unsure, *unsure, _GRADE))


def _flow(entry: MapEntry, more: str = "") -> str:
    """A column of the map, in one line."""
    recorder = f"recorder: {entry.recorder}, " if entry.recorder is not None else ""
    scale = f", scale: {entry.scale:g}" if entry.scale != 1.0 else ""
    offset = f", offset: {entry.offset:.10g}" if entry.offset != 0.0 else ""
    return f"{{{recorder}column: {_quoted(entry.column)}, units: {entry.units}{scale}{offset}{more}}}"


def _missing(channels: Collection[str]) -> list[str]:
    """What format 1 needs and no column was found for."""
    lacking = [f"no column was found for {name}" for name in INERTIAL_CHANNELS if name not in channels]
    if "velocity" not in channels and not {"altitude", "ax"} <= set(channels):
        lacking.append(
            "no column was found for velocity, and none for altitude, from which a climb would give it: if another "
            "recorder has one, name its file too"
        )
    if not {"dynamic_pressure", "density", "altitude"} & set(channels):
        lacking.append("no column was found for dynamic_pressure, density or altitude: one of them is needed")
    return lacking


def _unused(tables: Sequence[ForeignTable]) -> list[tuple[str, str, str]]:
    """The file, name and range of each column that the map does not use; the main table is the first."""
    main, unused = tables[0], []
    for table in tables:
        recorder = None if table is main else table.recorder
        used = {entry.column for entry in main.entries.values() if entry.recorder == recorder}
        if table is main.vehicle:
            used = {entry.column for entry in table.entries.values()}
        elif table is not main:
            used |= {table.entries["time"].column, *([table.align.column] if table.align else [])}
        place = "" if table is main else f"{one_line(table.path.name)}: "
        for name, values in table.read.columns.items():
            if name not in used:
                known = values[np.isfinite(values)]
                unused.append((place, name, f"{known.min():.4g} to {known.max():.4g}" if known.size else "empty"))
    return unused


def _quoted(text: str) -> str:
    """A scalar as YAML writes it in one line."""
    return yaml.safe_dump(text, default_style='"', width=10**6).strip()
