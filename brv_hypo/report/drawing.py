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
    wanted = [(chart, path) for chart in charts for path in picture_files(target, chart.name)]
    check_pictures(target, [chart.name for chart in charts], overwrite=overwrite)
    if wanted:
        make_folder(target)
    for chart, path in wanted:
        write_whole(path, drawn(chart, path.suffix[1:]))
    return tuple(path for _, path in wanted)


def check_pictures(folder: Path, names: Sequence[str], *, overwrite: bool) -> None:
    """Raise UsageError where the file of a chart of these names exists and is not to be overwritten."""
    for path in (path for name in names for path in picture_files(folder, name)):
        check_target(path, overwrite=overwrite)


def picture_files(folder: Path, name: str) -> tuple[Path, Path]:
    """The PNG and SVG file of a chart: its name with nothing in it that a file name cannot hold."""
    stem = re.sub(r"[^\w.+-]+", "-", name)
    return folder / f"{stem}.png", folder / f"{stem}.svg"


def drawn(chart: Chart, kind: str) -> bytes:
    """The chart as the content of a file of that kind, "png" or "svg"; the same chart gives the same bytes."""
    import matplotlib as mpl

    from brv_hypo.report.figure import STYLE, chart_figure

    content = io.BytesIO()
    metadata: dict[str, Any] = {"Date": None} if kind == "svg" else {}
    with mpl.rc_context(STYLE):
        chart_figure(chart).savefig(content, format=kind, dpi=RESOLUTION, metadata=metadata)
    return content.getvalue()
