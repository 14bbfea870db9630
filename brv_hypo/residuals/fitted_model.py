"""A model with its coefficients and its errors on one flight; and the same with an effect added."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.flight.record import Flight
from brv_hypo.regression.whitening import NoiseModel, difference
from brv_hypo.residuals.candidates import Candidate
from brv_hypo.residuals.candidates_at_step import Look, bare_look
from brv_hypo.residuals.config import TraceConfig
from brv_hypo.residuals.judge import Prediction, ResidualMoments, moment_errors, residual_moments
from brv_hypo.residuals.linearisation import Applied, Model, Seen, see, with_in_plane_moment
from brv_hypo.residuals.problem import TraceTask, solution, unknown_values

# How often the values of record effects are corrected in the end; how much the error may grow by it, as noise moves it.
_CORRECTIONS = 2
_TRIFLE = 1.01


@dataclass(frozen=True)
class State:
    """A model with its coefficients, the flight as it is seen with it, and the moments that it leaves.

    `task` is the regression that the coefficients are of; None before the first look.
    """

    model: Model
    seen: Seen
    values: FloatArray
    noise: NoiseModel
    left: ResidualMoments
    errors: Prediction
    held_out: Prediction
    task: TraceTask | None


def state_of(model: Model, seen: Seen, noise: NoiseModel, task: TraceTask | None) -> State:
    """The model's coefficients on the fitted part, and its errors.

    A model that lacks something fits the moments badly under the noise of one that does not; plain least
    squares of the moments are tried too, and the smaller error of the fitted part decides.
    """
    nothing = np.zeros(seen.record.time.size, dtype=complex)
    answers = [(seen.values(seen.fitted, model.columns, difference()), nothing)]
    if task is not None:
        answers.append(solution(task, seen.frame, model.columns))
    found = []
    for values, others in answers:
        left = residual_moments(seen.frame, seen.record, model.columns, values, others)
        errors, held_out = (moment_errors(part, left) for part in (seen.fitted, seen.held_out))
        found.append(State(model, seen, values, noise, left, errors, held_out, task))
    return min(found, key=lambda state: state.errors.mean_square)


def with_candidate(
    flight: Flight, config: TraceConfig, here: Look, state: State, candidate: Candidate
) -> State:
    """The model with the candidate added, fitted to the fitted part of `flight`."""
    model = state.model
    if candidate.effect is None:
        known = {**model.mechanisms, **{m.name: m for m in candidate.fit.mechanisms}}
        model = replace(
            model, mechanisms=known, columns=candidate.fit.columns, added=(*model.added, candidate.name)
        )
        seen = replace(state.seen, frame=candidate.fit.frame)
        return state_of(model, seen, here.task.noise, here.task)
    values = candidate.fit.values[candidate.fit.baseline_size :]
    sizes = {component: (units, size) for component, units, size in candidate.effect.components(flight)}
    applied = tuple(
        Applied(candidate.effect, component, *sizes[component], float(value))
        for column, value in zip(candidate.fit.selected, values, strict=True)
        for component in [here.components[column.term]]
    )
    model = replace(model, applied=(*model.applied, *applied), added=(*model.added, candidate.name))
    seen = with_in_plane_moment(see(flight, model, config), model.columns)
    task = bare_look(seen, model, state.values, here.task.both).task
    return state_of(model, seen, here.task.noise, task)


def refitted(flight: Flight, config: TraceConfig, state: State) -> State:
    """The state with its errors of the record fitted once more, all together and under the final noise.

    Their first values are those of a reconstruction that the errors themselves had spoilt. The state itself where that
    fits no better.
    """
    best = state
    for _ in range(_CORRECTIONS if state.model.applied else 0):
        assert best.task is not None
        wrong = unknown_values(best.task, best.seen.frame, best.model.columns)
        applied = tuple(replace(a, value=a.value + wrong[a.name]) for a in best.model.applied)
        model = replace(best.model, applied=applied)
        seen = with_in_plane_moment(see(flight, model, config), model.columns)
        task = bare_look(seen, model, best.values, best.task.both).task
        found = state_of(model, seen, best.noise, task)
        if found.errors.mean_square > best.errors.mean_square * _TRIFLE:
            break
        best = found
    return best
