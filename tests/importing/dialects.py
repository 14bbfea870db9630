"""One motion in the dialects of many recorders: `DIALECTS` are tables that come in, `REFUSED` those that cannot.

Each writes a file from the columns of `tests.flight.records.motion` and gives what the map needs beside the names of
columns: `units` where the table states none, and now and then a key.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pandas as pd
import scipy.io
from scipy.interpolate import CubicSpline

from tests.flight.records import UNITS, motion

NOON = datetime(2024, 5, 17, 12, tzinfo=UTC)


def truth() -> dict[str, Any]:
    """The motion, its time in whole hundredths from 0."""
    columns = {name: np.round(values, 6) for name, values in motion(200).items()}
    return {**columns, "time": np.arange(200) / 100.0}


@dataclass(frozen=True)
class Table:
    """A file, the columns of the channels where they are not called as these, and keys of the map."""

    suffix: str
    write: Callable[[Path], object]
    columns: dict[str, str] = field(default_factory=dict)
    keys: dict[str, Any] = field(default_factory=dict)
    channel: dict[str, Any] = field(default_factory=dict)
    """Keys by channel; None takes one out."""


def numbered(prefix: str) -> dict[str, str]:
    """Columns that are called by their place."""
    return {name: f"{prefix}{k}" for k, name in enumerate(truth(), 1)}


def text(
    delimiter: str = ",",
    decimal: str = ".",
    thousands: str = "",
    head: str = "",
    time: Any = None,
    names: Callable[[str], str] | None = str,
    row: str = "{}",
    form: str = ".6f",
    encoding: str = "utf-8",
    change: Callable[[list[str]], list[str]] = list,
    end: str = "\n",
) -> Callable[[Path], object]:
    """What writes a text table; `row` frames the header, `change` works on the lines of values."""  # fmt: skip

    def cell(value: Any) -> str:
        if isinstance(value, str):
            return value
        plain = f"{value:{',' if thousands else ''}{form}}"
        return plain.translate({ord(","): thousands, ord("."): decimal})

    def write(path: Path) -> object:
        columns = truth()
        columns["time"] = time(columns["time"]) if time else columns["time"]
        lines = [delimiter.join(map(cell, values)) for values in zip(*columns.values(), strict=True)]
        header = [row.format(delimiter.join(map(names, columns)))] if names else []
        return path.write_bytes(end.join([*head.splitlines(), *header, *change(lines), ""]).encode(encoding))

    return write


def dated(form: str, start: datetime = NOON, cut: int | None = None) -> Callable[[Any], list[str]]:
    """Times as dates."""
    return lambda time: [(start + timedelta(seconds=float(t))).strftime(form)[:cut] for t in time]


def counted(size: float, bits: int, start: float) -> Callable[[Any], list[str]]:
    """Times as a counter that wraps."""
    return lambda time: [f"{(start + round(t * size)) % 2**bits:.0f}" for t in time]


def csv(*, columns: Any = None, keys: Any = None, channel: Any = None, bare: bool = False, **how: Any) -> Table:
    """A text table; `bare`: the map gives no units."""
    given = {name: {"units": None} for name in truth()} if bare else channel or {}
    return Table("csv", text(**how), columns or {}, keys or {}, given)


def units_in(form: str, spell: Callable[[str], str] = str) -> dict[str, Any]:
    """Names with units."""
    named = {name: form.format(name, spell(UNITS[name])) for name in truth()}
    return {"names": named.__getitem__, "columns": named, "bare": True}


def interleaved(units: tuple[str, str], other: float) -> Callable[[list[str]], list[str]]:
    """Each row twice, of two units, the second with other values."""
    return lambda lines: [
        each for line in lines for each in (f"{line},{units[0]}", f"{line.split(',')[0]},{','.join([str(other)] * 8)},{units[1]}")
    ]  # fmt: skip


def frame(**time: Any) -> Callable[[Path], object]:
    return lambda path: pd.DataFrame({**truth(), **time}).to_parquet(path)


def mat(content: Any) -> Callable[[Path], object]:
    return lambda path: scipy.io.savemat(path, content)


def mat73(*, array: bool) -> Callable[[Path], object]:
    """A v7.3 file with a matrix, or an array of structs: its fields are references."""

    def write(path: Path) -> object:
        with h5py.File(path, "w", userblock_size=512) as file:
            if not array:
                file["log"] = MATRIX.T
            for name, values in truth().items() if array else ():
                kept = [file.create_dataset(f"#refs#/{name}{k}", data=[[value]]) for k, value in enumerate(values)]
                file[f"log/{name}"] = np.array([each.ref for each in kept], dtype=h5py.ref_dtype)[:, None]
        with path.open("r+b") as stream:
            return stream.write(b"MATLAB 7.3 MAT-file".ljust(116) + bytes(8) + b"\x00\x02IM")

    return write


MATRIX = np.stack([*truth().values()], axis=1)
STAMPS = pd.Timestamp(NOON) + pd.to_timedelta(truth()["time"], unit="s")
STRUCTS = np.array([tuple(row) for row in MATRIX], dtype=[(name, float) for name in truth()])
PREAMBLE = "Logger 7, version 1.2\nSerial: 1234\n\nFlight of 2024-05-17\n"
LOG = {name: f"log.{name}" for name in truth()}


def increments(path: Path) -> object:
    """Angles turned since the sample before, in degrees."""
    columns = truth()
    for name in "pqr":
        angle = CubicSpline(columns["time"], columns[name]).antiderivative()
        columns[name] = np.degrees(angle(columns["time"]) - angle(columns["time"] - 0.01))
    return pd.DataFrame(columns).to_csv(path, index=False)


DIALECTS = {
    "commas": csv(),
    "semicolons": csv(delimiter=";"),
    "tabs": csv(delimiter="\t"),
    "bars": csv(delimiter="|"),
    "blanks": csv(delimiter=" "),
    "commas and blanks": csv(delimiter=", "),
    "fixed width": csv(delimiter=" ", form="14.6f"),
    "exponents": csv(form=".9e"),
    "exponents of Fortran": csv(change=lambda lines: [line.replace("e", "D") for line in lines], form=".9e"),
    "every cell quoted": csv(delimiter='","', row='"{}"', change=lambda lines: [f'"{line}"' for line in lines]),
    "decimal comma, semicolons": csv(delimiter=";", decimal=","),
    "decimal comma, tabs": csv(delimiter="\t", decimal=","),
    "decimal comma, blanks": csv(delimiter=" ", decimal=","),
    "decimal comma, quoted": csv(delimiter='","', decimal=",", row='"{}"', change=lambda lines: [f'"{line}"' for line in lines]),
    "thousands by commas": csv(delimiter=";", thousands=","),
    "thousands by points": csv(delimiter=";", decimal=",", thousands="."),
    "thousands by blanks": csv(delimiter=";", decimal=",", thousands=" "),
    "thousands by narrow blanks": csv(delimiter="\t", decimal=",", thousands="\u202f"),
    "thousands by apostrophes": csv(thousands="'"),
    "header behind #": csv(row="#{}"),
    "header of savetxt": csv(delimiter=" ", row="# {}"),
    "header behind %": csv(delimiter="\t", row="% {}"),
    "header behind # and a preamble": csv(head="# a log\n# of a flight\n", row="# {}"),
    "index without a name": csv(row=",{}", change=lambda lines: [f"{k},{line}" for k, line in enumerate(lines)]),
    "index without a header": csv(change=lambda lines: [f"{k},{line}" for k, line in enumerate(lines)]),
    "delimiter at the end": csv(change=lambda lines: [f"{line}," for line in lines]),
    "no header": csv(names=None, columns=numbered("column ")),
    "no header, blanks": csv(names=None, delimiter=" ", columns=numbered("column ")),
    "no header, decimal comma": csv(names=None, delimiter=";", decimal=",", columns=numbered("column ")),
    "no header, names in the map": csv(names=None, keys={"names": [*truth()]}),
    "preamble": csv(head=PREAMBLE),
    "preamble of cells": csv(head="Logger,7\nSerial,1234,x\n,,\n", delimiter=","),
    "preamble, blanks": csv(head=PREAMBLE, delimiter=" "),
    "first line of Excel": csv(head="sep=;\n", delimiter=";"),
    "row of units": csv(row="{}\n" + ",".join(UNITS[name] for name in truth()), bare=True),
    "row of units in brackets": csv(delimiter=";", row="{}\n" + ";".join(f"[{UNITS[name]}]" for name in truth()), bare=True),
    "row of units, tabs": csv(delimiter="\t", row="{}\n" + "\t".join(UNITS[name] for name in truth()), bare=True),
    "units in brackets": csv(**units_in("{} [{}]")),
    "units in parentheses": csv(delimiter=";", **units_in("{}_({})")),
    "units in a name": csv(**units_in("{}_{}", lambda unit: unit.replace("/", "_per_").replace("^", ""))),
    "units in Latin-1": csv(**units_in("{} [{}]", lambda unit: unit.replace("^2", "²")), encoding="latin-1"),
    "UTF-8 with a mark": csv(encoding="utf-8-sig"),
    "UTF-16": csv(encoding="utf-16"),
    "UTF-16, tabs, decimal comma": csv(encoding="utf-16", delimiter="\t", decimal=",", end="\r\n"),
    "UTF-16 without a mark": csv(encoding="utf-16-be"),
    "Latin-1": csv(encoding="latin-1", head="Flug über München\n"),
    "lines of Windows": csv(end="\r\n"),
    "lines of the old Macintosh": csv(end="\r"),
    "ISO dates": csv(time=dated("%Y-%m-%dT%H:%M:%S.%fZ")),
    "ISO dates with a blank": csv(time=dated("%Y-%m-%d %H:%M:%S.%f")),
    "ISO dates with a zone": csv(time=dated("%Y-%m-%dT%H:%M:%S.%f+02:00")),
    "dates with dashes": csv(time=dated("%d-%m-%Y %H:%M:%S.%f"), delimiter=";"),
    "dates with points": csv(time=dated("%d.%m.%Y %H:%M:%S,%f"), delimiter=";", decimal=","),
    "American dates": csv(time=dated("%m/%d/%Y %H:%M:%S.%f")),
    "dates with a month's name": csv(time=dated("%d-%b-%Y %H:%M:%S.%f")),
    "days of the year": csv(time=dated("%Y-%jT%H:%M:%S.%f")),
    "dates in a form of the map": csv(time=dated("%I:%M:%S.%f %p on %y%m%d"), keys={"dates": "%I:%M:%S.%f %p on %y%m%d"}),
    "date and time in two columns": csv(delimiter=" ", time=dated("%Y-%m-%d %H:%M:%S.%f"), names=lambda name: {"time": "day time"}.get(name, name)),
    "times of day": csv(time=dated("%H:%M:%S.%f")),
    "times of day over midnight": csv(time=dated("%H:%M:%S.%f", NOON.replace(hour=23, minute=59, second=59))),
    "minutes and seconds": csv(time=dated("%M:%S.%f")),
    "counter of 16 bits": csv(time=counted(1000.0, 16, 65000), channel={"time": {"units": "ms"}}),
    "counter of 32 bits": csv(time=counted(1e6, 32, 2**32 - 10**6), channel={"time": {"units": "us"}}),
    "every row twice": csv(change=lambda lines: [each for line in lines for each in (line, line)]),
    "a block twice": csv(change=lambda lines: [*lines[:80], *lines[40:]]),
    "cells without a value, text": csv(row="{},state", change=lambda lines: [f"{line},{'NA' if k % 9 else 'coast'}" for k, line in enumerate(lines)]),
    "two units by a number": csv(row="{},unit", change=interleaved(("1", "2"), 0.5), keys={"where": {"unit": 1}}),
    "two units by a name": csv(row="{},unit", change=interleaved(("left", "right"), 0.5), keys={"where": {"unit": "left"}}),
    "columns without blanks": csv(delimiter="", names=None, form="12.6f", keys={"widths": [12] * 9, "names": [*truth()]}),
    "increments of angle": Table("csv", increments, channel={name: {"units": "deg", "increments": True} for name in "pqr"}),
    "parquet": Table("parquet", frame()),
    "parquet, dates": Table("parquet", frame(time=STAMPS)),
    "parquet, dates with a zone": Table("parquet", frame(time=STAMPS.tz_convert("Europe/Berlin"))),
    "parquet, durations": Table("parquet", frame(time=pd.to_timedelta(truth()["time"], unit="s"))),
    "MATLAB variables": Table("mat", mat(truth())),
    "MATLAB matrix": Table("mat", mat({"log": MATRIX}), numbered("log.")),
    "MATLAB matrix, lying": Table("mat", mat({"log": MATRIX.T, "note": "lying"}), numbered("log.")),
    "MATLAB matrix, names in the map": Table("mat", mat({"log": MATRIX}), keys={"names": [*truth()]}),
    "MATLAB struct": Table("mat", mat({"log": truth()}), LOG),
    "MATLAB array of structs": Table("mat", mat({"log": STRUCTS}), LOG),
    "MATLAB struct with a matrix": Table("mat", mat({"log": {"data": MATRIX}}), numbered("log.data.")),
    "MATLAB 7.3, matrix": Table("mat", mat73(array=False), numbered("log.")),
    "MATLAB 7.3, array of structs": Table("mat", mat73(array=True), LOG),
}  # fmt: skip


def damaged(line: int, text: str) -> Callable[[list[str]], list[str]]:
    """One line of values replaced."""
    return lambda lines: [*lines[:line], text, *lines[line + 1 :]]


REFUSED = {
    "decimal comma between commas": (csv(decimal=","), r"line 2, cell 18: .* 18 cells, expected 9.*decimal sign"),
    "no sign of thousands": (csv(delimiter=";", form=".3f", decimal=",", change=lambda lines: ["12,345;" * 8 + "1,234"] * 20), r"line 2, cell 1: found '12,345'.*`decimal`"),
    "a remark below": (csv(change=lambda lines: [*lines, "end of the log"]), r"line 202, cell 1: found 'end of the log'.*remove the line"),
    "a damaged cell": (csv(change=damaged(7, "0.07,6,0.1,x.y,1,2,3,4,5")), r"'r': line 9, cell 4: found 'x.y'"),
    "two units without a key": (csv(row="{},unit", change=interleaved(("1", "2"), 0.5)), r"line 3, column 'time': found 0 after 0 .*several sensors.*`where"),
    "coarse stamps": (csv(time=lambda t: np.floor(5.0 * t) / 5.0), r"line 3, column 'time'.*coarser"),
    "a clock that was set": (csv(change=lambda lines: [*lines[100:], *lines[:100]]), r"line 102, column 'time': found 0 after 1.99.*cut the file there"),
    "another kind of file": (Table("csv", lambda path: path.write_bytes(bytes(range(256)) * 9)), r"no row of numbers.*`encoding`"),
    "no units": (csv(bare=True), r"channels/a?./units: neither the map nor the table"),
    "no such unit": (csv(row="{},unit", change=interleaved(("1", "2"), 0.5), keys={"where": {"unit": 3}}), "where.*keeps no row"),
    "names of another count": (csv(names=None, keys={"names": ["time", "p"]}), "got 2, expected one for each of the 9 columns"),
    "an unknown encoding": (csv(keys={"encoding": "utf-9"}), "encoding 'utf-9' is not known"),
}  # fmt: skip
