"""What the leader says beside its coefficients: errors, collinearity, residual, the moment as functions."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.polynomial import Polynomial

from brv_hypo.arrays import BoolArray, ComplexArray, FloatArray
from brv_hypo.comparison import result
from brv_hypo.comparison.intervals import collinear_groups, collinear_pairs
from brv_hypo.comparison.judgement import Judged, processes, share_of
from brv_hypo.comparison.limits import fitted_size
from brv_hypo.comparison.preparation import APART_SIGMAS
from brv_hypo.comparison.result import Comparison, Knot, ProcessEstimate, RecordError, Series, SizedModel, TermEstimate
from brv_hypo.comparison.summary import estimates, motion_histories
from brv_hypo.flight.record import Flight
from brv_hypo.identification import Estimate, Identification
from brv_hypo.identification.parameters import NonlinearParameter
from brv_hypo.inference import derivatives
from brv_hypo.inference.evidence import Evidence
from brv_hypo.inference.fit import HypothesisFit, likeliest
from brv_hypo.inference.problem import Problem
from brv_hypo.inference.refinement import Nonlinear, shift_sigma
from brv_hypo.inference.search import on_grid
from brv_hypo.io.text import times
from brv_hypo.linearisation.channels import Channels
from brv_hypo.linearisation.frame import residual_moments
from brv_hypo.mechanisms.contract import MomentProcess, rms_of_shapes
from brv_hypo.mechanisms.registry import processes_by_name
from brv_hypo.model.common_time import at, decimals
from brv_hypo.model.term import Regressor
from brv_hypo.motion.motion import plane_from_body
from brv_hypo.motion.reconstruction import UNKNOWN_ANGLE, Reconstruction
from brv_hypo.motion.signals import rms
from brv_hypo.subset.criteria import Criteria

_CHANNELS = ("q", "r", "ay", "az")  # in the order of the rows of a residual
MOST_DRAWN = 10_000  # samples of a stretch of time up to which all are drawn
STABLE_SIGMAS = 2.0  # standard errors by which a static slope must be stable to be called so; convention
REPORTED_DRAG = 0.1  # relative spread of axial force over dynamic pressure, below which they are said to be one
# Logarithm by which that leaves a parabola in ln Mach on one of 32 stretches, from which it is said. Opportunity has
# 0.012 at most, with a density that was found from it; slender simulated bodies, whose drag follows alpha, have 0.025.
REPORTED_DENSITY = 0.05
_AT_BOUND = 0.01  # of a range: a value so near its end lies there
_DETERMINED = 0.05  # share of an error's precision that is the data's: with less they hardly give a value
_TIMES = 100  # at which histories of processes are evaluated: three for each spline of the fastest


def of_leader(judged: Judged, comparison: Comparison, motions: Sequence[Reconstruction]) -> dict[str, Any]:
    """Fields of a comparison, of its leader above all; `motions` of all flights."""
    fit, own = judged.leading
    gains, null = dict[str, dict[str, Any]](), judged.baseline.held_out
    independent = judged.weight / share_of(judged.leading)
    flights = [(each.flight.dynamic_pressure, each.flight.vehicle) for each in motions]
    scales = np.concatenate([q * vehicle.reference_area * vehicle.reference_length for q, vehicle in flights])
    newton_metres = rms(scales)  # of a moment coefficient of 1
    for pair in judged.pairs:
        each, evidence = pair
        gain = judged.weight * (evidence.held_out - null)  # on each stretch of time given the others
        error = float(np.sqrt(gain.size * np.var(gain, ddof=1))) if gain.size > 1 else float("nan")
        gains[each.name] = {"held_out_gain": float(np.sum(gain)), "held_out_gain_std_error": error}
        beside = [one for one in processes(evidence) if one.is_shown and one.size > one.std_error]
        gains[each.name] |= {"process_shares": {one.name: one.share_of_moment for one in beside}}
        if each.selected:
            share, moment = share_of(pair), evidence.rows.measured_moment
            size, error, _ = fitted_size(each, evidence, independent * share, {m.name for m in each.mechanisms})
            gains[each.name] |= {"share_of_moment": size / moment, "share_std_error": error / moment}
            gains[each.name] |= {"rms_moment": size * newton_metres, "share_beside_processes": share}
    (knots,) = [row.knots for row in comparison.ranking if row.mechanism == fit.name]
    gains[fit.name] |= {"share_of_static": judged.of_static, "knots": at_own_times(judged, knots)}
    by = {"C_m0": derivatives.value, "C_malpha": derivatives.slope, "C_mq": derivatives.damping}
    frame = own.rows.frame_of(fit)
    along = {k: derivatives.along_flights(own, fit.columns, frame, one, judged.weight) for k, one in by.items()}
    mechanisms = [k for k, each in enumerate(judged.fits) if each.selected]
    best = min(mechanisms, key=lambda k: judged.fits[k].information, default=None)
    places = dict.fromkeys(k for k in (judged.null, judged.leader, best) if k is not None)
    histories = {judged.fits[k].name: _as_judged(judged, k) for k in places}
    alone, known = None if best is None else judged.fits[best].name, fit.estimated
    covariance = fit.covariance[np.ix_(known, known)]
    return {
        "ranking": tuple(row.model_copy(update=gains[row.mechanism]) for row in comparison.ranking),
        "record_errors": record_errors(own, judged.weight),
        **collinear(estimates([fit.columns[k] for k in known], fit.values[known], covariance, frame), covariance),
        "functions": along,
        "series": tuple(_series(judged, k, histories, alone, motions[k]) for k in range(len(motions))),
    }


def caveats_of(flight: Flight, slope: derivatives.Derivative) -> list[str]:
    """What in the data could pose as an effect."""
    found, share = list[str](), flight.ax / flight.dynamic_pressure
    drag = float(np.std(share) / max(abs(float(np.median(share))), 1e-300))
    slopes, errors = np.array([slope.at_flown, slope.at_flown_std_error])
    changed = np.ptp(slopes) > STABLE_SIGMAS * np.hypot(*errors[[np.argmin(slopes), np.argmax(slopes)]])
    if drag < REPORTED_DRAG and changed:
        found.append(
            f"dynamic pressure keeps a fixed proportion to the axial force within {max(100.0 * drag, 0.01):.2g} %: if "
            "it was derived from drag, the stiffness, which changes, may in part be a change of the drag coefficient"
        )
    stretches = np.array_split(np.arange(flight.samples), len(slope.time_s))
    axial = np.array([flight.ax[use].sum() / flight.dynamic_pressure[use].sum() for use in stretches])
    if np.all(axial < 0.0) and np.ptp(slope.mach) > 0.0:  # drag, no thrust; NaN where Mach is not known
        place, logarithms = np.log(slope.mach), np.log(-axial)
        off = logarithms - Polynomial.fit(place, logarithms, 2)(place)
        worst = int(np.argmax(np.abs(off)))
        if abs(off[worst]) > REPORTED_DENSITY:
            found.append(
                f"axial force over dynamic pressure is {100.0 * np.expm1(off[worst]):+.2g} % off a parabola in ln Mach "
                f"at {times(slope.time_s[worst])}: density is wrong there (family air), and every coefficient with it "
                "(no other test here shows that), or the axial force coefficient changes"
            )
    return found


def motions_beside(
    motions: Sequence[Reconstruction], first: Sequence[Reconstruction]
) -> tuple[tuple[Reconstruction, ...], tuple[float, ...]]:
    """The motion of each flight that a model is linear about, and how far (rad) it is from the `first`, of instruments
    alone. A model that lacks something moves it as it makes up for that: one more error, in every direction alike.
    """
    found, moved = [], []
    for motion, before in zip(motions, first, strict=True):
        off = rms((motion.crossflow - before.crossflow)[motion.flight.measured()]) / np.sqrt(2.0)
        turned = np.hypot(motion.phi_w_sigma, off / np.maximum(motion.motion.alpha, 1e-12))
        sigmas = {"alpha_sigma": np.hypot(motion.alpha_sigma, off), "phi_w_sigma": np.minimum(turned, UNKNOWN_ANGLE)}
        found.append(replace(motion, **sigmas))
        moved.append(float(off))
    return tuple(found), tuple(moved)


def with_errors_of_processes(found: Identification, fit: HypothesisFit, own: Evidence) -> Identification:
    """A likelihood, which knows no processes, with the errors that they make of its estimates."""
    if found.problem is None:
        return found
    covariance, variances = own.errors_of_processes
    count = len(fit.columns)

    def variance(parameter: NonlinearParameter) -> float:
        """Of a delay or knot, which the fit has as the middle and the width of an onset."""
        row, side = np.zeros(covariance.shape[0]), {"start": -0.5, "stop": 0.5, "theta": 0.0}[parameter.kind]
        for k, other in enumerate(fit.nonlinear, start=count):
            same_kind = (other.kind == "theta") is (parameter.kind == "theta")
            if same_kind and {j - fit.baseline_size for j in parameter.columns} & set(other.columns):
                row[k] = side if other.kind == "width" else 1.0
        return float(row @ covariance @ row)

    def wider(estimates: Sequence[Estimate], added: Iterable[float]) -> tuple[Estimate, ...]:
        pairs = zip(estimates, added, strict=True)
        return tuple(replace(each, std_error=float(np.sqrt(each.std_error**2 + more))) for each, more in pairs)

    items = own.rows.problem.rows.nuisances.items
    known = {(item.plain_label, item.flight): v * item.size**2 for item, v in zip(items, variances, strict=True)}
    tolerated = [known.get((e.name, flight), known.get((e.name, None), 0.0)) for e, flight in found.problem.tolerated]
    return replace(
        found,
        covariance=found.covariance + covariance[:count, :count],
        terms=wider(found.terms, np.diag(covariance)[:count]),
        nonlinear=wider(found.nonlinear, map(variance, found.problem.structure.nonlinear_parameters)),
        instruments=wider(found.instruments, tolerated),
    )


def record_errors(own: Evidence, weight: float = 1.0) -> tuple[RecordError, ...]:
    """Errors within stated tolerances, the least probable first; `weight`: what a nat counts. By the data
    alone one is its value over the share of its precision that is theirs.
    """
    items, values = own.rows.problem.rows.nuisances.items, own.errors.tolist()
    of_data = np.maximum(1.0 - (own.error_sigmas / own.noise) ** 2, 0.0)
    of_data[of_data < _DETERMINED] = np.nan
    sigmas = np.minimum(own.error_sigmas / np.sqrt(weight), 1.0).tolist()
    several = len(own.rows.blocks) > 1
    found = [
        RecordError(
            name=items[k].plain_label + (f", flight {flight + 1}" if several else ""),
            value=items[k].whole(values[k]),
            std_error=items[k].size * sigmas[k],
            units=items[k].units,
            tolerance=items[k].size,
            without_tolerance=items[k].whole(values[k]) / float(of_data[k]),
        )
        for flight, block in enumerate(own.rows.blocks)
        for k in block.items
        if items[k].stated
    ]
    return tuple(sorted(found, key=lambda each: -each.sigmas))


def far_beside_small(judged: Judged, processes: Sequence[ProcessEstimate]) -> str:
    """An error of record or vehicle that would be far beyond its tolerance if no process of the moment were above its
    ordinary size, in a sentence: those that are may replace it, as a cross-damping moment for a ratio of inertias.
    """
    own = judged.leading.evidence
    large = [each.name for each in processes if each.is_of_moment and each.size > each.tolerance]
    far = result.far_beyond(record_errors(own.beside_small, judged.weight)) if large else ""
    return f"With {', '.join(large)} of no more than ordinary size, {far}: check which it is." if far else ""


def _late(judged: Judged) -> tuple[list[Nonlinear], FloatArray, BoolArray]:
    """Knots of the leader, how late each comes on each flight (knots, flights) s, which significantly (knots,)."""
    own, fit = judged.leading.evidence, judged.leading.fit
    knots = [each for each in fit.nonlinear if each.kind == "knot"]
    if len(own.rows.blocks) < 2 or not knots:
        return [], np.zeros((0, len(own.rows.blocks))), np.zeros(0, dtype=bool)
    late, sigmas = own.events_apart
    step = max(each.flight.step for each in fit.frame.reconstructions)
    sigmas = np.hypot(sigmas / np.sqrt(judged.weight), shift_sigma(step))
    return knots, late, np.any(np.abs(late) > APART_SIGMAS * sigmas, axis=1)


def at_own_times(judged: Judged, knots: Sequence[Knot]) -> tuple[Knot, ...]:
    """The ends of the leader's regions, each at the flight's own time where it comes significantly late there."""
    fit, (moved, late, apart) = judged.leading.fit, _late(judged)
    common, by_edge = fit.frame.common, dict[float, FloatArray]()
    for parameter, own, known in zip(moved, late, apart.tolist(), strict=True):
        bases = [fit.selected[j].time_basis for j in parameter.columns]
        by_edge |= {edge: own for basis in bases for edge in (basis.start, basis.stop) if known}
    if common is None or not by_edge:
        return tuple(knots)
    nothing, found = np.zeros(len(common.flights)), []
    for knot in knots:
        shifts = by_edge.get(knot.time_s, nothing).tolist()
        pairs = zip(common.flights, shifts, knot.flights_s, strict=True)
        times = tuple(None if known is None else own.own_at(knot.time_s + shift) for own, shift, known in pairs)
        found.append(knot.model_copy(update={"flights_s": times}))
    return tuple(found)


def events_apart(judged: Judged) -> tuple[str, ...]:
    """Which change of the leader comes most apart on flights from their Mach numbers or time, if significantly."""
    fit, (knots, late, apart) = judged.leading.fit, _late(judged)
    if not knots:
        return ()
    common = fit.frame.common
    aligned = np.zeros_like(late) if common is None else np.array([common.late_at(each.value) for each in knots])
    whole = np.where(apart[:, np.newaxis], late, 0.0) + aligned
    most = int(np.argmax(np.ptp(whole, axis=1)))
    if np.ptp(whole[most]) == 0.0:
        return ()
    term, place = fit.selected[knots[most].columns[0]].term, at(common, knots[most].value)
    shared = "time" if common is None else "Mach number"
    advice = "for its time, compare each flight by itself" if common is None else "each flight has its own time"
    return (
        f"the change of {term} about {place} does not come at one {shared} on all flights "
        f"({np.ptp(whole[most]):.1g} s apart): {advice}",
    )


def events_unreached(comparison: Comparison) -> tuple[str, ...]:
    """At which Mach numbers the mechanism that leads begins or ends where not every flight comes by them."""
    leader, found = comparison.ranking[0], dict[tuple[str, str], list[str]]()
    inner = {each.start_s for each in leader.intervals[1:]}  # the others are those of the record
    ends = inner.intersection(end for each in leader.acting for end in (each.start_s, each.stop_s))
    digits = decimals([knot.mach for knot in leader.knots])
    for knot in leader.knots:
        by_reach = [
            " and ".join(str(k) for k, own in enumerate(knot.flights_s, start=1) if (own is None) == missed)
            for missed in (False, True)
        ]
        if all(by_reach) and knot.time_s in ends:
            found.setdefault((by_reach[0], by_reach[1]), []).append(f"{knot.mach:.{digits}f}")
    return tuple(
        f"that {leader.mechanism} changes at Mach {' and '.join(machs)} is known from flight {known} alone: flight "
        f"{missing} does not come by there"
        for (known, missing), machs in found.items()
    )


def delays_at_bounds(fit: HypothesisFit) -> tuple[str, ...]:
    """Delays, and what else terms depend on, that lie at an end of what is searched."""
    searched = [(each, *each.bounds) for each in fit.nonlinear if each.kind == "theta"]
    return tuple(
        f"{each.mechanism} {each.name} is {each.value:.3g} {each.units}, at the end of the range searched, "
        f"{low:.3g} to {high:.3g} {each.units}: its standard error knows nothing of what lies beyond"
        for each, low, high in searched
        if min(each.value - low, high - each.value) <= _AT_BOUND * min(abs(each.value), high - low)
    )


def collinear(terms: Sequence[TermEstimate], covariance: FloatArray) -> dict[str, Any]:
    """Fields of a result: pairs of coefficients that are nearly collinear, with their numbers, and what they form."""
    labels = [term.begins for term in terms]
    pairs = collinear_pairs(covariance).values()
    named = tuple(f"{labels[j]}, {labels[k]}: {numbers}" for j, k, numbers in pairs)
    return {"collinear": named, "collinear_groups": collinear_groups(labels, covariance)}


def _timed(column: Regressor) -> str:
    """Its label with the time that it begins at."""
    start = column.time_basis.start
    return column.label + (f" at {start:.2f} s" if np.isfinite(start) else "")


def best_by_size(problem: Problem, fits: Sequence[HypothesisFit], none: Criteria) -> tuple[SizedModel, ...]:
    """The best subsets, on the grid of knots and delays, of the likeliest hypothesis that has a mechanism. `none`:
    criteria of the baseline alone, by which C_p has its variance.
    """
    searched = [fit for fit in fits if fit.mechanisms]
    if not searched:
        return ()
    (_, _, best), n = on_grid(problem, likeliest(searched).mechanisms), problem.response.size
    forced = round(n * none.expected_variance / none.adjusted_rss)  # the baseline's p, by (b) and (f)
    variance = none.rss / (none.cp + n - 2 * forced)
    sized = [(0, none.rss, ()), *((size, *found) for size, found in sorted(best.items()))]
    return tuple(
        SizedModel(n_terms=size, n_coefficients=p, cp=rss / variance - n + 2 * p, terms=tuple(map(_timed, columns)))
        for size, rss, columns in sized
        for p in (forced + size,)
    )


class _AsJudged(NamedTuple):
    """A hypothesis with its processes: what it does not explain of rates and force (frame rows,); and as moments, C_m +
    i C_n (frame rows,), that, what its mechanisms make, without and with processes, and the first without processes.
    """

    rest: Channels
    residual: ComplexArray
    mechanisms: ComplexArray
    with_processes: ComplexArray
    bare: ComplexArray


def _as_judged(judged: Judged, place: int) -> _AsJudged:
    """A hypothesis at the mode of its evidence, errors of the record with it."""
    own, fit = judged.evidences[place], judged.fits[place]
    problem = own.rows.problem
    frame, columns, values = derivatives.beside_its_processes(own, fit)
    rest = problem.left(frame, columns, values, problem.others_beside(frame, columns, values))
    made = frame.columns(fit.selected) @ fit.values[fit.baseline_size :]
    beside = frame.columns(columns[len(fit.columns) :]) @ values[len(fit.columns) :]
    without = judged.problem.left(fit.frame, fit.columns, *judged.problem.solution(fit.frame, fit.columns))
    rates = np.stack([rest.rates, made, made + beside, without.rates], axis=1)
    return _AsJudged(rest, *residual_moments(frame, problem.records, rates).body.T)


def _series(
    judged: Judged, flight: int, found: Mapping[str, _AsJudged], best: str | None, known: Reconstruction
) -> Series:
    """Histories of a flight, whose motion is `known`: of hypotheses `found`, and of the `best` mechanism alone."""
    own, problem, leader = judged.leading.evidence, judged.problem, judged.leading.fit
    frame, rest, motion = problem.frame, found[leader.name].rest, problem.frame.motions[flight]
    observed = residual_moments(frame, problem.records, frame.observed)
    bodies = [observed.body, *(observed.body - each.bare for each in found.values())]
    bodies += [each.residual for each in found.values()]
    if best is not None:
        own_moments = found[best].mechanisms
        bodies += [found[best].residual + own_moments, own_moments, found[best].with_processes]
    samples, chosen = [], []
    channels: list[FloatArray] = []  # a segment each: every channel as measured and as modelled
    for segment, (a, b) in zip(frame.segments, frame.pieces, strict=True):
        if segment.flight == flight:
            turn = np.exp(-1j * problem.records[flight].spin_angle[segment.rows])
            rates, force = frame.observed[a:b] * turn, problem.force[a:b]
            modelled = (rates - (rest.rates[a:b] - np.mean(rest.rates[a:b])) * turn, force - rest.force[a:b])
            pairs = zip((rates, force), modelled, strict=True)
            every = slice(None, None, max(1, -(-(b - a) // MOST_DRAWN)))
            parts = [part(each) for pair in pairs for part in (np.real, np.imag) for each in pair]
            channels.append(np.stack(parts)[:, every])
            samples.append(np.arange(segment.rows.start, segment.rows.stop)[every])
            chosen.append(np.arange(a, b)[every])
    kept, rows = np.concatenate(samples), np.concatenate(chosen)
    bodies = [np.where(observed.usable, each, np.nan)[rows] for each in bodies]  # the filter's ends hold nothing
    planes = [plane_from_body(each, motion.windward_meridian[kept]) for each in bodies]
    moments = [(tuple(each.real.tolist()), tuple(each.imag.tolist())) for each in planes]
    drawn, count = list(map(tuple, np.concatenate(channels, axis=1).tolist())), 1 + len(found)
    return Series(
        measured=moments[0],
        sigma=tuple(observed.noise[rows].tolist()),
        fitted=dict(zip(found, moments[1:], strict=False)),
        residuals=dict(zip(found, moments[count:], strict=False)),
        alone=() if best is None else tuple(moments[-3:]),
        channels=dict(zip(_CHANNELS, zip(drawn[::2], drawn[1::2], strict=True), strict=True)),
        whitened=whitened(own, flight),
        histories=_histories(own, flight),
        **motion_histories(known, kept),
    )


def _histories(own: Evidence, flight: int) -> dict[str, Any]:
    """Of each process by name, at even times of a flight; of a moment with the rms of its shapes about there."""
    processes, found, motion = processes_by_name(), dict[str, Any](), own.rows.frame.motions[flight]
    for place, group in enumerate(own.rows.groups):
        process, made = processes[group.name], np.ones((1, 1))
        known = derivatives.process_history(own, place, process.splines, flight, np.linspace(0.0, 1.0, _TIMES))
        if isinstance(process, MomentProcess):
            squares = np.array_split(np.abs(np.array(process.shapes(motion))) ** 2, _TIMES, axis=1)
            local = np.sqrt(np.stack([part.mean(axis=1) for part in squares], axis=1))
            made = local / rms_of_shapes(process, motion)
        pairs = zip(*((made * each).tolist() for each in known), strict=True)
        found[group.name] = tuple((tuple(each), tuple(error)) for each, error in pairs)
    return found


def whitened(own: Evidence, flight: int) -> dict[str, tuple[float, ...]]:
    """The residual beside all processes at unit noise, by channel, in axes that do not roll."""
    rows = own.rows.blocks[flight].rows
    residual, counted = (each[rows].reshape(len(_CHANNELS), -1) for each in (own.residual, own.rows.counted))
    parts = (residual[:, counted[0]] / own.noise).tolist()
    return {name: tuple(part) for name, part in zip(_CHANNELS, parts, strict=True)}
