"""What other files add to a guessed map: recorders with clocks of their own, and tables of the vehicle over time."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from brv_hypo.errors import UsageError
from brv_hypo.flight import guess_physics as physics
from brv_hypo.flight.clocks import clock_offset
from brv_hypo.flight.guess_names import vehicle_property, vehicle_units
from brv_hypo.flight.guess_table import Entry, Table
from brv_hypo.flight.guess_text import Guessed, OtherRecorder, VehicleTable
from brv_hypo.flight.phases import find_phases
from brv_hypo.flight.record import ACCELEROMETERS
from brv_hypo.flight.schema import VEHICLE_DIMENSIONS
from brv_hypo.flight.units import SI

AIR = ("altitude", "velocity", "dynamic_pressure", "density", "mach")  # what a second recorder may add
ABOVE_GROUND = 30.0  # m: an altitude that begins within this counts from the ground
FAR = 60.0  # s: clocks that begin further apart have another zero


def with_others(table: Table, others: Sequence[Table]) -> Guessed:
    """The main table with the channels, clocks and properties that `others` hold."""
    found = Guessed(table)
    for other in others:
        properties = _properties(other)
        vehicle = VehicleTable(other, properties)
        found = replace(found, vehicle=vehicle) if properties else _with_recorder(found, other)
    return _at_liftoff(found)


def _properties(table: Table) -> dict[str, Entry]:
    found = {}
    for column in table.columns:
        name = vehicle_property(column)
        if name is not None and name not in found:
            units = vehicle_units(column, VEHICLE_DIMENSIONS[name])
            si = SI[VEHICLE_DIMENSIONS[name]]
            doubt = () if units else (f"units of {column} are nowhere said: {si} is a guess",)
            found[name] = Entry(column, units or si, "by name", doubt)
    return found


def _with_recorder(found: Guessed, other: Table) -> Guessed:
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


def _alignment(main: Table, other: Table) -> Entry | None:
    if "ax" not in main.entries or "ax" not in other.entries:
        return None
    entry = other.entries["ax"]
    scale = main.entries["ax"].scale
    try:
        _, likeness = clock_offset(main.seconds, scale * main.values("ax"), other.seconds, other.values("ax"))
    except UsageError:
        return None
    return replace(entry, why=f"{entry.why}; it runs as ax does, correlation {likeness:.3f}")


def _from_sea(entry: Entry, table: Table) -> Entry:
    """A doubt about an altitude that begins at nought."""
    begins = float(np.nanmedian(table.columns[entry.column][:5])) * physics.LENGTHS.get(entry.units, 1.0)
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
        physics.ACCELERATIONS[table.entries[name].units] * table.entries[name].scale for name in ACCELEROMETERS
    ]
    forces = [size * table.values(name) for size, name in zip(sizes, ACCELEROMETERS, strict=True)]
    burn = next((phase for phase in find_phases(time, *forces) if phase.name == "burn"), None)
    if burn is None:
        doubt = f"{found.vehicle.table.path.name} counts time from another zero than the log: give its time an offset"
        return replace(found, unsure=(*found.unsure, doubt))
    zero = burn.start_s
    size = physics.TIMES.get(table.entries["time"].units, 60.0)
    told = f"zero set to the ignition, found at {zero:.3f} s, from which {found.vehicle.table.path.name} counts"
    table.change("time", told, "whether that table counts from ignition", offset=-zero / size)
    return replace(found, zero_s=zero)
