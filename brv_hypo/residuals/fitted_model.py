"""A model with its coefficients and its errors on one flight; and the same with an effect added."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.constants import MODEL_CORRECTIONS, MODEL_LINEARISATIONS, MODEL_OWN_POINTS, MODEL_PLAUSIBLE, MODEL_TRIFLE
from brv_hypo.flight.record import Flight
from brv_hypo.mechanisms.registry import nuisance_effects
from brv_hypo.regression.fit import fit_hypothesis
from brv_hypo.regression.nuisance import Errors
from brv_hypo.regression.problem import Problem
from brv_hypo.regression.reduced import Reduced
from brv_hypo.regression.refinement import nonlinear_parameters, refine
from brv_hypo.regression.response import LinearisedFlight
from brv_hypo.regression.uncertainty import ResidualMoments, residual_moments
from brv_hypo.residuals.baseline import tolerated
from brv_hypo.residuals.candidates import Candidate
from brv_hypo.residuals.candidates_at_step import Analysis
from brv_hypo.residuals.config import TraceConfig
from brv_hypo.residuals.judge import Prediction, moment_errors
from brv_hypo.residuals.linearisation import Applied, Corrected, Model, correct, with_in_plane_moment
from brv_hypo.residuals.problem import errors_beside, linearised_at, problem_of


@dataclass(frozen=True)
class State:
    """A model with its coefficients (columns,), the flights as they are seen with it, and the moments that it leaves.

    `problem` is the regression that the coefficients are of, and `linear` the flights as it has them.
    """

    model: Model
    data: Corrected
    values: FloatArray
    left: ResidualMoments
    errors: Prediction
    held_out: Prediction
    problem: Problem
    linear: tuple[LinearisedFlight, ...]


def state_of(model: Model, data: Corrected, problem: Problem, linear: tuple[LinearisedFlight, ...]) -> State:
    """The model's coefficients on the fitted part, and its errors."""
    values, others = problem.solution(data.frame, model.columns)
    rates = problem.left(data.frame, model.columns, values, others).rates
    left = residual_moments(data.frame, problem.records, rates)
    errors, held_out = (moment_errors(part, left) for part in (data.fitted, data.held_out))
    return State(model, data, values, left, errors, held_out, problem, linear)


def first_state(model: Model, data: Corrected, config: TraceConfig) -> State:
    """The state of a model of which nothing but its columns is known."""
    return _state_about(data, model, data.values(data.fitted, model.columns), config)


def _state_about(data: Corrected, model: Model, values: FloatArray, config: TraceConfig) -> State:
    """The state of a model that is linearised about coefficients (columns,)."""
    linear = linearised_at(data, model, values)
    return state_of(model, data, problem_of(data, model, linear, config), linear)


def converged_state(flights: Sequence[Flight], model: Model, config: TraceConfig) -> State:
    """The state of a model, linearised where the errors that the tolerances allow are nearly taken out.

    What they do to the reconstruction is not small enough to be linear from the record as it stands. Knots and delays
    of the model are refined there. Last it is linearised about its own coefficients, while it fits better so: the first
    are of the rates' differences, and those of columns that are nearly one are anything. Where it fits worse, much is
    left, errors far beyond their tolerances are linear about no point, and the next is as good as chance.
    """
    state = _converged(flights, model, config)
    for _ in range(MODEL_OWN_POINTS):
        nearer = _state_about(state.data, state.model, state.values, config)
        fall = state.errors.mean_square / nearer.errors.mean_square
        if fall < 1.0 / MODEL_TRIFLE:
            break
        state = nearer
        if fall < MODEL_TRIFLE:
            break
    return state


def _converged(flights: Sequence[Flight], model: Model, config: TraceConfig) -> State:
    state = first_state(model, with_in_plane_moment(correct(flights, model, config), model.columns), config)
    for _ in range(MODEL_LINEARISATIONS):
        found = errors_beside(state.problem, fit_hypothesis(state.problem, "none", ()))
        corrections = [
            next_corrections(number, flight, model, found[number], state.data.corrections[number])
            for number, flight in enumerate(flights)
        ]
        data = with_in_plane_moment(correct(flights, model, config, corrections), model.columns)
        nearer = _refined(first_state(model, data, config))
        if nearer.errors.mean_square > state.errors.mean_square * MODEL_TRIFLE:
            return _about_its_vehicle(state, corrections, config)  # the errors of the record that were found are none
        state, model = nearer, nearer.model
    return state


def _about_its_vehicle(state: State, found: Sequence[Errors], config: TraceConfig) -> State:
    """The state of the same records, linearised where what was found of the vehicle's moments acts."""
    model, data = state.model, state.data
    corrections = []
    for number, flight in enumerate(data.flights):
        of_vehicle = {mechanism.name for mechanism in tolerated(model, flight)}
        own = {name: value for name, value in found[number].items() if name[0] in of_vehicle}
        corrections.append({**data.corrections[number], **own})
    return _state_about(replace(data, corrections=tuple(corrections)), model, state.values, config)


def next_corrections(number: int, flight: Flight, model: Model, found: Errors, before: Errors) -> Errors:
    """What is taken out of one flight's record from here on: its errors within their tolerances.

    `found` are whole errors, with what was taken out `before` in them.
    """
    free = {(a.effect.name, a.component) for a in model.applied if a.flight == number}
    sizes = {(e.name, c.name): c.size for e in nuisance_effects() for c in e.components(flight)}
    of_vehicle = {mechanism.name for mechanism in tolerated(model, flight)}
    known = {name: value for name, value in found.items() if name in sizes or name[0] in of_vehicle}
    most = {name: MODEL_PLAUSIBLE * size for name, size in sizes.items()}
    within = {
        name: float(np.clip(value, -most[name], most[name])) if name in most else value
        for name, value in known.items()
        if name not in free
    }
    return {**before, **within}


def _refined(state: State) -> State:
    """The state with the knots and delays of its model where its regression has them."""
    problem, data = state.problem, state.data
    columns, frame = state.model.columns, problem.frame
    nonlinear = nonlinear_parameters(columns, 0, frame, problem.knots)
    if not nonlinear:
        return state
    known: frozenset[int] = frozenset()
    found = refine(columns, nonlinear, known, Reduced(replace(problem, baseline=()), frame)).columns
    model = replace(state.model, columns=found)
    return state_of(model, with_in_plane_moment(data, found), replace(problem, baseline=found), state.linear)


def with_candidate(
    flights: Sequence[Flight], config: TraceConfig, here: Analysis, state: State, candidate: Candidate
) -> State:
    """The model with the candidate added, fitted to the fitted part of the flights.

    Without an error of the record that it lacked, other errors had taken up some of it: with it they are settled anew,
    where that fits better.
    """
    model = state.model
    if candidate.effect is None:
        known = {**model.mechanisms, **{m.name: m for m in candidate.fit.mechanisms}}
        model = replace(model, mechanisms=known, columns=candidate.fit.columns, added=(*model.added, candidate.name))
        data = replace(state.data, frame=candidate.fit.frame)
        return state_of(model, data, replace(here.problem, frame=data.frame), state.linear)
    values = candidate.fit.values[candidate.fit.baseline_size :]
    applied = tuple(
        Applied(candidate.effect, component.name, component.units, component.size, float(value), number)
        for column, value in zip(candidate.fit.selected, values, strict=True)
        for number, component in [here.components[column.term]]
    )
    model = replace(model, applied=(*model.applied, *applied), added=(*model.added, candidate.name))
    freed = {(each.flight, each.effect.name, each.component) for each in applied}
    corrections = [
        {name: value for name, value in known.items() if (number, *name) not in freed}
        for number, known in enumerate(state.data.corrections)
    ]
    data = with_in_plane_moment(correct(flights, model, config, corrections), model.columns)
    linear = linearised_at(data, model, state.values)
    problem = problem_of(data, model, linear, config, noise=here.problem.rows.noise)
    found, anew = state_of(model, data, problem, linear), converged_state(flights, model, config)
    return anew if anew.errors.mean_square * MODEL_TRIFLE < found.errors.mean_square else found


def refitted(flights: Sequence[Flight], config: TraceConfig, state: State) -> State:
    """The state with its errors of the record fitted once more, all together and under the final noise.

    Their first values are those of a reconstruction that the errors themselves had spoilt. The state itself where that
    fits no better.
    """
    best = state
    for _ in range(MODEL_CORRECTIONS if state.model.applied else 0):
        fit = fit_hypothesis(best.problem, "none", ())
        wrong = errors_beside(best.problem, fit)
        applied = tuple(
            replace(a, value=a.value + wrong[a.flight].get((a.effect.name, a.component), 0.0))
            for a in best.model.applied
        )
        model = replace(best.model, applied=applied)
        data = with_in_plane_moment(correct(flights, model, config, best.data.corrections), model.columns)
        linear = linearised_at(data, model, best.values)
        found = state_of(model, data, problem_of(data, model, linear, config, noise=best.problem.rows.noise), linear)
        if found.errors.mean_square > best.errors.mean_square * MODEL_TRIFLE:
            break
        best = found
    return best
