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

from brv_hypo import thresholds as limits
from brv_hypo.arrays import FloatArray
from brv_hypo.errors import UsageError
from brv_hypo.flight import plausibility as physics
from brv_hypo.flight.derived import atmosphere
from brv_hypo.flight.inspection import find_phases
from brv_hypo.flight.record import ACCELEROMETERS, CHANNEL_DIMENSIONS, GYROS, INERTIAL_CHANNELS, VEHICLE_DIMENSIONS
from brv_hypo.flight.units import SI, Dimension
from brv_hypo.importing import guess_rules as rules
from brv_hypo.importing.formats import clock_fault, read_all
from brv_hypo.importing.guess_rules import ForeignTable, MapEntry, stated_units
from brv_hypo.importing.rocket_log import ATTITUDE, PAD_FEWEST_SAMPLES, clock_offset
from brv_hypo.io.text import one_line

NOT_EARTHS = 2.0  # factor between a density and the Earth's at its altitude from which the planet is in doubt
AIR = ("altitude", "velocity", "dynamic_pressure", "density", "mach")  # what a second recorder may add
ABOVE_GROUND = 30.0  # m: an altitude that begins within this counts from the ground
FAR = 60.0  # s: clocks that begin further apart have another zero
SLOWEST_FAST = 100.0  # Hz: beyond, a log of many samples is offered decimation; as it is its noise is known better
MANY_SAMPLES = 5000  # with which a comparison takes some ten seconds
_NOT_STATED = "not stated"  # in a doubt of units


@dataclass(frozen=True)
class Guess:
    """The map as YAML text, and what it is unsure of."""

    text: str
    unsure: tuple[str, ...]


def guess_map(data: str | Path, *others: str | Path) -> Guess:
    """A map for the csv, parquet or mat file `data`, and `others` recorded beside it; UsageError without any time."""
    main = _examined(Path(data))
    main.entries = {name: entry for name, entry in main.entries.items() if name not in VEHICLE_DIMENSIONS}
    for other in others:
        _add(main, _examined(Path(other)))
    _judged(main)
    _count_from_liftoff(main)
    return _written(main)


def _examined(path: Path) -> ForeignTable:
    table = ForeignTable(path, read_all(path))
    known = [name for name, values in table.read.columns.items() if np.any(np.isfinite(values))]
    chosen, others = rules.by_name(known)
    for channel, column in chosen.items():
        dimension = {**CHANNEL_DIMENSIONS, **ATTITUDE, **VEHICLE_DIMENSIONS}.get(channel)
        entry = _named(column, dimension, table) if dimension else MapEntry(column, "", "by name")
        scale, doubts = rules.sense(channel, column)
        table.entries[channel] = replace(entry, scale=scale, unsure=(*entry.unsure, *doubts))
    _find_time(table)
    _by_gravity(table)
    _by_range(table)
    if set(INERTIAL_CHANNELS) <= set(table.entries):
        forces = np.stack([table.in_si(name) for name in ACCELEROMETERS])
        table.tilt = physics.nose_axis(table.in_si("time"), np.zeros_like(forces), forces)
    for channel, names in others.items():
        if names and channel in table.entries:
            table.change(channel, "the likeliest name", f"{', '.join(names)} may be {channel} as well")
    return table


def _named(column: str, dimension: Dimension, table: ForeignTable) -> MapEntry:
    """A column that its name gives to a channel or property, in the units of the table or its name, or SI."""
    if units := stated_units(column, table.read, dimension):
        return MapEntry(column, units, "by name, units in the name")
    doubt = f"units of {column} are {_NOT_STATED}: {SI[dimension]} is a guess"
    return MapEntry(column, SI[dimension], "by name", (doubt,))


def _sure(table: ForeignTable, channel: str, units: str, why: str) -> None:
    """Units by physics, which override those of a name."""
    entry = table.entries[channel]
    doubts = [each for each in entry.unsure if _NOT_STATED not in each]
    if len(doubts) == len(entry.unsure) and units != entry.units:
        doubts.append(f"its name says {entry.units}, {why}")
    table.change(channel, why, units=units, unsure=tuple(doubts))


def _find_time(table: ForeignTable) -> None:
    """The column of time, and its units by the rate that they make."""
    columns = table.read.columns.items()  # a difference that is not known is not above zero
    rising = [name for name, values in columns if values.size > 1 and np.all(np.diff(values) > 0.0)]
    entry = table.entries.get("time")
    if entry is None or entry.column not in rising:
        if not rising:
            raise UsageError(f"{table.path}: {_no_clock(table)}")
        used = {each.column for channel, each in table.entries.items() if channel != "time"}
        first = next((name for name in rising if name not in used), rising[0])
        entry = MapEntry(first, "s", "the first column that rises throughout", ("whether this is time",))
        table.entries["time"] = entry
    step, (least, most) = float(np.median(np.diff(table.values("time")))), rules.RATES
    possible = [unit for unit, size in rules.sizes("time").items() if least <= 1.0 / (step * size) <= most]
    fitting = [unit for unit in possible if unit not in rules.STATED_ONLY]
    if fitting and (entry.units not in possible or "units in the name" not in entry.why):
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
        "without time, or vehicle data, which are entered in the map by hand. Remedy: add a column of sample times."
    )


def _by_gravity(table: ForeignTable) -> None:
    """Units of the accelerometers, and the pad, from gravity at rest."""
    if not set(ACCELEROMETERS) <= set(table.entries):
        return
    time = table.in_si("time")
    rest = rules.find_rest(time, [table.values(name) for name in INERTIAL_CHANNELS if name in table.entries])
    if rest is None:
        if not any(_NOT_STATED in doubt for name in ACCELEROMETERS for doubt in table.entries[name].unsure):
            return
        table.unsure.append("no rest in the record, at which gravity would tell units of the accelerometers")
        return
    norm = float(np.linalg.norm([np.mean(table.values(name)[:rest]) for name in ACCELEROMETERS]))
    units = rules.units_of_gravity(norm)
    if units is None:
        table.unsure.append(f"at rest the accelerometers read {norm:.4g}, which is gravity in no units that are known")
        return
    for name in ACCELEROMETERS:
        _sure(table, name, units, f"at rest they read {norm:.4g}, gravity in {units}")
    if rest >= PAD_FEWEST_SAMPLES:
        table.rest_s = (float(time[0]), float(time[rest - 1]))


def _by_range(table: ForeignTable) -> None:
    """Units of gyros that nothing states: deg/s where their range is none in rad/s."""
    doubtful = [n for n in GYROS if n in table.entries and any(_NOT_STATED in each for each in table.entries[n].unsure)]
    most = max((float(np.nanmax(np.abs(table.values(name)))) for name in doubtful), default=0.0)
    for name in doubtful if most > rules.FASTEST_RADIANS else ():
        doubt = f"units of {table.entries[name].column} are {_NOT_STATED}: deg/s is a guess"
        table.change(name, f"deg/s by range (up to {most:.3g})", units="deg/s", unsure=(doubt,))


def _judged(table: ForeignTable) -> None:
    """Doubts where the channels, as they are guessed, break the physics of any vehicle: as on import."""
    known = [n for n in CHANNEL_DIMENSIONS if n in table.entries and np.any(np.isfinite(table.values(n)))]
    if set(ACCELEROMETERS) <= set(known):
        _by_burn(table, known)
    channels = {name: table.in_si(name) for name in known}
    time = channels.pop("time")
    if set(INERTIAL_CHANNELS) <= set(channels):
        sizes, own = rules.sizes("angular rate"), {name: table.entries[name].units for name in GYROS}
        rates = np.stack([channels[name] for name in GYROS]) / sizes[own["q"]]
        forces = np.stack([channels[name] for name in ACCELEROMETERS])
        turn, air = (np.eye(3), physics.air_of(channels)) if table.tilt is None else (table.tilt.matrix, None)
        found = physics.relative_axes(time, turn @ rates, turn @ forces, sizes, air)
        if not (sure := physics.is_sure(found)) and table.tilt is None and air is None:
            table.unsure.append(
                "signs and axes of gyros and accelerometers were not checked: thrust, or speed and air data in the "
                "same file, would show them"
            )
        elif not sure:
            table.unsure.append("signs and axes of the gyros: the forces do not show them, and they are taken as named")
        else:
            _, units, turned = found[0]
            said = f"the forces across the axis follow from the rates in {units}"
            for name in GYROS:
                _sure(table, name, own[name] if units == own["q"] else units, said)
            if words := physics.as_turned(GYROS, turned):
                table.unsure.append(f"gyros: {said} as if {words}")
    table.unsure += [f"{fault.channel}: {fault.action}" for fault in physics.contradictions(time, channels)]
    if {"density", "altitude"} <= set(channels):
        share = float(np.nanmedian(channels["density"] / atmosphere(channels["altitude"], "density")))
        if not 1.0 / NOT_EARTHS < share < NOT_EARTHS:
            table.unsure.append(f"the planet: the density is {share:.2g} of the Earth's at its altitudes")


def _by_burn(table: ForeignTable, known: Collection[str]) -> None:
    """Units of speed and altitude by what the thrust gains, as far as import would contradict those of their names."""
    forces = np.stack([table.in_si(name) for name in ACCELEROMETERS])
    recorded = {name: table.in_si(name) for name in ("velocity", "altitude") if name in known}
    for name, (rise, made) in physics.gains(table.in_si("time"), forces, recorded).items():
        sizes, own = rules.sizes(CHANNEL_DIMENSIONS[name]), table.entries[name].units
        shares = {unit: rise / made * size / sizes[own] for unit, size in sizes.items()}
        fitting = [unit for unit, share in shares.items() if limits.GAIN_WITHIN[0] < share < limits.GAIN_WITHIN[1]]
        if fitting:
            likely = own if own in fitting else min(fitting, key=lambda unit: abs(np.log(shares[unit])))
            made_si = f"{made:.3g} {SI[CHANNEL_DIMENSIONS[name]]}"
            _sure(table, name, likely, f"in {likely} it gains in the burn what the forces make, {made_si}, or nearly")


def _add(table: ForeignTable, other: ForeignTable) -> None:
    """What another file adds: properties of the vehicle; else channels that the main table lacks, on its own clock."""
    properties = {name: entry for name, entry in other.entries.items() if name in VEHICLE_DIMENSIONS}
    if properties:
        other.entries = {"time": other.entries["time"], **properties}
        table.vehicle = other
        return
    main, name, clock = table.entries, other.recorder, other.in_si("time")
    if table.axial in main and "ax" in other.entries:  # what the other sensed, if it runs as that of the main table
        time, axial = table.in_si("time"), table.in_si(table.axial)
        with suppress(UsageError):
            moved, likeness = clock_offset(time, axial, clock, other.values("ax"))
            clock = clock + moved
            sensed, reads = np.interp(clock, time, axial, np.nan, np.nan), other.values("ax")
            both = np.isfinite(sensed + reads)
            slope = np.polyfit(sensed[both], reads[both], 1)[0]
            units = rules.units_of_gravity(physics.GRAVITY * slope)
            if units is not None:
                _sure(other, "ax", units, f"it reads {slope:.3g} for each m/s^2 of {table.axial}: it is in {units}")
            other.change("ax", f"it runs as {table.axial} does, correlation {likeness:.3f}")
            other.align = other.entries["ax"]
    table.unsure += [f"{name}: {each}" for each in other.unsure if "no rest" not in each]
    if other.align is None:
        table.unsure.append(
            f"{name}: it has no acceleration along the axis that runs as ax does, which would put its clock on the "
            "main one: give its time an offset, if the two differ"
        )
    for channel in AIR:
        # Speed in a climb is better made of ax and altitude than taken from a recorder's own integral.
        derived = channel == "velocity" and {"ax", "altitude"} <= set(main) and _rises(table.values("altitude"))
        if channel in other.entries and channel not in main and not derived:
            main[channel] = replace(other.entries[channel], recorder=name)
            table.joined[channel] = np.interp(table.in_si("time"), clock, other.values(channel), np.nan, np.nan)
            if channel == "altitude" and abs(float(np.nanmedian(other.in_si("altitude")[:5]))) <= ABOVE_GROUND:
                doubt = "it begins at nought, above the ground: add the site's height above the sea as offset"
                table.change(channel, "it begins at nought", doubt)
    table.recorders.append(other)


def _count_from_liftoff(table: ForeignTable) -> None:
    """The main clock set to zero at lift-off, where a table of the vehicle counts from there and the log does not."""
    if table.vehicle is None or not set(ACCELEROMETERS) <= set(table.entries):
        return
    time, name = table.in_si("time"), table.vehicle.path.name
    if abs(time[0] - float(table.vehicle.in_si("time")[0])) < FAR:
        return
    burn = next((phase for phase in find_phases(time, *map(table.in_si, ACCELEROMETERS)) if phase.name == "burn"), None)
    if burn is None:
        table.unsure.append(f"{name} counts time from another zero than the log: give its time an offset")
        return
    if table.rest_s is not None:
        table.rest_s = (table.rest_s[0] - burn.start_s, table.rest_s[1] - burn.start_s)
    reason = f"zero set to the ignition, found at {burn.start_s:.3f} s, from which {name} counts"
    offset = -burn.start_s / rules.sizes("time")[table.entries["time"].units]
    table.change("time", reason, "whether that table counts from ignition", offset=offset)


# ---- The map as commented YAML: `map.yaml.j2`, and what it needs ----


# What a channel counts, and what a property of the vehicle is, for whom its name does not say.
_MEANINGS = {
    "p": "positive: right side down",
    "q": "positive: nose up",
    "r": "positive: nose right",
    "ax": "positive: to the nose, in drag below zero",
    "ay": "positive: to the right",
    "az": "positive: down",
    "ixx": "about the spin axis",
    "iyy": "about either transverse axis",
    "reference_length": "the one length of all moment coefficients: the diameter",
    "accelerometer_position": "from the centre of gravity, x to the nose",
}


def _written(table: ForeignTable) -> Guess:
    """The map as text, with a comment for every line that rests on a guess."""
    tables = [table, *table.recorders, *([table.vehicle] if table.vehicle else [])]
    channels = {name: table.entries[name] for name in (*CHANNEL_DIMENSIONS, *ATTITUDE) if name in table.entries}
    climbs = {"altitude", "ax"} <= set(channels) and _rises(table.values("altitude"))
    missing = _missing(channels, climbs)
    vehicle = {n: e for n, e in table.vehicle.entries.items() if n in VEHICLE_DIMENSIONS} if table.vehicle else {}
    unknown = [name for name in VEHICLE_DIMENSIONS if name not in vehicle]
    no_position = "accelerometer_position: unknown while zeros; if so, state its size as instruments/accel_position"
    said = [f"no table gives these properties of the vehicle: {', '.join(unknown)}", no_position]
    unsure = [f"{name}: {doubt}" for name, entry in {**channels, **vehicle}.items() for doubt in entry.unsure]
    unsure.append("instruments: industrial is assumed, for pressure, wind and inertia too: it sets all errors")
    time = table.in_si("time")
    rate = 1.0 / float(np.median(np.diff(time)))

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
        channels=channels,
        vehicle=vehicle,
        missing=missing,
        properties={name: SI[dimension] for name, dimension in VEHICLE_DIMENSIONS.items()},
        meanings=_MEANINGS,
        no_position=no_position,
        ascends="velocity" not in channels and climbs,
        degrees=np.degrees,
        turned=bool(physics.mounting_fault(time, table.tilt)),
        rate=rate if rate > SLOWEST_FAST and time.size > MANY_SAMPLES else None,
        unused=_unused(tables),
        flow=_flow,
        file_of=file_of,
    )
    return Guess(text, (*missing, *said, *table.unsure, *unsure))


def _flow(entry: MapEntry, more: str = "") -> str:
    """A column of the map, in one line."""
    recorder = f"recorder: {entry.recorder}, " if entry.recorder is not None else ""
    scale = f", scale: {entry.scale}" if entry.scale != 1 else ""
    offset = f", offset: {entry.offset:.10g}" if entry.offset != 0.0 else ""
    return f"{{{recorder}column: {_quoted(entry.column)}, units: {entry.units}{scale}{offset}{more}}}"


def _rises(altitude: FloatArray) -> bool:
    """Whether a vehicle climbs in the record, as the derivation of its speed from altitude needs."""
    known = altitude[np.isfinite(altitude)]
    return known.size > 0 and known.max() - known[0] > 0.5 * np.ptp(known)


def _missing(channels: Collection[str], climbs: bool) -> list[str]:
    """What format 1 needs and no column was found for."""
    lacking = [*(name for name in INERTIAL_CHANNELS if name not in channels)]
    if "velocity" not in channels and not climbs:
        no = "the altitude of no climb" if "altitude" in channels else "none for altitude"
        lacking.append(
            f"velocity, and {no}, from which a climb would give it: enter one that is not used, or name another "
            "recorder's file too"
        )
    if not {"dynamic_pressure", "density", "altitude"} & set(channels):
        lacking.append("dynamic_pressure, density or altitude: one of them is needed")
    return [f"no column was found for {each}" for each in lacking]


def _unused(tables: Sequence[ForeignTable]) -> list[tuple[str, str, str]]:
    """The file, name and range of each column that the map does not use; the main table is the first."""
    main, unused = tables[0], []
    for table in tables:
        recorder = None if table is main else table.recorder
        entries = [entry for entry in main.entries.values() if entry.recorder == recorder]
        if table is main.vehicle:
            entries = [*table.entries.values()]
        elif table is not main:
            entries += [table.entries["time"], *([table.align] if table.align else [])]
        used, place = {entry.column for entry in entries}, "" if table is main else f"{one_line(table.path.name)}: "
        for name, values in table.read.columns.items():
            if name not in used:
                known = values[np.isfinite(values)]
                unused.append((place, name, f"{known.min():.4g} to {known.max():.4g}" if known.size else "empty"))
    return unused


def _quoted(text: str) -> str:
    """A scalar as YAML writes it in one line."""
    return yaml.safe_dump(text, default_style='"', width=10**6).strip()
