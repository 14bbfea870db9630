"""A trace, and a prediction by its model, as documents.

`trace_document` and `prediction_document` are the entrances.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from brv_hypo.comparison.result import beyond_text, within_text
from brv_hypo.inference.derivatives import Derivative, Function
from brv_hypo.io.text import interval, number, p_value, share
from brv_hypo.mechanisms.registry import compared, plugin_files
from brv_hypo.prediction.result import Prediction
from brv_hypo.report import motion_charts as charts
from brv_hypo.report import tables
from brv_hypo.report.document import Band, Bars, Block, Chart, Document, Line, Panel, Section, Table, Texts, thinned
from brv_hypo.report.motion_charts import BODY, DAMPING, STATIC, TIME, Drawn, Setting, derivative_chart, scale_of
from brv_hypo.report.tables import CONTRADICTED, IN_DOUBT, fault_texts, flight_lines, term_table
from brv_hypo.thresholds import NORMAL_95, SPECIFIC
from brv_hypo.tracing.result import Family, Step, Trace, lasting_steps, names_added

TRACED = "Models of trace have no processes; errors of record and vehicle (tolerances: 1 sigma) are fitted with them."

DAMPING_AS_ESTIMATED = (
    "Its values there and their errors (coefficients along the flight: -v, and on the page) hold only for sizes of "
    "processes as estimated."
)
LEAST_FAMILY = 0.005  # of a residual, which is worth a word
SURE, NOT_SURE = (f"{how} above {share(LEAST_FAMILY)}" for how in ("surely", "not surely"))
CANDIDATES_AT_FIRST = 3  # candidates that the terminal shows for each step; all of them with -v and on the page
_STOPPED = {
    "white": "The residual is noise.",
    "nothing significant": "No effect explains more.",
    "nothing improves held-out error": "No further effect lowers the held-out error and explains more than processes.",
    "limit": "",
}
"""Why the loop stopped, where that says something of the flight."""
_ERRORS = (
    "Mean square of the moments on blocks in no fit or choice; sigma: its standard error, from block to block. Errors "
    "of the record, tolerances as 1 sigma, are fitted in every model. scheduled: static slope by Mach number; "
    "constant: a constant slope, for comparison (setting `baseline`)."
)
COEFFICIENTS_AT_FIRST = 16  # coefficients that the terminal shows; all of them with -v and on the page


def _charts(result: Trace) -> dict[str, list[Chart]]:
    """Charts by the section that they are in."""
    kept = result.picture
    if kept is None:
        return {}
    span = (result.flight.start_s, result.flight.stop_s)
    faults = charts.shaded(result.record.faults, span[1] - span[0], result.flight.gaps_s)
    setting = Setting(span, charts.knots_of(result.model.terms, *span), faults)
    measured, before, after = map(np.array, (kept.measured, kept.before, kept.after))
    added = [Drawn("before", before, "second"), Drawn("after", after, "first")]
    residuals = added if result.added else [Drawn("residual", after, "first")]
    model = Drawn("model", measured - after, "first")
    return {
        "Air data and motion": charts.flight_charts(setting, kept),
        "Moments, measured and modelled": [
            charts.moment_chart(setting, kept.time_s, kept.sigma, [model], measured, BODY, TRACED),
            charts.moment_chart(setting, kept.time_s, kept.sigma, residuals, None, BODY, TRACED),
        ],
        "Residual diagnostics": [
            *charts.whiteness_charts(setting, kept.whitened),
            charts.spectrum_chart(setting, kept, [Drawn("measured", measured, "measured"), *residuals]),
        ],
        "Static slope and damping": [
            derivative_chart(each, len(some), *named)
            for some, named in ((result.static_slopes, STATIC), (result.damping, DAMPING))
            for each in some
        ],
    }


def families_chart(step: Step) -> Chart:
    """The share of a step's residual that each family explains, grey if not surely above nothing, and the rest."""
    layers = []
    for each in step.decomposition:
        sure, size, (low, high) = is_sure(each), 100.0 * each.share, (100.0 * end for end in each.interval_95)
        bar = Bars([f"{each.family} {share(each.share)}"], [size], error=([size - low], [high - size]))
        layers.append(replace(bar, role="second", name=SURE) if sure else replace(bar, role="none", name=NOT_SURE))
    rest = max(1.0 - sum(each.share for each in step.decomposition), 0.0)
    layers += [Bars([f"noise, lack of fit {share(rest)}"], [100.0 * rest], role="measured")] if layers else []
    read = "first by effects that were added, then by processes (95 % intervals)."
    read = f"Share of the mean square that the first model does not explain, largest first: {read}"
    named = ("families", "What holds the residual, by family", "of the residual, %")
    return Chart(*named, [Panel("", layers)] if layers else [], caption=read)


def is_sure(family: Family) -> bool:
    """Whether a family explains more of a residual than is worth a word, by its interval."""
    return family.interval_95[0] > LEAST_FAMILY


def families_text(step: Step) -> str:
    """The families that hold some of a step's residual, with their intervals and the largest process of each."""
    said = []
    for each in filter(is_sure, step.decomposition):
        whole, low, high = (share(value) for value in (each.share, *each.interval_95))
        beside = [] if low == high == whole else [f"{low.removesuffix(' %')} to {high}"]
        beside += [f"with {', '.join(each.effects)}"] if each.effects else []
        beside += [] if each.process is None else [f"mostly {each.process}"]
        said.append(f"{each.family} {whole}" + (f" ({', '.join(beside)})" if beside else ""))
    return ", ".join(said)


def trace_document(result: Trace) -> Document:
    """The steps, the model, and the residual that stays unexplained."""
    name = ", ".join(flight.title or str(flight.path) for flight in result.flights)
    sound, found, given = result.record.sound, ", ".join(result.findings), ", ".join(result.given)
    most = next((each.family for each in result.steps[0].decomposition if each.interval_95[0] > 0.5), None)
    collinear = tables.collinear_texts("C_mq", result.damping)
    flown = [value for slope in result.static_slopes for value in slope.at_flown]
    ends = dict.fromkeys(number(end, 2) for end in (min(flown), max(flown))) if flown else ()
    stable = f"The static moment is stable: C_malpha {' to '.join(ends)} per rad at the angles flown." if ends else ""
    conclusion = (
        "" if sound else CONTRADICTED,
        _found_text(result),
        f"Hints, no findings: {result.hints_in_words}. {next_step(result)}" if result.hints else "",
        "" if result.added else next_data(result.steps[0]),
        result.static_stability or stable,
        result.dynamic_stability,
        " ".join((*(text.removeprefix(f"{tables.COLLINEAR_MARK} ") for text in collinear), DAMPING_AS_ESTIMATED))
        if collinear
        else "",
        _STOPPED[result.stopped],
        result.unexplained,
        beyond_text(result.record_errors, "the final model"),
        within_text(result.record_errors),
    )
    names, nothing = [each.model for each in result.account], f"nothing beside {given}" if given else "nothing"
    account = [
        {
            "model": each.model + (f", part {names[:k].count(each.model) + 1}" if names.count(each.model) > 1 else ""),
            "held out": number(each.held_out),
            "sigma": number(each.std_error, 2),
        }
        for k, each in enumerate(result.account)
    ]
    account.append({"model": "noise alone", "held out": number(result.noise), "sigma": ""})
    errors = Table(account, "Held-out error of one model after another", ("model",))
    functions: dict[Function, tuple[Derivative, ...]] = {"C_malpha": result.static_slopes, "C_mq": result.damping}
    errors_of_record, known = result.record_errors, result.reconstruction
    instruments = charts.errors_chart(errors_of_record), tables.error_table(errors_of_record, result.static_slopes)
    related = (tables.NAME_AND_FAMILY,) if any(each.model == "scheduled" for each in result.account) else ()
    model: list[Block] = [
        term_table("Model, fitted to the whole record", result.model.terms, collinear=result.collinear_groups),
        Texts(tables.collinear_names(result.collinear_groups), bullets=False, shown="verbose"),
        Texts(result.collinear, tables.PAIRS, shown="page"),
    ]
    own = [term for term in result.model.terms if term.mechanism in result.findings]
    heading = "What was found, beside all that was added; sigma includes processes (quote compare --mechanisms NAME)"
    groups = [group for group in result.collinear_groups if any(term.begins in group for term in own)]
    estimates = term_table(heading, own, "always", most=tables.ROWS_AT_FIRST, collinear=groups)
    limits = (*result.caveats, *(() if known is None else known.warnings))
    faults = fault_texts(result.record)
    warnings = (*limits, *faults) if sound else (*faults, *limits)  # what was only corrected comes last
    has = [(*result.given, *names_added(result.steps[:k])) for k in range(len(result.steps))]
    steps = [b for step, own in zip(result.steps, has, strict=True) for b in _step(step, own)]
    sections = [
        Section("Data quality", [tables.warning_texts(warnings), *tables.vehicle_blocks(result.flights)]),
        *(Section(name, some, name.startswith("Air")) for name, some in _charts(result).items()),
        Section("Coefficients along the flight", tables.function_blocks(functions), folded=True),
        Section("Errors of instruments and vehicle", instruments),
        Section("Steps", steps),
        Section("Model", model, folded=True),
    ]
    return Document(
        title=f"Residual traced: {name}",
        subtitle=[*flight_lines(result.flights), *([tables.motion_known(known, "the final model")] if known else [])],
        conclusion_title=f"Found: {found or (f'no name, family {most}' if most else nothing)}" if sound else IN_DOUBT,
        conclusion="\n".join(filter(None, conclusion)),
        decided=sound and (bool(found) or result.unexplained is None),
        blocks=sections,
        beside=(
            estimates,
            Texts(tables.collinear_names(groups), bullets=False),
            errors,
            Texts((_ERRORS,), bullets=False, shown="verbose"),
            families_chart(result.steps[0]),
            Texts(related, bullets=False),
        ),
    )


def _found_text(result: Trace) -> str:
    """What was found, and what of the error is left; without a name, which families hold the first model's residual."""
    if result.findings:
        ratios = dict.fromkeys(result.findings, 1.0)  # to a model with none of it, also of what has a tolerance
        for step in lasting_steps(result.steps):
            if step.added in ratios:
                ratios[step.added] *= step.error_ratio_held_out or 1.0
        shares = ((name, share(ratio)) for name, ratio in ratios.items())
        return " ".join(f"With {name}, the held-out error is {part} of what it is without." for name, part in shares)
    families = "" if result.steps[0].residual.white else families_text(result.steps[0])
    explained = f"; families of processes explain the residual: {families}" if families else ""
    beside = f" beside {', '.join(result.given)} of the model given" if result.given else ""
    return f"No effect with a name was found{beside}{explained}."


def next_step(result: Trace) -> str:
    """How to go on from hints: against their rivals on this flight, and on another flight."""
    kinds = {each.effect: each.kind for step in result.steps for each in step.candidates}
    named, usual = [name for name in result.hints if kinds.get(name) == "mechanism"], compared([])
    rivals = [*usual, *(name for name in named if name not in usual)] if set(named) - set(usual) else []
    plugins = "".join(f" --plugin {file}" for file in plugin_files())
    described = any(kinds.get(name) == "discovered" for name in result.hints)
    written = ", with what --write-mechanism FILE.yaml writes here," if described else ""
    options = f" --mechanisms {','.join(rivals)}" if rivals else ""
    options += f"{plugins} --plugin FILE.yaml" if described else plugins
    weighed = f"`brv-hypo compare FLIGHT.h5{options}`{written} weighs it against its rivals; "
    first = weighed if named or described else ""
    return (
        f"To go on: {first}`brv-hypo predict OTHER.h5 --model MODEL.yaml{plugins}`, with what --write-model MODEL.yaml "
        "writes here, which has hints too (as --json), tells whether it holds on another flight."
    )


_DATA = {  # what identifies a family's cause
    "stiffness": "a table (--aero); an error of the air's density changes axial force over dynamic pressure as much",
    "rate": "a table or test of the damping, or a flight at other amplitudes",
    "side": "a flight at another roll rate: a side moment of the roll rate changes with it",
    "body": "its c.g. and principal axes as measured; or rates where no air acts: there a drift of the gyros shows",
    "harmonic": "both transverse inertias as measured, and the shape about the axis",
    "air": "winds and densities from another source; axial force over dynamic pressure, which density changes",
    "gyros": "rates where no air acts, and the gyros as calibrated",
    "accelerometers": "their place and bias as measured",
    "data quality": "clocks and inertias as measured",
}


def next_data(step: Step) -> str:
    """How to go on where nothing was added: the family that explains most, and what would identify its cause."""
    first = next(filter(is_sure, step.decomposition), None)
    return "" if step.residual.white or first is None else f"To go on: {first.family} first, by {_DATA[first.family]}."


def _step(step: Step, has: Sequence[str]) -> list[Block]:
    ordered = sorted(step.candidates, key=lambda row: -row.f_ratio)
    candidates = [
        {
            "effect": row.effect,
            "kind": row.kind,
            "F-ratio": number(row.f_ratio),
            "adj. p-value": p_value(row.p_value_adjusted),
            "explains": share(row.explains),
            "confounded with": ", ".join(row.near_equals) or "none",
        }
        for row in ordered
    ]
    extremes = next((f"{each.extremes}." for each in filter(is_sure, step.decomposition) if each.extremes), "")
    doubtful = [each for each in step.decomposition if not is_sure(each)]
    small = [each.family + (f" {share(each.share)}" if each.share > LEAST_FAMILY else "") for each in doubtful]
    families = families_text(step) and families_text(step) + (f"; {NOT_SURE}: {', '.join(small)}" if small else "")
    known = sorted(step.decomposition, key=lambda each: -each.evidence)
    gains = [f"{each.family} {each.evidence:.0f} nats" for each in known if each.evidence > SPECIFIC]
    words = [f"{row.effect}: {row.description}." for row in ordered if row.kind == "discovered" and row.description]
    done = step.residual.white and step.added is None  # what was tried is of no interest then
    sentences = (
        f"By family, largest share first: {families}." if families else "",
        f"Evidence of each beside all others, largest first: {', '.join(gains)}." if gains else "",
        outcome_text(step, has),
        f"removed, as the model no longer needs it: {', '.join(step.removed)}" if step.removed else "",
    )
    marked = [i for i, row in enumerate(ordered) if row.effect == step.added]
    columns, by = ("effect", "kind", "confounded with"), "Tried, by F-ratio; evidence decides (•: added)"
    later = done or step.step > 1  # a screen of a terminal has room for one table
    return [
        Texts((f"residual {step.residual.words}",), f"Step {step.step}", bullets=False),
        Table(candidates, by, columns, marked, most=CANDIDATES_AT_FIRST, shown="verbose" if later else "always"),
        Texts(words, bullets=False, shown="verbose" if later else "always"),
        Texts([extremes[:1].upper() + extremes[1:]] if extremes else [], bullets=False, shown="verbose"),
        Texts([*filter(None, sentences)], bullets=False, strong=step.added is not None),
    ]


def outcome_text(step: Step, has: Sequence[str] = ()) -> str:
    """What was added to a model that `has` some effects, and the errors before and after."""
    before, after = step.error_before, step.error_after
    if step.added is None or after is None:
        # what was significant in the fit, and why it was not added; the last of them where few repetitions name it
        unnamed = step.refused[-1:] if step.named_in == 0.0 else ()
        worse = [name for name in step.refused if name not in (*unnamed, *step.unwanted)]
        reasons = [f"{', '.join(worse)} did not lower the held-out error"] if worse else []
        reasons += [f"processes explain the flight far better than {', '.join(step.unwanted)}"] if step.unwanted else []
        parts = [f"a further part of {name}" if name in has else name for name in unnamed]
        why = "; ".join([*reasons, *(f"few repetitions name {part}" for part in parts)])
        errors = f"error {number(before.fit)} in the fit, {number(before.held_out)} held out"
        return f"added nothing{f' ({why})' if why else ''}; {errors}"
    here = f" (values of this step, not of the final model: {step.description})" if step.description else ""
    what = f"added {step.added}{here}"
    ratio = number(step.error_ratio_held_out)
    if step.error_ratio_held_out is not None and step.error_ratio_std_error is not None:
        ratio += f", at most {number(step.error_ratio_held_out + NORMAL_95 * step.error_ratio_std_error, 2)},"
    text = (
        f"{what}, a {step.status}, which {share(step.named_in)} of the repetitions name: error in the fit "
        f"{number(before.fit)} → {number(after.fit)}, held out {number(before.held_out)} → {number(after.held_out)} "
        f"(ratio {ratio} to a model without any)"
    )
    if step.evidence_gain is not None:
        text += f", {number(step.evidence_gain, 2)} nats more evidence beside processes"
    if step.ratio_of_flights_left_out is not None:
        text += f"; each flight predicted from the others, ratio {number(step.ratio_of_flights_left_out)}"
    if step.doubts:
        text += f". It is a hint since {', and '.join(step.doubts)}"
    return text


def prediction_document(result: Prediction) -> Document:
    """Errors without the model, with it frozen and with it refitted; by region; the coefficients."""
    flight, sound = result.flight, result.record.sound
    found_on = ", ".join(result.model.found_on)
    errors = [
        {"moments less": name, "mean square": number(value), "ratio": _percent(value / result.error.without)}
        for name, value in _errors(result).items()
    ]
    regions = [
        {
            "time, s": interval((region.start_s, region.stop_s)),
            "Mach": "" if region.mach is None else interval(region.mach),
            "ratio": _percent(region.ratio),
        }
        for region in result.regions
    ]
    return Document(
        title=f"Predicted: {flight.title or flight.path}",
        subtitle=[*flight_lines([flight]), *([f"model found on {found_on}"] if found_on else [])],
        conclusion_title=result.outcome if sound else IN_DOUBT,
        conclusion=result.reason if sound else f"{CONTRADICTED} {result.reason}",
        brief=result.brief if sound else "",
        decided=sound and not result.is_contradicted,
        blocks=(
            Table(errors, "Mean square of the moment coefficients, over all samples", ("moments less",)),
            Table(regions, "Error with the frozen model over that without a model, all samples, by interval"),
            band_chart(result),
            term_table("Frozen, as traced", result.frozen, "always", most=COEFFICIENTS_AT_FIRST),
            term_table(
                "Fitted to this flight; sigma: without processes", result.refitted, "always", most=COEFFICIENTS_AT_FIRST
            ),
            tables.warning_texts(fault_texts(result.record)),
            Texts(flight.notes, "Notes", shown="page"),
        ),
    )


def band_chart(result: Prediction) -> Chart:
    """C_m and C_n less the frozen model's, over the band in which it predicts them to be, noise included."""
    band, panels = result.band, []
    time, percent = thinned(band.time_s), f"{100.0 * band.level:.0f} %"
    factor, suffix = scale_of(np.array([band.measured, band.predicted]))
    for name, *histories in zip(BODY, band.measured, band.predicted, band.half_width, strict=True):
        measured, centre, half = (factor * thinned(values) for values in histories)
        interval_drawn = Band(time, -half, half, f"{percent} prediction interval", "first")
        dots = Line(time, measured - centre, "measured", "measured less predicted", dots=True)
        panels.append(charts.framed(Panel(f"{name}{suffix}", [interval_drawn, dots])))
    heading = f"Moments less the prediction ({100.0 * band.inside:.1f} % within its {percent} interval)"
    span = (result.flight.start_s, result.flight.stop_s)
    read = (
        "The interval includes the noise, the errors of the coefficients, and the residual of the model on the flights "
        "that it was found on. The prediction is that of the frozen model, record errors fitted, in the table."
    )
    return Chart("band", heading, TIME, panels, over_time=True, range=span, caption=read)


def _percent(ratio: float) -> str:
    """A share at two digits however small it is: they distinguish a model's errors from the noise's."""
    return f"{number(100.0 * ratio, 2)} %"


def _errors(result: Prediction) -> dict[str, float]:
    error = result.error
    return {
        "nothing": error.without,
        f"the frozen model{result.without}": error.frozen,
        "the frozen model, record errors fitted": error.within,
        "the model fitted here (to rates and forces)": error.own,
        "noise alone": error.noise,
    }
