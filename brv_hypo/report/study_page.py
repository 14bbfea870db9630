"""A study as a page."""

from __future__ import annotations

from collections.abc import Sequence

from brv_hypo.report import study_figures as figures
from brv_hypo.report import study_rows as rows
from brv_hypo.report.pages import Block, drawn, page, table
from brv_hypo.report.style import share as percent
from brv_hypo.study import Outcome, StudySummary
from brv_hypo.study.calibration import Calibration
from brv_hypo.study.confusion import ConfusionRow


def study_page(summary: StudySummary, outcomes: Sequence[Outcome]) -> str:
    """Confusion, calibration, detection limits, coverage, and every mistake."""
    visible = f"effect of at least {percent(summary.visible_effect)}, or none"
    planted = [o for o in outcomes if o.status == "compared" and o.effect > 0.0]
    blocks = [
        Block(f"Ranked first ({visible})", _drawn_confusion(summary.confusion_visible)),
        *(Block(f"Ranked first, {name}", _confusion(part)) for name, part in summary.by_vehicle.items()),
        Block("Ranked first, all flights", _confusion(summary.confusion)),
        Block(f"Calibration ({visible})", _calibration(summary.calibration_visible)),
        Block("Calibration, all flights", _calibration(summary.calibration)),
        Block("Effects", drawn(figures.effect_figure(planted)) if planted else ""),
        Block("Detection limits", _filled(rows.DETECTION_HEADINGS, rows.detection_rows(summary.detection))),
        Block("Planted parameters", _filled(rows.COVERAGE_HEADINGS, rows.coverage_rows(summary.coverage))),
        Block("Faults of the record", _filled(rows.FAULT_HEADINGS, rows.fault_rows(summary))),
        Block("Mistakes", _filled(rows.MISTAKE_HEADINGS, rows.mistake_rows(summary))),
        Block("Failed", _filled(rows.FAILURE_HEADINGS, rows.failure_rows(summary))),
    ]
    return page(f"Study: {summary.title}", rows.flown(summary), rows.headline(summary), blocks)


def _drawn_confusion(part: Sequence[ConfusionRow]) -> str:
    return drawn(figures.confusion_figure(part)) + _confusion(part) if part else ""


def _confusion(part: Sequence[ConfusionRow]) -> str:
    return _filled(rows.confusion_headings(part), rows.confusion_rows(part))


def _calibration(calibration: Calibration) -> str:
    if not calibration.flights:
        return ""
    line = f"<p>{rows.calibration_line(calibration)}</p>"
    return (
        drawn(figures.calibration_figure(calibration))
        + table(rows.CALIBRATION_HEADINGS, rows.calibration_rows(calibration))
        + line
    )


def _filled(headings: Sequence[str], lines: rows.Rows) -> str:
    """A table; nothing where it has no rows."""
    return table(headings, lines) if lines else ""
