"""Options that several commands share and their shell completion; options of one command stand beside it.

Typer evaluates the aliases at start-up, so this module imports nothing heavy: completions import what they
need when a shell calls them.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from importlib import import_module
from pathlib import Path
from typing import Annotated

from typer import Argument, Option


def _completion(module: str, names: str, *arguments: str) -> Callable[[str], list[str]]:
    """What a shell offers of the names in a module, or by a function of it: those that begin as what is typed."""

    def beginning(incomplete: str) -> list[str]:
        known = getattr(import_module(f"brv_hypo.{module}"), names)
        return _beginning(incomplete, known(*arguments) if callable(known) else known)

    return beginning


topics = _completion("docs", "topics")
configurations = _completion("simulation.config", "config_names")  # a shell completes files where none begins so
studies = _completion("simulation.config", "config_names", "studies")
grades = _completion("flight.tolerances", "GRADES")
installed = _completion("mechanisms.registry", "installed")


def hypotheses(incomplete: str) -> list[str]:
    """A list of mechanisms, the last of which is not whole yet; commas and pluses stand between them."""
    from brv_hypo.mechanisms.registry import mechanisms

    before = re.sub(r"[^,+]*$", "", incomplete)
    names = sorted(mechanism.name for mechanism in mechanisms())
    return [before + name for name in _beginning(incomplete[len(before) :], names)]


def _beginning(incomplete: str, names: Iterable[str]) -> list[str]:
    return [name for name in names if name.startswith(incomplete)]


FlightFile = Annotated[Path, Argument(metavar="FLIGHT.h5", help="Flight record, format 1.")]
FlightFiles = Annotated[list[Path], Argument(metavar="FLIGHT.h5", help="Flight records; several are fitted jointly.")]
Output = Annotated[Path, Option("-o", "--output", metavar="FILE", help="File to write.")]
Config = Annotated[Path | None, Option("--config", metavar="FILE.yaml", help="Settings other than the defaults.")]
Json = Annotated[str | None, Option("--json", metavar="FILE|-", help="Write the result as JSON; - is standard output.")]
Report = Annotated[
    Path | None, Option("--report", metavar="FILE.html", help="Write a report that any browser opens offline.")
]
Figures = Annotated[
    Path | None,
    Option("--figures", metavar="DIR", help="Write every figure as PNG and SVG into this folder; needs matplotlib."),
]
Start = Annotated[float | None, Option("--start", metavar="T", help="Use the record from T (s).")]
Stop = Annotated[float | None, Option("--stop", metavar="T", help="Use the record up to T (s).")]
Instruments = Annotated[
    str | None,
    Option(
        "--instruments",
        metavar="GRADE|FILE",
        autocompletion=grades,
        help="Tolerances of instruments, vehicle and air in place of the record's: laboratory, tactical, industrial, "
        "or a YAML file.",
    ),
]
AcceptRecord = Annotated[bool, Option("--accept-record", help="Go on with a record that contradicts itself.")]
Seed = Annotated[int | None, Option("--seed", metavar="N", min=0, help="Seed of every random draw.")]
Quiet = Annotated[bool, Option("-q", "--quiet", help="Print the conclusion alone.")]
Verbose = Annotated[bool, Option("-v", "--verbose", help="Print every detail; tracebacks too.")]
Plugins = Annotated[
    list[Path] | None,
    Option("--plugin", metavar="FILE", help="Use the mechanisms of this .py or .yaml file; repeatable."),
]
Force = Annotated[bool, Option("--force", help="Overwrite output files that exist.")]
