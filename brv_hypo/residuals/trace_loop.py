"""`trace`, the residual loop: find the residual, add the effect that explains it, repeat until nothing is left.

An effect is added where the evidence wants it beside all processes (`families`), and removed where it no longer does.
The final model is refined by maximum likelihood on the measurements themselves (`maximum_likelihood`).
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Unpack

import numpy as np
from threadpoolctl import threadpool_limits

from brv_hypo.constants import (
    HELD_OUT_SHORTEST,
    LIKELIHOOD_STEPS,
    LOOP_REPEATED_BLOCKS,
    LOOP_REPEATED_KNOTS,
    LOOP_RIVALS,
    LOOP_WITH_EVIDENCE,
    REPEATED_ERRORS,
    SCHEDULE_TRIFLE,
    TRACED_SMALLEST,
)
from brv_hypo.errors import UnanswerableError
from brv_hypo.flight import FlightSource, flights_of
from brv_hypo.flight.derived import averaged
from brv_hypo.flight.record import Flight
from brv_hypo.identification import IdentificationConfig, identify
from brv_hypo.mechanisms.contract import FAMILIES, Mechanism, RecordEffect
from brv_hypo.mechanisms.registry import find_installed, mechanisms, parse_hypothesis, record_effects
from brv_hypo.model.baseline import KnownSlopeSchedule, SlopeSchedule, StaticBend
from brv_hypo.model.term import Regressor, TimeBasis, default_knots, term_column
from brv_hypo.motion import try_record
from brv_hypo.progress import Progress, report_to, stages
from brv_hypo.ranking.result import MaximumLikelihood
from brv_hypo.ranking.summary import likelihood_block, record_summary
from brv_hypo.regression.channels import split
from brv_hypo.regression.fit import fit_hypothesis
from brv_hypo.regression.problem import Problem
from brv_hypo.regression.uncertainty import Regressed
from brv_hypo.residuals.baseline import (
    has_schedule,
    is_bend,
    scheduled,
    start_model,
    starting_columns,
    with_priors,
    without,
)
from brv_hypo.residuals.candidates import Candidate, adjusted, confounded, with_columns
from brv_hypo.residuals.candidates_at_step import Analysis, analyse_step
from brv_hypo.residuals.choice import Choice, Tried, best_first, choose, follows_mach, is_schedule, schedules_first
from brv_hypo.residuals.config import TraceConfig, TraceSettings
from brv_hypo.residuals.diagnostics import find
from brv_hypo.residuals.discover import Discovery
from brv_hypo.residuals.families import Beside, beside_processes
from brv_hypo.residuals.fitted_model import State, converged_state, first_state, refitted, state_of, with_candidate
from brv_hypo.residuals.judge import Prediction
from brv_hypo.residuals.linearisation import Corrected, Model, correct
from brv_hypo.residuals.problem import increments
from brv_hypo.residuals.restore import restored
from brv_hypo.residuals.result import Account, Residual, Step, Stop, Trace
from brv_hypo.residuals.step_report import step_of
from brv_hypo.residuals.summary import LoopEnd, summary, term_estimates
from brv_hypo.settings import settings_of, takes_settings
from brv_hypo.thresholds import FAMILY_REST, SPECIFIC


def named_in(beside: Beside, offered: Sequence[Candidate], name: str, data: Corrected, config: TraceConfig) -> float:
    """Share of the repetitions in which an effect gains most beside all processes, a generic description far more."""
    own = next(candidate for candidate in offered if candidate.name == name)
    rivals = [each for each in offered if each is not own and each.evidence is not None][:LOOP_RIVALS]
    best = []
    for problem in _repetitions(beside.rows.problem, data, config):
        again = beside.under(problem)
        gains = {each.name: again.gain_of(each.fit) - (each.kind == "discovered") * SPECIFIC for each in rivals}
        gains[name] = again.gain_of(own.fit)
        best.append(min((own, *rivals), key=best_first((own, *rivals), gains)).name)
    return float(np.mean([each == name for each in best]))


def _repetitions(problem: Problem, data: Corrected, config: TraceConfig) -> Iterator[Problem]:
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


def with_evidence(here: Analysis, beside: Beside) -> Analysis:
    """The candidates that lead, as they are likeliest beside all processes, with the evidence that they gain there.

    So are all that change in time: on a coarse grid any of them may look like nothing.
    """
    leading = {id(each) for each in here.candidates[:LOOP_WITH_EVIDENCE] if each.gain > 0.0}
    leading |= {id(c) for c in here.candidates if any(m.time_variation != ("constant",) for m in c.fit.mechanisms)}
    found = [_with_evidence(here, beside, each) if id(each) in leading else each for each in here.candidates]
    discovery = here.discovery
    if discovery is not None:
        discovery = replace(discovery, candidate=_with_evidence(here, beside, discovery.candidate))
    return replace(here, candidates=tuple(found), discovery=discovery)


def _with_evidence(here: Analysis, beside: Beside, candidate: Candidate) -> Candidate:
    gain, columns = beside.likeliest(candidate.fit)
    if set(columns) != set(candidate.fit.selected):
        candidate = with_columns(here.problem, here.null, candidate, columns)
    return replace(candidate, evidence=gain)


def unwanted(state: State, names: Sequence[str], config: TraceConfig) -> tuple[str, ...]:
    """Those of the effects whose moments are not wanted beside all others and processes.

    Schedules, which change what the baseline is, and what every fit has within its tolerance are not asked.
    """
    model, flights = state.model, state.data.flights
    known = {name: model.mechanisms[name] for name in names if name in model.mechanisms}
    removable = [
        name
        for name, mechanism in known.items()
        if mechanism.follows != "mach" and all(mechanism.tolerance(flight) is None for flight in flights)
    ]
    if not removable:
        return ()
    first = min(k for k, column in enumerate(model.columns) if column.mechanism in removable)
    before = replace(model, columns=model.columns[:first])
    return beside_processes(state, before, config).unwanted(removable)


# ---- The final model of a trace, refined by maximum likelihood on the measurements themselves ----


_OPTIONS = IdentificationConfig(max_iterations=LIKELIHOOD_STEPS)


def maximum_likelihood(state: State) -> MaximumLikelihood:
    """The likelihood's block of the result, in the form of `compare`'s; a failure is its status and message.

    On a record that limits the reconstruction the search takes long and seldom ends: it is left out.
    """
    data, columns = state.data, state.model.columns
    if len(data.records) > 1:
        return _left_out("with several flights, terms of a single flight cannot be fitted")
    if data.reconstructions[0].status == "degraded":
        return _left_out("the reconstruction is limited by the record, and the search would rarely converge")
    values = state.values
    known_schedule = _known_schedule(state)
    if known_schedule is not None:
        column = Regressor(known_schedule.name, "C_malpha by the schedule", (), TimeBasis("constant"), "1")
        data = replace(data, frame=data.frame.with_mechanisms([known_schedule]))
        columns, values = (*columns, column), np.append(values, 1.0)
    frame, model = state.data.frame, state.model
    _, others = state.problem.solution(frame, model.columns)
    fixed = {(each.effect.name, each.component): each.value for each in model.applied}
    regressed = Regressed.of(state.problem, frame, model.columns, state.values, others).beside([fixed])
    found = identify(data.frame, columns, values, _OPTIONS, regressed=regressed)
    return likelihood_block(found, term_estimates(data, found.columns, found.values, found.covariance))


def _known_schedule(state: State) -> KnownSlopeSchedule | None:
    """What the baseline's slope is more by its schedule, which the likelihood knows no prior of; None for a trifle."""
    schedule = state.model.mechanisms.get(SlopeSchedule.name)
    if not isinstance(schedule, SlopeSchedule):
        return None
    _, others = state.problem.solution(state.data.frame, state.model.columns)
    more = increments(state.problem, others).items()
    found = schedule.known_schedule(tuple(value for column, value in more if column.mechanism == schedule.name))
    motion = state.data.reconstructions[0].motion
    own = found.terms(motion, {})[0].in_plane
    slope = sum(v for c, v in zip(state.model.columns, state.values, strict=True) if c.term == "C_malpha")
    return found if np.linalg.norm(own) > SCHEDULE_TRIFLE * abs(slope) * np.linalg.norm(motion.alpha) else None


def _left_out(message: str) -> MaximumLikelihood:
    return MaximumLikelihood(status="left out", iterations=0, log_likelihood=None, message=message)


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
    loop = _Loop(flights, config, *_candidates(config))
    turns: list[Turn] = []
    stopped: Stop = "limit"
    say("reconstructing the motion")
    state = loop.begin()
    discovery: Discovery | None = None
    for number in range(1, config.max_steps + 1):
        say(f"step {number}: trying the effects")
        turn = loop.turn(number, state, [each.step for each in turns])
        turns.append(turn)
        if turn.discovery is not None and (turn.after is not None or discovery is None):
            discovery = turn.discovery
        state = turn.after or turn.before
        if turn.after is None:
            stopped = turn.reason
            break
    first, state = turns[0].before, refitted(flights, config, state)
    steps = confirmed([turn.step for turn in turns], beside_processes(state, first.model, config))
    result = summary(flights, first.left, LoopEnd(config, state, steps, stopped, discovery))
    result = result.model_copy(update={"account": loop.account(turns, state), "families": steps[0].families})
    if config.maximum_likelihood:
        say("maximum likelihood of the final model")
        result = result.model_copy(update={"ml": maximum_likelihood(state)})
    return result.model_copy(update={"seconds": clock.perf_counter() - begun})


def confirmed(steps: Sequence[Step], beside: Beside) -> tuple[Step, ...]:
    """The steps, whose findings are hints where processes explain the flight as well as the effect does beside the
    final model, leave that model inadequate, or those of the effect's family have much to explain beside it.
    """
    gains = {name: beside.gain(name) for name in beside.terms}
    adequate = beside.is_adequate([name for name, gain in gains.items() if gain > -SPECIFIC])
    kept = {n for n, gain in gains.items() if gain >= SPECIFIC and adequate and beside.rest_of_family(n) <= FAMILY_REST}
    return tuple(
        step.model_copy(update={"standing": "hint"}) if step.standing == "finding" and step.added not in kept else step
        for step in steps
    )


def _declared(mechanisms: Sequence[Mechanism], data: Corrected) -> tuple[Regressor, ...]:
    """Every term of mechanisms that leave no choice in time, of all flights together or of each."""
    motion, always, several = data.reconstructions[0].motion, TimeBasis("constant"), len(data.flights) > 1
    return tuple(
        term_column(m, term, (), always, flight)
        for m in mechanisms
        for flight in (range(len(data.flights)) if several and m.of_each_flight(data.flights[0]) else (None,))
        for term in m.terms(motion, {})
    )


def _candidates(config: TraceConfig) -> tuple[tuple[Mechanism, ...], tuple[RecordEffect, ...]]:
    if config.effects is None:
        return mechanisms("mechanism") + mechanisms("aerodynamic"), record_effects()
    items = [find_installed(name) for name in config.effects]
    return (
        tuple(item for item in items if isinstance(item, Mechanism)),
        tuple(item for item in items if isinstance(item, RecordEffect)),
    )


@dataclass(frozen=True)
class Turn:
    """One step with the state that it started from, the one that it led to, and why the loop may end here."""

    step: Step
    before: State
    after: State | None
    reason: Stop
    discovery: Discovery | None


@dataclass(frozen=True)
class _Loop:
    """What stays the same over the steps."""

    flights: tuple[Flight, ...]
    config: TraceConfig
    mechanisms: tuple[Mechanism, ...]
    effects: tuple[RecordEffect, ...]

    def begin(self) -> State:
        """The model that the trace starts from."""
        start = self.config.start
        if not isinstance(start, str):
            return converged_state(self.flights, restored(start, self.flights), self.config)
        held = parse_hypothesis(start)
        model = start_model(self.flights, held, self.config.baseline, self.config.aero)
        data = correct(self.flights, model, self.config)
        model = replace(model, columns=starting_columns(model, data.frame), added=tuple(m.name for m in held))
        model = with_priors(model, data)
        chosen = tuple(m for m in held if m.time_variation != ("constant",) or m.parameters())
        declared = tuple(m for m in held if m not in chosen)
        model = replace(model, columns=(*model.columns, *_declared(declared, data)))
        if chosen:
            state = converged_state(self.flights, model, self.config)
            model = replace(model, columns=fit_hypothesis(state.problem, "start", chosen).columns)
        return converged_state(self.flights, model, self.config)

    def account(self, turns: Sequence[Turn], last: State) -> tuple[Account, ...]:
        """The held-out error of one model after another, from constant coefficients to the last."""
        first, added = turns[0].before, [turn.step.added for turn in turns if turn.step.added is not None]
        config, start = self.config, "constant"
        models: list[tuple[str, Prediction]] = []
        if config.start != "none" or config.aero is not None:
            start = "the model given"
        elif has_schedule(first.model):
            plain = replace(self, config=config.model_copy(update={"baseline": "constant"}))
            models, start = [(start, plain.begin().held_out)], "scheduled"
        errors = [*(turn.before.held_out for turn in turns[: len(added)]), last.held_out]
        models += zip((start, *added), errors, strict=True)
        return tuple(Account(model=name, held_out=each.mean_square, std_error=each.std_error) for name, each in models)

    def turn(self, number: int, state: State, before: Sequence[Step]) -> Turn:
        """One step: the residual, the candidates, and the model with the best of them if it is needed.

        What steps `before` added and is not wanted beside it is removed.
        """
        usable = tuple(m for m in self.mechanisms if _applicable(m, state.data))
        motion = state.data.frame.motions[0]
        bends = [m for m in usable if StaticBend.name in state.model.mechanisms and is_bend(m, motion)]
        untried = [m for m in usable if m not in bends and _may_join(m, state.model, len(self.flights))]
        effects = [e for e in self.effects if not _held_everywhere(e.name, state.model, len(self.flights))]
        here = analyse_step(state.data, state.model, state.linear, untried, effects, self.config)
        state = state_of(state.model, state.data, here.problem, state.linear)
        residual = find(here, state.left)
        beside = beside_processes(state, state.model, self.config, state.data.fitted, here.problem.given)
        here = with_evidence(here, beside)
        choice = self._choice(here, state, beside, here.discovery, white=residual.white)
        if choice.accepted is None and bends and (named := self._naming_the_bend(number, state, bends)) is not None:
            return named
        return self._turn(number, residual, here, state, choice, before)

    def _naming_the_bend(self, number: int, state: State, bends: Sequence[Mechanism]) -> Turn | None:
        """The step that gives the bend of the static moment its name; None where it may as well be none.

        Every effect is tried beside the bend that bodies have. That this one has any is asked once nothing else is
        added, of a model without it.
        """
        model = without(state.model, [StaticBend.name])
        bare, config = first_state(model, state.data, self.config), self.config.model_copy(update={"discover": False})
        here = analyse_step(bare.data, model, bare.linear, bends, (), config)
        bare = state_of(model, bare.data, here.problem, bare.linear)
        residual = find(here, bare.left)
        beside = beside_processes(bare, model, self.config, bare.data.fitted)
        here = with_evidence(here, beside)
        choice = self._choice(here, bare, beside, None, white=residual.white)
        return self._turn(number, residual, here, bare, choice, ()) if choice.accepted else None

    def _turn(
        self, number: int, residual: Residual, here: Analysis, state: State, choice: Choice, before: Sequence[Step]
    ) -> Turn:
        """The step of a choice, and the model with what was chosen."""
        step = self._decomposed(step_of(number, residual, here, state, choice, before), state, choice.accepted)
        reason: Stop = "white" if residual.white else "nothing significant"
        if choice.tried:
            reason = "nothing improves held-out error"
        after = choice.accepted.state if choice.accepted else None
        if after is not None and choice.accepted is not None and choice.accepted.candidate.effect is None:
            # Beside a model that lacked the effect, the errors of the record had taken up some of it.
            after = converged_state(self.flights, after.model, self.config)
        others = [each.added for each in before if each.added is not None and each.added != step.added]
        if after is not None and (gone := unwanted(after, others, self.config)):
            after = converged_state(self.flights, without(after.model, gone), self.config)
            step = step.model_copy(update={"taken_out": gone})
        return Turn(step, state, after, reason, _counting(choice, self.config.significance))

    def _decomposed(self, step: Step, state: State, tried: Tried | None) -> Step:
        """The step with what each family explains of its residual: what was added only where it is established."""
        beside = beside_processes(state if tried is None else tried.state, state.model, self.config)
        established = tried is not None and tried.candidate.kind != "discovered" and (tried.gain or 0.0) >= SPECIFIC
        found = beside.shares([tried.candidate.name] if tried is not None and established else [])
        shares = {**dict.fromkeys(FAMILIES, 0.0), **{each.family: each.share for each in found}}
        return step.model_copy(update={"families": shares, "decomposition": found})

    def _choice(
        self, here: Analysis, state: State, beside: Beside, discovery: Discovery | None, white: bool = False
    ) -> Choice:
        def add(candidate: Candidate) -> State:
            found = with_candidate(self.flights, self.config, here, state, candidate)
            if not follows_mach(candidate) or has_schedule(state.model):
                return found
            return converged_state(self.flights, scheduled(found.model, found.data), self.config)

        known = has_schedule(state.model)

        def weighed(found: State) -> tuple[float, bool]:
            there = beside_processes(found, state.model, self.config, found.data.fitted)
            gain = there.gain(own := found.model.added[-1])
            gain = gain if gain >= 0.0 else max(gain, min(there.gain_in_place(own), 0.0))
            return gain, gain >= SPECIFIC or beside.majority in (None, there.families[own])

        choice = choose(here, state, discovery, self.config.significance, add, white, known, weighed)
        if choice.accepted is None:
            return choice
        name = choice.accepted.candidate.name
        offered = [each for each in choice.ranked if each.name not in choice.unwanted]
        if not known and is_schedule(choice.accepted.candidate):  # where the model has no schedule, one comes first
            offered = list(schedules_first(offered))
        return replace(choice, named_in=named_in(beside, offered, name, state.data, self.config))


def _counting(choice: Choice, significance: float) -> Discovery | None:
    """The description in generic terms, where it is significant and no name took its place."""
    found, accepted = choice.discovery, choice.accepted
    if found is None:
        return None
    if accepted is not None and accepted.candidate is not found.candidate:
        return found if found.candidate.name in confounded(accepted.candidate, choice.ranked) else None
    return found if adjusted(choice.ranked)[found.candidate.name] <= significance else None


def _may_join(mechanism: Mechanism, model: Model, flights: int) -> bool:
    """Whether columns of the mechanism may be added: what changes in time may be described better by more of them."""
    return mechanism.time_variation != ("constant",) or not _held_everywhere(mechanism.name, model, flights)


def _held_everywhere(name: str, model: Model, flights: int) -> bool:
    """Whether the effect was added for all of the flights: to those that lack it, it may be added yet."""
    own = {column.flight for column in model.columns if column.mechanism == name}
    own |= {applied.flight for applied in model.applied if applied.effect.name == name}
    return name in model.added and (None in own or len(own) in (0, flights))


def _applicable(mechanism: Mechanism, data: Corrected) -> bool:
    """Whether the records hold what the mechanism needs, such as the Mach number."""
    theta = {parameter.name: parameter.grid[0] for parameter in mechanism.parameters()}
    return all(
        np.all(np.isfinite(term.in_plane)) and np.all(np.isfinite(term.out_of_plane))
        for reconstruction in data.reconstructions
        for term in mechanism.terms(reconstruction.motion, theta)
    )
