"""A comparison as a document: ranking, verdict, terms and criteria, and the charts of each flight.

`comparison_charts` draws probabilities, limits and C_p, then for each flight the moments with the leading
hypotheses, residuals, motion, spectra and coefficients over time and Mach number. `comparison_document` is
the entrance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from brv_hypo.arrays import FloatArray, IntArray
from brv_hypo.ranking.result import (
    CoefficientSeries,
    Comparison,
    FlightSummary,
    Knot,
    MaximumLikelihood,
    RankedHypothesis,
    Series,
    SizeSeries,
    TermEstimate,
)
from brv_hypo.report import tables
from brv_hypo.report.document import (
    Band,
    Bars,
    Block,
    Chart,
    Document,
    Layer,
    Line,
    Panel,
    Picture,
    Role,
    Shown,
    Table,
    Texts,
    Values,
)
from brv_hypo.report.motion_charts import (
    PLAIN,
    Drawn,
    Moments,
    Scale,
    Setting,
    attitude_chart,
    caption,
    cut_text,
    difference,
    framed,
    knots_of,
    masked,
    moment_by_alpha_chart,
    moment_chart,
    motion_chart,
    residual_chart,
    scale_of,
    spectrum_chart,
    turning_rates,
)
from brv_hypo.report.style import probability, share

# ---- The charts of a comparison ----


LEADING = 2
"""Hypotheses that are drawn besides `none`; more lines than this hide each other."""
CLOSE = 0.1
"""Share of the axis within which two dots are so close that their names would hide each other."""
ROUNDING = 1e-9
"""A coefficient that stays below this, its error included, is none of the model's and is not drawn."""
_ROLES: tuple[Role, ...] = ("first", "second")
COEFFICIENTS = {
    "C_N'": "C<sub>N</sub>′",
    "C_Z'": "C<sub>Z</sub>′",
    "C_N' by alpha": "∂C<sub>N</sub>′/∂α, 1/rad",
    "C_Z' by alpha": "∂C<sub>Z</sub>′/∂α, 1/rad",
    "C_Nalpha_force": "force C<sub>Nα</sub>, 1/rad",
}
"""By name, the title of a coefficient's axis."""
MOMENTS = ("C_N'", "C_Z'")
"""Coefficients that may be drawn in thousandths."""
BY_MACH = ("C_N' by alpha", "C_Nalpha_force")
"""Coefficients that are drawn over Mach number too."""


def comparison_charts(comparison: Comparison) -> list[Chart]:
    """Every chart that the comparison has the data for, in the order of a page."""
    charts = [_probabilities(comparison), _limits(comparison), _sizes(comparison)]
    for index, series in enumerate(comparison.series):
        charts += _of_flight(comparison, index, series)
    return [chart for chart in charts if chart.panels]


def leading(comparison: Comparison) -> list[tuple[str, Role]]:
    """The hypotheses to draw with their roles: `none` below, for contrast, and the leader last, on top."""
    first = [row.mechanism for row in comparison.ranking if row.mechanism != "none"][:LEADING]
    return [("none", "none"), *reversed(list(zip(first, _ROLES, strict=False)))]


def _probabilities(comparison: Comparison) -> Chart:
    chances = comparison.verdict.probability
    ranked = [row.mechanism for row in comparison.ranking if row.mechanism in chances]
    names = dict.fromkeys([*ranked, *chances])  # of equal ones the better ranked first
    known = sorted(((name, chances[name]) for name in names), key=lambda item: -item[1])
    bars = Bars([name for name, _ in known], [value for _, value in known], [probability(v) for _, v in known])
    panels = [Panel("", [bars])] if known else []
    read = "Over the hypotheses compared and other: something that is not on the list."
    return Chart("probability", "Probability", "probability", panels, range=(0.0, 1.08), caption=read)


def _limits(comparison: Comparison) -> Chart:
    known = comparison.verdict.limits
    shares = [100.0 * limit.share_of_moment_95 for limit in known]
    bars = Bars([limit.mechanism for limit in known], shares, [share(value / 100.0) for value in shares], "third")
    return Chart(
        "limits",
        "Limits at 95 %",
        "largest share of the moment's rms, %",
        [Panel("", [bars])] if known else [],
        caption="How large each mechanism may be, whatever won.",
    )


def _sizes(comparison: Comparison) -> Chart:
    """Mallows' C_p over the number of terms, counted from the least so that a logarithmic axis holds all."""
    rows = [row for row in comparison.ranking if np.isfinite(row.cp)]
    if len(rows) < 2:
        return Chart("cp", "", "", ())
    most = max(row.n_terms for row in rows)
    lowest = min(row.cp for row in rows)
    terms, spread = [row.n_terms for row in rows], [row.cp - lowest + 1.0 for row in rows]
    labels = _together([row.mechanism for row in rows], terms, np.log10(spread))
    points = Line(terms, spread, "first", dots=True, large=True, labels=labels)
    return Chart(
        "cp",
        "C_p over size",
        "terms besides the baseline",
        [Panel("C<sub>p</sub> − least + 1", [points], log=True)],
        caption="Mallows' criterion. Far above the least, terms are missing.",
        range=(-0.5, most + 1.0),  # room for the label of the last
        counted=True,
    )


def _together(names: Sequence[str], columns: Sequence[int], heights: FloatArray) -> list[str]:
    """The names as labels of dots: those of dots in one column that lie close to each other stand in one label, the
    uppermost first, beside the middle one of these dots.
    """
    labels = [""] * len(names)
    close = CLOSE * float(np.ptp(heights))
    downwards = sorted(range(len(names)), key=lambda i: (columns[i], -heights[i]))
    groups: list[list[int]] = []
    for i in downwards:
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
        return knots_of(row.terms, flight.start_s, flight.stop_s)
    own = [knot.flights_s[index] for knot in row.knots]
    return [time for time in own if time is not None and flight.start_s < time < flight.stop_s]


def _of_flight(comparison: Comparison, index: int, series: Series) -> list[Chart]:
    flight = comparison.flights[index]
    several = len(comparison.flights) > 1
    leader = next((row for row in comparison.ranking if row.mechanism != "none"), None)
    setting = Setting(
        (flight.start_s, flight.stop_s),
        _own_knots(leader, index, flight),
        masked(comparison.record.faults, flight.stop_s - flight.start_s),
        f"-{index + 1}" if several else "",
        f": {flight.title or flight.path}" if several else "",
    )
    time, measured, sigma = series.time_s, series.measured, series.sigma
    models = [Drawn(name, series.fitted[name], role) for name, role in leading(comparison) if name in series.fitted]
    left = [Drawn(m.name, difference(measured, m.moments), m.role) for m in models]
    charts = [
        moment_chart(setting, time, measured, sigma, models),
        residual_chart(setting, time, sigma, left),
        motion_chart(
            setting,
            time,
            series.alpha_rad,
            series.windward_meridian_rad,
            series.alpha_sigma_rad,
            series.windward_meridian_sigma_rad,
        ),
        moment_by_alpha_chart(setting, series.alpha_rad, measured, models[-1:]),
        *_excess(setting, series, models),
    ]
    if series.roll_rate_rad_s:
        angles = (series.alpha_rad, series.windward_meridian_rad)
        charts.append(attitude_chart(setting, time, *angles, series.roll_rate_rad_s))
    charts += _by_size(setting, [s for s in comparison.sizes if s.flight == index])
    histories: dict[str, tuple[Moments, Role]] = {"measured": (measured, "measured")}
    histories |= {f"less {m.name}": (m.moments, m.role) for m in left}
    rates = turning_rates(series.roll_rate_rad_s, series.windward_meridian_rate_rad_s)
    charts.append(spectrum_chart(setting, time, histories, rates))
    for name, _ in reversed(leading(comparison)):
        own = [s for s in comparison.coefficients if (s.flight, s.mechanism) == (index, name)]
        row = next((row for row in comparison.ranking if row.mechanism == name), None)
        charts += _coefficients(replace(setting, knots=_own_knots(row, index, flight)), own, series)
    return charts


def _excess(setting: Setting, series: Series, models: Sequence[Drawn]) -> list[Chart]:
    """What the baseline leaves over the angle of attack, with what the leader makes of it (Figure 5.18)."""
    static = series.fitted.get("none")
    if static is None or models[-1].name == "none":
        return []
    leader = models[-1]
    beyond = Drawn(leader.name, difference(leader.moments, static), leader.role)
    left = difference(series.measured, static)
    return [
        moment_by_alpha_chart(
            setting, series.alpha_rad, left, [beyond], "excess-by-alpha", "Moments less the baseline"
        )
    ]


def _by_size(setting: Setting, series: Sequence[SizeSeries]) -> list[Chart]:
    """The in-plane moment at no angle of attack and its slope, by the number of terms (Figures 5.12 to 5.15)."""
    if len(series) < 2:
        return []
    roles: tuple[Role, ...] = ("none", "third", "second")  # the fewest terms below
    scale = scale_of(*(each.at_zero for each in series))
    at_zero: list[Layer] = []
    slopes: list[Layer] = []
    for each, role in zip(series, (*roles, "first"), strict=False):
        name = f"{each.n_terms} term{'' if each.n_terms == 1 else 's'}" + (", chosen" if each.chosen else "")
        shown: Role = "first" if each.chosen else role
        at_zero.append(Line(each.time_s, scale.drawn(each.at_zero), shown, name))
        slopes.append(Line(each.time_s, each.slope, shown, name))
    titles = (f"C<sub>m0</sub>{scale.suffix}", COEFFICIENTS["C_N' by alpha"])
    panels = [framed(Panel(title, layers)) for title, layers in zip(titles, (at_zero, slopes), strict=True)]
    heading = f"In-plane moment of {series[-1].mechanism} by its terms"
    read = "Above: at no angle of attack. Where two sizes differ by much, do not rely on the smaller."
    return [setting.chart("coefficients-by-size", heading, panels, caption(read, cut_text(panels)))]


def _coefficients(setting: Setting, series: Sequence[CoefficientSeries], motion: Series) -> list[Chart]:
    """Coefficients and derivatives of one hypothesis over time and over Mach number; nothing where it has none."""
    shown = [s for s in series if max(map(abs, s.value)) > ROUNDING or max(s.std_error) > ROUNDING]
    if not shown:
        return []
    name, method = shown[0].mechanism, shown[0].method
    scale = scale_of(*(s.value for s in shown if s.name in MOMENTS))
    panels = [
        framed(
            Panel(
                f"{COEFFICIENTS.get(each, each)}{own.suffix}",
                [layer for s in shown if s.name == each for layer in _estimate(s, s.time_s, own)],
            )
        )
        for each in dict.fromkeys(s.name for s in shown)
        for own in (scale if each in MOMENTS else PLAIN,)
    ]
    heading = f"Coefficients of {name} by {method}"
    knots = "Dashed lines: its knots." if setting.knots else ""
    read = caption("Bands: two standard deviations.", knots, cut_text(panels))
    charts = [setting.chart(f"coefficients-{name}", heading, panels, read)]
    by_mach = [s for s in shown if s.name in BY_MACH]
    if by_mach and len(motion.mach) and np.all(np.isfinite(motion.mach)) and np.ptp(motion.mach) > 0.0:
        charts.append(_by_mach(setting, by_mach, motion))
    return charts


def _by_mach(setting: Setting, series: Sequence[CoefficientSeries], motion: Series) -> Chart:
    panels = []
    for name in dict.fromkeys(s.name for s in series):
        layers: list[Layer] = []
        for s in series:
            if s.name == name:
                mach = np.interp(s.time_s, motion.time_s, motion.mach)
                order = np.argsort(mach, kind="stable")
                layers += _estimate(s, mach[order], PLAIN, order)
        panels.append(framed(Panel(COEFFICIENTS[name], layers)))
    return Chart(
        f"coefficients-by-mach-{series[0].mechanism}{setting.suffix}",
        f"Coefficients of {series[0].mechanism} by Mach number{setting.which}",
        "Mach number",
        panels,
        caption=caption("Bands: two standard deviations.", cut_text(panels)),
    )


def _estimate(
    series: CoefficientSeries, x: Values, scale: Scale, order: IntArray | slice = slice(None)
) -> list[Layer]:
    """The estimate within two standard deviations."""
    value, wide = scale.drawn(series.value)[order], 2.0 * scale.drawn(series.std_error)[order]
    return [Band(x, value - wide, value + wide, role="first"), Line(x, value, "first", "estimate")]


# ---- A comparison as a document ----


def comparison_document(comparison: Comparison) -> Document:
    """Ranking, verdict and warnings; in detail every term, criterion and note; on a page the charts."""
    verdict = comparison.verdict
    ranking = Table(
        tables.RANKING_HEADINGS, tables.ranking_rows(comparison), marked=tables.credible_rows(comparison)
    )
    headings = ("criterion", *(row.mechanism for row in comparison.ranking))
    terms = [block for row in comparison.ranking for block in _of_hypothesis(row)]
    return Document(
        title="Mechanisms compared: " + ", ".join(flight.title or flight.path for flight in comparison.flights),
        subtitle=tables.flight_texts(comparison),
        conclusion_title=f"Verdict: {verdict.winner or verdict.outcome}",
        conclusion=verdict.reason,
        decided=verdict.winner is not None,
        blocks=(
            ranking,
            Texts(comparison.disagreements, "Disagreements"),
            Texts(tables.warning_texts(comparison), "Warnings", warning=True),
            *(Picture(chart) for chart in comparison_charts(comparison)),
            term_table("baseline, as the likeliest hypothesis has it", comparison.baseline.terms),
            *terms,
            Table(headings, tables.criteria_rows(comparison), "criteria in whitened rates", shown="verbose"),
            Texts(tables.stepwise_texts(comparison), "Stepwise beside the exact search", shown="verbose"),
            Texts(tables.note_texts(comparison), "Notes", shown="verbose"),
            Texts((_seconds(comparison),), bullets=False, shown="verbose"),
        ),
    )


def _of_hypothesis(hypothesis: RankedHypothesis) -> list[Block]:
    """Terms, derived quantities and likelihood fit of one hypothesis."""
    blocks: list[Block] = [term_table(hypothesis.mechanism, hypothesis.terms, knots=hypothesis.knots)]
    blocks.append(Texts(tables.knot_texts(hypothesis.knots), shown="verbose"))
    blocks.append(Texts(tables.derived_texts(hypothesis.derived), shown="verbose"))
    if hypothesis.ml is not None:
        blocks += likelihood_blocks(tables.likelihood_heading(hypothesis.mechanism, hypothesis.ml), hypothesis.ml)
    return blocks


def likelihood_blocks(heading: str, fit: MaximumLikelihood) -> list[Block]:
    """Terms, errors of the record, and what follows from them, by maximum likelihood."""
    derived = [*tables.derived_texts(fit.derived), *([fit.message] if fit.message else [])]
    errors = Table(
        tables.ERROR_HEADINGS, tables.error_rows(fit.instrument), f"{heading}: errors of the record", shown="verbose"
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
    headings, lines = tables.shown_columns(tables.TERM_HEADINGS, tables.term_rows(terms, knots))
    return Table(headings, lines, heading, most=most, shown=shown)


def _seconds(comparison: Comparison) -> str:
    seconds = comparison.seconds
    return (
        f"{seconds.total:.2f} s in all: reconstruction {seconds.reconstruct:.2f}, selection "
        f"{seconds.select:.2f}, maximum likelihood {seconds.ml:.2f}"
    )
