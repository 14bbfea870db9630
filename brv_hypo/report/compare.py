"""A comparison as a document."""

from __future__ import annotations

from collections.abc import Sequence

from brv_hypo.ranking.result import Comparison, Knot, MaximumLikelihood, RankedHypothesis, TermEstimate
from brv_hypo.report import rows
from brv_hypo.report.blocks import Block, Document, Picture, Shown, Table, Texts
from brv_hypo.report.comparison_charts import comparison_charts


def comparison_document(comparison: Comparison) -> Document:
    """Ranking, verdict and warnings; in detail every term, criterion and note; on a page the charts."""
    verdict = comparison.verdict
    ranking = Table(
        rows.RANKING_HEADINGS, rows.ranking_rows(comparison), marked=rows.standing_rows(comparison)
    )
    headings = ("criterion", *(row.mechanism for row in comparison.ranking))
    terms = [block for row in comparison.ranking for block in _of_hypothesis(row)]
    return Document(
        title="Mechanisms compared: " + ", ".join(flight.title or flight.path for flight in comparison.flights),
        subtitle=rows.flight_texts(comparison),
        conclusion_title=f"Verdict: {verdict.winner or verdict.outcome}",
        conclusion=verdict.reason,
        settled=verdict.winner is not None,
        blocks=(
            ranking,
            Texts(comparison.disagreements, "Disagreements"),
            Texts(rows.warning_texts(comparison), "Warnings", warning=True),
            *(Picture(chart) for chart in comparison_charts(comparison)),
            term_table("baseline, as the likeliest hypothesis has it", comparison.baseline.terms),
            *terms,
            Table(headings, rows.criteria_rows(comparison), "criteria in whitened rates", shown="verbose"),
            Texts(rows.stepwise_texts(comparison), "Stepwise beside the exact search", shown="verbose"),
            Texts(rows.note_texts(comparison), "Notes", shown="verbose"),
            Texts((_seconds(comparison),), bullets=False, shown="verbose"),
        ),
    )


def _of_hypothesis(hypothesis: RankedHypothesis) -> list[Block]:
    """Terms, derived quantities and likelihood fit of one hypothesis."""
    blocks: list[Block] = [term_table(hypothesis.mechanism, hypothesis.terms, knots=hypothesis.knots)]
    blocks.append(Texts(rows.knot_texts(hypothesis.knots), shown="verbose"))
    blocks.append(Texts(rows.derived_texts(hypothesis.derived), shown="verbose"))
    if hypothesis.ml is not None:
        blocks += likelihood_blocks(rows.likelihood_heading(hypothesis.mechanism, hypothesis.ml), hypothesis.ml)
    return blocks


def likelihood_blocks(heading: str, fit: MaximumLikelihood) -> list[Block]:
    """Terms, errors of the record, and what follows from them, by maximum likelihood."""
    derived = [*rows.derived_texts(fit.derived), *([fit.message] if fit.message else [])]
    errors = Table(
        rows.ERROR_HEADINGS, rows.error_rows(fit.instrument), f"{heading}: errors of the record", shown="verbose"
    )
    return [term_table(heading, fit.terms, knots=fit.knots), Texts(derived, shown="verbose"), errors]


def term_table(
    heading: str,
    terms: Sequence[TermEstimate],
    shown: Shown = "verbose",
    knots: Sequence[Knot] = (),
    most: int | None = None,
) -> Table:
    """One row for each coefficient with its sigma, F, unit, region and delay, where any has one."""
    headings, lines = rows.shown_columns(rows.TERM_HEADINGS, rows.term_rows(terms, knots))
    return Table(headings, lines, heading, most=most, shown=shown)


def _seconds(comparison: Comparison) -> str:
    seconds = comparison.seconds
    return (
        f"{seconds.total:.2f} s in all: reconstruction {seconds.reconstruct:.2f}, selection "
        f"{seconds.select:.2f}, maximum likelihood {seconds.ml:.2f}"
    )
