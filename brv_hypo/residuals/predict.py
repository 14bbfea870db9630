"""`predict`: what a model that was found on other flights, its coefficients frozen, says of this one."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from brv_hypo.arrays import FloatArray
from brv_hypo.flight import FlightSource, one_flight
from brv_hypo.flight.record import Flight
from brv_hypo.mechanisms.contract import Mechanism
from brv_hypo.mechanisms.registry import find_installed
from brv_hypo.model.columns import Column
from brv_hypo.model.time_variation import TimeFunction
from brv_hypo.ranking.summary import flight_summary
from brv_hypo.regression.problem import Problem
from brv_hypo.regression.residual_moments import ResidualMoments, residual_moments
from brv_hypo.residuals.config import TraceConfig
from brv_hypo.residuals.judge import noise_floor
from brv_hypo.residuals.linearisation import Model, Seen, see, with_in_plane_moment
from brv_hypo.residuals.model_file import read_model
from brv_hypo.residuals.prediction import ErrorsOfPrediction, ModelSource, Prediction, Region
from brv_hypo.residuals.problem import Constrained, constrained, linearised_at, problem_of
from brv_hypo.residuals.restore import column_of, restored
from brv_hypo.residuals.saved import SavedModel
from brv_hypo.residuals.summary import term_estimates

# Stretches of the record whose errors are told apart.
_REGIONS = 8
# What every fit finds anew: how the flight began, and the normal force that tells it.
_OF_THE_MOTION = ("motion", "force")


def predict(
    flight: FlightSource,
    model: SavedModel | str | Path,
    refit: Sequence[str] = (),
    config: TraceConfig | None = None,
) -> Prediction:
    """Errors of the moments that a frozen model predicts for a flight.

    `refit` names what belongs to this vehicle and is fitted here: mechanisms, coefficients, errors of the record.
    Errors of the record that the model holds are those of its own flight, and are left out.
    Raises UsageError where the model holds no coefficients or `refit` names what is not there.
    """
    path = None if isinstance(model, SavedModel) else Path(model)
    content = model if isinstance(model, SavedModel) else read_model(Path(model))
    record = one_flight(flight)
    with threadpool_limits(limits=1, user_api="blas"):
        return _predict(record, content, path, tuple(refit), config or TraceConfig())


@dataclass(frozen=True)
class _Task:
    """The model's columns on this flight; `held` (columns,) their frozen values, NaN where they are refitted."""

    seen: Seen
    problem: Problem
    columns: tuple[Column, ...]
    held: FloatArray
    others: FloatArray

    def solved(self, held: FloatArray) -> Constrained:
        return constrained(self.problem, self.seen.frame, self.columns, held, self.others)

    def moments(self, solved: Constrained) -> ResidualMoments:
        return residual_moments(self.seen.frame, self.problem.records, solved.left.rates)


def _predict(
    flight: Flight, content: SavedModel, path: Path | None, refit: tuple[str, ...], config: TraceConfig
) -> Prediction:
    task = _task(flight, content, refit, config)
    frozen = task.solved(task.held)
    own = task.moments(task.solved(np.full(len(task.columns), np.nan)))
    measured = residual_moments(task.seen.frame, task.problem.records, task.seen.frame.observed)
    left = task.moments(frozen)
    errors = ErrorsOfPrediction(
        without=_mean_square(measured),
        frozen=_mean_square(left),
        own=_mean_square(own),
        noise=noise_floor(task.seen.whole, task.seen.reconstruction),
    )
    covariance = frozen.covariance.copy()
    known = np.flatnonzero(np.isfinite(task.held))
    if content.covariance:
        known_by = task.seen.frame.mechanisms
        place = {column_of(c, known_by[c.mechanism]): k for k, c in enumerate(content.columns)}
        order = [place[task.columns[k]] for k in known]
        covariance[np.ix_(known, known)] = np.array(content.covariance)[np.ix_(order, order)]
    terms = term_estimates(task.seen, task.columns, frozen.values, covariance)
    return Prediction(
        flight=flight_summary(flight),
        model=ModelSource(path=None if path is None else str(path), found_on=content.found_on),
        frozen=tuple(terms[k] for k in known),
        refitted=tuple(term for k, term in enumerate(terms) if k not in known),
        error=errors,
        ratio=errors.frozen / errors.without,
        regions=_regions(task.seen, measured, left),
        reason=_reason(errors),
    )


def _task(flight: Flight, content: SavedModel, refit: tuple[str, ...], config: TraceConfig) -> _Task:
    model = replace(restored(content, flight), applied=())
    coefficients = dict(zip(model.columns, (column.value for column in content.columns), strict=True))
    effects = _effects(refit, model)
    model = _with_refitted(model, refit, flight, config)
    seen = with_in_plane_moment(see(flight, model, config), model.columns)
    free = {c for c in model.columns if {c.mechanism, c.term} & set(refit) or c not in coefficients}
    held = np.array([np.nan if c in free else coefficients[c] for c in model.columns], dtype=float)
    start = np.where(np.isnan(held), seen.values(seen.whole, model.columns), held)
    problem = problem_of(seen, model, linearised_at(seen, model, start), config).on(seen.whole)
    items = problem.rows.nuisances.items
    others = np.array([np.nan if item.name in (*_OF_THE_MOTION, *effects) else item.present for item in items])
    return _Task(seen, problem, model.columns, held, others)


def _effects(refit: tuple[str, ...], model: Model) -> tuple[str, ...]:
    """The names among `refit` that are errors of the record; UsageError for those that nothing has."""
    known = {name for column in model.columns for name in (column.mechanism, column.term)}
    others = (name for name in refit if name not in known)
    return tuple(name for name in others if not isinstance(find_installed(name), Mechanism))


def _with_refitted(model: Model, refit: tuple[str, ...], flight: Flight, config: TraceConfig) -> Model:
    """The model with the constant columns of mechanisms that it lacks and that are to be fitted here."""
    known = {name for column in model.columns for name in (column.mechanism, column.term)}
    always = TimeFunction("constant")
    for name in refit:
        item = None if name in known else find_installed(name)
        if isinstance(item, Mechanism):
            motion = see(flight, model, config).reconstruction.motion
            more = [Column(name, term.name, (), always, term.units) for term in item.terms(motion, {})]
            mechanisms = {**model.mechanisms, name: item}
            model = replace(model, mechanisms=mechanisms, columns=(*model.columns, *more))
    return model


def _mean_square(moments: ResidualMoments) -> float:
    return float(np.mean(np.abs(moments.body[moments.usable]) ** 2) / 2.0)


def _regions(seen: Seen, measured: ResidualMoments, left: ResidualMoments) -> tuple[Region, ...]:
    """Errors over even stretches of the record, with the Mach numbers that each runs through."""
    samples = np.concatenate([np.arange(s.rows.start, s.rows.stop) for s in seen.frame.segments])
    time, mach = seen.frame.time, seen.reconstruction.motion.mach[samples]
    edges = np.linspace(time.min(), time.max(), _REGIONS + 1)
    found = []
    for start, stop in itertools.pairwise(edges):
        inside = (time >= start) & (time <= stop) & left.usable
        if not np.any(inside):
            continue
        own = mach[inside]
        found.append(
            Region(
                start_s=float(start),
                stop_s=float(stop),
                mach=(float(own.min()), float(own.max())) if np.all(np.isfinite(own)) else None,
                ratio=float(np.sum(np.abs(left.body[inside]) ** 2) / np.sum(np.abs(measured.body[inside]) ** 2)),
            )
        )
    return tuple(found)


def _reason(errors: ErrorsOfPrediction) -> str:
    """The outcome in a sentence."""
    signal = max(errors.without - errors.noise, 1e-300)
    explained, best = (1.0 - max(e - errors.noise, 0.0) / signal for e in (errors.frozen, errors.own))
    return (
        f"The frozen model explains {100.0 * explained:.1f} % of the moments' mean square, noise aside; "
        f"the same model fitted to this flight explains {100.0 * best:.1f} %."
    )
