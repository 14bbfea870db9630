"""Tables of the Planetary Data System, version 3: fixed columns of characters, described by a label.

The label is a file of its own (.lbl beside the table; either may be given) or begins the table. Layout: Planetary Data
System Standards Reference, version 3.8, appendix A.29 TABLE and A.8 COLUMN, and chapter 12 on the language of labels
(https://pds.nasa.gov/datastandards/pds3/standards/).
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from brv_hypo.errors import FlightRecordError
from brv_hypo.importing.formats import Layout, TableFormat
from brv_hypo.importing.formats.delimited import Dialect, read_text
from brv_hypo.io.binary import ColumnTable
from brv_hypo.io.files import check_regular
from brv_hypo.io.text import one_line

LONGEST_LABEL = 1 << 20  # bytes
STATEMENT = re.compile(r'^[ \t]*(\^?\w+)[ \t]*=[ \t]*("[^"]*"|\([^)]*\)|[^\r\n]*)', re.MULTILINE)
UNITS = {"SECOND": "s", "SECONDS": "s", "GRAVITY": "g", "METER": "m", "METERS": "m", "KILOMETER": "km", "N/A": ""}


def recognises(path: Path, head: str) -> bool:
    """Whether the file is a label, begins with one, or has one beside it."""
    return "PDS_VERSION_ID" in head[:2000] or (path.suffix.lower() == ".tab" and _label_beside(path) is not None)


def read(path: Path, names: tuple[str, ...], layout: Layout) -> ColumnTable:
    """The columns `names` of the table that a label describes; the label's constants for missing values are NaN."""
    beside = _label_beside(path) if path.suffix.lower() == ".tab" else None
    label = path if beside is None else beside
    with label.open("rb") as stream:
        text = stream.read(LONGEST_LABEL).decode("latin-1")
    columns = [*_columns(text)]
    place = re.search(r"^[ \t]*\^\w*TABLE[ \t]*=[ \t]*(.*)$", text, re.MULTILINE)
    named = place and re.search(r'"([^"]+)"', place.group(1))
    table = _beside(label, named.group(1)) if named else label
    record = re.search(r",\s*(\d+)\s*\)\s*$", place.group(1)) if place else None
    end = re.search(r"^\s*END\s*$", text, re.MULTILINE)
    if not columns or table is None or re.search(r"INTERCHANGE_FORMAT\s*=\s*\"?BINARY", text):
        raise FlightRecordError(
            f"{label}: found {len(columns)} columns and the table {one_line(place.group(1)) if place else '(none)'}, "
            "expected the label of a table of characters and the table beside it. Likely cause: a binary table, "
            "columns in a file of their own (^STRUCTURE), or a label without its table. Remedy: keep both in one "
            "folder, or convert the table to csv."
        )
    check_regular(table, "the table of a label", FlightRecordError)
    spans = tuple((start - 1, start - 1 + size) for _, start, size, _ in columns)
    kinds = tuple("date" if "TIME" in each["DATA_TYPE"] else "number" for *_, each in columns)
    units = {name: UNITS.get(each["UNIT"].upper(), each["UNIT"]) for name, *_, each in columns if "UNIT" in each}
    first = int(record.group(1)) - 1 if record else 0
    if table == label and end:  # the label begins the table
        first = text[: end.end()].count("\n") + 1
    dialect = Dialect("latin-1", "", ".", tuple(name for name, *_ in columns), kinds, first, units, spans)
    read_table = read_text(table, names, layout, dialect)
    found = dict(read_table.columns)
    for name, _, _, each in columns:
        for key in ("MISSING_CONSTANT", "INVALID_CONSTANT", "NOT_APPLICABLE_CONSTANT"):
            if name in found and key in each and found[name].dtype.kind == "f":
                found[name] = np.where(found[name] == float(each[key].split()[0]), np.nan, found[name])
    return replace(read_table, columns=found)


def _columns(text: str) -> Iterator[tuple[str, int, int, dict[str, str]]]:
    """Name, first byte from 1, bytes and all statements of each column; several items of one are columns of their own."""
    for block in re.findall(r"OBJECT\s*=\s*COLUMN\b(.*?)END_OBJECT", text, re.DOTALL):
        each = {"DATA_TYPE": "", **_statements(block)}
        try:
            name, start, size = each["NAME"], int(each["START_BYTE"]), int(each.get("ITEM_BYTES", each["BYTES"]))
            step, items = int(each.get("ITEM_OFFSET", size)), int(each.get("ITEMS", 1))
        except (KeyError, ValueError) as error:
            raise FlightRecordError(f"the label's column {one_line(each.get('NAME', ''))} has no {error}.") from error
        for k in range(min(items, 1000)):
            yield name if items == 1 else f"{name}.{k + 1}", start + k * step, size, each


def _statements(text: str) -> dict[str, str]:
    """Keys and values, without quotes, on one line each."""
    return {key: " ".join(value.strip().strip('"').split()) for key, value in STATEMENT.findall(text)}


def _label_beside(path: Path) -> Path | None:
    return _beside(path, f"{path.stem}.lbl")


def _beside(path: Path, name: str) -> Path | None:
    """A file of that name, in whatever capitals, in the folder of another."""
    return next((each for each in path.parent.iterdir() if each.name.lower() == name.lower()), None)


FORMATS = (TableFormat("pds3", read, (), recognises),)
