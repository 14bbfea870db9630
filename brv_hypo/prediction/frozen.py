"""A model that was found on other flights on this one, its coefficients fixed but for what is fitted here.

Fitted are how this flight's motion began and what `refit` names. Entrance: `frozen_on`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from brv_hypo.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from brv_hypo.errors import UsageError
from brv_hypo.flight import load_flight
from brv_hypo.flight.record import Flight
from brv_hypo.inference.derivatives import scale_variance
from brv_hypo.inference.refinement import prediction_slopes, shift_sigma
from brv_hypo.io.text import times
from brv_hypo.linearisation.channels import first_values
from brv_hypo.linearisation.linear import solve_scaled
from brv_hypo.linearisation.nuisance import Errors
from brv_hypo.mechanisms.conformance import sample_motion, uniform_time
from brv_hypo.mechanisms.contract import Mechanism, RecordEffect
from brv_hypo.mechanisms.registry import find_installed, installed, nuisance_effects, nuisance_mechanisms
from brv_hypo.model.baseline import StaticBend
from brv_hypo.model.model import Model, SavedModel, digest, restored
from brv_hypo.tracing.baseline import is_bend
from brv_hypo.tracing.fit import Corrected, Fit, Flights, correct, fitted_about, next_corrections
from brv_hypo.tracing.result import TRACED_SMALLEST, TraceConfig

PREDICTED_LINEARISATIONS = 2  # where errors of the record are fitted
_OF_THE_MOTION = ("motion", "force")  # what every fit finds anew: how the flight began, and the force that shows it
CUTOFF = 1e-12  # singular values of what is fitted that count, of the largest
_Spans = Sequence[tuple[float, float]]
INSTRUMENTS = "instruments"  # what `refit` calls all errors of record and vehicle that the tolerances allow


@dataclass(frozen=True)
class FrozenModel:
    """A model on a flight, where it is known if that is enough of the record."""

    content: SavedModel
    fit: Fit  # the errors of record and vehicle are fixed too, unless refitted
    places: IntArray  # of its columns in the file
    left_out: tuple[str, ...]  # mechanisms that belong to times of the model's own flights, unless this is one
    here: bool  # whether this is a record that the model was found on
    own_spans: _Spans  # from when to when, s, another record has its samples

    @property
    def fixed(self) -> FloatArray:
        """Frozen coefficients (columns,), NaN where they are fitted here."""
        return self.fit.known[: self.places.size]

    @property
    def known(self) -> IntArray:
        """Columns of the frozen coefficients."""
        return np.flatnonzero(np.isfinite(self.fixed))

    @cached_property
    def covariances(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Of the frozen coefficients where they were found, that without processes, and what errors of pressure and
        inertia of both flights add.
        """
        places, values = self.places[self.known], self.fixed[self.known]
        stated, bare = (each[np.ix_(places, places)] for each in self.content.known_covariance)
        return stated, bare, 2.0 * scale_variance(self.fit.problem) * np.outer(values, values)

    @cached_property
    def within(self) -> Fit:
        """The same with record and vehicle free to err within their tolerances."""
        return _freed(self.fit, tolerated(self.fit.data.flights[0]))

    @cached_property
    def own(self) -> Fit:
        """The same model with all of its coefficients fitted here too."""
        return _freed(self.within, tuple(column.mechanism for column in self.fit.model.columns))

    @cached_property
    def flown(self) -> BoolArray:
        """Where the model is known, less its own samples (rows,)."""
        return _flown(self.content, self.fit.data, self.own_spans)

    @cached_property
    def moved_by_times(self) -> ComplexArray:
        """What a sigma of each delay and knot, with shifts by filters, does to the rates (frame rows, parameters)."""
        fit, step = self.fit, shift_sigma(self.fit.data.flights[0].step)
        saved = [self.content.columns[self.places[each.columns[0]]].time_errors for each in fit.nonlinear]
        known = [errors.get(each.name, 0.0) for errors, each in zip(saved, fit.nonlinear, strict=True)]
        sigmas = np.hypot(known, [step * (each.kind == "knot") for each in fit.nonlinear])
        return np.asarray(prediction_slopes(fit.nonlinear, self.fit.model.columns, fit.values, fit.data.frame) * sigmas)

    @property
    def agreed(self) -> tuple[FloatArray, FloatArray]:
        """Coefficients (columns,) and nuisances (unknowns,) where frozen coefficients may differ by what they are known
        to: exact ones err at the expense of the record, whose errors were 15 tolerances beside a coefficient 0.8 % off.
        """
        known, (_, bare, of_scale) = self.known, self.covariances
        mechanisms = tuple(column.mechanism for column in self.fit.model.columns)
        design, values, free = _freed(self.fit, mechanisms).all_unknowns
        variances, directions = np.linalg.eigh(bare + of_scale)
        inverse = (directions / np.sqrt(np.maximum(variances, CUTOFF * variances.max(initial=0.0)))).T
        prior = np.zeros((known.size, design.shape[1]))
        prior[:, known] = inverse
        response = self.fit.problem.raw_response - design @ np.where(free, 0.0, values)
        both = np.vstack([design, prior])[:, free]
        values[free] = solve_scaled(both, np.append(response, inverse @ self.fixed[known]))
        return values[: self.places.size], values[values.size - len(self.fit.nuisances) :]


def frozen_on(flight: Flight, content: SavedModel, refit: tuple[str, ...], config: TraceConfig) -> FrozenModel:
    """The model on this flight; UsageError where what `refit` names cannot be fitted here."""
    number = _found_on(content, flight)
    here = number is not None
    content = content.of_as_many(1) if number is None else content.of_flight(number)
    if here:  # all of it was flown
        content = content.model_copy(update={"flown": {}})
    own_spans = [] if here else _own_spans(content, flight)
    model = restored(content, (flight,), frozen=True)
    columns, place = model.columns, {column: k for k, column in enumerate(model.columns)}
    refit = tuple(_in_model(model, name) for name in refit)
    to_refit = {column for column in columns if {column.mechanism, column.term} & set(refit)}
    changes = [c.time_basis.start for c in to_refit if c.time_basis.kind != "constant"]
    ends = flight.time[[0, -1]].tolist()
    if changes and len(content.times) == 1 and not any(ends[0] < each < ends[1] for each in changes):
        where = f"--refit {','.join(refit)}: its times are the model's, and none is within the record, {times(*ends)}"
        raise UsageError(f"{where}: it cannot be estimated. Leave it out, or give the record the model's clock.")
    if not here:  # without what belongs to the times and to the instruments of its own flights
        kept = tuple(c for c, lasts in zip(columns, model.lasting, strict=True) if lasts or c in to_refit)
        model = model.but(columns=kept, applied=())
    left_out = tuple(dict.fromkeys(c.mechanism for c in columns if c not in model.columns))
    source = Flights((flight,), config)
    model, effects = _with_refitted(model, refit, source)
    own_errors = {(each.effect, each.component): each.value for each in content.errors if here}
    known = {column: saved.value for column, saved in zip(columns, content.columns, strict=True)}
    fixed = np.array([np.nan if c in to_refit else known.get(c, np.nan) for c in model.columns], dtype=float)

    def read_with(corrections: Errors, own: FloatArray | None = None) -> Fit:
        """The model where these are taken out of the record and `effects` are free within their tolerances. A delay
        looks back to the moment that this flight's `own` coefficients (columns,) make, plain ones where not given.
        """
        data = correct(source, model, (corrections,))
        there = _flown(content, data, own_spans)
        part = data.part_where(there) if there.sum() >= TRACED_SMALLEST else data.whole
        values = first_values(data.frame, data.whole, model.columns) if own is None else own
        data = data.with_in_plane_moment(model.columns, values)
        fit = fitted_about(data, model, np.where(np.isnan(fixed), values, fixed))
        # What has no prior was found on this very record, and is taken out of it; so are errors that are known.
        held = fixed.tolist()
        for item in fit.nuisances:
            beyond = (own_errors.get((item.name, item.component), 0.0) - (item.applied or 0.0)) / item.size
            free = item.name in (*_OF_THE_MOTION, *effects)
            held.append(np.nan if free else beyond if np.isfinite(item.present) else 0.0)
        return replace(fit, problem=fit.problem.on(part), known=np.array(held))

    places = np.array([place.get(column, -1) for column in model.columns])
    corrections = next_corrections(0, flight, model, own_errors, {})
    delays, own = any(column.theta for column in model.columns), fixed if here else None
    found = list[tuple[float, FrozenModel]]()
    for _ in range(1 + PREDICTED_LINEARISATIONS * bool(effects or (delays and not here))):
        last = read_with(corrections, own)
        there = FrozenModel(content, last, places, left_out, here, own_spans)
        own, errors = there.agreed
        mine = np.array([False] * len(model.columns) + [item.name in effects for item in last.nuisances])
        fitted = np.append(np.full(len(model.columns), np.nan), errors)
        last = replace(last, known=np.where(mine, fitted, last.known))
        found.append((there.fit.left.mean_square(), replace(there, fit=last)))
        beside = last.problem.rows.nuisances.values(errors, 1)[0]
        free = {name: value for name, value in beside.items() if name[0] in effects}
        corrections = next_corrections(0, flight, model, free, corrections)
    # A record that the model explains badly may have another motion without them, which it explains worse. The first is
    # about a plain moment, whose errors are those of a lag's fraction.
    about = found[-PREDICTED_LINEARISATIONS:] if delays else found
    return min(about, key=lambda each: each[0])[1]


def _freed(fit: Fit, names: tuple[str, ...]) -> Fit:
    """The same with record and vehicle free to err: these effects, and the columns of these mechanisms."""
    own = [*(column.mechanism for column in fit.model.columns), *(item.name for item in fit.nuisances)]
    return replace(fit, known=np.where(np.isin(own, names), np.nan, fit.known))


def _flown(content: SavedModel, data: Corrected, own_spans: _Spans) -> BoolArray:
    """Where the model's flights flew in Mach number and angle of attack, less its own record (rows,)."""
    motion, samples = data.frame.motions[0], data.frame.samples(0)
    there = np.ones(samples.size, dtype=bool)
    for name, (low, high) in content.flown.items():
        values = getattr(motion, name)[samples]
        there &= ~((values < low) | (values > high))
    for start, stop in own_spans:
        there &= (data.frame.time < start) | (data.frame.time > stop)
    return there


def _in_model(model: Model, name: str) -> str:
    """The name of the model's bend, where a mechanism of this name is the very same moment; else the name."""
    item = installed()[name].item if name in installed() and StaticBend.name in model.mechanisms else None
    return StaticBend.name if isinstance(item, Mechanism) and is_bend(item, sample_motion(uniform_time())) else name


def _found_on(content: SavedModel, flight: Flight) -> int | None:
    """Which of the model's own records this is, or a part of which; None for another flight, if by the same name."""
    if (own := digest(flight)) in content.digests:
        return content.digests.index(own)
    first, last, path = float(flight.time[0]), float(flight.time[-1]), Path(flight.path)
    spans = [(start, stop) for start, stop in content.times if start <= first and last <= stop]
    if not spans or not path.is_file() or path.name not in {Path(name).name for name in content.found_on}:
        return None
    parts = (digest(load_flight(path).window(*span)) for span in spans)
    return next((content.digests.index(part) for part in parts if part in content.digests), None)


def _own_spans(content: SavedModel, flight: Flight) -> _Spans:
    """From when to when (s) another record has the samples that the model was estimated from."""
    inside = ((a, b) for a, b in content.times if np.sum((flight.time >= a) & (flight.time <= b)) >= TRACED_SMALLEST)
    return [span for span in inside if digest(flight.window(*span)) in content.digests]


def tolerated(flight: Flight) -> tuple[str, ...]:
    """What record and vehicle may err by within their tolerances."""
    return (*(effect.name for effect in nuisance_effects()), *(m.name for m in nuisance_mechanisms(flight)))


def _with_refitted(model: Model, refit: tuple[str, ...], source: Flights) -> tuple[Model, tuple[str, ...]]:
    """The model with refitted mechanisms that it lacks, and which names are of record and vehicle."""
    known, effects = {name for column in model.columns for name in (column.mechanism, column.term)}, list[str]()
    for name in refit:
        item = None if name in known or name == INSTRUMENTS else find_installed(name)
        searched = [parameter.name for parameter in item.parameters()] if isinstance(item, Mechanism) else []
        if isinstance(item, RecordEffect) and not item.carried and name not in {a.effect.name for a in model.applied}:
            searched = ["time"]
        if searched:
            compared = f"`compare --mechanisms {name}`, and by " if isinstance(item, Mechanism) else ""
            raise UsageError(
                f"--refit {name}: the model has no {name} of this flight, and its {searched[0]} is not known: it is "
                f"searched for by {compared}`trace`, whose model then has it. Leave {name} out, or predict with such a "
                "model."
            )
        if isinstance(item, Mechanism):
            model = model.with_terms(item, correct(source, model).frame.motions[0])
        elif item is not None:
            effects.append(name)
        elif name == INSTRUMENTS:
            effects += tolerated(source.records[0])
    return model, tuple(effects)
