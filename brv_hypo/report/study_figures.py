"""Figures of a study."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import plotly.graph_objects as go

from brv_hypo.report.figures import COLOURS, MEASURED, finished
from brv_hypo.report.study_rows import confusion_headings
from brv_hypo.study import Outcome
from brv_hypo.study.calibration import Calibration
from brv_hypo.study.confusion import ConfusionRow


def confusion_figure(rows: Sequence[ConfusionRow]) -> go.Figure:
    """Shares of what ranked first, one line for each planted mechanism."""
    names = confusion_headings(rows)[2:-2]
    counts = [[row.first.get(name, 0) for name in names] for row in rows]
    figure = go.Figure(
        go.Heatmap(
            x=names,
            y=[row.planted for row in rows],
            z=[
                [100.0 * n / max(row.flights, 1) for n in line]
                for row, line in zip(rows, counts, strict=True)
            ],
            text=[[str(n) if n else "" for n in line] for line in counts],
            texttemplate="%{text}",
            colorscale=[[0.0, "#ffffff"], [1.0, COLOURS[0]]],
            zmin=0.0,
            zmax=100.0,
            colorbar={"title": "% of flights"},
            hovertemplate="planted %{y}, first %{x}: %{z:.0f} %<extra></extra>",
        )
    )
    figure.update_xaxes(title="ranked first", type="category")
    figure.update_yaxes(title="planted", type="category", autorange="reversed")
    return finished(figure, legend=False, height=160 + 44 * len(rows))


def calibration_figure(calibration: Calibration) -> go.Figure:
    """Share right over stated probability, with its interval; the line is perfect calibration."""
    bins = [item for item in calibration.bins if item.right.value is not None]
    share = np.array([item.right.value for item in bins])
    figure = go.Figure(
        go.Scatter(x=[0, 1], y=[0, 1], mode="lines", line={"color": "#999999", "dash": "dot"}, name="perfect")
    )
    figure.add_trace(
        go.Scatter(
            x=[item.mean_probability for item in bins],
            y=share,
            mode="markers+text",
            text=[str(item.right.total) for item in bins],
            textposition="top left",
            marker={"color": MEASURED, "size": 8},
            error_y={
                "type": "data",
                "symmetric": False,
                "array": [item.right.high for item in bins] - share,
                "arrayminus": share - np.array([item.right.low for item in bins]),
            },
            name="verdicts, with their number",
        )
    )
    figure.update_xaxes(title="probability of the leader", range=[0, 1.03])
    figure.update_yaxes(title="share right", range=[-0.03, 1.03])
    return finished(figure, height=420)


def effect_figure(outcomes: Sequence[Outcome]) -> go.Figure:
    """Every planted flight: effect over mechanism; won, first without a verdict, or missed."""
    kinds = (
        ("won", COLOURS[2], [o for o in outcomes if o.won]),
        ("first, undecided", COLOURS[4], [o for o in outcomes if o.right and not o.won]),
        ("missed", COLOURS[1], [o for o in outcomes if not o.right]),
    )
    figure = go.Figure()
    for name, colour, flights in kinds:
        figure.add_trace(
            go.Scatter(
                x=[100.0 * o.effect for o in flights],
                y=[f"{o.planted}, {o.draw.vehicle}" for o in flights],
                mode="markers",
                name=name,
                marker={"color": colour, "size": 9, "opacity": 0.75},
                text=[f"{o.draw.key}: {o.verdict}" for o in flights],
                hovertemplate="%{text}<extra></extra>",
            )
        )
    lines = sorted({f"{o.planted}, {o.draw.vehicle}" for o in outcomes})
    figure.update_xaxes(title="effect, % of the moment's rms while it lasts", type="log")
    figure.update_yaxes(type="category", categoryorder="array", categoryarray=lines, autorange="reversed")
    finished(figure, height=160 + 28 * len(lines))
    return figure.update_layout(hovermode="closest", margin={"l": 200})
