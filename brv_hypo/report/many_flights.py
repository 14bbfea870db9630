"""A study as a document: confusion matrix, calibration, detection limits, faults of records.

Its tables, its chart, then `study_document`, the entrance.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from brv_hypo.io.text import NOT_A_NUMBER, hypothesis, number
from brv_hypo.io.text import share as percent
from brv_hypo.report.document import LARGE, Block, Chart, Document, Line, Panel, Shown, Table, Texts
from brv_hypo.study.statistics import Calibration, ConfusionRow, Share, StudySummary

MOST_MISTAKES = 12  # mistakes that the terminal lists; -v, the page and the CSV file hold them all
_CONFUSION = "Rows: what was planted; columns: what ranks first. right: it ranks first; won: the verdict names it too."
_LIMITS = "Effects that are named in 50 and 90 % of flights, in % of the moment's rms while they last."


def counted(value: Share) -> str:
    """A share with its counts and its 95 % interval, as a sentence has them."""
    interval = f" (95 %: {100 * value.low:.0f} to {100 * value.high:.0f} %)" if value.value is not None else ""
    return f"{value.count} of {value.total} flights{interval}"


def ranged(value: Share) -> str:
    """A share in percent with its 95 % interval."""
    if value.value is None:
        return NOT_A_NUMBER
    return f"{100 * value.value:.0f} %, {100 * value.low:.0f}–{100 * value.high:.0f}"


def confusion_table(heading: str, part: Sequence[ConfusionRow], shown: Shown = "always") -> Table:
    """How often each hypothesis ranked first, by what was planted; cells shaded by their share of the row."""
    names = dict.fromkeys([*(row.planted for row in part), *(name for row in part for name in row.first)])
    rows = [
        {
            "planted": hypothesis(row.planted),
            "n": str(row.flights),
            **{hypothesis(name): str(row.first.get(name, 0) or "·") for name in names},
            "right": percent(row.ranked_first.value),
            "won": percent(row.won.value),
        }
        for row in part
    ]
    shades = [{hypothesis(name): row.first.get(name, 0) / max(row.flights, 1) for name in names} for row in part]
    return Table(rows, heading, ("planted",), shown=shown, shades=shades)


def calibration_blocks(calibration: Calibration) -> list[Block]:
    """One row for each bin that holds flights; scores."""
    rows = [
        {
            "probability": f"{item.low:g}–{item.high:g}",
            "flights": str(item.right.total),
            "mean prob.": number(item.mean_probability),
            "right (95 %)": ranged(item.right),
        }
        for item in calibration.bins
        if item.right.total
    ]
    brier, loss = number(calibration.brier), number(calibration.log_loss)
    scores = f"{calibration.flights} flights: Brier score {brier}, log loss {loss}"
    return [Table(rows, "Calibration"), Texts((scores,) if calibration.flights else (), bullets=False)]


def detection_table(summary: StudySummary) -> Table:
    """One row for each planted mechanism and vehicle, and for all of several: effects flown, and those mostly won."""
    several = len({limit.vehicle for limit in summary.detection} - {None}) > 1
    rows = [
        {
            "planted": limit.planted,
            "vehicle": limit.vehicle or "all",
            "flights": str(limit.flights),
            "won": str(limit.won),
            "effects": f"{number(100.0 * limit.least, 2)}–{percent(limit.greatest)}",
            "50 %": percent(limit.half),
            "90 %": percent(limit.nine_tenths),
            "status": limit.status,
        }
        for limit in summary.detection
        if limit.vehicle is not None or several
    ]
    return Table(rows, "Detection limits", ("planted", "vehicle", "status"))


def fault_table(summary: StudySummary) -> Table:
    """One row for each fault of the record: how often it is named, and what becomes of the verdict."""
    rows = [
        {
            "fault of the record": row.fault,
            "flights": str(row.flights),
            "named": ranged(row.named),
            "wrong": ranged(row.wrong),
            "wrong, unwarned": ranged(row.unwarned),
        }
        for row in summary.faults
    ]
    return Table(rows, "Faults of the record", ("fault of the record",))


def mistake_table(summary: StudySummary) -> Table:
    """One row for each flight with a visible effect that something else than the truth leads."""
    rows = [
        {
            "flight": item.draw.key,
            "size": number(item.draw.size),
            "effect": percent(item.effect),
            "ranked first": hypothesis(item.first or ""),
            "verdict": hypothesis(item.winner or "undecided"),
            "prob.": number(item.probability.get(item.first or "")),
            "lead": number(item.lead),
        }
        for item in summary.mistakes
    ]
    return Table(rows, f"Mistakes ({len(rows)})", ("flight", "ranked first", "verdict"), most=MOST_MISTAKES)


def calibration_chart(calibration: Calibration) -> Chart:
    """Share right over stated probability, with its interval; the line is perfect calibration."""
    bins = [item for item in calibration.bins if item.right.total and item.mean_probability is not None]
    share = np.array([item.right.value for item in bins], dtype=float)
    low, high = (np.array([getattr(item.right, end) for item in bins], dtype=float) for end in ("low", "high"))
    stated, counts = [item.mean_probability or 0.0 for item in bins], [str(item.right.total) for item in bins]
    error = (share - low, high - share)
    dots = Line(stated, share, "first", "verdicts, and how many", dots=True, size=LARGE, labels=counts, error=error)
    perfect = Line([0.0, 1.0], [0.0, 1.0], "guide", "perfect", dashed=True)
    panels = [Panel("share right", [perfect, dots], range=(-0.03, 1.08))] if bins else []
    read = "Of verdicts given at 0.9, nine in ten should be right. Bars: 95 % intervals."
    titles = ("calibration", "Share right by probability", "probability of the leader")
    return Chart(*titles, panels, range=(0.0, 1.03), caption=read)


def study_document(summary: StudySummary) -> Document:
    """Confusion, calibration, detection limits; in detail each vehicle and every mistake."""
    least = percent(summary.visible_effect)
    pace = "" if summary.seconds_per_flight is None else f", {summary.seconds_per_flight:.1f} s each"
    flown = f"{summary.compared} of {summary.flights} flights compared{pace}"
    by_vehicle = summary.by_vehicle if len(summary.by_vehicle) > 1 else {}
    small = summary.confusion != summary.confusion_visible
    visible = f"Ranked first (effect at least {least} of the moment while it lasts, or none)"
    return Document(
        title=f"Study: {summary.title}",
        subtitle=(f"{summary.title}, seed {summary.seed}: {flown}",),
        conclusion_title="Study",
        conclusion=(
            f"What was planted is named in {counted(summary.named)}, another mechanism in {counted(summary.wrong)}; "
            f"false alarms in {counted(summary.false_alarms)} with nothing planted. It ranks first in "
            f"{counted(summary.right_visible)} with an effect of at least {least} of the moment while it lasts, or "
            "none." + (f" {len(summary.failures)} flights failed, and count nowhere." if summary.failures else "")
        ),
        decided=not summary.failures,
        blocks=[
            confusion_table("Ranked first, all flights", summary.confusion),
            Texts((_CONFUSION,) if summary.confusion else (), bullets=False),
            confusion_table(visible, summary.confusion_visible if small else (), "page"),
            *(confusion_table(f"Ranked first, {name}", part, "verbose") for name, part in by_vehicle.items()),
            *calibration_blocks(summary.calibration_visible),
            calibration_chart(summary.calibration_visible),
            detection_table(summary),
            Texts((_LIMITS,) if summary.detection else (), bullets=False, shown="page"),
            fault_table(summary),
            mistake_table(summary),
            Texts([f"{f.draw.key}, {f.status}: {f.reason}" for f in summary.failures], "Failed", warning=True),
        ],
    )
