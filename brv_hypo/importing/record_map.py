"""MAP.yaml: what a foreign record's columns are, what is done with them, and the flight that is made of them.

A value is `scale * column + offset`, in `units`, and NaN where the column holds `missing`. `RecordMap` lists the keys,
`brv-hypo docs record` says what each means, `configs/maps` has a whole map. Columns of a mat file that lie in a struct
are called `struct.field`. Files are named relative to the map's folder, or to that of the data.

Entrances: `read_map`; `bring_in`, and `import_record` for the flight alone. Their order: all recorders on one clock;
axes turned; biases from the pad removed; speed derived; phases found and the window cut, with the vehicle and its
tolerances over it; faults masked on the way to the rate that the motion needs.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, BaseModel, ConfigDict, Discriminator, Field, Tag, ValidationError
from scipy.spatial.transform import Rotation

from brv_hypo.arrays import FloatArray
from brv_hypo.errors import FlightRecordError, UsageError
from brv_hypo.flight.format import assemble
from brv_hypo.flight.inspection import Phase, PhaseName, find_phases, held_or_rounded
from brv_hypo.flight.plausibility import ARM_OFF, Tilt, air_of, contradictions, gyro_fault, mounting_fault, nose_axis
from brv_hypo.flight.record import (
    ACCELEROMETERS,
    CHANNEL_DIMENSIONS,
    GYROS,
    INERTIAL_CHANNELS,
    VEHICLE_DIMENSIONS,
    Channels,
    Flight,
    Record,
    RecordFault,
    Vehicle,
    check_shape,
    check_time,
    checked_vehicle,
    complaints,
    validated,
)
from brv_hypo.flight.tolerances import DEFAULT_GRADE, Instruments, of_grade, tolerances_of, with_stated
from brv_hypo.flight.units import EXAMPLES, Dimension, to_si
from brv_hypo.importing import rocket_log
from brv_hypo.importing.formats import Layout, clock_fault, found_file, nearest, read_columns
from brv_hypo.importing.guess_rules import stated_units
from brv_hypo.importing.rocket_log import ATTITUDE
from brv_hypo.io.binary import ColumnTable
from brv_hypo.io.mappings import read_yaml
from brv_hypo.io.text import naming, one_line, refusal

OF_UNIT = " of unit "  # between the name of a channel and the number of a further unit
ASCENT_KNOWN_SPEED = 3.0  # sigmas: a derived speed below so many is unknown
STEADY_PROPERTY = 0.002  # relative change of a mass property over the window, below which it counts as constant
DENSITY_OF_THE_DAY = 0.03  # 1-sigma, relative, about a standard atmosphere below 20 km


def _in_order(span: tuple[float, float]) -> tuple[float, float]:
    if not span[0] < span[1]:
        raise ValueError("a start before its stop")
    return span


Row = tuple[float, float, float]
Rows = tuple[Row, Row, Row]
Span = Annotated[tuple[float, float], AfterValidator(_in_order)]


def _rotation(entry: str | Rows | None) -> Any:
    """`auto`, or the rows of named turns, in degrees, or those that are given."""
    if entry is None or entry == "auto":
        return entry
    matrix = np.eye(3)
    try:
        for turn in entry.split(",") if isinstance(entry, str) else ():
            axis, angle = turn.split()
            matrix = matrix @ Rotation.from_euler(axis, float(angle), degrees=True).as_matrix()
    except ValueError:
        raise ValueError('auto, three rows, or turns in degrees such as "x 45, z -3"') from None
    matrix = matrix if isinstance(entry, str) else np.array(entry)
    if not np.allclose(matrix @ matrix.T, np.eye(3), atol=1e-3) or np.linalg.det(matrix) < 0.0:
        raise ValueError("a rotation: rows of length 1, perpendicular and right-handed (a scale of -1 mirrors)")
    return tuple(map(tuple, matrix.tolist()))


class _Entry(BaseModel):
    model_config = ConfigDict(extra="forbid")


class ColumnMap(_Entry):
    """Where a channel comes from: `scale * column + offset`, in `units`."""

    column: str
    units: str | None = None  # None: those that the table states, in a row of its own or in the column's name
    scale: float = 1.0
    offset: float = 0.0
    missing: float | None = None  # the value that marks a missing sample
    recorder: str | None = None  # the recorder of the column; None is the main table


class Alignment(_Entry):
    """What a second recorder sensed of channel `to`; a constant difference between the two does not matter."""

    column: str
    units: str
    to: str = "ax"


class Recorder(Layout):
    """Another file, or rows of the same by `where`, and the clock that it has."""

    file: str
    time: ColumnMap
    align: Alignment | None = None


class VehicleValue(_Entry):
    """A property of the vehicle, with its units."""

    value: float | tuple[float, float, float]
    units: str


class VehicleColumn(_Entry):
    """A property of the vehicle from a table over time: its mean over what is kept of the record."""

    file: str
    column: str
    units: str
    time: ColumnMap


VehicleEntry = Annotated[
    Annotated[VehicleValue, Tag("value")] | Annotated[VehicleColumn, Tag("column")],
    # Which of the two it is, so that one complaint is made of it and not both.
    Discriminator(lambda entry: "column" if isinstance(entry, dict) and {"file", "column"} & set(entry) else "value"),
]


class RecordMap(Layout):
    """MAP.yaml; the layout is that of the main table."""

    channels: dict[str, ColumnMap]
    vehicle: dict[str, VehicleEntry]
    recorders: dict[str, Recorder] = Field({})  # other files, each with a clock of its own
    beside: list[dict[str, ColumnMap]] = Field([])  # gyros and accelerometers of further units
    instruments: dict[str, Any] = Field({})  # grade and tolerances
    # From what gyros and accelerometers read to body axes: "auto" is found from thrust, drag and spin.
    rotation: Annotated[str | Rows | None, AfterValidator(_rotation)] = None
    pad: Span | None = None  # times between which the vehicle is at rest, nose up, s
    derive: dict[Literal["velocity"], Literal["ascent"]] = Field({})  # from ax and altitude, on a steep climb
    window: PhaseName | Span | None = None  # what is kept: a phase that is found, or times in s
    rate: Literal["auto"] | Annotated[float, Field(gt=0.0)] | None = None  # Hz; "auto" is what the motion needs
    planet: str = "earth"
    title: str = ""
    source: str = ""


def read_map(path: str | Path | Mapping[str, Any]) -> RecordMap:
    """The validated map, or that at a path. Raises UsageError, naming the entry that is wrong."""
    file = "given" if isinstance(path, Mapping) else str(path)
    content = path if isinstance(path, Mapping) else read_yaml(path, "a map with the keys channels and vehicle")
    # A guessed map has null for what no table gives.
    vehicle = content.get("vehicle")
    entries = vehicle.items() if isinstance(vehicle, dict) else ()
    empty = [str(name) for name, entry in entries if isinstance(entry, dict) and entry.get("value", 0) is None]
    if empty:
        raise UsageError(
            f"the map {file} has no value yet for vehicle/{', vehicle/'.join(empty)}: fill in what is null. The shape "
            "of the moments needs the ratio of the inertias alone; their size needs all of them."
        )
    try:
        mapping = RecordMap.model_validate(content)
    except ValidationError as error:
        raise UsageError(f"the map {file}: {complaints(error, '', 'the description of the map')}") from error
    for number, unit in enumerate(mapping.beside, 2):
        mapping.channels |= {f"{name}{OF_UNIT}{number}": entry for name, entry in unit.items()}
    parts: list[tuple[str, Collection[str], Collection[str]]] = [
        ("channels", [name for name in mapping.channels if OF_UNIT not in name], [*CHANNEL_DIMENSIONS, *ATTITUDE]),
        *((f"beside/{k}", unit, INERTIAL_CHANNELS) for k, unit in enumerate(mapping.beside)),
        ("vehicle", mapping.vehicle, VEHICLE_DIMENSIONS),
    ]
    for group, name, known in ((group, name, known) for group, names, known in parts for name in names):
        if name not in known:
            found = f"'{group}/{name}' is not part of format 1{nearest(name, known)}"
            raise UsageError(f"the map {file}: {found}. It has {', '.join(known)}.")
    if "time" not in mapping.channels:
        raise UsageError(f"the map {file} has no channels/time. Map the column that holds the sample times.")
    for name, entry in mapping.channels.items():
        if entry.recorder is not None and entry.recorder not in mapping.recorders:
            raise UsageError(
                f"the map {file}: channels/{name} comes from the recorder '{entry.recorder}', which recorders does "
                f"not describe{nearest(entry.recorder, mapping.recorders)}. Give its file and its time."
            )
    return mapping


def vehicle_of(
    mapping: RecordMap, raw: Mapping[str | None, ColumnTable], window: tuple[float, float]
) -> tuple[Vehicle, float, list[str]]:
    """The map's vehicle, half the relative range of its inertias over `window` s (0: constant), and notes. `raw` has
    the tables of `bring_in`. Raises UsageError where a table holds nothing in the window, FlightRecordError.
    """
    values: dict[str, Any] = {}
    changes, notes = 0.0, []
    for name, entry in mapping.vehicle.items():
        place = f"vehicle/{name}"
        if isinstance(entry, VehicleValue):
            values[name] = to_si(entry.value, entry.units, VEHICLE_DIMENSIONS[name], place).tolist()
            continue
        table = raw[place]
        clock = _with_units(entry.time, table, "time", f"{place}/time")
        time = _channel(table.columns[clock.column], clock, "time", f"{place}/time")
        held = to_si(table.columns[entry.column], entry.units, VEHICLE_DIMENSIONS[name], place)
        held = held[(time >= window[0]) & (time <= window[1]) & np.isfinite(held)]
        if not held.size:
            raise UsageError(
                f"{place}: {entry.file} has no value of {entry.column} from {window[0]:.3g} to {window[1]:.3g} s. "
                "Likely cause: another zero of time. Remedy: correct the offset of its time, or give a value."
            )
        values[name] = float(np.mean(held))
        change = 0.5 * float(np.ptp(held)) / (abs(values[name]) or 1.0)
        changes = max(changes, 0.0 if name == "mass" else change)
        said = f", which changes by ±{100.0 * change:.2g} % in the window" if change > STEADY_PROPERTY else ""
        notes.append(f"{place} {values[name]:.5g} from {entry.file}{said}")
    return checked_vehicle(values), changes, notes


def instruments_of(
    mapping: RecordMap,
    estimated: Mapping[str, Any],
    inertia: float,
    channels: Mapping[str, FloatArray],
    speed_sigma: FloatArray | None,
) -> Instruments:
    """Tolerances: of the map's grade, then what pad, mounting, table and speed show, then what the map states.
    `inertia` is relative, of `vehicle_of`; `speed_sigma` (n,) m/s of a derived speed, None for a measured one.
    """
    grade = of_grade(str(mapping.instruments.get("grade", DEFAULT_GRADE)))
    shown: dict[str, Any] = dict(estimated)
    for key in {"gyro_misalignment", "accel_misalignment"} & set(shown):
        shown[key] = float(np.hypot(shown[key], getattr(grade, key)[0]))
    if inertia > STEADY_PROPERTY:
        shown |= {"inertia": float(np.hypot(inertia, grade.inertia[0]))}
    # Relative, of a dynamic pressure that is made of speed and a standard atmosphere.
    pressure = 0.0 if {"density", "dynamic_pressure"} & set(channels) else DENSITY_OF_THE_DAY
    if speed_sigma is not None and "dynamic_pressure" not in channels:
        pressure = float(np.hypot(pressure, 2.0 * np.nanmedian(speed_sigma / channels["velocity"])))
    if pressure > grade.dynamic_pressure_scale[0]:
        shown |= {"dynamic_pressure_scale": pressure}
    stated = {key: value for key, value in mapping.instruments.items() if key != "grade"}
    return tolerances_of(stated, with_stated(grade, shown), "the map's instruments")


@dataclass(frozen=True)
class Imported:
    """A foreign record: the flight that was made of it, and the phases that it holds."""

    flight: Flight
    phases: tuple[Phase, ...]


def import_record(data: str | Path, map_path: str | Path | Mapping[str, Any]) -> Flight:
    """The flight in a csv, parquet or mat file, read through a map, or the one at a path; errors as of `bring_in`."""
    return bring_in(data, map_path).flight


def bring_in(data: str | Path, map_path: str | Path | Mapping[str, Any]) -> Imported:
    """The record in a csv, parquet or mat file by a map, or at a path. Raises UsageError (the map is unreadable, wrong,
    or names what the data do not have; a missing extra) and FlightRecordError (the data make no record).
    """
    source, mapping = Path(data), read_map(map_path)
    folders = (source if isinstance(map_path, Mapping) else Path(map_path)).parent, source.parent
    raw: dict[str | None, ColumnTable] = {}
    zero, notes = None, list[str]()
    for name, recorder in ((None, None), *mapping.recorders.items()):
        path = source if recorder is None else found_file(recorder.file, folders)
        channels = {key: entry for key, entry in mapping.channels.items() if entry.recorder == name}
        clocks = [] if recorder is None else [each for each in (recorder.time, recorder.align) if each is not None]
        columns = tuple(each.column for each in (*channels.values(), *clocks))
        table = raw[name] = read_columns(path, columns, recorder or mapping, zero)
        zero = table.zero if zero is None else zero
        for key, entry in channels.items():
            mapping.channels[key] = _with_units(entry, table, _dimension(key), f"channels/{key}")
        clock = mapping.channels["time"]
        if recorder is not None:
            clock = recorder.time = _with_units(recorder.time, table, "time", f"recorders/{name}/time")
        if (fault := clock_fault(table, clock.column)) is not None:
            raise FlightRecordError(f"{path}: {fault}")
        notes += table.notes
    for name, held in mapping.vehicle.items():
        if isinstance(held, VehicleColumn):
            path = found_file(held.file, folders)
            raw[f"vehicle/{name}"] = read_columns(path, (held.time.column, held.column), zero=zero)
    with naming(source):
        record, faults, phases = _record(raw, mapping, source, notes)
    flight = assemble(record)
    return Imported(replace(flight, faults=(*faults, *flight.faults)), phases)


def _record(
    raw: Mapping[str | None, ColumnTable], mapping: RecordMap, source: Path, notes: list[str]
) -> tuple[Record, tuple[RecordFault, ...], tuple[Phase, ...]]:
    """The record of what is to be analysed, faults masked on the way to its rate, and the phases of the whole."""
    time, channels, clock_notes = _on_one_clock(raw, mapping)
    notes = [*notes, *clock_notes]
    tolerances: dict[str, Any] = {}
    sigma, rest = None, None
    lean = channels.pop("lean", None)
    further = [{n: channels.pop(f"{n}{OF_UNIT}{k}") for n in unit} for k, unit in enumerate(mapping.beside, 2)]
    tilt = _nose(time, channels, mapping)
    if mapping.rotation is not None:
        _turn(mapping.rotation, tilt, channels, tolerances, notes)
        tilt = _nose(time, channels, mapping)
    turned = mounting_fault(time, tilt)
    contradicted = (*turned, *contradictions(time, channels))
    if tilt is not None and not turned:
        contradicted += gyro_fault(time, *_triads(channels))
    if further:
        channels, unit_notes = rocket_log.together(channels, further)
        notes += unit_notes
    notes += [f"{fault.channel}: {fault.action}" for fault in contradicted]
    if mapping.pad is not None:
        if missing := [name for name in INERTIAL_CHANNELS if name not in channels]:
            raise UsageError(f"pad: biases need all gyros and accelerometers, and the map has no {missing[0]}. Map it.")
        sigma_known = tolerances.get("accel_misalignment", rocket_log.PAD_MOUNTED)
        channels, rest, biases, pad_notes = rocket_log.take_out_biases(time, channels, mapping.pad, sigma_known)
        tolerances |= biases
        notes += pad_notes
    if mapping.derive:
        missing = [name for name in ("ax", "altitude") if name not in channels]
        if missing:
            raise UsageError(f"derive/velocity: ascent needs the channel {missing[0]}. Map it.")
        derived = rocket_log.ascent(time, channels["ax"], channels["altitude"], rest, lean)
        speed, channels["altitude"], sigma, climb_notes = derived
        # unknown where it is as good as rest
        channels["velocity"] = np.where(speed > ASCENT_KNOWN_SPEED * sigma, speed, np.nan)
        notes += climb_notes
    forces = [channels[name] for name in ACCELEROMETERS if name in channels]
    phases = find_phases(time, *forces) if len(forces) == len(ACCELEROMETERS) else ()
    window = _window(mapping, phases, time)
    inside = (time >= window[0]) & (time <= window[1])
    kept = {name: values[inside] for name, values in channels.items()}
    rate = None if mapping.rate == "auto" else mapping.rate
    flown = np.flatnonzero(inside & np.isfinite(channels.get("velocity", time)))
    if mapping.rate == "auto" and flown.size and {"q", "r"} <= set(channels):
        motion = {name: channels[name][flown[0] : flown[-1] + 1] for name in ("q", "r")}
        rate = rocket_log.needed_rate(time[flown[0] : flown[-1] + 1], motion)
    reach = 0.0 if rate is None else rocket_log.DECIMATED_REACH / rate  # the filter runs in from beyond the window
    around = (time >= window[0] - reach) & (time <= window[1] + reach)
    vehicle, inertia, vehicle_notes = vehicle_of(mapping, raw, window)
    notes += vehicle_notes
    if mapping.window is not None:
        name = f" ({mapping.window})" if isinstance(mapping.window, str) else ""
        notes.append(f"window of the map{name}: {window[0]:.3f} to {window[1]:.3f} s")
    content = {
        "time": time[around],
        "channels": {name: values[around] for name, values in channels.items()},
        "vehicle": vehicle,
        "instruments": instruments_of(mapping, tolerances, inertia, kept, None if sigma is None else sigma[inside]),
        "planet": mapping.planet,
        "title": mapping.title,
        "source": mapping.source or source.name,
        "path": str(source),
        "recorded_units": {n: each.units for n, each in mapping.channels.items() if n in CHANNEL_DIMENSIONS},
        "notes": notes,
    }
    record = validated(Record, content)
    faults: tuple[RecordFault, ...] = ()
    if rate is not None:
        record, faults = rocket_log.decimated(record, rate)
        within = (record.time >= window[0]) & (record.time <= window[1])
        cut = {name: values[within] for name, values in record.channels.items()}
        record = record.model_copy(update={"time": record.time[within], "channels": cut})
        faults = tuple(fault for fault in faults if fault.start_s <= window[1] and fault.stop_s >= window[0])
    return record, (*contradicted, *faults), phases


def _nose(time: FloatArray, channels: Channels, mapping: RecordMap) -> Tilt | None:
    """The nose by thrust; without, by a coast of known speed."""
    if not set(INERTIAL_CHANNELS) <= set(channels):
        return None
    air = air_of(channels)
    if air is None:
        return nose_axis(time, *_triads(channels))
    place = mapping.vehicle.get("accelerometer_position", VehicleValue(value=0.0, units="m"))
    value = to_si(getattr(place, "value", 0.0), place.units, "length", "vehicle/accelerometer_position")
    return nose_axis(time, *_triads(channels), (*air, np.broadcast_to(value, (3,)), ARM_OFF))


def _triads(channels: Channels) -> tuple[FloatArray, FloatArray]:
    rates, forces = (np.stack([channels[name] for name in triad]) for triad in (GYROS, ACCELEROMETERS))
    return rates, forces


def _turn(rotation: Any, tilt: Tilt | None, channels: Channels, tolerances: dict[str, Any], notes: list[str]) -> None:
    """Turn gyros and accelerometers in `channels`, noting it and an estimate's error in `tolerances`; or UsageError."""
    missing = [name for name in INERTIAL_CHANNELS if name not in channels]
    if missing or (rotation == "auto" and tilt is None):
        lacks = f"the map has no channel {missing[0]}" if missing else "no thrust, nor a spinning coast, shows x"
        raise UsageError(f"rotation: {lacks}. Give a rotation by hand (turns or three rows) over all six channels.")
    matrix = np.array(rotation) if rotation != "auto" or tilt is None else tilt.matrix
    for names, triad in zip((GYROS, ACCELEROMETERS), _triads(channels), strict=True):
        channels |= dict(zip(names, matrix @ triad, strict=True))
    if rotation == "auto" and tilt is not None:
        tolerances |= dict.fromkeys(("gyro_misalignment", "accel_misalignment"), tilt.sigma)
        rows = "; ".join(", ".join(f"{value:.4f}" for value in row) for row in matrix)
        lay = f"{np.degrees(tilt.angle):.2f} deg off x, known to {np.degrees(tilt.sigma):.2f} deg"
        notes.append(f"rotation found from {tilt.by}: the nose lay {lay}; rows {rows}")


def _on_one_clock(raw: Mapping[str | None, ColumnTable], mapping: RecordMap) -> tuple[FloatArray, Channels, list[str]]:
    """All channels, SI, on the stamps of the main table, NaN where another recorder has none; notes."""
    channels = {
        name: _channel(raw[None].columns[entry.column], entry, _dimension(name), name)
        for name, entry in mapping.channels.items()
        if entry.recorder is None
    }
    time = channels.pop("time")
    notes: list[str] = []
    steps = [held_or_rounded(name, time, values) for name, values in channels.items() if values.shape == time.shape]
    for name, recorder in mapping.recorders.items():
        columns = raw[name].columns
        clock = _channel(columns[recorder.time.column], recorder.time, "time", f"recorders/{name}/time")
        if recorder.align is not None:
            align = recorder.align
            if align.to not in channels:
                has = f"the main table, which has {', '.join(channels)}"
                raise UsageError(f"recorders/{name}/align/to: '{align.to}' is no channel of {has}.")
            place = f"recorders/{name}/align"
            other = to_si(columns[align.column], align.units, CHANNEL_DIMENSIONS[align.to], place)
            moved, likeness = rocket_log.clock_offset(time, channels[align.to], clock, other)
            clock = clock + moved
            notes.append(
                f"clock of {one_line(name)}: {moved:+.4g} s to that of the main table, by its "
                f"{one_line(align.column)} against {align.to} (correlation {likeness:.3f})"
            )
        for channel, entry in mapping.channels.items():
            if entry.recorder == name:
                values = _channel(columns[entry.column], entry, _dimension(channel), channel)
                known = np.isfinite(values) & np.isfinite(clock)
                steps.append(held_or_rounded(channel, clock[known], values[known]))
                channels[channel] = np.interp(time, clock[known], values[known], left=np.nan, right=np.nan)
    check_time(time)
    for name, values in channels.items():
        check_shape(name, values, time.shape)
        if not np.any(np.isfinite(values)):
            cause = "an instrument that was not there, or a recorder whose clock does not overlap"
            raise refusal(name, "no number", "values", cause, f"take '{name}' out of the map, or map another column")
    return time, channels, [*notes, *filter(None, steps)]


def _channel(column: FloatArray, entry: ColumnMap, dimension: Dimension, name: str) -> FloatArray:
    """The mapped column in SI."""
    known = column if entry.missing is None else np.where(column == entry.missing, np.nan, column)
    return to_si(entry.scale * known + entry.offset, entry.units or "", dimension, name)


def _dimension(name: str) -> Dimension:
    """Of a channel, whichever unit's."""
    return {**CHANNEL_DIMENSIONS, **ATTITUDE}[name.partition(OF_UNIT)[0]]


def _with_units(entry: ColumnMap, table: ColumnTable, dimension: Dimension, place: str) -> ColumnMap:
    """The entry with the units of its column: the map's, else the table's. Raises UsageError where neither has any."""
    of_table = "s" if entry.column in table.stamps else entry.units  # dates and times of day are read in s
    units = of_table or stated_units(entry.column, table, dimension)
    if units is None:
        raise UsageError(
            f"{place}/units: neither the map nor the table gives the units of '{one_line(entry.column)}'. Add units of "
            f"{dimension}, such as {EXAMPLES[dimension]}."
        )
    return entry.model_copy(update={"units": units})


def _window(mapping: RecordMap, phases: tuple[Phase, ...], time: FloatArray) -> tuple[float, float]:
    if not isinstance(mapping.window, str):
        return mapping.window or (-np.inf, np.inf)
    for phase in phases:
        if phase.name == mapping.window:
            return phase.start_s, phase.stop_s
    found = ", ".join(f"{each.name} {each.start_s:.2f} to {each.stop_s:.2f} s" for each in phases) or "none"
    raise UsageError(
        f"the map's window is '{mapping.window}', a phase that the record from {time[0]:.3f} to {time[-1]:.3f} s "
        f"does not show (it shows {found}). Give times instead: window: [start, stop]."
    )
