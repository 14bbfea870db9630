"""SIGINT and SIGTERM: a command unwinds, its workers end, and if it does not within the grace, it ends all the same."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from brv_hypo.files.whole import remove_open_temporaries

GRACE_SECONDS = 1.5  # to unwind in; workers and process are to be gone 2 s after the signal
CODES = {signal.SIGINT: 130, signal.SIGTERM: 143}
LINE = "brv-hypo: {}; no half-written output is left"
WORDS = {130: "interrupted", 143: "terminated"}

_unwinds = False
_code: int | None = None  # of the signal that arrived


class Terminated(KeyboardInterrupt):
    """SIGTERM arrived."""


def listen() -> None:
    """Handle both signals from now on."""
    for number in CODES:
        signal.signal(number, _handle)


@contextmanager
def unwinding() -> Iterator[None]:
    """In this block a signal is an exception, for everything to be cleaned up; outside it ends the process."""
    global _unwinds
    _unwinds = True
    try:
        yield
    finally:
        _unwinds = False


def code_that_arrived() -> int | None:
    """The exit code of the signal that arrived, if any: a library that was just starting may make it another error."""
    return _code


def code_of(interrupt: KeyboardInterrupt) -> int:
    """The exit code of a signal's exception."""
    return CODES[signal.SIGTERM] if isinstance(interrupt, Terminated) else CODES[signal.SIGINT]


def end_workers() -> None:
    """End the processes that work for this one, without waiting for what they do."""
    loky = sys.modules.get("joblib.externals.loky.reusable_executor")
    executor = getattr(loky, "_executor", None)
    if executor is None:
        return
    for worker in list((executor._processes or {}).values()):
        worker.kill()


def _handle(number: int, frame: FrameType | None) -> None:
    global _code
    for each in CODES:  # one is enough: a second must not disturb the unwinding of the first
        signal.signal(each, signal.SIG_IGN)
    code = _code = CODES[signal.Signals(number)]
    if not _unwinds:
        _leave(code)
    clock = threading.Timer(GRACE_SECONDS, _leave, [code])
    clock.daemon = True
    clock.start()
    raise KeyboardInterrupt if number == signal.SIGINT else Terminated


def _leave(code: int) -> None:
    """End now: workers, temporaries, a line, the process."""
    end_workers()
    remove_open_temporaries()
    os.write(2, (LINE.format(WORDS[code]) + "\n").encode())
    os._exit(code)
