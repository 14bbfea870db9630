"""Text tables: the wanted columns of a csv, read line by line within a budget."""

from __future__ import annotations

import csv
import difflib
from array import array
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TextIO

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.errors import FlightRecordError, UsageError
from brv_hypo.files.library import READ_BUDGET
from brv_hypo.files.printed import one_line
from brv_hypo.flight.refusal import refusal

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
    guess = difflib.get_close_matches(name, list(known), n=2, cutoff=0.5)
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
