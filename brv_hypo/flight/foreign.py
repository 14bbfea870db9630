"""Foreign records (csv, parquet, mat) through a map of names and units: `import_record`.

The map is YAML; a value is `scale * column + offset`, in `units`, and NaN where the column holds `missing`:

    title: Entry of 1975
    planet: earth
    channels:
      time: {column: t, units: s}
      p: {column: gyro_x, units: deg/s, scale: -1.0, missing: -999}
    vehicle:
      mass: {value: 832, units: kg}
      accelerometer_position: {value: [0.1, 0, 0], units: m}

Columns of a mat file that lie in a struct are called `struct.field`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from brv_hypo.arrays import FloatArray
from brv_hypo.errors import FlightRecordError, UsageError
from brv_hypo.files.library import Content, read_table
from brv_hypo.files.printed import one_line
from brv_hypo.files.regular import check_regular
from brv_hypo.flight.assemble import assemble
from brv_hypo.flight.csv_table import find_columns, nearest, read_csv
from brv_hypo.flight.hdf5 import Tree, read_tree
from brv_hypo.flight.record import Flight
from brv_hypo.flight.refusal import naming, refusal
from brv_hypo.flight.schema import (
    CHANNEL_DIMENSIONS,
    VEHICLE_DIMENSIONS,
    Record,
    VehicleRecord,
    complaints,
    validated,
)
from brv_hypo.flight.units import to_si

Columns = Mapping[str, FloatArray]


class ColumnMap(BaseModel):
    """Where a channel comes from."""

    model_config = ConfigDict(extra="forbid")

    column: str
    units: str
    scale: float = 1.0
    offset: float = 0.0
    missing: float | None = None


class VehicleValue(BaseModel):
    """A property of the vehicle, with its units."""

    model_config = ConfigDict(extra="forbid")

    value: float | tuple[float, float, float]
    units: str


class RecordMap(BaseModel):
    """MAP.yaml."""

    model_config = ConfigDict(extra="forbid")

    channels: dict[str, ColumnMap]
    vehicle: dict[str, VehicleValue]
    planet: str = "earth"
    title: str = ""
    source: str = ""
    delimiter: str = Field(default=",", min_length=1, max_length=1)


def import_record(data: str | Path, map_path: str | Path) -> Flight:
    """The flight in a csv, parquet or mat file, read through the map at `map_path`.

    Raises UsageError (the map is unreadable, wrong, or names what the data do not have; a missing extra) and
    FlightRecordError (the data are unreadable or make no valid record).
    """
    source, mapping = Path(data), read_map(map_path)
    wanted = {name: entry.column for name, entry in mapping.channels.items()}
    columns = _read_columns(source, tuple(dict.fromkeys(wanted.values())), mapping.delimiter)
    with naming(source):
        arrays = {
            name: _channel(columns[entry.column], entry, name) for name, entry in mapping.channels.items()
        }
        record = _record(arrays, mapping, source)
    return assemble(record)


def read_map(path: str | Path) -> RecordMap:
    """The validated map at `path`. Raises UsageError, naming the entry that is wrong."""
    from brv_hypo.files.mappings import read_yaml

    file = Path(path)
    content = read_yaml(file, "a map with the keys channels and vehicle")
    try:
        mapping = RecordMap.model_validate(content)
    except ValidationError as error:
        raise UsageError(f"the map {file}: {complaints(error, '', 'the description of the map')}") from error
    _check_names(mapping.channels, CHANNEL_DIMENSIONS, "channels", file)
    _check_names(mapping.vehicle, VEHICLE_DIMENSIONS, "vehicle", file)
    if "time" not in mapping.channels:
        raise UsageError(f"the map {file} has no channels/time. Map the column that holds the sample times.")
    return mapping


def _check_names(names: Iterable[str], known: Iterable[str], group: str, file: Path) -> None:
    for name in names:
        if name not in set(known):
            raise UsageError(
                f"the map {file}: '{group}/{name}' is not part of format 1{nearest(name, known)}. "
                f"It has {', '.join(known)}."
            )


def _record(arrays: dict[str, FloatArray], mapping: RecordMap, source: Path) -> Record:
    vehicle = {
        name: to_si(
            np.asarray(entry.value), entry.units, VEHICLE_DIMENSIONS[name], f"vehicle/{name}"
        ).tolist()
        for name, entry in mapping.vehicle.items()
    }
    return validated(
        Record,
        {
            "time": arrays.pop("time"),
            "channels": arrays,
            "vehicle": validated(VehicleRecord, vehicle, group="vehicle"),
            "planet": mapping.planet.strip().lower(),
            "title": one_line(mapping.title),
            "source": one_line(mapping.source or source.name),
            "path": str(source),
            "recorded_units": {name: entry.units for name, entry in mapping.channels.items()},
        },
    )


def _channel(column: FloatArray, entry: ColumnMap, name: str) -> FloatArray:
    """The mapped column in SI."""
    known = column if entry.missing is None else np.where(column == entry.missing, np.nan, column)
    return to_si(entry.scale * known + entry.offset, entry.units, CHANNEL_DIMENSIONS[name], name)


def _read_columns(path: Path, names: tuple[str, ...], delimiter: str) -> Columns:
    """The columns `names` of a file, each (n,)."""
    readers: dict[str, Callable[[], Columns]] = {
        ".csv": lambda: read_csv(path, names, delimiter),
        ".parquet": lambda: _read_parquet(path, names),
        ".mat": lambda: _read_mat(path, names),
    }
    check_regular(path, "a record to import", FlightRecordError)
    if path.suffix.lower() not in readers:
        raise UsageError(
            f"{path}: found a file of type '{path.suffix}', expected {', '.join(readers)}. "
            "Rename it if it is one of these (a text table of any delimiter is .csv), else convert it first."
        )
    return readers[path.suffix.lower()]()


def _read_parquet(path: Path, names: tuple[str, ...]) -> Columns:
    if find_spec("pyarrow") is None:
        raise UsageError(
            f"{path}: reading parquet needs pyarrow. Install the extra: pip install 'brv-hypo[tables]'."
        )
    return _columns(read_table("parquet", path, names), names, path)


def _read_mat(path: Path, names: tuple[str, ...]) -> Columns:
    """Columns of a MATLAB file: up to v7 through scipy, v7.3 as the HDF5 that it is."""
    table = read_table("mat", path, names)
    if not table.is_hdf5:
        return _columns(table, names, path)
    asked: dict[str, list[str]] = {}
    for name in names:
        *groups, last = name.split(".")
        asked.setdefault("/".join(groups), []).append(last)
    tree = read_tree(path, only=asked)
    held = dict(_dotted(tree, ""))
    find_columns(names, [*held, *tree.unread], path)
    return {name: _vector(held[name], name) for name in names}


def _columns(table: Content, names: tuple[str, ...], path: Path) -> Columns:
    """The columns of a table, all of which must be there."""
    find_columns(names, list(table.names), path)
    return {held.place: _vector(held.values, held.place) for held in table.held}


def _dotted(tree: Tree, prefix: str) -> Iterator[tuple[str, Any]]:
    """The datasets of a tree under the names that they have in MATLAB."""
    for name, dataset in tree.datasets.items():
        yield prefix + name, dataset.values
    for name, below in tree.groups.items():
        yield from _dotted(below, f"{prefix}{name}.")


def _vector(values: Any, name: str) -> FloatArray:
    """Numbers as (n,); MATLAB has rows and columns."""
    if values.dtype.kind not in "fiu":
        raise refusal(name, "what is not numeric", "numbers", "text or dates", "map a numeric column")
    array = np.asarray(values, dtype=np.float64)
    return array.reshape(-1) if array.size == max(array.shape, default=0) else array
