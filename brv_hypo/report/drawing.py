"""Charts as picture files for papers, PNG and SVG, by matplotlib (the extra `figures`)."""

from __future__ import annotations

import io
import re
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from brv_hypo.errors import UsageError
from brv_hypo.files.whole import check_target, make_folder, write_whole
from brv_hypo.report.chart import Chart

RESOLUTION = 200
"""Dots per inch of PNG files."""


def require_matplotlib(what: str = "--figures") -> None:
    """Raise UsageError with the remedy where matplotlib, which `what` needs, is not installed."""
    if find_spec("matplotlib") is None:
        raise UsageError(f"{what} needs matplotlib, which is not installed: pip install 'brv-hypo[figures]'.")


def draw_into(folder: str | Path, charts: Sequence[Chart], *, overwrite: bool = False) -> tuple[Path, ...]:
    """Every chart as `name.png` and `name.svg` in the folder, which is made where it is missing.

    Raises UsageError where a file exists and is not to be overwritten, or matplotlib is missing.
    """
    require_matplotlib()
    target = Path(folder)
    wanted = [(chart, target / f"{file_stem(chart)}.{kind}") for chart in charts for kind in ("png", "svg")]
    for _, path in wanted:
        check_target(path, overwrite=overwrite)
    if wanted:
        make_folder(target)
    for chart, path in wanted:
        write_whole(path, drawn(chart, path.suffix[1:]))
    return tuple(path for _, path in wanted)


def file_stem(chart: Chart) -> str:
    """The chart's name with nothing in it that a file name cannot hold."""
    return re.sub(r"[^\w.+-]+", "-", chart.name)


def drawn(chart: Chart, kind: str) -> bytes:
    """The chart as the content of a file of that kind, "png" or "svg"; the same chart gives the same bytes."""
    import matplotlib as mpl

    from brv_hypo.report.figure import STYLE, chart_figure

    content = io.BytesIO()
    metadata: dict[str, Any] = {"Date": None} if kind == "svg" else {}
    with mpl.rc_context(STYLE):
        chart_figure(chart).savefig(content, format=kind, dpi=RESOLUTION, metadata=metadata)
    return content.getvalue()
