"""`trace`: find the residual, trace it to an effect, add that effect, and again, until nothing is left to
explain.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from brv_hypo.errors import UnanswerableError
from brv_hypo.flight import FlightSource, one_flight
from brv_hypo.flight.record import Flight
from brv_hypo.mechanisms.contract import Mechanism, RecordEffect
from brv_hypo.mechanisms.registry import find_installed, mechanisms, parse_hypothesis, record_effects
from brv_hypo.regression.build import baseline_columns
from brv_hypo.regression.fit import fit_hypothesis
from brv_hypo.residuals.candidates import Candidate, adjusted, look_alikes
from brv_hypo.residuals.candidates_at_step import Look, generic_name, look
from brv_hypo.residuals.choice import Choice, Tried, choose
from brv_hypo.residuals.config import TraceConfig
from brv_hypo.residuals.discover import Discovery, discover
from brv_hypo.residuals.find import find
from brv_hypo.residuals.fitted_model import State, refitted, settled_state, state_of, with_candidate
from brv_hypo.residuals.likelihood import maximum_likelihood
from brv_hypo.residuals.linearisation import Seen, see, start_model
from brv_hypo.residuals.restore import restored
from brv_hypo.residuals.result import Step, Stop, Trace
from brv_hypo.residuals.step_report import step_of
from brv_hypo.residuals.summary import Ending, summary

Progress = Callable[[str], None]
SMALLEST_RECORD = 120
_GENERIC = 4


def trace(flight: FlightSource, config: TraceConfig | None = None, *, progress: Progress | None = None) -> Trace:
    """Trace what a model lacks on one flight (a path, a `Flight` or a simulated flight), effect by effect.

    Raises UsageError for an unknown effect and UnanswerableError where the record is too short.
    """
    record = one_flight(flight)
    if record.samples < SMALLEST_RECORD:
        raise UnanswerableError(
            f"the record holds {record.samples} samples in the window, expected at least {SMALLEST_RECORD}: too few to "
            "hold any out. Widen --start and --stop."
        )
    config = config or TraceConfig()
    with threadpool_limits(limits=1, user_api="blas"):  # the matrices are small: threads only cost
        return _trace(record, config, progress or (lambda message: None))


def _trace(flight: Flight, config: TraceConfig, say: Progress) -> Trace:
    begun = clock.perf_counter()
    course = _Course(flight, config, *_candidates(config))
    steps: list[Step] = []
    stopped: Stop = "limit"
    say("reconstructing the motion")
    state = course.begin()
    first: State | None = None
    discovery: Discovery | None = None
    for number in range(1, config.max_steps + 1):
        say(f"step {number}: trying the effects")
        turn = course.turn(number, state)
        first = first or turn.before
        steps.append(turn.step)
        if turn.discovery is not None and (turn.after is not None or discovery is None):
            discovery = turn.discovery
        state = turn.after or turn.before
        if turn.after is None:
            stopped = turn.reason
            break
    assert first is not None
    end = Ending(config, refitted(flight, config, state), tuple(steps), stopped, discovery)
    result = summary(flight, first.left, end)
    if config.maximum_likelihood:
        say("maximum likelihood of the final model")
        result = result.model_copy(update={"ml": maximum_likelihood(end.state)})
    return result.model_copy(update={"seconds": clock.perf_counter() - begun})


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
class _Course:
    """What stays the same over the steps."""

    flight: Flight
    config: TraceConfig
    mechanisms: tuple[Mechanism, ...]
    effects: tuple[RecordEffect, ...]

    def begin(self) -> State:
        """The model that the trace starts from."""
        start = self.config.start
        if not isinstance(start, str):
            return settled_state(self.flight, restored(start, self.flight), self.config)
        held = parse_hypothesis(start)
        model = start_model(self.flight, held, self.config.baseline)
        seen = see(self.flight, model, self.config)
        model = replace(model, columns=baseline_columns(seen.frame), added=tuple(m.name for m in held))
        if held:
            state = settled_state(self.flight, model, self.config)
            model = replace(model, columns=fit_hypothesis(state.problem, "start", held).columns)
        return settled_state(self.flight, model, self.config)

    def turn(self, number: int, state: State) -> Turn:
        """One step: the residual, the candidates, and the model with the best of them if it is needed."""
        usable = tuple(m for m in self.mechanisms if _applicable(m, state.seen))
        untried = [m for m in usable if m.name not in state.model.added]
        effects = [e for e in self.effects if e.name not in state.model.added]
        here = look(
            state.seen,
            state.model,
            state.values,
            untried,
            effects,
            self.config,
        )
        state = state_of(state.model, state.seen, here.problem)
        residual = find(here, state.left)
        choice = self._choice(here, state, here.discovery, white=residual.white)
        if choice.taken is None and here.dictionary is not None and not residual.white:
            more = discover(here.problem, here.null, here.dictionary, generic_name(state.model), _GENERIC)
            described = self._choice(here, state, more, choice.tried)
            choice = described if described.taken else choice
        step = step_of(number, residual, here, state, choice, self.config)
        reason: Stop = "white" if residual.white else "nothing significant"
        if choice.tried:
            reason = "nothing improves held-out error"
        after = choice.taken.state if choice.taken else None
        if after is not None and choice.taken is not None and choice.taken.candidate.effect is None:
            # Beside a model that lacked the effect, the errors of the record had taken up some of it.
            after = settled_state(self.flight, after.model, self.config)
        return Turn(step, state, after, reason, _counting(choice, self.config.significance))

    def _choice(
        self, here: Look, state: State, discovery: Discovery | None, before: Sequence[Tried] = (), white: bool = False
    ) -> Choice:
        def add(candidate: Candidate) -> State:
            return with_candidate(self.flight, self.config, here, state, candidate)

        return choose(here, state, discovery, self.config.significance, add, before, white)


def _counting(choice: Choice, significance: float) -> Discovery | None:
    """The description in generic terms, where it is significant and no name took its place."""
    found = choice.discovery
    if found is None:
        return None
    if choice.taken is not None and choice.taken.candidate is not found.candidate:
        similar = look_alikes(choice.taken.candidate, choice.ranked)
        return found if found.candidate.name in similar else None
    if adjusted(choice.ranked)[found.candidate.name] > significance:
        return None
    return found


def _applicable(mechanism: Mechanism, seen: Seen) -> bool:
    """Whether the record holds what the mechanism needs, such as the Mach number."""
    motion = seen.reconstruction.motion
    theta = {parameter.name: parameter.grid[0] for parameter in mechanism.parameters()}
    return all(
        np.all(np.isfinite(term.in_plane)) and np.all(np.isfinite(term.out_of_plane))
        for term in mechanism.terms(motion, theta)
    )
