"""A trace as tables for the terminal."""

from __future__ import annotations

from collections.abc import Iterable

from rich.console import Group, RenderableType
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from brv_hypo.ranking.result import FlightSummary, MaximumLikelihood
from brv_hypo.report.compare import add_columns, term_table
from brv_hypo.report.style import bullets, interval, number, plain_table, share, warning_list
from brv_hypo.residuals.result import Residual, Step, Trace, TriedCandidate

TOLD = 4
"""Candidates shown for each step; all of them with `verbose`."""

CANDIDATE_HEADINGS = ("effect", "kind", "F-ratio", "adjusted p", "explains", "cannot be told from")


def trace_view(result: Trace, *, verbose: bool = False) -> RenderableType:
    """The steps, the model, and what is left unexplained."""
    parts: list[RenderableType] = [Text("\n".join(flight_line(flight) for flight in result.flights))]
    for step in result.steps:
        parts.extend(_step(step, verbose))
    if result.final_residual is not None:
        parts.append(Text(f"\nLeft over: {residual_text(result.final_residual)}"))
    if verbose:
        parts.extend(term_table("model, fitted to the whole record", result.model.terms))
    if verbose and result.ml is not None:
        parts.append(Text(f"\n{likelihood_text(result.ml)}"))
        parts.extend(term_table("model, by maximum likelihood", result.ml.terms))
    panel = Panel(
        Text(conclusion(result)),
        title="Found: " + (", ".join(result.findings) or "nothing"),
        title_align="left",
        border_style="yellow" if result.unexplained else "green",
        expand=False,
    )
    return Group(*parts, Text(), panel, warning_list(result.caveats))


def flight_line(flight: FlightSummary) -> str:
    """Title, samples, span and rate of a flight."""
    span = interval((flight.start_s, flight.stop_s))
    return f"{flight.title or flight.path}: {flight.samples} samples, {span} s, {flight.sample_rate_hz:.4g} Hz"


def conclusion(result: Trace) -> str:
    """What was found, what is hinted at, and what is left, in a sentence or two."""
    found = f"Found: {', '.join(result.findings)}." if result.findings else "Nothing was found."
    hinted = f"Hints, no findings: {', '.join(result.hints)}." if result.hints else ""
    return " ".join(part for part in (found, hinted, _ending(result), result.unexplained) if part)


def _ending(result: Trace) -> str:
    """Why the loop stopped, where that says something of the flight."""
    return {
        "white": "What is left is noise.",
        "nothing significant": "No effect explains more.",
        "nothing improves held-out error": "No effect that was tried predicts more.",
        "limit": "",
    }[result.stopped]


def residual_text(residual: Residual) -> str:
    """Size, whiteness and place of a residual."""
    white = "white" if residual.white else f"not white (p {number(residual.p_value, 2)})"
    where = "" if residual.flight is None else f"flight {residual.flight + 1}: "
    return (
        f"{where}rms {number(residual.rms)}, {white}, {number(residual.noise_ratio)} of the noise; worst in "
        f"{residual.worst_channel}, {interval(residual.worst_region_s)} s, mostly at "
        f"{number(residual.dominant_frequency_hz)} Hz ({residual.dominant_frequency_is})"
    )


def _step(step: Step, verbose: bool) -> Iterable[RenderableType]:
    yield Text(f"\nStep {step.step}", "bold")
    yield Text(f"residual {residual_text(step.residual)}")
    if step.candidates:
        yield candidate_table(step.candidates if verbose else step.candidates[:TOLD], step.added)
    if step.look_alikes:
        yield Text(f"as good a fit on this flight: {', '.join(step.look_alikes)}", "dim")
    yield Text(outcome_text(step), "bold" if step.added else "")
    if verbose:
        correlated = [
            f"{one.moment} goes with {one.channel}: {number(one.coefficient, 2)} (p {number(one.p_value, 2)})"
            for one in step.residual.correlations
        ]
        yield bullets(correlated, "Correlations")


def candidate_table(candidates: Iterable[TriedCandidate], added: str | None) -> Table:
    """One row for each effect that was tried, the best first; what was added is bold."""
    table = plain_table()
    add_columns(table, CANDIDATE_HEADINGS)
    for row in candidates:
        table.add_row(*candidate_row(row), style="bold" if row.effect == added else "")
    return table


def candidate_row(candidate: TriedCandidate) -> tuple[str, ...]:
    """Effect, kind, F, adjusted p, the share of the residual that it explains, and its near-equals."""
    return (
        candidate.effect,
        candidate.kind,
        number(candidate.f_ratio),
        number(candidate.p_value_adjusted, 2),
        share(candidate.explains),
        ", ".join(candidate.near_equals),
    )


def outcome_text(step: Step) -> str:
    """What was added, and the errors before and after; those of the specific force where an error of the record was."""
    before = step.error_before
    if step.added is None or step.error_after is None:
        refused = f" ({', '.join(step.refused)} did not lower the held-out error)" if step.refused else ""
        return f"added nothing{refused}; error {number(before.fit)} in the fit, {number(before.held_out)} held out"
    after = step.error_after
    what = f"added {step.added}" + (f" ({step.description})" if step.description else "")
    what += f", a {step.standing}, named in {share(step.named_in)} of the repetitions"
    ratio = number(step.error_ratio_held_out)
    if step.error_ratio_std_error is not None:
        ratio += f" ± {number(step.error_ratio_std_error, 2)}"
    if step.held_out_score is not None:
        ratio += f"; rates and force held out fall by {number(step.held_out_score, 2)} standard errors"
    return (
        f"{what}: error in the fit {number(before.fit)} → {number(after.fit)}, held out "
        f"{number(before.held_out)} → {number(after.held_out)} (ratio {ratio}){_force_text(step)}{_flight_text(step)}"
    )


def _flight_text(step: Step) -> str:
    if step.flight_left_out is None:
        return ""
    return f"; on each flight by the others, ratio {number(step.flight_left_out.ratio)}"


def _force_text(step: Step) -> str:
    kind = next((c.kind for c in step.candidates if c.effect == step.added), None)
    after = step.force_error_after
    if kind not in ("instrument", "environment") or after is None:
        return ""
    before = step.force_error_before
    return f"; specific force held out {number(before.held_out)} → {number(after.held_out)} m²/s⁴"


def likelihood_text(likelihood: MaximumLikelihood) -> str:
    """How the refinement of the final model by maximum likelihood ended."""
    said = f"Maximum likelihood of the final model: {likelihood.status}"
    return said if likelihood.status == "converged" else f"{said} ({likelihood.message})"
