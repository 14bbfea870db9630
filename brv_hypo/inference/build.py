"""From reconstructed flights to the least-squares problem: the entrance of this package."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from brv_hypo.arrays import BoolArray, ComplexArray, FloatArray
from brv_hypo.inference.fit import HypothesisFit
from brv_hypo.inference.noise import first_noise
from brv_hypo.inference.problem import GivenColumns, Problem, WhitenedRows
from brv_hypo.linearisation.channels import ForceModel, first_values, whole
from brv_hypo.linearisation.frame import RateFrame
from brv_hypo.linearisation.nuisance import Errors, nuisances, with_shared
from brv_hypo.linearisation.response import LinearisedFlight
from brv_hypo.mechanisms.contract import Mechanism, RecordEffect
from brv_hypo.model.baseline import PitchDamping, StaticMoment
from brv_hypo.model.term import Regressor
from brv_hypo.motion.inertial import InertialRecord

FORCE_SPIKE = 7.2  # residuals of the normal force, in their median, from which a sample is a spike
FORCE_SPIKE_ROUNDS = 2  # of the force's fit without spikes
ERRORS_REACH = 1e-3  # probability of errors under their tolerances, down to which they are taken out as they are


def baseline_columns(frame: RateFrame) -> tuple[Regressor, ...]:
    """The columns of the static moment and of pitch damping that the frame knows."""
    return tuple(
        Regressor(name, term.name, units=term.units)
        for name in (StaticMoment.name, PitchDamping.name)
        for term in frame.mechanisms[name].terms(frame.motions[0], {})
    )


@dataclass(frozen=True)
class LinearisationPoint:
    """A moment model with `values` (columns,), and every flight's `errors` (SI), taken out of the records before."""

    mechanisms: tuple[Mechanism, ...]
    columns: tuple[Regressor, ...]
    values: FloatArray
    errors: tuple[Errors, ...]


def build_problem(
    frame: RateFrame,
    records: Sequence[InertialRecord],
    baseline: tuple[Regressor, ...],
    effects: Sequence[RecordEffect],
    vehicle: Sequence[Mechanism],
    knots: FloatArray,
    max_terms: int,
    exact_terms: int,
    refine: bool = True,
    point: LinearisationPoint | None = None,
) -> Problem:
    """The problem of reconstructed flights, linearised about a moment model, under the white noise of the records.
    `records` are the flights' inertial records; `effects` and `vehicle` are carried in every hypothesis. Without a
    `point` the model is the baseline's first fit, and nothing was taken out of the records.
    """
    if point is None:
        nothing: tuple[Errors, ...] = tuple({} for _ in records)
        every = whole(frame, np.ones(frame.observed.size, dtype=bool))
        point = LinearisationPoint((), baseline, first_values(frame, every, baseline), nothing)
    # What the design of the vehicle makes of C_mw is the same on all flights.
    designed = [mechanism for mechanism in vehicle if mechanism.wind_fixed]
    designing, columns, values = with_vehicle(frame, (), np.zeros(0), designed, point.errors[0])
    frame = replace(designing, design=designing.in_plane_moments(columns, values))
    known = frame.with_mechanisms(point.mechanisms)
    if point.mechanisms:
        known = known.with_in_plane_moment(point.columns, point.values)
    flights = linearised_flights(known, records, point.columns, point.values, vehicle, point.errors)
    force, valid = on_rows(frame, flights)
    carried = nuisances(frame, flights, effects, vehicle, corrections=point.errors)
    rows = WhitenedRows(whole(frame, valid), first_noise(flights), carried)
    given = frame.with_mechanisms([GivenColumns()])
    return Problem(given, tuple(records), force, rows, baseline, knots, max_terms, exact_terms, refine)


def carrying(problem: Problem, mechanism: Mechanism) -> Problem:
    """The problem that carries one more mechanism of which all flights have the same, linearised as it was."""
    frame = problem.frame.with_mechanisms([mechanism])
    nuisances = with_shared(problem.rows.nuisances, frame, mechanism)
    return replace(problem, frame=frame, rows=replace(problem.rows, nuisances=nuisances))


def point_of(problem: Problem, fit: HypothesisFit) -> LinearisationPoint:
    """The point at a fit, and the errors that go with it."""
    values, others = problem.solution(fit.frame, fit.columns)
    return LinearisationPoint(fit.mechanisms, fit.columns, values, within_reach(problem, others))


def within_reach(problem: Problem, others: FloatArray) -> tuple[Errors, ...]:
    """Fitted errors (unknowns,) in SI, one mapping a flight; scaled down to where their tolerances make them probable.
    A moment that is not in the model yet poses as errors of many tolerances; the record without them is another flight.
    """
    nuisances = problem.rows.nuisances
    shift = nuisances.present - others[nuisances.bounded]
    farthest = float(stats.chi2.isf(ERRORS_REACH, shift.size)) if shift.size else 0.0
    scale = min(1.0, float(np.sqrt(farthest / max(float(shift @ shift), 1e-300))))
    errors = nuisances.values(others, len(problem.records))
    return tuple({key: scale * value for key, value in own.items()} for own in errors)


def with_vehicle(
    frame: RateFrame, baseline: tuple[Regressor, ...], values: FloatArray, vehicle: Sequence[Mechanism], known: Errors
) -> tuple[RateFrame, tuple[Regressor, ...], FloatArray]:
    """Frame, columns and coefficients with the moments of the vehicle's own errors, where they are known."""
    own = {
        Regressor(mechanism.name, term.name, units=term.units): known[mechanism.name, term.name]
        for mechanism in vehicle
        for term in mechanism.terms(frame.motions[0], {})
        if (mechanism.name, term.name) in known
    }
    return frame.with_mechanisms(vehicle), (*baseline, *own), np.append(values, list(own.values()))


def linearised_flights(
    frame: RateFrame,
    records: Sequence[InertialRecord],
    columns: tuple[Regressor, ...],
    values: FloatArray,
    vehicle: Sequence[Mechanism],
    errors: Sequence[Errors],
) -> tuple[LinearisedFlight, ...]:
    """Every flight about its columns of a moment model with `values` (columns,) and known errors of its vehicle."""
    found = []
    for number, (record, known) in enumerate(zip(records, errors, strict=True)):
        own = [k for k, column in enumerate(columns) if column.acts_on(number)]
        about = with_vehicle(frame, tuple(columns[k] for k in own), values[own], vehicle, known)
        found.append(linearised(record, number, *about))
    return tuple(found)


def linearised(
    record: InertialRecord, flight: int, frame: RateFrame, columns: tuple[Regressor, ...], values: FloatArray
) -> LinearisedFlight:
    """A flight with its moment model and the normal force that fits it, spikes left out."""
    known = frame.reconstructions[flight]
    slope = known.normal_force_slope  # NaN where the method has none
    force = ForceModel(np.where(np.isfinite(slope), slope, 1.0), known.normal_force_bend)
    found = force.columns(record, known.crossflow)
    valid = record.measured
    for _ in range(FORCE_SPIKE_ROUNDS):
        parts = found[valid], record.transverse_force[valid]
        columns_there, force_there = (np.concatenate([part.real, part.imag]) for part in parts)
        force_values = np.linalg.lstsq(columns_there, force_there, rcond=None)[0]
        size = np.abs(record.transverse_force - found @ force_values)
        valid = record.measured & (size <= FORCE_SPIKE * np.median(size[record.measured]) + 1e-12)
    return LinearisedFlight(record, known, frame.mechanisms, columns, values, force, force_values, valid)


def on_rows(frame: RateFrame, flights: Sequence[LinearisedFlight]) -> tuple[ComplexArray, BoolArray]:
    """Transverse force and where it may be used, on the rows of the frame (rows,)."""
    force = [flights[s.flight].record.transverse_force[s.rows] for s in frame.segments]
    valid = [flights[s.flight].force_valid[s.rows] for s in frame.segments]
    return np.concatenate(force), np.concatenate(valid)
