"""`trace`: find the residual, trace it to an effect, add that effect, and again, until nothing is left to
explain.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.design.whitening import NoiseModel, difference
from brv_hypo.errors import UnanswerableError
from brv_hypo.flight.record import Flight
from brv_hypo.mechanisms.contract import Mechanism, RecordEffect
from brv_hypo.mechanisms.registry import find_installed, mechanisms, parse_hypothesis, record_effects
from brv_hypo.ranking.noise import baseline_columns
from brv_hypo.trace.candidates import NEAR, Candidate, adjusted, look_alikes
from brv_hypo.trace.config import TraceConfig
from brv_hypo.trace.discover import Discovery, discover
from brv_hypo.trace.find import find
from brv_hypo.trace.judge import (
    Prediction,
    ResidualMoments,
    moment_errors,
    ratio,
    residual_moments,
    score,
)
from brv_hypo.trace.result import Errors, Residual, Step, Stop, Trace, TriedCandidate
from brv_hypo.trace.step import (
    Applied,
    Look,
    Model,
    Seen,
    bare_task,
    look,
    see,
    start_columns,
    start_model,
)
from brv_hypo.trace.summary import Ending, summary
from brv_hypo.trace.task import TraceTask, solution

Progress = Callable[[str], None]
SMALLEST_RECORD = 120
_TOLD = 8
_GENERIC = 4
# The held-out error has to fall by this many of its standard errors.
_SIGMAS = 2.5
# Fall of the squared whitened rates above which an effect shows in the moments.
_SHOWN = 12.0


def trace(flight: Flight, config: TraceConfig | None = None, *, progress: Progress | None = None) -> Trace:
    """Trace what a model lacks on one flight, effect by effect.

    Raises UsageError for an unknown effect and UnanswerableError where the record is too short.
    """
    config = config or TraceConfig()
    say = progress or (lambda message: None)
    begun = clock.perf_counter()
    if flight.samples < SMALLEST_RECORD:
        raise UnanswerableError(
            f"the record holds {flight.samples} samples in the window, expected at least {SMALLEST_RECORD}: too few to "
            "hold any out. Widen --start and --stop."
        )
    course = _Course(flight, config, *_candidates(flight, config))
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
    end = Ending(
        state.seen, state.model, state.values, state.noise, state.left, tuple(steps), stopped, discovery
    )
    return summary(flight, first.left, end, clock.perf_counter() - begun)


def _candidates(
    flight: Flight, config: TraceConfig
) -> tuple[tuple[Mechanism, ...], tuple[RecordEffect, ...]]:
    if config.effects is None:
        return mechanisms("mechanism") + mechanisms("aerodynamic"), record_effects()
    items = [find_installed(name) for name in config.effects]
    return (
        tuple(item for item in items if isinstance(item, Mechanism)),
        tuple(item for item in items if isinstance(item, RecordEffect)),
    )


@dataclass(frozen=True)
class State:
    """A model with its coefficients, the flight as it is seen with it, and the moments that it leaves."""

    model: Model
    seen: Seen
    values: FloatArray
    noise: NoiseModel
    left: ResidualMoments
    errors: Prediction
    held_out: Prediction


@dataclass(frozen=True)
class Tried:
    """What an effect did to the held-out part: `score` in both channels, `ratio` of the moments' mean
    squares.
    """

    state: State
    score: float
    ratio: float
    ratio_error: float


@dataclass(frozen=True)
class Choice:
    """The effect that counts, if any; what came of trying it; the model with it, where the held-out part
    agrees.
    """

    ranked: tuple[Candidate, ...]
    discovery: Discovery | None
    leader: Candidate | None = None
    tried: Tried | None = None
    taken: bool = False


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
        start = parse_hypothesis(self.config.start)
        model = start_model(self.flight, start)
        seen = see(self.flight, model, self.config)
        columns = baseline_columns(seen.frame)
        noise = seen.first_noise(columns)
        if start:
            columns = start_columns(seen, columns, noise, start, self.config)
            noise = seen.first_noise(columns)
        model = replace(model, columns=columns, added=tuple(m.name for m in start))
        return self._state(model, seen, noise, None)

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
            usable,
            self.config,
            most_generic=min(self._generic, 1),
        )
        state = self._state(state.model, state.seen, here.task.noise, here.task)
        residual = find(here, state.left)
        choice = self._choice(here, state, here.discovery)
        if not choice.taken and self._generic and not residual.white:
            more = discover(here.task, here.null, _generic_name(state.model), self._generic)
            described = self._choice(here, state, more)
            choice = described if described.taken else choice
        step = _step(number, residual, here, state, choice, self.config.significance)
        reason: Stop = "white" if residual.white else "nothing significant"
        if choice.leader is not None:
            reason = "nothing improves held-out error"
        after = choice.tried.state if choice.tried is not None and choice.taken else None
        return Turn(step, state, after, reason, _counting(choice, self.config.significance))

    @property
    def _generic(self) -> int:
        return _GENERIC if self.config.discover else 0

    def _choice(self, here: Look, state: State, discovery: Discovery | None) -> Choice:
        """The best effect that counts and shows in the moments, tried on the held-out part.

        An effect that the specific force shows and the moments do not is named, but it cannot lower their
        error.
        """
        ranked = tuple(_ranked(here.candidates, discovery))
        chances = adjusted(ranked)
        counting = [c for c in ranked if c.gain > 0.0 and chances[c.name] <= self.config.significance]
        leader = next((c for c in counting if c.in_rates > _SHOWN), None)
        if leader is None:
            return Choice(ranked, discovery, counting[0] if counting else None)
        after = self._with(here, state, leader)
        fallen = score(here.task, state.seen.held_out, here.null, leader.fit)
        tried = Tried(after, fallen, *ratio(state.held_out, after.held_out))
        return Choice(ranked, discovery, leader, tried, fallen >= _SIGMAS and tried.ratio < 1.0)

    def _with(self, here: Look, state: State, leader: Candidate) -> State:
        """The model with the leader added, fitted to the fitted part."""
        model = state.model
        if leader.effect is None:
            known = {**model.mechanisms, **{m.name: m for m in leader.fit.mechanisms}}
            model = replace(
                model, mechanisms=known, columns=leader.fit.columns, added=(*model.added, leader.name)
            )
            seen = replace(state.seen, frame=leader.fit.frame)
            return self._state(model, seen, here.task.noise, here.task)
        values = leader.fit.values[leader.fit.baseline_size :]
        sizes = {component: (units, size) for component, units, size in leader.effect.components()}
        applied = tuple(
            Applied(leader.effect, component, *sizes[component], float(value))
            for column, value in zip(leader.fit.selected, values, strict=True)
            for component in [here.components[column.term]]
        )
        model = replace(model, applied=(*model.applied, *applied), added=(*model.added, leader.name))
        seen = see(self.flight, model, self.config)
        task = bare_task(seen, model, state.values, here.task.both)
        return self._state(model, seen, here.task.noise, task)

    def _state(self, model: Model, seen: Seen, noise: NoiseModel, task: TraceTask | None) -> State:
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
            found.append(State(model, seen, values, noise, left, errors, held_out))
        return min(found, key=lambda state: state.errors.mean_square)


def _step(
    number: int, residual: Residual, here: Look, state: State, choice: Choice, significance: float
) -> Step:
    """What the result tells of one step."""
    leader, tried = choice.leader, choice.tried
    chances = adjusted(choice.ranked)
    return Step(
        step=number,
        residual=residual,
        candidates=tuple(_told(c, chances, here, choice.discovery) for c in choice.ranked[:_TOLD]),
        look_alikes=look_alikes(leader, choice.ranked) if leader else (),
        added=leader.name if leader and choice.taken else None,
        description=_words(leader, here, choice.discovery) if leader else "",
        error_before=_errors(state),
        error_after=None if tried is None else _errors(tried.state),
        error_ratio_held_out=None if tried is None else tried.ratio,
        error_ratio_std_error=None if tried is None else tried.ratio_error,
        held_out_score=None if tried is None else tried.score,
    )


def _counting(choice: Choice, significance: float) -> Discovery | None:
    """The description in generic terms, where it is significant and no name took its place."""
    found = choice.discovery
    if found is None:
        return None
    leader = choice.leader
    if choice.taken and leader is not None and leader is not found.candidate:
        return found if found.candidate.name in look_alikes(leader, choice.ranked) else None
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


def _errors(state: State) -> Errors:
    return Errors(fit=state.errors.mean_square, held_out=state.held_out.mean_square)


def _ranked(found: Sequence[Candidate], discovery: Discovery | None) -> list[Candidate]:
    """The candidates, best first; a description in generic terms has to beat a name clearly."""
    both = [*found, *([discovery.candidate] if discovery else [])]
    handicap = {"discovered": NEAR}
    return sorted(both, key=lambda candidate: handicap.get(candidate.kind, 0.0) - candidate.gain)


def _generic_name(model: Model) -> str:
    return f"discovered_{len(model.added) + 1}"


def _told(
    candidate: Candidate, chances: dict[str, float], here: Look, discovery: Discovery | None
) -> TriedCandidate:
    return TriedCandidate(
        effect=candidate.name,
        kind=candidate.kind,
        f_ratio=candidate.f_ratio,
        p_value_adjusted=chances[candidate.name],
        explains=candidate.explains,
        description=_words(candidate, here, discovery),
    )


def _words(candidate: Candidate, here: Look, discovery: Discovery | None) -> str:
    """What the candidate says of this flight."""
    if candidate.kind == "discovered" and discovery is not None:
        return discovery.words
    values = candidate.fit.values[candidate.fit.baseline_size :]
    where = "" if candidate.in_rates > _SHOWN else " (in the specific force only)"
    if candidate.effect is not None:
        when = getattr(candidate.effect, "time", None)
        sizes = ", ".join(
            f"{here.components[column.term]} {value:.3g} {column.units}"
            for column, value in zip(candidate.fit.selected, values, strict=True)
        )
        return (sizes if when is None else f"{sizes} at {when:.3f} s") + where
    return ", ".join(
        f"{column.label} {value:.3g}"
        + (
            ""
            if column.course.kind == "constant"
            else f" at {max(column.course.start, float(here.seen.flight.time[0])):.2f} s"
        )
        for column, value in zip(candidate.fit.selected, values, strict=True)
    )
