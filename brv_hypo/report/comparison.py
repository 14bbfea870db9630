"""A comparison as a document: verdict, ranking and overview, then the evidence in sections with charts of each flight.

`comparison_document` is the entrance.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import chain, pairwise

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.comparison.result import Comparison, FlightSummary, RankedHypothesis
from brv_hypo.io.text import hypothesis, probability, share
from brv_hypo.report import motion_charts as charts
from brv_hypo.report import tables
from brv_hypo.report.document import LARGE, Block, Chart, Document, Line, Mark, Panel, Role, Section, Span, Texts
from brv_hypo.report.motion_charts import DAMPING, STATIC, Drawn, Setting, derivative_chart

_OFFSET = ("static-offset", "Static moment at alpha = 0", "C<sub>m0</sub>")  # name, heading and axis
FUNCTIONS = {"C_m0": _OFFSET, "C_malpha": STATIC, "C_mq": DAMPING}
CHANNELS = {
    "measured-rates": {"q": ("q, deg/s", 180.0 / np.pi), "r": ("r, deg/s", 180.0 / np.pi)},
    "measured-forces": {"ay": ("a<sub>y</sub>, m/s²", 1.0), "az": ("a<sub>z</sub>, m/s²", 1.0)},
}
"""By chart and channel, title and scale of an axis."""
ALONE = (
    "Dots: measured less baseline, processes and errors of the record: what is unexplained without it. With processes: "
    "the sum, also outside the shaded time; where these cancel the moment, only the sum is known. Moments are "
    "derivatives of smoothed rates: where the plane of alpha turns fast, some of one component is in the other."
)
JUDGED = "Models as they are judged: each with its own estimated processes and errors of the record."
NEAR = 0.12  # share of the height of C_p's axis, within which dots have one label
EVIDENCE = (
    "F-ratio, C_p: of fits without processes, at knots, delays and noise found beside these; where processes are "
    "needed, C_p is above k, the number of coefficients, though no term is missing. pred. error: mean "
    "square error of moments on blocks held out of the fit; ln evidence: ln of the record's probability density, with "
    "processes. Both over the baseline only's. A + beside terms: the search came to `max_terms` of them; what is split "
    "or added beside processes comes on top. A hypothesis that only takes the place of processes has a large "
    "F-ratio and predicts better than the baseline, but its ln evidence is small, or below zero by its price."
)


def _sizes(comparison: Comparison) -> Chart:
    """Mallows' C_p over the number of coefficients: hypotheses, best subsets of the leader by size, and C_p = k."""
    sized, rows = comparison.best_by_size, [row for row in comparison.ranking if np.isfinite(row.cp)]
    if len(rows) < 2 or not sized:
        return Chart("cp", "", "", ())
    every, least = [*(each.cp for each in sized), *(row.cp for row in rows)], sized[0].n_coefficients
    log, ordered = min(every) >= 1.0, sorted(rows, key=lambda row: (row.n_terms, -row.cp))
    height = np.log10 if log else np.asarray
    groups = [ordered[:1]]  # of one size, whose dots are near each other
    for above, row in pairwise(ordered):
        apart = height(above.cp) - height(row.cp) > NEAR * np.ptp(height(every))
        if above.n_terms != row.n_terms or apart:
            groups.append([])
        groups[-1].append(row)
    k = np.arange(least, max(least + ordered[-1].n_terms, sized[-1].n_coefficients) + 1.0)
    layers = [
        Line(k, k, "guide", "C_p = k", dashed=True),
        Line([each.n_coefficients for each in sized], [each.cp for each in sized], "third", "best of a size"),
    ]
    for some in groups:  # in one label, from top to bottom as their dots are
        counts, labels = [least + row.n_terms for row in some], [""] * len(some)
        labels[len(some) // 2] = "\n".join(hypothesis(row.mechanism) for row in some).replace(" ", "\n")
        heights = [row.cp for row in some]
        layers.append(Line(counts, heights, "first", "hypotheses", dots=True, size=LARGE, labels=labels))
    read = (
        "Mallows' criterion, without processes: above the line terms are missing, or what processes describe. Best of "
        "a size: exact search on the grid of knots and delays. Hypotheses: as judged, with terms split or added, knots "
        "and delays placed beside processes, and above the line for that, too."
    )
    if not log:
        read += " Below zero: a smaller residual than the complete model's, which has the knots of the hypotheses."
    panels, ends = [Panel("C<sub>p</sub>", layers, log=log)], (k[0] - 1.0, k[-1] + 2.0)  # room for labels
    return Chart("cp", "C_p over size", "coefficients, k", panels, caption=read, range=ends, counted=True)


def _own_knots(row: RankedHypothesis, index: int, flight: FlightSummary) -> dict[float, str]:
    """Times inside the record of one flight at which a hypothesis' coefficients change: onset, end, or neither ("")."""
    own = {knot.time_s: knot.flights_s[index] for knot in row.knots}
    acts, found = row.acting, dict[float, str]()
    names = {acts[0].start_s: "onset", acts[-1].stop_s: "end"} if acts else {}
    for each in row.intervals:
        at = own.get(each.start_s) if own else each.start_s
        if at is not None and flight.start_s < at < flight.stop_s:
            found[at] = names.get(each.start_s, "")
    return found


def _setting(comparison: Comparison, index: int, knots: Iterable[float]) -> Setting:
    """What charts over time of one flight share, with the knots of a hypothesis."""
    flight = comparison.flights[index]
    faults = charts.shaded(comparison.record.faults, flight.stop_s - flight.start_s, flight.gaps_s)
    which = (f"-{index + 1}", f", flight {index + 1}") if len(comparison.flights) > 1 else ("", "")
    return Setting((flight.start_s, flight.stop_s), list(knots), faults, *which)


def _of_flight(comparison: Comparison, index: int) -> dict[str, list[Chart]]:
    """Charts of one flight, by what they are of."""
    series, leader = comparison.series[index], comparison.ranking[0]
    knots = _own_knots(leader, index, comparison.flights[index])
    setting = _setting(comparison, index, knots)
    ends = {name: at for at, name in knots.items() if name}
    (start, stop), name = setting.span, f"{leader.mechanism} acts"
    acts = [Span(ends.get("onset", start), ends.get("end", stop), name, "first")] if ends else []
    of_moments = replace(setting, shaded=[*setting.shaded, *acts])
    time, measured, sigma = series.time_s, np.array(series.measured), series.sigma
    # the baseline below, for contrast, and the leader last, on top
    shown = sorted(series.residuals, key=lambda name: (name == leader.mechanism, name != "none"))
    roles: dict[str, Role] = {"none": "none", leader.mechanism: "first"}
    residuals = [Drawn(hypothesis(name), np.array(series.residuals[name]), roles.get(name, "second")) for name in shown]
    models = [replace(each, moments=measured - each.moments) for each in residuals]
    bare = Drawn("no processes", np.array(series.fitted[leader.mechanism]), "guide", hidden=True)
    left = replace(bare, moments=measured - bare.moments)
    without = [left]
    if leader.n_terms and series.alone:
        lacking = residuals[-1].moments + np.array(series.alone[1])
        without.append(Drawn(f"without {leader.mechanism}", lacking, "second", hidden=True))
    moments = [
        charts.moment_chart(of_moments, time, sigma, [*models, bare], measured, caption=JUDGED),
        charts.moment_chart(of_moments, time, sigma, [*residuals, *without], caption=JUDGED),
        charts.moment_by_alpha_chart(setting, series.alpha_rad, measured, models[-1:]),
    ]
    overview = moments[0]
    if series.alone:  # what all else does not explain, and what the mechanism makes of that (5.18)
        best = next(row for row in comparison.ranking if row.n_terms)
        (beyond, made, summed), heading = np.array(series.alone), f"Moments of {hypothesis(best.mechanism)}"
        drawn = [Drawn("with processes", summed, "second"), Drawn(hypothesis(best.mechanism), made, "first")]
        name = "excess-by-alpha"
        by_alpha = charts.moment_by_alpha_chart(setting, series.alpha_rad, beyond, drawn[1:], name, heading)
        moments.append(replace(by_alpha, caption=ALONE))
        if best is leader:
            name, heading = f"overview{setting.suffix}", f"{heading}{setting.which}"
            chart = charts.moment_chart(of_moments, time, sigma, drawn, beyond, dots="measured less all else")
            marks = [Mark(*knot) for knot in knots.items()]
            overview = replace(chart, name=name, heading=heading, caption=ALONE, marks=marks)
    channels = []
    for stem, axes in CHANNELS.items() if series.channels else ():
        panels = []
        for name, (title, scale) in axes.items():
            read, fitted = (scale * np.asarray(each) for each in series.channels[name])
            dots = Line(time, read, "measured", "measured", dots=True)
            panels.append(Panel(title, [dots, Line(time, fitted, "first", hypothesis(leader.mechanism))]))
        text = "At the c.g., fitted errors of the record taken out; the model with its processes."
        channels.append(setting.chart(stem, stem.replace("-", " ").capitalize(), panels, text))
    spectrum = charts.spectrum_chart(setting, series, [Drawn("measured", measured, "measured"), *residuals])
    units, most = [(each.name, each.units) for each in tables.shown_processes(comparison)], tables.ROWS_AT_FIRST
    named = {"processes": "Largest processes over time", "smaller-processes": "Smaller processes over time"}
    return {
        "overview": [overview],
        "processes": [
            charts.process_chart(setting, series.histories, dict(units[k * most : (k + 1) * most]), *each)
            for k, each in enumerate(named.items())
        ],
        "motion": charts.flight_charts(setting, series),
        "moments": [each for each in moments if each is not overview],
        "channels": channels,
        "residual": [*charts.whiteness_charts(setting, series.whitened), spectrum],
    }


def _coefficients(setting: Setting, row: RankedHypothesis) -> Chart:
    panels = []
    known = {(value.mechanism, value.name): value.units for each in row.intervals for value in each.values}
    for term, units in known.items():
        t, y, sigma = _net(row, term, np.nan if units == "rad" else 0.0)
        factor, suffix = charts.scale_of(y)
        title = f"{term[1]}{suffix}{'' if units == '1' else f', {units}'}"
        panels.append(Panel(title, charts.estimate(t, factor * y, factor * sigma, band="± 2 sigma")))
    heading, caption = f"Coefficients of {hypothesis(row.mechanism)}", "Net values; zero where it does not act."
    return setting.chart(f"coefficients-{row.mechanism}", heading, panels, caption)


def _net(row: RankedHypothesis, term: tuple[str, str], nothing: float) -> FloatArray:
    """Times, values and standard errors (3, 2 intervals) of a mechanism's term at both ends of each interval; `nothing`
    where it does not act. A ramp, of which a result has the mean, goes on from the value before, independent of it.
    """
    ramps = [own.region_s for own in row.terms if (own.mechanism, own.name) == (term[0], f"ramp in {term[1]}")]
    steps, value, sigma = list[tuple[float, float, float]](), nothing, 0.0
    for each in row.intervals:
        net = {(own.mechanism, own.name): (own.value, own.std_error) for own in each.values}
        first = last = net.get(term, (nothing, 0.0))
        if any(region is not None and region[0] <= each.start_s < region[1] for region in ramps):
            mean, error = first
            first, last = (value, sigma), (2.0 * mean - value, max(4.0 * error**2 - 3.0 * sigma**2, 0.0) ** 0.5)
        value, sigma = last
        steps += [(each.start_s, *first), (each.stop_s, *last)]
    return np.array(steps).T


def comparison_document(comparison: Comparison) -> Document:
    """Verdict, ranking, overview; then the evidence in sections, those of rejected hypotheses folded."""
    verdict, ranking, count = comparison.verdict, comparison.ranking, len(comparison.flights)
    flights = [_of_flight(comparison, index) for index in range(len(comparison.series))]
    first: Mapping[str, Sequence[Chart]] = flights[0] if flights else defaultdict(list)

    def functions(flight: int) -> list[Chart]:
        known = comparison.functions.items()
        return [derivative_chart(found[flight], count, *FUNCTIONS[name]) for name, found in known]

    further = [(k + 1, [*chain(*flights[k].values()), *functions(k)]) for k in range(1, len(flights))]
    others = [Section(f"Flight {number}", drawn, folded=True) for number, drawn in further]
    terms = comparison.baseline.terms
    errors = tables.error_table(comparison.record_errors, comparison.functions.get("C_malpha", ()))
    known, fits = comparison.record_errors, Texts(_fit_texts(comparison), shown="verbose")
    read = Texts((tables.OF_ERRORS,) if errors.rows else (), bullets=False, shown="verbose")
    joined = (row.mechanism for row in ranking if "+" in row.mechanism and row.mechanism not in verdict.probability)
    idle = [f"{name} is no hypothesis of its own: a part of it does not act." for name in joined]
    beyond = [row for row in ranking if row.impossible and row.prediction_ratio < 1.0]
    only = ": read its ln evidence, which counts possible values alone"
    idle += [f"F-ratio, C_p and pred. error of {row.mechanism} are with {row.impossible}{only}." for row in beyond]
    names = tables.collinear_names(comparison.collinear_groups)
    collinear = (
        tables.term_table("Baseline", terms, collinear=comparison.collinear_groups),
        Texts(names, bullets=False, shown="verbose"),
        Texts(comparison.collinear, tables.PAIRS, shown="page"),
    )
    of_each = [Section(f"Terms of {hypothesis(r.mechanism)}", _of_hypothesis(comparison, r), True) for r in ranking]
    notes = [note for flight in comparison.flights for note in flight.notes]
    notes += [f"setting {name}: {value}" for name, value in comparison.settings.items()]
    shares = tables.process_blocks(comparison)
    if ranking:
        seconds = comparison.seconds
        notes.append(f"{seconds.total:.2f} s in all, {seconds.ml:.2f} s of maximum likelihood")
    return Document(
        title="Mechanisms compared: " + ", ".join(flight.title or flight.path for flight in comparison.flights),
        subtitle=tables.flight_texts(comparison),
        conclusion_title=f"Verdict: {comparison.named()}",
        conclusion=comparison.conclusion(),
        brief=comparison.conclusion().partition("\n")[0] if verdict.winner else "",
        decided=verdict.winner is not None,
        ahead=(
            *first["overview"],
            tables.ranking_table(comparison),
            Texts(idle, bullets=False),
            Texts((EVIDENCE,) if ranking else (), bullets=False, shown="page"),
        ),
        beside=[*tables.estimate_blocks(comparison), *tables.limit_blocks(comparison), *shares],
        blocks=(
            Section("Data quality", [*_quality(comparison), *tables.vehicle_blocks(comparison.flights)]),
            Section("Notes", [Texts(notes, "How the record was read", shown="verbose")], folded=True),
            Section("Air data and motion", first["motion"], folded=True),
            Section("Moments, measured and modelled", first["moments"]),
            Section("Measured channels", first["channels"], folded=True),
            Section("Processes", [*tables.process_texts(comparison), *first["processes"]], folded=True),
            Section("Residual diagnostics", first["residual"]),
            Section("Hypotheses and limits", _compared(comparison)),
            Section("Models by size", [_sizes(comparison), tables.size_table(comparison)], folded=True),
            Section("Errors of instruments and vehicle", [charts.errors_chart(known), errors, read, fits]),
            Section("Coefficients", [*functions(0), *tables.function_blocks(comparison.functions), *collinear], True),
            *others,
            *of_each,
        ),
    )


def _quality(comparison: Comparison) -> list[Block]:
    """Faults of the record, and what limits the result."""
    faults = tables.fault_texts(comparison.record, comparison.verdict.reason)
    own = (*comparison.reconstruction.warnings, *comparison.warnings)  # what was only corrected comes last
    known = (*own, *faults) if comparison.record.sound else (*faults, *own)
    warnings = [text for text in known if text not in comparison.conclusion()]
    none = () if warnings or comparison.record.faults else ("The record shows no fault.",)
    return [Texts(none, bullets=False, shown="page"), tables.gap_table(comparison), tables.warning_texts(warnings)]


def _compared(comparison: Comparison) -> list[Block]:
    """Evidence and prediction with their errors, probabilities, limits, and where criteria disagree."""
    rows = [row for row in comparison.ranking if np.isfinite(row.held_out_gain)]
    held_out, wide = [row.held_out_gain for row in rows], [2.0 * row.held_out_gain_std_error for row in rows]
    places, level = list(range(len(rows))), [row.log_evidence for row in rows]
    gains = Line(held_out, places, "first", "held-out gain, ± 2 sigma", dots=True, size=LARGE, spread=wide)
    evidence = Line(level, places, "second", "ln evidence", dots=True, size=LARGE)
    panels = [Panel("", [gains, evidence], categories=[hypothesis(row.mechanism) for row in rows])] if rows else []
    read = "Held-out gain: in ln probability of each twelfth of the record given the others, beside processes."
    over = Chart("evidence", "Evidence and held-out gain", "nats over the baseline only", panels, caption=read)
    # The likeliest first, of equals as they are ranked.
    chances = comparison.verdict.probability
    order = [*(row.mechanism for row in comparison.ranking if row.mechanism in chances), *chances]
    shares = {hypothesis(name): chances[name] for name in sorted(dict.fromkeys(order), key=lambda name: -chances[name])}
    panels, read = charts.share_bars(shares, probability, {}), "Other: something that is not on the list."
    likely = Chart("probability", "Probability", "probability, %", panels, range=(0.0, 108.0), caption=read)
    smallest = sorted(comparison.verdict.limits, key=lambda limit: np.nan_to_num(limit.share_of_moment_95, nan=np.inf))
    leader, shares = comparison.ranking[0].mechanism if rows else "", dict[str, float]()
    for limit in smallest:
        name = f"{limit.mechanism} (leader)" if limit.mechanism == leader else limit.mechanism
        whole = f"{name}, throughout" if np.isfinite(limit.share_in_part_95) else name
        shares |= {whole: limit.share_of_moment_95, f"{name}, in a part": limit.share_in_part_95}
    roles: dict[str, Role] = {name: "first" if "(leader)" in name else "third" for name in shares}
    panels = charts.share_bars(shares, share, roles)
    named = "limits", "Upper limits", "largest share of the moment's rms, %"
    read = (
        "the most that the leader may make, and that any other could hide beside it; no sign that it is there. What "
        "acts throughout hides in trim and baseline: a long bar says that the record cannot tell, not that it is large."
    )
    limits = Chart(*named, panels, caption=f"At 95 %: {read}")
    return [over, likely, limits, Texts(comparison.disagreements, "Disagreements", shown="verbose")]


def _fit_texts(comparison: Comparison) -> list[str]:
    """What is wrong with fits by maximum likelihood, and notes on hypotheses."""
    fits = ((row.mechanism, row.ml) for row in comparison.ranking if row.ml is not None and row.ml.trouble)
    said = [(name, f"{fit.status}, {fit.iterations} iterations: {fit.message.split(';')[0]}") for name, fit in fits]
    said += [(row.mechanism, note) for row in comparison.ranking for note in row.notes]
    return [f"{hypothesis(name)}: {text}" for name, text in said]


def _of_hypothesis(comparison: Comparison, row: RankedHypothesis) -> list[Block]:
    """Coefficients over time, net values, terms, derived quantities and likelihood fit of one hypothesis."""
    name, fit, place = hypothesis(row.mechanism), row.ml, (comparison.reference_flight or 1) - 1
    leads = row is comparison.ranking[0]  # its knots are on the first screen
    groups = comparison.collinear_groups if leads else ()
    values, changes = f"Net values of {name}", f"{name}: jumps and ramps, to be read together"
    net = [value for each in row.intervals for value in each.values]
    setting = _setting(comparison, place, _own_knots(row, place, comparison.flights[place]))
    blocks: list[Block] = [
        _coefficients(setting, row),
        tables.term_table(values, net, knots=row.knots, collinear=tables.collinear_at(row), derived=row.derived),
        Texts(tables.size_texts(row, leads), bullets=False, shown="verbose"),
        tables.term_table(changes, row.terms, "verbose" if leads else "page", row.knots, collinear=groups),
        *([] if leads else [tables.knot_table(comparison, row)]),
        Texts(tables.derived_texts(row.derived), shown="verbose"),
    ]
    if fit is not None:
        blocks.append(
            tables.term_table(
                f"{name} by maximum likelihood: {fit.status}; a check, not to quote", fit.terms, knots=fit.knots
            )
        )
        trouble = (f"Maximum likelihood, {fit.trouble}: {comparison.quoted}.",) if fit.trouble else ()
        blocks.append(Texts((*tables.derived_texts(fit.derived), *trouble), shown="verbose"))
    return blocks
