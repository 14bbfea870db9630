"""The installed mechanisms and their conformance, as tables and as data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

from rich.table import Table
from rich.text import Text

from brv_hypo.mechanisms.conformance import Outcome
from brv_hypo.mechanisms.registry import Installed
from brv_hypo.report.style import plain_table

KINDS = ("mechanism", "aerodynamic", "instrument", "environment")
"""In the order of the list: what `compare` takes if nothing is named comes first."""


def listing_table(found: Mapping[str, Installed], *, verbose: bool = False) -> Table:
    """One row for each mechanism or effect: name, kind, package, claim; `verbose` adds the source."""
    table = plain_table("Installed mechanisms and effects")
    table.add_column("name", no_wrap=True, style="bold")
    table.add_column("kind", no_wrap=True)
    table.add_column("package", no_wrap=True)
    table.add_column("claims")
    if verbose:
        table.add_column("source")
    for name, entry in sorted(found.items(), key=lambda item: (KINDS.index(item[1].item.kind), item[0])):
        row = [name, entry.item.kind, f"{entry.package} {entry.version}", entry.item.claims]
        table.add_row(*row, *([entry.item.source] if verbose else []))
    return table


def listing_data(found: Mapping[str, Installed]) -> dict[str, Any]:
    """The same as data for JSON."""
    return {
        "schema": "brv-hypo/mechanisms/1",
        "mechanisms": [
            {
                "name": name,
                "kind": entry.item.kind,
                "title": entry.item.title,
                "claims": entry.item.claims,
                "source": entry.item.source,
                "package": entry.package,
                "version": entry.version,
            }
            for name, entry in found.items()
        ],
    }


def conformance_table(name: str, outcomes: Sequence[Outcome]) -> Table:
    """One row for each check, with what was found where it failed."""
    table = plain_table(f"Conformance of '{name}'")
    table.add_column("check", no_wrap=True)
    table.add_column("", no_wrap=True)
    table.add_column("found")
    for outcome in outcomes:
        passed = Text("passed", "green") if outcome.passed else Text("failed", "bold red")
        table.add_row(outcome.check.replace("_", " "), passed, outcome.detail)
    return table


def conformance_data(name: str, outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """The same as data for JSON."""
    return {
        "schema": "brv-hypo/conformance/1",
        "mechanism": name,
        "passed": all(outcome.passed for outcome in outcomes),
        "checks": [asdict(outcome) for outcome in outcomes],
    }
