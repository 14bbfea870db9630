"""Pitch against yaw, stretch by stretch: many cycles over each other are a tangle that says nothing."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.report.chart import Chart, Line, Panel, Path, Values
from brv_hypo.report.motion_charts import Setting

_CAPTION = (
    "Attitude to the wind in axes that do not roll; the roll angle counts from the start. "
    "A circle is coning, a line planar motion, a centre off the middle a trim that does not roll."
)
_SEVERAL = " Each stretch begins at the dot. Zoom a chart over time, and the stretches are of what it shows."


def attitude_chart(setting: Setting, time: Values, alpha: Values, meridian: Values, roll_rate: Values) -> Chart:
    """Pitch against yaw angle in axes that do not roll: theta = alpha cos(lambda), psi = alpha sin(lambda).

    lambda = phi - phi_w, with the roll angle phi integrated from the roll rate (Eq. 2.7, small psi). One panel for
    every few cycles, in order of time and at one scale.
    """
    t, p = np.asarray(time, dtype=float), np.asarray(roll_rate, dtype=float)
    phi = np.concatenate([[0.0], np.cumsum(0.5 * (p[1:] + p[:-1]) * np.diff(t))])
    turned = phi - np.asarray(meridian)
    amplitude = np.degrees(np.asarray(alpha))
    theta, psi = amplitude * np.cos(turned), amplitude * np.sin(turned)
    path = Path(t, psi, theta, "theta, deg", cycle=float(t[-1] - t[0]) / _cycles(theta, psi))
    panels = [Panel(title, layers) for title, layers in _stretches(path)]
    return Chart(
        f"theta-psi{setting.suffix}",
        f"Pitch against yaw{setting.which}",
        "psi, deg",
        panels,
        path=path,
        caption=_CAPTION + (_SEVERAL if len(panels) > 1 else ""),
    )


def _cycles(theta: FloatArray, psi: FloatArray) -> float:
    """How often the path goes round, by its length over the circumference of a circle of its size; at least one."""
    length = float(np.sum(np.hypot(np.diff(theta), np.diff(psi))))
    size = float(np.sqrt(np.mean(theta**2 + psi**2)))
    return max(length / (2.0 * np.pi * size), 1.0) if size > 0.0 else 1.0


def _stretches(path: Path) -> Iterator[tuple[str, list[Line]]]:
    """Title and layers of equally long stretches of the path, each up to where the next begins."""
    time, x, y = (np.asarray(values, dtype=float) for values in (path.time, path.x, path.y))
    edges = np.linspace(time[0], time[-1], path.stretches + 1)
    digits = max(0, 1 - int(np.floor(np.log10((edges[1] - edges[0]) or 1.0))))
    for start, stop in pairwise(edges):
        inside = slice(int(np.searchsorted(time, start)), int(np.searchsorted(time, stop)) + 1)
        first = slice(inside.start, inside.start + 1)
        line = Line(x[inside], y[inside], "measured", "path")
        yield (
            f"{start:.{digits}f}–{stop:.{digits}f} s",
            [line, Line(x[first], y[first], "second", "start", dots=True, large=True)],
        )
