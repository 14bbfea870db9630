"""The process that is killed: begun, killed at its moment, and what it leaves running."""

from __future__ import annotations

import os
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

LONGEST_SECONDS = 300.0
ORPHANS_MAY_TAKE_SECONDS = 20.0  # to see that their parent is gone, on a busy machine
_POLL_SECONDS = 2e-4


@dataclass(frozen=True)
class Ended:
    """`code` as of `subprocess`; `killed` whether we came before its own end; `messages` of standard error."""

    code: int
    killed: bool
    messages: str
    seconds: float


def run(
    arguments: list[str],
    folder: Path,
    temporary: Path,
    *,
    moment: Callable[[float], bool],
    largest_file: int | None = None,
) -> Ended:
    """Run the program in `folder` and kill it when `moment`, called with the seconds since its begin, says so."""

    def limit() -> None:
        if largest_file is not None:
            resource.setrlimit(resource.RLIMIT_FSIZE, (largest_file, largest_file))

    paths = os.pathsep.join(path for path in (os.getcwd(), *sys.path) if path)
    errors = temporary / "messages"
    with errors.open("w+") as stream:
        process = subprocess.Popen(
            [sys.executable, "-m", "brv_hypo", *arguments],
            cwd=folder,
            env={**os.environ, "PYTHONPATH": paths, "TMPDIR": str(temporary)},
            stdout=subprocess.DEVNULL,
            stderr=stream,
            start_new_session=True,
            preexec_fn=limit,
        )
        begun, killed = time.monotonic(), False
        while process.poll() is None and not killed:
            passed = time.monotonic() - begun
            killed = passed > LONGEST_SECONDS or moment(passed)
            if not killed:
                time.sleep(_POLL_SECONDS)
        process.send_signal(signal.SIGKILL)
        code = process.wait()
        left = orphans_of(process.pid)
        stream.seek(0)
        messages = stream.read()
    errors.unlink()
    assert not left, f"still running after {ORPHANS_MAY_TAKE_SECONDS:g} s: {left}"
    shared = [entry.name for entry in Path("/dev/shm").glob("*") if f"-{process.pid}-" in entry.name]
    assert not shared, f"left in shared memory: {shared}"
    return Ended(code, killed and code == -signal.SIGKILL, messages, time.monotonic() - begun)


def orphans_of(session: int) -> list[str]:
    """Commands of the processes that outlive their session's leader by more than they may; these are ended."""
    patience = time.monotonic() + ORPHANS_MAY_TAKE_SECONDS
    while (left := _members_of(session)) and time.monotonic() < patience:
        time.sleep(0.05)
    for number in left:
        os.kill(number, signal.SIGKILL)
    return list(left.values())


def _members_of(session: int) -> dict[int, str]:
    found = {}
    for entry in Path("/proc").glob("[0-9]*"):
        try:
            fields = (entry / "stat").read_text().rpartition(")")[2].split()
            if int(fields[3]) == session and fields[0] != "Z":
                found[int(entry.name)] = (entry / "cmdline").read_text().replace("\0", " ").strip()
        except OSError:
            continue
    return found
