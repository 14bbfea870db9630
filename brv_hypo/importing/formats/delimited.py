"""Text tables of any dialect: found from the first lines, then read by pandas. Entrances: `detect`, `read_text`.

Found are the encoding, the delimiter and decimal sign that make most cells values, the row of names above the first row
of values (behind a comment mark or not), and units in a row below the names or in brackets behind each. A value is a
number, with or without marks between thousands, a date or a time of day. Dates without a zone are UTC; where day and
month cannot be told apart, the day is first.
"""

from __future__ import annotations

import codecs
import csv
import io
import re
import warnings
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from datetime import datetime
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from brv_hypo.errors import FlightRecordError, UsageError
from brv_hypo.flight.units import is_unit, spelled
from brv_hypo.importing.formats import Layout, TableFormat, check_columns
from brv_hypo.io.binary import ColumnTable
from brv_hypo.io.sandbox import READ_BUDGET
from brv_hypo.io.text import one_line

MISSING = ("", "NA", "N/A", "na", "n/a", "#N/A", "NaN", "nan", "NULL", "null", "None", "none", "-", "--", "---")
LONGEST_LINE = 1 << 20  # characters; 14 channels need 300
HEAD_LINES = 300  # from which the dialect is found
DELIMITERS = (",", ";", "\t", "|", " ")  # a blank: any number of blanks
TEXT_ENDINGS = (".txt", ".tsv", ".dat", ".tab", ".asc", ".log")
MARKS = dict.fromkeys(map(ord, "\u00a0\u2009\u202f\u2019'"))  # between thousands, beside comma, point and blank
SWAPPED = str.maketrans(",.", ".,")
NUMBER = re.compile(
    r"[+-]?(?=[.\d])(?:[1-9]\d{0,2}(?:([, ])\d{3})(?:\1\d{3})*|\d*)(?:\.\d*)?(?:[eE][+-]?\d+)?|[+-]?inf"
)
CLOCK = re.compile(r"[+-]?(\d+:)?\d{1,2}:\d{1,2}([.,]\d*)?")
DATE = re.compile(r"(\d{4}-\d{3}|\d{1,4}([-/.])(\d{1,2}|[A-Za-z]{3})\2\d{1,4})([T ]+\d.*)?")


@dataclass(frozen=True)
class Dialect:
    """How a text table is written; `kinds` of its columns are number, date, clock (a time of day) or text."""

    encoding: str
    delimiter: str
    decimal: str
    names: tuple[str, ...]
    kinds: tuple[str, ...]
    first: int
    """Lines before the first row of values."""
    units: Mapping[str, str] = field(default_factory=dict)
    spans: tuple[tuple[int, int], ...] = ()
    """First and last place of each column, where nothing is between them."""
    thousands: str | None = None


def detect(path: Path, layout: Layout) -> Dialect:
    """The dialect of a text, as far as `layout` leaves it open. Raises FlightRecordError where it is no table."""
    text, encoding = _lines(path, layout.encoding)
    head = [re.sub(r"^(#|%|//|!)+ *", "", line) for line in text[:HEAD_LINES]]
    spans = tuple(pairwise(np.cumsum((0, *layout.widths)).tolist()))
    tried = {}
    for delimiter in (layout.delimiter,) if layout.delimiter else (" ",) if spans else DELIMITERS:
        rows = [_cells(line, delimiter, spans) for line in head]
        for decimal in layout.decimal or ".,":
            kinds = [[_kind(cell, decimal, layout.dates) for cell in cells] for cells in rows]
            tried[delimiter, decimal] = (*_worth(rows, kinds), rows, kinds)
    delimiter, decimal = max(tried, key=lambda each: tried[each][:2])
    worth, width, rows, kinds = tried[delimiter, decimal]
    columns = [_most([row[k] for row in kinds if len(row) == width]) for k in range(width)]
    numeric = [k for k, kind in enumerate(columns) if kind != "text"]
    first = next((at for at, row in enumerate(kinds) if len(row) == width and _is_data(row, numeric)), None)
    if first is None or worth <= 0:
        texts = [cells for cells in rows if any(cells)]
        if encoding != "utf-8-sig" or len(texts) > 1:
            raise FlightRecordError(
                f"{path}: found a table that cannot be read (no row of numbers in its first {len(head)} lines, as "
                f"{encoding}). Likely cause: another kind of file or encoding. Remedy: give `encoding` in the map."
            )
        names = _distinct(texts[0]) if texts else ()
        return Dialect(encoding, delimiter, decimal, names, ("number",) * len(names), len(head))
    cells = [(at, place, cell) for at in range(first, len(rows)) for place, cell in enumerate(rows[at], 1)]
    marked = next(
        (
            each
            for each in cells
            if (mark := NUMBER.fullmatch(each[2].translate(SWAPPED) if decimal == "," else each[2])) and mark.group(1)
        ),
        None,
    )
    if marked and decimal == "." and tried.get((delimiter, ","), (0,))[0] == worth:
        raise FlightRecordError(
            f"{path}: line {marked[0] + 1}, cell {marked[1]}: found '{marked[2]}', and no cell that shows whether commas "
            'part thousands or decimals. Remedy: give `decimal` in the map: "." or ",".'
        )
    thousands = None if marked is None else " " if " " in marked[2] else "," if decimal == "." else "."
    above = next((k for k in range(first - 1, -1, -1) if any(rows[k])), 0)
    if not layout.names and delimiter != " " and 1 < len(rows[above]) < width - 1 and {*kinds[above]} == {"text"}:
        raise FlightRecordError(
            f"{path}: line {first + 1}, cell {width}: found {width} cells, expected {len(rows[above])} as the names in "
            f"line {above + 1}: no column is cell {width}. Likely cause: the decimal sign is also the delimiter, or "
            "names are missing. Remedy: write the table with another delimiter, or give `names` in the map."
        )
    if layout.names and len(layout.names) != width:
        raise UsageError(f"{path}: names: got {len(layout.names)}, expected one for each of the {width} columns.")
    names, units = _heading(rows[:first], rows[first:], width)
    return Dialect(encoding, delimiter, decimal, layout.names or names, tuple(columns), first, units, spans, thousands)


def _lines(path: Path, encoding: str | None) -> tuple[list[str], str]:
    """The lines of a text and its encoding: as given, by its mark or the zeros in it, else UTF-8, else Latin-1."""
    if path.stat().st_size > 4 * READ_BUDGET:  # a value of 8 bytes takes 32 characters at most
        raise FlightRecordError(
            f"{path}: found a table of more than {READ_BUDGET >> 18} MB. Remedy: cut it into flights."
        )
    raw = path.read_bytes()
    zeros = [raw[start : 1 << 14 : 2].count(0) > 0.4 * len(raw[: 1 << 14]) / 2 for start in (0, 1)]
    if encoding is None and raw.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        encoding = "utf-16"
    tried = (
        (encoding,)
        if encoding
        else ("utf-16-be",)
        if zeros[0]
        else ("utf-16-le",)
        if zeros[1]
        else ("utf-8-sig", "latin-1")
    )
    for each in tried:
        try:
            plain = re.sub(r"(?<=[\d.])[dD](?=[+-]\d)", "e", raw.decode(each).translate(MARKS))  # as Fortran writes it
            lines = re.split(r"\r\n|\r|\n", plain)
        except LookupError as error:
            raise UsageError(f"{path}: the encoding '{encoding}' is not known. Give another in the map.") from error
        except UnicodeError:
            continue
        if max(map(len, lines)) > LONGEST_LINE:
            raise FlightRecordError(f"{path}: found a line of more than 1 MB. Likely cause: another kind of file.")
        return lines, each
    raise FlightRecordError(f"{path}: found a table that cannot be read as {tried[0]}. Save it as UTF-8 csv.")


def _cells(line: str, delimiter: str, spans: Sequence[tuple[int, int]]) -> list[str]:
    if spans or delimiter == " ":
        return [line[start:stop].strip() for start, stop in spans if line.strip()] or line.split()
    try:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter, skipinitialspace=True), [])]
    except csv.Error:  # a cell without end, which the reading refuses
        return [line]
    except (TypeError, ValueError) as error:
        raise UsageError(f"the delimiter {delimiter!r} cannot be used ({error}). Give another.") from error


def _kind(cell: str, decimal: str, form: str | None) -> str:
    """Of a cell: number, date, clock, text or empty."""
    if form is not None:
        with suppress(ValueError):
            datetime.strptime(cell, form)
            return "date"
    if cell in MISSING:
        return "empty"
    patterns = {"number": NUMBER, "date": DATE, "clock": CLOCK}
    spelled_cell = cell.translate(SWAPPED) if decimal == "," else cell
    return next(
        (kind for kind, each in patterns.items() if each.fullmatch(spelled_cell if each is NUMBER else cell)), "text"
    )


def _worth(rows: Sequence[Sequence[str]], kinds: Sequence[Sequence[str]]) -> tuple[int, int]:
    """How many cells are values, less those that hold one and more, in rows of the same width; and this width."""
    worth: Counter[int] = Counter()
    for cells, row in zip(rows, kinds, strict=True):
        torn = [bool(re.search(r"\d.*[,;\t| ]|[,;\t| ].*\d", cell)) for cell in cells]
        worth[len(cells)] += sum(
            -2 * more if kind == "text" else kind != "empty" for kind, more in zip(row, torn, strict=True)
        )
    return max(((size, width) for width, size in worth.items() if width > 1), default=(0, 0))


def _most(cells: Sequence[str]) -> str:
    """What a column holds, by its cells: what half of those hold that hold anything."""
    values = Counter(cell for cell in cells if cell not in ("text", "empty"))
    texts = cells.count("text")
    return values.most_common(1)[0][0] if values and 2 * values.total() >= texts else "text" if texts else "number"


def _is_data(kinds: Sequence[str], numeric: Sequence[int]) -> bool:
    """Whether a row has values, and no text beside them, or few."""
    texts = sum(kinds[k] == "text" for k in numeric)
    values = sum(kinds[k] not in ("text", "empty") for k in numeric)
    return values > 0 and (texts == 0 or 2 * values > len(numeric))


def _heading(above: Any, data: Any, width: int) -> tuple[tuple[str, ...], dict[str, str]]:
    """Names of the columns, and units by name, from the lines above the first row of values."""
    trailing = all(len(cells) < width or not cells[-1] for cells in data)
    rows = []
    for cells in reversed(above):  # a name is missing above an index, or behind the last delimiter
        if len(cells) == width - 1 > 1:
            cells = [*cells, ""] if trailing else ["", *cells]
        rows += [cells] if len(cells) == width else []
    has_units = len(rows) > 1 and _are_units(rows[0]) and not _are_units(rows[1])
    names = _distinct(rows[has_units] if rows else [""] * width)
    units = {name: found.group(1) for name in names if (found := re.search(r"[\[(]([^\[\]()]+)[\])]\s*$", name))}
    return names, units | ({n: u.strip("[]()") for n, u in zip(names, rows[0], strict=True) if u} if has_units else {})


def _are_units(cells: Sequence[str]) -> bool:
    texts = [cell.strip("[]() ") for cell in cells if cell]
    return sum(is_unit(spelled(text)) for text in texts) > 0.6 * len(texts)


def _distinct(names: Sequence[str]) -> tuple[str, ...]:
    """Names of which none is empty or stands twice."""
    found: list[str] = []
    for place, name in enumerate(names, 1):
        twice = names[: place - 1].count(name)
        found.append((f"{name} #{twice + 1}" if twice else name) if name else f"column {place}")
    return tuple(found)


def read_text(path: Path, names: tuple[str, ...], layout: Layout, dialect: Dialect | None = None) -> ColumnTable:
    """The columns `names` of a text table, of a dialect that is known or found."""
    import pandas as pd

    found = dialect or detect(path, layout)
    check_columns(names, found.names, path)
    lines, _ = _lines(path, found.encoding)
    numbers = [k for k in range(found.first, len(lines)) if lines[k].strip() and not lines[k].startswith(("#", "%"))]
    notes = () if found.encoding.startswith("utf-8") else (f"{path.name} is read as {found.encoding}",)
    table = ColumnTable({}, found.names, found.units, notes, np.array(numbers) + 1, (), found.delimiter)
    if not names:
        return table
    places = {name: found.names.index(name) for name in names}
    given: dict[str, Any] = {"header": None, "names": range(len(found.names)), "na_values": [*MISSING]}
    given |= {"decimal": found.decimal, "thousands": found.thousands}
    text = io.StringIO("\n".join(lines[k] for k in numbers))
    with warnings.catch_warnings(action="ignore"):
        try:
            if found.spans:
                frame = pd.read_fwf(text, colspecs=[*found.spans], **given)
            else:
                separator = r"\s+" if found.delimiter == " " else found.delimiter
                frame = pd.read_csv(text, sep=separator, low_memory=False, skipinitialspace=True, **given)
        except (ValueError, OverflowError) as error:  # of the parser
            at = re.search(r"line (\d+), saw (\d+)", str(error))
            place = f"line {numbers[int(at[1]) - 1] + 1}, cell {at[2]}: " if at else ""
            raise FlightRecordError(
                f"{path}: {place}found a table that cannot be read ({one_line(str(error))}). Likely cause: a quotation mark "
                "without its second, or another delimiter. Remedy: correct the line, or give `delimiter` in the map."
            ) from error
        columns = {
            name: _converted(frame[place], found.kinds[place], name in layout.where, layout)
            for name, place in places.items()
        }
    for name, place in places.items():
        bad = np.flatnonzero(frame[place].notna() & pd.isna(columns[name]))
        if bad.size:
            cell = frame[place].iloc[bad[0]]
            raise FlightRecordError(
                f"{path}: dataset '{one_line(name)}': line {numbers[bad[0]] + 1}, cell {place + 1}: found '{one_line(str(cell))}', "
                f"expected a {found.kinds[place]}. Likely cause: a damaged line, a remark "
                f"or another record in the table, or another decimal sign than '{found.decimal}'. Remedy: remove the line "
                "(one that starts with # is skipped), or give `decimal`, `delimiter`, `widths` or `dates` in the map."
            )
    stamps = tuple(name for name, place in places.items() if found.kinds[place] == "clock")
    return replace(table, columns=columns, stamps=stamps)


def _converted(cells: Any, kind: str, as_text: bool, layout: Layout) -> Any:
    """The values of a column's cells; missing where they are of another kind."""
    import pandas as pd

    if kind == "text" and as_text:
        return cells.fillna("").astype(str).to_numpy(dtype=np.str_)
    if kind == "clock":
        whole = cells.where(cells.str.count(":") > 1, "00:" + cells).str.replace(",", ".")
        return pd.to_timedelta(whole, errors="coerce").dt.total_seconds().to_numpy()
    if kind == "date":
        whole = cells if layout.dates else cells.str.replace(",", ".")
        for form in (layout.dates,) if layout.dates else ("%Y-%jT%H:%M:%S.%f", "ISO8601", "mixed"):
            dates = pd.to_datetime(whole, format=form, dayfirst=form == "mixed", utc=True, errors="coerce")
            if dates.notna().sum() == cells.notna().sum():
                break
        return dates.dt.tz_localize(None).to_numpy(dtype="M8[ns]")
    return pd.to_numeric(cells, errors="coerce").to_numpy(dtype=float)


FORMATS = (TableFormat("text", read_text, (".csv",), lambda path, head: path.suffix.lower() in TEXT_ENDINGS),)
