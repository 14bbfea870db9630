"""The account of a trace: one step with its candidates, the families that hold the residual, errors before and after.

Entrance: `step_of`. Beside the candidates are those that this flight cannot tell from them, and whether each flight
needs what was added without having had a part in choosing it (`flight_left_out`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from brv_hypo.constants import FINDING_SHOWN
from brv_hypo.flight.record import Flight
from brv_hypo.inference.problem import GIVEN
from brv_hypo.mechanisms.contract import FAMILIES
from brv_hypo.tracing.acceptance import Candidate, Choice, Tried, adjusted, confounded, with_columns
from brv_hypo.tracing.families import beside_processes
from brv_hypo.tracing.fit import Fit, MomentErrors
from brv_hypo.tracing.result import Errors, FlightLeftOut, Step, TriedCandidate, lasting_steps

_REPORTED = 8  # candidates in a step's table


def step_of(number: int, fit: Fit, choice: Choice, earlier: Sequence[Step]) -> Step:
    """One step of the result: the candidates with what was added first, and the errors before and after."""
    leading, accepted = choice.leading, choice.accepted
    before = fit if leading is None else leading.before
    reported, chances = choice.reported[:_REPORTED], adjusted(choice.ranked)
    without_flight, status = None if leading is None else flight_left_out(fit, leading.candidate), None
    if accepted is not None and choice.named_in is not None:
        generic = accepted.candidate.kind == "discovered" and len(fit.data.records) == 1
        elsewhere = None if without_flight is None else without_flight.ratio
        own = accepted.status(choice.named_in, len(choice.ranked), elsewhere)
        status = "hint" if generic or rests_on_hints(earlier) else own
    beside = beside_processes(fit if accepted is None else accepted.fit, fit.model)
    families = beside.shares([accepted.candidate.name] if accepted is not None and accepted.is_established else [])
    return Step(
        step=number,
        residual=fit.residual,
        families={**dict.fromkeys(FAMILIES, 0.0), **{each.family: each.share for each in families}},
        decomposition=families,
        candidates=tuple(
            TriedCandidate(
                effect=each.name,
                kind=each.kind,
                f_ratio=each.f_ratio,
                p_value_adjusted=chances[each.name],
                explains=each.explains,
                description=described(each, fit.data.flights),
                near_equals=confounded(each, reported),
            )
            for each in reported
        ),
        refused=tuple(tried.candidate.name for tried in choice.tried if tried is not accepted),
        unwanted=choice.unwanted,
        evidence_gain=None if accepted is None else accepted.gain,
        added=None if accepted is None else accepted.candidate.name,
        standing=status,
        flight_left_out=without_flight,
        named_in=choice.named_in,
        error_before=_errors(before),
        force_error_before=_force_errors(before),
        **({} if leading is None else _after(leading)),
    )


def described(candidate: Candidate, flights: Sequence[Flight]) -> str:
    """What a candidate says of these flights."""
    if candidate.file is not None:
        return candidate.file.title
    effect, parts = candidate.effect, []
    for column, value in zip(candidate.fit.selected, candidate.fit.values[candidate.fit.baseline_size :], strict=True):
        name, number, when = column.label, column.flight, ""
        if effect is not None:
            number, component, *_ = candidate.variant[column.term]
            name = component.name
        elif column.time_basis.kind != "constant":
            when = f" at {max(column.time_basis.start, float(flights[number or 0].time[0])):.2f} s"
        units = "" if effect is None else f" {column.units}"
        which = "" if number is None or len(flights) == 1 else f" on flight {number + 1}"
        parts.append(f"{name} {value:.3g}{units}{when}{which}")
    time = getattr(effect, "time", None)
    at = "" if time is None else f" at {time:.3f} s"
    where = "" if effect is None or candidate.in_rates > FINDING_SHOWN else " (in the specific force only)"
    return ", ".join(parts) + at + where


def _after(leading: Tried) -> dict[str, Any]:
    """What a step says of the candidate that leads."""
    return {
        "description": described(leading.candidate, leading.before.data.flights),
        "error_after": _errors(leading.fit),
        "error_ratio_held_out": leading.ratio,
        "error_ratio_std_error": leading.ratio_error,
        "force_error_after": _force_errors(leading.after),
        "held_out_score": leading.agreement.fall,
    }


def _errors(fit: Fit) -> Errors:
    return Errors(fit=fit.errors.mean_square, held_out=fit.held_out.mean_square)


def _force_errors(fit: Fit) -> Errors:
    """Mean squares (m/s^2)^2 of the transverse specific force's residual, both axes together."""
    parts = [fit.rest.force[part.rows][part.valid] for part in (fit.data.fitted, fit.data.held_out)]
    fitted, held_out = (float(np.mean(np.abs(part) ** 2) / 2.0) for part in parts)
    return Errors(fit=fitted, held_out=held_out)


def rests_on_hints(earlier: Sequence[Step]) -> bool:
    """Whether the model has what earlier steps added and did not establish.

    What is added beside it may make up for it: a moment that is constant in the body for one that drifts there.
    """
    return any(step.status == "hint" for step in lasting_steps(earlier))


def flight_left_out(fit: Fit, candidate: Candidate) -> FlightLeftOut | None:
    """Errors on each flight without and with the candidate; None for one flight, or where nothing of it is shared."""
    flights = range(len(fit.data.records))
    shared = any(column.flight is None and column.mechanism != GIVEN for column in candidate.fit.selected)
    if len(flights) < 2 or not shared:
        return None
    fits = (fit, with_columns(fit, candidate))
    before, after = ([_predicted(each, number) for number in flights] for each in fits)
    sums = [sum(float(each.squares.sum()) for each in errors) for errors in (before, after)]
    return FlightLeftOut(
        before=tuple(each.mean_square for each in before),
        after=tuple(each.mean_square for each in after),
        ratio=sums[1] / sums[0],
    )


def _predicted(fit: Fit, number: int) -> MomentErrors:
    """Errors on one flight of the shared coefficients that the others have: 0 is fixed, NaN free."""
    data, inside = fit.data, fit.data.frame.flight_of_row == number
    numbers = ([each.flight for each in some] for some in (fit.model.columns, fit.nuisances))
    flights = [np.array([-1 if each is None else each for each in some]) for some in numbers]
    without = [np.where(each == number, 0.0, np.nan) for each in flights]
    known = replace(fit, problem=fit.problem.on(data.part_where(~inside)), fixed=without[0], others=without[1])
    fixed = [
        np.where(each == -1, found, np.where(each == number, np.nan, 0.0))
        for each, found in zip(flights, known.solution, strict=True)
    ]
    part = data.part_where(inside)
    there = replace(fit, problem=fit.problem.on(part), fixed=fixed[0], others=fixed[1])
    return MomentErrors.of(part, there.left)
