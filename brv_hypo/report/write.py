"""From Python: any result as a page, its charts as PNG and SVG files, or one of them as a figure.

Picture files need matplotlib (the extra `figures`), which is imported when a picture is drawn.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import singledispatch
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from brv_hypo.comparison.result import Comparison
from brv_hypo.errors import UsageError, missing_package
from brv_hypo.flight import Flight
from brv_hypo.io.files import check_target, make_folder, write_whole
from brv_hypo.motion import Reconstruction
from brv_hypo.prediction.result import Prediction
from brv_hypo.report.comparison import comparison_document
from brv_hypo.report.document import Chart, Document
from brv_hypo.report.html import page, provenance
from brv_hypo.report.reconstruction import reconstruction_document, record_document
from brv_hypo.report.trace import prediction_document, trace_document
from brv_hypo.simulation import SimulatedFlight
from brv_hypo.tracing.result import Trace

if TYPE_CHECKING:
    from matplotlib.figure import Figure


RESOLUTION = 200  # dots per inch of PNG files
PRINCIPAL = ("moments", "moments-1", "residuals", "band", "probability")
"""The chart that `plot` draws where none is named: the first of these that the result has, else its first."""


def require_matplotlib(what: str = "--figures") -> None:
    """Raise UsageError with the remedy where matplotlib, which `what` needs, is not installed."""
    if find_spec("matplotlib") is None:
        raise missing_package(what, "matplotlib", "figures")


def draw_into(folder: str | Path, charts: Sequence[Chart], *, overwrite: bool = False) -> tuple[Path, ...]:
    """Every chart as `name.png` and `name.svg` in the folder, made if missing; UsageError for a file that exists."""
    require_matplotlib()
    from brv_hypo.report.figures import chart_figure

    stems = {re.sub(r"[^\w.+-]+", "-", chart.name): chart for chart in charts}
    wanted = {Path(folder) / f"{stem}.{kind}": chart for stem, chart in stems.items() for kind in ("png", "svg")}
    for path in wanted:
        check_target(path, overwrite=overwrite)
    if wanted:
        make_folder(folder)
    for path, chart in wanted.items():
        write_whole(path, chart_figure(chart).content(path.suffix[1:], RESOLUTION))
    return tuple(wanted)


@singledispatch
def document_of(result: Any) -> Document:
    """The document of a comparison, trace, prediction, reconstruction or flight; else UsageError."""
    expected = "a Flight, or what compare, trace, predict, reconstruct or simulate returned: only these have one"
    raise UsageError(f"got {type(result).__name__}, expected {expected}.")


document_of.register(Comparison, comparison_document)
document_of.register(Trace, trace_document)
document_of.register(Prediction, prediction_document)
document_of.register(Reconstruction, reconstruction_document)
document_of.register(Flight, record_document)
document_of.register(SimulatedFlight, lambda flown: record_document(flown.flight))


def write_report(result: Any, path: str | Path, *, overwrite: bool = False) -> None:
    """Write the page of a result; raises UsageError where the file exists and is not to be overwritten."""
    check_target(path, overwrite=overwrite)
    document = document_of(result)
    flights = result.flights if isinstance(result, Comparison) else (getattr(result, "flight", result),)
    write_whole(path, page(document, provenance("", None, [flight.path for flight in flights])))


def write_figures(result: Any, folder: str | Path, *, overwrite: bool = False) -> tuple[Path, ...]:
    """Write the charts of a result as PNG and SVG; returns the files. Needs the extra `figures`. Raises UsageError
    where a file exists and is not to be overwritten, or matplotlib is missing.
    """
    return draw_into(folder, document_of(result).charts, overwrite=overwrite)


def plot(result: Any, chart: str = "") -> Figure:
    """One chart of a result as a figure, by its picture file's name, "" for the principal; UsageError for none."""
    require_matplotlib("plot()")
    from brv_hypo.report.figures import chart_figure

    charts = {each.name: each for each in document_of(result).charts}
    name = chart or next((each for each in PRINCIPAL if each in charts), next(iter(charts), ""))
    if name not in charts:
        known = ", ".join(charts) or "none"
        message = f"got chart {chart!r}, expected one that this {type(result).__name__} has: {known}."
        if not result.series if isinstance(result, Comparison) else getattr(result, "picture", result) is None:
            message += (
                " The others show histories over time, which are no part of its JSON: call compare or trace again, or "
                "keep the result by pickle, which holds them."
            )
        raise UsageError(message)
    return chart_figure(charts[name])


def plot_compare(comparison: Comparison) -> Figure:
    """The hypotheses side by side, the likeliest on top, as a matplotlib figure.

    Parameters
    ----------
    comparison : Comparison
        What `compare` returned, or `Comparison.from_json` read.

    Returns
    -------
    matplotlib.figure.Figure
        ln evidence, and by how much held-out stretches are predicted better, +- 2 sigma, over the baseline only.

    Raises
    ------
    UsageError
        matplotlib is not installed.
    """
    return plot(comparison, "evidence")
