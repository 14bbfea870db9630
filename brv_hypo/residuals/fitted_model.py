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
from brv_hypo.residuals.candidates_at_step import Look
from brv_hypo.residuals.config import TraceConfig
from brv_hypo.residuals.judge import Prediction, moment_errors
from brv_hypo.residuals.linearisation import Applied, Model, Seen, see, with_in_plane_moment
from brv_hypo.residuals.problem import errors_beside, linearised_at, problem_of


@dataclass(frozen=True)
class State:
    """A model with its coefficients (columns,), the flights as they are seen with it, and the moments that it leaves.

    `problem` is the regression that the coefficients are of, and `linear` the flights as it has them.
    """

    model: Model
    seen: Seen
    values: FloatArray
    left: ResidualMoments
    errors: Prediction
    held_out: Prediction
    problem: Problem
    linear: tuple[LinearisedFlight, ...]


def state_of(model: Model, seen: Seen, problem: Problem, linear: tuple[LinearisedFlight, ...]) -> State:
    """The model's coefficients on the fitted part, and its errors."""
    values, others = problem.solution(seen.frame, model.columns)
    rates = problem.left(seen.frame, model.columns, values, others).rates
    left = residual_moments(seen.frame, problem.records, rates)
    errors, held_out = (moment_errors(part, left) for part in (seen.fitted, seen.held_out))
    return State(model, seen, values, left, errors, held_out, problem, linear)


def first_state(model: Model, seen: Seen, config: TraceConfig) -> State:
    """The state of a model of which nothing but its columns is known."""
    return _state_about(seen, model, seen.values(seen.fitted, model.columns), config)


def _state_about(seen: Seen, model: Model, values: FloatArray, config: TraceConfig) -> State:
    """The state of a model that is linearised about coefficients (columns,)."""
    linear = linearised_at(seen, model, values)
    return state_of(model, seen, problem_of(seen, model, linear, config), linear)


def settled_state(flights: Sequence[Flight], model: Model, config: TraceConfig) -> State:
    """The state of a model, linearised where the errors that the tolerances allow are nearly taken out.

    What they do to the reconstruction is not small enough to be linear from the record as it stands. Knots and delays
    of the model are refined there. Last it is linearised about its own coefficients, while it fits better so: the first
    are of the rates' differences, and those of columns that are nearly one are anything. Where it fits worse, much is
    left, errors far beyond their tolerances are linear about no point, and the next is as good as chance.
    """
    state = _settled(flights, model, config)
    for _ in range(MODEL_OWN_POINTS):
        nearer = _state_about(state.seen, state.model, state.values, config)
        fall = state.errors.mean_square / nearer.errors.mean_square
        if fall < 1.0 / MODEL_TRIFLE:
            break
        state = nearer
        if fall < MODEL_TRIFLE:
            break
    return state


def _settled(flights: Sequence[Flight], model: Model, config: TraceConfig) -> State:
    state = first_state(model, with_in_plane_moment(see(flights, model, config), model.columns), config)
    for _ in range(MODEL_LINEARISATIONS):
        found = errors_beside(state.problem, fit_hypothesis(state.problem, "none", ()))
        taken = [
            taken_out(number, flight, model, found[number], state.seen.taken[number])
            for number, flight in enumerate(flights)
        ]
        seen = with_in_plane_moment(see(flights, model, config, taken), model.columns)
        nearer = _refined(first_state(model, seen, config))
        if nearer.errors.mean_square > state.errors.mean_square * MODEL_TRIFLE:
            return _about_its_vehicle(state, taken, config)  # the errors of the record that were found are none
        state, model = nearer, nearer.model
    return state


def _about_its_vehicle(state: State, found: Sequence[Errors], config: TraceConfig) -> State:
    """The state of the same records, linearised where what was found of the vehicle's moments acts."""
    model, seen = state.model, state.seen
    taken = []
    for number, flight in enumerate(seen.flights):
        of_vehicle = {mechanism.name for mechanism in tolerated(model, flight)}
        own = {name: value for name, value in found[number].items() if name[0] in of_vehicle}
        taken.append({**seen.taken[number], **own})
    return _state_about(replace(seen, taken=tuple(taken)), model, state.values, config)


def taken_out(number: int, flight: Flight, model: Model, found: Errors, before: Errors) -> Errors:
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
    problem, seen = state.problem, state.seen
    columns, frame = state.model.columns, problem.frame
    nonlinear = nonlinear_parameters(columns, 0, frame, problem.knots)
    if not nonlinear:
        return state
    known: frozenset[int] = frozenset()
    found = refine(columns, nonlinear, known, Reduced(replace(problem, baseline=()), frame)).columns
    model = replace(state.model, columns=found)
    return state_of(model, with_in_plane_moment(seen, found), replace(problem, baseline=found), state.linear)


def with_candidate(
    flights: Sequence[Flight], config: TraceConfig, here: Look, state: State, candidate: Candidate
) -> State:
    """The model with the candidate added, fitted to the fitted part of the flights.

    Without an error of the record that it lacked, other errors had taken up some of it: with it they are settled anew,
    where that fits better.
    """
    model = state.model
    if candidate.effect is None:
        known = {**model.mechanisms, **{m.name: m for m in candidate.fit.mechanisms}}
        model = replace(model, mechanisms=known, columns=candidate.fit.columns, added=(*model.added, candidate.name))
        seen = replace(state.seen, frame=candidate.fit.frame)
        return state_of(model, seen, replace(here.problem, frame=seen.frame), state.linear)
    values = candidate.fit.values[candidate.fit.baseline_size :]
    applied = tuple(
        Applied(candidate.effect, component.name, component.units, component.size, float(value), number)
        for column, value in zip(candidate.fit.selected, values, strict=True)
        for number, component in [here.components[column.term]]
    )
    model = replace(model, applied=(*model.applied, *applied), added=(*model.added, candidate.name))
    freed = {(each.flight, each.effect.name, each.component) for each in applied}
    taken = [
        {name: value for name, value in known.items() if (number, *name) not in freed}
        for number, known in enumerate(state.seen.taken)
    ]
    seen = with_in_plane_moment(see(flights, model, config, taken), model.columns)
    linear = linearised_at(seen, model, state.values)
    problem = problem_of(seen, model, linear, config, noise=here.problem.rows.noise)
    found, anew = state_of(model, seen, problem, linear), settled_state(flights, model, config)
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
        seen = with_in_plane_moment(see(flights, model, config, best.seen.taken), model.columns)
        linear = linearised_at(seen, model, best.values)
        found = state_of(model, seen, problem_of(seen, model, linear, config, noise=best.problem.rows.noise), linear)
        if found.errors.mean_square > best.errors.mean_square * MODEL_TRIFLE:
            break
        best = found
    return best
