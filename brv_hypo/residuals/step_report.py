"""What the result tells of one step."""

from __future__ import annotations

from collections.abc import Sequence

from brv_hypo.constants import FINDING_REPEATED, FINDING_SHOWN, FINDING_SIGMAS
from brv_hypo.residuals.candidates import Candidate, adjusted, look_alikes
from brv_hypo.residuals.candidates_at_step import Look
from brv_hypo.residuals.choice import Choice, Tried
from brv_hypo.residuals.discover import Discovery
from brv_hypo.residuals.fitted_model import State
from brv_hypo.residuals.flight_left_out import flight_left_out
from brv_hypo.residuals.judge import Prediction, force_errors, residuals_of
from brv_hypo.residuals.near_equals import near_equals
from brv_hypo.residuals.problem import left_by
from brv_hypo.residuals.result import (
    Errors,
    FlightLeftOut,
    Residual,
    Standing,
    Step,
    TriedCandidate,
    lasting_steps,
)

_TOLD = 8  # candidates in a step's table


def step_of(
    number: int,
    residual: Residual,
    here: Look,
    state: State,
    choice: Choice,
    earlier: Sequence[Step],
) -> Step:
    """One step of the result: the candidates with what was added first, and the errors before and after."""
    told, taken = choice.told[:_TOLD], choice.taken
    near = near_equals(here.problem, told, here.candidates)
    leading = choice.leading
    held_out = state.seen.held_out
    left = leading.before if leading else left_by(here.problem, here.null)
    force_before = force_errors(here.problem, held_out, residuals_of(here.problem, held_out, left))
    before = _errors(state.errors, state.held_out) if leading is None else _errors(*leading.errors_before)
    chances = adjusted(choice.ranked)
    without_flight = None if leading is None else flight_left_out(here.problem, here.seen, leading.candidate)
    standing: Standing | None = None
    if taken is not None and choice.named_in is not None:
        hinted = only_describes(taken, choice.discovery) or rests_on_hints(earlier)
        standing = "hint" if hinted else _standing(taken, choice.named_in, without_flight)
    return Step(
        step=number,
        residual=residual,
        candidates=tuple(_told(c, chances, here, choice.discovery, near[c.name]) for c in told),
        look_alikes=look_alikes(leading.candidate, choice.ranked) if leading else (),
        refused=tuple(tried.candidate.name for tried in choice.tried if tried is not taken),
        added=None if taken is None else taken.candidate.name,
        standing=standing,
        flight_left_out=without_flight,
        named_in=choice.named_in,
        description=_words(leading.candidate, here, choice.discovery) if leading else "",
        error_before=before,
        error_after=None if leading is None else _errors(leading.state.errors, leading.state.held_out),
        error_ratio_held_out=None if leading is None else leading.ratio,
        force_error_before=Errors(fit=force_before[0], held_out=force_before[1]),
        force_error_after=None
        if leading is None
        else Errors(fit=leading.force[0], held_out=leading.force[1]),
        error_ratio_std_error=None if leading is None else leading.ratio_error,
        held_out_score=None if leading is None else leading.agreement.fall,
    )


def _errors(fitted: Prediction, held_out: Prediction) -> Errors:
    return Errors(fit=fitted.mean_square, held_out=held_out.mean_square)


def _told(
    candidate: Candidate,
    chances: dict[str, float],
    here: Look,
    discovery: Discovery | None,
    near: tuple[str, ...],
) -> TriedCandidate:
    return TriedCandidate(
        effect=candidate.name,
        kind=candidate.kind,
        f_ratio=candidate.f_ratio,
        p_value_adjusted=chances[candidate.name],
        explains=candidate.explains,
        description=_words(candidate, here, discovery),
        near_equals=near,
    )


def only_describes(taken: Tried, discovery: Discovery | None) -> bool:
    """Whether it is generic terms that name nothing: several that were found one after another."""
    return discovery is not None and taken.candidate is discovery.candidate and discovery.pieces > 1


def rests_on_hints(earlier: Sequence[Step]) -> bool:
    """Whether the model holds what earlier steps added and did not establish.

    What is added beside it may make up for it: a moment that is constant in the body for one that drifts there.
    """
    return any(step.standing == "hint" for step in lasting_steps(earlier))


def _standing(taken: Tried, share: float, without_flight: FlightLeftOut | None) -> Standing:
    """A finding or a hint."""
    lowers = taken.ratio + FINDING_SIGMAS * taken.ratio_error < 1.0
    elsewhere = without_flight is None or without_flight.ratio < 1.0
    return "finding" if lowers and elsewhere and share >= FINDING_REPEATED else "hint"


def _words(candidate: Candidate, here: Look, discovery: Discovery | None) -> str:
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
            else f" at {max(column.time_basis.start, float(here.seen.flights[column.flight or 0].time[0])):.2f} s"
        )
        + _of_flight(here, column.flight)
        for column, value in zip(candidate.fit.selected, values, strict=True)
    )


def _of_flight(here: Look, number: int | None) -> str:
    """Which flight a value is of, where there are several; counted from 1."""
    return "" if number is None or len(here.seen.records) == 1 else f" on flight {number + 1}"
