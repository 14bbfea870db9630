"""MAP.yaml: what a foreign record's columns are, and what is to be done with them. Read by `read_map`.

A value is `scale * column + offset`, in `units`, and NaN where the column holds `missing`:

    title: Entry of 1975
    planet: earth
    channels:
      time: {column: t, units: s}
      p: {column: gyro_x, units: deg/s, scale: -1.0, missing: -999}
      altitude: {recorder: altimeter, column: baro, units: ft}
    recorders:                     # other files, each with a clock of its own
      altimeter:
        file: altimeter.csv
        time: {column: met, units: s}
        align: {column: accel, units: g, to: ax}   # the clock's offset, from what both recorders sensed
    vehicle:
      mass: {value: 832, units: kg}
      ixx: {file: masses.csv, column: roll_inertia, units: kg*m^2, time: {column: t, units: s}}
    instruments: {grade: industrial}
    pad: [-4.0, -0.5]              # at rest, nose up, between these times: biases
    derive: {velocity: ascent}     # from ax and altitude, on a steep climb
    window: coast                  # a phase that is found, or [start, stop] in s
    rate: auto                     # Hz, or auto: what the motion needs

Columns of a mat file that lie in a struct are called `struct.field`. Files are named relative to the map's folder, or
to that of the data.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Discriminator, Field, Tag, ValidationError

from brv_hypo.errors import UsageError
from brv_hypo.flight.csv_table import nearest
from brv_hypo.flight.phases import PhaseName
from brv_hypo.flight.schema import CHANNEL_DIMENSIONS, VEHICLE_DIMENSIONS, complaints


def _in_order(span: tuple[float, float]) -> tuple[float, float]:
    if not span[0] < span[1]:
        raise ValueError("a start before its stop")
    return span


Span = Annotated[tuple[float, float], AfterValidator(_in_order)]


class _Entry(BaseModel):
    model_config = ConfigDict(extra="forbid")


class ColumnMap(_Entry):
    """Where a channel comes from: the main table, or that of a `recorder`."""

    column: str
    units: str
    scale: float = 1.0
    offset: float = 0.0
    missing: float | None = None
    recorder: str | None = None


class Alignment(_Entry):
    """What a second recorder sensed of channel `to`; a constant difference between the two does not matter."""

    column: str
    units: str
    to: str = "ax"


class Recorder(_Entry):
    """Another file, and the clock that it has."""

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


def _kind_of(entry: Any) -> str:
    """Which of the two an entry of `vehicle` is, so that one complaint is made of it and not both."""
    named = entry if isinstance(entry, dict) else getattr(entry, "__dict__", {})
    return "column" if "file" in named or "column" in named else "value"


VehicleEntry = Annotated[
    Annotated[VehicleValue, Tag("value")] | Annotated[VehicleColumn, Tag("column")], Discriminator(_kind_of)
]


class Derived(_Entry):
    """Channels that no instrument gave. `ascent`: speed from the axial accelerometer and the altitude."""

    velocity: Literal["ascent"]


class RecordMap(_Entry):
    """MAP.yaml."""

    channels: dict[str, ColumnMap]
    vehicle: dict[str, VehicleEntry]
    recorders: dict[str, Recorder] = {}
    instruments: dict[str, Any] = {}
    pad: Span | None = None
    derive: Derived | None = None
    window: PhaseName | Span | None = None
    rate: Literal["auto"] | Annotated[float, Field(gt=0.0)] | None = None
    planet: str = "earth"
    title: str = ""
    source: str = ""
    delimiter: str = Field(default=",", min_length=1, max_length=1)


def read_map(path: str | Path) -> RecordMap:
    """The validated map at `path`. Raises UsageError, naming the entry that is wrong."""
    from brv_hypo.files.mappings import read_yaml

    file = Path(path)
    content = read_yaml(file, "a map with the keys channels and vehicle")
    _check_filled_in(content, file)
    try:
        mapping = RecordMap.model_validate(content)
    except ValidationError as error:
        raise UsageError(f"the map {file}: {complaints(error, '', 'the description of the map')}") from error
    _check_names(mapping.channels, CHANNEL_DIMENSIONS, "channels", file)
    _check_names(mapping.vehicle, VEHICLE_DIMENSIONS, "vehicle", file)
    if "time" not in mapping.channels:
        raise UsageError(f"the map {file} has no channels/time. Map the column that holds the sample times.")
    for name, entry in mapping.channels.items():
        if entry.recorder is not None and entry.recorder not in mapping.recorders:
            raise UsageError(
                f"the map {file}: channels/{name} comes from the recorder '{entry.recorder}', which recorders does "
                f"not describe{nearest(entry.recorder, mapping.recorders)}. Give its file and its time."
            )
    return mapping


def _check_filled_in(content: dict[str, Any], file: Path) -> None:
    """A guessed map has null for what no table tells."""
    vehicle = content.get("vehicle")
    entries = vehicle.items() if isinstance(vehicle, dict) else ()
    empty = [str(name) for name, entry in entries if isinstance(entry, dict) and entry.get("value", 0) is None]
    if empty:
        raise UsageError(
            f"the map {file} has no value yet for vehicle/{', vehicle/'.join(empty)}: fill in what is null. The shape "
            "of the moments needs the ratio of the inertias alone; their size needs all of them."
        )


def _check_names(names: Iterable[str], known: Iterable[str], group: str, file: Path) -> None:
    for name in names:
        if name not in set(known):
            raise UsageError(
                f"the map {file}: '{group}/{name}' is not part of format 1{nearest(name, known)}. "
                f"It has {', '.join(known)}."
            )
