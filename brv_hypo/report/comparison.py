"""A comparison as a document: ranking, verdict, terms and criteria, and the charts of each flight.

`comparison_document` is the entrance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from brv_hypo.arrays import FloatArray, IntArray
from brv_hypo.io.text import counted, hypothesis, probability
from brv_hypo.ranking.result import CoefficientSeries, Comparison, FlightSummary, RankedHypothesis, Series, SizeSeries
from brv_hypo.report import motion_charts as charts
from brv_hypo.report import tables
from brv_hypo.report.document import Band, Bars, Block, Chart, Document, Line, Panel, Picture, Role, Texts, Values
from brv_hypo.report.motion_charts import PLAIN, Drawn, Scale, Setting, caption, cut_text, framed

LEADING = 2  # hypotheses that are drawn besides the baseline only; more lines than this hide each other
CLOSE = 0.1  # share of the axis within which two dots are so close that their names would hide each other
ROUNDING = 1e-9  # a coefficient that stays below this, its error included, is none of the model's and is not drawn
COEFFICIENTS = {
    "C_N'": "C<sub>m,in</sub>",
    "C_Z'": "C<sub>n,side</sub>",
    "C_N' by alpha": "∂C<sub>m,in</sub>/∂α, 1/rad",
    "C_Z' by alpha": "∂C<sub>n,side</sub>/∂α, 1/rad",
    "C_Nalpha_force": "force C<sub>Nα</sub>, 1/rad",
}
"""By name, the title of a coefficient's axis."""
MOMENTS = ("C_N'", "C_Z'")  # coefficients that may be drawn in thousandths
BY_MACH = ("C_N' by alpha", "C_Nalpha_force")  # coefficients that are drawn over Mach number too


def comparison_charts(comparison: Comparison) -> list[Chart]:
    """Every chart that the comparison has the data for, in the order of a page."""
    verdict = comparison.verdict
    ranked = [row.mechanism for row in comparison.ranking if row.mechanism in verdict.probability]
    chances = {name: verdict.probability[name] for name in (*ranked, *verdict.probability)}
    likeliest = sorted(chances, key=lambda name: -chances[name])  # of equals as they are ranked
    texts = [probability(chances[name]) for name in likeliest]
    names, values = list(map(hypothesis, likeliest)), [chances[name] for name in likeliest]
    over = "Over the hypotheses compared and other: something that is not on the list."
    limits = {limit.mechanism: limit.share_of_moment_95 for limit in verdict.limits}
    title, read = "largest share of the moment's rms, %", "How large each mechanism may be, whatever won."
    drawn = [
        Chart("probability", "Probability", "probability", [Panel("", [Bars(names, values, texts)])] if names else [],
              range=(0.0, 1.08), caption=over),
        Chart("limits", "Limits at 95 %", title, charts.share_bars(limits, "third"), caption=read),
        _sizes(comparison),
    ]  # fmt: skip
    for index, series in enumerate(comparison.series):
        drawn += _of_flight(comparison, index, series)
    return [chart for chart in drawn if chart.panels]


def _families(comparison: Comparison) -> Chart:
    """The share of the static moment's rms of each family's processes, largest first."""
    shares: dict[str, float] = {}
    for each in comparison.verdict.processes:
        shares[each.family] = float(np.hypot(shares.get(each.family, 0.0), each.share_of_moment))
    panels = charts.share_bars(dict(sorted(shares.items(), key=lambda item: -item[1])), "second")
    read = "What a family's processes make of the record: rms (root of the sum of squares) over the static moment's."
    return Chart("families", "Processes by family", "of the static moment, %", panels, caption=read)


def _sizes(comparison: Comparison) -> Chart:
    """Mallows' C_p over the number of terms, counted from the least so that a logarithmic axis holds all."""
    rows = [row for row in comparison.ranking if np.isfinite(row.cp)]
    if len(rows) < 2:
        return Chart("cp", "", "", ())
    lowest = min(row.cp for row in rows)
    terms, spread = [row.n_terms for row in rows], [row.cp - lowest + 1.0 for row in rows]
    labels = _together([hypothesis(row.mechanism) for row in rows], terms, np.log10(spread))
    points = Line(terms, spread, "first", dots=True, large=True, labels=labels)
    return Chart(
        "cp",
        "C_p over size",
        "terms besides the baseline",
        [Panel("C<sub>p</sub> − least + 1", [points], log=True)],
        caption="Mallows' criterion. Far above the least, terms are missing.",
        range=(-0.5, max(terms) + 1.0),  # room for the label of the last
        counted=True,
    )


def _together(names: Sequence[str], columns: Sequence[int], heights: FloatArray) -> list[str]:
    """The names as labels of dots: those of dots in one column that lie close to each other stand in one label, the
    uppermost first, beside the middle one of these dots.
    """
    labels = [""] * len(names)
    close = CLOSE * float(np.ptp(heights))
    groups: list[list[int]] = []
    for i in sorted(range(len(names)), key=lambda i: (columns[i], -heights[i])):
        last = groups[-1][-1] if groups else None
        if last is not None and columns[last] == columns[i] and heights[last] - heights[i] <= close:
            groups[-1].append(i)
        else:
            groups.append([i])
    for group in groups:
        labels[group[len(group) // 2]] = "\n".join(names[i] for i in group)
    return labels


def _own_knots(row: RankedHypothesis | None, index: int, flight: FlightSummary) -> list[float]:
    """Times inside the record of one flight at which a hypothesis' coefficients begin, change or end."""
    if row is None:
        return []
    if not row.knots:
        return charts.knots_of(row.terms, flight.start_s, flight.stop_s)
    own = [knot.flights_s[index] for knot in row.knots]
    return [time for time in own if time is not None and flight.start_s < time < flight.stop_s]


def _of_flight(comparison: Comparison, index: int, series: Series) -> list[Chart]:
    flight, rows = comparison.flights[index], {row.mechanism: row for row in comparison.ranking}
    several = len(comparison.flights) > 1
    setting = Setting(
        (flight.start_s, flight.stop_s),
        _own_knots(next((row for name, row in rows.items() if name != "none"), None), index, flight),
        charts.masked(comparison.record.faults, flight.stop_s - flight.start_s),
        f"-{index + 1}" if several else "",
        f": {flight.title or flight.path}" if several else "",
    )
    time, measured, sigma = series.time_s, series.measured, series.sigma
    angles = (series.alpha_rad, series.windward_meridian_rad)
    # the baseline below, for contrast, and the leader last, on top
    first = [row.mechanism for row in comparison.ranking if row.mechanism != "none"][:LEADING]
    roles: tuple[Role, ...] = ("first", "second")
    leading: list[tuple[str, Role]] = [("none", "none"), *reversed(list(zip(first, roles, strict=False)))]
    fitted = {name: series.fitted[name] for name, _ in leading if name in series.fitted}
    models = [Drawn(hypothesis(name), fitted[name], role) for name, role in leading if name in fitted]
    residuals = [replace(m, moments=charts.difference(measured, m.moments)) for m in models]
    drawn = [
        charts.moment_chart(setting, time, measured, sigma, models),
        charts.residual_chart(setting, time, sigma, residuals),
        charts.motion_chart(setting, time, *angles, series.alpha_sigma_rad, series.windward_meridian_sigma_rad),
        charts.moment_by_alpha_chart(setting, series.alpha_rad, measured, models[-1:]),
    ]
    if "none" in fitted and len(fitted) > 1:  # what the leader makes of the baseline's residual (Figure 5.18)
        beyond = replace(models[-1], moments=charts.difference(models[-1].moments, fitted["none"]))
        residual = charts.difference(measured, fitted["none"])
        heading = "Moments less the baseline"
        drawn.append(charts.moment_by_alpha_chart(setting, angles[0], residual, [beyond], "excess-by-alpha", heading))
    if series.roll_rate_rad_s:
        drawn.append(charts.attitude_chart(setting, time, *angles, series.roll_rate_rad_s))
    drawn += _by_size(setting, [s for s in comparison.sizes if s.flight == index])
    histories = [Drawn("measured", measured, "measured"), *(replace(m, name=f"less {m.name}") for m in residuals)]
    rates = charts.turning_rates(series.roll_rate_rad_s, series.windward_meridian_rate_rad_s)
    drawn.append(charts.spectrum_chart(setting, time, histories, rates))
    for name, _ in reversed(leading):
        own = [s for s in comparison.coefficients if (s.flight, s.mechanism) == (index, name)]
        knots = _own_knots(rows.get(name), index, flight)
        drawn += _coefficients(replace(setting, knots=knots), own, series)
    return drawn


def _by_size(setting: Setting, series: Sequence[SizeSeries]) -> list[Chart]:
    """The in-plane moment at no angle of attack and its slope, by the number of terms (Figures 5.12 to 5.15)."""
    if len(series) < 2:
        return []
    roles: tuple[Role, ...] = ("none", "third", "second", "first")  # the fewest terms below
    scale = charts.scale_of(*(each.at_zero for each in series))
    at_zero: list[Line] = []
    slopes: list[Line] = []
    for each, role in zip(series, roles, strict=False):
        name = counted(each.n_terms, "term") + (", chosen" if each.chosen else "")
        shown: Role = "first" if each.chosen else role
        at_zero.append(Line(each.time_s, scale.drawn(each.at_zero), shown, name))
        slopes.append(Line(each.time_s, each.slope, shown, name))
    titles = (f"C<sub>m0</sub>{scale.suffix}", COEFFICIENTS["C_N' by alpha"])
    panels = [framed(Panel(title, layers)) for title, layers in zip(titles, (at_zero, slopes), strict=True)]
    heading = f"In-plane moment of {series[-1].mechanism} by its terms"
    read = "Above: at no angle of attack. Where two sizes differ by much, do not rely on the smaller."
    return [setting.chart("coefficients-by-size", heading, panels, read, cut_text(panels))]


def _coefficients(setting: Setting, series: Sequence[CoefficientSeries], motion: Series) -> list[Chart]:
    """Coefficients and derivatives of one hypothesis over time and over Mach number; nothing where it has none."""
    shown = [s for s in series if max(map(abs, s.value)) > ROUNDING or max(s.std_error) > ROUNDING]
    if not shown:
        return []
    scale = charts.scale_of(*(s.value for s in shown if s.name in MOMENTS))
    panels = []
    for name in dict.fromkeys(s.name for s in shown):
        own = scale if name in MOMENTS else PLAIN
        layers = [layer for s in shown if s.name == name for layer in _estimate(s, s.time_s, own)]
        panels.append(framed(Panel(f"{COEFFICIENTS.get(name, name)}{own.suffix}", layers)))
    heading = f"Coefficients of {hypothesis(shown[0].mechanism)}"
    bands, stem, by = "Bands: two standard deviations.", shown[0].mechanism, shown[0].method
    drawn = [setting.chart(f"coefficients-{stem}", f"{heading} by {by}", panels, bands, cut_text(panels))]
    by_mach = [s for s in shown if s.name in BY_MACH]
    if by_mach and len(motion.mach) and np.all(np.isfinite(motion.mach)) and np.ptp(motion.mach) > 0.0:
        panels = []
        for name in dict.fromkeys(s.name for s in by_mach):
            layers = []
            for s in (s for s in by_mach if s.name == name):
                mach = np.interp(s.time_s, motion.time_s, motion.mach)
                order = np.argsort(mach, kind="stable")
                layers += _estimate(s, mach[order], PLAIN, order)
            panels.append(framed(Panel(COEFFICIENTS[name], layers)))
        file, title = f"coefficients-by-mach-{stem}{setting.suffix}", f"{heading} by Mach number{setting.which}"
        drawn.append(Chart(file, title, "Mach number", panels, caption=caption(bands, cut_text(panels))))
    return drawn


def _estimate(
    series: CoefficientSeries, x: Values, scale: Scale, order: IntArray | slice = slice(None)
) -> list[Band | Line]:
    value, sigma = scale.drawn(series.value)[order], scale.drawn(series.std_error)[order]
    return charts.estimate(x, value, sigma, band="± 2 sigma")


# ---- A comparison as a document ----


def comparison_document(comparison: Comparison) -> Document:
    """Ranking, verdict and warnings; in detail every term, criterion and note; on a page the charts."""
    verdict, seconds = comparison.verdict, comparison.seconds
    faults = tables.fault_texts(comparison.record, verdict.reason)
    warnings = (*faults, *comparison.reconstruction.warnings, *comparison.warnings)
    notes = [note for flight in comparison.flights for note in flight.notes]
    notes += [f"{hypothesis(row.mechanism)}: {note}" for row in comparison.ranking for note in row.notes]
    took = (
        f"{seconds.total:.2f} s in all: reconstruction {seconds.reconstruct:.2f}, selection "
        f"{seconds.select:.2f}, maximum likelihood {seconds.ml:.2f}"
    )
    evidence = "ln evidence: ln of the record's probability density, processes included, over the baseline only's."
    withheld = any(np.isnan(limit.share_of_moment_95) for limit in verdict.limits)
    no_limits = ("Withheld: no hypothesis that was compared is adequate.",) if withheld else ()
    return Document(
        title="Mechanisms compared: " + ", ".join(flight.title or flight.path for flight in comparison.flights),
        subtitle=tables.flight_texts(comparison),
        conclusion_title=f"Verdict: {hypothesis(verdict.winner or verdict.outcome)}",
        conclusion=comparison.conclusion(),
        decided=verdict.winner is not None,
        blocks=(
            tables.ranking_table(comparison),
            Texts((evidence,), bullets=False, shown="page"),
            Texts(comparison.disagreements, "Disagreements"),
            Texts(warnings, "Warnings", warning=True),
            Texts(no_limits, "Limits at 95 %", bullets=False, shown="page"),
            *(Picture(chart) for chart in comparison_charts(comparison)),
            tables.term_table("baseline, as fitted with the most probable hypothesis", comparison.baseline.terms),
            *(block for row in comparison.ranking for block in _of_hypothesis(row)),
            tables.criteria_table(comparison),
            Texts(notes, "Notes", shown="verbose"),
            Texts((took,), bullets=False, shown="verbose"),
        ),
        beside=(*tables.process_blocks(comparison), Picture(_families(comparison))),
    )


def _of_hypothesis(row: RankedHypothesis) -> list[Block]:
    """Terms, derived quantities and likelihood fit of one hypothesis."""
    name, fit = hypothesis(row.mechanism), row.ml
    blocks: list[Block] = [
        tables.term_table(name, row.terms, knots=row.knots),
        Texts(tables.knot_texts(row.knots), shown="verbose"),
        Texts(tables.derived_texts(row.derived), shown="verbose"),
    ]
    if fit is not None:
        ended = f"{name} by maximum likelihood: {fit.status}, {fit.iterations} iterations"
        blocks += [
            tables.term_table(ended, fit.terms, knots=fit.knots),
            Texts((*tables.derived_texts(fit.derived), *filter(None, (fit.message,))), shown="verbose"),
            tables.term_table(f"{ended}: errors of the record", fit.instrument),
        ]
    return blocks
