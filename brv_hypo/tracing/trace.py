"""`trace`, the residual loop: find the residual, add the effect that explains it, repeat until nothing is left.

An effect is added where the evidence wants it beside all processes (`families`), and removed where it no longer is.
The final model is refined by maximum likelihood on the measurements themselves (`final_model`).
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple, Unpack

import numpy as np
from threadpoolctl import threadpool_limits

from brv_hypo.comparison.summary import record_summary
from brv_hypo.constants import (
    HELD_OUT_SHORTEST,
    LOOP_REPEATED_BLOCKS,
    LOOP_REPEATED_KNOTS,
    LOOP_RIVALS,
    LOOP_WITH_EVIDENCE,
    REPEATED_ERRORS,
    TRACED_SMALLEST,
)
from brv_hypo.errors import UnanswerableError
from brv_hypo.flight import FlightSource, flights_of
from brv_hypo.flight.derived import averaged
from brv_hypo.flight.record import Flight
from brv_hypo.inference.fit import fit_hypothesis
from brv_hypo.inference.held_out import jackknife_error
from brv_hypo.inference.problem import Problem
from brv_hypo.linearisation.channels import split
from brv_hypo.mechanisms.contract import Mechanism, RecordEffect
from brv_hypo.mechanisms.registry import find_installed, mechanisms, parse_hypothesis, record_effects
from brv_hypo.mechanisms.yaml_mechanism import MechanismFile
from brv_hypo.model.baseline import StaticBend
from brv_hypo.model.model import Model, restored
from brv_hypo.model.term import TimeBasis, default_knots, term_column
from brv_hypo.motion import try_record
from brv_hypo.progress import Progress, report_to, stages
from brv_hypo.settings import settings_of, takes_settings
from brv_hypo.thresholds import FAMILY_REST, SPECIFIC
from brv_hypo.tracing.acceptance import (
    Candidate,
    Choice,
    adjusted,
    best_first,
    choose,
    confounded,
    fitted_again,
    follows_mach,
    is_schedule,
    schedules_first,
    solved_again,
)
from brv_hypo.tracing.account import step_of
from brv_hypo.tracing.additions import analyse_step, with_candidate
from brv_hypo.tracing.baseline import has_schedule, is_bend, scheduled, start_model, starting_columns, with_priors
from brv_hypo.tracing.families import Beside, beside_processes
from brv_hypo.tracing.final_model import gathered, maximum_likelihood
from brv_hypo.tracing.fit import Corrected, Fit, converged, correct, fitted_about, refitted
from brv_hypo.tracing.result import Account, Baseline, Step, Stop, Trace, TraceConfig, TraceSettings


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
        result = _trace(records, config, stages(report_to(progress), {}))
    return result.model_copy(update={"record": record_summary([try_record(flight)[1] for flight in own])})


def _trace(flights: tuple[Flight, ...], config: TraceConfig, say: Callable[[str], None]) -> Trace:
    begun = clock.perf_counter()
    tried, turns = _effects(config), list[Turn]()
    say("reconstructing the motion")
    fit = _start(flights, config, config.baseline)
    discovery: MechanismFile | None = None
    stopped: Stop = "limit"
    for number in range(1, config.max_steps + 1):
        say(f"step {number}: trying the effects")
        turn = _turn(number, fit, *tried, [each.step for each in turns])
        turns.append(turn)
        if turn.discovery is not None and (turn.after is not None or discovery is None):
            discovery = turn.discovery
        fit = turn.after or turn.before
        if turn.after is None:
            stopped = turn.reason
            break
    first, fit = turns[0].before, refitted(fit)
    steps = confirmed([turn.step for turn in turns], beside_processes(fit, first.model))
    result = gathered(fit, first.left, steps, _account(turns, fit), stopped, discovery)
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


def _start(flights: tuple[Flight, ...], config: TraceConfig, baseline: Baseline) -> Fit:
    """The model that the trace starts from."""
    start = config.start
    if not isinstance(start, str):
        return converged(flights, restored(start, flights), config)
    known = parse_hypothesis(start)
    model = start_model(flights, known, baseline, config.aero)
    data = correct(flights, model, config)
    columns, added = starting_columns(model, data.frame), tuple(mechanism.name for mechanism in known)
    model = with_priors(model.but(columns=columns, added=added), data)
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
        problem = converged(flights, model, config).problem
        model = model.but(columns=fit_hypothesis(problem, "start", chosen).columns)
    return converged(flights, model, config)


def _account(turns: Sequence[Turn], last: Fit) -> tuple[Account, ...]:
    """The held-out error of one model after another, from constant coefficients to the last."""
    first, added = turns[0].before, [turn.step.added for turn in turns if turn.step.added is not None]
    flights, config = first.data.originals, first.data.config
    start, models = "constant", list[tuple[str, Fit]]()
    if config.start != "none" or config.aero is not None:
        start = "the model given"
    elif has_schedule(first.model):
        models, start = [(start, _start(flights, config, "constant"))], "scheduled"
    models += zip((start, *added), [*(turn.before for turn in turns[: len(added)]), last], strict=True)
    errors = [(name, fit.held_out) for name, fit in models]
    return tuple(
        Account(model=name, held_out=each.mean_square, std_error=jackknife_error(each.left_out))
        for name, each in errors
    )


# ---- One step ----


class Turn(NamedTuple):
    """One step with the fit that it started from, and the one that it led to.

    `discovery`: the description in generic terms, where it is significant and no name took its place.
    """

    step: Step
    before: Fit
    after: Fit | None
    discovery: MechanismFile | None

    @property
    def reason(self) -> Stop:
        """Why the loop ends with a step that led to nothing."""
        if self.step.refused:
            return "nothing improves held-out error"
        return "white" if self.step.residual.white else "nothing significant"


def _turn(
    number: int, fit: Fit, mechanisms: Sequence[Mechanism], effects: Sequence[RecordEffect], before: Sequence[Step]
) -> Turn:
    """One step: the residual, the candidates, and the model with the best of them if it is needed.

    What steps `before` added and is not wanted beside it is removed.
    """
    model, flights, config = fit.model, fit.data.originals, fit.data.config
    usable = tuple(m for m in mechanisms if _applicable(m, fit.data))
    bends = [m for m in usable if StaticBend.name in model.mechanisms and is_bend(m, fit.data.frame.motions[0])]
    # What changes in time may be described better by more columns of it.
    timed = [m for m in usable if m.time_variation != ("constant",)]
    untried = [m for m in usable if m not in bends and (m in timed or not _has_everywhere(m.name, model, len(flights)))]
    others = [e for e in effects if not _has_everywhere(e.name, model, len(flights))]
    here, choice = _choice(*analyse_step(fit, untried, others, config.discover))
    if choice.accepted is None and bends:
        # Every effect is tried beside the bend that bodies have. Whether this one has any is tried once nothing else is
        # added, of a model without it.
        bare = fitted_about(fit.data, model.without([StaticBend.name]))
        there, named = _choice(*analyse_step(bare, bends, ()))
        if named.accepted is not None:
            here, choice, before = there, named, ()
    step, after = step_of(number, here, choice, before), None
    if choice.accepted is not None:
        after = choice.accepted.fit
        if choice.accepted.candidate.effect is None:
            # Beside a model that lacked the effect, the errors of the record had taken up some of it.
            after = converged(flights, after.model, config)
        earlier = [each.added for each in before if each.added is not None and each.added != step.added]
        if gone := unwanted(after, earlier):
            after = converged(flights, after.model.without(gone), config)
            step = step.model_copy(update={"removed": gone})
    return Turn(step, here, after, _counting(choice, config.significance))


def _choice(fit: Fit, candidates: Sequence[Candidate]) -> tuple[Fit, Choice]:
    """What is chosen of the candidates beside a fit, with the evidence that they gain."""
    beside, known = beside_processes(fit, fit.model, fit.data.fitted, fit.problem.given), has_schedule(fit.model)

    def add(candidate: Candidate) -> Fit:
        found = with_candidate(fit, candidate)
        if not follows_mach(candidate) or known:
            return found
        return converged(fit.data.originals, scheduled(found.model, found.data), fit.data.config)

    def weighed(found: Fit) -> tuple[float, bool]:
        there = beside_processes(found, fit.model, found.data.fitted)
        gain = there.gain(own := found.model.added[-1])
        gain = gain if gain >= 0.0 else max(gain, min(there.gain(own, in_place=True), 0.0))
        return gain, gain >= SPECIFIC or beside.majority in (None, there.families[own])

    choice = choose(fit, with_evidence(fit, candidates, beside), add, weighed)
    if choice.accepted is None:
        return fit, choice
    offered = [each for each in choice.ranked if each.name not in choice.unwanted]
    if not known and is_schedule(choice.accepted.candidate):  # where the model has no schedule, one comes first
        offered = list(schedules_first(offered))
    name = choice.accepted.candidate.name
    if choice.refuted:
        share = explains_most_in(fit, [each for each in offered if each.name not in choice.refuted], name)
    else:
        share = named_in(beside, offered, name, fit)
    return fit, replace(choice, named_in=share)


def _counting(choice: Choice, significance: float) -> MechanismFile | None:
    """The description in generic terms, where it is significant and no name took its place."""
    accepted, own = choice.accepted, next((each for each in choice.ranked if each.file is not None), None)
    if own is None:
        return None
    if accepted is None or accepted.candidate is own:
        return own.file if adjusted(choice.ranked)[own.name] <= significance else None
    return own.file if own.name in confounded(accepted.candidate, choice.ranked) else None


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


# ---- Beside processes: which candidates lead, how often they do, which effects stay ----


def with_evidence(fit: Fit, candidates: Sequence[Candidate], beside: Beside) -> list[Candidate]:
    """The candidates that lead, as they are likeliest beside all processes, with the evidence that they gain there.

    So are all that change in time: on a coarse grid any of them may look like nothing.
    """
    found = []
    for place, candidate in enumerate(candidates):
        changes = any(m.time_variation != ("constant",) for m in candidate.fit.mechanisms)
        leads = place < LOOP_WITH_EVIDENCE and candidate.gain > 0.0
        if changes or leads or candidate.kind == "discovered":
            gain, columns = beside.likeliest(candidate.fit)
            if set(columns) != set(candidate.fit.selected):
                candidate = fitted_again(fit.problem, fit.null, candidate, columns)
            candidate = replace(candidate, evidence=gain)
        found.append(candidate)
    return found


def named_in(beside: Beside, offered: Sequence[Candidate], name: str, fit: Fit) -> float:
    """Share of the repetitions in which an effect gains most beside all processes, a generic description far more."""
    own = next(candidate for candidate in offered if candidate.name == name)
    rivals = [each for each in offered if each is not own and each.evidence is not None][:LOOP_RIVALS]
    best = []
    for problem in _repetitions(beside.rows.problem, fit.data):
        again = beside.under(problem)
        gains = {each.name: again.gain_of(each.fit) - (each.kind == "discovered") * SPECIFIC for each in rivals}
        gains[name] = again.gain_of(own.fit)
        best.append(min((own, *rivals), key=best_first((own, *rivals), gains)).name)
    return float(np.mean([each == name for each in best]))


def explains_most_in(fit: Fit, offered: Sequence[Candidate], name: str) -> float:
    """Share of the repetitions in which an effect explains more than every other name, processes apart."""
    named = sorted((each for each in offered if each.kind != "discovered"), key=lambda each: -each.gain)
    rivals = [each for each in offered if each.name == name or each in named[: LOOP_RIVALS + 1]]
    best = [
        min(rivals, key=lambda each: solved_again(problem, each.fit).information).name
        for problem in _repetitions(fit.problem, fit.data)
    ]
    return float(np.mean([each == name for each in best]))


def _repetitions(problem: Problem, data: Corrected) -> Iterator[Problem]:
    config = data.config
    for share in LOOP_REPEATED_BLOCKS:
        fitted, _ = split(data.frame, data.whole.valid, round(share * config.blocks))
        yield problem.on(fitted)
    start, stop = float(data.frame.time.min()), float(data.frame.time.max())
    for more in LOOP_REPEATED_KNOTS:
        yield replace(problem, knots=default_knots(start, stop, max(config.knot_count + more, 1)))
    nuisances = problem.rows.nuisances
    for effect in REPEATED_ERRORS:
        for side in (-1.0, 1.0):
            items = tuple(
                replace(item, present=item.present + side) if item.name == effect else item for item in nuisances.items
            )
            if items != nuisances.items:
                yield replace(problem, rows=replace(problem.rows, nuisances=replace(nuisances, items=items)))


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


def confirmed(steps: Sequence[Step], beside: Beside) -> tuple[Step, ...]:
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
