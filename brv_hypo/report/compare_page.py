"""A comparison as a page."""

from __future__ import annotations

from collections.abc import Sequence

from brv_hypo.ranking.result import Comparison, RankedHypothesis, Series
from brv_hypo.report import figures, rows
from brv_hypo.report.pages import Block, bullets, drawn, page, table

LEADING = 2
"""Hypotheses that are drawn besides `none`; more lines than this hide each other."""


def comparison_page(comparison: Comparison) -> str:
    """Ranking, verdict and warnings, and the histories with what the leading hypotheses make of them."""
    names = ", ".join(flight.title or flight.path for flight in comparison.flights)
    ranking = table(
        rows.RANKING_HEADINGS,
        rows.ranking_rows(comparison),
        marked=rows.standing_rows(comparison),
    )
    blocks = [
        Block("Ranking", ranking),
        Block("Probability", drawn(figures.probability_figure(comparison.verdict.probability))),
        Block("Warnings", bullets(rows.warning_texts(comparison))),
    ]
    for flight, series in zip(comparison.flights, comparison.series, strict=False):
        which = f": {flight.title or flight.path}" if len(comparison.flights) > 1 else ""
        blocks.extend(_histories(series, leading(comparison), which))
    blocks.extend(Block(f"Terms of {row.mechanism}", _terms(row)) for row in comparison.ranking if row.terms)
    headings = ("criterion", *(row.mechanism for row in comparison.ranking))
    blocks.append(Block("Criteria, in whitened rates", table(headings, rows.criteria_rows(comparison))))
    blocks.append(Block("Notes", bullets(rows.note_texts(comparison))))
    subtitle = "; ".join(rows.flight_texts(comparison))
    return page(f"Mechanisms compared: {names}", subtitle, comparison.verdict.reason, blocks)


def leading(comparison: Comparison) -> list[str]:
    """The hypotheses to draw: the first of the ranking, and `none` for contrast."""
    first = [row.mechanism for row in comparison.ranking if row.mechanism != "none"][:LEADING]
    return [*first, "none"]


def _histories(series: Series, names: Sequence[str], which: str) -> list[Block]:
    fitted = {name: series.fitted[name] for name in names if name in series.fitted}
    known = (series.time_s, series.measured, series.sigma)
    motion = figures.motion_figure(series.time_s, series.alpha_rad, series.windward_meridian_rad)
    return [
        Block(f"Moments, measured and fitted{which}", drawn(figures.moment_figure(*known, fitted))),
        Block(f"Residuals{which}", drawn(figures.residual_figure(*known, fitted))),
        Block(f"Motion{which}", drawn(motion)),
    ]


def _terms(hypothesis: RankedHypothesis) -> str:
    terms = table(rows.TERM_HEADINGS, rows.term_rows(hypothesis.terms))
    return terms + bullets(rows.derived_texts(hypothesis.derived))
