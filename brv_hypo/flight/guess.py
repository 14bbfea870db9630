"""`guess_map`: a commented map for a foreign record, from the names of its columns and from physics.

Every entry says what it rests on; what is unsure is said in the map and listed beside it. Nothing is hidden: columns
that were not used stand at the end, with their ranges. Other files may go with the first: recorders with clocks of
their own, and tables of the vehicle (guess_others.py). The map's text is made in guess_text.py.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.errors import UsageError
from brv_hypo.files.printed import one_line
from brv_hypo.flight import guess_physics as physics
from brv_hypo.flight.guess_names import MAGNETOMETER, by_name
from brv_hypo.flight.guess_others import with_others
from brv_hypo.flight.guess_table import Entry, Table, numeric_table
from brv_hypo.flight.guess_text import Guess, written
from brv_hypo.flight.record import ACCELEROMETERS, GYROS
from brv_hypo.flight.schema import CHANNEL_DIMENSIONS
from brv_hypo.flight.units import SI

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


def _examined(path: Path) -> Table:
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


def _by_name(table: Table) -> dict[str, list[str]]:
    chosen, others = by_name(list(table.columns))
    for channel, named in chosen.items():
        if channel in MAGNETOMETER:
            table.entries[channel] = Entry(named.column, "", "by name")
            continue
        si = SI[CHANNEL_DIMENSIONS[channel]]
        told = "by name" if named.units is None else "by name, units in the name"
        doubt = () if named.units else (_nowhere_said(named.column, si),)
        table.entries[channel] = Entry(named.column, named.units or si, told, doubt)
    return others


def _nowhere_said(column: str, units: str) -> str:
    return f"units of {column} are {_NOWHERE}: {units} is a guess"


def _find_time(table: Table) -> None:
    """The column of time, and its units by the rate that they make."""
    rising = [name for name, values in table.columns.items() if physics.increasing(values)]
    entry = table.entries.get("time")
    if entry is None or entry.column not in rising:
        if not rising:
            raise UsageError(
                f"{table.path}: no column rises strictly from sample to sample, as time does (there are "
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
        doubt = tuple(each for each in entry.unsure if _NOWHERE not in each)
        table.entries["time"] = replace(
            entry, units=fitting[0], why=f"{entry.why}; {told}", unsure=(*doubt, *ambiguous)
        )


def _find_unnamed(table: Table) -> None:
    """Triads whose names say nothing: one that reads gravity at rest, and its neighbours in the table."""
    if "ax" in table.entries:
        return
    taken = {entry.column for entry in table.entries.values()}
    free = [name for name in table.columns if name not in taken]
    rest = physics.find_rest(table.seconds, [table.columns[name] for name in free])
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
        (ACCELEROMETERS, at),
        (GYROS, at - 3 if all(n in free for n in names[max(at - 3, 0) : at]) and at >= 3 else at + 3),
    )
    for channels, first in blocks:
        for channel, name in zip(channels, names[first : first + 3], strict=False):
            if name in free and channel not in table.entries:
                si = SI[CHANNEL_DIMENSIONS[channel]]
                table.entries[channel] = Entry(name, si, f"beside {up}, which reads gravity at rest", doubt)


def _stand_upright(table: Table, time: FloatArray) -> None:
    """Units of the accelerometers, and the axis that is up, from gravity at rest."""
    if not set(ACCELEROMETERS) <= set(table.entries):
        return
    known = [table.values(name) for name in (*ACCELEROMETERS, *GYROS) if name in table.entries]
    rest = physics.find_rest(time, known)
    if rest is None:
        doubt = "no rest in the record, at which gravity would tell units and axes of the accelerometers"
        table.unsure.append(doubt)
        return
    reads = np.array([np.mean(table.values(name)[rest.start : rest.stop]) for name in ACCELEROMETERS])
    norm = float(np.linalg.norm(reads))
    units = physics.gravity_units(norm)
    if units is None:
        table.unsure.append(
            f"at rest the accelerometers read {norm:.4g}, which is gravity in no units that are known"
        )
        return
    for name in ACCELEROMETERS:
        table.sure(name, units, f"at rest they read {norm:.4g}, gravity in {units}")
    table.rest_s = (float(time[rest.start]), float(time[rest.stop - 1]))
    _turn_nose_up(table, reads / norm)


def _turn_nose_up(table: Table, up: FloatArray) -> None:
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


def _units_of_gyros(table: Table, time: FloatArray) -> None:
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
    if any(_NOWHERE in doubt or "order of" in doubt for doubt in table.entries["p"].unsure):
        most = max(float(np.nanmax(np.abs(table.values(name)))) for name in GYROS)
        units = "deg/s" if most > physics.FASTEST_RADIANS else "rad/s"
        for name in GYROS:
            entry = table.entries[name]
            doubts = tuple(_nowhere_said(entry.column, units) if _NOWHERE in each else each for each in entry.unsure)
            table.entries[name] = replace(entry, unsure=doubts)
            table.change(name, f"{units} by range (up to {most:.3g})", units=units)


def _units_of_air(table: Table, time: FloatArray) -> None:
    """Units of speed, altitude and pressure against each other and the accelerometer."""
    have = set(table.entries)
    if {"velocity", "ax"} <= have:
        _speed_like_push(table, time)
    if {"dynamic_pressure", "density", "velocity"} <= have:
        speed = table.values("velocity") * physics.SPEEDS[table.entries["velocity"].units]
        units = physics.pressure_units(table.values("dynamic_pressure"), table.values("density"), speed)
        if units is not None:
            table.sure("dynamic_pressure", units, f"in {units} it is half of density times speed squared")
    if {"density", "altitude"} <= have:
        _density_like_earths(table)


def _density_like_earths(table: Table) -> None:
    """A doubt about the planet, where the density at the record's altitudes is none of the Earth's."""
    units = (table.entries["altitude"].units, table.entries["density"].units)
    if units[0] not in physics.LENGTHS or units[1] != "kg/m^3":
        return
    share = physics.density_share(physics.LENGTHS[units[0]] * table.values("altitude"), table.values("density"))
    if share is not None and not 1.0 / NOT_EARTHS < share < NOT_EARTHS:
        table.unsure.append(f"the planet: the density is {share:.2g} of the Earth's at its altitudes")


def _speed_like_push(table: Table, time: FloatArray) -> None:
    """Speed and axial accelerometer in units that agree: as named, else with those that gravity told, else any."""
    pairs = physics.speed_units(time, table.values("velocity"), table.values("ax"))
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


def _altitude_like_speed(table: Table, time: FloatArray) -> None:
    """An altitude that rises by the path of the speed, or nearly, is in the same units of length."""
    length = table.entries["velocity"].units.split("/")[0]
    if "altitude" in table.entries and length in ("m", "ft", "km"):
        factor = physics.climb_factor(time, table.values("altitude"), table.values("velocity"))
        if 0.8 < factor < 1.1:
            table.sure("altitude", length, f"it rises by the path of the speed, in {length}")
