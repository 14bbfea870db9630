"""`predict`: what a model that was found on other flights, its coefficients frozen, says of this one.

The attitude is the integral of the very noise that the rates show, and the static moment follows the attitude: of noise
at a frequency f, the difference of measured and modelled moment has 1 - (f_n / f)^2, f_n being that of the motion
(`noise_share`).
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Unpack

import numpy as np
from threadpoolctl import threadpool_limits

from brv_hypo.arrays import BoolArray, FloatArray, IntArray
from brv_hypo.constants import (
    BAND_FREQUENCIES,
    HELD_OUT_SHORTEST,
    PREDICTED_BLOCKS,
    PREDICTED_LINEARISATIONS,
    TRACED_SMALLEST,
)
from brv_hypo.errors import UnanswerableError
from brv_hypo.flight import FlightSource, one_flight
from brv_hypo.flight.record import Flight
from brv_hypo.mechanisms.contract import Mechanism, current_name
from brv_hypo.mechanisms.registry import find_installed, nuisance_effects, nuisance_mechanisms, record_processes
from brv_hypo.model.term import Regressor, TimeBasis
from brv_hypo.motion import try_record
from brv_hypo.motion.inertial import InertialRecord
from brv_hypo.motion.signals import middle_weights
from brv_hypo.progress import Progress, report_to
from brv_hypo.ranking.summary import flight_summary, record_summary
from brv_hypo.regression.noise import first_noise
from brv_hypo.regression.nuisance import Errors
from brv_hypo.regression.problem import Problem
from brv_hypo.regression.uncertainty import ResidualMoments, residual_moments
from brv_hypo.residuals.config import TraceConfig, TraceSettings
from brv_hypo.residuals.fitted_model import next_corrections
from brv_hypo.residuals.judge import noise_floor
from brv_hypo.residuals.linearisation import Corrected, Model, correct, with_in_plane_moment
from brv_hypo.residuals.local_change import evidence_here, find_difference, find_local_change, held_within
from brv_hypo.residuals.prediction import ErrorsOfPrediction, ModelSource, Prediction, Region
from brv_hypo.residuals.prediction_in_words import Shares, reason
from brv_hypo.residuals.prediction_interval import band_of, error_at, lasting, predictive_sigma
from brv_hypo.residuals.problem import Constrained, constrained, linearised_at, problem_of
from brv_hypo.residuals.restore import column_of, of_as_many, restored
from brv_hypo.residuals.result import Trace
from brv_hypo.residuals.saved import SavedModel, read_model
from brv_hypo.residuals.static_slope import slopes_at
from brv_hypo.residuals.summary import term_estimates
from brv_hypo.settings import settings_of, takes_settings
from brv_hypo.thresholds import REFUSED


def noise_share(record: InertialRecord, stiffness: FloatArray, modes: int) -> FloatArray:
    """Variance of the residual moments' noise over that of the measured ones' (n,).

    `stiffness` (n,) 1/s^2 is the static moment's slope, times its scale; negative where it restores. Slower than the
    `modes` of the walk that is fitted, the noise is dealt with there.
    """
    spin, flight = record.spin_rate, record.flight
    frequency = np.pi * (np.arange(BAND_FREQUENCIES) + 0.5) / BAND_FREQUENCIES
    weights = middle_weights(spin.order, spin.half_width)
    power = np.abs(np.exp(1j * np.outer(frequency, np.arange(weights.size))) @ weights) ** 2
    faster = frequency > np.pi * modes * flight.step / record.time[-1]
    first, second = (float(np.sum((power / frequency**k)[faster]) / np.sum(power)) for k in (2, 4))
    turned = stiffness * flight.step**2
    return np.asarray(1.0 + 2.0 * first * turned + second * turned**2, dtype=float)


# ---- `predict`: what a model that was found on other flights, its coefficients frozen, says of this one ----


# Stretches of the record whose errors are told apart.
_REGIONS = 8
# What every fit finds anew: how the flight began, and the normal force that tells it.
_OF_THE_MOTION = ("motion", "force")
# What `refit` calls all errors of record and vehicle that the tolerances allow.
INSTRUMENTS = "instruments"


@takes_settings(
    TraceConfig,
    model="Trace, SavedModel, str or Path\n    What `trace` returned, the model of it, or a file that holds either.",
    refit="sequence of str\n    What belongs to this vehicle and is fitted here: mechanisms, coefficients, errors of "
    "the record;\n    `instruments` stands for all of these, within their tolerances.",
)
def predict(
    flight: FlightSource,
    model: Trace | SavedModel | str | Path,
    refit: Sequence[str] = (),
    config: TraceConfig | Mapping[str, Any] | str | Path | None = None,
    *,
    progress: Progress | None = None,
    **settings: Unpack[TraceSettings],
) -> Prediction:
    """Errors of the moments that a frozen model predicts for a flight.

    Errors of the record that the model holds are those of its own flight, and are left out, unless this is that flight
    (its file, at its times); so is what belongs to its times, unless `refit` names it.
    What the model left on stretches held out where it was found widens the band. A record that contradicts itself is
    predicted as it is; `record` of the result says so.

    Returns
    -------
    Prediction
        Errors (mean squares of the moment coefficients), by region too, and the prediction interval.

    Examples
    --------
    >>> import brv_hypo
    >>> flown, sister = (brv_hypo.simulate("research_cone", seed=seed, sample_rate=50.0) for seed in (1, 2))
    >>> traced = brv_hypo.trace(flown, effects=["magnus"], discover=False, maximum_likelihood=False)
    >>> brv_hypo.predict(sister, traced).ratio < 0.01
    True
    """
    report_to(progress)(0.0, "predicting the moments")
    saved = model.model.definition if isinstance(model, Trace) else model
    path, chosen = None if isinstance(saved, SavedModel) else Path(saved), settings_of(TraceConfig, config, settings)
    content = of_as_many(saved if isinstance(saved, SavedModel) else read_model(Path(saved)), 1)
    record = one_flight(flight)
    with threadpool_limits(limits=1, user_api="blas"):
        found = _predict(record, content, path, tuple(map(current_name, refit)), _in_blocks(record, chosen))
    return found.model_copy(update={"record": record_summary([try_record(record)[1]])})


def _in_blocks(flight: Flight, config: TraceConfig) -> TraceConfig:
    """The settings with no more blocks than the record has samples for: nothing is chosen by them here."""
    most = flight.samples // HELD_OUT_SHORTEST
    if most < PREDICTED_BLOCKS:
        raise UnanswerableError(
            f"the record holds {flight.samples} samples in the window, expected at least "
            f"{PREDICTED_BLOCKS * HELD_OUT_SHORTEST}: too few to know its motion and noise. Widen --start and --stop."
        )
    return config.model_copy(update={"blocks": min(config.blocks, most)})


@dataclass(frozen=True)
class _Task:
    """The model's columns on this flight; `held` (columns,) their frozen values, NaN where they are refitted.

    `open` makes the problem that has the processes of the record too.
    `left_out` are the mechanisms of columns that belong to the times of the model's own flights; `elsewhere` says that
    this is none of them.
    """

    data: Corrected
    problem: Problem
    open: Callable[[], Problem]
    columns: tuple[Regressor, ...]
    held: FloatArray
    others: FloatArray
    left_out: tuple[str, ...] = ()
    elsewhere: bool = True

    def freed(self, carried: tuple[str, ...]) -> _Task:
        """The same with record and vehicle free to err: the effects `carried`, and the columns of those mechanisms."""
        own = np.array([column.mechanism in carried for column in self.columns], dtype=bool)
        errors = np.array([item.name in carried for item in self.problem.rows.nuisances.items], dtype=bool)
        return replace(self, held=np.where(own, np.nan, self.held), others=np.where(errors, np.nan, self.others))

    def solved(self, held: FloatArray) -> Constrained:
        return constrained(self.problem, self.data.frame, self.columns, held, self.others)

    def moments(self, solved: Constrained) -> ResidualMoments:
        return residual_moments(self.data.frame, self.problem.records, solved.left.rates)

    def noise(self, measured: ResidualMoments, values: FloatArray) -> FloatArray:
        """1-sigma (rows,) of the gyros' noise in the residual moments, the coefficients being `values` (columns,)."""
        record, motion = self.problem.records[0], self.data.reconstructions[0].motion
        slopes = slopes_at(self.data, motion, self.columns, 0, motion.alpha) @ values
        stiffness = (slopes * record.moment_scale)[self.data.samples_of(0)]
        modes = self.problem.rows.nuisances.correlated.size // 2
        return np.asarray(measured.noise * np.sqrt(noise_share(record, stiffness, modes)), dtype=float)


def _predict(
    flight: Flight, content: SavedModel, path: Path | None, refit: tuple[str, ...], config: TraceConfig
) -> Prediction:
    task = _task(flight, content, refit, config)
    frozen = task.solved(task.held)
    own = task.moments(task.solved(np.full(len(task.columns), np.nan)))
    measured = residual_moments(task.data.frame, task.problem.records, task.data.frame.observed)
    left = task.moments(frozen)
    carried = _carried(flight)
    freed = task.freed(carried)
    within = freed.solved(freed.held)
    left_within = freed.moments(within)
    errors = ErrorsOfPrediction(
        without=_mean_square(measured),
        frozen=_mean_square(left),
        own=_mean_square(own),
        noise=noise_floor(task.data.whole, measured),
    )
    covariance = frozen.covariance.copy()
    known = np.flatnonzero(np.isfinite(task.held))
    covariance[np.ix_(known, known)] = _covariance_of(content, task, known)
    flown = _flown(content.flown, task.data)
    mach = task.data.reconstructions[0].motion.mach[task.data.samples_of(0)]
    beyond = error_at(content.error, mach, elsewhere=task.elsewhere)
    known_by = covariance[np.ix_(known, known)]
    alone, beside = evidence_here(task.open().on(task.problem.rows.part), task.columns)
    better = max(alone, beside, key=lambda each: each.level)
    change = find_local_change(held_within(alone, task.columns, task.held, known_by))
    difference = find_difference(better, task.columns, task.held, known_by)
    remain = np.flatnonzero(np.isfinite(freed.held))
    noise, fitted = task.noise(measured, within.values), np.isnan(np.concatenate([freed.held, freed.others]))
    known_by = covariance[np.ix_(remain, remain)]
    sigma = predictive_sigma(freed.problem, freed.data.frame, freed.columns, known_by, fitted, noise, beyond)
    band = band_of(task.data.frame.time, measured, left_within, sigma, beyond, flown)
    remedy = _remedy(task, refit, carried)
    shares = Shares(
        left=_beyond(errors.frozen, errors.without, errors.noise),
        freed=_beyond(_mean_square(left_within), errors.without, errors.noise),
        frozen=_explained(measured, left, errors.noise, flown),
        own=_explained(measured, own, errors.noise, flown),
        flown=float(flown.mean()),
    )
    terms = term_estimates(task.data, task.columns, frozen.values, covariance)
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
        regions=_regions(task.data, measured, left),
        local_change=change,
        difference=difference,
        refused=change is not None or (difference is not None and difference.p_value < REFUSED),
        left_out=task.left_out,
        reason=reason(shares, band, errors.noise, remedy, task.left_out, (change, difference)),
    )


def _covariance_of(content: SavedModel, task: _Task, known: IntArray) -> FloatArray:
    """Covariance of the frozen coefficients, as the model's own file says; by their errors alone where it has none.

    Not on its own flights, it is that of the coefficients that were fitted without what belongs to those alone.
    """
    told = (content.covariance_elsewhere or content.covariance) if task.elsewhere else content.covariance
    errors = np.array([column.std_error or 0.0 for column in content.columns])
    whole = np.array(told) if told else np.diag(errors**2)
    mechanisms = task.data.frame.mechanisms
    place = {column_of(c, mechanisms[c.mechanism]): k for k, c in enumerate(content.columns)}
    order = [place[task.columns[k]] for k in known]
    return np.asarray(whole[np.ix_(order, order)], dtype=float)


def _task(flight: Flight, content: SavedModel, refit: tuple[str, ...], config: TraceConfig) -> _Task:
    whole = restored(content, (flight,), frozen=True)
    here = _is_found_on(content, flight)
    model = whole if here else _of_any_flight(whole, refit)
    coefficients = dict(zip(whole.columns, (column.value for column in content.columns), strict=True))
    if not here:
        anew = zip(whole.columns, (column.elsewhere for column in content.columns), strict=True)
        coefficients.update({column: value for column, value in anew if value is not None})
    left_out = tuple(dict.fromkeys(c.mechanism for c in whole.columns if c not in model.columns))
    effects = _effects(refit, model, flight)
    model = _with_refitted(model, refit, flight, config)
    free = {c for c in model.columns if {c.mechanism, c.term} & set(refit) or c not in coefficients}
    held = np.array([np.nan if c in free else coefficients[c] for c in model.columns], dtype=float)
    corrections: Errors = {}
    task = _seen_with(flight, model, held, effects, corrections, config, content.flown)
    for _ in range(PREDICTED_LINEARISATIONS if effects else 0):
        found = task.problem.rows.nuisances.values(task.solved(held).others, 1)[0]
        own = {name: value for name, value in found.items() if name[0] in effects}
        corrections = next_corrections(0, flight, model, own, corrections)
        task = _seen_with(flight, model, held, effects, corrections, config, content.flown)
    return replace(task, left_out=left_out, elsewhere=not here)


def _of_any_flight(model: Model, refit: tuple[str, ...]) -> Model:
    """The model without what belongs to the times and to the instruments of its own flights."""
    lasts = lasting(model.columns, model.mechanisms)
    kept = (c for c, own in zip(model.columns, lasts, strict=True) if own or {c.mechanism, c.term} & set(refit))
    return replace(model, columns=tuple(kept), applied=())


def _is_found_on(content: SavedModel, flight: Flight) -> bool:
    """Whether the model was found on this very record at these times: then its times and errors are the flight's."""
    first, last = float(flight.time[0]), float(flight.time[-1])
    return flight.path is not None and any(
        Path(flight.path).resolve() == Path(name).resolve() and start <= first and last <= stop
        for name, (start, stop) in zip(content.found_on, content.times, strict=False)
    )


def _seen_with(
    flight: Flight,
    model: Model,
    held: FloatArray,
    effects: tuple[str, ...],
    corrections: Errors,
    config: TraceConfig,
    flown: Mapping[str, tuple[float, float]],
) -> _Task:
    """The task where `corrections` is taken out of the record and `effects` are free within their tolerances.

    What is fitted here is fitted where the model is known, if that is enough of the record.
    """
    data = with_in_plane_moment(correct((flight,), model, config, (corrections,)), model.columns)
    start = np.where(np.isnan(held), data.values(data.whole, model.columns), held)
    there = _flown(flown, data)
    part = data.part_where(there) if there.sum() >= TRACED_SMALLEST else data.whole
    linear = linearised_at(data, model, start)
    problem = problem_of(data, model, linear, config).on(part)
    items = problem.rows.nuisances.items
    # What has no prior was found on this very record, and is taken out of it.
    known = ((item.name, item.present if np.isfinite(item.present) else 0.0) for item in items)
    others = np.array([np.nan if name in (*_OF_THE_MOTION, *effects) else value for name, value in known])
    processes = partial(problem_of, data, model, linear, config, None, first_noise(linear), record_processes())
    return _Task(data, problem, processes, model.columns, held, others)


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
    return (*(effect.name for effect in nuisance_effects()), *(m.name for m in nuisance_mechanisms(flight)))


def _remedy(task: _Task, refit: tuple[str, ...], carried: tuple[str, ...]) -> str:
    """What `--refit` would name as well to let record and vehicle err; nothing where all of it is fitted already."""
    held = {column.mechanism for column, value in zip(task.columns, task.held, strict=True) if np.isfinite(value)}
    more = [*(name for name in carried if name in held), *(() if INSTRUMENTS in refit else (INSTRUMENTS,))]
    return ",".join((*refit, *more)) if more else ""


def _with_refitted(model: Model, refit: tuple[str, ...], flight: Flight, config: TraceConfig) -> Model:
    """The model with the constant columns of mechanisms that it lacks and that are to be fitted here."""
    known = {name for column in model.columns for name in (column.mechanism, column.term)}
    always = TimeBasis("constant")
    for name in refit:
        item = None if name in known or name == INSTRUMENTS else find_installed(name)
        if isinstance(item, Mechanism):
            motion = correct((flight,), model, config).reconstructions[0].motion
            more = [Regressor(name, term.name, (), always, term.units) for term in item.terms(motion, {})]
            mechanisms = {**model.mechanisms, name: item}
            model = replace(model, mechanisms=mechanisms, columns=(*model.columns, *more))
    return model


def _mean_square(moments: ResidualMoments, kept: BoolArray | None = None) -> float:
    """Of both coefficients, over all that are usable or over what is kept of them (rows,)."""
    return float(np.mean(np.abs(moments.body[moments.usable if kept is None else kept]) ** 2) / 2.0)


def _regions(data: Corrected, measured: ResidualMoments, left: ResidualMoments) -> tuple[Region, ...]:
    """Errors over even stretches of the record, with the Mach numbers that each runs through."""
    time, mach = data.frame.time, data.reconstructions[0].motion.mach[data.samples_of(0)]
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


def _flown(ends: Mapping[str, tuple[float, float]], data: Corrected) -> BoolArray:
    """Where the flights that the model was found on flew in Mach number and angle of attack (rows,)."""
    motion, samples = data.reconstructions[0].motion, data.samples_of(0)
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
    without, error = (_mean_square(each, kept) for each in (measured, left))
    return 1.0 - _beyond(error, without, noise)


def _beyond(error: float, without: float, noise: float) -> float:
    """A mean square as a share of that without a model, noise aside."""
    return max(error - noise, 0.0) / max(without - noise, 1e-300)
