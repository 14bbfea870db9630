"""`brv-hypo mechanisms`: what is installed; a new plugin; does a plugin keep the contract."""

from __future__ import annotations

import typer

from brv_hypo.cli import options
from brv_hypo.cli.guard import guarded
from brv_hypo.cli.session import Session

app = typer.Typer(
    help="List the installed mechanisms; write or check a plugin.",
    invoke_without_command=True,
    add_completion=False,
)


@app.callback()
@guarded
def listing(
    context: typer.Context,
    json: options.Json = None,
    quiet: options.Quiet = False,
    verbose: options.Verbose = False,
    force: options.Force = False,
) -> None:
    """List the installed mechanisms with their source package and claims; write or check a plugin."""
    if context.invoked_subcommand is not None:
        return
    session = Session(json=json, force=force, quiet=quiet, verbose=verbose)
    session.claim()
    from brv_hypo.mechanisms import installed
    from brv_hypo.report.mechanisms import listing_data, listing_table

    found = installed()
    session.conclude(listing_table(found, verbose=verbose))
    session.write_json(listing_data(found))
