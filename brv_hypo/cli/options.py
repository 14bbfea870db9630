"""Options that several commands share and their shell completion; options of one command stand beside it.

Typer evaluates the aliases at start-up, so this module imports nothing heavy: completions import what they
need when a shell calls them.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated

import typer


def topics(incomplete: str) -> list[str]:
    """Topics of the manual that begin so."""
    from brv_hypo.docs import topics as known

    return _beginning(incomplete, known())


def configurations(incomplete: str) -> list[str]:
    """Simulations that come along; a shell completes files where none begins so."""
    from brv_hypo.simulation.config import config_names

    return _beginning(incomplete, config_names())


def studies(incomplete: str) -> list[str]:
    """Studies that come along."""
    from brv_hypo.simulation.config import config_names

    return _beginning(incomplete, config_names("studies"))


def grades(incomplete: str) -> list[str]:
    """Grades of instruments."""
    from brv_hypo.flight.tolerances import GRADES

    return _beginning(incomplete, GRADES)


def installed(incomplete: str) -> list[str]:
    """Mechanisms and record effects."""
    from brv_hypo.mechanisms.registry import installed as known

    return _beginning(incomplete, sorted(known()))


def hypotheses(incomplete: str) -> list[str]:
    """A list of mechanisms, the last of which is not whole yet; commas and pluses stand between them."""
    from brv_hypo.mechanisms.registry import mechanisms

    before = re.sub(r"[^,+]*$", "", incomplete)
    names = sorted(mechanism.name for mechanism in mechanisms())
    return [before + name for name in _beginning(incomplete[len(before) :], names)]


def _beginning(incomplete: str, names: Iterable[str]) -> list[str]:
    return [name for name in names if name.startswith(incomplete)]


# ---- The options that commands share, declared once ----

FlightFile = Annotated[Path, typer.Argument(metavar="FLIGHT.h5", help="Flight record, format 1.")]
FlightFiles = Annotated[
    list[Path], typer.Argument(metavar="FLIGHT.h5", help="Flight records; several are fitted jointly.")
]
Output = Annotated[Path, typer.Option("-o", "--output", metavar="FILE", help="File to write.")]
Config = Annotated[Path | None, typer.Option("--config", metavar="FILE.yaml", help="Settings other than the defaults.")]
Json = Annotated[
    str | None, typer.Option("--json", metavar="FILE|-", help="Write the result as JSON; - is standard output.")
]
Report = Annotated[
    Path | None, typer.Option("--report", metavar="FILE.html", help="Write a report that any browser opens offline.")
]
Figures = Annotated[
    Path | None,
    typer.Option(
        "--figures", metavar="DIR", help="Write every figure as PNG and SVG into this folder; needs matplotlib."
    ),
]
Start = Annotated[float | None, typer.Option("--start", metavar="T", help="Use the record from T (s).")]
Stop = Annotated[float | None, typer.Option("--stop", metavar="T", help="Use the record up to T (s).")]
Instruments = Annotated[
    str | None,
    typer.Option(
        "--instruments",
        metavar="GRADE|FILE",
        autocompletion=grades,
        help="Tolerances of instruments, vehicle and air in place of the record's: laboratory, tactical, industrial, "
        "or a YAML file.",
    ),
]
AcceptRecord = Annotated[bool, typer.Option("--accept-record", help="Go on with a record that contradicts itself.")]
Seed = Annotated[int | None, typer.Option("--seed", metavar="N", min=0, help="Seed of every random draw.")]
Quiet = Annotated[bool, typer.Option("-q", "--quiet", help="Print the conclusion alone.")]
Verbose = Annotated[bool, typer.Option("-v", "--verbose", help="Print every detail; tracebacks too.")]
Plugins = Annotated[
    list[Path] | None,
    typer.Option("--plugin", metavar="FILE", help="Use the mechanisms of this .py or .yaml file; repeatable."),
]
Force = Annotated[bool, typer.Option("--force", help="Overwrite output files that exist.")]
