"""The rows of a comparison's tables, the same in the terminal and on the page."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from brv_hypo.io.text import counted
from brv_hypo.model.common_time import decimals
from brv_hypo.motion.reconstruction import angle_known
from brv_hypo.ranking.result import (
    Comparison,
    DerivedEstimate,
    FlightSummary,
    Knot,
    MaximumLikelihood,
    RecordSummary,
    TermEstimate,
)
from brv_hypo.report.style import NOT_A_NUMBER, f_ratio, interval, known_to, number, probability, share

RANKING_HEADINGS = ("rank", "mechanism", "terms", "F-ratio", "C_p", "pred. error", "R²", "MCS p", "prob.")
TERM_HEADINGS = ("term", "plane", "unit", "value", "sigma", "F", "region, s", "Mach", "delay, s")
ERROR_HEADINGS = ("term", "unit", "value", "sigma", "F")
_PLANES = {"in-plane": "in", "out-of-plane": "out"}
_LONG = re.compile(r"\d+\.\d{5,}")
"""A number at more digits than a reader needs, in the name of what was discovered."""
_DIFFERENCES = ("aic", "bic")
"""Criteria that say nothing but by their differences."""


def ranking_rows(comparison: Comparison) -> list[tuple[str, ...]]:
    """One row for each hypothesis, likeliest first.

    "pred. error" is the held-out error over that of `none`; "MCS p" the p-value in the model confidence set; "6+" terms
    says that more would have entered.
    """
    return [
        (
            str(row.rank),
            row.mechanism,
            str(row.n_terms) + ("+" if row.status == "term limit" else ""),
            number(row.f_ratio),
            number(row.cp),
            share(row.prediction_ratio),
            f"{row.r2:.4f}",
            probability(comparison.verdict.confidence_p_values.get(row.mechanism)),
            probability(comparison.verdict.probability.get(row.mechanism)),
        )
        for row in comparison.ranking
    ]


def credible_rows(comparison: Comparison) -> list[int]:
    """Which rows are in the verdict's credible set."""
    return [i for i, row in enumerate(comparison.ranking) if row.mechanism in comparison.verdict.equivalent]


def term_rows(terms: Iterable[TermEstimate], knots: Sequence[Knot] = ()) -> list[tuple[str, ...]]:
    """One row for each coefficient; `knots` tell the ends of its region by Mach number."""
    machs = {knot.time_s: knot.mach for knot in knots}
    digits = decimals(list(machs.values()))
    return [
        (
            _LONG.sub(lambda found: f"{float(found[0]):.4g}", term.name),
            _PLANES.get(term.channel, term.channel),
            term.units,
            known_to(term.value, term.std_error),
            number(term.std_error, 2),
            f_ratio(term.f_ratio),
            interval(term.region_s),
            _machs(term, machs, digits),
            number(term.delay_s),
        )
        for term in terms
    ]


def _machs(term: TermEstimate, machs: Mapping[float, float], digits: int) -> str:
    if term.region_s is None or any(end not in machs for end in term.region_s):
        return NOT_A_NUMBER
    return "–".join(f"{machs[end]:.{digits}f}" for end in term.region_s)


def knot_texts(knots: Sequence[Knot]) -> list[str]:
    """One line for each knot of several flights: its Mach number, and every flight's own time of it."""
    digits = decimals([knot.mach for knot in knots])
    return [
        f"Mach {knot.mach:.{digits}f}: "
        + ", ".join(
            f"flight {k} {'does not come by it' if own is None else f'at {own:.2f} s'}"
            for k, own in enumerate(knot.flights_s, start=1)
        )
        for knot in knots
    ]


def shown_columns(headings: Sequence[str], lines: Sequence[Sequence[str]]) -> tuple[list[str], list[list[str]]]:
    """Headings and rows without the columns in which no row says anything."""
    kept = [i for i in range(len(headings)) if any(line[i] != NOT_A_NUMBER for line in lines)]
    return [headings[i] for i in kept], [[line[i] for i in kept] for line in lines]


def error_rows(terms: Iterable[TermEstimate]) -> list[tuple[str, ...]]:
    """One row for each error of the record: they have neither plane, nor region, nor delay."""
    return [
        (
            term.name,
            term.units,
            known_to(term.value, term.std_error),
            number(term.std_error, 2),
            f_ratio(term.f_ratio),
        )
        for term in terms
    ]


def likelihood_heading(mechanism: str, fit: MaximumLikelihood) -> str:
    """Whose likelihood, and how its search ended."""
    return f"{mechanism} by maximum likelihood: {fit.status}, {fit.iterations} iterations"


def criteria_rows(comparison: Comparison) -> list[tuple[str, ...]]:
    """One row for each criterion: its name, then its value for each hypothesis, as they are ranked.

    Information criteria are reported as differences from the least.
    """
    names = dict.fromkeys(name for row in comparison.ranking for name in row.criteria)
    return [_criterion(name, [row.criteria.get(name) for row in comparison.ranking]) for name in names]


def _criterion(name: str, values: Sequence[float | None]) -> tuple[str, ...]:
    known = [value for value in values if value is not None and np.isfinite(value)]
    if name not in _DIFFERENCES or not known:
        return (name, *(number(value, 4) for value in values))
    least = min(known)
    return (f"{name} - least", *(number(None if value is None else value - least, 4) for value in values))


def derived_texts(derived: Iterable[DerivedEstimate]) -> list[str]:
    """What follows from the coefficients, one line each; angles in degrees too."""
    lines = []
    for item in derived:
        unit = "" if item.units == "1" else f" {item.units}"
        line = f"{item.name} = {known_to(item.value, item.std_error)} ± {number(item.std_error, 2)}{unit}"
        if item.units == "rad":
            line += f" ({np.degrees(item.value):.1f} ± {np.degrees(item.std_error):.1f} deg)"
        lines.append(line + (f" in {interval(item.region_s)} s" if item.region_s else ""))
    return lines


def flight_line(flight: FlightSummary) -> str:
    """Title, samples, span and rate of a flight."""
    span = interval((flight.start_s, flight.stop_s))
    return f"{flight.title or flight.path}: {flight.samples} samples, {span} s, {flight.sample_rate_hz:.4g} Hz"


def flight_texts(comparison: Comparison) -> list[str]:
    """One line for each flight, and one for how well the motion is known."""
    lines = [flight_line(flight) for flight in comparison.flights]
    if any(row.knots for row in comparison.ranking):
        reference = comparison.flights[(comparison.reference_flight or 1) - 1]
        lines.append(
            "terms begin and end at the same Mach numbers on every flight; times are those of "
            f"{reference.title or reference.path}"
        )
    known = comparison.reconstruction
    if known.alpha_rms_sigma_rad is None or known.phi_w_rms_sigma_rad is None:
        return lines
    alpha, meridian = angle_known(known.alpha_rms_sigma_rad), angle_known(known.phi_w_rms_sigma_rad)
    lines.append(f"motion by the {known.method} method, known to {alpha} in alpha and {meridian} in meridian (rms)")
    return lines


def stepwise_texts(comparison: Comparison) -> list[str]:
    """Where a stepwise search would have taken other terms than the exact one."""
    return [
        f"{each.mechanism}, {counted(each.size, 'term')}: stepwise (Efroymson) would take "
        f"{', '.join(each.stepwise)} for {', '.join(each.best)}, with "
        f"{share(each.rss_ratio - 1.0)} more left over"
        for each in comparison.stepwise
    ]


def note_texts(comparison: Comparison) -> list[str]:
    """What reading changed in the records, and remarks on the fits."""
    flights = [note for flight in comparison.flights for note in flight.notes]
    return flights + [f"{row.mechanism}: {note}" for row in comparison.ranking for note in row.notes]


def warning_texts(comparison: Comparison) -> list[str]:
    """What limits the result."""
    faults = fault_texts(comparison.record, comparison.verdict.reason)
    return [*faults, *comparison.reconstruction.warnings, *comparison.warnings]


IN_DOUBT = "Record in doubt"
"""The title of a conclusion on a record that contradicts itself."""
CONTRADICTED = "The record contradicts itself (see the warnings), and what is {reported} may be that."


def fault_texts(record: RecordSummary, reported: str = "") -> list[str]:
    """The faults of the record but those that are `reported` already."""
    return [
        f"{fault.channel}: {fault.fault}, {interval((fault.start_s, fault.stop_s))} s: {fault.action}"
        for fault in record.faults
        if fault.action not in reported
    ]
