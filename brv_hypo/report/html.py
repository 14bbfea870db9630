"""A document as one HTML file that opens offline, in light, dark and print.

Charts are drawn in the browser by plotly.js (basic, MIT licence), which is in the page once, packed
(`page/plotly-basic.min.js.gz`, as its distribution has it). `plotly_chart` gives the traces and the layout of
a chart; colours are names of CSS variables; histories are single precision, thinned. At the foot stands where
the page came from (`Provenance`): version, settings, records with their SHA-256, and the command that makes
it again. `page` is the entrance.
"""

from __future__ import annotations

import base64
import gzip
import hashlib
import json
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from pydantic import BaseModel

from brv_hypo.arrays import FloatArray
from brv_hypo.report.document import (
    MOST_OF_A_PATH,
    TEXT_COLUMNS,
    Band,
    Bars,
    Block,
    Chart,
    Document,
    Line,
    Panel,
    Picture,
    PlanePath,
    Table,
    Texts,
    Values,
    named,
    thinned,
)
from brv_hypo.version import version

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
    in_legend: set[str] = set()
    for row, panel in enumerate(chart.panels, start=1):
        for layer in panel.layers:
            for trace in _traces(layer):
                name = trace.get("name", "")
                group = "" if isinstance(layer, Bars) else layer.name
                place = {"xaxis": "x", "yaxis": "y" if row == 1 else f"y{row}", "legendgroup": group}
                traces.append({**trace, **place, "showlegend": bool(name) and name not in in_legend})
                in_legend.add(name)
    return {"traces": traces, "layout": _layout(chart), "time": chart.over_time, "height": chart_height(chart)}


def _plotly_path(chart: Chart, path: PlanePath) -> dict[str, Any]:
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


# ---- Where a page came from: version, settings, records by digest, and the command that makes it again ----


_CHUNK = 1 << 20


@dataclass(frozen=True)
class Provenance:
    """The command, the settings that differ from the defaults, and each record with its SHA-256."""

    command: str = ""
    settings: str = ""
    records: tuple[tuple[str, str], ...] = ()

    @property
    def rows(self) -> tuple[tuple[str, str], ...]:
        """Name and value of each entry."""
        found = [("version", f"brv-hypo {version()}")]
        found += [(f"record {path}", f"SHA-256 {digest}") for path, digest in self.records]
        if self.settings:
            found.append(("settings", self.settings))
        if self.command:
            found.append(("made by", self.command))
        return tuple(found)


def provenance(command: str, settings: BaseModel | None, records: Iterable[str | Path]) -> Provenance:
    """The provenance of a result; a record that is no file any more has no digest."""
    paths = [Path(path) for path in records if str(path)]
    return Provenance(
        command=command,
        settings=_settings_text(settings),
        records=tuple((str(path), digest(path)) for path in dict.fromkeys(paths) if path.is_file()),
    )


def digest(path: Path) -> str:
    """SHA-256 of a file, in hexadecimal digits."""
    found = hashlib.sha256()
    with path.open("rb") as file:
        while chunk := file.read(_CHUNK):
            found.update(chunk)
    return found.hexdigest()


def _settings_text(settings: BaseModel | None) -> str:
    """The settings that differ from the defaults, on one line."""
    if settings is None:
        return ""
    changed = settings.model_dump(mode="json", exclude_defaults=True)
    return yaml.safe_dump(changed, default_flow_style=True, width=10**6).strip() if changed else "defaults"


_FOLDER = "page"
_WHOLE = 9
"""A table of more columns takes the whole width of the page."""
_ROW, _LINE = 380, 32
"""Heights (px) of a row of sections, and of a line of a table: a section that is several rows high has as many sections
beside it, and no empty space."""
_CODE = re.compile(r"`([^`]+)`|(?<![\w-])(--[a-z][a-z-]*)")
"""What is typed as it stands: text between backticks, and options."""


def page(document: Document, provenance: Provenance) -> str:
    """The whole file: conclusion first, blocks, and at the foot where it came from and how to make it again."""
    style, stretches, script = (resource(name).decode() for name in ("page.css", "stretches.js", "page.js"))
    subtitle = "<br>".join(map(escape, document.subtitle))
    decided = " decided" if document.decided else ""
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(document.title)}</title>\n<style>{style}</style>\n</head>\n<body>\n"
        f'<h1>{escape(document.title)}</h1>\n<p class="quiet">{subtitle}</p>\n'
        f'<p class="verdict{decided}">{_text(document.conclusion)}</p>\n'
        f"<main>\n{_sections(document.blocks)}\n</main>\n{_footer(provenance)}\n"
        f"{_charts(document.charts)}<script>{stretches}{script}</script>\n</body>\n</html>\n"
    )


def resource(name: str) -> bytes:
    """A file that pages are made of."""
    return (files("brv_hypo.report") / _FOLDER / name).read_bytes()


def _sections(blocks: Sequence[Block]) -> str:
    return "\n".join(_section(group) for group in _groups(blocks))


def _groups(blocks: Sequence[Block]) -> list[list[Block]]:
    """Blocks that belong together: one without a heading goes with what stands before it, unless that is a chart."""
    groups: list[list[Block]] = []
    for block in blocks:
        if block.empty:
            continue
        alone = block.heading or isinstance(block, Picture)
        if alone or not groups or isinstance(groups[-1][-1], Picture):
            groups.append([block])
        else:
            groups[-1].append(block)
    return groups


def _section(group: Sequence[Block]) -> str:
    wide = any(isinstance(block, Table) and len(block.headings) > _WHOLE for block in group)
    rows = max(1, round(sum(map(_height, group)) / _ROW))
    span = f' style="grid-row: span {rows}"' if rows > 1 else ""
    return f'<section class="{"whole" if wide else ""}"{span}>{"".join(map(_content, group))}</section>'


def _height(block: Block) -> int:
    """About what the block takes, px."""
    if isinstance(block, Picture):
        return chart_height(block.chart)
    return _LINE * len(block.rows if isinstance(block, Table) else block.texts)


def _content(block: Block) -> str:
    heading = f"<h2>{escape(block.heading)}</h2>\n" if block.heading else ""
    if isinstance(block, Table):
        return heading + _table(block)
    if isinstance(block, Picture):
        return heading + _figure(block.chart)
    return f'{heading}<div class="{"warning" if block.warning else "texts"}">{_texts(block)}</div>'


def _figure(chart: Chart) -> str:
    caption = f"<figcaption>{escape(chart.caption)}</figcaption>" if chart.caption else ""
    return f'<figure><div class="chart" role="img" aria-label="{escape(chart.heading)}"></div>{caption}</figure>'


def _texts(block: Texts) -> str:
    items = list(dict.fromkeys(map(_text, block.texts)))
    if block.bullets:
        return "<ul>" + "".join(f"<li>{item}</li>" for item in items) + "</ul>"
    return "".join(f"<p>{item}</p>" for item in items)


def _text(words: str) -> str:
    """Text as HTML, with what is typed in one piece."""
    return _CODE.sub(lambda found: f"<code>{found[1] or found[2]}</code>", escape(words))


def _table(block: Table) -> str:
    """Numbers to the right; marked rows bold."""

    def cells(tag: str, values: Sequence[str], shades: Sequence[float]) -> str:
        return "".join(
            f"<{tag}{' class=text' if heading in TEXT_COLUMNS else ''}{_shade(shade)}>{escape(value)}</{tag}>"
            for heading, value, shade in zip(block.headings, values, shades, strict=True)
        )

    plain = [0.0] * len(block.headings)
    body = "\n".join(
        f"<tr{' class=marked' if i in block.marked else ''}>"
        f"{cells('td', line, block.shades[i] if block.shades else plain)}</tr>"
        for i, line in enumerate(block.rows)
    )
    return f'<div class="wide"><table><tr>{cells("th", block.headings, plain)}</tr>\n{body}</table></div>'


def _shade(share: float) -> str:
    return f' style="background: rgba(var(--shade), {0.6 * share:.2f})"' if share > 0.0 else ""


def _footer(provenance: Provenance) -> str:
    rows = "".join(f"<dt>{escape(name)}</dt><dd><code>{escape(value)}</code></dd>" for name, value in provenance.rows)
    return f"<footer><dl>{rows}</dl></footer>"


def _charts(charts: Sequence[Chart]) -> str:
    """The script and what it draws, packed; nothing where there is nothing to draw."""
    if not charts:
        return ""
    data = json.dumps([plotly_chart(chart) for chart in charts], separators=(",", ":"), allow_nan=False)
    library = base64.b64encode(resource("plotly-basic.min.js.gz")).decode("ascii")
    packed = base64.b64encode(gzip.compress(data.encode(), mtime=0)).decode("ascii")
    return (
        f'<script type="text/plain" id="library">{library}</script>\n'
        f'<script type="text/plain" id="charts">{packed}</script>\n'
    )
