"""Text tables of any dialect: found from the first lines, then read line by line within a budget.

Found are the encoding, the delimiter and decimal sign that make most cells values, the row of names above the first row
of values (behind a comment mark or not), and units in a row below the names or in brackets behind each. A value is a
number, with or without marks between thousands, a date or a time of day. Dates without a zone are UTC; dates of which
day and month cannot be told apart begin with the day. Entrances: `detect`, `read_text`.
"""

from __future__ import annotations

import codecs
import csv
import re
from array import array
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from functools import cache
from itertools import islice
from pathlib import Path
from typing import Any, TextIO

import numpy as np

from brv_hypo.errors import FlightRecordError, UsageError
from brv_hypo.flight.units import is_unit, spelled
from brv_hypo.importing.formats import HEAD_BYTES, Layout, TableFormat, check_columns
from brv_hypo.io.binary import ColumnTable
from brv_hypo.io.sandbox import READ_BUDGET
from brv_hypo.io.text import one_line

MISSING_TEXT = frozenset({"", "na", "n/a", "#n/a", "nan", "null", "none", "nil", "-", "--", "---"})
LONGEST_LINE = 1 << 20  # characters; 14 channels need 300
HEAD_LINES = 300  # from which the dialect is found
DELIMITERS = (",", ";", "\t", "|", " ")  # a blank: any number of blanks
COMMENTS = ("#", "%", "//", "!")
TEXT_ENDINGS = (".txt", ".tsv", ".dat", ".tab", ".asc", ".log")
MARKS = {ord(mark): "," for mark in " '\u00a0\u2009\u202f\u2019"}  # between thousands, beside the comma
GROUPED = re.compile(r"[+-]?[1-9]\d{0,2}(,\d{3})+(\.\d*)?")
SWAPPED = str.maketrans(",.", ".,")
CLOCK = re.compile(r"[+-]?(?:(\d+):)?(\d{1,2}):(\d{1,2}(?:[.,]\d*)?)")
DATE = re.compile(r"(\d{1,4})([-/.])(\d{1,2}|[A-Za-z]{3})\2(\d{1,4})")
NOT_A_TIME = -(2**63)  # as numpy has it
EPOCH = datetime(1970, 1, 1, tzinfo=UTC)

Spans = tuple[tuple[int, int], ...]


@dataclass(frozen=True)
class Dialect:
    """How a text table is written."""

    encoding: str
    delimiter: str
    decimal: str
    names: tuple[str, ...]
    kinds: tuple[str, ...]
    """Of each column: number, date, clock (a time of day) or text."""
    first: int
    """Lines before the first row of values."""
    units: Mapping[str, str] = field(default_factory=dict)
    spans: Spans = ()
    """First and last place of each column, where nothing is between them."""
    notes: tuple[str, ...] = ()


# ---- One cell ----


def as_number(text: str, decimal: str) -> float | None:
    """The number in a cell, NaN where it is empty or says that it is missing, None where it holds something else."""
    text = text.strip()
    if decimal == ",":
        text = text.translate(SWAPPED)
    for read in (float, _spelled_number):
        with suppress(ValueError):
            return read(text)
    return float("nan") if text.lower() in MISSING_TEXT else None


def _spelled_number(text: str) -> float:
    """Of thousands with marks between, or with the exponent of Fortran."""
    marked = text.translate(MARKS)
    if GROUPED.fullmatch(marked):
        return float(marked.replace(",", ""))
    return float(re.sub(r"(?<=[\d.])[dD](?=[+-]?\d)", "e", text))


def as_clock(text: str) -> float | None:
    """Seconds in hours:minutes:seconds or minutes:seconds; None where it is no such time."""
    found = CLOCK.fullmatch(text.strip())
    if found is None:
        return None
    hours, minutes, seconds = found.groups(default="0")
    size = 3600.0 * float(hours) + 60.0 * float(minutes) + float(seconds.replace(",", "."))
    return -size if text.strip().startswith("-") else size


def as_date(text: str, form: str | None = None) -> int | None:
    """The date and time in a cell, UTC, in us since 1970; None where it is none. `form` as of strptime."""
    try:
        if form is not None:
            stamp = datetime.strptime(text.strip(), form)
        else:
            day, _, time = re.sub(r"[T ]+", "T", text.strip(), count=1).replace(",", ".").partition("T")
            stamp = datetime.fromisoformat(_iso_day(day) + (f"T{time}" if time else ""))
        stamp = stamp if stamp.tzinfo else stamp.replace(tzinfo=UTC)
        return (stamp - EPOCH) // timedelta(microseconds=1)
    except (ValueError, OverflowError):
        return None


@cache
def _iso_day(day: str) -> str:
    """A day as ISO writes it; raises ValueError."""
    if re.fullmatch(r"\d{4}-\d{3}", day):
        return datetime.strptime(day, "%Y-%j").date().isoformat()
    found = DATE.fullmatch(day)
    if found is None:
        raise ValueError(day)
    a, _, b, c = found.groups()
    if len(a) < 4:
        a, b, c = (c, a, b) if b.isdigit() and int(b) > 12 else (c, b, a)
    form = "%Y-%m-%d" if b.isdigit() else "%Y-%b-%d"
    return datetime.strptime(f"{a}-{b}-{c}", form if len(a) == 4 else form.lower()).date().isoformat()


def _kind(text: str, decimal: str, form: str | None) -> str:
    """Of a cell: number, date, clock, text, or empty."""
    number = as_number(text, decimal)
    if number is not None:
        return "empty" if number != number else "number"
    if as_date(text, form) is not None:
        return "date"
    return "clock" if as_clock(text) is not None else "text"


# ---- The dialect, from the first lines ----


def detect(path: Path, layout: Layout) -> Dialect:
    """The dialect of a text, as far as `layout` leaves it open. Raises FlightRecordError where it is no table."""
    encoding = layout.encoding or _encoding(path)
    with _opened(path, encoding) as lines:
        head = [*islice(lines, HEAD_LINES)]
    bare = [_uncommented(line.rstrip("\r\n")) for line in head]
    stops = np.cumsum((0, *layout.widths)).tolist()
    spans = tuple(zip(stops, stops[1:], strict=False))
    delimiters = (layout.delimiter,) if layout.delimiter else (" ",) if spans else DELIMITERS
    decimals = (layout.decimal,) if layout.decimal else (".", ",")
    split = {delimiter: [_cells(line, delimiter, spans) for line in bare] for delimiter in delimiters}
    tried = {
        (delimiter, decimal): _worth(split[delimiter], decimal, layout.dates)
        for delimiter in delimiters
        for decimal in decimals
    }
    delimiter, decimal = max(tried, key=lambda each: tried[each])
    rows, (worth, width) = split[delimiter], tried[delimiter, decimal]
    if tried.get((delimiter, ","), (0, 0)) == (worth, width) and worth > 0 and decimal == ".":
        _refuse_both_decimals(rows, path)
    kinds = [[_kind(cell, decimal, layout.dates) for cell in cells] for cells in rows]
    columns = _kinds_of_columns([row for row in kinds if len(row) == width])
    numeric = [k for k, kind in enumerate(columns) if kind != "text"]
    first = next((at for at, row in enumerate(kinds) if len(row) == width and _is_data(row, numeric)), None)
    if first is None or worth <= 0:
        texts = [cells for cells in rows if any(cells)]
        if encoding != "utf-8-sig" or len(texts) > 1:
            raise FlightRecordError(
                f"{path}: found a table that cannot be read (no row of numbers in its first {len(head)} lines, as "
                f"{encoding}). Likely cause: another kind of file or encoding. Remedy: give `encoding` in the map, or "
                "save it as UTF-8 csv."
            )
        names = _distinct(texts[0]) if texts else ()
        return Dialect(encoding, delimiter, decimal, names, ("number",) * len(names), len(head))
    above = next((k for k in range(first - 1, -1, -1) if any(rows[k])), 0)
    if not layout.names and delimiter != " " and 1 < len(rows[above]) < width - 1 and {*kinds[above]} == {"text"}:
        raise FlightRecordError(
            f"{path}: line {first + 1}, cell {width}: found {width} cells, expected {len(rows[above])} as the names in "
            f"line {above + 1}: no column is cell {width}. Likely cause: the decimal sign is also the delimiter, or "
            "names are missing. Remedy: write the table with another delimiter, or give `names` in the map."
        )
    names, units = _heading(rows[:first], width, rows[first:])
    if layout.names:
        if len(layout.names) != width:
            raise UsageError(f"{path}: names: got {len(layout.names)}, expected one for each of the {width} columns.")
        units = {new: units[old] for old, new in zip(names, layout.names, strict=True) if old in units}
        names = layout.names
    notes = () if encoding.startswith("utf-8") else (f"{path.name} is read as {encoding}",)
    return Dialect(encoding, delimiter, decimal, names, tuple(columns), first, units, spans, notes)


def _encoding(path: Path) -> str:
    """By its mark, else by zeros between characters, else UTF-8 where it can be, else Latin-1."""
    with path.open("rb") as stream:
        head = stream.read(HEAD_BYTES)
    for mark, encoding in (
        (codecs.BOM_UTF32_LE, "utf-32"),
        (codecs.BOM_UTF16_LE, "utf-16"),
        (codecs.BOM_UTF16_BE, "utf-16"),
    ):
        if head.startswith(mark):
            return encoding
    zeros = [head[start::2].count(0) for start in (0, 1)]
    if max(zeros) > 0.4 * (len(head) // 2):
        return "utf-16-be" if zeros[0] > zeros[1] else "utf-16-le"
    try:
        with path.open(encoding="utf-8", newline="") as text:
            while text.read(LONGEST_LINE):
                pass
    except UnicodeDecodeError:
        return "latin-1"
    return "utf-8-sig"


def _uncommented(line: str) -> str:
    """A line without its mark of comment."""
    mark = next((each for each in COMMENTS if line.startswith(each)), "")
    return line[len(mark) :].lstrip(f"{mark} ") if mark else line


def _cells(line: str, delimiter: str, spans: Spans) -> list[str]:
    if spans:
        return [line[start:stop].strip() for start, stop in spans] if line.strip() else []
    if delimiter == " ":
        return re.split(r"[ \t]+", line.strip(" \t")) if line.strip() else []
    try:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter, skipinitialspace=True), [])]
    except csv.Error:  # a cell without end, which the reading refuses
        return [line]
    except (TypeError, ValueError) as error:
        raise UsageError(f"the delimiter {delimiter!r} cannot be used ({error}). Give another.") from error


def _worth(rows: Sequence[Sequence[str]], decimal: str, form: str | None) -> tuple[int, int]:
    """How many cells are values, less those that are nearly, in rows of the same width; and this width."""
    worth: Counter[int] = Counter()
    sizes = {"empty": 0, "text": 0, "number": 1, "date": 1, "clock": 1}
    for cells in rows:
        for cell in cells if len(cells) > 1 else ():
            kind = _kind(cell, decimal, form)
            worth[len(cells)] += -2 if kind == "text" and re.search(r"\d.*[,;\t| ]|[,;\t| ].*\d", cell) else sizes[kind]
    return max(((size, width) for width, size in worth.items()), default=(0, 0))


def _refuse_both_decimals(rows: Sequence[Sequence[str]], path: Path) -> None:
    """Raise FlightRecordError where commas may part thousands or decimals alike."""
    for number, cells in enumerate(rows, 1):
        for place, cell in enumerate(cells, 1):
            if GROUPED.fullmatch(cell) and "." not in cell:
                raise FlightRecordError(
                    f"{path}: line {number}, cell {place}: found '{cell}', and no cell that shows whether commas part "
                    'thousands or decimals. Remedy: give `decimal` in the map: "." or ",".'
                )


def _kinds_of_columns(rows: Sequence[Sequence[str]]) -> list[str]:
    """What most cells of each column hold that hold a value, where a third of the rows do."""
    kinds = []
    for cells in zip(*rows, strict=True):
        values = Counter(cell for cell in cells if cell not in ("text", "empty"))
        texts = cells.count("text")
        kinds.append(
            values.most_common(1)[0][0] if values and 2 * values.total() >= texts else "text" if texts else "number"
        )
    return kinds


def _is_data(kinds: Sequence[str], numeric: Sequence[int]) -> bool:
    """Whether a row has values, and no text beside them, or few."""
    texts = sum(kinds[k] == "text" for k in numeric)
    values = sum(kinds[k] not in ("text", "empty") for k in numeric)
    return values > 0 and (texts == 0 or 2 * values > len(numeric))


def _heading(
    above: Sequence[Sequence[str]], width: int, data: Sequence[Sequence[str]]
) -> tuple[tuple[str, ...], dict[str, str]]:
    """Names of the columns, and units by name, from the lines above the first row of values."""
    trailing = all(len(cells) < width or not cells[-1] for cells in data)
    rows = []
    for cells in reversed(above):  # a name is missing above an index, or behind the last delimiter
        if len(cells) == width - 1 and width > 2:
            cells = [*cells, ""] if trailing else ["", *cells]
        if len(cells) == width:
            rows.append(cells)
    has_units = len(rows) > 1 and _are_units(rows[0]) and not _are_units(rows[1])
    names = _distinct(rows[has_units] if rows else [""] * width)
    bracketed = {name: re.search(r"[\[(]([^\[\]()]+)[\])]\s*$", name) for name in names}
    units = {name: found.group(1) for name, found in bracketed.items() if found}
    if has_units:
        units |= {name: cell.strip("[]()") for name, cell in zip(names, rows[0], strict=True) if cell}
    return names, units


def _are_units(cells: Sequence[str]) -> bool:
    texts = [cell.strip("[]() ") for cell in cells if cell]
    return bool(texts) and sum(is_unit(spelled(text)) for text in texts) > 0.6 * len(texts)


def _distinct(names: Sequence[str]) -> tuple[str, ...]:
    """Names of which none is empty or stands twice."""
    found: list[str] = []
    for place, name in enumerate(names, 1):
        name = name.strip() or f"column {place}"
        count = sum(each == name or each.startswith(f"{name} #") for each in found)
        found.append(f"{name} #{count + 1}" if count else name)
    return tuple(found)


# ---- The rows ----


class _Lines:
    """The lines of a text, counted, as long as all values together stay within the budget."""

    def __init__(self, stream: TextIO, path: Path) -> None:
        self._stream, self._path = stream, path
        self.number = 0

    def __iter__(self) -> Iterator[str]:
        read = 0
        while line := self._stream.readline(LONGEST_LINE):
            read += len(line)
            self.number += 1
            if len(line) == LONGEST_LINE or read > READ_BUDGET * 4:  # a value of 8 bytes takes 32 characters at most
                raise FlightRecordError(
                    f"{self._path}: found {'a line' if len(line) == LONGEST_LINE else 'a table'} of more than "
                    f"{read >> 20} MB, expected a table of samples, one a line. Likely cause: another kind of file. "
                    "Remedy: cut it into flights, or lower the sample rate."
                )
            yield line


@contextmanager
def _opened(path: Path, encoding: str) -> Iterator[_Lines]:
    """The lines of a file; whatever the text and csv readers raise becomes one refusal."""
    try:
        with path.open(newline="", encoding=encoding) as stream:
            yield _Lines(stream, path)
    except (UnicodeError, csv.Error, OSError) as error:
        raise FlightRecordError(
            f"{path}: found a table that cannot be read ({one_line(str(error))}). Save it as UTF-8 csv."
        ) from error
    except LookupError as error:
        raise UsageError(f"{path}: the encoding '{encoding}' is not known. Give another in the map.") from error


def read_text(path: Path, names: tuple[str, ...], layout: Layout, dialect: Dialect | None = None) -> ColumnTable:
    """The columns `names` of a text table, of a dialect that is known or found."""
    found = dialect or detect(path, layout)
    check_columns((*names, *layout.where), found.names, path)
    places = {name: found.names.index(name) for name in names}
    parsers = {name: _parser(found.kinds[place], found.decimal, layout.dates) for name, place in places.items()}
    kept = {found.names.index(name): _parser_of(value) for name, value in layout.where.items()}
    columns: dict[str, Any] = {
        name: array("q" if found.kinds[place] == "date" else "d") for name, place in places.items()
    }
    numbers = array("q")
    with _opened(path, found.encoding) as lines:
        for row in _rows(lines, found) if names else ():
            if any(row[len(found.names) :]):
                raise FlightRecordError(
                    f"{path}: line {lines.number}, cell {len(row)}: found {len(row)} cells, expected {len(found.names)} "
                    "as there are names. Likely cause: the decimal sign is also the delimiter, or a name is missing. "
                    "Remedy: write the table with another delimiter, or give `names` in the map."
                )
            if kept and not all(place < len(row) and is_kept(row[place]) for place, is_kept in kept.items()):
                continue
            numbers.append(lines.number)
            for name, place in places.items():
                text = row[place] if place < len(row) else ""
                value = parsers[name](text)
                if value is None:
                    raise FlightRecordError(
                        f"{path}: dataset '{one_line(name)}': line {lines.number}, cell {place + 1}: found "
                        f"'{one_line(text.strip())}', expected a {found.kinds[place]}, or an empty cell where a sample "
                        "is missing. Likely cause: a damaged line, a remark or another record below the table, or "
                        f"another decimal sign than '{found.decimal}'. Remedy: remove the line (one that starts with # "
                        "is skipped), or give `decimal`, `delimiter`, `widths` or `dates` in the map."
                    )
                columns[name].append(value)
    arrays = {name: np.array(values) for name, values in columns.items()}
    arrays = {name: values.view("M8[us]") if values.dtype.kind == "i" else values for name, values in arrays.items()}
    stamps = tuple(name for name, place in places.items() if found.kinds[place] == "clock")
    return ColumnTable(arrays, found.names, found.units, found.notes, np.array(numbers), stamps, found.delimiter)


def _rows(lines: _Lines, found: Dialect) -> Iterator[list[str]]:
    """The cells of each row of values: no lines that are empty or a comment."""
    kept = (line for line in islice(lines, found.first, None) if not line.startswith(("#", "%")) and line.strip())
    if found.spans or found.delimiter == " ":
        return (_cells(line.rstrip("\r\n"), found.delimiter, found.spans) for line in kept)
    return csv.reader(kept, delimiter=found.delimiter, skipinitialspace=True)


def _parser(kind: str, decimal: str, form: str | None) -> Callable[[str], float | None]:
    """What reads the cells of a column; None for what is none of its kind."""

    def date_or_clock(text: str) -> float | None:
        value = as_date(text, form) if kind == "date" else as_clock(text)
        if value is None and text.strip().lower() in MISSING_TEXT:
            return NOT_A_TIME if kind == "date" else float("nan")
        return value

    def number(text: str) -> float | None:
        try:
            return float(text) if decimal == "." else as_number(text, decimal)
        except ValueError:
            return as_number(text, decimal)

    return date_or_clock if kind in ("date", "clock") else number


def _parser_of(value: str | float) -> Callable[[str], bool]:
    """Whether a cell holds the value of `where`."""
    return lambda text: text.strip() == value or (isinstance(value, float) and as_number(text, ".") == value)


FORMATS = (TableFormat("text", read_text, (".csv",), lambda path, head: path.suffix.lower() in TEXT_ENDINGS),)
