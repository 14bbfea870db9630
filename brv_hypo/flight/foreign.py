"""Foreign records (csv, parquet, mat) through a map (record_map.py): `bring_in`; `import_record` for the flight alone.

The order is fixed: columns become channels in SI; a second recorder's are put on the first one's clock; biases from
the pad are taken out; speed is derived; the record is brought to the rate that its motion needs; phases are found; the
window is cut; `assemble` does the rest. What was read stays as it was read beside all that, as the record's raw part.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.constants import ASCENT_KNOWN_SPEED
from brv_hypo.errors import UsageError
from brv_hypo.files.printed import one_line
from brv_hypo.flight.ascent import ascent
from brv_hypo.flight.assemble import assemble
from brv_hypo.flight.clocks import clock_offset
from brv_hypo.flight.decimate import decimated, needed_rate
from brv_hypo.flight.faults import RecordFault
from brv_hypo.flight.foreign_vehicle import instruments_of, vehicle_of
from brv_hypo.flight.pad import take_out_biases
from brv_hypo.flight.phases import Phase, find_phases
from brv_hypo.flight.record import Flight
from brv_hypo.flight.record_map import Alignment, ColumnMap, RecordMap, read_map
from brv_hypo.flight.refusal import naming
from brv_hypo.flight.schema import CHANNEL_DIMENSIONS, Record, check_shape, check_time, validated
from brv_hypo.flight.tables import Columns, RawTable, found_file, read_columns
from brv_hypo.flight.units import Dimension, to_si

Channels = dict[str, FloatArray]


@dataclass(frozen=True)
class Imported:
    """A foreign record: the flight, what it was made from, and the phases that it holds."""

    flight: Flight
    raw: tuple[RawTable, ...]
    phases: tuple[Phase, ...]


@dataclass(frozen=True)
class _Read:
    """Everything in SI on one clock, before anything is cut."""

    time: FloatArray
    channels: Channels
    notes: tuple[str, ...]
    tolerances: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)
    speed_sigma: FloatArray | None = None


def import_record(data: str | Path, map_path: str | Path) -> Flight:
    """The flight in a csv, parquet or mat file, read through the map at `map_path`; errors as of `bring_in`."""
    return bring_in(data, map_path).flight


def bring_in(data: str | Path, map_path: str | Path) -> Imported:
    """The record in a csv, parquet or mat file, read through the map at `map_path`.

    Raises UsageError (the map is unreadable, wrong, or names what the data do not have; a missing extra) and
    FlightRecordError (the data are unreadable or make no valid record).
    """
    source, mapping = Path(data), read_map(map_path)
    folders = (Path(map_path).parent, source.parent)
    tables: dict[str | None, Columns] = {None: _table(source, mapping, None)}
    for name, recorder in mapping.recorders.items():
        tables[name] = _table(found_file(recorder.file, folders), mapping, name)
    with naming(source):
        read = _derived(_rested(_on_one_clock(tables, mapping), mapping), mapping)
        record, faults, phases = _cut(read, mapping, source, folders)
    flight = assemble(record)
    raw = tuple(_raw(name, columns, mapping) for name, columns in tables.items())
    return Imported(replace(flight, faults=(*faults, *flight.faults)), raw, phases)


def _entries(mapping: RecordMap, name: str | None) -> list[ColumnMap | Alignment]:
    """What the map takes from one recorder; None is the main table."""
    entries: list[ColumnMap | Alignment] = [e for e in mapping.channels.values() if e.recorder == name]
    if name is not None:
        recorder = mapping.recorders[name]
        entries += [recorder.time, *([recorder.align] if recorder.align else [])]
    return entries


def _table(path: Path, mapping: RecordMap, name: str | None) -> Columns:
    """The columns of one recorder that the map names."""
    wanted = dict.fromkeys(entry.column for entry in _entries(mapping, name))
    return read_columns(path, tuple(wanted), mapping.delimiter)


def _raw(name: str | None, columns: Columns, mapping: RecordMap) -> RawTable:
    """A table as it was read, with what the map says of its units."""
    return RawTable(name or "main", columns, {entry.column: entry.units for entry in _entries(mapping, name)})


def _on_one_clock(tables: Mapping[str | None, Columns], mapping: RecordMap) -> _Read:
    """All channels on the stamps of the main table; NaN where another recorder has none."""
    channels = {
        name: _channel(tables[None][entry.column], entry, CHANNEL_DIMENSIONS[name], name)
        for name, entry in mapping.channels.items()
        if entry.recorder is None
    }
    time = channels.pop("time")
    notes: list[str] = []
    for name, recorder in mapping.recorders.items():
        columns = tables[name]
        clock = _channel(columns[recorder.time.column], recorder.time, "time", f"recorders/{name}/time")
        if recorder.align is not None:
            moved, note = _aligned(name, recorder.align, columns, clock, time, channels)
            clock, notes = clock + moved, [*notes, note]
        for channel, entry in mapping.channels.items():
            if entry.recorder == name:
                values = _channel(columns[entry.column], entry, CHANNEL_DIMENSIONS[channel], channel)
                channels[channel] = _interpolated(time, clock, values)
    check_time(time)
    for name, values in channels.items():
        check_shape(name, values, time.shape)
    return _Read(time, channels, tuple(notes))


def _aligned(
    name: str, align: Alignment, columns: Columns, clock: FloatArray, time: FloatArray, channels: Channels
) -> tuple[float, str]:
    """What is to be added to a second recorder's clock, s, and a note on it."""
    if align.to not in channels:
        raise UsageError(
            f"recorders/{name}/align/to: '{align.to}' is no channel of the main table, which has {', '.join(channels)}."
        )
    other = to_si(columns[align.column], align.units, CHANNEL_DIMENSIONS[align.to], f"recorders/{name}/align")
    moved, likeness = clock_offset(time, channels[align.to], clock, other)
    return moved, (
        f"clock of {one_line(name)}: {moved:+.4g} s to that of the main table, by its {one_line(align.column)} against "
        f"{align.to} (correlation {likeness:.3f})"
    )


def _channel(column: FloatArray, entry: ColumnMap, dimension: Dimension, name: str) -> FloatArray:
    """The mapped column in SI."""
    known = column if entry.missing is None else np.where(column == entry.missing, np.nan, column)
    return to_si(entry.scale * known + entry.offset, entry.units, dimension, name)


def _interpolated(time: FloatArray, clock: FloatArray, values: FloatArray) -> FloatArray:
    """`values` at `time`, along straight lines; NaN before and after them."""
    known = np.isfinite(values) & np.isfinite(clock)
    return np.interp(time, clock[known], values[known], left=np.nan, right=np.nan)


def _rested(read: _Read, mapping: RecordMap) -> _Read:
    """Less the biases that the pad shows."""
    if mapping.pad is None:
        return read
    found = take_out_biases(read.time, read.channels, mapping.pad)
    notes = (*read.notes, *found.notes)
    return replace(read, channels=found.channels, tolerances=found.tolerances, notes=notes)


def _derived(read: _Read, mapping: RecordMap) -> _Read:
    """With a speed, where the map asks for one; unknown where it is as good as rest."""
    if mapping.derive is None:
        return read
    missing = [name for name in ("ax", "altitude") if name not in read.channels]
    if missing:
        raise UsageError(f"derive/velocity: ascent needs the channel {missing[0]}. Map it.")
    found = ascent(read.time, read.channels["ax"], read.channels["altitude"])
    moving = found.velocity > ASCENT_KNOWN_SPEED * found.sigma
    speed = np.where(moving, found.velocity, np.nan)
    channels = {**read.channels, "velocity": speed, "altitude": found.altitude}
    return replace(read, channels=channels, speed_sigma=found.sigma, notes=(*read.notes, found.note))


def _cut(
    read: _Read, mapping: RecordMap, source: Path, folders: tuple[Path, ...]
) -> tuple[Record, tuple[RecordFault, ...], tuple[Phase, ...]]:
    """The record of what is to be analysed, faults masked on the way to its rate, and the phases of the whole."""
    phases = _phases(read)
    window = _window(mapping, phases, read.time)
    inside = (read.time >= window[0]) & (read.time <= window[1])
    kept = {name: values[inside] for name, values in read.channels.items()}
    sigma = None if read.speed_sigma is None else read.speed_sigma[inside]
    vehicle = vehicle_of(mapping, folders, window)
    record = validated(
        Record,
        {
            "time": read.time[inside],
            "channels": kept,
            "vehicle": vehicle.record,
            "instruments": instruments_of(mapping, read.tolerances, vehicle.inertia, kept, sigma),
            "planet": mapping.planet.strip().lower(),
            "title": one_line(mapping.title),
            "source": one_line(mapping.source or source.name),
            "path": str(source),
            "recorded_units": {name: entry.units for name, entry in mapping.channels.items()},
            "notes": (*read.notes, *vehicle.notes, *_told(mapping, window)),
        },
    )
    rate = needed_rate(record.time, record.channels) if mapping.rate == "auto" else mapping.rate
    if rate is None:
        return record, (), phases
    thinned = decimated(record, rate)
    return thinned.record, thinned.faults, phases


def _phases(read: _Read) -> tuple[Phase, ...]:
    known = read.channels
    if not {"ax", "ay", "az"} <= set(known):
        return ()
    return find_phases(read.time, known["ax"], known["ay"], known["az"])


def _window(mapping: RecordMap, phases: tuple[Phase, ...], time: FloatArray) -> tuple[float, float]:
    if mapping.window is None:
        return -np.inf, np.inf
    if not isinstance(mapping.window, str):
        return mapping.window
    phase = next((phase for phase in phases if phase.name == mapping.window), None)
    if phase is None:
        found = (
            ", ".join(f"{each.name} {each.start_s:.2f} to {each.stop_s:.2f} s" for each in phases) or "none"
        )
        raise UsageError(
            f"the map's window is '{mapping.window}', a phase that the record from {time[0]:.3f} to {time[-1]:.3f} s "
            f"does not show (it shows {found}). Give times instead: window: [start, stop]."
        )
    return phase.start_s, phase.stop_s


def _told(mapping: RecordMap, window: tuple[float, float]) -> tuple[str, ...]:
    if mapping.window is None:
        return ()
    name = f" ({mapping.window})" if isinstance(mapping.window, str) else ""
    return (f"window of the map{name}: {window[0]:.3f} to {window[1]:.3f} s",)
