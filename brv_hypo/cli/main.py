"""The console script: which commands there are.

Commands import what they need when they run, so that `brv-hypo --help` is quick.
"""

from __future__ import annotations

from typing import Annotated

import typer

from brv_hypo.cli import analyses, flights, plugins
from brv_hypo.cli.exits import listen

app = typer.Typer(
    name="brv-hypo",
    no_args_is_help=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _print_version(wanted: bool) -> None:
    if wanted:
        from brv_hypo.version import version

        typer.echo(f"brv-hypo {version()}")
        raise typer.Exit


@app.callback()
def program(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version and exit.")
    ] = False,
) -> None:
    """Which mechanism explains the moments that a spinning entry body flew through?"""


app.command("demo")(flights.demo)
app.command("simulate")(flights.simulate)
app.command("reconstruct")(flights.reconstruct)
app.command("compare")(analyses.compare)
app.command("trace")(analyses.trace)
app.command("predict")(analyses.predict)
app.command("study")(analyses.study)
app.command("inspect")(flights.inspect)
app.command("import")(flights.import_)
app.command("docs")(plugins.docs)
app.add_typer(plugins.mechanisms_app, name="mechanisms")
app.add_typer(plugins.config_app, name="config")


def run() -> None:
    """Run the command line; the process ends with the contract's exit code."""
    listen()
    app(prog_name="brv-hypo")
