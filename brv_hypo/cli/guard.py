"""Exit codes: what goes wrong inside a command becomes one readable message and the contract's code."""

from __future__ import annotations

import errno
import functools
import os
import sys
import traceback
import warnings
from collections.abc import Callable
from typing import ParamSpec

import typer

from brv_hypo.cli.signals import LINE, WORDS, code_of, code_that_arrived, end_workers, unwinding
from brv_hypo.errors import BrvHypoError, UsageError
from brv_hypo.files.printed import printable

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
            code = code_of(interrupt)
            _end(f"{LINE.format(WORDS[code])}{interrupt}", code)
        except Exception as fault:
            arrived = code_that_arrived()
            if arrived is not None:
                end_workers()
                _end(LINE.format(WORDS[arrived]), arrived)
            if isinstance(fault, OSError) and fault.errno in FULL:
                _abandon_output()
                _end(
                    f"brv-hypo: an output cannot be written: {fault.strerror}. Choose another.",
                    UsageError.exit_code,
                )
            message = (
                f"brv-hypo: a fault of the program: {type(fault).__name__}: {fault}. Please report it, with "
            )
            if kwargs.get("verbose"):
                traceback.print_exc()
                _end(f"{message}the traceback above.", PROGRAM_FAULT)
            _end(f"{message}the traceback that -v prints.", PROGRAM_FAULT)

    return run


def _abandon_output() -> None:
    """Let the interpreter end without another attempt to write what cannot be written."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, sys.stdout.fileno())


def _end(message: str, code: int) -> None:
    typer.echo(printable(message), err=True)
    raise typer.Exit(code) from None
