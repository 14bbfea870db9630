"""One run: a command is killed, what it left is judged, then it is done again to its end and judged."""

from __future__ import annotations

import os
import random
import sqlite3
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from typer.testing import CliRunner

from brv_hypo.cli.main import app
from tests.harness.kill import disk, victim
from tests.harness.kill.commands import COMMANDS, Command, complete, flights_of

OLD = b"what stood there before"
PAGE_BYTES = 4096
# After the first sign of writing: a file of 5 MB takes some 20 ms, a line of a study a few.
LONGEST_AFTER_SIGN_SECONDS = 0.03
FULL_AT_SHARE = 1.2  # of what the outputs take, the most room on a full disk: the last of it may just fit


@dataclass(frozen=True)
class Plan:
    """A command and when it is killed: at `share` of its usual time, or `after` s from the first sign of writing.

    `old`: outputs exist before, and are to be replaced. `room`: share of the outputs' bytes that the disk has.
    """

    command: Command
    share: float | None
    after: float
    old: bool
    room: float | None


@dataclass(frozen=True)
class Reference:
    """An undisturbed run: how long it takes, and how many bytes its outputs have together and at most."""

    seconds: float
    size: int
    largest: int


@dataclass(frozen=True)
class Result:
    """`problem` None where nothing is wrong; `state`: "killed", "killed while writing", "refused" or "done" before."""

    plan: Plan
    state: str
    problem: str | None


def plans(runs: int, full: int, seed: int, only: str = "") -> Iterator[Plan]:
    """`runs` plans in turn over the commands whose label contains `only`, `full` of them on a full disk."""
    draw = random.Random(seed)
    commands = [command for command in COMMANDS if only in command.label]
    on_full = set(draw.sample(range(runs), min(full, runs)))
    first = draw.randrange(len(commands))
    for number in range(runs):
        command = commands[(first + number) % len(commands)]
        yield Plan(
            command,
            share=draw.random() if draw.random() < 0.4 else None,
            after=draw.random() ** 2 * LONGEST_AFTER_SIGN_SECONDS,
            old=command.replaces and draw.random() < 0.5,
            room=draw.random() * FULL_AT_SHARE if number in on_full else None,
        )


def reference(command: Command, inputs: Path) -> Reference:
    """Run the command undisturbed."""
    with _folders() as (folder, temporary):
        ended = victim.run(command.line(inputs), folder, temporary, moment=lambda passed: False)
        assert ended.code == 0, f"{command.label}: {ended.messages}"
        _judge(command, folder, temporary, finished=True)
        sizes = [path.stat().st_size for path in folder.rglob("*") if path.is_file()]
        return Reference(ended.seconds, sum(sizes), max(sizes))


def judged(plan: Plan, usual: Reference, inputs: Path) -> Result:
    """Carry the plan out."""
    try:
        return Result(plan, _carried_out(plan, usual, inputs), None)
    except Exception as problem:  # whatever a check or a reader of outputs raises is the finding
        return Result(plan, "failed", f"{type(problem).__name__}: {problem}")


def _carried_out(plan: Plan, usual: Reference, inputs: Path) -> str:
    with _folders() as (above, temporary):
        folder = above / "out"
        if plan.room is None:
            folder.mkdir()
            return _killed_and_done(plan, usual, inputs, folder, temporary, None)
        pages = 2 + len(plan.command.outputs) + int(plan.room * usual.size) // PAGE_BYTES
        with disk.small(folder, pages * PAGE_BYTES) as mounted:
            largest = None if mounted else int(plan.room * usual.largest)
            return _killed_and_done(plan, usual, inputs, folder, temporary, largest)


def _killed_and_done(
    plan: Plan, usual: Reference, inputs: Path, folder: Path, temporary: Path, largest: int | None
) -> str:
    command, line = plan.command, plan.command.line(inputs)
    if plan.old:
        for name in command.outputs:
            (folder / name).write_bytes(OLD)
        line.append("--force")
    moment = _at(plan, usual, folder)
    ended = victim.run(line, folder, temporary, moment=moment, largest_file=largest)
    state = _state(plan, ended)
    _judge(command, folder, temporary, finished=False, killed=ended.killed)
    if plan.room is not None:
        disk.freed(folder)
    _done_again(command, inputs, folder)
    _judge(command, folder, temporary, finished=True)
    return state


def _at(plan: Plan, usual: Reference, folder: Path) -> Callable[[float], bool]:
    """The moment of the plan, called again and again."""
    share = plan.share
    if share is not None:
        return lambda passed: passed > share * usual.seconds
    sign: list[float] = []

    def writing(passed: float) -> bool:
        if not sign and _has_begun(plan.command, folder):
            sign.append(passed)
        return bool(sign) and passed > sign[0] + plan.after

    return writing


def _has_begun(command: Command, folder: Path) -> bool:
    """True where a temporary exists; of a study, where its folder holds a flight."""
    if command.goes_on:
        with suppress(OSError, sqlite3.DatabaseError):  # it is being written just now
            return bool(flights_of(folder / "out"))
        return False
    return any(name.endswith(".partial") for name in os.listdir(folder))


def _state(plan: Plan, ended: victim.Ended) -> str:
    if ended.killed:
        return "killed" if plan.share is not None else "killed while writing"
    assert ended.code == 0 or (ended.code == 2 and plan.room is not None), f"ended with {ended.code}: {ended.messages}"
    if ended.code == 2:
        assert len(ended.messages.splitlines()) == 1, f"said {ended.messages}"
    return "refused" if ended.code == 2 else "done before"


def _done_again(command: Command, inputs: Path, folder: Path) -> None:
    """The same command once more, undisturbed, in this process."""
    line = [*command.line(inputs), *(["--force"] if command.replaces else [])]
    before = Path.cwd()
    os.chdir(folder)
    try:
        done = CliRunner().invoke(app, line)
    finally:
        os.chdir(before)
    exists = not command.replaces and not command.goes_on and done.exit_code == 2 and "exists" in done.output
    assert done.exit_code == 0 or exists, f"done again, it ends with {done.exit_code}: {done.output}"


def _judge(command: Command, folder: Path, temporary: Path, *, finished: bool, killed: bool = False) -> None:
    """Raise where an output is neither the old one nor whole, or something else lies about.

    Only a killed process may leave temporaries, for the next one to remove.
    """
    for path in sorted(folder.rglob("*")):
        name = path.relative_to(folder).parts[0]
        if path.name.endswith(".partial") or name.endswith(".partial"):
            assert killed, f"left {path.name}"
            continue
        assert name in command.outputs, f"left {name}"
    for name, check in command.outputs.items():
        path = folder / name
        if not path.exists():
            assert not finished, f"{name} is missing"
        elif finished or not (path.is_file() and path.read_bytes() == OLD):
            check(path)
    if finished and command.goes_on:
        complete(folder / "out")
    litter = [path.name for path in temporary.iterdir()]
    assert not litter, f"left in the temporary folder: {litter}"


@contextmanager
def _folders() -> Iterator[tuple[Path, Path]]:
    """An empty folder to run in, and one for temporary files."""
    with tempfile.TemporaryDirectory(prefix="kill.") as name:
        work, temporary = Path(name) / "work", Path(name) / "tmp"
        work.mkdir()
        temporary.mkdir()
        yield work, temporary
