"""A prediction as a page."""

from __future__ import annotations

from brv_hypo.report import figures, rows
from brv_hypo.report.pages import Block, drawn, page, table
from brv_hypo.report.prediction import ERROR_HEADINGS, REGION_HEADINGS, error_rows, region_rows
from brv_hypo.report.trace import flight_line
from brv_hypo.residuals.prediction import Prediction


def prediction_page(result: Prediction) -> str:
    """The moments in the band in which the frozen model predicts them, the errors, and the coefficients."""
    band = result.band
    figure = figures.prediction_figure(band.time_s, band.measured, band.predicted, band.half_width)
    title = f"Moments as measured, in the {100.0 * band.level:.0f} % predictive band"
    blocks = [
        Block(title, drawn(figure)),
        Block("Errors", table(ERROR_HEADINGS, error_rows(result))),
        Block("By region", table(REGION_HEADINGS, region_rows(result))),
        Block("Frozen", table(rows.TERM_HEADINGS, rows.term_rows(result.frozen))),
    ]
    if result.refitted:
        fitted = table(rows.TERM_HEADINGS, rows.term_rows(result.refitted))
        blocks.append(Block("Fitted to this flight", fitted))
    name = result.flight.title or result.flight.path
    return page(f"Predicted: {name}", flight_line(result.flight), result.reason, blocks)
