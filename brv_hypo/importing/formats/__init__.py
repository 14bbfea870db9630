"""Formats of foreign tables: a registry of readers, and what is done with the columns of any of them.

A format is a `TableFormat` in the FORMATS of a file of this package: its endings, or marks by which its beginning is
recognised, and a reader. A package adds one by an entry point in the group `brv_hypo.table_formats`, named as the
ending without its point: a function of the path, the names of the columns to read and the `Layout`, which returns a
`ColumnTable`. Entrances: `read_columns`, `read_all`.

Whatever the format, dates become seconds, counters that wrap are unwrapped, and repeated rows are left out.
"""

from __future__ import annotations

import pkgutil
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache
from importlib import import_module
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from brv_hypo.arrays import FloatArray
from brv_hypo.errors import BrvHypoError, FlightRecordError, UsageError
from brv_hypo.io.binary import ColumnTable
from brv_hypo.io.files import check_regular
from brv_hypo.io.text import counted, one_line, refusal
from brv_hypo.io.text import nearest as nearest_names

MOST_NAMED = 40  # columns named where one is missing
HEAD_BYTES = 1 << 14  # by which a format is recognised
ENTRY_POINTS = "brv_hypo.table_formats"
# What counters of 16 and 32 bits count, in their own units and as seconds of ms and us; a day and a week in s.
WRAPS = (*(2.0**bits * size for bits in (16, 32) for size in (1.0, 1e-3, 1e-6)), 86400.0, 604800.0)
LONGEST_WRAP = 20.0  # median steps across a wrap: a longer gap is no wrap


class Layout(BaseModel):
    """How a file is laid out. What is None is found from the file."""

    model_config = ConfigDict(extra="forbid")
    format: str | None = None
    encoding: str | None = None
    delimiter: str | None = Field(default=None, min_length=1, max_length=1)  # a blank is any number of blanks
    decimal: str | None = Field(default=None, pattern="^[.,]$")
    names: tuple[str, ...] = ()  # of the columns of a table that has none
    widths: tuple[int, ...] = ()  # characters of each column, where nothing is between them
    dates: str | None = None  # as of strptime, such as "%d/%m/%y %I:%M:%S %p"
    where: dict[str, str | float] = {}  # columns and their values in the rows to keep: one of several sensors


@dataclass(frozen=True)
class TableFormat:
    """A format: `read` gives the named columns and the names of all; `recognises` by path and first characters.
    `finds_numbers`: of no names (None) it gives every column of numbers, whatever text there is beside them.
    """

    name: str
    read: Callable[[Path, Any, Layout], ColumnTable]
    endings: tuple[str, ...] = ()
    recognises: Callable[[Path, str], bool] = lambda path, head: False
    finds_numbers: bool = False


@cache
def known_formats() -> tuple[TableFormat, ...]:
    """All formats of this package."""
    modules = [import_module(f"{__name__}.{module.name}") for module in pkgutil.iter_modules(__path__)]
    return tuple(each for module in modules for each in module.FORMATS)


def read_columns(
    path: Path, names: tuple[str, ...], layout: Layout | None = None, zero: np.datetime64 | None = None
) -> ColumnTable:
    """The columns `names` of a file, each (n,) of numbers; dates are s since `zero`, or since their first. Raises
    UsageError (another type of file, a missing extra or column) and FlightRecordError (it is unreadable).
    """
    layout = layout or Layout()
    wanted = tuple(dict.fromkeys((*names, *layout.where)))
    table = _format_of(path, layout).read(path, wanted, layout)
    check_columns(wanted, table.names, path)
    columns = {name: table.columns[name] for name in names}
    if layout.where:
        kept = np.all([table.columns[name] == value for name, value in layout.where.items()], axis=0)
        if not np.any(kept):
            raise UsageError(f"{path}: where: {layout.where} keeps no row. Give a value that the column holds.")
        columns = {name: values[kept] for name, values in columns.items()}
        table = replace(table, lines=None if table.lines is None else table.lines[kept])
    return _cleaned(table, columns, zero)


def read_all(path: Path) -> ColumnTable:
    """Every column of numbers of a file; errors as of `read_columns`."""
    found = _format_of(path, Layout())
    if found.finds_numbers:
        table = found.read(path, None, Layout())
        return _cleaned(table, table.columns, None)
    table = found.read(path, (), Layout())
    columns: dict[str, Any] = {}
    with suppress(BrvHypoError):
        table = found.read(path, tuple(dict.fromkeys(table.names)), Layout())
        columns = {name: _vector(values, name) for name, values in table.columns.items()}
    for name in table.names if not columns else ():
        with suppress(BrvHypoError):  # text: it is no channel
            columns[name] = _vector(found.read(path, (name,), Layout()).columns[name], name)
    return _cleaned(table, columns, None)


def _format_of(path: Path, layout: Layout) -> TableFormat:
    """By the map, else by an ending of another package, the beginning of the file or its ending."""
    check_regular(path, "a record to import", FlightRecordError)
    added = [TableFormat(each.name, each.load(), (f".{each.name}",)) for each in entry_points(group=ENTRY_POINTS)]
    formats, suffix = (*known_formats(), *added), path.suffix.lower()
    with path.open("rb") as stream:
        head = stream.read(HEAD_BYTES).decode("latin-1").replace("\0", "")
    fitting = [each for each in added if suffix in each.endings]
    fitting += [each for each in reversed(formats) if each.recognises(path, head)]
    fitting += [each for each in formats if suffix in each.endings]
    if layout.format is not None:
        fitting = [each for each in formats if each.name == layout.format]
    if not fitting:
        raise UsageError(
            f"{path}: found a file of type '{layout.format or path.suffix}', expected "
            f"{', '.join(', '.join(each.endings) for each in formats if each.endings)}. Rename it if it is one of "
            f"these (a text table is .csv), give `format` ({', '.join(each.name for each in formats)}) in the "
            "map, else convert it first."
        )
    return fitting[0]


def check_columns(names: Iterable[str], available: Iterable[str], path: Path) -> None:
    """Raise UsageError for a name that is not among the columns of a file."""
    available = list(available)
    for name in names:
        if name not in available:
            known = ", ".join(map(one_line, available[:MOST_NAMED])) or "none"
            lacks = f"there is no column '{name}', which the map asks for{nearest(name, available)}"
            raise UsageError(f"{path}: {lacks}. It has {known}.")


def nearest(name: str, known: Iterable[str]) -> str:
    """A hint at the names that are like it, for a refusal; empty where none is."""
    guess = nearest_names(name, known, 0.5, most=2)
    return f" (is {' or '.join(one_line(repr(one)) for one in guess)} meant?)" if guess else ""


def found_file(file: str, folders: tuple[Path, ...]) -> Path:
    """A file that a map names, in the first of `folders` that has it."""
    return next((folder / file for folder in folders if (folder / file).exists()), folders[0] / file)


# ---- Columns of any format: dates, counters, repeated rows ----


def _cleaned(table: ColumnTable, columns: Mapping[str, Any], zero: np.datetime64 | None) -> ColumnTable:
    """The table with these columns as numbers, (n,) each."""
    notes, found, stamps = [*table.notes], dict[str, FloatArray](), [*table.stamps]
    for name, values in columns.items():
        if np.asarray(values).dtype.kind == "M":
            zero = next(iter(values), np.datetime64("NaT")) if zero is None else zero
            values = (values - zero) / np.timedelta64(1, "s")
            stamps.append(name)
            notes.append(f"{one_line(name)} counts from {str(zero)[:19]} UTC")
        found[name], size = _unwrapped(_vector(values, name))
        if size:
            notes.append(f"{one_line(name)} is a counter that wraps at {size:g}: unwrapped")
    kept = _first_of_repeated(found)
    if kept is not None:
        left_out = next(iter(found.values())).size - kept.size
        notes.append(f"left out {counted(left_out, 'row')} that repeat another to the last digit")
        found = {name: values[kept] for name, values in found.items()}
        table = replace(table, lines=None if table.lines is None else table.lines[kept])
    return replace(table, columns=found, notes=tuple(notes), stamps=tuple(stamps), zero=zero)


def _vector(values: np.ndarray, name: str) -> Any:
    """Numbers as (n,); MATLAB has rows and columns. Dates as they are."""
    if values.dtype.kind not in "fiuM":
        raise refusal(name, "what is not numeric", "numbers", "text or dates", "map a numeric column")
    array = values if values.dtype.kind == "M" else np.asarray(values, dtype=np.float64)
    return array.reshape(-1) if array.size == max(array.shape, default=0) else array


def _unwrapped(values: FloatArray) -> tuple[FloatArray, float]:
    """A counter that rises but where it wraps, and by how much it wraps; other columns as they are, and 0."""
    steps = np.diff(values) if values.ndim == 1 else np.array([])
    falls, rises = steps[steps < 0.0], steps[steps > 0.0]
    if rises.size and 0 < falls.size < 0.2 * steps.size and np.all(np.isfinite(steps)) and values.min() >= 0.0:
        most = LONGEST_WRAP * float(np.median(rises))
        for size in WRAPS:
            if values.max() < size and np.all((falls + size > 0.0) & (falls + size < most)):
                return values + size * np.concatenate([[0.0], np.cumsum(steps < 0.0)]), size
    return values, 0.0


def _first_of_repeated(columns: Mapping[str, FloatArray]) -> Any:
    """Rows (m,) that no earlier row repeats in every column; None where none repeats."""
    values = [*columns.values()]
    of_a_table = len(values) > 1 and all(each.shape == values[0].shape and each.ndim == 1 for each in values)
    if not of_a_table or any(np.all(np.diff(each) > 0.0) for each in values):
        return None
    _, first = np.unique(np.stack(values, axis=1), axis=0, return_index=True)
    return np.sort(first) if first.size < values[0].size else None


def clock_fault(table: ColumnTable, name: str) -> str | None:
    """What keeps column `name` from being time: line, cell, cause and remedy; None where nothing does."""
    time = table.columns[name]
    wrong = np.flatnonzero(np.diff(time) <= 0.0) if time.ndim == 1 else np.array([])
    if not wrong.size:
        return None
    at = int(wrong[0]) + 1
    where = f"row {at + 1}" if table.lines is None else f"line {int(table.lines[at])}"
    cause, remedy = "a clock that was set, or a second record behind the first", "cut the file there"
    if np.all(np.diff(time)[wrong] == 0.0) or wrong.size > 0.1 * time.size:
        cause = "several sensors or units in one table, or stamps coarser than the samples"
        remedy = "`where: {column: value}` in the map keeps the rows of one"
    return (
        f"{where}, column '{one_line(name)}': found {time[at]:.9g} after {time[at - 1]:.9g} ({wrong.size} such rows), "
        f"expected a time that rises. Likely cause: {cause}. Remedy: {remedy}, or map another column of time."
    )
