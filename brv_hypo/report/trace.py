"""A trace as a document: the steps with their candidates and errors, the model, and the residual that is left.

`trace_charts` draws the moments with the model, the residual before and after, the static slope by Mach
number and the motion. `trace_document` is the entrance.
"""

from __future__ import annotations

import numpy as np

from brv_hypo.ranking.result import MaximumLikelihood
from brv_hypo.report.comparison import term_table
from brv_hypo.report.document import (
    Band,
    Block,
    Chart,
    Document,
    Layer,
    Line,
    Panel,
    Picture,
    Role,
    Table,
    Texts,
    Values,
)
from brv_hypo.report.motion_charts import (
    BODY,
    TIME,
    Drawn,
    Setting,
    attitude_chart,
    caption,
    cut_text,
    difference,
    framed,
    knots_of,
    moment_chart,
    motion_chart,
    residual_chart,
    spectrum_chart,
    turning_rates,
)
from brv_hypo.report.style import interval, number, p_value, share
from brv_hypo.report.tables import CONTRADICTED, IN_DOUBT, fault_texts, flight_line
from brv_hypo.residuals.result import Residual, StaticSlope, Step, Trace, TriedCandidate

# ---- The charts of a trace: the moments with the model, the residual before and after, the motion ----


def trace_charts(result: Trace) -> list[Chart]:
    """Every chart that the trace has the data for; none where the residual was not kept."""
    picture = result.picture
    if picture is None:
        return []
    span = (result.flight.start_s, result.flight.stop_s)
    setting = Setting(span, knots_of(result.model.terms, *span))
    models = [Drawn("before", picture.before, "second"), Drawn("after", picture.after, "first")]
    heading = "Residual moments, before and after"
    rates = turning_rates(picture.roll_rate_rad_s, picture.windward_meridian_rate_rad_s)
    model = Drawn("model", difference(picture.measured, picture.after), "first")
    charts = [
        moment_chart(setting, picture.time_s, picture.measured, picture.sigma, [model], BODY),
        residual_chart(setting, picture.time_s, picture.sigma, models, BODY, heading),
        *(static_slope_chart(slope, len(result.static_slopes)) for slope in result.static_slopes),
        spectrum_chart(
            setting,
            picture.time_s,
            {
                "measured": (picture.measured, "measured"),
                "before": (picture.before, "second"),
                "after": (picture.after, "first"),
            },
            rates,
        ),
    ]
    if picture.alpha_rad:
        angles = (picture.alpha_rad, picture.windward_meridian_rad)
        sigmas = (picture.alpha_sigma_rad, picture.windward_meridian_sigma_rad)
        charts.append(motion_chart(setting, picture.time_s, *angles, *sigmas))
        charts.append(attitude_chart(setting, picture.time_s, *angles, picture.roll_rate_rad_s))
    return charts


def static_slope_chart(slope: StaticSlope, flights: int) -> Chart:
    """The slope of the static moment by Mach number, or by time where that is not known or stays the same."""
    by_mach = bool(np.all(np.isfinite(slope.mach))) and np.ptp(slope.mach) > 0.0
    x = np.array(slope.mach if by_mach else slope.time_s)
    order = np.argsort(x, kind="stable")
    layers = [
        *_estimate(x[order], np.array(slope.at_flown)[order], np.array(slope.at_flown_std_error)[order], "second",
                   "at the angle flown"),
        *_estimate(x[order], np.array(slope.at_zero)[order], np.array(slope.at_zero_std_error)[order], "first",
                   "at no angle of attack"),
    ]  # fmt: skip
    panels = [framed(Panel("C<sub>N</sub>′ by alpha, 1/rad", layers))]
    suffix, which = ("", "") if flights == 1 else (f"-{slope.flight + 1}", f", flight {slope.flight + 1}")
    read = "Negative is stable. Bands: two standard deviations of the coefficients."
    return Chart(
        f"static-slope{suffix}",
        f"Slope of the static moment{which}",
        "Mach number" if by_mach else TIME,
        panels,
        caption=caption(read, cut_text(panels)),
    )


def _estimate(x: Values, value: np.ndarray, sigma: np.ndarray, role: Role, name: str) -> list[Layer]:
    """A line within two standard deviations."""
    return [Band(x, value - 2.0 * sigma, value + 2.0 * sigma, "", role), Line(x, value, role, name)]


# ---- A trace as a document ----


SHOWN_AT_FIRST = 4
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
        decided=result.unexplained is None and result.record.sound,
        blocks=blocks,
    )


def _title(result: Trace) -> str:
    return "Found: " + (", ".join(result.findings) or "nothing") if result.record.sound else IN_DOUBT


def conclusion(result: Trace) -> str:
    """What was found, what is hinted at, and what is left, in a sentence or two."""
    doubt = "" if result.record.sound else CONTRADICTED.format(reported="found")
    found = f"Found: {', '.join(result.findings)}." if result.findings else "Nothing was found."
    hinted = f"Hints, no findings: {', '.join(result.hints)}." if result.hints else ""
    sentences = (doubt, found, hinted, result.static_stability, _stop_reason(result), result.unexplained)
    return " ".join(part for part in sentences if part)


def _stop_reason(result: Trace) -> str:
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
    sentences = [outcome_text(step)]
    if step.look_alikes:
        sentences.insert(0, f"as good a fit on this flight: {', '.join(step.look_alikes)}")
    if step.taken_out:
        sentences.append(f"not needed beside it, and taken out: {', '.join(step.taken_out)}")
    correlated = [
        f"{one.moment} goes with {one.channel}: {number(one.coefficient, 2)} (p {p_value(one.p_value)})"
        for one in step.residual.correlations
    ]
    marked = [i for i, row in enumerate(step.candidates) if row.effect == step.added]
    return [
        Texts((f"residual {residual_text(step.residual)}",), f"Step {step.step}", bullets=False),
        Table(CANDIDATE_HEADINGS, rows, marked=marked, most=SHOWN_AT_FIRST),
        Texts(sentences, bullets=False, strong=step.added is not None),
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
