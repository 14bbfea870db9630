"""From reconstructed flights to the problem that all hypotheses share, linearised where the data say."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.comparison.config import CompareConfig
from brv_hypo.errors import UnanswerableError, UsageError
from brv_hypo.flight.inspection import FILTERED, low_passed
from brv_hypo.flight.record import Flight
from brv_hypo.inference.build import LinearisationPoint, baseline_columns, build_problem, carrying
from brv_hypo.inference.fit import HypothesisFit, fit_hypothesis, self_consistent
from brv_hypo.inference.noise import estimated_noise
from brv_hypo.inference.problem import Problem
from brv_hypo.inference.refinement import shift_sigma
from brv_hypo.linearisation.frame import build_frame
from brv_hypo.linearisation.response import PropagatedMotion, cycles, linearisation_point
from brv_hypo.mechanisms.contract import RecordEffect
from brv_hypo.mechanisms.registry import nuisance_effects, nuisance_mechanisms, record_processes, without
from brv_hypo.model.baseline import PitchDamping, Quantity, StaticBend, StaticMoment, wavering_speeds
from brv_hypo.model.common_time import CommonTime, common_time
from brv_hypo.model.reconstruction import reconstruct
from brv_hypo.model.term import default_knots
from brv_hypo.motion import ReconstructionConfig
from brv_hypo.motion.pipeline import require_answerable
from brv_hypo.motion.reconstruction import Reconstruction
from brv_hypo.motion.signals import ColouredNoise
from brv_hypo.thresholds import EVENTS_APART

# Worked out on the seeds of `tests.studies.independent.study` that validation.md lists, and held by its fresh ones.
COMPARED_SMALLEST = 60  # samples; rule of thumb: four for each of baseline and six terms
# Of noise at the motion's frequency over that of neighbouring samples (correlations above 0.2), used from there on.
COLOURED = 1.5
OFFSET_DEGREE = 1  # Legendre degree in time of the drift of C_m0
SLOPE_DEGREE = 3  # and of that of C_malpha: a speed that falls by a tenth bends it beyond a parabola
APART_SIGMAS = 3.0  # standard deviations within which events of two flights may be one, and beyond which apart in time


@dataclass(frozen=True)
class Reading:
    """How the flights are read, from one linearisation to the next. `known` are the flights reconstructed so, `common`
    is the time that they share, if they do. `static`, `bend`: None until chosen.
    """

    reconstruction: tuple[ReconstructionConfig, ...]
    known: tuple[Reconstruction, ...]
    common: CommonTime | None = None
    static: StaticMoment | None = None
    bend: StaticBend | None = None


def shared_problem(
    reconstructions: Sequence[Reconstruction], config: CompareConfig, common: CommonTime | None = None
) -> tuple[Problem, Reading]:
    """What the hypotheses share, linear about the baseline's first fit, and how the flights are to be reconstructed.
    `common`: the time that flights share, where it is known better than by their Mach numbers. How large the
    instruments' noise is at the frequencies of the motion is known once the motion is subtracted.
    """
    samples = sum(reconstruction.flight.samples for reconstruction in reconstructions)
    if samples < COMPARED_SMALLEST:
        raise UnanswerableError(
            f"the window holds {samples} samples, expected at least {COMPARED_SMALLEST}: too few to "
            "distinguish mechanisms. Widen --start and --stop."
        )
    methods = tuple(ReconstructionConfig(method=config.method) for _ in reconstructions)
    shared = _by_mach(reconstructions) if common is None else common
    reading = Reading(methods, tuple(reconstructions), shared if isinstance(shared, CommonTime) else None)
    problem = _problem(reconstructions, reading, config)
    static, bend = _static_and_bend(problem)
    reading = replace(reading, static=static, bend=bend)
    problem = carrying(problem.under(estimated_noise(problem)), bend)
    return problem, _with_motion_noise(problem, reading)


# ---- The time that flights share ----


def aligned(
    reconstructions: Sequence[Reconstruction], config: CompareConfig, common: CommonTime, fit: HypothesisFit
) -> CommonTime | None:
    """The common time in which the events of a hypothesis come together that each flight has by itself; None where they
    come together already. Mach numbers that err by a factor, and air that is another, move events of flights apart, and
    a step that comes twice looks like an onset that takes time. The shift of a flight is linear in time; it has the
    prior `EVENTS_APART`, and large changes count most.
    """

    def alone(flight: int) -> list[_Event]:
        """The jumps of the fit of a flight by itself; none where it is too short to be compared so."""
        try:
            problem, _ = shared_problem([reconstructions[flight]], config)
        except UnanswerableError:
            return []
        own = self_consistent(problem, fit_hypothesis(problem, fit.name, fit.mechanisms))
        changes = dict[float, dict[str, float]]()
        for column, value in zip(own.selected, own.values[own.baseline_size :], strict=True):
            if column.time_basis.kind == "jump":
                changes.setdefault(column.time_basis.start, {})[column.term] = float(value)
        sizes = [math.hypot(*each.values()) for each in changes.values()]
        # The largest is known to within a sample, others the worse the smaller they are.
        largest = shift_sigma(own.frame.reconstructions[0].flight.step) * max(sizes, default=0.0)
        times = [float(common.flights[flight].common_at(np.array(time))) for time in changes]
        found = zip(times, sizes, changes.values(), strict=True)
        return [_Event(time, largest / max(size, 1e-300), each) for time, size, each in found]

    events = [alone(flight) for flight in range(len(reconstructions))]
    start, stop = common.span
    late, moves = np.zeros((len(events), 2)), False
    for flight, own in enumerate(events):
        pairs = [
            (each.time, each.time - other.time, max(each.sigma, other.sigma))
            for each in own
            for other in events[common.reference]
            if flight != common.reference and each.like(other, APART_SIGMAS * EVENTS_APART * (stop - start))
        ]
        if pairs:
            times, after, sigmas = np.array(pairs).T
            shares = (times - start) / (stop - start)
            ends = np.stack([1.0 - shares, shares], axis=1) / sigmas[:, np.newaxis]
            prior = np.eye(2) / (EVENTS_APART * (stop - start)) ** 2
            late[flight] = np.linalg.solve(ends.T @ ends + prior, ends.T @ (after / sigmas))
            moves |= bool(np.any(np.abs(after) > APART_SIGMAS * sigmas))
    return common.aligned(late) if moves else None


@dataclass(frozen=True)
class _Event:
    """A change of one flight's fit: its common `time` and the error of that, s, and by how much each term changes."""

    time: float
    sigma: float
    changes: Mapping[str, float]

    def like(self, other: _Event, apart: float) -> bool:
        """Whether it comes within so many seconds of another change of the same terms, of like size and direction."""
        if abs(self.time - other.time) > apart or self.changes.keys() != other.changes.keys():
            return False
        mine, theirs = (np.array([each[key] for key in self.changes]) for each in (self.changes, other.changes))
        return float(np.linalg.norm(mine - theirs)) < 0.5 * float(np.linalg.norm(mine) + np.linalg.norm(theirs))


# ---- The problem ----


def _with_motion_noise(problem: Problem, reading: Reading) -> Reading:
    """The same with the noise that instruments have at the motion's frequencies, where that is far more. A motion
    that the fit knows needs no other, but another noise may want another normal force.
    """
    records, lasting = problem.records, problem.rows.noise.lasting
    if lasting is None:
        return reading
    stated = float(np.median([record.gyro_sigma for record in records]))
    rates = float(lasting.rates.sigma_at(lasting.motion)) / stated
    loudness = np.median([np.median(record.force_sigma) for record in records])
    force = float(lasting.force.sigma_at(lasting.motion) / loudness)
    out = []
    for record, setting in zip(records, reading.reconstruction, strict=True):
        raised: dict[str, float | ColouredNoise] = {}
        if rates > COLOURED:
            raised["gyro_sigma"] = rates * record.gyro_sigma
            raised["gyro_walk"] = lasting.rates.times(record.gyro_sigma / stated)
        if force > COLOURED:
            raised["accel_sigma"] = force * record.accel_sigma
        out.append(setting.model_copy(update=raised))
    if tuple(out) == reading.reconstruction:
        return reading
    try:
        known = tuple(reconstruct(rec.flight, setting) for rec, setting in zip(reading.known, out, strict=True))
    except UnanswerableError:
        return reading
    return replace(reading, reconstruction=tuple(out), known=known)


def _static_and_bend(problem: Problem) -> tuple[StaticMoment, StaticBend]:
    """The static moment, and the bend that a body with its slope may have, which drifts as the slope does."""
    static = problem.frame.mechanisms[StaticMoment.name]
    assert isinstance(static, StaticMoment)
    values, _ = problem.solution(problem.frame, problem.baseline)
    by_term = {column.term: float(value) for column, value in zip(problem.baseline, values, strict=True)}
    slopes = [static.mean_slope(motion, by_term) for motion in problem.frame.motions]
    drift: tuple[Quantity, float, float] = (static.by, static.start, static.stop)
    drift = drift if static.speeds is None else ("speed", *static.speeds)
    return static, StaticBend(slope=float(np.mean(slopes)), drift=drift)


def linearised_about(
    problem: Problem, point: LinearisationPoint, reading: Reading, config: CompareConfig
) -> tuple[Problem, Problem]:
    """The problem linearised about a point of it, errors that were found there taken out of the records. With the
    processes of record and air, under white noise; and without, under the noise beside the fit's model. Where a record
    has no motion left without its errors, the records are linearised as they read.
    """
    try:
        records = _without_errors(reading, point)
    except UnanswerableError:
        point = replace(point, errors=tuple({} for _ in point.errors))
        records = _without_errors(reading, point)
    before = zip(problem.records, problem.frame.reconstructions, point.errors, strict=True)
    motions = [PropagatedMotion.of(record, motion).less(record, errors) for record, motion, errors in before]
    processes = record_processes()
    whole = _problem(records, reading, config, point, motions, processes)
    nuisances = whole.rows.nuisances.without(frozenset(each.name for each in processes))
    bare = replace(whole, rows=replace(whole.rows, nuisances=nuisances))
    frame = bare.frame.with_mechanisms(point.mechanisms).with_in_plane_moment(point.columns, point.values)
    return whole, bare.under(estimated_noise(replace(bare, frame=frame, baseline=point.columns)))


def _without_errors(reading: Reading, point: LinearisationPoint) -> list[Reconstruction]:
    """The flights without the errors of a point; their motion is known from the fit."""
    flights = [without(known.flight, errors) for known, errors in zip(reading.known, point.errors, strict=True)]
    for flight in flights:
        require_answerable(flight)
    return [replace(known, flight=flight) for known, flight in zip(reading.known, flights, strict=True)]


def _problem(
    reconstructions: Sequence[Reconstruction],
    reading: Reading,
    config: CompareConfig,
    point: LinearisationPoint | None = None,
    motions: Sequence[PropagatedMotion | None] | None = None,
    processes: Sequence[RecordEffect] = (),
) -> Problem:
    """The problem of the flights, linearised about `motions`, or where the reconstruction's errors are taken out."""
    where = motions or [None] * len(reconstructions)
    points = [linearisation_point(*each) for each in zip(reconstructions, reading.reconstruction, where, strict=True)]
    records, smooth = [record for record, _ in points], [smooth for _, smooth in points]
    static = reading.static or _static(smooth, reading.common)
    bend = () if reading.bend is None else (reading.bend,)
    frame = build_frame(smooth, [static, PitchDamping(), *bend], reading.common)
    span = frame.coefficient_time
    knots = _knots(float(span.min()), float(span.max()), config)
    return build_problem(
        frame,
        records,
        baseline_columns(frame),
        (*nuisance_effects(), *processes),
        (*nuisance_mechanisms(reconstructions[0].flight), *bend),
        knots,
        config.max_terms,
        config.exact_terms,
        config.refine,
        point,
    )


def _knots(start: float, stop: float, config: CompareConfig) -> FloatArray:
    """Times at which coefficients may change, in order; UsageError for one that is not within the record."""
    if config.knots is None:
        return default_knots(start, stop, config.knot_count)
    outside = [knot for knot in config.knots if not start < knot < stop]
    if outside:
        raise UsageError(
            f"knots at {', '.join(f'{knot:g}' for knot in outside)} s, expected times between {start:g} and {stop:g} "
            "s: outside what is analysed nothing can change. Leave them out, or widen --start and --stop."
        )
    return np.unique(config.knots)


def sharing_warnings(reconstructions: Sequence[Reconstruction]) -> tuple[str, ...]:
    """Why several flights do not share terms by Mach number, or which of them shares none; empty for one flight."""
    found = _by_mach(reconstructions)
    if isinstance(found, str):
        return (f"terms begin and end at the same time on every flight, not at the same Mach number: {found}",)
    return tuple(
        f"flight {number + 1} shares no Mach number with another: changes there are determined by it alone"
        for number in (() if found is None else found.apart())
    )


def short_warnings(reconstructions: Sequence[Reconstruction]) -> tuple[str, ...]:
    """Which flights hold less than a cycle of their motion."""
    held = [(rec.flight.path or "the window", cycles(rec.motion)) for rec in reconstructions]
    return tuple(
        f"{name} holds {count:.2g} cycles of the transverse motion, expected one at least, better ten: what acts "
        "throughout can hardly be distinguished from the baseline. Widen --start and --stop."
        for name, count in held
        if count < 1.0
    )


def filter_warnings(flights: Sequence[Flight]) -> tuple[str, ...]:
    """Which records were low-passed; empty where none was."""
    numbers = [str(k) for k, flight in enumerate(flights, start=1) if low_passed(flight)]
    which = f"flight {' and '.join(numbers)}: " if len(flights) > 1 else ""
    return (f"{which}{FILTERED}",) if numbers else ()


def _by_mach(reconstructions: Sequence[Reconstruction]) -> CommonTime | str | None:
    """The time that flights share by their Mach numbers, or why these do not give it; None for one flight."""
    if len(reconstructions) < 2:
        return None
    return common_time([(rec.flight.time, rec.flight.mach) for rec in reconstructions])


def _static(reconstructions: Sequence[Reconstruction], common: CommonTime | None) -> StaticMoment:
    """The static moment with its drift: in time, or, where flights share their Mach numbers, with those."""
    curves = [(rec.flight.time, rec.motion.velocity) for rec in reconstructions]
    span = (min(float(time[0]) for time, _ in curves), max(float(time[-1]) for time, _ in curves))
    if common is not None:  # one curve together: at one Mach number the air is warmer on one flight than on another
        mach = np.concatenate([own.mach for own in common.flights])
        span, curves = common.mach_span, [(mach, np.concatenate([speed for _, speed in curves]))]
    return StaticMoment(
        start=span[0],
        stop=span[1],
        offset_degree=OFFSET_DEGREE,
        slope_degree=SLOPE_DEGREE,
        by="time" if common is None else "mach",
        speeds=wavering_speeds(curves, SLOPE_DEGREE),
    )
