"""A comparison as a page."""

from __future__ import annotations

from collections.abc import Sequence

from brv_hypo.ranking.result import CoefficientSeries, Comparison, RankedHypothesis, Series
from brv_hypo.report import figures, rows
from brv_hypo.report.pages import Block, bullets, drawn, page, table

LEADING = 2
"""Hypotheses that are drawn besides `none`; more lines than this hide each other."""
ROUNDING = 1e-9
"""A coefficient that stays below this, its error included, is none of the model's and is not drawn."""


def comparison_page(comparison: Comparison) -> str:
    """Ranking, verdict and warnings, and the histories with what the leading hypotheses make of them."""
    names = ", ".join(flight.title or flight.path for flight in comparison.flights)
    ranking = table(
        rows.RANKING_HEADINGS,
        rows.ranking_rows(comparison),
        marked=rows.standing_rows(comparison),
    )
    blocks = [
        Block("Ranking", ranking + bullets(rows.disagreement_texts(comparison))),
        Block("Probability", drawn(figures.probability_figure(comparison.verdict.probability))),
        Block("Warnings", bullets(rows.warning_texts(comparison))),
    ]
    for index, (flight, series) in enumerate(zip(comparison.flights, comparison.series, strict=False)):
        which = f": {flight.title or flight.path}" if len(comparison.flights) > 1 else ""
        blocks.extend(_histories(series, leading(comparison), which))
        for name in leading(comparison):
            own = [s for s in comparison.coefficients if (s.flight, s.mechanism) == (index, name)]
            blocks.extend(_coefficients(own, which))
    for row in comparison.ranking:
        blocks.extend(_terms(row))
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


def _coefficients(series: Sequence[CoefficientSeries], which: str) -> list[Block]:
    """Coefficients and derivatives of one hypothesis over one flight; nothing where it has none."""
    shown = [s for s in series if max(map(abs, s.value)) > ROUNDING or max(s.std_error) > ROUNDING]
    if not shown:
        return []
    histories: dict[str, list[figures.Uncertain]] = {}
    for each in shown:
        history = figures.Uncertain(each.time_s, each.value, each.std_error)
        histories.setdefault(each.name, []).append(history)
    picture = drawn(figures.coefficient_figure(histories))
    heading = f"Coefficients of {shown[0].mechanism} by {shown[0].method}{which}"
    return [Block(heading, picture + bullets(rows.coefficient_texts(shown)))]


def _terms(hypothesis: RankedHypothesis) -> list[Block]:
    """Terms and what follows from them, by regression and, where it was tried, by maximum likelihood."""
    own = table(rows.TERM_HEADINGS, rows.term_rows(hypothesis.terms)) if hypothesis.terms else ""
    blocks = [
        Block(f"Terms of {hypothesis.mechanism}", own + bullets(rows.derived_texts(hypothesis.derived)))
    ]
    if hypothesis.ml is not None:
        fit = hypothesis.ml
        estimates = (*fit.terms, *fit.instrument)
        found = table(rows.TERM_HEADINGS, rows.term_rows(estimates)) if estimates else ""
        texts = bullets([*rows.derived_texts(fit.derived), *([fit.message] if fit.message else [])])
        blocks.append(Block(f"Terms of {rows.likelihood_heading(hypothesis.mechanism, fit)}", found + texts))
    return blocks
