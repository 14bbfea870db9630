"""`python -m tests.frozen [NAME ...]`: checks the frozen results of the default flights, or writes them.

NAME is that of a flight, or FLIGHT.COMMAND; `--all` takes all forty flights. Exits with 1 where anything differs.
`--write` freezes what is found; `--reword` the messages alone, where no value has moved by a bit. `--rename` applies
the table's pending renames to all that is frozen; with names, the whole table to these results, which code from before
the renames has written.
"""

from __future__ import annotations

import argparse
import re
import sys
import time
from collections import defaultdict
from collections.abc import Iterable, Sequence
from typing import Literal

import pytest
from threadpoolctl import threadpool_limits

from tests.frozen.agreement import Difference, disagreements, identical, read_allowances
from tests.frozen.commands import RESULTS, current_content, frozen_content, frozen_file
from tests.frozen.content import as_text
from tests.frozen.flights import FLIGHTS, Command
from tests.frozen.libraries import note_libraries, same_libraries
from tests.frozen.renames import apply_all, apply_pending

SHOWN = 12
"""Differences of one result that are printed."""
LARGEST_BYTES = 200_000


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.frozen", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help="flights, or FLIGHT.COMMAND; else the default ones")
    parser.add_argument("--all", action="store_true", help="all forty flights")
    parser.add_argument("--write", action="store_true", help="freeze what is found")
    parser.add_argument("--reword", action="store_true", help="freeze the messages alone")
    parser.add_argument("--rename", action="store_true", help="apply renames.yaml to the frozen files")
    agreement = parser.add_mutually_exclusive_group()
    agreement.add_argument("--exact", action="store_true", help="bit for bit, on the machine where it was written")
    agreement.add_argument("--close", action="store_true", help="to 1e-9")
    options = parser.parse_args(arguments)
    try:
        chosen = results(options.names, every=options.all)
    except KeyError as unknown:
        parser.error(f"no such frozen result: {unknown.args[0]}; flights are {', '.join(FLIGHTS)}")
    if options.rename:
        changed = apply_all([frozen_file(*pair) for pair in chosen]) if options.names else apply_pending()
        print(f"renamed in {changed} files")
        return 0
    with threadpool_limits(limits=1):
        if options.write:
            return write(chosen, every=options.all)
        if options.reword:
            return reword(chosen)
        return check(chosen, "exact" if options.exact else "close" if options.close else "across builds")


def results(names: Iterable[str], *, every: bool) -> list[tuple[str, Command]]:
    """Flight and command of each result that is meant; KeyError for a name that none has."""
    known = [(flight.name, command) for flight in FLIGHTS.values() for command in flight.commands]
    if every:
        return known
    if not names:
        return [(each.name, command) for each in FLIGHTS.values() if each.default for command in each.commands]
    chosen = []
    for name in names:
        meant = [pair for pair in known if name in (pair[0], ".".join(pair))]
        if not meant:
            raise KeyError(name)
        chosen += meant
    return chosen


def write(chosen: Sequence[tuple[str, Command]], *, every: bool) -> int:
    """Freezes the results, all with the same libraries; 1 where a file becomes too large."""
    RESULTS.mkdir(exist_ok=True)
    if not same_libraries():
        if not every:
            print("libraries.json names other libraries than these: write all results anew with --all --write")
            return 2
        note_libraries()
    begun, large = time.process_time(), False
    for name, command in chosen:
        before = time.process_time()
        try:
            text = as_text(current_content(name, command))
        except pytest.skip.Exception as reason:
            print(f"{name}.{command}: left out: {reason}")
            continue
        file = frozen_file(name, command)
        old = file.read_text(encoding="utf-8") if file.exists() else None
        file.write_text(text, encoding="utf-8")
        state = "new" if old is None else "as it was" if old == text else "changed"
        size = file.stat().st_size
        large |= size > LARGEST_BYTES
        seconds = time.process_time() - before
        print(f"{name}.{command}: {state}, {size / 1000:.0f} kB, {seconds:.1f} s of CPU", flush=True)
    print(f"{len(chosen)} results, {time.process_time() - begun:.0f} s of CPU")
    return int(large)


def reword(chosen: Sequence[tuple[str, Command]]) -> int:
    """Freezes the messages of results whose values are the same bit for bit; 1 where some are not."""
    moved = False
    for name, command in chosen:
        try:
            current = current_content(name, command)
        except pytest.skip.Exception as reason:
            print(f"{name}.{command}: left out: {reason}")
            continue
        frozen = frozen_content(name, command)
        differences = identical(frozen["values"], current["values"], f"{name}.{command}:values", exact=True)
        new = sum(frozen["messages"].get(key) != text for key, text in current["messages"].items())
        if not differences:
            frozen_file(name, command).write_text(as_text(current), encoding="utf-8")
        state = f"{len(differences)} values moved, left as it was" if differences else f"{new} messages reworded"
        print(f"{name}.{command}: {state}", flush=True)
        for each in differences[:SHOWN]:
            print(f"  {each}")
        moved |= bool(differences)
    return int(moved)


def check(chosen: Sequence[tuple[str, Command]], required: Literal["exact", "close", "across builds"]) -> int:
    """Prints what differs, first by result, then by key; 1 where anything does."""
    begun, found, others = time.process_time(), [], not same_libraries()
    if others:
        print("Other libraries than those of libraries.json: numbers may differ by what rounding.yaml says.")
    for name, command in chosen:
        before = time.process_time()
        if others and command in FLIGHTS[name].rounded:
            print(f"{name}.{command}: left out: it hangs on rounding")
            continue
        try:
            current = current_content(name, command)
        except pytest.skip.Exception as reason:
            print(f"{name}.{command}: left out: {reason}")
            continue
        differences = disagreements(
            frozen_content(name, command),
            current,
            f"{name}.{command}",
            required=required,
            allowances=read_allowances() if others else (),
        )
        seconds = time.process_time() - before
        state = f"{len(differences)} differences" if differences else "agrees"
        print(f"{name}.{command}: {state}, {seconds:.1f} s of CPU", flush=True)
        for each in differences[:SHOWN]:
            print(f"  {each}")
        if len(differences) > SHOWN:
            print(f"  and {len(differences) - SHOWN} more")
        found += differences
    if found:
        print("\nBy key:")
        for line in by_key(found):
            print(f"  {line}")
    print(f"{len(chosen)} results, {len(found)} differences, {time.process_time() - begun:.0f} s of CPU")
    return int(bool(found))


def by_key(differences: Iterable[Difference]) -> list[str]:
    """A line for each place in the results, whichever flight and row it is of: how often it differs, and how much."""
    places: dict[str, list[Difference]] = defaultdict(list)
    for each in differences:
        result, _, path = each.path.partition(":")
        places[f"{result.rpartition('.')[2]}:{re.sub(r'/[0-9]+(?=/|$)', '/*', path)}"].append(each)
    return [
        f"{place}: {len(found)} in {len({each.path.partition(':')[0] for each in found})} results, largest "
        f"{max(each.relative for each in found):.1e} relative"
        for place, found in sorted(places.items())
    ]


if __name__ == "__main__":
    sys.exit(main())
