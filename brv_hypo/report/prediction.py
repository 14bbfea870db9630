"""A prediction as tables for the terminal."""

from __future__ import annotations

from rich.console import Group, RenderableType
from rich.text import Text

from brv_hypo.report.compare import add_columns, term_table
from brv_hypo.report.style import interval, number, plain_table
from brv_hypo.residuals.prediction import Prediction

ERROR_HEADINGS = ("moments less", "mean square", "ratio")
REGION_HEADINGS = ("time s", "Mach", "ratio")


def error_rows(result: Prediction) -> list[tuple[str, str, str]]:
    """Mean squares without the model, with it frozen and refitted, and of the noise; over that without."""
    error = result.error
    named = (
        ("nothing", error.without),
        ("the frozen model", error.frozen),
        ("the model fitted here", error.own),
        ("all but noise", error.noise),
    )
    return [(name, number(value), number(value / error.without)) for name, value in named]


def region_rows(result: Prediction) -> list[tuple[str, str, str]]:
    """Span, Mach numbers and ratio of errors of each stretch of the record."""
    return [
        (
            interval((region.start_s, region.stop_s)),
            "" if region.mach is None else interval(region.mach),
            number(region.ratio),
        )
        for region in result.regions
    ]


def prediction_view(result: Prediction) -> RenderableType:
    """Errors without the model, with it frozen and with it refitted; by region; the coefficients."""
    errors = plain_table()
    add_columns(errors, ERROR_HEADINGS)
    for line in error_rows(result):
        errors.add_row(*line)
    regions = plain_table()
    add_columns(regions, REGION_HEADINGS)
    for line in region_rows(result):
        regions.add_row(*line)
    parts: list[RenderableType] = [errors, regions, *term_table("frozen", result.frozen)]
    if result.refitted:
        parts.extend(term_table("fitted to this flight", result.refitted))
    return Group(*parts, Text(result.reason))
