"""What makes a function a command: its `Session`, and the options that the session is made from."""

from __future__ import annotations

import functools
import inspect
import sys
from collections.abc import Callable
from contextlib import nullcontext, redirect_stdout
from pathlib import Path
from typing import Any

from brv_hypo.cli import options
from brv_hypo.cli.session import Session, left_out

_SHARED = {
    "json": options.Json,
    "report": options.Report,
    "figures": options.Figures,
    "quiet": options.Quiet,
    "verbose": options.Verbose,
    "force": options.Force,
}


def _use(files: list[Path] | None) -> None:
    """Have the registry load the files named with `--plugin`; without any, leave it unimported."""
    if files or "brv_hypo.mechanisms" in sys.modules:
        from brv_hypo.mechanisms import plugin_files, use_plugin_files

        if files or plugin_files():
            use_plugin_files(files or ())


def in_session(*outputs: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Give a command its session as first argument, and the command line the options that the session needs.

    `outputs` are those of "json", "report", "figures", "force" and "plugin" that the command takes; -q and -v are
    everyone's. What was left out of the plugins is said on standard error, however quiet the command is to be.
    """
    with_plugins = "plugin" in outputs
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

    if with_plugins:
        shared.append(
            inspect.Parameter(
                "plugin", inspect.Parameter.KEYWORD_ONLY, default=None, annotation=options.Plugins
            )
        )

    def decorate(command: Callable[..., None]) -> Callable[..., None]:
        @functools.wraps(command)
        def run(**given: Any) -> None:
            if with_plugins:
                _use(given.pop("plugin"))
            session = Session(**{name: given.pop(name) for name in names})
            try:
                # Nothing but the result may reach a standard output that belongs to JSON.
                with redirect_stdout(sys.stderr) if session.json_only else nullcontext():
                    command(session, **given)
            finally:
                for reason in left_out():
                    session.warn(reason)

        declared = inspect.signature(command, eval_str=True)
        own = list(declared.parameters.values())[1:]
        signature = declared.replace(parameters=[*own, *shared])
        run.__signature__ = signature  # type: ignore[attr-defined]  # what the command line reads
        run.__annotations__ = {p.name: p.annotation for p in signature.parameters.values()}
        return run

    return decorate
