"""Damaged tables of every dialect, by the command line in this process: which end it with a fault of the program.

    python -m tests.studies.importing.mutated --tables 10000 --seed 1

Each table is one of tests.importing.dialects, damaged once to four times: its bytes, cells, rows, columns, delimiters,
encoding, line ends or times. It is guessed at (`import --guess`), and imported by the map that fits the sound table.
Counted are exit codes beyond those of the contract (70: a fault of the program), exceptions that come out, tracebacks.
"""

from __future__ import annotations

import argparse
import io
import os
import random
import tempfile
import warnings
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import redirect_stderr, redirect_stdout
from functools import cache
from pathlib import Path
from typing import Any

import yaml
from typer.main import get_command

from brv_hypo.cli.main import app
from tests.flight.records import UNITS
from tests.harness.fuzz.mutations import NASTY, OF_TABLES, RAW, Mutation
from tests.harness.fuzz.run import SOUND_CODES
from tests.importing.dialects import DIALECTS, TRUTH
from tests.importing.test_foreign import foreign_map
from tests.studies.independent.imperfect_study import count

ENCODINGS = ("utf-8-sig", "utf-16", "utf-16-be", "utf-32", "latin-1", "cp1252", "cp437", "utf-7", "shift-jis")
LINE_ENDS = ("\r\n", "\r", "\n\n", "\x0b", "\x0c", "\x1c", "\x85", "\u2028", "", ",\n")
DELIMITERS = (",", ";", "\t", "|", " ", "  ", ":", "\x1f", ",,", '","', " , ", "")
TIMES = ("0", "-1", "1e300", "nan", "inf", "2024-02-30T25:61:61", "24:00:00", "0000-00-00", "99:99:99.9", "1e-320", "")


def _text(path: Path) -> str:
    return path.read_text(encoding="utf-8", errors="replace")


def _cells(change: Callable[[list[list[str]], random.Random], list[list[str]]]) -> Mutation:
    """A change of the cells between whichever delimiter is the commonest."""

    def mutation(path: Path, draw: random.Random) -> None:
        text = _text(path)
        delimiter = max(DELIMITERS[:5], key=text.count)
        rows = change([line.split(delimiter) for line in text.splitlines()] or [[""]], draw)
        path.write_text("\n".join(map(delimiter.join, rows)), encoding="utf-8", errors="replace")

    return mutation


def _columns(rows: list[list[str]], draw: random.Random) -> list[list[str]]:
    """A column is left out, doubled, moved, emptied or constant, in all rows or from one on."""
    width = max(map(len, rows))
    at, to, first = draw.randrange(width), draw.randrange(width), draw.choice((0, 0, 1, draw.randrange(len(rows))))
    how = draw.choice(("drop", "double", "move", "empty", "constant", "name"))
    nasty = str(draw.choice(NASTY))[:80]
    for number, row in enumerate(rows):
        if number < first or at >= len(row):
            continue
        if how in ("drop", "move"):
            cell = row.pop(at)
            row[to:to] = [cell] if how == "move" else []
        elif how == "double":
            row.insert(to, row[at])
        elif how != "name" or number == first:
            row[at] = "" if how == "empty" else nasty
    return rows


def _rows(rows: list[list[str]], draw: random.Random) -> list[list[str]]:
    """Rows in another order, or left out, or one of another width."""
    a, b = sorted(draw.randrange(len(rows) + 1) for _ in range(2))
    part = rows[a:b]
    how = draw.choice(("reverse", "shuffle", "drop", "keep", "wide"))
    if how == "shuffle":
        draw.shuffle(part)
    return {
        "reverse": [*rows[:a], *part[::-1], *rows[b:]],
        "shuffle": [*rows[:a], *part, *rows[b:]],
        "drop": [*rows[:a], *rows[b:]],
        "keep": [*rows[:1], *part] or [[""]],
        "wide": [*rows[:a], [cell for row in part for cell in row], *rows[b:]],
    }[how]


def _times(rows: list[list[str]], draw: random.Random) -> list[list[str]]:
    """Times in the wrong form: some, or all from a row on."""
    at, first = draw.randrange(max(map(len, rows))), draw.randrange(len(rows))
    for row in draw.choice((rows[first : first + 1], rows[first:], rows[1:])):
        if at < len(row):
            row[at] = draw.choice(TIMES)
    return rows


def _delimiters(path: Path, draw: random.Random) -> None:
    """Another delimiter throughout, or in one line."""
    lines = _text(path).splitlines() or [""]
    before = max(DELIMITERS[:5], key="".join(lines).count)
    chosen = draw.choice((range(len(lines)), [draw.randrange(len(lines))]))
    after = draw.choice(DELIMITERS)
    for k in chosen:
        lines[k] = lines[k].replace(before, after)
    path.write_text("\n".join(lines), encoding="utf-8", errors="replace")


def _encoded(path: Path, draw: random.Random) -> None:
    path.write_bytes(_text(path).encode(draw.choice(ENCODINGS), errors="replace"))


def _line_ends(path: Path, draw: random.Random) -> None:
    path.write_bytes(draw.choice(LINE_ENDS).join(_text(path).splitlines()).encode("utf-8", errors="replace"))


OF_DIALECTS: tuple[Mutation, ...] = (
    *OF_TABLES, *[_cells(_columns)] * 4, *[_cells(_rows)] * 3, *[_cells(_times)] * 3,
    *[_delimiters] * 3, *[_encoded] * 3, *[_line_ends] * 2,
)  # fmt: skip


def ended(arguments: list[str]) -> tuple[int, str]:
    """The exit code of a command, -1 where an exception comes out, and what it writes."""
    written = io.StringIO()
    with redirect_stdout(written), redirect_stderr(written):
        try:
            command().main(arguments, "brv-hypo")
        except SystemExit as end:
            return int(end.code or 0), written.getvalue()
        except BaseException as error:
            return -1, f"{error!r}, behind {written.getvalue()}"
    return 0, written.getvalue()


@cache
def command() -> Any:
    """The command line, made once."""
    return get_command(app)


def outcomes(folder: Path, seed: int) -> tuple[str, list[int], list[str]]:
    """The dialect of a damaged table, the exit codes of both commands, and the faults that they end in."""
    draw = random.Random(seed)
    dialect, table = draw.choice([*DIALECTS.items()])
    table.write(path := folder / f"log.{table.suffix}")
    for _ in range(draw.choice((1, 1, 2, 4))):
        draw.choice(OF_DIALECTS if table.suffix == "csv" else RAW)(path, draw)
    channels = {
        name: {"column": table.columns.get(name, name), "units": UNITS[name], **table.channel.get(name, {})}
        for name in TRUTH
    }
    known = {name: {k: v for k, v in entry.items() if v is not None} for name, entry in channels.items()}
    (folder / "map.yaml").write_text(yaml.safe_dump({**foreign_map(), "channels": known, **table.keys}))
    (folder / "log.map.yaml").unlink(missing_ok=True)
    codes, faults = [], []
    for arguments in (
        ["import", "--guess", str(path)],
        ["import", str(path), "--map", str(folder / "map.yaml"), "-o", str(folder / "out.h5")],
    ):
        code, output = ended(arguments)
        codes.append(code)
        if code not in SOUND_CODES or "Traceback" in output:
            faults.append(f"seed {seed}, {dialect}, {arguments[1]}: code {code}, {output[-500:]}")
    return dialect, codes, faults


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the faults and the counts; 1 where there is a fault."""
    parser = argparse.ArgumentParser(prog="python -m tests.studies.importing.mutated", description=__doc__)
    parser.add_argument("--tables", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args(arguments)
    warnings.simplefilter("ignore")
    codes: Counter[int] = Counter()
    bad = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        os.chdir(folder)
        for seed in range(options.seed, options.seed + options.tables):
            _, ended, faults = outcomes(folder, seed)
            codes.update(ended)
            bad.append(bool(faults))
            if len(bad) % 1000 == 0:
                print(f"{len(bad)} tables", flush=True)
            for fault in faults:
                print(fault, flush=True)
    print(f"exit codes of {sum(codes.values())} commands: {dict(sorted(codes.items()))}")
    print(count("tables that end in a fault of the program", bad))
    return int(any(bad))


if __name__ == "__main__":
    raise SystemExit(main())
