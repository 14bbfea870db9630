"""A chart as a matplotlib figure (the extra `figures`): what picture files and `plot()` of results show."""

from __future__ import annotations

import io
import re
import textwrap
from collections.abc import Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from brv_hypo.report.document import Band, Bars, Chart, Line, Panel, PlanePath, named

WIDTH = 6.5  # inches: the text of a page
PANEL, BAR, FRAME, TITLE, CAPTION = 1.9, 0.24, 0.9, 0.35, 0.14
CAPTION_LINE = 105  # characters
# By role; the palette of Okabe and Ito (2008), for colour-blind readers too.
COLOURS = {
    "measured": "#1a1a1a",
    "first": "#0072b2",
    "second": "#d55e00",
    "third": "#009e73",
    **dict.fromkeys(("none", "guide"), "#8c8c8c"),
}
_NAME = 8  # points of the height of a mark's name
_DOT = 0.6  # points of a dot's size for a px of it on a page
SMALLEST_DOT = 3.0  # points of a dot in a legend, at least: those of histories are smaller
STYLE: Any = {
    "font.size": 9.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "legend.frameon": False,
    "svg.fonttype": "none",
    "svg.hashsalt": "brv-hypo",
}
SHOWN = 110  # dots per inch in a notebook


class ChartFigure(Figure):
    """A figure that notebooks show without pyplot."""

    def content(self, kind: str, dpi: int) -> bytes:
        """Of a file of that kind, "png" or "svg"; the same chart gives the same bytes."""
        content = io.BytesIO()
        with mpl.rc_context(STYLE):
            self.savefig(content, format=kind, dpi=dpi, metadata={"Date": None} if kind == "svg" else {})
        return content.getvalue()

    def _repr_png_(self) -> bytes:
        return self.content("png", SHOWN)


def chart_figure(chart: Chart) -> ChartFigure:
    """The chart with title and caption, in a paper's colours and width; `.axes` are its panels, to be changed."""
    height = FRAME + (BAR * chart.lines or PANEL * max(len(chart.panels), 1.4))
    if chart.path is not None:
        height = WIDTH * chart.rows / chart.columns + FRAME / chart.columns
    height += TITLE + CAPTION * _caption(chart).count("\n")
    with mpl.rc_context(STYLE):
        figure = ChartFigure(figsize=(WIDTH, height), layout="constrained")
        FigureCanvasAgg(figure)
        _fill(figure, chart)
    return figure


def _fill(figure: Figure, chart: Chart) -> None:
    one_scale = chart.path is not None
    rows = list(figure.subplots(chart.rows, chart.columns, sharex=True, sharey=one_scale, squeeze=False).flat)
    for axes, panel in zip(rows, chart.panels, strict=True):
        _draw(axes, panel)
        for mark in chart.marks:
            label = "" if mark.name else chart.dashed
            axes.axvline(mark.at, color="#cc79a7", linewidth=0.8, linestyle="--", label=label)
        for span in chart.spans:
            colour = {"masked": "#e69f00"}.get(span.role, COLOURS["first"])
            axes.axvspan(span.start, span.stop, color=colour, alpha=0.2, linewidth=0, label=span.name)
    top, bottom = rows[0], rows[-1]
    figure.supxlabel(_caption(chart), fontsize=8, x=0.01, ha="left")
    for mark, line in named(chart.marks):
        above = {"xytext": (0, 2 + _NAME * line), "textcoords": "offset points", "fontsize": 7}
        top.annotate(mark.name, (mark.at, 1.0), xycoords=("data", "axes fraction"), ha="left", **above)
    if chart.path is None:
        bottom.set_xlabel(_plain(chart.x))
    if chart.log:
        bottom.set_xscale("log")
    if chart.counted:
        bottom.xaxis.set_major_locator(MaxNLocator(integer=True))
    if chart.range:
        bottom.set_xlim(*chart.range)
    if chart.path is not None:
        _frame_path(figure, rows, chart, chart.path)
    handles = {label: h for axes in rows for h, label in zip(*axes.get_legend_handles_labels(), strict=True)}
    title = _plain(chart.heading)
    if not handles:
        figure.suptitle(title, x=0.01, ha="left", fontsize="large")
    else:  # in the legend, which would lie over a title of its own
        style: Any = {"ncols": 5, "title": title, "title_fontsize": "large", "alignment": "left"}
        legend = figure.legend(handles.values(), handles.keys(), loc="outside upper left", **style)
        for handle in legend.legend_handles:
            if isinstance(handle, Line2D) and handle.get_marker() == "o":
                handle.set_markersize(max(handle.get_markersize(), SMALLEST_DOT))


def _frame_path(figure: Figure, intervals: Sequence[Axes], chart: Chart, path: PlanePath) -> None:
    """Squares at one scale, each under its title, with the titles of the axes once."""
    for axes, panel in zip(intervals, chart.panels, strict=True):
        axes.set_title(panel.title, fontsize="medium")
        axes.set_ylabel("")
        axes.set_aspect("equal")
        axes.axhline(0.0, color=COLOURS["guide"], linewidth=0.4, zorder=0)
        axes.axvline(0.0, color=COLOURS["guide"], linewidth=0.4, zorder=0)
    limit = 1.05 * float(np.nanmax(np.abs(np.concatenate([path.x, path.y]))) or 1.0)
    intervals[0].set_xlim(-limit, limit)
    intervals[0].set_ylim(-limit, limit)
    figure.supylabel(_plain(path.y_title), fontsize="medium")


def _draw(axes: Axes, panel: Panel) -> None:
    if bars := [layer for layer in panel.layers if isinstance(layer, Bars)]:
        _bars(axes, bars)
    for layer in panel.layers:
        colour = COLOURS[layer.role]
        if isinstance(layer, Bars):
            continue
        if isinstance(layer, Band):
            axes.fill_between(layer.x, layer.low, layer.high, color=colour, alpha=0.2, linewidth=0, label=layer.name)
        elif not layer.hidden:
            _line(axes, layer, colour)
    axes.set_ylabel(_plain(panel.title))
    if panel.log:
        axes.set_yscale("log")
    if panel.range:
        axes.set_ylim(*panel.range)
    if panel.categories:
        axes.set_yticks(range(len(panel.categories)), panel.categories)
        axes.set_ylim(len(panel.categories) - 0.5, -0.5)


def _line(axes: Axes, layer: Line, colour: str) -> None:
    name = layer.name or None
    if not layer.dots:
        axes.plot(layer.x, layer.y, ":" if layer.dashed else "-", color=colour, linewidth=1.0, label=name)
        return
    axes.plot(layer.x, layer.y, "o", color=colour, markersize=_DOT * layer.size, markeredgewidth=0.0, label=name)
    if layer.error is not None or layer.spread is not None:
        error = None if layer.error is None else np.asarray(layer.error, dtype=float)
        axes.errorbar(layer.x, layer.y, yerr=error, xerr=layer.spread, fmt="none", ecolor=colour, linewidth=1.0)
    place: Any = {"xytext": (5, 0), "textcoords": "offset points", "fontsize": 8, "clip_on": False}
    for x, y, label in zip(layer.x, layer.y, layer.labels, strict=False):
        axes.annotate(label, (x, y), va="center" if "\n" in label else "bottom", **place)


def _bars(axes: Axes, layers: Sequence[Bars]) -> None:
    names = [name for layer in layers for name in layer.names]
    axes.set_yticks(np.arange(len(names)), names)
    axes.invert_yaxis()
    first = 0
    for layer in layers:
        places, first = np.arange(first, first + len(layer.names)), first + len(layer.names)
        values, error = np.asarray(layer.values, dtype=float), None if layer.error is None else np.array(layer.error)
        axes.barh(places, values, color=COLOURS[layer.role], label=layer.name, xerr=error)
        for place, value, text in zip(places, layer.values, layer.texts, strict=False):
            axes.annotate(text, (value, place), xytext=(3, 0), textcoords="offset points", va="center", fontsize=8)


def _caption(chart: Chart) -> str:
    """The caption in lines as wide as the figure; that of a path names the axis that its intervals share."""
    text = chart.caption if chart.path is None else f"Across: {chart.x}. {chart.caption}"
    return "\n".join(textwrap.wrap(_plain(text), CAPTION_LINE))


def _plain(title: str) -> str:
    """A title as matplotlib writes it: subscripts as mathematics."""
    return re.sub(r"(\w)<sub>(.*?)</sub>", r"$\1_{\2}$", title).replace("<br>", "\n")
