"""One mutated input: made, given to its command in this process, judged, and made smaller where it fails."""

from __future__ import annotations

import os
import random
import resource
import shutil
import signal
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from typer.testing import CliRunner

from brv_hypo.cli.main import app
from tests.harness.fuzz.mutations import mutated
from tests.harness.fuzz.targets import TARGETS, Target, prepare

LONGEST_SECONDS = 10.0  # of processor time; three times as long by the clock
LARGEST_BYTES = 2 << 30
SOUND_CODES = (0, 1, 2, 3)
OPERATIONS = (1, 1, 1, 2, 4)  # on one input: mostly one, for two mostly end where the first does


@dataclass(frozen=True)
class Input:
    """A target and the seeds of the operations on its valid input."""

    target: Target
    seeds: tuple[int, ...]


@dataclass(frozen=True)
class Failure:
    """What went wrong with an input, as small as it could be made."""

    input: Input
    operations: tuple[str, ...]
    problem: str


def inputs(count: int, seed: int) -> Iterator[Input]:
    """`count` inputs, drawn by the seed."""
    draw = random.Random(seed)
    weights = [target.weight for target in TARGETS]
    for _ in range(count):
        operations = draw.choice(OPERATIONS)
        yield Input(draw.choices(TARGETS, weights)[0], tuple(draw.randrange(2**32) for _ in range(operations)))


def failure_of(case: Input, save: Path | None = None) -> Failure | None:
    """None where the input ends as it may; else the failure with as few operations as still fail."""
    problem, operations = judged(case)
    if problem is None:
        return None
    for seed in case.seeds:
        fewer = Input(case.target, tuple(one for one in case.seeds if one != seed))
        again, names = judged(fewer)
        if again is not None:
            case, problem, operations = fewer, again, names
    if save is not None:
        save.mkdir(parents=True, exist_ok=True)
        name = f"{case.target.label.replace(' ', '-')}-{'-'.join(map(str, case.seeds))}{Path(case.target.name).suffix}"
        judged(case, keep=save / name)
    return Failure(case, operations, problem)


def judged(case: Input, keep: Path | None = None) -> tuple[str | None, tuple[str, ...]]:
    """What is wrong with how the input ended (None: nothing), and the operations."""
    with tempfile.TemporaryDirectory(prefix="fuzz.") as name, _inside(Path(name)) as folder:
        prepare(folder)
        path = folder / case.target.name
        case.target.write(path)
        operations = mutated(path, case.target.mutations, case.seeds)
        if keep is not None:
            shutil.copy(path, keep)
        return ended(case.target.arguments, folder), operations


def ended(arguments: tuple[str, ...], folder: Path) -> str | None:
    """What is wrong with how a command in this folder ends; None where nothing is."""
    before = {entry.name for entry in folder.iterdir()}
    begun = _processor_seconds()
    with _limited():
        done = CliRunner().invoke(app, list(arguments))
    seconds = _processor_seconds() - begun
    if seconds > LONGEST_SECONDS:
        return f"took {seconds:.0f} s"
    if done.exit_code not in SOUND_CODES:
        return f"exit code {done.exit_code}: {done.output[-600:]}"
    if done.exception is not None and not isinstance(done.exception, SystemExit):
        return f"{type(done.exception).__name__}: {done.exception}"
    if "\x1b" in done.output or "Traceback" in done.output:
        return f"printed {done.output[-600:]!r}"
    new = {entry.name for entry in folder.iterdir()} - before
    if new - ({"out.h5"} if done.exit_code == 0 else set()):
        return f"left {sorted(new)} with exit code {done.exit_code}"
    largest = 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return f"took {largest >> 20} MB" if largest > LARGEST_BYTES else None


def _processor_seconds() -> float:
    """Of this process and its children: another program that keeps the machine busy does not count.

    The reading child outlives its inputs: what it has taken so far counts while it lives, or the input that ends it
    would pay for all before.
    """
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    living = sum(_seconds_of(number) for number in _living_children())
    return time.process_time() + children.ru_utime + children.ru_stime + living


def _living_children() -> list[str]:
    """Process numbers of the children of every thread."""
    return [number for path in Path("/proc/self/task").glob("*/children") for number in _content(path).split()]


def _content(path: Path) -> str:
    """What the system says of a thread or process; nothing where it has just ended."""
    try:
        return path.read_text()
    except OSError:
        return ""


def _seconds_of(number: str) -> float:
    """Processor seconds of a living process; 0 where it has just ended."""
    fields = _content(Path(f"/proc/{number}/stat")).rpartition(")")[2].split()
    if not fields:
        return 0.0
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


@contextmanager
def _inside(folder: Path) -> Iterator[Path]:
    before = Path.cwd()
    os.chdir(folder)
    try:
        yield folder
    finally:
        os.chdir(before)


@contextmanager
def _limited() -> Iterator[None]:
    """End what hangs, as an error that the command's guard calls a fault."""

    def stop(number: int, frame: Any) -> None:
        raise TimeoutError(f"no end in {LONGEST_SECONDS:g} s")

    before = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, 3.0 * LONGEST_SECONDS)
    try:
        with suppress(TimeoutError):
            yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
