"""`trace`, the residual loop: find the residual, add the effect that explains it, repeat until nothing is left.

An effect is added where the evidence wants it beside all processes (`families`), and removed where it no longer is.
The final model is refined by maximum likelihood on the measurements themselves (`final_model`).
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple, Unpack

import numpy as np
from threadpoolctl import threadpool_limits

from brv_hypo.comparison.summary import record_summary
from brv_hypo.constants import FINDING_SHOWN, HELD_OUT_SHORTEST, TRACED_SMALLEST
from brv_hypo.errors import UnanswerableError
from brv_hypo.flight import FlightSource, flights_of
from brv_hypo.flight.derived import averaged
from brv_hypo.inference.fit import fit_hypothesis
from brv_hypo.inference.held_out import jackknife_error
from brv_hypo.inference.problem import GIVEN
from brv_hypo.io.text import times
from brv_hypo.mechanisms.contract import FAMILIES, Mechanism, RecordEffect
from brv_hypo.mechanisms.registry import find_installed, mechanisms, parse_hypothesis, record_effects
from brv_hypo.mechanisms.yaml_mechanism import MechanismFile
from brv_hypo.model.baseline import StaticBend
from brv_hypo.model.model import Model, restored
from brv_hypo.model.term import TimeBasis, term_column
from brv_hypo.motion import try_record
from brv_hypo.progress import Progress, report_to, stages
from brv_hypo.settings import settings_of, takes_settings
from brv_hypo.thresholds import FAMILY_REST, SPECIFIC
from brv_hypo.tracing.acceptance import Candidate, Choice, Tried, choose, confounded
from brv_hypo.tracing.additions import analyse_step
from brv_hypo.tracing.baseline import has_schedule, is_bend, start_model
from brv_hypo.tracing.families import Beside, beside_processes
from brv_hypo.tracing.final_model import gathered, maximum_likelihood
from brv_hypo.tracing.fit import Corrected, Fit, Flights, MomentErrors, converged, converged_from, correct, fitted_about
from brv_hypo.tracing.result import (
    Account,
    Baseline,
    Errors,
    FlightLeftOut,
    Step,
    Stop,
    Trace,
    TraceConfig,
    TraceSettings,
    TriedCandidate,
    lasting_steps,
)

_REPORTED = 8  # candidates in a step's table


@takes_settings(TraceConfig)
def trace(
    flights: FlightSource | Sequence[FlightSource],
    config: TraceConfig | Mapping[str, Any] | str | Path | None = None,
    *,
    progress: Progress | None = None,
    **settings: Unpack[TraceSettings],
) -> Trace:
    """Trace what a model lacks on one flight or several, effect by effect.

    Several flights share the terms by Mach number and angle of attack; trim, instruments, and what changes at times of
    the record are of each. Long records far finer than their motion are traced as means of samples. A record that
    contradicts itself is traced as it is, for the effect may be what does it; `record` of the result says so.

    Returns
    -------
    Trace
        The steps, findings, hints and the final model.

    Examples
    --------
    >>> import brv_hypo
    >>> magnus = {"mechanism": "magnus", "terms": {"C_npalpha": 3.0}}
    >>> flown = brv_hypo.simulate("research_cone", seed=1, duration=4.0, sample_rate=100.0, mechanisms=[magnus])
    >>> traced = brv_hypo.trace(flown, effects=["magnus"], discover=False, maximum_likelihood=False)
    >>> traced.hints
    ('magnus',)
    """
    config = settings_of(TraceConfig, config, settings)
    own = flights_of(flights)
    records = tuple(averaged(flight) for flight in own)
    fewest = max(TRACED_SMALLEST, HELD_OUT_SHORTEST * config.blocks)
    for record in records:
        if record.samples < fewest:
            raise UnanswerableError(
                f"the record holds {record.samples} samples in the window, expected at least {fewest}: too few to hold "
                f"any of {config.blocks} blocks out. Widen --start and --stop, or have fewer `blocks` in the "
                "configuration."
            )
    with threadpool_limits(limits=1, user_api="blas"):  # the matrices are small: threads only cost
        result = _trace(Flights(records, config), stages(report_to(progress), {}))
    return result.model_copy(update={"record": record_summary([try_record(flight)[1] for flight in own])})


def _trace(source: Flights, say: Callable[[str], None]) -> Trace:
    begun, config = clock.perf_counter(), source.config
    tried, turns = _effects(config), list[Turn]()
    say("reconstructing the motion")
    fit = _start(source, config.baseline)
    stopped: Stop = "limit"
    for number in range(1, config.max_steps + 1):
        say(f"step {number}: trying the effects")
        turn = _turn(number, fit, *tried, [each.step for each in turns])
        turns.append(turn)
        fit = turn.after or turn.before
        if turn.after is None:
            nothing_more: Stop = "white" if turn.step.residual.white else "nothing significant"
            stopped = "nothing improves held-out error" if turn.step.refused else nothing_more
            break
    first = turns[0].before
    steps = _confirmed([turn.step for turn in turns], beside_processes(fit, first.model))
    result = gathered(fit, first.left, steps, _account(turns, fit), stopped, turns[-1].discovery)
    if config.maximum_likelihood:
        say("maximum likelihood of the final model")
        result = result.model_copy(update={"ml": maximum_likelihood(fit)})
    return result.model_copy(update={"seconds": clock.perf_counter() - begun})


def _effects(config: TraceConfig) -> tuple[tuple[Mechanism, ...], tuple[RecordEffect, ...]]:
    """Those that are tried: of the moments, and of the records."""
    installed = (*mechanisms("mechanism"), *mechanisms("aerodynamic"), *record_effects())
    items = installed if config.effects is None else [find_installed(name) for name in config.effects]
    of_moments = tuple(item for item in items if isinstance(item, Mechanism))
    return of_moments, tuple(item for item in items if isinstance(item, RecordEffect))


def _start(source: Flights, baseline: Baseline) -> Fit:
    """The model that the trace starts from."""
    flights, start = source.records, source.config.start
    if not isinstance(start, str):
        return converged(source, restored(start, flights))
    known = parse_hypothesis(start)
    model = start_model(source, known, baseline).but(added=tuple(mechanism.name for mechanism in known))
    data = correct(source, model)
    chosen = tuple(m for m in known if m.time_variation != ("constant",) or m.parameters())
    motion, each = data.reconstructions[0].motion, range(len(flights)) if len(flights) > 1 else [None]
    declared = tuple(  # every term of mechanisms that leave no choice in time, of all flights together or of each
        term_column(mechanism, term, (), TimeBasis("constant"), flight)
        for mechanism in known
        if mechanism not in chosen
        for flight in (each if mechanism.of_each_flight(data.flights[0]) else [None])
        for term in mechanism.terms(motion, {})
    )
    model = model + Model(columns=declared)
    if chosen:
        problem = converged(source, model).problem
        model = model.but(columns=fit_hypothesis(problem, "start", chosen).columns)
    return converged(source, model)


def _account(turns: Sequence[Turn], last: Fit) -> tuple[Account, ...]:
    """The held-out error of one model after another, from constant coefficients to the last."""
    first, added = turns[0].before, [turn.step.added for turn in turns if turn.step.added is not None]
    config, start, models = first.data.source.config, "constant", list[tuple[str, Fit]]()
    if config.start != "none" or config.aero is not None:
        start = "the model given"
    elif has_schedule(first.model):
        models, start = [(start, _start(first.data.source, "constant"))], "scheduled"
    models += zip((start, *added), [*(turn.before for turn in turns[: len(added)]), last], strict=True)
    errors = [(name, fit.held_out) for name, fit in models]
    return tuple(
        Account(model=name, held_out=each.mean_square, std_error=jackknife_error(each.left_out))
        for name, each in errors
    )


# ---- One step ----


class Turn(NamedTuple):
    """One step with the fit that it started from, and the one that it led to.

    `discovery`: where it led to none, the description in generic terms that is significant all the same.
    """

    step: Step
    before: Fit
    after: Fit | None
    discovery: MechanismFile | None


def _turn(
    number: int, fit: Fit, mechanisms: Sequence[Mechanism], effects: Sequence[RecordEffect], before: Sequence[Step]
) -> Turn:
    """One step: the residual, the candidates, and the model with the best of them if it is needed.

    What steps `before` added and is not wanted beside it is removed.
    """
    model, source, config = fit.model, fit.data.source, fit.data.source.config
    flights = source.records
    usable = tuple(m for m in mechanisms if _applicable(m, fit.data))
    bends = [m for m in usable if StaticBend.name in model.mechanisms and is_bend(m, fit.data.frame.motions[0])]
    # What changes in time may be described better by more columns of it.
    timed = [m for m in usable if m.time_variation != ("constant",)]
    untried = [m for m in usable if m not in bends and (m in timed or not _has_everywhere(m.name, model, len(flights)))]
    others = [e for e in effects if not _has_everywhere(e.name, model, len(flights))]
    here, candidates = analyse_step(fit, untried, others, config.discover)
    choice = choose(here, candidates)
    if choice.accepted is None and bends:
        # Every effect is tried beside the bend that bodies have. Whether this one has any is tried once nothing else is
        # added, of a model without it.
        there, candidates = analyse_step(fitted_about(fit.data, model.without([StaticBend.name])), bends, ())
        named = choose(there, candidates)
        if named.accepted is not None:
            here, choice, before = there, named, ()
    step, after = step_of(number, here, choice, before), None
    if choice.accepted is not None:
        # Beside a model that lacked the effect, the errors of the record had taken up some of it.
        after = converged_from(choice.accepted.fit)
        earlier = [each.added for each in before if each.added is not None and each.added != step.added]
        if gone := unwanted(after, earlier):
            after = converged_from(fitted_about(after.data, after.model.without(gone)))
            step = step.model_copy(update={"removed": gone})
    described = [] if after else [each.file for each in choice.significant(here) if each.file is not None]
    return Turn(step, here, after, described[0] if described else None)


def _has_everywhere(name: str, model: Model, flights: int) -> bool:
    """Whether the effect was added for all of the flights: to those that lack it, it may be added yet."""
    own = {column.flight for column in model.columns if column.mechanism == name}
    own |= {applied.flight for applied in model.applied if applied.effect.name == name}
    return name in model.added and (None in own or len(own) in (0, flights))


def _applicable(mechanism: Mechanism, data: Corrected) -> bool:
    """Whether the records hold what the mechanism needs, such as the Mach number."""
    theta = {parameter.name: parameter.grid[0] for parameter in mechanism.parameters()}
    terms = [term for each in data.reconstructions for term in mechanism.terms(each.motion, theta)]
    return all(np.all(np.isfinite(part)) for term in terms for part in (term.in_plane, term.out_of_plane))


def unwanted(fit: Fit, names: Sequence[str]) -> tuple[str, ...]:
    """Those of the effects whose moments are not wanted beside all others and processes.

    Schedules, which change what the baseline is, and what every fit has within its tolerance are left as they are.
    """
    model, flights = fit.model, fit.data.flights
    known = {name: model.mechanisms[name] for name in names if name in model.mechanisms}
    removable = [
        name
        for name, mechanism in known.items()
        if mechanism.follows != "mach" and all(mechanism.tolerance(flight) is None for flight in flights)
    ]
    if not removable:
        return ()
    first = min(k for k, column in enumerate(model.columns) if column.mechanism in removable)
    return beside_processes(fit, model.but(columns=model.columns[:first])).unwanted(removable)


def _confirmed(steps: Sequence[Step], beside: Beside) -> tuple[Step, ...]:
    """The steps, whose findings are hints where processes explain the flight as well as the effect does beside the
    final model, leave that model inadequate, or those of the effect's family have much to explain beside it.
    """
    gains = {name: beside.gain(name) for name in beside.terms}
    adequate = beside.is_adequate([name for name, gain in gains.items() if gain > -SPECIFIC])
    kept = {n for n, gain in gains.items() if gain >= SPECIFIC and adequate and beside.rest_of_family(n) <= FAMILY_REST}
    return tuple(
        step.model_copy(update={"status": "hint"}) if step.status == "finding" and step.added not in kept else step
        for step in steps
    )


# ---- What a step says ----


def step_of(number: int, fit: Fit, choice: Choice, earlier: Sequence[Step]) -> Step:
    """One step of the result: the candidates with what was added first, and the errors before and after."""
    leading, accepted = choice.leading, choice.accepted
    before = fit if leading is None else leading.before
    reported = choice.reported[:_REPORTED]
    without_flight, status = None if leading is None else _left_out(fit, leading.candidate), None
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
                p_value_adjusted=choice.chances[each.name],
                explains=each.explains,
                description=_described(each, fit),
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


def _described(candidate: Candidate, fit: Fit) -> str:
    """What a candidate beside a model says of its flights."""
    if candidate.file is not None:
        return candidate.file.title
    effect, flights, parts = candidate.effect, fit.data.flights, []
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
    at = "" if time is None else f" at {times(time)}"
    own, rates = candidate.fit, fit.problem.rows.rates
    before, after = (each.residual[:rates] for each in (candidate.null, own))
    shown = float(before @ before - after @ after) > FINDING_SHOWN * own.rss / own.samples
    where = "" if effect is None or shown else " (in the specific force only)"
    return ", ".join(parts) + at + where


def _after(leading: Tried) -> dict[str, Any]:
    """What a step says of the candidate that leads."""
    return {
        "description": _described(leading.candidate, leading.before),
        "error_after": _errors(leading.fit),
        "error_ratio_held_out": leading.ratio,
        "error_ratio_std_error": leading.ratio_error,
        "force_error_after": _force_errors(leading.fit),
        "held_out_score": leading.score,
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


def _left_out(fit: Fit, candidate: Candidate) -> FlightLeftOut | None:
    """Errors on each flight without and with the candidate; None for one flight, or where nothing of it is shared."""
    flights = range(len(fit.data.records))
    shared = any(column.flight is None and column.mechanism != GIVEN for column in candidate.fit.selected)
    if len(flights) < 2 or not shared:
        return None
    own = replace(
        fit, model=fit.model.but(columns=candidate.fit.columns), data=replace(fit.data, frame=candidate.fit.frame)
    )
    fits = (fit, own)
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
    numbers = [*(column.flight for column in fit.model.columns), *(item.flight for item in fit.nuisances)]
    flights = np.array([-1 if each is None else each for each in numbers])
    own, shared, part = flights == number, flights == -1, data.part_where(inside)
    others = replace(fit, problem=fit.problem.on(data.part_where(~inside)), known=np.where(own, 0.0, np.nan))
    known = np.where(shared, np.concatenate(others.solution), np.where(own, np.nan, 0.0))
    return MomentErrors.of(part, replace(fit, problem=fit.problem.on(part), known=known).left)
