"""The installed mechanisms and their conformance, as tables and as data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

from rich.table import Table
from rich.text import Text

from brv_hypo.mechanisms.conformance import Outcome
from brv_hypo.mechanisms.loading import OWN
from brv_hypo.mechanisms.registry import Installed
from brv_hypo.report.style import plain_table
from brv_hypo.version import version

KINDS = ("mechanism", "aerodynamic", "instrument", "environment")
"""In the order of the list: what `compare` takes if nothing is named comes first."""


def listing_table(found: Mapping[str, Installed], *, verbose: bool = False) -> Table:
    """One row for each mechanism or effect: name, kind, claim; below the claim the package, where it is another's;
    `verbose` adds package and source of all.
    """
    table = plain_table(f"Mechanisms and effects, of {OWN} {version()} where no other package is named")
    table.add_column("name", no_wrap=True, style="bold")
    table.add_column("kind", no_wrap=True)
    table.add_column("claims", overflow="fold")
    for name, entry in sorted(found.items(), key=lambda item: (KINDS.index(item[1].item.kind), item[0])):
        told = [entry.item.claims]
        if verbose or entry.package != OWN:
            told.append(f"package: {entry.package} {entry.version}")
        if verbose:
            told.append(f"source: {entry.item.source}")
        table.add_row(name, entry.item.kind, "\n".join(told))
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
