"""A trace as a page."""

from __future__ import annotations

from brv_hypo.report import figures, rows
from brv_hypo.report.pages import Block, bullets, drawn, page, table
from brv_hypo.report.trace import (
    CANDIDATE_HEADINGS,
    candidate_row,
    conclusion,
    flight_line,
    likelihood_text,
    outcome_text,
    residual_text,
)
from brv_hypo.residuals.result import Step, Trace


def trace_page(result: Trace) -> str:
    """The residual before and after, the steps, and the model."""
    blocks = []
    if (picture := result.picture) is not None:
        left = {"before": picture.before, "after": picture.after}
        figure = figures.leftover_figure(picture.time_s, left, picture.sigma)
        blocks.append(Block("Residual moments, before and after", drawn(figure)))
    blocks.extend(Block(f"Step {step.step}", _step(step)) for step in result.steps)
    if result.model.terms:
        terms = table(rows.TERM_HEADINGS, rows.term_rows(result.model.terms))
        blocks.append(Block("Model, fitted to the whole record", terms))
    if result.ml is not None:
        refined = bullets([likelihood_text(result.ml)]) + table(
            rows.TERM_HEADINGS, rows.term_rows(result.ml.terms)
        )
        blocks.append(Block("Model, by maximum likelihood", refined))
    blocks.append(Block("Caveats", bullets(result.caveats)))
    names = ", ".join(flight.title or str(flight.path) for flight in result.flights)
    subtitle = "; ".join(flight_line(flight) for flight in result.flights)
    return page(f"Residual traced: {names}", subtitle, conclusion(result), blocks)


def _step(step: Step) -> str:
    told = bullets([f"residual {residual_text(step.residual)}", outcome_text(step)])
    return told + table(CANDIDATE_HEADINGS, [candidate_row(one) for one in step.candidates])
