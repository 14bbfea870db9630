"""The charts of a study."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from brv_hypo.report.chart import Chart, Line, Panel, Role
from brv_hypo.study import Outcome
from brv_hypo.study.calibration import Calibration


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
