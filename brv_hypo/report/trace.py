"""A trace as a document."""

from __future__ import annotations

from brv_hypo.ranking.result import MaximumLikelihood
from brv_hypo.report.blocks import Block, Document, Picture, Table, Texts
from brv_hypo.report.compare import term_table
from brv_hypo.report.rows import CONTRADICTED, IN_DOUBT, fault_texts, flight_line
from brv_hypo.report.style import interval, number, p_value, share
from brv_hypo.report.trace_charts import trace_charts
from brv_hypo.residuals.result import Residual, Step, Trace, TriedCandidate

TOLD = 4
"""Candidates that the terminal shows for each step; all of them with -v and on the page."""

CANDIDATE_HEADINGS = ("effect", "kind", "F-ratio", "adjusted p", "explains", "near-equals")


def trace_document(result: Trace) -> Document:
    """The steps, the model, and what is left unexplained."""
    name = ", ".join(flight.title or str(flight.path) for flight in result.flights)
    left = result.final_residual
    blocks: list[Block] = [*(Picture(chart) for chart in trace_charts(result))]
    for step in result.steps:
        blocks += _step(step)
    if left is not None:
        blocks.append(Texts((residual_text(left),), "Left over", bullets=False))
    blocks.append(term_table("model, fitted to the whole record", result.model.terms))
    if result.ml is not None:
        blocks.append(Texts((likelihood_text(result.ml),), bullets=False, shown="verbose"))
        blocks.append(term_table("model, by maximum likelihood", result.ml.terms))
    blocks.append(Texts((*fault_texts(result.record), *result.caveats), "Warnings", warning=True))
    return Document(
        title=f"Residual traced: {name}",
        subtitle=tuple(flight_line(flight) for flight in result.flights),
        conclusion_title=_title(result),
        conclusion=conclusion(result),
        settled=result.unexplained is None and result.record.sound,
        blocks=blocks,
    )


def _title(result: Trace) -> str:
    return "Found: " + (", ".join(result.findings) or "nothing") if result.record.sound else IN_DOUBT


def conclusion(result: Trace) -> str:
    """What was found, what is hinted at, and what is left, in a sentence or two."""
    doubt = "" if result.record.sound else CONTRADICTED.format(told="found")
    found = f"Found: {', '.join(result.findings)}." if result.findings else "Nothing was found."
    hinted = f"Hints, no findings: {', '.join(result.hints)}." if result.hints else ""
    told = (doubt, found, hinted, result.static_stability, _ending(result), result.unexplained)
    return " ".join(part for part in told if part)


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
    white = "white" if residual.white else f"not white (p {p_value(residual.p_value)})"
    where = "" if residual.flight is None else f"flight {residual.flight + 1}: "
    return (
        f"{where}rms {number(residual.rms)}, {white}, mean square {number(residual.noise_ratio)} of the noise's; "
        f"worst in {residual.worst_channel}, {interval(residual.worst_region_s)} s, mostly at "
        f"{number(residual.dominant_frequency_hz)} Hz ({residual.dominant_frequency_is})"
    )


def _step(step: Step) -> list[Block]:
    rows = [candidate_row(row) for row in step.candidates]
    told = [outcome_text(step)]
    if step.look_alikes:
        told.insert(0, f"as good a fit on this flight: {', '.join(step.look_alikes)}")
    if step.taken_out:
        told.append(f"not needed beside it, and taken out: {', '.join(step.taken_out)}")
    correlated = [
        f"{one.moment} goes with {one.channel}: {number(one.coefficient, 2)} (p {p_value(one.p_value)})"
        for one in step.residual.correlations
    ]
    marked = [i for i, row in enumerate(step.candidates) if row.effect == step.added]
    return [
        Texts((f"residual {residual_text(step.residual)}",), f"Step {step.step}", bullets=False),
        Table(CANDIDATE_HEADINGS, rows, marked=marked, most=TOLD),
        Texts(told, bullets=False, strong=step.added is not None),
        Texts(correlated, "Correlations", shown="verbose"),
    ]


def candidate_row(candidate: TriedCandidate) -> tuple[str, ...]:
    """Effect, kind, F, adjusted p, the share of the residual that it explains, and its near-equals."""
    return (
        candidate.effect,
        candidate.kind,
        number(candidate.f_ratio),
        p_value(candidate.p_value_adjusted),
        share(candidate.explains),
        ", ".join(candidate.near_equals),
    )


def _refused_text(step: Step) -> str:
    """What counted in the fit, and why it was not added."""
    unnamed = step.refused[-1:] if step.named_in == 0.0 else ()
    worse = step.refused[: len(step.refused) - len(unnamed)]
    reasons = [f"{', '.join(worse)} did not lower the held-out error"] if worse else []
    reasons += [f"no repetition names {name}" for name in unnamed]
    return f" ({'; '.join(reasons)})" if reasons else ""


def outcome_text(step: Step) -> str:
    """What was added, and the errors before and after; those of the specific force where an error of the record was."""
    before = step.error_before
    if step.added is None or step.error_after is None:
        errors = f"error {number(before.fit)} in the fit, {number(before.held_out)} held out"
        return f"added nothing{_refused_text(step)}; {errors}"
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
