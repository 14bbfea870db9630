"""A prediction as tables for the terminal."""

from __future__ import annotations

from rich.console import Group, RenderableType
from rich.text import Text

from brv_hypo.report.compare import add_columns, term_table
from brv_hypo.report.style import interval, number, plain_table
from brv_hypo.residuals.prediction import Prediction


def prediction_view(result: Prediction) -> RenderableType:
    """Errors without the model, with it frozen and with it refitted; by region; the coefficients."""
    errors = plain_table()
    add_columns(errors, ("moments less", "mean square", "ratio"))
    for name, value in (
        ("nothing", result.error.without),
        ("the frozen model", result.error.frozen),
        ("the model fitted here", result.error.own),
        ("all but noise", result.error.noise),
    ):
        errors.add_row(name, number(value), number(value / result.error.without))
    regions = plain_table()
    add_columns(regions, ("time s", "Mach", "ratio"))
    for region in result.regions:
        mach = "" if region.mach is None else interval(region.mach)
        regions.add_row(interval((region.start_s, region.stop_s)), mach, number(region.ratio))
    parts: list[RenderableType] = [errors, regions, *term_table("frozen", result.frozen)]
    if result.refitted:
        parts.extend(term_table("fitted to this flight", result.refitted))
    return Group(*parts, Text(result.reason))
