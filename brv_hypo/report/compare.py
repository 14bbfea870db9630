"""A comparison as tables for the terminal."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from rich.console import Group, RenderableType
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from brv_hypo.ranking.result import Comparison, RankedHypothesis, TermEstimate, Verdict
from brv_hypo.report import rows
from brv_hypo.report.style import NOT_A_NUMBER, bullets, plain_table, warning_list


def comparison_view(comparison: Comparison, *, verbose: bool = False) -> RenderableType:
    """Flights, ranking, verdict and warnings; `verbose` adds every term of every hypothesis."""
    parts: list[RenderableType] = [
        Text("\n".join(rows.flight_texts(comparison))),
        Text(),
        ranking_table(comparison),
    ]
    if verbose:
        parts.extend(_details(comparison))
        parts.append(bullets(rows.disagreement_texts(comparison), "Disagreements"))
    else:
        parts.append(bullets(comparison.disagreements, "Disagreements"))
    parts.extend([Text(), verdict_panel(comparison.verdict), warning_list(rows.warning_texts(comparison))])
    return Group(*parts)


def ranking_table(comparison: Comparison) -> Table:
    """One row for each hypothesis, the likeliest first; those that stand are bold."""
    table = plain_table()
    add_columns(table, rows.RANKING_HEADINGS)
    standing = rows.standing_rows(comparison)
    for index, row in enumerate(rows.ranking_rows(comparison)):
        table.add_row(*row, style="bold" if index in standing else "")
    return table


def add_columns(table: Table, headings: Sequence[str]) -> None:
    """A column for each heading: words to the left, numbers to the right."""
    for heading in headings:
        table.add_column(heading, justify="left" if heading in rows.TEXT_COLUMNS else "right", no_wrap=True)


def verdict_panel(verdict: Verdict) -> Panel:
    """The verdict in one sentence: green where a winner is named."""
    return Panel(
        Text(verdict.reason),
        title=f"Verdict: {verdict.winner or verdict.outcome}",
        title_align="left",
        border_style="green" if verdict.winner else "yellow",
        expand=False,
    )


def _details(comparison: Comparison) -> Iterable[RenderableType]:
    yield from term_table("baseline, fitted along with every hypothesis", comparison.baseline.terms)
    for hypothesis in comparison.ranking:
        yield from hypothesis_tables(hypothesis)
    yield from criteria_table(comparison)
    yield bullets(rows.note_texts(comparison), "Notes")
    seconds = comparison.seconds
    yield Text(
        f"{seconds.total:.2f} s in all: reconstruction {seconds.reconstruct:.2f}, selection "
        f"{seconds.select:.2f}, maximum likelihood {seconds.ml:.2f}",
        "dim",
    )


def hypothesis_tables(hypothesis: RankedHypothesis) -> Iterable[RenderableType]:
    """Terms, derived quantities, criteria and likelihood fit of one hypothesis."""
    if hypothesis.terms:
        yield from term_table(hypothesis.mechanism, hypothesis.terms)
    for line in rows.derived_texts(hypothesis.derived):
        yield Text(f"  {line}")
    if hypothesis.ml is not None:
        fit = hypothesis.ml
        heading = rows.likelihood_heading(hypothesis.mechanism, fit)
        yield from term_table(heading, (*fit.terms, *fit.instrument))
        for line in rows.derived_texts(fit.derived):
            yield Text(f"  {line}")
        if fit.message:
            yield Text(f"  {fit.message}", "dim")


def criteria_table(comparison: Comparison) -> Iterable[RenderableType]:
    """The report's criteria and others (rows) of every hypothesis (columns)."""
    table = plain_table()
    lines = rows.criteria_rows(comparison)
    if not lines:
        return
    table.add_column("criterion", no_wrap=True)
    for hypothesis in comparison.ranking:
        table.add_column(hypothesis.mechanism, justify="right", no_wrap=True)
    for line in lines:
        table.add_row(*line)
    yield from (Text("\ncriteria in whitened rates", "bold"), table)


def term_table(title: str, terms: Sequence[TermEstimate]) -> Iterable[RenderableType]:
    """One row for each coefficient with its sigma, F, unit, region and delay, where any has one."""
    table = plain_table()
    lines = rows.term_rows(terms)
    shown = [i for i in range(len(rows.TERM_HEADINGS)) if any(line[i] != NOT_A_NUMBER for line in lines)]
    add_columns(table, [rows.TERM_HEADINGS[i] for i in shown])
    for line in lines:
        table.add_row(*(line[i] for i in shown))
    return (Text(f"\n{title}", "bold"), table)
