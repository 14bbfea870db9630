"""What makes a function a command: its `Session`, and the options that the session is made from."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from typing import Any

from brv_hypo.cli import options
from brv_hypo.cli.session import Session

_SHARED = {
    "json": options.Json,
    "report": options.Report,
    "quiet": options.Quiet,
    "verbose": options.Verbose,
    "force": options.Force,
}


def in_session(*outputs: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Give a command its session as first argument, and the command line the options that the session needs.

    `outputs` are those of "json", "report" and "force" that the command takes; -q and -v are everyone's.
    """
    names = [name for name in _SHARED if name in (*outputs, "quiet", "verbose")]
    shared = [
        inspect.Parameter(
            name,
            inspect.Parameter.KEYWORD_ONLY,
            default=getattr(Session, name),
            annotation=_SHARED[name],
        )
        for name in names
    ]

    def decorate(command: Callable[..., None]) -> Callable[..., None]:
        @functools.wraps(command)
        def run(**given: Any) -> None:
            session = Session(**{name: given.pop(name) for name in names})
            command(session, **given)

        declared = inspect.signature(command, eval_str=True)
        own = list(declared.parameters.values())[1:]
        signature = declared.replace(parameters=[*own, *shared])
        run.__signature__ = signature  # type: ignore[attr-defined]  # what the command line reads
        run.__annotations__ = {p.name: p.annotation for p in signature.parameters.values()}
        return run

    return decorate
