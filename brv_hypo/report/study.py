"""A study as a document."""

from __future__ import annotations

from collections.abc import Sequence

from brv_hypo.report import study_rows as rows
from brv_hypo.report.blocks import Block, Document, Picture, Shown, Table, Texts
from brv_hypo.report.study_charts import calibration_chart, effect_chart
from brv_hypo.report.style import share as percent
from brv_hypo.study import Outcome, StudySummary
from brv_hypo.study.confusion import ConfusionRow

MOST_MISTAKES = 12
"""Mistakes that the terminal lists; -v, the page and the CSV file hold them all."""


def study_document(summary: StudySummary, outcomes: Sequence[Outcome]) -> Document:
    """Confusion, calibration, detection limits, coverage; in detail each vehicle and every mistake."""
    visible = f"effect at least {percent(summary.visible_effect)} of the moment, or none"
    planted = [o for o in outcomes if o.status == "compared" and o.effect > 0.0]
    mistakes = rows.mistake_rows(summary)
    calibrated = summary.calibration_visible
    blocks: list[Block] = [
        _confusion(f"Ranked first ({visible})", summary.confusion_visible),
        *(_confusion(f"Ranked first, {name}", part, "verbose") for name, part in summary.by_vehicle.items()),
        _confusion("Ranked first, all flights", summary.confusion, "page"),
        Table(rows.CALIBRATION_HEADINGS, rows.calibration_rows(calibrated), "Calibration"),
        Texts((rows.calibration_line(calibrated),) if calibrated.flights else (), bullets=False),
        Picture(effect_chart(planted)),
        Picture(calibration_chart(calibrated)),
        Table(rows.DETECTION_HEADINGS, rows.detection_rows(summary.detection), "Detection limits"),
        Table(rows.COVERAGE_HEADINGS, rows.coverage_rows(summary.coverage), "Planted parameters"),
        Table(rows.FAULT_HEADINGS, rows.fault_rows(summary), "Faults of the record"),
        Table(rows.MISTAKE_HEADINGS, mistakes, f"Mistakes ({len(mistakes)})", most=MOST_MISTAKES),
        Texts([f"{f.key}, {f.status}: {f.reason}" for f in summary.failures], "Failed", warning=True),
    ]
    return Document(
        title=f"Study: {summary.title}",
        subtitle=(rows.flown(summary),),
        conclusion_title="Study",
        conclusion=rows.headline(summary),
        settled=not summary.failures,
        blocks=blocks,
    )


def _confusion(heading: str, part: Sequence[ConfusionRow], shown: Shown = "always") -> Table:
    """How often each hypothesis ranked first, cells shaded by their share of the row."""
    headings = rows.confusion_headings(part)
    shades = [
        [0.0, 0.0, *(row.first.get(name, 0) / max(row.flights, 1) for name in headings[2:-2]), 0.0, 0.0]
        for row in part
    ]
    return Table(headings, rows.confusion_rows(part), heading, shown=shown, shades=shades)
