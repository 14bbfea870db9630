"""One step of a trace as its result holds it. Entrance: `step_of`.

Beside the candidates stand the effects that this flight cannot tell apart from them (`confounded`), and whether each
flight needs what was added without having had a part in choosing it (`flight_left_out`).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from brv_hypo.arrays import BoolArray, FloatArray
from brv_hypo.constants import FINDING_REPEATED, FINDING_SHOWN, FINDING_SIGMAS
from brv_hypo.model.term import Regressor
from brv_hypo.regression.frame import RateFrame
from brv_hypo.regression.problem import GIVEN, Problem
from brv_hypo.regression.uncertainty import residual_moments
from brv_hypo.residuals.candidates import Candidate, adjusted, confounded
from brv_hypo.residuals.candidates_at_step import Analysis
from brv_hypo.residuals.choice import Choice, Tried
from brv_hypo.residuals.discover import Discovery
from brv_hypo.residuals.fitted_model import State
from brv_hypo.residuals.judge import Prediction, force_errors, moment_errors, residuals_of
from brv_hypo.residuals.linearisation import Corrected
from brv_hypo.residuals.problem import constrained, left_by
from brv_hypo.residuals.result import Errors, FlightLeftOut, Residual, Standing, Step, TriedCandidate, lasting_steps
from brv_hypo.thresholds import SPECIFIC


def flight_left_out(problem: Problem, data: Corrected, candidate: Candidate) -> FlightLeftOut | None:
    """Errors on each flight without and with the candidate; None for one flight, or where nothing of it is shared."""
    shared = any(column.flight is None and column.mechanism != GIVEN for column in candidate.fit.selected)
    if len(data.records) < 2 or not shared:
        return None
    flights = range(len(data.records))
    before = [_predicted(problem, data, problem.frame, problem.baseline, k) for k in flights]
    after = [_predicted(problem, data, candidate.fit.frame, candidate.fit.columns, k) for k in flights]
    sums = [sum(float(each.squares.sum()) for each in errors) for errors in (before, after)]
    return FlightLeftOut(
        before=tuple(each.mean_square for each in before),
        after=tuple(each.mean_square for each in after),
        ratio=sums[1] / sums[0],
    )


def _predicted(
    problem: Problem, data: Corrected, frame: RateFrame, columns: Sequence[Regressor], number: int
) -> Prediction:
    """Errors on one flight of the shared coefficients that the others have."""
    items = problem.rows.nuisances.items
    own = np.array([column.flight == number for column in columns], dtype=bool)
    shared = np.array([column.flight is None for column in columns], dtype=bool)
    here = np.array([item.flight == number for item in items], dtype=bool)
    others = problem.on(data.part_of([k for k in range(len(data.records)) if k != number]))
    known = constrained(others, frame, columns, _held_at_zero(own), _held_at_zero(here))
    held = np.where(shared, known.values, _held_at_zero(~own & ~shared))
    of_all = np.array([item.flight is None for item in items], dtype=bool)
    nuisances = np.where(of_all, known.others, _held_at_zero(~here & ~of_all))
    part = data.part_of([number])
    left = constrained(problem.on(part), frame, columns, held, nuisances).left
    return moment_errors(part, residual_moments(frame, problem.records, left.rates))


def _held_at_zero(which: BoolArray) -> FloatArray:
    """Zero for these, NaN (free) for the others."""
    return np.where(which, 0.0, np.nan)


# ---- What the result tells of one step ----


_REPORTED = 8  # candidates in a step's table


def step_of(
    number: int, residual: Residual, here: Analysis, state: State, choice: Choice, earlier: Sequence[Step]
) -> Step:
    """One step of the result: the candidates with what was added first, and the errors before and after."""
    reported, accepted = choice.reported[:_REPORTED], choice.accepted
    leading = choice.leading
    held_out = state.data.held_out
    left = leading.before if leading else left_by(here.problem, here.null)
    force_before = force_errors(here.problem, held_out, residuals_of(here.problem, held_out, left))
    before = _errors(state.errors, state.held_out) if leading is None else _errors(*leading.errors_before)
    chances = adjusted(choice.ranked)
    without_flight = None if leading is None else flight_left_out(here.problem, here.data, leading.candidate)
    standing: Standing | None = None
    if accepted is not None and choice.named_in is not None:
        generic = accepted.candidate.kind == "discovered" and len(state.data.records) == 1
        hinted = generic or rests_on_hints(earlier)
        standing = "hint" if hinted else _finding_or_hint(accepted, choice, choice.named_in, without_flight)
    return Step(
        step=number,
        residual=residual,
        candidates=tuple(_reported(c, chances, here, choice) for c in reported),
        refused=tuple(tried.candidate.name for tried in choice.tried if tried is not accepted),
        unwanted=choice.unwanted,
        evidence_gain=None if accepted is None else accepted.gain,
        added=None if accepted is None else accepted.candidate.name,
        standing=standing,
        flight_left_out=without_flight,
        named_in=choice.named_in,
        description=_words(leading.candidate, here, choice.discovery) if leading else "",
        error_before=before,
        error_after=None if leading is None else _errors(leading.state.errors, leading.state.held_out),
        error_ratio_held_out=None if leading is None else leading.ratio,
        force_error_before=Errors(fit=force_before[0], held_out=force_before[1]),
        force_error_after=None if leading is None else Errors(fit=leading.force[0], held_out=leading.force[1]),
        error_ratio_std_error=None if leading is None else leading.ratio_error,
        held_out_score=None if leading is None else leading.agreement.fall,
    )


def _errors(fitted: Prediction, held_out: Prediction) -> Errors:
    return Errors(fit=fitted.mean_square, held_out=held_out.mean_square)


def _reported(candidate: Candidate, chances: dict[str, float], here: Analysis, choice: Choice) -> TriedCandidate:
    return TriedCandidate(
        effect=candidate.name,
        kind=candidate.kind,
        f_ratio=candidate.f_ratio,
        p_value_adjusted=chances[candidate.name],
        explains=candidate.explains,
        description=_words(candidate, here, choice.discovery),
        near_equals=confounded(candidate, choice.reported[:_REPORTED]),
    )


def rests_on_hints(earlier: Sequence[Step]) -> bool:
    """Whether the model holds what earlier steps added and did not establish.

    What is added beside it may make up for it: a moment that is constant in the body for one that drifts there.
    """
    return any(step.standing == "hint" for step in lasting_steps(earlier))


def _finding_or_hint(tried: Tried, choice: Choice, share: float, without_flight: FlightLeftOut | None) -> Standing:
    """A finding or a hint."""
    lowers = tried.ratio + FINDING_SIGMAS * tried.ratio_error < 1.0
    elsewhere = without_flight is None or without_flight.ratio < 1.0
    wanted = tried.gain is None or tried.gain - np.log(len(choice.ranked)) >= SPECIFIC  # one of so many was chosen
    return "finding" if lowers and elsewhere and wanted and share >= FINDING_REPEATED else "hint"


def _words(candidate: Candidate, here: Analysis, discovery: Discovery | None) -> str:
    """What the candidate says of this flight."""
    if candidate.kind == "discovered" and discovery is not None:
        return discovery.words
    values = candidate.fit.values[candidate.fit.baseline_size :]
    where = "" if candidate.in_rates > FINDING_SHOWN else " (in the specific force only)"
    if candidate.effect is not None:
        when = getattr(candidate.effect, "time", None)
        sizes = ", ".join(
            f"{component.name} {value:.3g} {column.units}{_of_flight(here, number)}"
            for column, value in zip(candidate.fit.selected, values, strict=True)
            for number, component in [here.components[column.term]]
        )
        return (sizes if when is None else f"{sizes} at {when:.3f} s") + where
    return ", ".join(
        f"{column.label} {value:.3g}"
        + (
            ""
            if column.time_basis.kind == "constant"
            else f" at {max(column.time_basis.start, float(here.data.flights[column.flight or 0].time[0])):.2f} s"
        )
        + _of_flight(here, column.flight)
        for column, value in zip(candidate.fit.selected, values, strict=True)
    )


def _of_flight(here: Analysis, number: int | None) -> str:
    """Which flight a value is of, where there are several; counted from 1."""
    return "" if number is None or len(here.data.records) == 1 else f" on flight {number + 1}"
