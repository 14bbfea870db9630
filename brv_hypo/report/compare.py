"""A comparison as tables for the terminal."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from rich.console import Group, RenderableType
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from brv_hypo.ranking.result import Comparison, DerivedEstimate, RankedHypothesis, TermEstimate, Verdict
from brv_hypo.report.style import bullets, interval, number, percent, plain_table, warning_list


def comparison_view(comparison: Comparison, *, verbose: bool = False) -> RenderableType:
    """Flights, ranking, verdict and warnings; `verbose` adds every term of every hypothesis."""
    parts: list[RenderableType] = [flight_lines(comparison), Text(), ranking_table(comparison)]
    if verbose:
        parts.append(term_table("Baseline (fitted along with every hypothesis)", comparison.baseline.terms))
        parts.extend(part for hypothesis in comparison.ranking for part in hypothesis_tables(hypothesis))
    parts.append(verdict_panel(comparison.verdict))
    parts.append(warning_list((*comparison.reconstruction.warnings, *comparison.warnings)))
    if verbose:
        parts.append(bullets(_notes(comparison), "Notes"))
        seconds = comparison.seconds
        parts.append(
            Text(
                f"{seconds.total:.2f} s in all: reconstruction {seconds.reconstruct:.2f}, selection "
                f"{seconds.select:.2f}, maximum likelihood {seconds.ml:.2f}",
                "dim",
            )
        )
    return Group(*parts)


def _notes(comparison: Comparison) -> list[str]:
    """What reading changed, and remarks on the fits."""
    flights = [note for flight in comparison.flights for note in flight.notes]
    fits = [
        f"{hypothesis.mechanism}: {note}" for hypothesis in comparison.ranking for note in hypothesis.notes
    ]
    return [*flights, *fits]


def flight_lines(comparison: Comparison) -> Text:
    """One line for each flight, and one for how well the motion is known."""
    lines = [
        f"{flight.title or flight.path}: {flight.samples} samples, {flight.start_s:.2f} to "
        f"{flight.stop_s:.2f} s, {flight.sample_rate_hz:.4g} Hz"
        for flight in comparison.flights
    ]
    known = comparison.reconstruction
    lines.append(
        f"motion by the {known.method} method: alpha to "
        f"{number(np.degrees(known.alpha_rms_sigma_rad), 2)} deg, windward meridian to "
        f"{number(known.phi_w_rms_sigma_rad, 2)} rad (1 sigma, rms)"
    )
    return Text("\n".join(lines))


def ranking_table(comparison: Comparison) -> Table:
    """One row for each hypothesis, the likeliest first."""
    table = plain_table()
    table.add_column("rank", justify="right")
    table.add_column("mechanism", no_wrap=True)
    for heading in ("terms", "F-ratio", "C_p", "pred. error", "of none", "R²", "prob."):
        table.add_column(heading, justify="right", no_wrap=True)
    standing = comparison.verdict.equivalent
    for row in comparison.ranking:
        failed = row.status == "failed"
        table.add_row(
            str(row.rank),
            row.mechanism,
            str(row.n_terms),
            number(row.f_ratio),
            number(row.cp, 4),
            number(row.prediction_error),
            "failed" if failed else percent(row.prediction_ratio),
            f"{row.r2:.4f}",
            percent(comparison.verdict.probability.get(row.mechanism)),
            style="bold" if row.mechanism in standing else "",
        )
    return table


def verdict_panel(verdict: Verdict) -> Panel:
    """The verdict in one sentence: green where a winner is named."""
    return Panel(
        Text(verdict.reason),
        title=f"Verdict: {verdict.winner or 'undecided'}",
        title_align="left",
        border_style="green" if verdict.winner else "yellow",
        expand=False,
    )


def hypothesis_tables(hypothesis: RankedHypothesis) -> Iterable[RenderableType]:
    """Terms, derived quantities, criteria and likelihood fit of one hypothesis."""
    if not hypothesis.terms and hypothesis.ml is None:
        return
    yield term_table(hypothesis.mechanism, hypothesis.terms)
    if hypothesis.derived:
        yield derived_lines(hypothesis.derived)
    if hypothesis.criteria:
        yield Text(
            "  " + ", ".join(f"{name} {number(value, 4)}" for name, value in hypothesis.criteria.items()),
            "dim",
        )
    if hypothesis.ml is not None:
        fit = hypothesis.ml
        heading = f"{hypothesis.mechanism} by maximum likelihood: {fit.status}, {fit.iterations} iterations"
        yield term_table(heading, (*fit.terms, *fit.instrument))
        if fit.message:
            yield Text(f"  {fit.message}", "dim")


def term_table(title: str, terms: Sequence[TermEstimate]) -> Table:
    """One row for each coefficient with its sigma, F, unit, region and delay."""
    table = plain_table(title)
    table.add_column("term", no_wrap=True)
    table.add_column("channel", no_wrap=True)
    for heading in ("value", "sigma", "F"):
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column("unit", no_wrap=True)
    table.add_column("region, s", justify="right", no_wrap=True)
    table.add_column("delay, s", justify="right", no_wrap=True)
    for term in terms:
        table.add_row(
            term.name,
            term.channel,
            number(term.value, 4),
            number(term.std_error, 2),
            number(term.f_ratio),
            term.units,
            interval(term.region_s),
            number(term.delay_s),
        )
    return table


def derived_lines(derived: Sequence[DerivedEstimate]) -> Text:
    """What follows from the coefficients, one line each; angles in degrees too."""
    lines = []
    for item in derived:
        region = f" in {interval(item.region_s)} s" if item.region_s else ""
        unit = "" if item.units == "1" else f" {item.units}"
        line = f"  {item.name} = {number(item.value, 4)} ± {number(item.std_error, 2)}{unit}{region}"
        if item.units == "rad":
            line += f" ({np.degrees(item.value):.1f} ± {np.degrees(item.std_error):.1f} deg)"
        lines.append(line)
    return Text("\n".join(lines))
