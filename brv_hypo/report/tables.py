"""What tables and sentences show of a comparison, and of the terms of any model, on the terminal and on pages."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from brv_hypo.comparison import result
from brv_hypo.flight.record import VEHICLE_DIMENSIONS, RecordTrial
from brv_hypo.flight.units import SI
from brv_hypo.inference.derivatives import Derivative, Function
from brv_hypo.io import text
from brv_hypo.io.text import NOT_A_NUMBER, estimated, f_ratio, hypothesis, interval, known_to, number, share, times
from brv_hypo.model.common_time import decimals
from brv_hypo.motion.reconstruction import angle_known
from brv_hypo.report.document import Block, Shown, Table, Texts
from brv_hypo.thresholds import CREDIBLE_PROBABILITY

_PLANES = {"in-plane": "in", "out-of-plane": "out", "record": NOT_A_NUMBER}
_LONG = re.compile(r"\d+\.\d{5,}")  # a number at more digits than a reader needs, in the name of what was discovered

ROWS_AT_FIRST, WARNINGS_AT_FIRST = 4, 2  # that the terminal shows; all of them with -v and on the page
ERRORS = "Errors of record and vehicle that the data show, least probable first; trim"
IN_A_PART = "In a part: what begins or ends in the record; of moment: throughout as well."
UNLIMITED = "Trim and baseline hide more of what acts throughout. Processes are beside these limits, not within them."
OF_ERRORS = (
    "By the data alone: without its tolerance. Half waves of the wind (s1, 1, 2, ...) share the tolerance `wind`: each "
    "has its part of it."
)
LEAST_ERROR = 1.0  # of the sigmas of fitted values, from which an error of the record is listed
FUNCTION_ROWS = 6  # places of a flight in the table of functions
SLOW = "drifts and gusts, in all hypotheses"
KIN = "Processes of one family may stand for one another: quote their sum."
IN_TRIM = "The mean of a moment fixed in the body may be in trim instead."
_PROCESSES = (
    "A process is a smooth change that nobody has modelled. rms size: of the moment coefficient C_m that it makes, or "
    "of the error of instruments and air; of moment: that over the moment's rms, of instruments and air by the rates "
    "that they make (the verdict's shares count only what the baseline does not describe); relative: over an ordinary "
    "size. In parentheses: below its sigma. To simulate: JSON's `planted`."
)

_VEHICLE = (
    "As the record has it. All moment coefficients are proportional to iyy over reference area and length: where one "
    "of these is assumed, so is their scale. Tolerance, 1 sigma: of ixx that of ixx / iyy."
)
RISING = "In a region in which a value rises or falls steadily (a ramp, an onset width) it is the mean there."
COLLINEAR_MARK = "*"  # beside a value that is nearly collinear with others
PAIRS = "Collinear pairs: correlation (variance inflations)"
MOST_COLLINEAR, MOST_BESIDE = 6, 4  # names of a group in its sentence; processes beside a hypothesis in its row
NAME_AND_FAMILY = (
    "`compare` names what its baseline lacks; `trace` divides, by family, the residual of a model whose static slope "
    "follows the Mach number, which may include that moment: both may be right."
)
IN_DOUBT = "Record in doubt"  # the title of a conclusion on a record that contradicts itself
CONTRADICTED = "The record contradicts itself (see the warnings), and its faults may be the cause of what follows."


def ranking_table(comparison: result.Comparison) -> Table:
    """One row for each hypothesis, likeliest first; those of the verdict's credible set are marked. "pred. error" and
    "ln evidence" are over those of the baseline only; "6+" terms says that more would have entered.
    """
    verdict = comparison.verdict
    rows = [
        {
            "rank": str(row.rank),
            "mechanism": hypothesis(row.mechanism),
            "terms": str(row.n_terms) + ("+" if row.status == "term limit" else ""),
            "F-ratio": number(row.f_ratio),
            "C_p": number(row.cp),
            "pred. error": text.error_share(row.prediction_ratio),
            "ln evidence": f"{row.log_evidence:.1f}".replace("nan", NOT_A_NUMBER),
            "prob.": text.probability(verdict.probability.get(row.mechanism)),
        }
        for row in comparison.ranking
    ]
    if result.OTHER in verdict.probability:
        nothing = dict.fromkeys(rows[0] if rows else (), NOT_A_NUMBER)
        rows.append(nothing | {"mechanism": result.OTHER, "prob.": text.probability(verdict.probability[result.OTHER])})
    probable = {name for name, chance in verdict.probability.items() if chance >= CREDIBLE_PROBABILITY}
    credible = [k for k, row in enumerate(comparison.ranking) if row.mechanism in probable & {*verdict.equivalent}]
    heading = "Hypotheses, by evidence (bold, •: credible; F-ratio, C_p: no processes)"
    return Table(rows, heading, words=("mechanism",), marked=credible)


def shown_processes(comparison: result.Comparison) -> list[result.ProcessEstimate]:
    """Those that make more than `LEAST_PROCESS`, largest first; after them those that do not exceed their sigma."""
    large = [each for each in comparison.verdict.processes if each.is_shown]
    return sorted(large, key=lambda each: each.size <= each.std_error)


def process_blocks(comparison: result.Comparison) -> list[Block]:
    """One row for each process beside the leader that makes more than `LEAST_PROCESS`; with -v those below sigma."""
    shown = shown_processes(comparison)
    large = [each.size > each.std_error for each in shown]
    rows = [
        {
            "process": each.name,
            "family": each.family,
            "of moment": form.format(share(each.share_of_moment)),
            "rms size": form.format(known_to(each.size, each.std_error)),
            "sigma": number(each.std_error, 2),
            "unit": "C_m" if each.is_of_moment else each.units,
            "relative": form.format(f"{number(each.size / each.tolerance, 2)} ×"),
        }
        for each, form in zip(shown, ("{}" if exceeds else "({})" for exceeds in large), strict=True)
    ]
    leader = hypothesis(comparison.ranking[0].mechanism) if rows else ""
    beside = f"Processes beside {leader}, by share ({SLOW})"
    table = Table(rows, beside, ("process", "family", "unit"), most=min(max(sum(large), 1), ROWS_AT_FIRST))
    said = []
    for each in shown:  # of instruments or air: others of its family and unit may be the same drift
        kin = [p.name for p in comparison.verdict.processes if (p.family, p.units) == (each.family, each.units)]
        if not each.is_of_moment and len(kin) > 1:
            one = f"{' and '.join(sorted(kin))} may be one drift ({each.family})"
            said.append(f"{one}: the data may give it to either.")
    read = [KIN] * any(each.is_of_moment for each in shown) + [IN_TRIM] * any(each.family == "body" for each in shown)
    drifts = Texts(list(dict.fromkeys(said)), bullets=False)
    return [table, drifts, Texts(read, bullets=False, shown="page")]


def process_texts(comparison: result.Comparison) -> list[Block]:
    """What the columns of the processes mean, which are left out of the table, and what is beside each hypothesis."""
    shown = shown_processes(comparison)
    small = ", ".join(each.name for each in comparison.verdict.processes if each not in shown)
    none = (f"No process ({SLOW}) makes over {share(result.LEAST_PROCESS)} of the moment.",)
    others = (f"Estimated below {share(result.LEAST_PROCESS)} of the moment: {small}. {KIN}",) if small else ()
    rows = []
    for row in comparison.ranking:
        named = [f"{name} {share(size)}" for name, size in row.process_shares.items()]
        rest = [f"{len(named) - MOST_BESIDE} more"] * (len(named) > MOST_BESIDE)
        beside = ", ".join([*named[:MOST_BESIDE], *rest]) or "none above its sigma"
        rows.append({"mechanism": hypothesis(row.mechanism), "of moment": beside})
    heading = "Processes beside each hypothesis: all, listed above their sigma (beyond 100 % they cancel)"
    return [
        Texts((_PROCESSES,) if shown else (), bullets=False, shown="page"),
        Texts(none if small and not shown else (), bullets=False),
        Texts(others, bullets=False, shown="verbose"),
        Table(rows, heading, ("mechanism", "of moment"), shown="verbose"),
    ]


def estimate_blocks(comparison: result.Comparison) -> list[Block]:
    """What the leader does between its knots, in time order, beyond two standard errors if it can; knots; delays."""
    if not comparison.ranking:
        return []
    leader = comparison.ranking[0]
    every = [value for each in leader.intervals for value in each.values]
    acting = {(each.start_s, each.stop_s) for each in leader.intervals if each.acts}
    net = [value for value in every if value.region_s in acting and abs(value.value) > 2.0 * value.std_error]
    heading = "Estimates of the leader" + (", if it is the cause" if comparison.verdict.winner is None else "")
    begins = collinear_at(leader)
    table = term_table(heading, net or every, "always", leader.knots, ROWS_AT_FIRST, begins, leader.derived)
    marked = [COLLINEAR_MARK in row["value"] for row in table.rows]
    beside: Shown = "always" if any(marked[:ROWS_AT_FIRST]) else "verbose"
    named: Shown = "verbose" if comparison.verdict.winner is None else "always"
    within = sum(value not in net for value in every) if net else 0
    rest = f"{text.counted(within, 'further value')} within two sigma: see the terms of {hypothesis(leader.mechanism)}."
    rises = any(term.name.startswith("ramp ") for term in leader.terms)
    known = [e for e in leader.derived if e.region_s is None and not e.name.endswith((result.KNOT, result.WIDTH))]
    shown = {term.delay_s for term in every}
    derived = derived_texts(sorted((e for e in known if e.value not in shown), key=lambda e: (e.name, e.value)))
    return [
        table,
        Texts((RISING,) if rises and table.rows else (), bullets=False),
        Texts((rest,) if within else (), bullets=False, shown="verbose"),
        Texts(size_texts(leader, leads=True) if any(marked) else (), bullets=False, shown=beside),
        replace(knot_table(comparison, leader), most=ROWS_AT_FIRST, shown=named),
        Texts(derived, shown=named),
    ]


def collinear_at(row: result.RankedHypothesis) -> list[list[str]]:
    """Net values of each interval that are nearly collinear with each other, named with the times they begin at."""
    return [[f"{name} at {at.start_s:.2f} s" for name in g] for at in row.intervals for g in at.collinear_groups]


def size_texts(row: result.RankedHypothesis, leads: bool) -> list[str]:
    """How large a hypothesis is, and of which fit that is; what is nearly collinear."""
    said = collinear_names(dict.fromkeys(group for each in row.intervals for group in each.collinear_groups))
    fit = f"Fitted beside processes; the ranking's F-ratio, {number(row.f_ratio)}, is without them."
    return said if leads else [" ".join(filter(None, (f"{row.mechanism}:", row.size, fit))), *said]


def knot_table(comparison: result.Comparison, row: result.RankedHypothesis) -> Table:
    """One row for each knot of a hypothesis: its time on every flight, its error, how long it comes on, Mach number."""
    rows: list[dict[str, str]] = []
    found, lasts = row.changes, sum(each.stop_s - each.start_s for each in row.intervals)
    acts, flights = row.acting, comparison.flights
    ends = {"onset": row.middle(acts[0].start_s), "end": row.middle(acts[-1].stop_s)} if acts else {}
    shared = len(flights) > 1 and bool(row.knots)
    for knot, width in found:
        said = [name for name, at in ends.items() if abs(at - knot.value) < result.SAME_TIME]
        place = {"change": ", ".join(said) or "change"}
        if shared:
            mach = float(np.interp(knot.value, [k.time_s for k in row.knots], [k.mach for k in row.knots]))
            place |= {f"flight {k + 1}, s": _own_time(row, k, knot.value) for k in range(len(flights))}
            place[f"sigma (flight {comparison.reference_flight})"] = number(knot.std_error, 2)
        else:
            mach = comparison.mach_at(knot.value)
            at = text.instant(knot.value, knot.std_error) if knot.std_error < lasts else "undetermined"
            place |= {"time, s": at, "sigma": number(knot.std_error, 2)}
        over = NOT_A_NUMBER if width is None else estimated(width.value, width.std_error)
        rows.append(place | {"over, s": over, "Mach": number(mach)})
    kept = [name for name in (rows[0] if rows else ()) if any(each[name] != NOT_A_NUMBER for each in rows)]
    middle = " (the middle of what comes on over a time)" if "over, s" in kept else ""
    heading = f"When {hypothesis(row.mechanism)} changes{middle}"
    return Table([{name: each[name] for name in kept} for each in rows], heading, ("change",), shown="verbose")


def _own_time(row: result.RankedHypothesis, flight: int, at: float) -> str:
    """A flight's own time of what happens at a time of the reference flight (s)."""
    known = [(k.time_s, k.flights_s[flight]) for k in row.knots if k.flights_s[flight] is not None]
    if not known or not known[0][0] - 1e-6 <= at <= known[-1][0] + 1e-6:
        return "not reached"
    return f"{np.interp(at, *np.array(known, dtype=float).T):.2f}"


def limit_blocks(comparison: result.Comparison) -> list[Block]:
    """How large each mechanism may be: of the moment's rms, as C_m and in N m, smallest first; which are not known."""
    verdict, parts, scale = comparison.verdict, [], None
    for series, flight in zip(comparison.series, comparison.flights, strict=False):
        area, length = flight.vehicle.get("reference_area"), flight.vehicle.get("reference_length")
        if area is not None and length is not None:
            parts.append(area * length * np.array(series.dynamic_pressure_pa))
    if parts:  # rms over all flights: N m of a moment coefficient of 1
        scale = float(np.sqrt(np.mean(np.concatenate(parts) ** 2)))
    known = [each for each in verdict.limits if np.isfinite(each.share_of_moment_95)]
    rows = [
        {
            "mechanism": each.mechanism + (" (leader)" if each.mechanism == comparison.ranking[0].mechanism else ""),
            "of moment": share(each.share_of_moment_95),
            "in a part": share(each.share_in_part_95) if np.isfinite(each.share_in_part_95) else NOT_A_NUMBER,
            "C_m, rms": number(each.coefficient_95, 2),
            **({} if scale is None else {"N m, rms": number(each.coefficient_95 * scale, 2)}),
        }
        for each in sorted(known, key=lambda each: each.share_of_moment_95)
    ]
    withheld = ", ".join(each.mechanism for each in verdict.limits if each not in known)
    read = [UNLIMITED, *([] if scale is None else ["N m: at the rms dynamic pressure of the record."])] if rows else []
    sizes = [(e.mechanism, ", ".join(f"{k} {number(v, 2)}" for k, v in e.coefficients_95.items())) for e in known]
    if longest := "; ".join(f"{name} {largest}" for name, largest in sizes if largest):
        read.append(f"For a quarter of the record or longer, at most: {longest}.")
    said = [IN_A_PART] if rows else []
    if any(each.share_of_moment_95 > 1.0 for each in known):
        said.append("Above 100 %: nothing that is smaller than the whole moment is excluded.")
    if verdict.outcome == "none adequate":
        said = ["Limits are withheld: no hypothesis that was compared is adequate."] if withheld else said
    elif withheld:
        said.append(f"Withheld for {withheld}: the record says nothing of their size.")
    heading = "Upper limits at 95 %: what may hide beside leader, trim and baseline"
    excluded = Texts([" ".join(said)] if said else (), bullets=False)
    meaning = replace(excluded, texts=[" ".join(read)] if read else (), shown="verbose")
    return [Table(rows, heading, ("mechanism",)), excluded, meaning]


def size_table(comparison: result.Comparison) -> Table:
    """One row for each number of terms of the leader, with the best subset of that size (Tables 5.5, 5.7)."""
    null = "baseline only"
    rows = [
        {"terms": str(e.n_terms), "k": str(e.n_coefficients), "C_p": number(e.cp), "best": ", ".join(e.terms) or null}
        for e in comparison.best_by_size
    ]
    return Table(rows, "Best of each size, on the grid of knots and delays", ("best",), shown="verbose")


def error_table(errors: Sequence[result.RecordError], slopes: Sequence[Derivative] = ()) -> Table:
    """Errors of record and vehicle above one sigma, and trim, the least probable first; in degrees too what is an angle
    and a moment of the vehicle, as trim: where the static moment, by the median of `slopes`, is as large.
    """
    flown = np.abs([value for each in slopes for value in each.at_flown])
    rows, slope = list[dict[str, str]](), float(np.median(flown)) if flown.size else np.nan
    for each in (e for e in errors if e.sigmas > LEAST_ERROR or " C_" in e.name):
        of_moment = each.units == "1" and " C_" in each.name
        angle = np.degrees(1.0 if each.units == "rad" else 1.0 / slope if of_moment else np.nan)
        name = each.name + " (body)" * (" C_" in each.name)  # not the baseline's C_m0, in the plane of alpha
        row = {"error": name, "value": known_to(each.value, each.std_error), "sigma": number(each.std_error, 2)}
        row |= {"unit": each.units, "tolerances": f"{each.tolerances:.2f}"}
        known = known_to(angle * each.value, angle * each.std_error) if np.isfinite(angle) else NOT_A_NUMBER
        rows.append(row | {"by the data alone": number(each.without_tolerance), "as angle, deg": known})
    beyond = range(len(result.beyond_tolerances(errors)))
    return Table(rows, ERRORS, ("error", "unit"), beyond, shown="verbose")


def function_blocks(functions: Mapping[Function, Sequence[Derivative]]) -> list[Block]:
    """C_m,in and its derivatives at places along each flight, each with its standard error: at the angle of attack
    flown there, with what they are nearly collinear with; and at none.
    """
    flown, zero = [], []
    several = any(len(each) > 1 for each in functions.values())
    for found in zip(*functions.values(), strict=True):
        whole = found[0]
        for k in np.unique(np.linspace(0, len(whole.time_s) - 1, FUNCTION_ROWS).round().astype(int)).tolist():
            ends = [f"{np.degrees(end):.1f}" for pair in whole.alpha_ends_rad[k : k + 1] for end in pair]
            place = {"flight": str(whole.flight + 1)} if several else {}
            place |= {"time, s": f"{whole.time_s[k]:.2f}", "Mach": number(whole.mach[k])}
            place |= {"alpha, deg": "–".join(ends)} if ends else {}
            flown.append(dict(place))
            zero.append(place)
            for name, each in zip(functions, found, strict=True):
                in_plane = "static C_m,in" if name == "C_m0" else name
                mark = COLLINEAR_MARK if each.collinear[k] else ""
                flown[-1][in_plane] = estimated(each.at_flown[k], each.at_flown_std_error[k]) + mark
                value = each.at_zero[k], each.at_zero_std_error[k]
                zero[-1][name] = f"({known_to(*value)})" if each.extrapolated[k] else estimated(*value)
    said = [text for name, known in functions.items() for text in collinear_texts(name, known)]
    if said:
        said.append("That value and its error hold only for sizes of processes as estimated: no evidence by itself.")
    return [
        Table(flown, "At the angle of attack flown (model, its C_damping in C_mq, and processes)", shown="verbose"),
        Texts(said, bullets=False, shown="verbose"),
        Table(zero, "At alpha = 0; in parentheses: extrapolated, no sample is near", shown="verbose"),
    ]


def collinear_texts(name: str, functions: Sequence[Derivative]) -> list[str]:
    """With what a function is nearly collinear and where, on each flight; nothing where with nothing."""
    said = []
    for found in functions:
        if (places := np.flatnonzero(found.collinear)).size:
            first, last = found.time_s[places[0]], found.time_s[places[-1]]
            flight = f" of flight {found.flight + 1}" if len(functions) > 1 else ""
            others = [f"{other} (correlation up to {max(each):.2f})" for other, each in found.collinear_with.items()]
            where = f"{'at' if first == last else 'from'} {times(first, last)}"
            said.append(f"{COLLINEAR_MARK} {name}{flight} is nearly collinear with {', '.join(others)} {where}.")
    return said


def collinear_names(groups: Iterable[Sequence[str]]) -> list[str]:
    """A sentence for each group of coefficients that are nearly collinear."""
    said = []
    for group in groups:
        more = f" and {len(group) - MOST_COLLINEAR} more" if len(group) > MOST_COLLINEAR else ""
        said.append(f"{COLLINEAR_MARK} {', '.join(group[:MOST_COLLINEAR])}{more} are nearly collinear.")
    if said:
        said.append("Their sigmas are with the others free; the moment that they make together is known better.")
    return said


def term_table(
    heading: str,
    terms: Iterable[result.TermEstimate],
    shown: Shown = "verbose",
    knots: Sequence[result.Knot] = (),
    most: int | None = None,
    collinear: Iterable[Sequence[str]] = (),
    derived: Iterable[result.DerivedEstimate] = (),
) -> Table:
    """One row for each coefficient; no column without a value. `knots`: the ends of its region are Mach numbers, as
    each flight has times of its own. Those in a group of `collinear` ones, named with the times that they begin at, and
    the delays there are marked. `derived` has the errors of delays.
    """
    machs = {knot.time_s: knot.mach for knot in knots}
    errors = {each.value: estimated(each.value, each.std_error) for each in derived if np.isfinite(each.std_error)}
    digits = decimals(list(machs.values()))
    rows, terms, groups = [], tuple(terms), tuple(map(set, collinear))
    own, marked = {term.begins for term in terms}, set[str]().union(*groups)
    for term in terms:
        with_delay = any(term.begins in group and group - own for group in groups)
        ends = [machs[end] for end in term.region_s or () if end in machs]
        rows.append(
            {
                "term": _LONG.sub(lambda found: f"{float(found[0]):.4g}", term.name),
                "plane": _PLANES.get(term.channel, term.channel),
                "unit": term.units,
                "value": known_to(term.value, term.std_error) + (COLLINEAR_MARK if term.begins in marked else ""),
                "sigma": number(term.std_error, 2),
                "t²": f_ratio(term.f_ratio),
                "region, s": NOT_A_NUMBER if machs else interval(term.region_s),
                "Mach": "–".join(f"{end:.{digits}f}" for end in ends) if len(ends) == 2 else NOT_A_NUMBER,
                "delay, s": errors.get(term.delay_s or 0.0, number(term.delay_s)) + COLLINEAR_MARK * with_delay,
            }
        )
    kept = [name for name in (rows[0] if rows else ()) if any(row[name] != NOT_A_NUMBER for row in rows)]
    rows = [{name: row[name] for name in kept} for row in rows]
    return Table(rows, heading, ("term", "plane", "unit"), most=most, shown=shown)


def derived_texts(derived: Iterable[result.DerivedEstimate]) -> list[str]:
    """What follows from the coefficients, one line each; angles in degrees too."""
    lines = []
    for item in derived:
        unit = "" if item.units == "1" else f" {item.units}"
        value = known_to(item.value, item.std_error) if np.isfinite(item.std_error) else number(item.value, 7)
        value = "undetermined," if value == "0" and item.units == "s" else value
        line = f"{item.name} = {value} ± {number(item.std_error, 2)}{unit}"
        if item.units == "rad":
            line += f" ({estimated(np.degrees(item.value), np.degrees(item.std_error))} deg)"
        lines.append(line + (f", of the change at {item.region_s[0]:.2f} s" if item.region_s else ""))
    return lines


def flight_lines(flights: Sequence[result.FlightSummary]) -> list[str]:
    """Number, where there are several, title, samples, span, rate and instruments of each flight."""
    lines = []
    for k, flight in enumerate(flights, start=1):
        span, number = interval((flight.start_s, flight.stop_s)), f"flight {k}: " if len(flights) > 1 else ""
        line = f"{flight.title or flight.path}: {flight.samples} samples, {span} s, {flight.sample_rate_hz:.4g} Hz"
        lines.append(number + line + (f", instruments {flight.instruments}" if flight.instruments else ""))
    return lines


def vehicle_blocks(flights: Sequence[result.FlightSummary]) -> list[Block]:
    """Mass properties and reference quantities of each flight, with their tolerances, and what depends on them."""
    tolerances, rows = {"ixx": "inertia_ratio", "iyy": "inertia"}, []
    for k, flight in enumerate(flights, start=1):
        for name, dimension in VEHICLE_DIMENSIONS.items():
            if (value := flight.vehicle.get(name)) is not None:
                size = flight.vehicle.get(tolerances.get(name, ""))
                row = {"quantity": name.replace("_", " "), "value": number(value, 4), "unit": SI[dimension]}
                row["tolerance"] = NOT_A_NUMBER if size is None else share(size)
                rows.append(({"flight": str(k)} if len(flights) > 1 else {}) | row)
    read = Texts((_VEHICLE,) if rows else (), bullets=False, shown="page")
    return [Table(rows, "Vehicle", ("quantity", "unit"), shown="page"), read]


def flight_texts(comparison: result.Comparison) -> list[str]:
    """One line for each flight, and one for how well the motion is known."""
    lines = flight_lines(comparison.flights)
    if comparison.reference_flight is not None:
        lines.append("terms begin and end together, each flight at its own times: by Mach number, unless warned below")
    leaders = [hypothesis(row.mechanism) for row in comparison.ranking[:1]]
    return [*lines, *(motion_known(comparison.reconstruction, name) for name in leaders)]


def motion_known(known: result.ReconstructionSummary, about: str = "") -> str:
    """Which motion it is, of the instruments alone or `about` a model, and how well it is known (rms)."""
    alpha, meridian = (angle_known(each or 0.0) for each in (known.alpha_rms_sigma_rad, known.phi_w_rms_sigma_rad))
    which = f"about {about}" if about else "of the instruments alone"
    off = f"; its distance from reconstruct's, {angle_known(known.moved_rad)}, included" if about else ""
    return f"motion {which} ({known.method} method), known to {alpha} in alpha, {meridian} in meridian (rms{off})"


def gap_table(comparison: result.Comparison) -> Table:
    """One row for each gap, with the largest, in tolerances, of the errors of the record that it makes."""
    rows = dict[tuple[str, float], dict[str, str]]()
    for each in sorted(comparison.record_errors, key=lambda error: abs(error.tolerances)):
        if found := re.fullmatch(r"gap_turn \w+ (\d+)(?:, flight (\d+))?", each.name):
            start, stop = comparison.flights[int(found[2] or 1) - 1].gaps_s[int(found[1]) - 1]
            row = {"gap, s": interval((start, stop)), "error": each.name, "value": each.stated}
            rows[found[2] or "", start] = row | {"tolerances": f"{each.tolerances:.2f}"}
    return Table([rows[key] for key in sorted(rows)], "Gaps, each with its largest error", ("error",), shown="verbose")


def warning_texts(warnings: Sequence[str]) -> Texts:
    """Warnings, of which the terminal shows the first."""
    return Texts(warnings, "Warnings", warning=True, most=WARNINGS_AT_FIRST)


def fault_texts(record: RecordTrial, reported: str = "") -> list[str]:
    """The faults of the record but those that are `reported` already."""
    channels: dict[str, list[str]] = {}  # by what all of them have in common
    for fault in record.faults:
        if fault.action not in reported:
            channels.setdefault(f"{fault.fault}, {fault.action}, {fault.when}", []).append(fault.channel)
    return [f"{', '.join(names)}: {text}" for text, names in channels.items()]
