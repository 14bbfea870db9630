"""Tables of the Planetary Data System, version 3: fixed columns of characters, described by a label (.lbl).

The label is beside the table or begins it. Layout: Planetary Data System Standards Reference 3.8, appendix A.29 (TABLE)
and A.8 (COLUMN), chapter 12 (labels), https://pds.nasa.gov/datastandards/pds3/standards/.
"""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np

from brv_hypo.errors import FlightRecordError
from brv_hypo.importing.formats import Layout, TableFormat
from brv_hypo.importing.formats.delimited import Dialect, read_text
from brv_hypo.io.binary import ColumnTable
from brv_hypo.io.files import check_regular
from brv_hypo.io.sandbox import refused

LONGEST_LABEL = 1 << 20  # bytes
STATEMENT = re.compile(r'^[ \t]*(\^?\w+)[ \t]*=[ \t]*("[^"]*"|\([^)]*\)|[^\r\n]*)', re.MULTILINE)
UNITS = {"SECOND": "s", "SECONDS": "s", "GRAVITY": "g", "METER": "m", "METERS": "m", "KILOMETER": "km"}
MISSING = ("MISSING_CONSTANT", "INVALID_CONSTANT", "NOT_APPLICABLE_CONSTANT")


def _recognises(path: Path, head: str) -> bool:
    return "PDS_VERSION_ID" in head[:2000] or (
        path.suffix.lower() == ".tab" and _beside(path, f"{path.stem}.lbl") is not None
    )


def _read(path: Path, names: tuple[str, ...], layout: Layout) -> ColumnTable:
    label = (_beside(path, f"{path.stem}.lbl") if path.suffix.lower() == ".tab" else None) or path
    with label.open("rb") as stream:
        text = stream.read(LONGEST_LABEL).decode("latin-1")
    columns_of = re.findall(r"OBJECT\s*=\s*COLUMN\b(.*?)END_OBJECT", text, re.DOTALL)
    columns = [
        {key: value.strip().strip('"').strip() for key, value in STATEMENT.findall(block)} for block in columns_of
    ]
    place = re.search(r"^[ \t]*\^\w*TABLE[ \t]*=[ \t]*\(?(?:\"([^\"]+)\")?[ ,]*(\d+)?", text, re.MULTILINE)
    table = _beside(label, place[1]) if place and place[1] else label
    try:
        starts = [int(each["START_BYTE"]) - 1 for each in columns]
        spans = tuple((start, start + int(each["BYTES"])) for start, each in zip(starts, columns, strict=True))
        own_names = tuple(each["NAME"] for each in columns)
        lost = {each["NAME"]: [float(each[key].split()[0]) for key in MISSING if key in each] for each in columns}
        if table is None or not columns or re.search(r'INTERCHANGE_FORMAT\s*=\s*"?BINARY', text):
            raise ValueError("no table of characters" if columns else "no columns")
    except (KeyError, ValueError, IndexError) as error:
        cause = "a binary table, columns in a file of their own (^STRUCTURE), or a table that is not beside its label"
        found_error = f"a label with an error: {error}"
        raise refused(str(label), found_error, "a table of characters", cause, "convert it to csv") from error
    check_regular(table, "the table of a label", FlightRecordError)
    kinds = tuple("date" if "TIME" in each.get("DATA_TYPE", "") else "number" for each in columns)
    units = {each["NAME"]: UNITS.get(each["UNIT"].upper(), each["UNIT"]) for each in columns if "UNIT" in each}
    end = re.search(r"^\s*END\s*$", text, re.MULTILINE)
    first = text[: end.end()].count("\n") + 1 if table == label and end else int(place[2] or 1) - 1 if place else 0
    found = read_text(table, names, layout, Dialect("latin-1", "", ".", own_names, kinds, first, units, spans))
    values = dict(found.columns)
    for name in (name for name in values if lost[name]):
        values[name] = np.where(np.isin(values[name], lost[name]), np.nan, values[name])
    return replace(found, columns=values)


def _beside(path: Path, name: str) -> Path | None:
    """A file of that name, in whatever capitals, in the folder of another."""
    return next((each for each in path.parent.iterdir() if each.name.lower() == name.lower()), None)


FORMATS = (TableFormat("pds3", _read, (), _recognises),)
