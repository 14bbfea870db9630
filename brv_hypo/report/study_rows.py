"""The rows of a study's tables, the same in the terminal and on the page."""

from __future__ import annotations

from collections.abc import Sequence

from brv_hypo.report.style import NOT_A_NUMBER, number
from brv_hypo.report.style import share as percent
from brv_hypo.study.calibration import Calibration
from brv_hypo.study.confusion import ConfusionRow
from brv_hypo.study.coverage import SIGMAS, Coverage
from brv_hypo.study.detection import DetectionLimit
from brv_hypo.study.shares import Share
from brv_hypo.study.summary import StudySummary

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
