"""A study as tables for the terminal."""

from __future__ import annotations

from collections.abc import Sequence

from rich.console import Group, RenderableType
from rich.text import Text

from brv_hypo.report import study_rows as rows
from brv_hypo.report.compare import add_columns
from brv_hypo.report.style import bullets, plain_table
from brv_hypo.report.style import share as percent
from brv_hypo.study import StudySummary

MOST_MISTAKES = 12
"""Mistakes that are listed; -v, the page and the CSV file hold them all."""


def study_view(summary: StudySummary, *, verbose: bool = False) -> RenderableType:
    """Confusion, calibration, detection limits, coverage; `verbose` adds each vehicle and every mistake."""
    visible = f"effect at least {percent(summary.visible_effect)} of the moment, or none"
    confusion = summary.confusion_visible
    mistakes = rows.mistake_rows(summary)
    listed = mistakes if verbose else mistakes[:MOST_MISTAKES]
    parts = [
        Text(rows.flown(summary), "bold"),
        _table(
            f"Ranked first ({visible})", rows.confusion_headings(confusion), rows.confusion_rows(confusion)
        ),
    ]
    if verbose:
        parts += [
            _table(f"Ranked first, {vehicle}", rows.confusion_headings(table), rows.confusion_rows(table))
            for vehicle, table in summary.by_vehicle.items()
        ]
    parts += [
        _table("Calibration", rows.CALIBRATION_HEADINGS, rows.calibration_rows(summary.calibration_visible)),
        Text(rows.calibration_line(summary.calibration_visible)),
        _table("Detection limits", rows.DETECTION_HEADINGS, rows.detection_rows(summary.detection)),
        _table("Planted parameters", rows.COVERAGE_HEADINGS, rows.coverage_rows(summary.coverage)),
        _table("Faults of the record", rows.FAULT_HEADINGS, rows.fault_rows(summary)),
        _table(f"Mistakes ({len(listed)} of {len(mistakes)})", rows.MISTAKE_HEADINGS, listed),
        bullets((f"{f.key}, {f.status}: {f.reason}" for f in summary.failures), "Failed", "yellow"),
        Text(f"\n{rows.headline(summary)}", "bold"),
    ]
    return Group(*parts)


def _table(title: str, headings: Sequence[str], lines: rows.Rows) -> RenderableType:
    """A titled table; nothing where it has no rows."""
    if not lines:
        return Group()
    table = plain_table()
    add_columns(table, headings)
    for line in lines:
        table.add_row(*line)
    return Group(Text(f"\n{title}", "bold"), table)
