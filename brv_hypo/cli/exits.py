"""Exit codes and messages of a command that ends in a refusal, a fault of the program, SIGINT or SIGTERM.

After a signal the command unwinds and its workers end; if it does not within the grace period, the process
ends all the same. `listen` handles the signals, `guarded` wraps a command.
"""

from __future__ import annotations

import errno
import functools
import os
import signal
import sys
import threading
import traceback
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import ParamSpec

import typer

from brv_hypo.errors import BrvHypoError, UsageError
from brv_hypo.io.files import remove_open_temporaries
from brv_hypo.io.text import printable

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


def end_workers() -> None:
    """End the processes that work for this one, without waiting for what they do."""
    loky = sys.modules.get("joblib.externals.loky.reusable_executor")
    executor = getattr(loky, "_executor", None)
    if executor is None:
        return
    for worker in list((executor._processes or {}).values()):
        if worker.pid is not None and worker.is_alive():
            os.kill(worker.pid, signal.SIGKILL)  # loky's workers have no kill() of their own


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


# ---- Exit codes: what goes wrong inside a command becomes one readable message and the contract's code ----

PROGRAM_FAULT = 70
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EIO)

P = ParamSpec("P")


def guarded(command: Callable[P, None]) -> Callable[P, None]:
    """The command, with its refusals and faults turned into messages on standard error and exit codes.

    Wrong usage of options never gets here: typer itself ends it with code 2.
    """

    @functools.wraps(command)
    def run(*args: P.args, **kwargs: P.kwargs) -> None:
        try:
            with unwinding(), warnings.catch_warnings():
                if not kwargs.get("verbose"):  # what a user can act on is in the result's own warnings
                    warnings.simplefilter("ignore")
                command(*args, **kwargs)
                sys.stdout.flush()
        except (typer.Exit, BrokenPipeError):
            raise
        except BrvHypoError as refusal:
            _end(f"brv-hypo: {refusal}", refusal.exit_code)
        except KeyboardInterrupt as interrupt:
            end_workers()
            code = CODES[signal.SIGTERM if isinstance(interrupt, Terminated) else signal.SIGINT]
            _end(f"{LINE.format(WORDS[code])}{interrupt}", code)
        except Exception as fault:
            if _code is not None:  # a library that was just starting may make the signal another error
                end_workers()
                _end(LINE.format(WORDS[_code]), _code)
            if isinstance(fault, OSError) and fault.errno in FULL:
                # let the interpreter end without another attempt to write what cannot be written
                os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
                reason = f"brv-hypo: an output cannot be written: {fault.strerror}. Choose another."
                _end(reason, UsageError.exit_code)
            message = f"brv-hypo: a fault of the program: {type(fault).__name__}: {fault}. Please report it, with "
            if kwargs.get("verbose"):
                traceback.print_exc()
                _end(f"{message}the traceback above.", PROGRAM_FAULT)
            _end(f"{message}the traceback that -v prints.", PROGRAM_FAULT)

    return run


def _end(message: str, code: int) -> None:
    typer.echo(printable(message), err=True)
    raise typer.Exit(code) from None
