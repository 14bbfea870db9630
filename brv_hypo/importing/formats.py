"""Import formats (csv, parquet, mat): `FORMATS`, the reader of each by file ending. A new format is one entry.

`FORMATS` holds the reader of each format by the ending of its files: a function of the path, the names of the columns
to read and the delimiter of the map, which returns a `ColumnTable`. A package adds a format by an entry point in the
group `brv_hypo.table_formats`, named as the ending without its point. Entrances: `read_columns`, `column_names`.

A csv is read line by line within a budget: one header row, lines that start with # left out. Parquet and MATLAB
files are read in the sandbox.
"""

from __future__ import annotations

import csv
from array import array
from collections.abc import Callable, Iterable, Iterator, Mapping
from importlib.metadata import entry_points
from importlib.util import find_spec
from pathlib import Path
from typing import TextIO

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.errors import BrvHypoError, FlightRecordError, UsageError, missing_package
from brv_hypo.io.binary import ColumnTable, mat_table, parquet_table
from brv_hypo.io.files import check_regular
from brv_hypo.io.sandbox import READ_BUDGET, read_in_sandbox
from brv_hypo.io.text import nearest as nearest_names
from brv_hypo.io.text import one_line, refusal

MISSING_TEXT = frozenset({"", "na", "n/a", "nan", "null", "none", "-"})
LONGEST_LINE = 1 << 20  # characters; 14 channels need 300
MOST_NAMED = 40  # columns named where one is missing
ENTRY_POINTS = "brv_hypo.table_formats"

Columns = Mapping[str, FloatArray]
TableReader = Callable[[Path, tuple[str, ...], str], ColumnTable]


def read_columns(path: Path, names: tuple[str, ...], delimiter: str = ",") -> Columns:
    """The columns `names` of a file, each (n,).

    Raises UsageError (another type of file, a missing extra or column) and FlightRecordError (it is unreadable).
    """
    table = _reader(path)(path, names, delimiter)
    check_columns(names, table.names, path)
    return {name: _vector(table.columns[name], name) for name in names}


def column_names(path: Path, delimiter: str = ",") -> tuple[str, ...]:
    """The names of all columns of a file; errors as of `read_columns`."""
    return _reader(path)(path, (), delimiter).names


def _reader(path: Path) -> TableReader:
    """The reader of a file's format, by its suffix."""
    check_regular(path, "a record to import", FlightRecordError)
    suffix = path.suffix.lower()
    if suffix in FORMATS:
        return FORMATS[suffix]
    added = {f".{entry.name}": entry for entry in entry_points(group=ENTRY_POINTS)}
    if suffix in added:
        reader: TableReader = added[suffix].load()
        return reader
    raise UsageError(
        f"{path}: found a file of type '{path.suffix}', expected {', '.join((*FORMATS, *added))}. "
        "Rename it if it is one of these (a text table of any delimiter is .csv), else convert it first."
    )


def _vector(values: np.ndarray, name: str) -> FloatArray:
    """Numbers as (n,); MATLAB has rows and columns."""
    if values.dtype.kind not in "fiu":
        raise refusal(name, "what is not numeric", "numbers", "text or dates", "map a numeric column")
    array = np.asarray(values, dtype=np.float64)
    return array.reshape(-1) if array.size == max(array.shape, default=0) else array


def check_columns(names: Iterable[str], available: Iterable[str], path: Path) -> None:
    """Raise UsageError for a name that is not among the columns of a file."""
    available = list(available)
    for name in names:
        if name not in available:
            known = ", ".join(map(one_line, available[:MOST_NAMED])) or "none"
            raise UsageError(
                f"{path}: there is no column '{name}', which the map asks for{nearest(name, available)}. "
                f"It has {known}."
            )


def nearest(name: str, known: Iterable[str]) -> str:
    """A hint at the names that are like it, for a refusal; empty where none is."""
    guess = nearest_names(name, known, 0.5, most=2)
    return f" (is {' or '.join(one_line(repr(one)) for one in guess)} meant?)" if guess else ""


def found_file(file: str, folders: tuple[Path, ...]) -> Path:
    """A file that a map names, in the first of `folders` that has it."""
    return next((folder / file for folder in folders if (folder / file).exists()), folders[0] / file)


# ---- csv: the wanted columns, read line by line within a budget ----


def _read_csv(path: Path, names: tuple[str, ...], delimiter: str) -> ColumnTable:
    try:
        with path.open(newline="", encoding="utf-8-sig") as stream:
            rows = csv.reader(_lines(stream, path), delimiter=delimiter)
            header = [name.strip() for name in next(rows, [])]
            check_columns(names, header, path)
            columns = {name: array("d") for name in names}
            places = {name: header.index(name) for name in names}
            for row in rows if names else ():
                for name, place in places.items() if row else ():
                    columns[name].append(_number(row, place, name))
    except BrvHypoError:
        raise
    except (UnicodeDecodeError, csv.Error, OSError) as error:
        raise FlightRecordError(
            f"{path}: found a table that cannot be read ({one_line(str(error))}). Save it as UTF-8 csv."
        ) from error
    except (TypeError, ValueError) as error:  # what csv says of a delimiter that cannot be one
        raise UsageError(f"the delimiter {delimiter!r} cannot be used ({error}). Give another.") from error
    return ColumnTable({name: np.array(values) for name, values in columns.items()}, tuple(header))


def _lines(stream: TextIO, path: Path) -> Iterator[str]:
    """The lines that are no comment, as long as all values together stay within the budget."""
    read = 0
    while line := stream.readline(LONGEST_LINE):
        read += len(line)
        if len(line) == LONGEST_LINE or read > READ_BUDGET * 4:  # a value of 8 bytes takes some 32 characters at most
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


# ---- Parquet and MATLAB, in the sandbox ----


def _read_parquet(path: Path, names: tuple[str, ...], delimiter: str) -> ColumnTable:
    if find_spec("pyarrow") is None:
        raise missing_package(f"{path}: reading parquet", "pyarrow", "tables")
    return read_in_sandbox("Parquet", parquet_table, path, names)


FORMATS: dict[str, TableReader] = {
    ".csv": _read_csv,
    ".parquet": _read_parquet,
    ".mat": lambda path, names, delimiter: read_in_sandbox("MATLAB", mat_table, path, names),
}
