"""Columns of foreign tables: csv, parquet and mat, by name."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.errors import FlightRecordError, UsageError
from brv_hypo.files.library import Content, read_table
from brv_hypo.files.regular import check_regular
from brv_hypo.flight.csv_table import csv_names, find_columns, read_csv
from brv_hypo.flight.hdf5 import Tree, read_tree
from brv_hypo.flight.refusal import refusal

Columns = Mapping[str, FloatArray]


@dataclass(frozen=True)
class RawTable:
    """One table as it was read: columns (n,) in the units that the map says, by recorder."""

    recorder: str
    columns: Mapping[str, FloatArray]
    units: Mapping[str, str]


def read_columns(path: Path, names: tuple[str, ...], delimiter: str = ",") -> Columns:
    """The columns `names` of a file, each (n,).

    Raises UsageError (another type of file, a missing extra or column) and FlightRecordError (it is unreadable).
    """
    readers: dict[str, Callable[[], Columns]] = {
        ".csv": lambda: read_csv(path, names, delimiter),
        ".parquet": lambda: _columns(_parquet(path, names), names, path),
        ".mat": lambda: _read_mat(path, names),
    }
    return readers[_kind(path, readers)]()


def column_names(path: Path, delimiter: str = ",") -> tuple[str, ...]:
    """The names of all columns of a file; errors as of `read_columns`."""
    readers: dict[str, Callable[[], tuple[str, ...]]] = {
        ".csv": lambda: csv_names(path, delimiter),
        ".parquet": lambda: _parquet(path, ()).names,
        ".mat": lambda: _mat_names(path),
    }
    return readers[_kind(path, readers)]()


def found_file(file: str, folders: tuple[Path, ...]) -> Path:
    """A file that a map names, in the first of `folders` that has it."""
    return next((folder / file for folder in folders if (folder / file).exists()), folders[0] / file)


def _kind(path: Path, known: Mapping[str, Any]) -> str:
    check_regular(path, "a record to import", FlightRecordError)
    if path.suffix.lower() not in known:
        raise UsageError(
            f"{path}: found a file of type '{path.suffix}', expected {', '.join(known)}. "
            "Rename it if it is one of these (a text table of any delimiter is .csv), else convert it first."
        )
    return path.suffix.lower()


def _parquet(path: Path, names: tuple[str, ...]) -> Content:
    if find_spec("pyarrow") is None:
        raise UsageError(
            f"{path}: reading parquet needs pyarrow. Install the extra: pip install 'brv-hypo[tables]'."
        )
    return read_table("parquet", path, names)


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


def _mat_names(path: Path) -> tuple[str, ...]:
    table = read_table("mat", path, ())
    if not table.is_hdf5:
        return table.names
    return tuple(name for name, values in _dotted(read_tree(path), "") if values.dtype.kind in "fiu")


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
