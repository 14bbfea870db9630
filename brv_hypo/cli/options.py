"""The options that commands share, declared once.

The aliases are evaluated by typer at start-up, so this module imports nothing heavy.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from brv_hypo.cli import completion

FlightFile = Annotated[Path, typer.Argument(metavar="FLIGHT.h5", help="Flight record, format 1.")]
FlightFiles = Annotated[
    list[Path], typer.Argument(metavar="FLIGHT.h5", help="Flight records; several are fitted jointly.")
]
Output = Annotated[Path, typer.Option("-o", "--output", metavar="FILE", help="File to write.")]
Config = Annotated[
    Path | None, typer.Option("--config", metavar="FILE.yaml", help="Settings other than the defaults.")
]
Json = Annotated[
    str | None,
    typer.Option("--json", metavar="FILE|-", help="Write the result as JSON; - is standard output."),
]
Report = Annotated[
    Path | None,
    typer.Option("--report", metavar="FILE.html", help="Write a report that any browser opens offline."),
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
        autocompletion=completion.grades,
        help="Tolerances of instruments, vehicle and air in place of the record's: laboratory, tactical, industrial, "
        "or a YAML file.",
    ),
]
AcceptRecord = Annotated[
    bool, typer.Option("--accept-record", help="Go on with a record that contradicts itself.")
]
Seed = Annotated[int | None, typer.Option("--seed", metavar="N", min=0, help="Seed of every random draw.")]
Quiet = Annotated[bool, typer.Option("-q", "--quiet", help="Print the conclusion alone.")]
Verbose = Annotated[bool, typer.Option("-v", "--verbose", help="Print every detail; tracebacks too.")]
Plugins = Annotated[
    list[Path] | None,
    typer.Option(
        "--plugin", metavar="FILE", help="Use the mechanisms of this .py or .yaml file; repeatable."
    ),
]
Force = Annotated[bool, typer.Option("--force", help="Overwrite output files that exist.")]
