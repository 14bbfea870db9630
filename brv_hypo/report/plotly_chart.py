"""A chart as the data that plotly's script draws: traces and layout, colours as names of CSS variables."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from typing import Any

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.report.chart import MOST_OF_A_PATH, Band, Bars, Chart, Line, Panel, Path, Values, named, thinned

_UNEVEN = 1e-3
"""Share of a step by which times may be uneven and still be given as start and step."""
_FEWEST_DECADES, _MOST_DECADES = 1.5, 6.0
"""Decades beyond which a logarithmic axis has no ticks between powers of ten, and most of them that have one."""
_HEIGHT = {"panel": 190, "frame": 105, "bar": 26, "gap": 32}
_STRETCHES = {1: 415, 2: 330, 3: 230, 4: 175}
"""Height of a row of stretches of a path by how many stand in it: squares, and their titles."""
_AXIS = {
    "linecolor": "--ink",
    "gridcolor": "--rule",
    "zerolinecolor": "--rule",
    "tickcolor": "--ink",
    "ticks": "outside",
    "showline": True,
    "automargin": True,
    "exponentformat": "none",
}
_BESIDE_BARS = 1.18
"""The axis of bars without a range of its own goes so far beyond the longest, where its text stands."""
_LEAST_PLAIN, _MOST_PLAIN = 1e-3, 1e6
"""Numbers between these have no exponent (style.number)."""
_NAME = 13
"""Height of a mark's name, px."""


def plotly_chart(chart: Chart) -> dict[str, Any]:
    """Traces, layout and height (px) of a chart; of a path what the page makes them of."""
    if chart.path is not None:
        return _plotly_path(chart, chart.path)
    traces: list[dict[str, Any]] = []
    told: set[str] = set()
    for row, panel in enumerate(chart.panels, start=1):
        for layer in panel.layers:
            for trace in _traces(layer):
                name = trace.get("name", "")
                group = "" if isinstance(layer, Bars) else layer.name
                place = {"xaxis": "x", "yaxis": "y" if row == 1 else f"y{row}", "legendgroup": group}
                traces.append({**trace, **place, "showlegend": bool(name) and name not in told})
                told.add(name)
    return {"traces": traces, "layout": _layout(chart), "time": chart.over_time, "height": chart_height(chart)}


def _plotly_path(chart: Chart, path: Path) -> dict[str, Any]:
    curve = {"t": path.time, "x": path.x, "y": path.y}
    histories = {name: _bits(thinned(values, MOST_OF_A_PATH))["bdata"] for name, values in curve.items()}
    rule = {"cycle": path.cycle, "cycles": path.cycles, "columns": path.columns, "most": path.most}
    titles = {"xTitle": chart.x, "yTitle": path.y_title}
    return {"path": {**histories, **rule, **titles, "axis": _AXIS}, "time": False, "height": chart_height(chart)}


def _traces(layer: Line | Band | Bars) -> list[dict[str, Any]]:
    if isinstance(layer, Bars):
        return [_bars(layer)]
    if isinstance(layer, Band):
        return _band(layer)
    return [_line(layer)]


def _line(layer: Line) -> dict[str, Any]:
    colour = f"--{layer.role}"
    trace: dict[str, Any] = {
        **_over(layer.x),
        "type": "scatter",
        "y": _packed(layer.y),
        "name": layer.name,
        "mode": ("markers+text" if layer.labels else "markers") if layer.dots else "lines",
    }
    if layer.dots:
        trace["marker"] = {"color": colour, "size": 8 if layer.large else 2.6}
    else:
        trace["line"] = {"color": colour, "width": 1.5, **({"dash": "dot"} if layer.dashed else {})}
    if layer.labels:
        text = [label.replace("\n", "<br>") for label in layer.labels]
        trace |= {"text": text, "textposition": "middle right", "cliponaxis": False}
    if layer.error is not None:
        below, above = (np.asarray(values, dtype=float).tolist() for values in layer.error)
        trace["error_y"] = {
            "type": "data", "symmetric": False, "array": above, "arrayminus": below, "color": colour
        }  # fmt: skip
    return trace


def _band(layer: Band) -> list[dict[str, Any]]:
    """Two edges, the upper filled down to the lower; closed areas where the band has breaks, none where it has no
    width.
    """
    if not np.any(np.isfinite(layer.low)):
        return []
    if not np.all(np.isfinite(layer.low)):
        return [_broken_band(layer)]
    edge = {**_over(layer.x), "type": "scatter", "mode": "lines", "line": {"width": 0}, "hoverinfo": "skip"}
    fill = {"name": layer.name, "fill": "tonexty", "fillcolor": f"--{layer.role}-band"}
    return [{**edge, "y": _packed(layer.low)}, {**edge, **fill, "y": _packed(layer.high)}]


def _broken_band(layer: Band) -> dict[str, Any]:
    x, low, high = (thinned(values) for values in (layer.x, layer.low, layer.high))
    there: list[FloatArray] = []
    around: list[FloatArray] = []
    edges = np.flatnonzero(np.diff(np.concatenate([[False], np.isfinite(low), [False]])))
    for run in (slice(start, stop) for start, stop in edges.reshape(-1, 2)):
        there += [x[run], x[run][::-1], np.array([np.nan])]
        around += [low[run], high[run][::-1], np.array([np.nan])]
    return {
        "type": "scatter",
        "x": _bits(np.concatenate(there)),
        "y": _bits(np.concatenate(around)),
        "mode": "lines",
        "line": {"width": 0},
        "hoverinfo": "skip",
        "name": layer.name,
        "fill": "toself",
        "fillcolor": f"--{layer.role}-band",
    }


def _bars(layer: Bars) -> dict[str, Any]:
    return {
        "type": "bar",
        "orientation": "h",
        "x": [float(value) for value in layer.values],
        "y": list(layer.names),
        "text": list(layer.texts),
        "textposition": "outside",
        "cliponaxis": False,
        "marker": {"color": f"--{layer.role}"},
    }


def _layout(chart: Chart) -> dict[str, Any]:
    count = len(chart.panels)
    across = chart.range or _range_of_bars(chart)
    layout: dict[str, Any] = {
        "xaxis": {
            **_AXIS,
            "title": {"text": chart.x},
            "anchor": "y" if count == 1 else f"y{count}",
            **({"type": "log"} if chart.log else {}),
            **({"dtick": 1} if chart.counted else {}),
            **({"range": list(across)} if across else {}),
            **({"exponentformat": "power"} if across and across[1] < _LEAST_PLAIN else {}),
        },
        "shapes": _shapes(chart),
        "annotations": _annotations(chart),
    }
    gap = _HEIGHT["gap"] / (_HEIGHT["panel"] * count)
    height = (1.0 - gap * (count - 1)) / count
    for row, panel in enumerate(chart.panels):
        top = 1.0 - row * (height + gap)
        bars = any(isinstance(layer, Bars) for layer in panel.layers)
        layout["yaxis" if row == 0 else f"yaxis{row + 1}"] = {
            **_AXIS,
            "anchor": "x",
            "domain": [max(top - height, 0.0), top],
            "title": {"text": panel.title},
            **({"exponentformat": "power"} if panel.log or not _plain(panel) else {}),
            **({"type": "log", **_decades(panel)} if panel.log else {}),
            **({"range": list(panel.range)} if panel.range else {}),
            **({"autorange": "reversed", "type": "category", "showgrid": False} if bars else {}),
            **(_ticks(panel.categories) if panel.categories else {}),
        }
    return layout


def _range_of_bars(chart: Chart) -> tuple[float, float] | None:
    """From nothing to beyond the text of the longest bar; None where there are none."""
    bars = [layer for panel in chart.panels for layer in panel.layers if isinstance(layer, Bars)]
    longest = max((float(value) for layer in bars for value in layer.values), default=0.0)
    return (0.0, _BESIDE_BARS * longest) if longest > 0.0 else None


def _plain(panel: Panel) -> bool:
    """True where the greatest value of the vertical axis is written without an exponent."""
    sides = [side for layer in panel.layers for side in _vertical(layer)]
    greatest = max((float(np.nanmax(np.abs(side))) for side in sides if np.any(np.isfinite(side))), default=0.0)
    if panel.range is not None:
        greatest = min(greatest, max(map(abs, panel.range)))
    return greatest == 0.0 or _LEAST_PLAIN <= greatest < _MOST_PLAIN


def _vertical(layer: Line | Band | Bars) -> list[FloatArray]:
    if isinstance(layer, Bars):
        return []
    sides = (layer.low, layer.high) if isinstance(layer, Band) else (layer.y,)
    return [np.asarray(side, dtype=np.float64) for side in sides]


def _decades(panel: Panel) -> dict[str, Any]:
    """Ticks at powers of ten alone, where the values span enough of them."""
    values = [np.asarray(layer.y, dtype=float) for layer in panel.layers if isinstance(layer, Line)]
    positive = np.concatenate([each[each > 0.0] for each in values]) if values else np.ones(1)
    span = float(np.log10(np.max(positive) / np.min(positive))) if positive.size else 0.0
    return {"dtick": max(1.0, np.ceil(span / _MOST_DECADES))} if span > _FEWEST_DECADES else {}


def _ticks(names: Sequence[str]) -> dict[str, Any]:
    return {
        "tickmode": "array",
        "tickvals": list(range(len(names))),
        "ticktext": list(names),
        "range": [len(names) - 0.5, -0.5],
    }


def _shapes(chart: Chart) -> list[dict[str, Any]]:
    whole = {"xref": "x", "yref": "paper", "y0": 0, "y1": 1}
    marks = [
        {**whole, "type": "line", "x0": m.at, "x1": m.at, "line": {"color": "--mark", "width": 1, "dash": "dash"}}
        for m in chart.marks
    ]
    spans = [
        {**whole, "type": "rect", "x0": s.start, "x1": s.stop, "line": {"width": 0}, "fillcolor": "--masked"}
        for s in chart.spans
    ]
    return [*spans, *marks]


def _annotations(chart: Chart) -> list[dict[str, Any]]:
    """Names above the frame: of spans in their middle, of marks from their line on."""
    above = {"xref": "x", "yref": "paper", "y": 1, "yanchor": "bottom", "showarrow": False, "font": {"size": 11}}
    spans = [(0.5 * (s.start + s.stop), s.name) for s in chart.spans if s.name]
    return [
        *({**above, "x": mark.at, "text": mark.name, "xanchor": "left", "yshift": _NAME * line}
          for mark, line in named(chart.marks)),
        *({**above, "x": at, "text": name} for at, name in spans),
    ]  # fmt: skip


def chart_height(chart: Chart) -> int:
    """Height of the drawn chart, px."""
    if chart.path is not None:
        return _HEIGHT["frame"] + _STRETCHES[chart.columns] * chart.rows
    bars = [layer for panel in chart.panels for layer in panel.layers if isinstance(layer, Bars)]
    lines = sum(len(layer.names) for layer in bars) + sum(len(panel.categories) for panel in chart.panels)
    if lines:
        return _HEIGHT["frame"] + _HEIGHT["bar"] * lines
    return _HEIGHT["frame"] + max(_HEIGHT["panel"] * len(chart.panels), 260)


def _over(x: Values) -> dict[str, Any]:
    """Start and step where the values are even, which halves the page; else the values."""
    values = thinned(x)
    steps = np.diff(values)
    if steps.size > 1 and steps[0] > 0.0 and np.ptp(steps) < _UNEVEN * steps[0]:
        return {"x0": float(values[0]), "dx": float((values[-1] - values[0]) / steps.size)}
    return {"x": _packed(values)}


def _packed(values: Values) -> dict[str, str]:
    """A history, thinned."""
    return _bits(thinned(values))


def _bits(values: FloatArray) -> dict[str, str]:
    """Single precision: half the page, and finer than any screen."""
    data = values.astype("<f4").tobytes()
    return {"dtype": "f4", "bdata": base64.b64encode(data).decode("ascii")}
