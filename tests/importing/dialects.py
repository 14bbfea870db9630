"""One motion in the dialects of many recorders: `DIALECTS` come in by a map of columns, `REFUSED` do not come in.

`python -m tests.importing.dialects COUNT` damages so many of the tables and says how many end in a fault.
"""

from __future__ import annotations

import random
import sys
import tempfile
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pandas as pd
import scipy.io

from brv_hypo.errors import BrvHypoError
from brv_hypo.importing.formats import Layout, read_columns
from brv_hypo.importing.guess import guess_map
from tests.flight.records import UNITS, motion
from tests.harness.fuzz.mutations import OF_TABLES, RAW

NOON = datetime(2024, 5, 17, 12, tzinfo=UTC)
TRUTH = {name: np.round(values, 6) for name, values in motion(200).items()} | {"time": np.arange(200) / 100.0}
MATRIX = np.stack([*TRUTH.values()], axis=1)
Lines = Callable[[list[str]], list[str]]


@dataclass(frozen=True)
class Table:
    """A file; columns of channels that are not called as these; keys of the map; and of its channels, None for none."""

    write: Callable[[Path], object]
    columns: dict[str, str] = field(default_factory=dict)
    keys: dict[str, Any] = field(default_factory=dict)
    channel: dict[str, Any] = field(default_factory=dict)
    suffix: str = "csv"


def csv(
    delimiter: str = ",", decimal: str = ".", *, thousands: str = "", head: str = "", row: str = "{}",
    form: str = ".6f", time: Any = None, names: Any = str, encoding: str = "utf-8", change: Lines = list,
    end: str = "\n", columns: Any = None, keys: Any = None, units: Any = (),
) -> Table:  # fmt: skip
    """A text table: `row` frames its header, `change` works on its lines of values, `units` are of channels."""

    def cell(value: Any) -> str:
        plain = value if isinstance(value, str) else f"{value:{',' if thousands else ''}{form}}"
        return plain if isinstance(value, str) else plain.translate({ord(","): thousands, ord("."): decimal})

    def write(path: Path) -> object:
        rows = {**TRUTH, "time": time(TRUTH["time"]) if time else TRUTH["time"]}
        lines = change([delimiter.join(map(cell, values)) for values in zip(*rows.values(), strict=True)])
        header = [row.format(delimiter.join(map(names, rows)))] if names else []
        return path.write_bytes(end.join([*head.splitlines(), *header, *lines, ""]).encode(encoding))

    return Table(write, columns or {}, keys or {}, {name: {"units": unit} for name, unit in dict(units).items()})


def dated(form: str, start: datetime = NOON) -> Callable[[Any], list[str]]:
    """Times as dates."""
    return lambda time: [(start + timedelta(seconds=float(t))).strftime(form) for t in time]


def stated(form: str, spell: Callable[[str], str] = str, **how: Any) -> Table:
    """Names with units."""
    named = {name: form.format(name, spell(UNITS[name])) for name in TRUTH}
    return csv(names=named.__getitem__, columns=named, units=dict.fromkeys(TRUTH), **how)


def two(first: str, second: str, **how: Any) -> Table:
    """Each row twice, of two units, the second with other values."""
    return csv(row="{},unit", change=lambda lines: [
        each for line in lines for each in (f"{line},{first}", f"{line.split(',')[0]}{',0.5' * 8},{second}")
    ], **how)  # fmt: skip


def mat(content: Any, prefix: str = "", numbered: bool = False, **keys: Any) -> Table:
    """A MATLAB file; whatever is callable writes one of version 7.3."""
    columns = {name: f"{prefix}{k if numbered else name}" for k, name in enumerate(TRUTH, 1)}

    def write(path: Path) -> object:
        if not callable(content):
            return scipy.io.savemat(path, content)
        with h5py.File(path, "w", userblock_size=512) as file:
            content(file)
        with path.open("r+b") as stream:
            return stream.write(b"MATLAB 7.3 MAT-file".ljust(116) + bytes(8) + b"\x00\x02IM")

    return Table(write, columns, keys, suffix="mat")


def parquet(time: Any) -> Table:
    return Table(lambda path: pd.DataFrame({**TRUTH, "time": time}).to_parquet(path), suffix="parquet")


PLACED = {name: f"column {k}" for k, name in enumerate(TRUTH, 1)}
STAMPS = pd.Timestamp(NOON) + pd.to_timedelta(TRUTH["time"], unit="s")
STRUCTS = np.array([tuple(row) for row in MATRIX], dtype=[(name, float) for name in TRUTH])
PREAMBLE, NAMES, BARE = "Logger 7, version 1.2\nSerial: 1234\n\nFlight of 2024-05-17\n", [*TRUTH], dict.fromkeys(TRUTH)
FORMS = (
    *("%Y-%m-%dT%H:%M:%S.%fZ", "%Y-%m-%d %H:%M:%S.%f", "%Y-%m-%dT%H:%M:%S.%f+02:00", "%d-%m-%Y %H:%M:%S.%f"),
    *("%d.%m.%Y %H:%M:%S.%f", "%m/%d/%Y %H:%M:%S.%f", "%d-%b-%Y %H:%M:%S.%f", "%Y-%jT%H:%M:%S.%f"),
    *("%Y-%m-%d %H:%M:%S,%f", "%H:%M:%S.%f", "%M:%S.%f"),
)
SPECIAL = "%I:%M:%S.%f %p on %y%m%d"

DIALECTS = {
    **{f"delimiter {d!r}": csv(d) for d in (",", ";", "\t", "|", " ", ", ")},
    **{f"decimal comma, {d!r}": csv(d, ",") for d in (";", "\t", " ")},
    **{f"quoted, {d}": csv('","', d, row='"{}"', change=lambda lines: [f'"{line}"' for line in lines]) for d in ".,"},
    **{f"thousands by {t!r}": csv(";", "." if t in ",'" else ",", thousands=t) for t in (",", ".", " ", "\u202f", "'")},
    **{f"header {r!r}": csv(d, row=r) for r, d in (("#{}", ","), ("# {}", " "), ("% {}", "\t"))},
    **{f"no header, {d!r}": csv(d, c, names=None, columns=PLACED) for d, c in ((",", "."), (" ", "."), (";", ","))},
    **{f"preamble, {d!r}": csv(d, head=PREAMBLE) for d in (",", " ")},
    **{f"encoding {e}": csv(encoding=e, head="Log\n") for e in ("utf-8-sig", "utf-16", "utf-16-be", "utf-16-le")},
    **{f"lines end {e!r}": csv(end=e) for e in ("\r\n", "\r")},
    **{f"dates {form}": csv(";", time=dated(form)) for form in FORMS},
    "counter of 16 bits": csv(time=lambda time: np.mod(1e3 * time - 500, 2**16), units={"time": "ms"}),
    "counter of 32 bits": csv(time=lambda time: np.mod(1e6 * time - 5e5, 2**32), units={"time": "us"}),
    "row of units": csv(row="{}\n" + ",".join(UNITS[name] for name in TRUTH), units=BARE),
    "row of units in brackets": csv("\t", row="{}\n" + "\t".join(f"[{UNITS[name]}]" for name in TRUTH), units=BARE),
    "units in brackets": stated("{} [{}]", delimiter=";"),
    "units in a name": stated("{}_{}", lambda unit: unit.replace("/", "_per_").replace("^", "")),
    "units in Latin-1": stated("{} ({})", lambda unit: unit.replace("^2", "²"), encoding="latin-1"),
    "fixed width": csv(" ", form="14.6f"),
    "fixed width without blanks": csv("", names=None, form="12.6f", keys={"widths": [12] * 9, "names": NAMES}),
    "exponents of Fortran": csv(form=".9e", change=lambda lines: [line.replace("e", "D") for line in lines]),
    "comments before the header": csv(head="# a log\n# of a flight\n", row="# {}"),
    "index without a name": csv(row=",{}", change=lambda lines: [f"{k},{line}" for k, line in enumerate(lines)]),
    "delimiter at the end": csv(change=lambda lines: [f"{line}," for line in lines]),
    "names in the map": csv(names=None, keys={"names": NAMES}),
    "preamble of cells": csv(head="sep=,\nLogger,7\nSerial,1234,x\n,,\n"),
    "dates in a form of the map": csv(time=dated(SPECIAL), keys={"dates": SPECIAL}),
    "date and time in two columns": csv(" ", row="day {}", time=dated(FORMS[1])),
    "times over midnight": csv(time=dated("%H:%M:%S.%f", NOON.replace(hour=23, minute=59, second=59))),
    "every row twice": csv(change=lambda lines: [each for line in lines for each in (line, line)]),
    "a block twice": csv(change=lambda lines: [*lines[:80], *lines[40:]]),
    "text beside values": csv(row="{},state", change=lambda lines: [f"{line},coast" for line in lines]),
    "two units by a number": two("1", "2", keys={"where": {"unit": 1}}),
    "two units by a name": two("left", "right", keys={"where": {"unit": "left"}}),
    "parquet, dates": parquet(STAMPS),
    "parquet, dates with a zone": parquet(STAMPS.tz_convert("Europe/Berlin")),
    "parquet, durations": parquet(pd.to_timedelta(TRUTH["time"], unit="s")),
    "MATLAB matrix": mat({"log": MATRIX}, "log.", numbered=True),
    "MATLAB matrix, lying": mat({"log": MATRIX.T, "note": "lying"}, "log.", numbered=True),
    "MATLAB array of structs": mat({"log": STRUCTS}, "log."),
    "MATLAB struct with a matrix": mat({"log": {"data": MATRIX}}, "log.data.", numbered=True),
    "MATLAB 7.3, matrix": mat(lambda file: file.update({"log": MATRIX.T}), "log.", numbered=True),
}  # fmt: skip

REFUSED = {
    r"line 2, cell 18: found 18 cells, expected 9.*decimal sign": csv(",", ","),
    r"line 2, cell 1: found '12,345'.*`decimal`": csv(";", change=lambda lines: ["12,345;" * 8 + "1,234"] * 20),
    r"line 202, cell 1: found 'end of the log'.*remove the line": csv(change=lambda lines: [*lines, "end of the log"]),
    r"line 9, cell 11: found .*damaged": csv(change=lambda lines: [*lines[:7], lines[7] + ",1,2", *lines[8:]]),
    r"'r': line 9, cell 4: found 'x.y'": csv(change=lambda lines: [*lines[:7], "0.07,6,0.1,x.y,1,2,3,4,5", *lines[8:]]),
    r"line 3, column 'time': found 0 after 0 .*several sensors.*`where": two("1", "2"),
    r"line 3, column 'time'.*coarser": csv(time=lambda time: np.floor(5.0 * time) / 5.0),
    r"line 102, column 'time': found 0 after 1.99.*cut the file": csv(
        change=lambda lines: [*lines[100:], *lines[:100]]
    ),
    r"no row of numbers.*`encoding`": Table(lambda path: path.write_bytes(bytes(range(256)) * 9)),
    r"channels/a./units: neither the map nor the table": csv(units=BARE),
    r"where.*keeps no row": two("1", "2", keys={"where": {"unit": 3}}),
    r"got 2, expected one for each of the 9 columns": csv(names=None, keys={"names": ["time", "p"]}),
    r"encoding 'utf-9' is not known": csv(keys={"encoding": "utf-9"}),
}


def fault_of(folder: Path, seed: int) -> str | None:
    """What is raised beside refusals where a damaged table is guessed at and read; None for nothing."""
    draw = random.Random(seed)
    dialect, table = draw.choice([*DIALECTS.items()])
    table.write(path := folder / f"log.{table.suffix}")
    for _ in range(draw.choice((1, 1, 2, 4))):
        draw.choice(OF_TABLES if table.suffix == "csv" else RAW)(path, draw)
    columns = tuple(table.columns.get(name, name) for name in TRUTH)
    for attempt in (lambda: guess_map(path), lambda: read_columns(path, columns, Layout(**table.keys))):
        try:
            attempt()
        except BrvHypoError:
            continue
        except Exception as error:
            return f"{dialect}, seed {seed}: {type(error).__name__}: {error}"
    return None


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    with tempfile.TemporaryDirectory() as name:
        faults = [fault for seed in range(int(sys.argv[1])) if (fault := fault_of(Path(name), seed))]
    print(*faults[:20], f"{sys.argv[1]} tables, {len(faults)} faults", sep="\n")
