"""Figures: from results to plotly figures, one function for each; they compute nothing and write nothing.

Colours are Okabe and Ito's (2008), told apart by colour-blind readers; measured data are black.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from brv_hypo.arrays import FloatArray

MEASURED = "#1a1a1a"
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
FONT = "system-ui, -apple-system, 'Segoe UI', Helvetica, Arial, sans-serif"
MILLI = 1e3
"""Moment coefficients are drawn in thousandths."""
MOST_POINTS = 6000
"""Points drawn of a history; a longer one is thinned, which no screen shows."""
PLANES = ("in plane, C<sub>N</sub>′", "out of plane, C<sub>Z</sub>′")

COEFFICIENTS = {
    "C_N'": ("C<sub>N</sub>′ · 10³", MILLI),
    "C_Z'": ("C<sub>Z</sub>′ · 10³", MILLI),
    "C_N' by alpha": ("∂C<sub>N</sub>′/∂α, 1/rad", 1.0),
    "C_Z' by alpha": ("∂C<sub>Z</sub>′/∂α, 1/rad", 1.0),
    "C_Nalpha_force": ("force C<sub>Nα</sub>, 1/rad", 1.0),
}
"""By name, the title of a coefficient's axis and the scale that goes with it."""

Values = Sequence[float] | FloatArray
Moments = tuple[Values, Values]
"""C_N' and C_Z' over time."""


class Uncertain(NamedTuple):
    """A history without gaps: time (s), value and its standard deviation."""

    time: Values
    value: Values
    sigma: Values


def motion_figure(time: Values, alpha: Values, windward_meridian: Values) -> go.Figure:
    """Angle of attack and windward meridian (rad) over time (s)."""
    figure = _stack(("angle of attack, deg", "windward meridian, deg"))
    kept = _thinned(len(time))
    for row, values in enumerate((alpha, windward_meridian), start=1):
        figure.add_trace(_line(time, np.degrees(values), kept, MEASURED), row=row, col=1)
    return finished(figure, legend=False)


def moment_figure(time: Values, measured: Moments, sigma: Values, fitted: Mapping[str, Moments]) -> go.Figure:
    """Measured moments within two standard deviations, and what each hypothesis makes of them."""
    figure = _stack([f"{plane} · 10³" for plane in PLANES])
    kept = _thinned(len(time))
    for row, values in enumerate(measured, start=1):
        band = _band(time, MILLI * np.asarray(values), MILLI * np.asarray(sigma), kept, row == 1)
        figure.add_trace(band, row=row, col=1)
        figure.add_trace(_dots(time, np.asarray(values), kept, row == 1), row=row, col=1)
        for (name, moments), colour in zip(fitted.items(), COLOURS, strict=False):
            line = _line(time, MILLI * np.asarray(moments[row - 1]), kept, colour, name, row == 1)
            figure.add_trace(line, row=row, col=1)
    return finished(figure)


def residual_figure(
    time: Values, measured: Moments, sigma: Values, fitted: Mapping[str, Moments]
) -> go.Figure:
    """Measured less fitted moments of each hypothesis, before a band of two standard deviations."""
    left = {
        name: (np.asarray(measured[0]) - np.asarray(inside), np.asarray(measured[1]) - np.asarray(outside))
        for name, (inside, outside) in fitted.items()
    }
    return leftover_figure(time, left, sigma)


def leftover_figure(time: Values, left: Mapping[str, Moments], sigma: Values) -> go.Figure:
    """Residual moments by name, before a band of two standard deviations."""
    figure = _stack([f"{plane} · 10³" for plane in PLANES])
    kept = _thinned(len(time))
    for row in (1, 2):
        band = _band(time, np.zeros(len(time)), MILLI * np.asarray(sigma), kept, row == 1)
        figure.add_trace(band, row=row, col=1)
        for (name, moments), colour in zip(left.items(), COLOURS, strict=False):
            line = _line(time, MILLI * np.asarray(moments[row - 1]), kept, colour, name, row == 1)
            figure.add_trace(line, row=row, col=1)
    return finished(figure)


def prediction_figure(time: Values, measured: Moments, predicted: Moments, half_width: Moments) -> go.Figure:
    """C_m and C_n as measured, over the band in which they are predicted."""
    figure = _stack(["C_m · 10³", "C_n · 10³"])
    kept = _thinned(len(time))
    for row, each in enumerate(zip(measured, predicted, half_width, strict=True), start=1):
        points, centre, width = (np.asarray(values, dtype=float) for values in each)
        band = _band(time, MILLI * centre, 0.5 * MILLI * width, kept, row == 1)
        figure.add_trace(band.update(name="predicted"), row=row, col=1)
        figure.add_trace(_dots(time, points, kept, row == 1), row=row, col=1)
    return finished(figure)


def coefficient_figure(histories: Mapping[str, Sequence[Uncertain]]) -> go.Figure:
    """Coefficients by name, each within two standard deviations; a history for every segment of the record."""
    shown = [COEFFICIENTS.get(name, (name, 1.0)) for name in histories]
    figure = _stack([title for title, _ in shown])
    for row, ((_, scale), segments) in enumerate(zip(shown, histories.values(), strict=True), start=1):
        for index, (time, value, sigma) in enumerate(segments):
            kept, legend = _thinned(len(time)), row == 1 and index == 0
            scaled = scale * np.asarray(value)
            band = _band(time, scaled, scale * np.asarray(sigma), kept, legend)
            figure.add_trace(band, row=row, col=1)
            figure.add_trace(_line(time, scaled, kept, COLOURS[0], "estimate", legend), row=row, col=1)
    return finished(figure, height=110 + 170 * len(shown))


def probability_figure(probability: Mapping[str, float]) -> go.Figure:
    """Probability of each hypothesis, the likeliest on top."""
    names = sorted(probability, key=lambda name: probability[name])
    figure = go.Figure(
        go.Bar(
            x=[probability[name] for name in names],
            y=names,
            orientation="h",
            marker_color=COLOURS[0],
            text=[f"{probability[name]:.2f}" for name in names],
            textposition="auto",
        )
    )
    figure.update_xaxes(title="probability", range=[0, 1])
    return finished(figure, legend=False, height=90 + 34 * len(names))


def _stack(titles: Sequence[str]) -> go.Figure:
    """Rows over one time axis, each with the title of its vertical axis."""
    figure = make_subplots(rows=len(titles), cols=1, shared_xaxes=True, vertical_spacing=0.06)
    for row, title in enumerate(titles, start=1):
        figure.update_yaxes(title_text=title, row=row, col=1)
    figure.update_xaxes(title_text="time, s", row=len(titles), col=1)
    return figure


def _thinned(size: int) -> slice:
    return slice(None, None, max(1, -(-size // MOST_POINTS)))


def _line(
    time: Values, values: FloatArray, kept: slice, colour: str, name: str = "", legend: bool = False
) -> go.Scatter:
    return go.Scatter(
        x=_compact(time[kept]),
        y=_compact(values[kept]),
        mode="lines",
        name=name,
        legendgroup=name,
        showlegend=legend,
        line={"color": colour, "width": 1.4},
    )


def _dots(time: Values, values: FloatArray, kept: slice, legend: bool) -> go.Scatter:
    return go.Scatter(
        x=_compact(time[kept]),
        y=_compact(MILLI * values[kept]),
        mode="markers",
        name="measured",
        legendgroup="measured",
        showlegend=legend,
        marker={"color": MEASURED, "size": 2.5},
    )


def _band(time: Values, centre: FloatArray, sigma: FloatArray, kept: slice, legend: bool) -> go.Scatter:
    """Two standard deviations on either side of `centre`, as one closed area."""
    upper, lower = (centre + 2.0 * sigma)[kept], (centre - 2.0 * sigma)[kept]
    there = np.asarray(time[kept])
    return go.Scatter(
        x=_compact(np.concatenate([there, there[::-1]])),
        y=_compact(np.concatenate([upper, lower[::-1]])),
        fill="toself",
        fillcolor="rgba(120, 120, 120, 0.22)",
        line={"width": 0},
        hoverinfo="skip",
        name="± 2 sigma",
        legendgroup="sigma",
        showlegend=legend,
    )


def _compact(values: Values) -> FloatArray:
    """Single precision: half the page, and finer than any screen."""
    return np.asarray(values, dtype=np.float32)


def finished(figure: go.Figure, *, legend: bool = True, height: int = 520) -> go.Figure:
    """The house style: white, thin axes, one font."""
    figure.update_layout(
        template="simple_white",
        font={"family": FONT, "size": 13},
        height=height,
        margin={"l": 70, "r": 20, "t": 24, "b": 50},
        showlegend=legend,
        legend={"orientation": "h", "yanchor": "bottom", "y": 1.02, "x": 0.0},
        hovermode="x unified",
    )
    return figure
