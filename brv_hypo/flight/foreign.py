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

import csv
import difflib
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from brv_hypo.arrays import FloatArray
from brv_hypo.errors import FlightRecordError, UsageError
from brv_hypo.flight.assemble import assemble
from brv_hypo.flight.hdf5 import Dataset, Tree, read_tree
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

MISSING_TEXT = frozenset({"", "na", "n/a", "nan", "null", "none", "-"})

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
    import yaml

    file = Path(path)
    try:
        content = yaml.safe_load(file.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise UsageError(f"the map {file} cannot be read: {error}. Give a readable YAML file.") from error
    if not isinstance(content, dict):
        raise UsageError(
            f"the map {file} holds {type(content).__name__}, expected the keys channels and vehicle."
        )
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
                f"the map {file}: '{group}/{name}' is not part of format 1{_nearest(name, known)}. "
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
            "title": mapping.title,
            "source": mapping.source or source.name,
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
    if not path.is_file():
        raise FlightRecordError(f"{path}: found no such file, expected a record to import. Check the path.")
    readers: dict[str, Callable[[], Columns]] = {
        ".csv": lambda: _read_csv(path, names, delimiter),
        ".parquet": lambda: _read_parquet(path, names),
        ".mat": lambda: _read_mat(path, names),
    }
    if path.suffix.lower() not in readers:
        raise UsageError(
            f"{path}: found a file of type '{path.suffix}', expected {', '.join(readers)}. "
            "Rename it if it is one of these (a text table of any delimiter is .csv), else convert it first."
        )
    return readers[path.suffix.lower()]()


def _read_csv(path: Path, names: tuple[str, ...], delimiter: str) -> Columns:
    """Columns of a text table: one header row, lines that start with # left out."""
    try:
        with path.open(newline="", encoding="utf-8-sig") as stream:
            rows = csv.reader((line for line in stream if not line.startswith("#")), delimiter=delimiter)
            header = [name.strip() for name in next(rows, [])]
            indices = _find(names, header, path)
            cells = [row for row in rows if row]
    except (UnicodeDecodeError, csv.Error, OSError) as error:
        raise FlightRecordError(
            f"{path}: found a table that cannot be read ({error}). Save it as UTF-8 csv."
        ) from error
    return {name: np.array([_number(row, i, name) for row in cells]) for name, i in indices.items()}


def _number(row: list[str], index: int, name: str) -> float:
    text = row[index].strip() if index < len(row) else ""
    if text.lower() in MISSING_TEXT:
        return float("nan")
    try:
        return float(text)
    except ValueError as error:
        raise refusal(
            name,
            f"'{text}'",
            "a number, or an empty cell where a sample is missing",
            "another decimal sign or delimiter, or a row of units under the header",
            "remove such rows (a line that starts with # is skipped) and use a decimal point",
        ) from error


def _read_parquet(path: Path, names: tuple[str, ...]) -> Columns:
    try:
        import pandas as pd

        table = pd.read_parquet(path)
    except ImportError as error:
        raise UsageError(
            f"{path}: reading parquet needs pandas and pyarrow ({error}). "
            "Install the extra: pip install 'brv-hypo[tables]'."
        ) from error
    except (OSError, ValueError) as error:
        raise FlightRecordError(
            f"{path}: found parquet that cannot be read ({error}). Write it again."
        ) from error
    found = _find(names, [str(name) for name in table.columns], path)
    return {
        name: _vector(table.iloc[:, index].to_numpy(na_value=np.nan), name) for name, index in found.items()
    }


def _read_mat(path: Path, names: tuple[str, ...]) -> Columns:
    """Columns of a MATLAB file: up to v7 through scipy, v7.3 as the HDF5 that it is."""
    from scipy.io import loadmat
    from scipy.io.matlab import MatReadError

    try:
        content = _flat(loadmat(path, simplify_cells=True))
    except NotImplementedError:
        content = _flat(_nested(read_tree(path)))
    except (MatReadError, ValueError, OSError) as error:
        raise FlightRecordError(
            f"{path}: found a mat file that cannot be read ({error}). Save it again."
        ) from error
    found = _find(names, list(content), path)
    return {name: _vector(content[name], name) for name in found}


def _vector(values: Any, name: str) -> FloatArray:
    """Numbers as (n,); MATLAB has rows and columns."""
    try:
        array = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise refusal(
            name,
            "what is not numeric",
            "numbers",
            "text, dates or a struct",
            "map a numeric column (struct.field in a mat file)",
        ) from error
    return array.reshape(-1) if array.size == max(array.shape, default=0) else array


def _flat(content: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Nested mappings as one, with dotted names."""
    flat: dict[str, Any] = {}
    for name, value in content.items():
        if isinstance(value, Mapping):
            flat.update(_flat(value, f"{prefix}{name}."))
        else:
            flat[prefix + name] = value
    return flat


def _nested(tree: Tree) -> dict[str, Any]:
    datasets: Mapping[str, Dataset] = tree.datasets
    groups = {name: _nested(below) for name, below in tree.groups.items()}
    return {**{name: dataset.values for name, dataset in datasets.items()}, **groups}


def _find(names: Iterable[str], available: list[str], path: Path) -> dict[str, int]:
    """Where each name stands among the columns of a file."""
    for name in names:
        if name not in available:
            raise UsageError(
                f"{path}: there is no column '{name}', which the map asks for{_nearest(name, available)}. "
                f"It has {', '.join(available[:40]) or 'none'}."
            )
    return {name: available.index(name) for name in names}


def _nearest(name: str, known: Iterable[str]) -> str:
    guess = difflib.get_close_matches(name, list(known), n=2, cutoff=0.5)
    return f" (is {' or '.join(repr(one) for one in guess)} meant?)" if guess else ""
