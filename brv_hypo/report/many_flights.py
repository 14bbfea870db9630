"""A study as a document: confusion matrix, calibration, detection limits, coverage of the planted parameters.

Rows of its tables, its two charts, then `study_document`, the entrance.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from brv_hypo.report.document import Block, Chart, Document, Line, Panel, Picture, Role, Shown, Table, Texts
from brv_hypo.report.style import NOT_A_NUMBER, number
from brv_hypo.report.style import share as percent
from brv_hypo.study import Outcome
from brv_hypo.study.statistics import (
    SIGMAS,
    Calibration,
    ConfusionRow,
    Coverage,
    DetectionLimit,
    Share,
    StudySummary,
)

# ---- The rows of a study's tables, the same in the terminal and on the page ----


Rows = list[tuple[str, ...]]

CALIBRATION_HEADINGS = ("probability", "flights", "mean prob.", "right (95 %)")
DETECTION_HEADINGS = ("planted", "vehicle", "flights", "won", "effects", "50 %", "90 %", "status")
COVERAGE_HEADINGS = (
    *("planted", "parameter", "unit", "known", "missing"),
    *(f"in {SIGMAS:g} sigma", "rms/sigma", "error"),
)
MISTAKE_HEADINGS = ("flight", "size", "effect", "ranked first", "verdict", "prob.", "lead")
FAULT_HEADINGS = ("fault of the record", "flights", "named", "wrong", "wrong, unwarned")


def headline(summary: StudySummary) -> str:
    """The outcome in one sentence."""
    return (
        f"What was planted ranks first in {counted(summary.right_visible)} flights with an effect of at "
        f"least {percent(summary.visible_effect)} of the moment, or with none; false alarms in "
        f"{counted(summary.false_alarms)} flights with none."
    )


def flown(summary: StudySummary) -> str:
    """How many flights there were."""
    pace = "" if summary.seconds_per_flight is None else f", {summary.seconds_per_flight:.1f} s each"
    compared = f"{summary.compared} of {summary.flights} flights compared"
    return f"{summary.title}, seed {summary.seed}: {compared}{pace}"


def counted(value: Share) -> str:
    """A share with its counts."""
    return f"{value.count} of {value.total}" + (f" ({ranged(value)})" if value.total else "")


def ranged(value: Share) -> str:
    """A share in percent with its 95 % interval."""
    if value.value is None:
        return NOT_A_NUMBER
    return f"{100 * value.value:.0f} %, {100 * value.low:.0f}–{100 * value.high:.0f}"


def confusion_headings(rows: Sequence[ConfusionRow]) -> tuple[str, ...]:
    """Planted, then a column for everything that ranked first."""
    return ("planted", "n", *_names(rows), "right", "won")


def confusion_rows(rows: Sequence[ConfusionRow]) -> Rows:
    """One row for each planted mechanism: how often each hypothesis ranked first."""
    names = _names(rows)
    return [
        (
            row.planted,
            str(row.flights),
            *(str(row.first.get(name, 0) or "·") for name in names),
            percent(row.ranked_first.value),
            percent(row.won.value),
        )
        for row in rows
    ]


def _names(rows: Sequence[ConfusionRow]) -> list[str]:
    planted = [row.planted for row in rows]
    return list(dict.fromkeys([*planted, *(name for row in rows for name in row.first)]))


def calibration_rows(calibration: Calibration) -> Rows:
    """One row for each bin that holds flights."""
    return [
        (
            f"{item.low:g}–{item.high:g}",
            str(item.right.total),
            number(item.mean_probability),
            ranged(item.right),
        )
        for item in calibration.bins
        if item.right.total
    ]


def calibration_line(calibration: Calibration) -> str:
    """Scores, and the temperature that would serve better."""
    best = calibration.best_temperature
    least = (
        "the flights cannot set a better one"
        if best is None
        else f"least {number(calibration.best_log_loss)} at {number(best, 2)}"
    )
    return (
        f"{calibration.flights} flights: Brier score {number(calibration.brier)}, log loss "
        f"{number(calibration.log_loss)} at temperature {calibration.temperature:g}; {least}"
    )


def detection_rows(limits: Sequence[DetectionLimit]) -> Rows:
    """One row for each planted mechanism and vehicle: the effects flown, and those won in 50 % and 90 %."""
    return [
        (
            limit.planted,
            limit.vehicle or "all",
            str(limit.flights),
            str(limit.won),
            f"{number(100.0 * limit.least, 2)}–{percent(limit.greatest)}",
            percent(limit.half),
            percent(limit.nine_tenths),
            limit.status,
        )
        for limit in limits
    ]


def coverage_rows(coverages: Sequence[Coverage]) -> Rows:
    """One row for each planted parameter; "error" is the median of the absolute errors."""
    return [
        (
            item.planted,
            item.parameter,
            item.units,
            str(item.covered.total),
            str(item.missing),
            percent(item.covered.value),
            number(item.rms_sigmas),
            number(item.median_error, 2),
        )
        for item in coverages
    ]


def mistake_rows(summary: StudySummary) -> Rows:
    """One row for each flight with a visible effect that something else than the truth leads."""
    return [
        (
            item.key,
            number(item.size),
            percent(item.effect),
            item.first,
            item.winner or "undecided",
            number(item.probability),
            NOT_A_NUMBER if item.lead is None else number(item.lead),
        )
        for item in summary.mistakes
    ]


def fault_rows(summary: StudySummary) -> Rows:
    """One row for each fault of the record: how often it is named, and what becomes of the verdict."""
    return [
        (row.fault, str(row.flights), ranged(row.named), ranged(row.wrong), ranged(row.unwarned))
        for row in summary.faults
    ]


# ---- The charts of a study ----


def calibration_chart(calibration: Calibration) -> Chart:
    """Share right over stated probability, with its interval; the line is perfect calibration."""
    bins = [item for item in calibration.bins if item.right.total and item.mean_probability is not None]
    share = np.array([item.right.value for item in bins], dtype=float)
    low, high = (np.array([getattr(item.right, end) for item in bins], dtype=float) for end in ("low", "high"))
    dots = Line(
        np.array([item.mean_probability for item in bins], dtype=float),
        share,
        "first",
        "verdicts, with their number",
        dots=True,
        large=True,
        labels=[str(item.right.total) for item in bins],
        error=(share - low, high - share),
    )
    perfect = Line([0.0, 1.0], [0.0, 1.0], "guide", "perfect", dashed=True)
    panels = [Panel("share right", [perfect, dots], range=(-0.03, 1.08))] if bins else []
    read = "Of verdicts given at 0.9, nine in ten should be right. Bars: 95 % intervals."
    return Chart("calibration", "Calibration", "probability of the leader", panels, range=(0.0, 1.03), caption=read)


def effect_chart(outcomes: Sequence[Outcome]) -> Chart:
    """Every planted flight: effect over mechanism and vehicle; won, first without a verdict, or missed."""
    lines = sorted({_line(o) for o in outcomes})
    kinds: tuple[tuple[str, Role, list[Outcome]], ...] = (
        ("won", "third", [o for o in outcomes if o.won]),
        ("first, undecided", "first", [o for o in outcomes if o.right and not o.won]),
        ("missed", "second", [o for o in outcomes if not o.right]),
    )
    layers = [
        Line([100.0 * o.effect for o in some], [lines.index(_line(o)) for o in some], role, name, dots=True,
             large=True)
        for name, role, some in kinds
        if some
    ]  # fmt: skip
    panels = [Panel("", layers, categories=lines)] if layers else []
    title = "effect, % of the moment's rms while it lasts"
    read = "A dot for every flight with a mechanism planted."
    return Chart("effects", "Effects", title, panels, log=True, caption=read)


def _line(outcome: Outcome) -> str:
    return f"{outcome.planted}, {outcome.draw.vehicle}"


# ---- A study as a document ----


MOST_MISTAKES = 12
"""Mistakes that the terminal lists; -v, the page and the CSV file hold them all."""


def study_document(summary: StudySummary, outcomes: Sequence[Outcome]) -> Document:
    """Confusion, calibration, detection limits, coverage; in detail each vehicle and every mistake."""
    visible = f"effect at least {percent(summary.visible_effect)} of the moment, or none"
    planted = [o for o in outcomes if o.status == "compared" and o.effect > 0.0]
    mistakes = mistake_rows(summary)
    calibrated = summary.calibration_visible
    blocks: list[Block] = [
        _confusion(f"Ranked first ({visible})", summary.confusion_visible),
        *(_confusion(f"Ranked first, {name}", part, "verbose") for name, part in summary.by_vehicle.items()),
        _confusion("Ranked first, all flights", summary.confusion, "page"),
        Table(CALIBRATION_HEADINGS, calibration_rows(calibrated), "Calibration"),
        Texts((calibration_line(calibrated),) if calibrated.flights else (), bullets=False),
        Picture(effect_chart(planted)),
        Picture(calibration_chart(calibrated)),
        Table(DETECTION_HEADINGS, detection_rows(summary.detection), "Detection limits"),
        Table(COVERAGE_HEADINGS, coverage_rows(summary.coverage), "Planted parameters"),
        Table(FAULT_HEADINGS, fault_rows(summary), "Faults of the record"),
        Table(MISTAKE_HEADINGS, mistakes, f"Mistakes ({len(mistakes)})", most=MOST_MISTAKES),
        Texts([f"{f.key}, {f.status}: {f.reason}" for f in summary.failures], "Failed", warning=True),
    ]
    return Document(
        title=f"Study: {summary.title}",
        subtitle=(flown(summary),),
        conclusion_title="Study",
        conclusion=headline(summary),
        decided=not summary.failures,
        blocks=blocks,
    )


def _confusion(heading: str, part: Sequence[ConfusionRow], shown: Shown = "always") -> Table:
    """How often each hypothesis ranked first, cells shaded by their share of the row."""
    headings = confusion_headings(part)
    shades = [
        [0.0, 0.0, *(row.first.get(name, 0) / max(row.flights, 1) for name in headings[2:-2]), 0.0, 0.0]
        for row in part
    ]
    return Table(headings, confusion_rows(part), heading, shown=shown, shades=shades)
