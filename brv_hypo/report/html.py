"""A document as one HTML file that opens offline, in light, dark and print.

Charts are drawn in the browser by plotly.js (basic, MIT licence), which is in the page once, packed
(`page/plotly-basic.min.js.gz`, as its distribution has it). `plotly_chart` gives the traces and the layout of
a chart; colours are names of CSS variables; histories are single precision, thinned. `page` is the entrance.
"""

from __future__ import annotations

import base64
import csv
import gzip
import hashlib
import io
import json
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
import yaml
from jinja2 import Environment, PackageLoader
from markupsafe import Markup, escape
from pydantic import BaseModel

from brv_hypo import __version__
from brv_hypo.arrays import FloatArray
from brv_hypo.flight.clock import runs
from brv_hypo.report import document
from brv_hypo.report.document import Band, Bars, Block, Chart, Line, Section, Table, Values, flat, named, thinned

_FEWEST_DECADES, _MOST_DECADES = 1.5, 6.0
"""Decades beyond which a logarithmic axis has no ticks between powers of ten, and most of them that have one."""
_HEIGHT = {"panel": 175, "frame": 131, "names": 50, "bar": 26, "gap": 32}  # names: of marks, above the frame
_STRETCHES = {1: 415, 2: 330, 3: 230, 4: 175}
"""Height of a row of intervals of a path by how many are in it: squares, and their titles."""
_AXIS = {
    "linecolor": "--ink",
    "gridcolor": "--rule",
    "zerolinecolor": "--rule",
    "tickcolor": "--ink",
    "ticks": "outside",
    "showline": True,
    "automargin": True,
    "exponentformat": "power",
    "minexponent": 4,  # an exponent below 1e-4 and from 1e5
}
_EDGE = {"type": "scatter", "mode": "lines", "line": {"width": 0}, "hoverinfo": "skip"}
"""Of a band, which is drawn by its area."""
_BESIDE_BARS = 1.18  # the axis of bars without a range of its own goes so far beyond the longest, where its text is
_SHADES = {"masked": "--masked", "first": "--first-band"}
_NAME = 13  # height of a mark's name, px
_WHOLE = 9  # a table of more columns takes the whole width of the page
_NARROW = 4  # a table of more columns does not fit a third of it
_TAG = re.compile("<.*?>")
_CODE = re.compile(r"`([^`]+)`|(?<![\w-])(--[a-z][a-z-]*)")
"""What is typed in one piece: text between backticks, and options."""


def plotly_chart(chart: Chart) -> dict[str, Any]:
    """Traces, layout and height (px) of a chart; of a path what the page makes them of."""
    height = _HEIGHT["bar"] * chart.lines or max(_HEIGHT["panel"] * len(chart.panels), 260)
    height += _HEIGHT["frame"] - (0 if chart.named else _HEIGHT["names"])
    if chart.path is not None:
        height = _HEIGHT["frame"] + _STRETCHES[chart.columns] * chart.rows
    shared = {"time": chart.over_time, "height": height, "named": chart.named}
    if (path := chart.path) is not None:
        curve = {"t": path.time, "x": path.x, "y": path.y}
        histories = {name: _bits(thinned(values, document.MOST_OF_A_PATH))["bdata"] for name, values in curve.items()}
        rule = {"cycle": path.cycle, "cycles": path.cycles, "columns": path.columns, "most": path.most}
        titles = {"xTitle": chart.x, "yTitle": path.y_title}
        return {"path": {**histories, **rule, **titles, "axis": _AXIS}, **shared}
    traces: list[dict[str, Any]] = []
    in_legend: set[str] = set()
    for row, panel in enumerate(chart.panels, start=1):
        place = {"xaxis": "x", "yaxis": "y" if row == 1 else f"y{row}"}
        for layer in panel.layers:
            for trace in _TRACES[type(layer)](layer):
                name = trace.get("name", "")
                shown = bool(name) and name not in in_legend
                traces.append({**trace, **place, "legendgroup": layer.name, "showlegend": shown})
                in_legend.add(name)
    shapes = {chart.dashed: {"color": "--mark", "width": 1, "dash": "dash"}}
    shapes |= {span.name: {"color": _SHADES[span.role], "width": 10} for span in chart.spans}
    for name, line in shapes.items() if traces else ():  # which no legend has: a line of no points represents them
        empty = {"type": "scatter", "mode": "lines", "x": [None], "y": [None], "line": line, "xaxis": "x", "yaxis": "y"}
        traces += [{**empty, "name": name, "legendgroup": name, "showlegend": True}] if name else []
    return {"traces": traces, "layout": _layout(chart), **shared}


def _line(layer: Line) -> list[dict[str, Any]]:
    colour = f"--{layer.role}"
    trace: dict[str, Any] = {
        "x": _bits(thinned(layer.x)),
        "type": "scatter",
        "y": _bits(thinned(layer.y)),
        "name": layer.name,
        "mode": ("markers+text" if layer.labels else "markers") if layer.dots else "lines",
        **({"visible": "legendonly"} if layer.hidden else {}),
    }
    if layer.dots:
        trace["marker"] = {"color": colour, "size": layer.size}
    else:
        trace["line"] = {"color": colour, "width": 1.5, **({"dash": "dot"} if layer.dashed else {})}
    if layer.labels:
        text = [label.replace("\n", "<br>") for label in layer.labels]
        place = ["middle right" if "<br>" in each else "top right" for each in text]  # a line of one dot falls below it
        trace |= {"text": text, "textposition": place, "textfont": {"size": 11}, "cliponaxis": False}
    if layer.error is not None:
        trace["error_y"] = _error(*layer.error, colour)
    if layer.spread is not None:
        trace["error_x"] = _error(layer.spread, layer.spread, colour)
    return [trace]


def _error(below: Values, above: Values, colour: str) -> dict[str, Any]:
    ends = {"array": np.asarray(above, dtype=float).tolist(), "arrayminus": np.asarray(below, dtype=float).tolist()}
    return {"type": "data", "symmetric": False, **ends, "color": colour, "thickness": 1.5}


def _band(layer: Band) -> list[dict[str, Any]]:
    """A closed area for each stretch that is known, there along the lower edge and back along the upper."""
    x, low, high = (thinned(values) for values in (layer.x, layer.low, layer.high))
    stretches = [slice(*edges) for edges in runs(np.isfinite(low))]
    if not stretches:
        return []
    around = {"x": (x, x), "y": (low, high)}
    area = {
        axis: _bits(np.concatenate([part for run in stretches for part in (there[run], back[run][::-1], [np.nan])]))
        for axis, (there, back) in around.items()
    }
    return [{**_EDGE, **area, "name": layer.name, "fill": "toself", "fillcolor": f"--{layer.role}-band"}]


def _bars(layer: Bars) -> list[dict[str, Any]]:
    bars = {"x": [float(value) for value in layer.values], "y": list(layer.names), "text": list(layer.texts)}
    drawn = {"type": "bar", "orientation": "h", "textposition": "outside", "cliponaxis": False}
    error = {} if layer.error is None else {"error_x": _error(*layer.error, "--ink")}
    return [{**bars, **drawn, **error, "name": layer.name, "marker": {"color": f"--{layer.role}"}}]


_TRACES: dict[type[document.Layer], Callable[[Any], list[dict[str, Any]]]] = {Line: _line, Band: _band, Bars: _bars}


def _layout(chart: Chart) -> dict[str, Any]:
    count = len(chart.panels)
    bars = [layer for panel in chart.panels for layer in panel.layers if isinstance(layer, Bars)]
    ends = (np.add(layer.values, 0.0 if layer.error is None else layer.error[1]) for layer in bars)
    longest = max((float(np.max(each)) for each in ends), default=0.0)
    across = chart.range or ((0.0, _BESIDE_BARS * longest) if longest > 0.0 else None)
    layout: dict[str, Any] = {
        "xaxis": {
            **_AXIS,
            "title": {"text": chart.x},
            "anchor": "y" if count == 1 else f"y{count}",
            **({"type": "log", "exponentformat": "none"} if chart.log else {}),
            **({"dtick": 1} if chart.counted else {}),
            **({"range": list(across)} if across else {}),
        },
        "barmode": "overlay",  # bars of one name each, in layers
        **_marked(chart),
    }
    gap = _HEIGHT["gap"] / (_HEIGHT["panel"] * count)
    height = (1.0 - gap * (count - 1)) / count
    for row, panel in enumerate(chart.panels):
        top = 1.0 - row * (height + gap)
        axis = {
            **_AXIS,
            "anchor": "x",
            "domain": [max(top - height, 0.0), top],
            "title": {"text": panel.title, "standoff": 8},  # px from its ticks
            **({"type": "log", **_decades(panel)} if panel.log else {}),
            **({"range": list(panel.range)} if panel.range else {}),
            **({"autorange": "reversed", "type": "category", "showgrid": False} if bars else {}),
        }
        if names := panel.categories:
            ticks = {"tickmode": "array", "tickvals": list(range(len(names))), "ticktext": list(names)}
            axis |= {**ticks, "range": [len(names) - 0.5, -0.5]}
        layout["yaxis" if row == 0 else f"yaxis{row + 1}"] = axis
    return layout


def _decades(panel: document.Panel) -> dict[str, Any]:
    """Ticks at powers of ten alone, where the values span enough of them."""
    values = [np.asarray(layer.y, dtype=float) for layer in panel.layers if isinstance(layer, Line)]
    positive = np.concatenate([each[each > 0.0] for each in values]) if values else np.ones(1)
    span = float(np.log10(np.max(positive) / np.min(positive))) if positive.size else 0.0
    return {"dtick": max(1.0, np.ceil(span / _MOST_DECADES))} if span > _FEWEST_DECADES else {}


def _marked(chart: Chart) -> dict[str, list[dict[str, Any]]]:
    """Spans and marks, and above the frame the names of marks, from their line on."""
    whole = {"xref": "x", "yref": "paper", "y0": 0, "y1": 1}
    dashed = {**whole, "type": "line", "line": {"color": "--mark", "width": 1, "dash": "dash"}}
    shaded = {**whole, "type": "rect", "line": {"width": 0}, "layer": "below"}
    shapes = [{**shaded, "x0": s.start, "x1": s.stop, "fillcolor": _SHADES[s.role]} for s in chart.spans]
    shapes += [{**dashed, "x0": mark.at, "x1": mark.at} for mark in chart.marks]
    above = {"xref": "x", "yref": "paper", "y": 1, "yanchor": "bottom", "showarrow": False, "font": {"size": 11}}
    marks = [
        {**above, "x": mark.at, "text": mark.name, "xanchor": "left", "yshift": _NAME * line}
        for mark, line in named(chart.marks)
    ]
    return {"shapes": shapes, "annotations": marks}


def _bits(values: FloatArray) -> dict[str, str]:
    """Single precision: half the page, and finer than any screen."""
    return {"dtype": "f4", "bdata": base64.b64encode(values.astype("<f4").tobytes()).decode("ascii")}


def provenance(command: str, settings: BaseModel | None, records: Iterable[str | Path]) -> dict[str, str]:
    """Each record that is a file with its SHA-256, settings that differ from the defaults, and the command, by name."""
    paths = [path for path in dict.fromkeys(Path(path) for path in records if str(path)) if path.is_file()]
    found = {f"record {path}": f"SHA-256 {hashlib.sha256(path.read_bytes()).hexdigest()}" for path in paths}
    if settings is not None:
        changed = settings.model_dump(mode="json", exclude_defaults=True)
        text = yaml.safe_dump(changed, default_flow_style=True, width=10**6).strip()
        found["settings"] = text if changed else "defaults"
    return found | ({"made by": command} if command else {})


# ---- The page: templates in `page/`, and what they need ----


def page(content: document.Document, provenance: Mapping[str, str] = {}) -> str:
    """The whole file: conclusion, contents, sections, and at the foot where it came from and how to make it again."""
    drawn = [plotly_chart(chart) for chart in content.charts]
    data = json.dumps(drawn, separators=(",", ":"), allow_nan=False).encode()
    return render(
        "page.html.j2",
        document=content,
        answer=list(map(_cell, _groups((*content.ahead, *content.beside)))),
        parts=_parts(content.blocks),
        provenance={"version": f"brv-hypo {__version__}", **provenance},
        library=base64.b64encode(resource("plotly-basic.min.js.gz")).decode("ascii"),
        charts=base64.b64encode(gzip.compress(data, mtime=0)).decode("ascii") if drawn else "",
    )


def render(template: str, **values: Any) -> str:
    """A template with its values, each escaped; in it `resource` is the text of a file that goes in whole."""
    loader = PackageLoader("brv_hypo.report", "page")
    known = Environment(loader=loader, autoescape=True, trim_blocks=True, lstrip_blocks=True)
    known.filters["typed"] = lambda words: Markup(_CODE.sub(r"<code>\1\2</code>", str(escape(words))))
    known.filters["slug"] = lambda heading: re.sub(r"[^a-z0-9]+", "-", _TAG.sub("", heading).lower()).strip("-")
    known.filters["csv"] = _as_csv
    known.filters["folding"] = lambda words: escape(words).replace("_", Markup("_<wbr>"))
    known.tests["table"] = lambda block: isinstance(block, Table)
    known.tests["picture"] = lambda block: isinstance(block, Chart)
    known.globals["resource"] = lambda name: Markup(resource(name).decode())
    return known.get_template(template).render(values)


def resource(name: str) -> bytes:
    """A file that pages are made of."""
    return (files("brv_hypo.report") / "page" / name).read_bytes()


def _parts(blocks: Sequence[Block | Section]) -> list[dict[str, Any]]:
    """What has something to show: blocks that are in no section, then each section with its cells."""
    loose = Section("", [block for block in blocks if not isinstance(block, Section)])
    every = (loose, *(block for block in blocks if isinstance(block, Section)))
    return [{"section": each, "cells": list(map(_cell, _groups(each.blocks)))} for each in every if any(flat([each]))]


def _groups(blocks: Sequence[Block]) -> list[list[Block]]:
    """Blocks that belong together: one without a heading goes with the one before it, unless that is a chart."""
    groups: list[list[Block]] = []
    for block in flat(blocks):
        alone = block.heading or isinstance(block, Chart)
        if alone or not groups or isinstance(groups[-1][-1], Chart):
            groups.append([block])
        else:
            groups[-1].append(block)
    return groups


def _cell(group: Sequence[Block]) -> dict[str, Any]:
    """Blocks, and whether they want all of the page's width or half of it; else a third will do."""
    pictures = [block for block in group if isinstance(block, Chart)]
    columns = max((len(block.headings) for block in group if isinstance(block, Table)), default=0)
    wide = columns > _NARROW or any(chart.over_time or chart.path or chart.counted for chart in pictures)
    return {"blocks": group, "whole": columns > _WHOLE, "wide": wide}


def _as_csv(table: Table) -> str:
    """The table as a link that holds it as CSV."""
    content = io.StringIO()
    csv.writer(content, lineterminator="\n").writerows([table.headings, *(row.values() for row in table.rows)])
    return "data:text/csv;charset=utf-8," + quote(content.getvalue())
