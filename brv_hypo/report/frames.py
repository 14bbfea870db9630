"""How far the vertical axis of a panel goes: a few values, or the band of the noise, do not flatten all others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.report.chart import Band, Line, Panel

_BULK = (0.01, 0.99)
"""Quantiles of the values that a frame always holds."""
_FAR = 3.0
"""Times the width of the bulk that all values take, beyond which the rest of them lies outside the frame."""
_BESIDE = 0.5
"""Widths of the bulk that are shown on both sides of it then."""
_FAR_WIDER = 5.0
"""Times the width of histories that their noise's band takes, beyond which they would be a flat line before it."""


def framed(panel: Panel, floor: float = -np.inf) -> Panel:
    """The panel, with a range where outliers or a wide band would flatten its histories; nothing lies below `floor`."""
    shown = _known([line.y for line in panel.layers if isinstance(line, Line)])
    if not shown.size:
        return panel
    low, high = _of_bulk(shown)
    width = high - low
    edges = _known([side for band in panel.layers if isinstance(band, Band) for side in (band.low, band.high)])
    if edges.size and np.ptp(edges) > _FAR_WIDER * width > 0.0:
        return replace(panel, range=(max(low - width, floor), high + width))
    if (low, high) != (np.min(shown), np.max(shown)):
        return replace(panel, range=(max(low, floor), high))
    return panel


def cut_text(panels: Sequence[Panel]) -> str:
    """What lies beyond the frames, in a sentence; empty where nothing does."""
    if any(_beyond(panel, Line) for panel in panels):
        return "A few values far from all others lie beyond the frame: double-click shows them."
    if any(_beyond(panel, Band) for panel in panels):
        return "The band is far wider than what is drawn, and goes beyond the frame."
    return ""


def _of_bulk(values: FloatArray) -> tuple[float, float]:
    """Least and greatest of the values; where a few are far from all others, of the bulk with some room beside it."""
    low, high = float(np.min(values)), float(np.max(values))
    first, last = (float(edge) for edge in np.quantile(values, _BULK))
    width = last - first
    if not high - low > _FAR * width > 0.0:
        return low, high
    return max(low, first - _BESIDE * width), min(high, last + _BESIDE * width)


def _beyond(panel: Panel, kind: type[Line] | type[Band]) -> bool:
    """Whether layers of this kind reach beyond the range of the panel."""
    if panel.range is None:
        return False
    layers = [layer for layer in panel.layers if isinstance(layer, kind)]
    sides = [side for each in layers for side in ((each.y,) if isinstance(each, Line) else (each.low, each.high))]
    values = _known(sides)
    return bool(values.size and (np.min(values) < panel.range[0] or np.max(values) > panel.range[1]))


def _known(sides: Sequence[Sequence[float] | FloatArray]) -> FloatArray:
    values = np.concatenate([np.asarray(side, dtype=float) for side in sides]) if sides else np.zeros(0)
    return values[np.isfinite(values)]
