"""Text tables of any dialect: found from the first lines, then read by pandas. Entrances: `detect`, `read_text`.

Found are the encoding, the delimiter and decimal sign that make most cells values, the names above the first row of
values (behind a comment mark or not), and units in a row below them or in brackets. A value is a number, with marks
between thousands or not, a date or a time of day. Dates without a zone are UTC; in doubt the day is before the month.
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
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from brv_hypo.errors import UsageError
from brv_hypo.flight.units import is_unit, spelled
from brv_hypo.importing.formats import Layout, TableFormat, check_columns
from brv_hypo.io.binary import ColumnTable
from brv_hypo.io.sandbox import READ_BUDGET
from brv_hypo.io.text import refused

MISSING = ("", "NA", "N/A", "na", "n/a", "#N/A", "NaN", "nan", "NULL", "null", "None", "none", "-", "--", "---")
LONGEST_LINE = 1 << 20  # characters; 14 channels need 300
HEAD_LINES = 100  # from which the dialect is found
DELIMITERS = ",;\t| "  # a blank: any number of blanks
TEXT_ENDINGS = (".txt", ".tsv", ".dat", ".tab", ".asc", ".log")
MARKS = dict.fromkeys(map(ord, "\u00a0\u2009\u202f\u2019'"))  # between thousands, beside comma, point and blank
FORTRAN = re.compile(r"(?<=[\d.])[dD](?=[+-]\d)")  # its exponent, 1.0D+03
TORN = re.compile(r"(?=\D*\d)[^,;\t| ]*[,;\t| ]")  # a value and more
BLANKS = re.compile(r"(?<=\d) (?=\d{3}(\D|$))")  # between thousands, where blanks are not between columns
KINDS = {
    "number": re.compile(r"[+-]?(?=[.\d])([1-9]\d{0,2}(,\d{3})+|\d*)(\.\d*)?(e[+-]?\d+)?|[+-]?inf", re.IGNORECASE),
    "date": re.compile(r"(\d{4}-\d{3}|\d{1,4}([-/.])(\d{1,2}|[A-Za-z]{3})\2\d{1,4})([T ]+\d.*)?"),
    "clock": re.compile(r"[+-]?(\d+:)?\d{1,2}:\d{1,2}([.,]\d*)?"),
}


@dataclass(frozen=True)
class Dialect:
    """How a text table is written: `kinds` of its columns, lines before the `first` of values, `spans` of columns."""

    encoding: str
    delimiter: str
    decimal: str
    names: tuple[str, ...]
    kinds: tuple[str, ...]
    first: int
    units: Mapping[str, str] = field(default_factory=dict)
    spans: tuple[tuple[int, int], ...] = ()
    thousands: str | None = None


def detect(path: Path, layout: Layout) -> Dialect:
    """The dialect of a text, as far as `layout` leaves it open. Raises FlightRecordError where it is no table."""
    text, encoding = _lines(path, layout.encoding)
    head = [re.sub(r"^(#|%|//|!)+ *", "", line) for line in text[:HEAD_LINES]]
    spans = tuple(pairwise(np.cumsum((0, *layout.widths)).tolist()))
    tried = {}
    present = [each for each in DELIMITERS if any(each in line for line in head)] or [","]
    for delimiter in (layout.delimiter,) if layout.delimiter else " " if spans else present:
        rows = [_cells(line, delimiter, spans) for line in head]
        for decimal in layout.decimal or ".,":
            kinds = [[_kind(cell, decimal, layout.dates) for cell in cells] for cells in rows]
            tried[delimiter, decimal] = (*_worth(rows, kinds), rows, kinds)
    delimiter, decimal = max(tried, key=lambda each: tried[each][:2])
    worth, width, rows, kinds = tried[delimiter, decimal]
    columns = [Counter(row[k] for row in kinds if len(row) == width and row[k] != "empty") for k in range(width)]
    most = tuple(max({"number": 0, **each}, key=lambda kind: each[kind]) for each in columns)
    numeric = [k for k in range(width) if most[k] != "text"]
    found = [[row[k] for k in numeric] if len(row) == width else [] for row in kinds]
    values = [sum(kind in KINDS for kind in row) for row in found]
    # No text beside them, or little, is in a row of data.
    first = next((k for k, n in enumerate(values) if n and ("text" not in found[k] or 2 * n > len(numeric))), None)
    if first is None or worth <= 0:
        texts = [cells for cells in rows if any(cells)]
        if encoding != "utf-8-sig" or len(texts) > 1:
            got = f"a table that cannot be read (no row of numbers in {len(head)} lines, as {encoding})"
            raise refused(str(path), got, "a table", "another kind of file", "give `encoding` in the map")
        names = _distinct(texts[0]) if texts else ()
        return Dialect(encoding, delimiter, decimal, names, ("number",) * len(names), len(head))
    mark = "," if decimal == "." else "."
    numbers = ((k, j) for k in range(first, len(rows)) for j, kind in enumerate(kinds[k]) if kind == "number")
    marked = next(((k, j) for k, j in numbers if mark in rows[k][j]), None)
    if marked and decimal == "." and tried.get((delimiter, ","), (0,))[0] == worth:
        place = f"{path}: line {marked[0] + 1}, cell {marked[1] + 1}"
        got = f"'{rows[marked[0]][marked[1]]}', and no cell that shows whether commas part thousands or decimals"
        remedy = 'give `decimal` in the map: "." or ","'
        raise refused(place, got, "one meaning", "numbers of three decimals", remedy)
    above = next((k for k in range(first - 1, -1, -1) if any(rows[k])), 0)
    count = len(layout.names or rows[above])
    if layout.names and count != width:
        raise UsageError(f"{path}: names: got {count}, expected one for each of the {width} columns.")
    if delimiter != " " and 1 < count < width - 1 and {*kinds[above]} == {"text"}:
        place = f"{path}: line {first + 1}, cell {width}"
        expected = f"{count} as in line {above + 1}: no column is this"
        cause = "the decimal sign is also the delimiter, or names are missing"
        raise refused(place, f"{width} cells", expected, cause, "take another delimiter, or give `names` in the map")
    names, units = _heading(rows[:first], rows[first:], width)
    names, thousands = layout.names or names, mark if marked else None
    return Dialect(encoding, delimiter, decimal, names, most, first, units, spans, thousands)


def _lines(path: Path, encoding: str | None) -> tuple[list[str], str]:
    """The lines of a text and its encoding: as given, by its mark or the zeros in it, else UTF-8, else Latin-1."""
    if path.stat().st_size > 4 * READ_BUDGET:  # a value of 8 bytes takes 32 characters at most
        raise refused(str(path), f"more than {READ_BUDGET >> 18} MB", "a flight", "many flights", "cut it into flights")
    try:
        codecs.lookup(encoding or "ascii")
    except (LookupError, ValueError) as error:
        raise UsageError(f"{path}: the encoding '{encoding}' is not known. Give another in the map.") from error
    raw = path.read_bytes()
    zeros = [raw[start : 1 << 14 : 2].count(0) > 0.2 * len(raw[: 1 << 14]) for start in (0, 1)]
    marked = raw.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    found = "utf-16" if marked else "utf-16-be" if zeros[0] else "utf-16-le" if zeros[1] else None
    for each in (encoding or found,) if encoding or found else ("utf-8-sig", "latin-1"):
        with suppress(UnicodeError):
            plain = FORTRAN.sub("e", raw.decode(each or "").translate(MARKS))
            lines = re.split(r"\r\n|\r|\n", plain)
            if max(map(len, lines)) > LONGEST_LINE:
                raise refused(str(path), "a line of more than 1 MB", "a table", "another kind of file", "convert it")
            return lines, str(each)
    raise refused(str(path), "a table that cannot be read in its encoding", "text", "damage", "save it as UTF-8 csv")


def _cells(line: str, delimiter: str, spans: Sequence[tuple[int, int]]) -> list[str]:
    if spans or delimiter == " ":
        return [line[start:stop].strip() for start, stop in spans if line.strip()] or line.split()
    try:
        cells = next(csv.reader([BLANKS.sub("", line)], delimiter=delimiter, skipinitialspace=True), [])
        return [cell.strip() for cell in cells]
    except csv.Error:  # a cell without end, which the reading refuses
        return [line]
    except (TypeError, ValueError) as error:
        raise UsageError(f"the delimiter {delimiter!r} cannot be used ({error}). Give another.") from error


@lru_cache(maxsize=1 << 16)
def _kind(cell: str, decimal: str, form: str | None) -> str:
    """Of a cell: number, date, clock, text or empty."""
    if form is not None:
        with suppress(ValueError):
            return "date" if datetime.strptime(cell, form) else ""
    number = cell.translate(str.maketrans(",.", ".,")) if decimal == "," else cell
    fitting = (kind for kind, each in KINDS.items() if each.fullmatch(number if kind == "number" else cell))
    return "empty" if cell in MISSING else next(fitting, "text")


def _worth(rows: Sequence[Sequence[str]], kinds: Sequence[Sequence[str]]) -> tuple[int, int]:
    """How many cells are values, less those that hold one and more, in rows of the same width; and this width."""
    worth: Counter[int] = Counter()
    for cells, row in zip(rows, kinds, strict=True):
        torn = sum(kind == "text" and bool(TORN.match(cell)) for cell, kind in zip(cells, row, strict=True))
        worth[len(cells)] += sum(kind in KINDS for kind in row) - 2 * torn
    return max(((size, width) for width, size in worth.items() if width > 1), default=(0, 0))


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
    units = {name: found[1] for name in names if (found := re.search(r"[\[(]([^\[\]()]+)[\])]\s*$", name))}
    return names, units | ({n: u.strip("[]()") for n, u in zip(names, rows[0], strict=True) if u} if has_units else {})


def _are_units(cells: Sequence[str]) -> bool:
    texts = [cell.strip("[]() ") for cell in cells if cell]
    return sum(is_unit(spelled(text)) for text in texts) > 0.6 * len(texts)


def _distinct(names: Sequence[str]) -> tuple[str, ...]:
    """Names of which none is empty or repeated."""
    known = [name or f"column {place}" for place, name in enumerate(names, 1)]
    before = [known[:k].count(name) for k, name in enumerate(known)]
    return tuple(f"{name} #{k + 1}" if k else name for name, k in zip(known, before, strict=True))


def read_text(path: Path, names: tuple[str, ...] | None, layout: Layout, dialect: Dialect | None = None) -> ColumnTable:
    """The columns `names` of a text table, None: all but texts; of a dialect that is known or found."""
    import pandas as pd

    found, numbers_only = dialect or detect(path, layout), names is None
    names = found.names if names is None else names
    check_columns(names, found.names, path)
    lines, _ = _lines(path, found.encoding)
    numbers = [k for k in range(found.first, len(lines)) if lines[k].strip() and not lines[k].startswith(("#", "%"))]
    notes = () if found.encoding.startswith("utf-8") else (f"{path.name} is read as {found.encoding}",)
    table = ColumnTable({}, found.names, found.units, notes, np.array(numbers) + 1, (), found.delimiter)
    if not names:
        return table
    how: dict[str, Any] = {"header": None, "names": range(len(found.names)), "na_values": [*MISSING]}
    how |= {"decimal": found.decimal, "thousands": found.thousands}
    exact: dict[str, Any] = {"low_memory": False, "skipinitialspace": True, "float_precision": "round_trip"}
    blanks = found.delimiter == " "
    text = io.StringIO("\n".join(lines[k] if blanks else BLANKS.sub("", lines[k]) for k in numbers))
    cause, remedy = "a damaged line, a remark or another record in the table", "remove the line, or give `delimiter`"
    with warnings.catch_warnings(action="ignore"):
        try:
            if found.spans:
                frame = pd.read_fwf(text, colspecs=[*found.spans], **how)
            else:
                separator = r"\s+" if blanks else found.delimiter
                frame = pd.read_csv(text, sep=separator, **exact, **how)
        except (ValueError, OverflowError) as error:  # of the parser
            at = re.search(r"line (\d+), saw (\d+)", str(error))
            place = f"{path}: line {numbers[int(at[1]) - 1] + 1}, cell {at[2]}" if at else str(path)
            got = f"a table that cannot be read ({error})"
            raise refused(place, got, f"{len(found.names)} cells in a line", cause, remedy) from error
        places = {name: found.names.index(name) for name in names}
        columns = {name: _values(frame[k], found.kinds[k], name in layout.where, layout) for name, k in places.items()}
    for name, k in places.items():
        bad = np.flatnonzero(frame[k].notna() & pd.isna(columns[name]))
        if bad.size and numbers_only:
            del columns[name]
        elif bad.size:
            place = f"{path}: dataset '{name}': line {numbers[bad[0]] + 1}, cell {k + 1}"
            remedy += ", `decimal`, `widths` or `dates` in the map (a line that starts with # is skipped)"
            got = f"'{str(frame[k].iloc[bad[0]]).strip()}'"
            raise refused(place, got, f"a {found.kinds[k]}, or an empty cell for a missing sample", cause, remedy)
    return replace(table, columns=columns, stamps=tuple(n for n in columns if found.kinds[places[n]] == "clock"))


def _values(cells: Any, kind: str, is_name: bool, layout: Layout) -> Any:
    """The values of a column's cells; missing where they are of another kind."""
    import pandas as pd

    if kind == "text" and is_name:
        return cells.fillna("").astype(str).to_numpy(dtype=np.str_)
    if kind in ("clock", "date"):
        cells = cells.astype("string")
    if kind == "clock":
        whole = cells.where(cells.str.count(":") > 1, "00:" + cells).str.replace(",", ".")
        return pd.to_timedelta(whole, errors="coerce").dt.total_seconds().to_numpy()
    if kind == "date":
        whole = cells if layout.dates else cells.str.replace(",", ".")
        for form in (layout.dates,) if layout.dates else ("%Y-%jT%H:%M:%S.%f", "ISO8601", None, "mixed"):
            dates = pd.to_datetime(whole, format=form, dayfirst=form in (None, "mixed"), utc=True, errors="coerce")
            if dates.notna().sum() == cells.notna().sum():
                break
        return dates.dt.tz_localize(None).to_numpy(dtype="M8[ns]")
    return pd.to_numeric(cells, errors="coerce").to_numpy(dtype=float)


FORMATS = (TableFormat("text", read_text, (".csv",), lambda path, head: path.suffix.lower() in TEXT_ENDINGS, True),)
