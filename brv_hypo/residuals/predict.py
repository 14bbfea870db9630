"""`predict`: what a model that was found on other flights, its coefficients frozen, says of this one."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from brv_hypo.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from brv_hypo.flight import FlightSource, one_flight
from brv_hypo.flight.record import Flight
from brv_hypo.mechanisms.carried import carried_effects, carried_mechanisms
from brv_hypo.mechanisms.contract import Mechanism
from brv_hypo.mechanisms.registry import find_installed
from brv_hypo.model.columns import Column
from brv_hypo.model.time_variation import TimeFunction
from brv_hypo.ranking.summary import flight_summary
from brv_hypo.regression.nuisance import Errors
from brv_hypo.regression.problem import Problem
from brv_hypo.regression.residual_moments import ResidualMoments, residual_moments
from brv_hypo.residuals.band import band_of, predictive_sigma
from brv_hypo.residuals.config import SMALLEST_RECORD, TraceConfig
from brv_hypo.residuals.fitted_model import taken_out
from brv_hypo.residuals.judge import noise_floor
from brv_hypo.residuals.linearisation import Model, Seen, see, with_in_plane_moment
from brv_hypo.residuals.model_file import read_model
from brv_hypo.residuals.prediction import Band, ErrorsOfPrediction, ModelSource, Prediction, Region
from brv_hypo.residuals.problem import Constrained, constrained, linearised_at, problem_of
from brv_hypo.residuals.restore import column_of, of_as_many, restored
from brv_hypo.residuals.result import Trace
from brv_hypo.residuals.saved import SavedModel
from brv_hypo.residuals.summary import term_estimates

# Stretches of the record whose errors are told apart.
_REGIONS = 8
# Share of the samples where the model's flights flew, from which nothing is said of it.
_NEARLY_ALL = 0.995
# What every fit finds anew: how the flight began, and the normal force that tells it.
_OF_THE_MOTION = ("motion", "force")
# What `refit` calls all errors of record and vehicle that the tolerances allow.
INSTRUMENTS = "instruments"
# Share of the frozen model's mean square, noise aside, below which letting record and vehicle err is worth a word; and
# the share of the moments' mean square below which the frozen model's is small enough to need none.
_GREATLY, _SMALL = 0.5, 0.01
# How often the flight is linearised anew where errors of its record are fitted.
_LINEARISATIONS = 2


def predict(
    flight: FlightSource,
    model: Trace | SavedModel | str | Path,
    refit: Sequence[str] = (),
    config: TraceConfig | None = None,
) -> Prediction:
    """Errors of the moments that a frozen model predicts for a flight.

    `model` is what `trace` returned, the model of it, or a file that holds either.
    `refit` names what belongs to this vehicle and is fitted here: mechanisms, coefficients, errors of the record;
    `instruments` stands for all of these, within their tolerances.
    Errors of the record that the model holds are those of its own flight, and are left out.
    Raises UsageError where the model holds no coefficients or `refit` names what is not there.
    """
    saved = model.model.definition if isinstance(model, Trace) else model
    path = None if isinstance(saved, SavedModel) else Path(saved)
    content = of_as_many(saved if isinstance(saved, SavedModel) else read_model(Path(saved)), 1)
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

    def eased(self, carried: tuple[str, ...]) -> _Task:
        """The same with record and vehicle free to err: the effects `carried`, and the columns of those mechanisms."""
        own = np.array([column.mechanism in carried for column in self.columns], dtype=bool)
        errors = np.array([item.name in carried for item in self.problem.rows.nuisances.items], dtype=bool)
        return replace(
            self, held=np.where(own, np.nan, self.held), others=np.where(errors, np.nan, self.others)
        )

    def solved(self, held: FloatArray) -> Constrained:
        return constrained(self.problem, self.seen.frame, self.columns, held, self.others)

    def moments(self, solved: Constrained) -> ResidualMoments:
        return residual_moments(self.seen.frame, self.problem.records, solved.left.rates)

    def sigma(self, covariance: FloatArray) -> ComplexArray:
        """Standard deviation of the residual moments (rows,), the held coefficients known to their covariance."""
        fitted = np.isnan(np.concatenate([self.held, self.others]))
        noise = self.seen.reconstructions[0].moments.noise_sigma[self.seen.samples_of(0)]
        return predictive_sigma(self.problem, self.seen.frame, self.columns, covariance, fitted, noise)


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
        noise=noise_floor(task.seen.whole, task.seen.frame),
    )
    covariance = frozen.covariance.copy()
    known = np.flatnonzero(np.isfinite(task.held))
    covariance[np.ix_(known, known)] = _covariance_of(content, task, known)
    flown = _flown(content.flown, task.seen)
    band = band_of(task.seen.frame.time, measured, left, task.sigma(covariance[np.ix_(known, known)]), flown)
    carried = _carried(flight)
    eased = task.eased(carried)
    remedy = _remedy(task, refit, carried)
    shares = _Shares(
        left=_beyond(errors.frozen, errors),
        eased=_beyond(_mean_square(eased.moments(eased.solved(eased.held))), errors),
        frozen=_explained(measured, left, errors.noise, flown),
        own=_explained(measured, own, errors.noise, flown),
        flown=float(flown.mean()),
    )
    terms = term_estimates(task.seen, task.columns, frozen.values, covariance)
    return Prediction(
        flight=flight_summary(flight),
        model=ModelSource(path=None if path is None else str(path), found_on=content.found_on),
        frozen=tuple(terms[k] for k in known),
        refitted=tuple(term for k, term in enumerate(terms) if k not in known),
        error=errors,
        ratio=errors.frozen / errors.without,
        explained=shares.frozen,
        flown=shares.flown,
        band=band,
        regions=_regions(task.seen, measured, left),
        reason=_reason(shares, band, remedy),
    )


def _covariance_of(content: SavedModel, task: _Task, known: IntArray) -> FloatArray:
    """Covariance of the frozen coefficients, as the model's own file says; by their errors alone where it has none."""
    errors = np.array([column.std_error or 0.0 for column in content.columns])
    whole = np.array(content.covariance) if content.covariance else np.diag(errors**2)
    mechanisms = task.seen.frame.mechanisms
    place = {column_of(c, mechanisms[c.mechanism]): k for k, c in enumerate(content.columns)}
    order = [place[task.columns[k]] for k in known]
    return np.asarray(whole[np.ix_(order, order)], dtype=float)


def _task(flight: Flight, content: SavedModel, refit: tuple[str, ...], config: TraceConfig) -> _Task:
    model = replace(restored(content, (flight,), frozen=True), applied=())
    coefficients = dict(zip(model.columns, (column.value for column in content.columns), strict=True))
    effects = _effects(refit, model, flight)
    model = _with_refitted(model, refit, flight, config)
    free = {c for c in model.columns if {c.mechanism, c.term} & set(refit) or c not in coefficients}
    held = np.array([np.nan if c in free else coefficients[c] for c in model.columns], dtype=float)
    taken: Errors = {}
    task = _seen_with(flight, model, held, effects, taken, config, content.flown)
    for _ in range(_LINEARISATIONS if effects else 0):
        found = task.problem.rows.nuisances.values(task.solved(held).others, 1)[0]
        own = {name: value for name, value in found.items() if name[0] in effects}
        taken = taken_out(0, flight, model, own, taken)
        task = _seen_with(flight, model, held, effects, taken, config, content.flown)
    return task


def _seen_with(
    flight: Flight,
    model: Model,
    held: FloatArray,
    effects: tuple[str, ...],
    taken: Errors,
    config: TraceConfig,
    flown: Mapping[str, tuple[float, float]],
) -> _Task:
    """The task where `taken` is taken out of the record and `effects` are free within their tolerances.

    What is fitted here is fitted where the model is known, if that is enough of the record.
    """
    seen = with_in_plane_moment(see((flight,), model, config, (taken,)), model.columns)
    start = np.where(np.isnan(held), seen.values(seen.whole, model.columns), held)
    there = _flown(flown, seen)
    part = seen.part_where(there) if there.sum() >= SMALLEST_RECORD else seen.whole
    problem = problem_of(seen, model, linearised_at(seen, model, start), config).on(part)
    items = problem.rows.nuisances.items
    others = np.array([np.nan if item.name in (*_OF_THE_MOTION, *effects) else item.present for item in items])
    return _Task(seen, problem, model.columns, held, others)


def _effects(refit: tuple[str, ...], model: Model, flight: Flight) -> tuple[str, ...]:
    """The names among `refit` that are errors of record or vehicle; UsageError for those that nothing has."""
    known = {name for column in model.columns for name in (column.mechanism, column.term)}
    others = tuple(name for name in refit if name not in known and name != INSTRUMENTS)
    named = tuple(name for name in others if not isinstance(find_installed(name), Mechanism))
    if INSTRUMENTS not in refit:
        return named
    return tuple(dict.fromkeys((*named, *_carried(flight))))


def _carried(flight: Flight) -> tuple[str, ...]:
    """What record and vehicle may err by within their tolerances."""
    return (*(effect.name for effect in carried_effects()), *(m.name for m in carried_mechanisms(flight)))


def _remedy(task: _Task, refit: tuple[str, ...], carried: tuple[str, ...]) -> str:
    """What `--refit` would name as well to let record and vehicle err; nothing where all of it is fitted already."""
    held = {column.mechanism for column, value in zip(task.columns, task.held, strict=True) if np.isfinite(value)}
    more = [*(name for name in carried if name in held), *(() if INSTRUMENTS in refit else (INSTRUMENTS,))]
    return ",".join((*refit, *more)) if more else ""


def _with_refitted(model: Model, refit: tuple[str, ...], flight: Flight, config: TraceConfig) -> Model:
    """The model with the constant columns of mechanisms that it lacks and that are to be fitted here."""
    known = {name for column in model.columns for name in (column.mechanism, column.term)}
    always = TimeFunction("constant")
    for name in refit:
        item = None if name in known or name == INSTRUMENTS else find_installed(name)
        if isinstance(item, Mechanism):
            motion = see((flight,), model, config).reconstructions[0].motion
            more = [Column(name, term.name, (), always, term.units) for term in item.terms(motion, {})]
            mechanisms = {**model.mechanisms, name: item}
            model = replace(model, mechanisms=mechanisms, columns=(*model.columns, *more))
    return model


def _mean_square(moments: ResidualMoments) -> float:
    return float(np.mean(np.abs(moments.body[moments.usable]) ** 2) / 2.0)


def _regions(seen: Seen, measured: ResidualMoments, left: ResidualMoments) -> tuple[Region, ...]:
    """Errors over even stretches of the record, with the Mach numbers that each runs through."""
    time, mach = seen.frame.time, seen.reconstructions[0].motion.mach[seen.samples_of(0)]
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


@dataclass(frozen=True)
class _Shares:
    """What the frozen model explains, and the same model refitted; the share of the samples that both are told of.

    Of the whole record: what the frozen model leaves (`left`), and what it would if record and vehicle erred within
    their tolerances (`eased`).
    """

    left: float
    eased: float
    frozen: float
    own: float
    flown: float


def _flown(ends: Mapping[str, tuple[float, float]], seen: Seen) -> BoolArray:
    """Where the flights that the model was found on flew in Mach number and angle of attack (rows,)."""
    motion, samples = seen.reconstructions[0].motion, seen.samples_of(0)
    there = np.ones(samples.size, dtype=bool)
    for name, (low, high) in ends.items():
        values = getattr(motion, name)[samples]
        there &= ~((values < low) | (values > high))
    return there


def _explained(measured: ResidualMoments, left: ResidualMoments, noise: float, flown: BoolArray) -> float:
    """The share of the moments' mean square, noise aside, that a model explains over some of the samples."""
    kept = left.usable & flown
    if not np.any(kept):
        return 0.0
    without, error = (float(np.mean(np.abs(each.body[kept]) ** 2) / 2.0) for each in (measured, left))
    return 1.0 - max(error - noise, 0.0) / max(without - noise, 1e-300)


def _explains(share: float) -> str:
    """What a model does to a mean square; one that explains less than nothing does not hold."""
    if share > 0.9995:
        return "explains more than 99.9 % of"
    if share >= 0.0:
        return f"explains {100.0 * share:.1f} % of"
    return f"does not hold here, and leaves {1.0 - share:.3g} times"


def _beyond(error: float, errors: ErrorsOfPrediction) -> float:
    """A mean square as a share of that without a model, noise aside."""
    return max(error - errors.noise, 0.0) / max(errors.without - errors.noise, 1e-300)


def _held_too_much(shares: _Shares, remedy: str) -> str:
    """What to do where the model fails, or would fail far less, for what record and vehicle are held not to err by."""
    much = shares.left > _SMALL and shares.eased < _GREATLY * shares.left
    if not remedy or not (much or shares.left > 1.0 or shares.frozen < 0.0):
        return ""
    return (
        f" Over the whole record it leaves {shares.left:.3g} of the mean square. Errors of the record were taken as "
        "none, and those of the vehicle as on the flights that the model was found on; "
        f"`--refit {remedy}` lets this flight have its own"
        + (f", and leaves about {shares.eased:.2g}." if much else ".")
    )


def _reason(shares: _Shares, band: Band, remedy: str) -> str:
    """The outcome in a few sentences."""
    if shares.flown == 0.0:
        nowhere = "The model was found at other Mach numbers or angles of attack throughout: it says nothing here."
        return nowhere + _held_too_much(shares, remedy)
    beyond = (
        f" {100.0 * (1.0 - shares.flown):.0f} % of the samples lie at other Mach numbers or angles of attack than the "
        "model was found at, and are left out of these shares."
    )
    return (
        f"The frozen model {_explains(shares.frozen)} the moments' mean square, noise aside; "
        f"the same model fitted to this flight {_explains(shares.own)} it. The frozen model's "
        f"{100.0 * band.level:.0f} % band holds {100.0 * band.inside:.1f} % of the samples."
        + (beyond if shares.flown < _NEARLY_ALL else "")
        + _held_too_much(shares, remedy)
    )
