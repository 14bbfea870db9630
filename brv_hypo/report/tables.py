"""What tables and sentences show of a comparison, and of the terms of any model, on the terminal and on pages."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

import numpy as np

from brv_hypo.io.text import NOT_A_NUMBER, f_ratio, hypothesis, interval, known_to, number, probability, share
from brv_hypo.model.common_time import decimals
from brv_hypo.motion.reconstruction import angle_known
from brv_hypo.ranking.result import Comparison, DerivedEstimate, FlightSummary, Knot, RecordSummary, TermEstimate
from brv_hypo.report.document import Block, Shown, Table, Texts

_PLANES = {"in-plane": "in", "out-of-plane": "out", "record": NOT_A_NUMBER}
_LONG = re.compile(r"\d+\.\d{5,}")  # a number at more digits than a reader needs, in the name of what was discovered
_DIFFERENCES = ("aic", "bic")  # criteria of which differences alone count
_OF_WHITENED_RATES = {
    "r2": "R² of whitened rates",
    "adjusted_r2": "adjusted R² of whitened rates",
    "prediction_error": "Akaike prediction error",
}
"""Criteria whose short names stand for another quantity in the ranking."""

LEAST_PROCESS = 1e-3  # share of the static moment above which a process is shown
_PROCESSES = (
    "A process is a smooth change that nobody has modelled, in every hypothesis. size: rms over the flight; relative: "
    "over an ordinary size; of moment: rms of what the process makes of the record, over the static moment's."
)

IN_DOUBT = "Record in doubt"  # the title of a conclusion on a record that contradicts itself
CONTRADICTED = "The record contradicts itself (see the warnings), and its faults may be the cause of what follows."


# ---- The ranking ----


def ranking_table(comparison: Comparison) -> Table:
    """One row for each hypothesis, likeliest first; those of the verdict's credible set stand out.

    "pred. error" and "ln evidence" are over those of the baseline only; "6+" terms says that more would have entered.
    """
    verdict = comparison.verdict
    rows = [
        {
            "rank": str(row.rank),
            "mechanism": hypothesis(row.mechanism),
            "terms": str(row.n_terms) + ("+" if row.status == "term limit" else ""),
            "F-ratio": number(row.f_ratio),
            "C_p": number(row.cp),
            "pred. error": share(row.prediction_ratio),
            "ln evidence": f"{row.log_evidence:.1f}".replace("nan", NOT_A_NUMBER),
            "prob.": probability(verdict.probability.get(row.mechanism)),
        }
        for row in comparison.ranking
    ]
    credible = [i for i, row in enumerate(comparison.ranking) if row.mechanism in verdict.equivalent]
    return Table(rows, words=("mechanism",), marked=credible)


def process_blocks(comparison: Comparison) -> list[Block]:
    """One row for each process beside the leader that makes more than `LEAST_PROCESS`, largest first."""
    processes = comparison.verdict.processes
    rows = [
        {
            "process": each.name,
            "family": each.family,
            "size": known_to(each.size, each.std_error),
            "sigma": number(each.std_error, 2),
            "unit": each.units,
            "relative": f"{number(each.size / each.tolerance, 2)} ×",
            "of moment": share(each.share_of_moment),
        }
        for each in processes
        if each.share_of_moment > LEAST_PROCESS
    ]
    beside = f"Processes beside {hypothesis(comparison.ranking[0].mechanism)}" if rows else ""
    none = (f"No process makes more than {share(LEAST_PROCESS)} of the static moment.",) if processes else ()
    table = Table(rows, beside, ("process", "family", "unit"), most=6)
    return [table, Texts((_PROCESSES,) if rows else none, bullets=False, shown="page" if rows else "always")]


def criteria_table(comparison: Comparison) -> Table:
    """One row for each criterion, with its value for each hypothesis; information criteria less the least of them."""
    rows = []
    for name in dict.fromkeys(name for row in comparison.ranking for name in row.criteria):
        values = {row.mechanism: row.criteria.get(name, np.nan) for row in comparison.ranking}
        label = _OF_WHITENED_RATES.get(name, name)
        if name in _DIFFERENCES and np.any(np.isfinite(list(values.values()))):
            label = f"{name} - least"
            values = {each: value - np.nanmin(list(values.values())) for each, value in values.items()}
        rows.append({"criterion": label, **{hypothesis(each): number(value, 4) for each, value in values.items()}})
    return Table(rows, "criteria in whitened rates", ("criterion",), shown="verbose")


# ---- Terms of a model ----


def term_table(
    heading: str,
    terms: Iterable[TermEstimate],
    shown: Shown = "verbose",
    knots: Sequence[Knot] = (),
    most: int | None = None,
) -> Table:
    """One row for each coefficient; `knots` give the ends of its region by Mach number; no column without a value."""
    machs = {knot.time_s: knot.mach for knot in knots}
    digits = decimals(list(machs.values()))
    rows = []
    for term in terms:
        ends = [machs[end] for end in term.region_s or () if end in machs]
        rows.append(
            {
                "term": _LONG.sub(lambda found: f"{float(found[0]):.4g}", term.name),
                "plane": _PLANES.get(term.channel, term.channel),
                "unit": term.units,
                "value": known_to(term.value, term.std_error),
                "sigma": number(term.std_error, 2),
                "F": f_ratio(term.f_ratio),
                "region, s": interval(term.region_s),
                "Mach": "–".join(f"{end:.{digits}f}" for end in ends) if len(ends) == 2 else NOT_A_NUMBER,
                "delay, s": number(term.delay_s),
            }
        )
    kept = [name for name in (rows[0] if rows else ()) if any(row[name] != NOT_A_NUMBER for row in rows)]
    rows = [{name: row[name] for name in kept} for row in rows]
    return Table(rows, heading, ("term", "plane", "unit"), most=most, shown=shown)


def knot_texts(knots: Sequence[Knot]) -> list[str]:
    """One line for each knot of several flights: its Mach number, and every flight's own time of it."""
    digits = decimals([knot.mach for knot in knots])
    return [
        f"Mach {knot.mach:.{digits}f}: "
        + ", ".join(
            f"flight {k} {'does not reach it' if own is None else f'at {own:.2f} s'}"
            for k, own in enumerate(knot.flights_s, start=1)
        )
        for knot in knots
    ]


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


# ---- Records, and what limits a result ----


def flight_line(flight: FlightSummary) -> str:
    """Title, samples, span, rate and instruments of a flight."""
    span = interval((flight.start_s, flight.stop_s))
    line = f"{flight.title or flight.path}: {flight.samples} samples, {span} s, {flight.sample_rate_hz:.4g} Hz"
    return line + (f", instruments {flight.instruments}" if flight.instruments else "")


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
    if known.alpha_rms_sigma_rad is not None and known.phi_w_rms_sigma_rad is not None:
        lines.append(motion_known(known.method, known.alpha_rms_sigma_rad, known.phi_w_rms_sigma_rad))
    return lines


def motion_known(method: str, alpha_sigma: float, meridian_sigma: float) -> str:
    """How the motion was reconstructed, and how well it is known (rad, rms)."""
    alpha, meridian = angle_known(alpha_sigma), angle_known(meridian_sigma)
    return f"motion by the {method} method, known to {alpha} in alpha and {meridian} in meridian (rms)"


def fault_texts(record: RecordSummary, reported: str = "") -> list[str]:
    """The faults of the record but those that are `reported` already."""
    return [
        f"{fault.channel}: {fault.fault}, {interval((fault.start_s, fault.stop_s))} s: {fault.action}"
        for fault in record.faults
        if fault.action not in reported
    ]
