"""`brv-hypo mechanisms`: what is installed; a new plugin; does a plugin keep the contract."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from brv_hypo.cli import completion
from brv_hypo.cli.command import in_session
from brv_hypo.cli.guard import guarded
from brv_hypo.cli.session import Session

app = typer.Typer(invoke_without_command=True, add_completion=False, rich_markup_mode=None)


@app.callback()
@guarded
@in_session("json", "force", "plugin")
def listing(session: Session, context: typer.Context) -> None:
    """List what is installed; write or check a plugin."""
    if context.invoked_subcommand is not None:
        return
    session.claim()
    from brv_hypo.mechanisms import installed
    from brv_hypo.report.mechanisms import listing_data, listing_table

    found = installed()
    session.tell(listing_table(found, verbose=session.verbose), conclusion="\n".join(found))
    session.write_json(listing_data(found))


@app.command("new")
@guarded
@in_session()
def new(
    session: Session,
    name: Annotated[str, typer.Argument(help="Name of the mechanism: lower case letters, digits and _.")],
    effect: Annotated[
        bool, typer.Option("--effect", help="An effect on the record, of an instrument or the air, instead.")
    ] = False,
    directory: Annotated[
        Path, typer.Option("-o", "--output", metavar="DIR", help="Directory to write the package into.")
    ] = Path(),
) -> None:
    """Write a ready plugin package with its tests, to start from."""
    from brv_hypo.mechanisms.template import write_plugin

    written = write_plugin(name, directory, effect=effect)
    part = "components and perturb" if effect else "the terms"
    session.show(
        f"Wrote {written}. Next:\n"
        f"  pip install -e '{written}[test]'\n"
        f"  brv-hypo mechanisms check {name}\n"
        f"then replace {part} in {written}/brv_hypo_{name}.py by your own."
    )


@app.command("check")
@guarded
@in_session("json", "force", "plugin")
def check(
    session: Session,
    name: Annotated[
        str, typer.Argument(autocompletion=completion.installed, help="Name of an installed mechanism or effect.")
    ],
) -> None:
    """Run the conformance kit on an installed mechanism or effect."""
    session.claim()
    from brv_hypo.mechanisms import find_installed
    from brv_hypo.mechanisms.conformance import conformance
    from brv_hypo.report.mechanisms import conformance_data, conformance_table

    outcomes = conformance(find_installed(name))
    failed = [outcome.check for outcome in outcomes if not outcome.passed]
    passed = f"'{name}' passes {len(outcomes) - len(failed)} of {len(outcomes)} checks."
    session.tell(conformance_table(name, outcomes), conclusion=passed)
    session.write_json(conformance_data(name, outcomes))
    if failed:
        session.warn(f"'{name}' fails {len(failed)} of {len(outcomes)} checks: {', '.join(failed)}")
        raise typer.Exit(1)
    session.show(passed)
