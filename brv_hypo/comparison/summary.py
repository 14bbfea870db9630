"""The result of a comparison, gathered: rows of the ranking, terms with errors, sentences where criteria disagree."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from typing import Any

import numpy as np

from brv_hypo.arrays import FloatArray, IntArray
from brv_hypo.comparison import result
from brv_hypo.comparison.intervals import channel_of, estimate, intervals, out_of_bounds
from brv_hypo.flight.record import VEHICLE_DIMENSIONS, Flight, RecordTrial
from brv_hypo.identification import Identification
from brv_hypo.inference.fit import HypothesisFit
from brv_hypo.inference.problem import Problem
from brv_hypo.inference.refinement import has_width
from brv_hypo.io.text import hypothesis, times
from brv_hypo.linearisation.frame import RateFrame
from brv_hypo.model.baseline import PitchDamping, SlopeSchedule, StaticBend, StaticMoment
from brv_hypo.model.model import SavedColumn
from brv_hypo.model.term import BASELINE, Choice, Regressor
from brv_hypo.motion.reconstruction import Reconstruction
from brv_hypo.motion.signals import rms
from brv_hypo.subset.criteria import Criteria
from brv_hypo.thresholds import SPECIFIC

_OF_THE_BASELINE = (StaticMoment.name, PitchDamping.name, StaticBend.name, SlopeSchedule.name)
_LEFT_OUT = "ranked by regression alone: set maximum_likelihood to full to have its likelihood fit too"


def criteria_disagree(ranking: Sequence[result.RankedHypothesis], probability: Mapping[str, float]) -> tuple[str, ...]:
    """A sentence on which hypothesis each criterion puts first, where these are not all one; else nothing. The F-ratio
    is none of `none`: it is against it. No probability comes first where none is left for the list.
    """
    if len(ranking) < 2:
        return ()
    first, named = dict[str, str](), [row for row in ranking if probability.get(row.mechanism, 0.0) > 0.0]
    impossible = {row.mechanism: f" (with {row.impossible})" for row in ranking if row.impossible}
    if tested := [row for row in ranking if row.f_ratio is not None]:
        first["F-ratio"] = max(tested, key=lambda row: row.f_ratio or 0.0).mechanism
    first["C_p"] = min(ranking, key=lambda row: row.cp).mechanism
    first["prediction error"] = min(ranking, key=lambda row: row.prediction_error).mechanism
    if named:
        first["probability"] = max(named, key=lambda row: probability[row.mechanism]).mechanism
    if len(set(first.values())) == 1:
        return ()
    leaders = []
    for each in dict.fromkeys(first.values()):
        names = [name for name, leader in first.items() if leader == each]
        joined = " and ".join(filter(None, (", ".join(names[:-1]), names[-1])))
        leaders.append(f"{joined}: {hypothesis(each)}{impossible.get(each, '')}")
    return (f"the criteria put different hypotheses first: {'; '.join(leaders)}",)


# ---- Turns fits into the result of the contract ----


def summarise(
    problem: Problem,
    fits: Sequence[HypothesisFit],
    errors: Sequence[float],
    criteria: Sequence[Criteria],
    seconds: result.Seconds,
    likelihoods: Mapping[str, Identification | None],
    verdict: result.Verdict,
) -> result.Comparison:
    """Rank the fits, and gather all that the result holds. The baseline is as beside the likeliest: without what moved
    the vehicle, its terms and the errors of the record make up for that.
    """
    null = next(i for i, fit in enumerate(fits) if not fit.mechanisms)
    order = sorted(range(len(fits)), key=lambda i: (fits[i].information, len(fits[i].mechanisms)))
    ranking = tuple(
        _ranked(rank, fits[i], errors[i], criteria[i], errors[null], problem, likelihoods)
        for rank, i in enumerate(order, start=1)
    )
    reconstructions = problem.frame.reconstructions
    return result.Comparison(
        flights=tuple(flight_summary(r.flight) for r in reconstructions),
        reference_flight=None if problem.frame.common is None else problem.frame.common.reference + 1,
        reconstruction=motion_summary(reconstructions),
        baseline=result.BaselineSummary(terms=_terms(fits[order[0]], slice(fits[order[0]].baseline_size))),
        ranking=ranking,
        verdict=verdict,
        seconds=seconds,
        disagreements=criteria_disagree(ranking, verdict.probability),
    )


def motion_summary(
    reconstructions: Sequence[Reconstruction], moved: Sequence[float] = (0.0,)
) -> result.ReconstructionSummary:
    """How well the motions of all flights are known, how far a model `moved` them (rad), and what limits them."""
    return result.ReconstructionSummary(
        method=reconstructions[0].method,
        alpha_rms_sigma_rad=rms(np.array([r.alpha_rms_sigma for r in reconstructions])),
        phi_w_rms_sigma_rad=rms(np.array([r.phi_w_rms_sigma for r in reconstructions])),
        moved_rad=rms(np.array(moved)),
        warnings=tuple(dict.fromkeys(w for r in reconstructions for w in r.warnings if w not in r.own_warnings)),
    )


def flight_summary(flight: Flight, analysed: Flight | None = None) -> result.FlightSummary:
    """The part of a record that was compared, and what was done to it before it was `analysed`."""
    keys, grade = ", ".join(flight.instruments.stated), flight.instruments.grade
    own = (f"tolerances that the record or --instruments states, all others are {grade}: {keys}",) if keys else ()
    return result.FlightSummary(
        path=flight.path,
        samples=flight.samples,
        start_s=float(flight.time[0]),
        stop_s=float(flight.time[-1]),
        sample_rate_hz=flight.sample_rate,
        gaps_s=(analysed or flight).gaps_s,
        title=flight.title,
        instruments=flight.instruments.described,
        vehicle={
            **{name: getattr(flight.vehicle, name) for name in VEHICLE_DIMENSIONS if name != "accelerometer_position"},
            **{name: getattr(flight.instruments, name)[0] for name in ("inertia", "inertia_ratio")},
        },
        notes=(*(analysed or flight).notes, *own),
    )


def record_summary(trials: Sequence[RecordTrial]) -> RecordTrial:
    """What the trials of all flights found."""
    faults = sorted((fault for trial in trials for fault in trial.faults), key=lambda fault: not fault.decisive)
    return RecordTrial(sound=all(trial.sound for trial in trials), faults=tuple(faults))


def refused(flights: Sequence[Flight], trials: Sequence[RecordTrial], method: str) -> result.Comparison:
    """The result for a record that contradicts itself: no ranking, and a verdict that says where."""
    record = record_summary(trials)
    worst = record.faults[0]
    unsound = next(flight for flight, trial in zip(flights, trials, strict=True) if not trial.sound)
    which = f" of {unsound.path or unsound.title}" if len(flights) > 1 else ""
    return result.Comparison(
        flights=tuple(flight_summary(flight) for flight in flights),
        reconstruction=result.ReconstructionSummary(method=method, alpha_rms_sigma_rad=None, phi_w_rms_sigma_rad=None),
        baseline=result.BaselineSummary(terms=()),
        record=record,
        ranking=(),
        verdict=result.Verdict(
            winner=None,
            outcome="record fault",
            equivalent=(),
            probability={},
            reason=f"The record{which} contradicts itself ({worst.fault}: {worst.channel}; "
            f"{times(worst.start_s, worst.stop_s)}): {worst.action}. "
            "`compare --accept-record` compares it nevertheless.",
        ),
        seconds=result.Seconds(reconstruct=0.0, select=0.0, ml=0.0, total=0.0),
    )


def _ranked(
    rank: int,
    fit: HypothesisFit,
    error: float,
    criteria: Criteria,
    null_error: float,
    problem: Problem,
    likelihoods: Mapping[str, Identification | None],
) -> result.RankedHypothesis:
    total = float(problem.response @ problem.response)
    variance = fit.rss / fit.samples
    bare = replace(fit, values=problem.solution(fit.frame, fit.columns)[0], ends=False)
    excess = out_of_bounds(bare) if fit.selected else None
    return result.RankedHypothesis(
        rank=rank,
        mechanism=fit.name,
        f_ratio=criteria.f_ratio if fit.selected else None,
        cp=criteria.cp,
        prediction_error=error,
        prediction_ratio=error / null_error,
        r2=1.0 - fit.rss / total,
        bic=fit.bic,
        log_evidence=float("nan") if fit.log_evidence is None else fit.log_evidence - 0.5 * fit.bound_cost,
        log_likelihood=-0.5 * fit.effective * (np.log(2.0 * np.pi * variance) + 1.0),
        n_terms=len(fit.selected),
        n_effective=fit.effective,
        terms=_terms(fit, slice(fit.baseline_size, None)),
        columns=tuple(map(SavedColumn.of, fit.selected)),
        intervals=intervals(fit),
        derived=_derived(fit),
        knots=_knots(fit),
        criteria=asdict(criteria),
        status="term limit" if len(fit.selected) >= problem.max_terms else "ok",
        impossible=excess.words if excess is not None and 0.5 * excess.sigmas**2 > SPECIFIC else "",
        notes=(_LEFT_OUT,) if likelihoods.get(fit.name, True) is None else (),
        ml=_likelihood(fit, likelihoods.get(fit.name)),
    )


def estimates(
    columns: Sequence[Regressor], values: FloatArray, covariance: FloatArray, frame: RateFrame
) -> tuple[result.TermEstimate, ...]:
    """Coefficients (columns,) with the standard errors of their covariance, as a result has them."""
    sigmas, found = np.sqrt(np.maximum(np.diag(covariance), 0.0)).tolist(), []
    for column, value, sigma in zip(columns, values.tolist(), sigmas, strict=True):
        mechanism = BASELINE if column.mechanism in _OF_THE_BASELINE else column.mechanism
        where = {"channel": channel_of(column, frame), "region_s": _region(frame, column), "delay_s": column.delay}
        label = column.label + of_flight(frame, column.flight)
        found.append(estimate(label, mechanism, value, sigma, column.units, **where))
    return tuple(found)


def of_flight(frame: RateFrame, number: int | None) -> str:
    """Which flight a term is of, where there are several; counted from 1."""
    return "" if number is None or len(frame.motions) == 1 else f" [flight {number + 1}]"


def _terms(fit: HypothesisFit, indices: slice) -> tuple[result.TermEstimate, ...]:
    return estimates(fit.columns[indices], fit.values[indices], fit.covariance[indices, indices], fit.frame)


def _region(frame: RateFrame, column: Regressor) -> tuple[float, float] | None:
    """Where the column acts, on the clock of time bases (s); None where it does everywhere."""
    if column.time_basis.kind == "constant":
        return None
    time = frame.coefficient_time if column.flight is None else frame.motions[column.flight].time
    return max(column.time_basis.start, float(time.min())), min(column.time_basis.stop, float(time.max()))


def _knots(fit: HypothesisFit) -> tuple[result.Knot, ...]:
    """The ends of its columns' regions by Mach number, in time order; none where flights have their own times."""
    common = fit.frame.common
    if common is None:
        return ()
    edges = {edge for column in fit.selected for edge in _region(fit.frame, column) or ()}
    return tuple(
        result.Knot(
            time_s=edge,
            mach=common.mach(edge),
            flights_s=tuple(own.own_at(edge) if own.flies(edge) else None for own in common.flights),
        )
        for edge in sorted(edges)
    )


def _likelihood(fit: HypothesisFit, found: Identification | None) -> result.MaximumLikelihood | None:
    """The contract's block; None where the hypothesis was out of reach."""
    if found is None:
        return None
    refined = replace(
        fit, columns=found.columns, values=found.values, nonlinear=(), joint_covariance=found.covariance, left_out=None
    )
    return result.MaximumLikelihood(
        status=found.status,
        message=found.message,
        iterations=found.iterations,
        log_likelihood=found.log_likelihood,
        terms=_terms(refined, slice(fit.baseline_size, None)),
        derived=tuple(
            result.DerivedEstimate(name=e.name, value=e.value, std_error=e.std_error, units=e.units)
            for e in found.nonlinear
        ),
        instrument=tuple(
            estimate(e.name, "instrument", e.value, e.std_error, e.units, channel="record") for e in found.instruments
        ),
        knots=_knots(refined),
        seconds=found.seconds,
    )


def _derived(fit: HypothesisFit) -> tuple[result.DerivedEstimate, ...]:
    found, end = [], float(fit.frame.coefficient_time.max())
    for own, sigma in zip(fit.nonlinear, fit.nonlinear_errors, strict=True):
        name = f"{own.mechanism} {own.name}"
        found.append(result.DerivedEstimate(name=name, value=own.value, std_error=sigma, units=own.units))
    vectors: dict[Choice, list[int]] = {}
    for j, column in enumerate(fit.columns):
        if column.grouped:
            vectors.setdefault(column.choice, []).append(j)
    for (name, _, _, time_basis, _), members in vectors.items():
        over = time_basis.final if has_width(time_basis) else 1.0  # of what comes on over a time, all of it
        values = {fit.columns[j].term: over * float(fit.values[j]) for j in members}
        covariance = over**2 * fit.covariance[np.ix_(members, members)]
        region = None if time_basis.kind == "constant" else (time_basis.start, end)
        found.extend(
            result.DerivedEstimate(name=d.name, value=d.value, std_error=d.std_error, units=d.units, region_s=region)
            for d in fit.frame.mechanisms[name].derived(values, covariance)
        )
    return tuple(found)


def motion_histories(reconstruction: Reconstruction, kept: IntArray) -> dict[str, Any]:
    """Fields of `MotionHistories` at some samples of a flight."""
    motion = reconstruction.motion
    histories = {
        "time_s": motion.time,
        "alpha_rad": motion.alpha,
        "alpha_sigma_rad": reconstruction.alpha_sigma,
        "windward_meridian_rad": motion.windward_meridian,
        "windward_meridian_sigma_rad": reconstruction.phi_w_sigma,
        "roll_rate_rad_s": motion.p,
        "windward_meridian_rate_rad_s": motion.windward_meridian_rate,
        "mach": motion.mach,
        "dynamic_pressure_pa": motion.dynamic_pressure,
    }
    return {name: tuple(values[kept].tolist()) for name, values in histories.items()}
