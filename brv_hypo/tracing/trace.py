"""`trace`, the residual loop: find the residual, add the effect that explains it, repeat until nothing is left.

An effect is added where the evidence wants it beside all processes (`families`), and removed where it no longer is.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Unpack

import numpy as np
from threadpoolctl import threadpool_limits

from brv_hypo.comparison.intervals import Excess
from brv_hypo.comparison.summary import estimates, of_flight, record_summary
from brv_hypo.flight import FlightSource, flights_of
from brv_hypo.flight.derived import averaged
from brv_hypo.inference.fit import fit_hypothesis
from brv_hypo.inference.held_out import jackknife_error
from brv_hypo.inference.refinement import FINAL
from brv_hypo.io.text import times
from brv_hypo.linearisation.channels import HELD_OUT_SHORTEST
from brv_hypo.mechanisms.contract import FAMILIES, Mechanism, RecordEffect
from brv_hypo.mechanisms.registry import find_installed, mechanisms, parse_hypothesis, record_effects
from brv_hypo.mechanisms.yaml_mechanism import MechanismFile
from brv_hypo.model.baseline import StaticBend
from brv_hypo.model.model import Model, restored
from brv_hypo.motion import try_record
from brv_hypo.progress import Progress, report_to, stages
from brv_hypo.settings import settings_of, takes_settings
from brv_hypo.thresholds import FAMILY_REST, SPECIFIC
from brv_hypo.tracing import result
from brv_hypo.tracing.acceptance import Candidate, Choice, choose, confounded
from brv_hypo.tracing.additions import analyse_step
from brv_hypo.tracing.baseline import has_schedule, is_bend, start_model
from brv_hypo.tracing.families import Beside, beside_processes
from brv_hypo.tracing.final_model import gathered, impossible_in
from brv_hypo.tracing.fit import Fit, Flights, converged, converged_from, correct, fitted_about, require_samples
from brv_hypo.tracing.result import Account, Errors, Step, Stop, Trace, TraceConfig, TraceSettings, TriedCandidate

_MOST_REPORTED = 8  # candidates in a step's table


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
    >>> traced = brv_hypo.trace(flown, effects=["magnus"], discover=False)
    >>> traced.hints
    ('magnus',)
    """
    config = settings_of(TraceConfig, config, settings)
    own = flights_of(flights)
    records = tuple(averaged(flight) for flight in own)
    fewest = max(result.TRACED_SMALLEST, HELD_OUT_SHORTEST * config.blocks)
    for record in records:
        advice = "Widen --start and --stop, or have fewer `blocks` in the configuration."
        require_samples(record, fewest, f"hold any of {config.blocks} blocks out. {advice}")
    with threadpool_limits(limits=1, user_api="blas"):  # the matrices are small: threads only cost
        traced = _trace(Flights(records, config), stages(report_to(progress), {}))
    given = config.model_dump(mode="json", exclude_defaults=True, exclude={"start", "columns", "aero"})
    tried = record_summary([try_record(flight)[1] for flight in own])
    return traced.model_copy(update={"record": tried, "settings": given})


def _trace(source: Flights, say: Callable[[str], None]) -> Trace:
    begun, config = clock.perf_counter(), source.config
    installed = (*mechanisms("mechanism"), *mechanisms("aerodynamic"), *record_effects())
    items = installed if config.effects is None else [find_installed(name) for name in config.effects]
    of_moments = [item for item in items if isinstance(item, Mechanism)]
    of_records = [item for item in items if isinstance(item, RecordEffect)]
    say("reconstructing the motion")
    fits, steps = [_start(source)], list[Step]()  # from the first model to the last
    stopped: Stop = "limit"
    for number in range(1, config.max_steps + 1):
        say(f"step {number}: trying the effects")
        step, after, discovery, beside = _turn(number, fits[-1], of_moments, of_records, steps)
        steps.append(step)
        if after is None:
            nothing_more: Stop = "white" if step.residual.white else "nothing significant"
            stopped = "nothing improves held-out error" if step.refused else nothing_more
            break
        fits.append(after)
    first, last = fits[0], fits[-1]
    alone = beside_processes(last, last.model) if after else beside
    whole = last.on_whole_record().at_best_knots(FINAL).on_whole_record()
    impossible = impossible_in(whole, alone.null)
    if any(step.status == "finding" for step in steps):
        bend = [StaticBend.name] if StaticBend.name not in last.model.mechanisms else []  # an effect in its place
        steps = _confirmed(steps, beside_processes(last, first.model.without(bend)), impossible)
    steps, account = beside_hints(steps), _account(fits, steps)
    made = gathered(last, whole, impossible, first.left, alone.null, steps, account, stopped, discovery)
    return made.model_copy(update={"seconds": clock.perf_counter() - begun})


def _start(source: Flights) -> Fit:
    flights, start, baseline = source.records, source.config.start, source.config.baseline
    if not isinstance(start, str):
        return converged(source, restored(start, flights))
    known = parse_hypothesis(start)
    model = start_model(source, known, baseline).but(added=tuple(mechanism.name for mechanism in known))
    motion = correct(source, model).frame.motions[0]
    chosen = tuple(m for m in known if m.time_variation != ("constant",) or m.parameters())
    for mechanism in known:  # every term of those that leave no choice in time, of all flights together or of each
        if mechanism not in chosen:
            apart = len(flights) > 1 and mechanism.of_each_flight(flights[0])
            model = model.with_terms(mechanism, motion, range(len(flights)) if apart else (None,))
    columns = [c for c in source.config.columns if any(c.mechanism == m.name for m in chosen)]
    first, last = flights[0].time[[0, -1]].tolist()
    if columns and all(c.start is None or first <= c.start <= last for c in columns):
        model = model.but(columns=(*model.columns, *(c.regressor(model.mechanisms[c.mechanism]) for c in columns)))
    elif chosen:
        problem = converged(source, model).problem
        model = model.but(columns=fit_hypothesis(problem, "start", chosen).columns)
    return converged(source, model)


def _account(fits: Sequence[Fit], steps: Sequence[Step]) -> tuple[Account, ...]:
    """The held-out error of one model after another, from constant coefficients to the last."""
    first, added = fits[0], [step.added for step in steps if step.added is not None]
    source, start, models = first.data.source, "constant", list[tuple[str, Fit]]()
    if source.config.start != "none" or source.config.aero is not None:
        start = result.GIVEN_MODEL
    elif has_schedule(first.model):
        models = [(start, converged(source, start_model(source)))]  # as with the setting `baseline: constant`
        start = "scheduled"
    models += zip((start, *added), fits, strict=True)
    known = ((name, fit.held_out, fit.without_stretches([fit.data.reported])) for name, fit in models)
    return tuple(Account(model=name, held_out=own, std_error=jackknife_error(left)) for name, own, left in known)


# ---- One step ----


def _turn(
    number: int, fit: Fit, mechanisms: Sequence[Mechanism], effects: Sequence[RecordEffect], before: Sequence[Step]
) -> tuple[Step, Fit | None, MechanismFile | None, Beside]:
    """One step: the residual, the candidates, and the model with the best of them if it is needed.
    What steps `before` added and is not wanted beside it is removed. Where it leads to no fit, the description in
    generic terms that is significant all the same; last what it adds, and processes beside that, on the whole record.
    """
    model, source, config = fit.model, fit.data.source, fit.data.source.config
    flights = source.records
    usable = []
    for mechanism in mechanisms:  # of which the records hold what it needs, such as the Mach number
        theta = {parameter.name: parameter.grid[0] for parameter in mechanism.parameters()}
        terms = [term for motion in fit.data.frame.motions for term in mechanism.terms(motion, theta)]
        if all(np.all(np.isfinite([term.in_plane, term.out_of_plane])) for term in terms):
            usable.append(mechanism)
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
            here, choice = there, named
    accepted, after, gone = choice.accepted, None, tuple[str, ...]()
    beside = beside_processes(here if accepted is None else accepted.fit, here.model)
    if accepted is not None:
        # Beside a model that lacked the effect, the errors of the record had taken up some of it.
        after = converged_from(accepted.fit)
        earlier = [each.added for each in before if each.added not in (None, accepted.candidate.name)]
        if gone := unwanted(after, earlier):
            after = converged_from(fitted_about(after.data, after.model.without(gone)))
    described = [] if after else [each.file for each in choice.significant if each.file is not None]
    step = _reported(number, fit, choice, after, beside).model_copy(update={"removed": gone})
    return step, after, described[0] if described else None, beside


def _has_everywhere(name: str, model: Model, flights: int) -> bool:
    """Whether the effect was added for all of the flights: to those that lack it, it may be added yet."""
    own = {column.flight for column in model.columns if column.mechanism == name}
    own |= {applied.flight for applied in model.applied if applied.effect.name == name}
    return name in model.added and (None in own or len(own) in (0, flights))


def unwanted(fit: Fit, names: Sequence[str]) -> tuple[str, ...]:
    """Those of the effects, no schedules and without tolerances, that nothing wants beside all others and processes."""
    model, flights = fit.model, fit.data.flights
    known = [model.mechanisms[name] for name in names if name in model.mechanisms]
    removable = [m.name for m in known if m.follows != "mach" and all(m.tolerance(f) is None for f in flights)]
    if not removable:
        return ()
    first = min(k for k, column in enumerate(model.columns) if column.mechanism in removable)
    return beside_processes(fit, model.but(columns=model.columns[:first])).unwanted(removable)


def _confirmed(steps: Sequence[Step], beside: Beside, impossible: Excess | None = None) -> list[Step]:
    """The steps, with hints for findings that processes explain as well, or that have an `impossible` value."""
    gains = {name: beside.gain(name) for name in beside.terms}
    adequate = beside.is_adequate([name for name, gain in gains.items() if gain > -SPECIFIC])

    def doubt(name: str) -> str:
        if impossible is not None and impossible.mechanism == name:
            return f"its final value is impossible: {impossible.words}"
        if gains.get(name, -np.inf) < SPECIFIC:
            return "beside the final model, processes explain the flight as well"
        if not adequate:
            return "processes explain more than all that was added to the final model"
        much = beside.rest_of_family(name) > FAMILY_REST
        return "processes of its family have much to explain beside it" if much else ""

    return [
        step.as_hint(found) if step.added and step.status == "finding" and (found := doubt(step.added)) else step
        for step in steps
    ]


def beside_hints(steps: Sequence[Step]) -> list[Step]:
    """The steps, their findings hints where they rest on a hint, for which they may make up."""
    found = list[Step]()
    for step in steps:
        rests = any(each.status == "hint" for each in result.lasting_steps([*found, step])[:-1])
        found.append(step.as_hint("it rests on an earlier hint") if rests and step.status is not None else step)
    return found


# ---- What a step says ----


def _reported(number: int, fit: Fit, choice: Choice, after: Fit | None, beside: Beside) -> Step:
    """One step of the result: the candidates with what was added first, and the errors before and `after` it."""
    leading, accepted, doubts = choice.leading, choice.accepted, list[str]()
    if accepted is not None and after is not None and choice.named_in is not None:
        leading = replace(accepted, fit=after)
        doubts += leading.doubts(choice.named_in, len(choice.ranked))
        if accepted.candidate.kind == "discovered" and len(fit.data.records) == 1:
            doubts.append("one flight establishes no description in generic terms")
    clearly_wanted = accepted is not None and accepted.gain >= SPECIFIC
    families = beside.shares([accepted.candidate.name] if accepted is not None and clearly_wanted else [])
    reported, shares = choice.reported[:_MOST_REPORTED], {each.family: each.share for each in families}
    return Step(
        step=number,
        residual=fit.residual,
        families={**dict.fromkeys(FAMILIES, 0.0), **shares},
        decomposition=families,
        candidates=tuple(
            TriedCandidate(
                effect=each.name,
                kind=each.kind,
                f_ratio=each.f_ratio,
                p_value_adjusted=choice.chances[each.name],
                explains=1.0 - each.fit.rss / each.null.rss,
                description=_described(each),
                near_equals=confounded(each, reported),
            )
            for each in reported
        ),
        refused=tuple(tried.candidate.name for tried in choice.tried if tried is not accepted),
        unwanted=choice.unwanted,
        evidence_gain=None if accepted is None else accepted.gain,
        added=None if accepted is None else accepted.candidate.name,
        standing=None if accepted is None else "hint" if doubts else "finding",
        doubts=tuple(doubts),
        named_in=choice.named_in,
        description="" if leading is None else _described(leading.candidate),
        error_before=Errors(fit=fit.error, held_out=fit.held_out),
        error_after=None if leading is None else Errors(fit=leading.fit.error, held_out=leading.fit.held_out),
        error_ratio_held_out=None if leading is None else leading.ratios["reported"][0],
        error_ratio_std_error=None if leading is None else leading.ratios["reported"][1],
        held_out_score=None if leading is None else leading.score,
        ratio_of_flights_left_out=None if leading is None else leading.elsewhere,
    )


def _described(candidate: Candidate) -> str:
    """What a candidate beside a model says of its flights."""
    if candidate.file is not None:
        return candidate.file.title
    own, time = candidate.fit, getattr(candidate.effect, "time", None)
    values = own.values[own.baseline_size :]
    terms = () if candidate.applied else estimates(own.selected, values, np.zeros((values.size,) * 2), own.frame)
    said = [f"{each.begins} {each.value:.3g}" for each in terms]
    said += [f"{e.component} {e.value:.3g} {e.units}{of_flight(own.frame, e.flight)}" for e in candidate.applied]
    return ", ".join(said) + ("" if time is None else f" at {times(time)}")
