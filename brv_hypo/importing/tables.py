"""Columns of foreign tables by name: csv, parquet and mat.

A csv is read line by line within a budget: one header row, lines that start with # left out. Parquet and MATLAB
files are read by `brv_hypo.io.sandbox`; a MATLAB file v7.3 is read as the HDF5 that it is.
Entrances: `read_columns`, `column_names`.
"""

from __future__ import annotations

import csv
from array import array
from collections.abc import Callable, Iterable, Iterator, Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import Any, TextIO

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.errors import FlightRecordError, UsageError
from brv_hypo.io.hdf5 import Tree, read_tree
from brv_hypo.io.reading import check_regular
from brv_hypo.io.sandbox import READ_BUDGET, Content, read_table
from brv_hypo.io.text import nearest as nearest_names
from brv_hypo.io.text import one_line, refusal

# ---- Text tables: the wanted columns of a csv, read line by line within a budget ----


MISSING_TEXT = frozenset({"", "na", "n/a", "nan", "null", "none", "-"})
LONGEST_LINE = 1 << 20  # characters; 14 channels need 300
MOST_NAMED = 40  # columns named where one is missing


def read_csv(path: Path, names: tuple[str, ...], delimiter: str) -> dict[str, FloatArray]:
    """Columns (n,) of a text table: one header row, lines that start with # left out.

    Raises FlightRecordError where the table is unreadable or too large, UsageError where a column is missing.
    """
    try:
        with path.open(newline="", encoding="utf-8-sig") as stream:
            rows = csv.reader(_lines(stream, path), delimiter=delimiter)
            places = find_columns(names, [name.strip() for name in next(rows, [])], path)
            columns = {name: array("d") for name in places}
            for row in rows:
                for name, place in places.items() if row else ():
                    columns[name].append(_number(row, place, name))
    except (UnicodeDecodeError, csv.Error, OSError) as error:
        raise _unreadable(path, error) from error
    except (TypeError, ValueError) as error:  # what csv says of a delimiter that cannot be one
        raise UsageError(f"the delimiter {delimiter!r} cannot be used ({error}). Give another.") from error
    return {name: np.array(values) for name, values in columns.items()}


def csv_names(path: Path, delimiter: str) -> tuple[str, ...]:
    """The names in the header row of a text table; errors as of `read_csv`."""
    try:
        with path.open(newline="", encoding="utf-8-sig") as stream:
            return tuple(name.strip() for name in next(csv.reader(_lines(stream, path), delimiter=delimiter), []))
    except (UnicodeDecodeError, csv.Error, OSError) as error:
        raise _unreadable(path, error) from error


def find_columns(names: Iterable[str], available: list[str], path: Path) -> dict[str, int]:
    """Where each name stands among the columns of a file; raises UsageError for one that is missing."""
    for name in names:
        if name not in available:
            known = ", ".join(map(one_line, available[:MOST_NAMED])) or "none"
            raise UsageError(
                f"{path}: there is no column '{name}', which the map asks for{nearest(name, available)}. "
                f"It has {known}."
            )
    return {name: available.index(name) for name in names}


def nearest(name: str, known: Iterable[str]) -> str:
    """A hint at the names that are like it, for a refusal; empty where none is."""
    guess = nearest_names(name, known, 0.5, most=2)
    return f" (is {' or '.join(one_line(repr(one)) for one in guess)} meant?)" if guess else ""


def _unreadable(path: Path, error: Exception) -> FlightRecordError:
    return FlightRecordError(
        f"{path}: found a table that cannot be read ({one_line(str(error))}). Save it as UTF-8 csv."
    )


def _lines(stream: TextIO, path: Path) -> Iterator[str]:
    """The lines that are no comment, as long as all values together stay within the budget."""
    read = 0
    while line := stream.readline(LONGEST_LINE):
        read += len(line)
        if (
            len(line) == LONGEST_LINE or read > READ_BUDGET * 4
        ):  # a value of 8 bytes takes some 32 characters at most
            raise FlightRecordError(
                f"{path}: found {'a line' if len(line) == LONGEST_LINE else 'a table'} of more than {read >> 20} MB, "
                "expected a table of samples, one a line. Likely cause: another kind of file. Remedy: cut it into "
                "flights, or lower the sample rate."
            )
        if not line.startswith("#"):
            yield line


def _number(row: list[str], index: int, name: str) -> float:
    text = row[index].strip() if index < len(row) else ""
    if text.lower() in MISSING_TEXT:
        return float("nan")
    try:
        return float(text)
    except ValueError as error:
        raise refusal(
            name,
            f"'{one_line(text)}'",
            "a number, or an empty cell where a sample is missing",
            "another decimal sign or delimiter, or a row of units under the header",
            "remove such rows (a line that starts with # is skipped) and use a decimal point",
        ) from error


# ---- Columns of foreign tables: csv, parquet and mat, by name ----


Columns = Mapping[str, FloatArray]


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
    selection: dict[str, list[str]] = {}
    for name in names:
        *groups, last = name.split(".")
        selection.setdefault("/".join(groups), []).append(last)
    tree = read_tree(path, only=selection)
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
