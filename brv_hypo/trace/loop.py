"""`trace`: find the residual, trace it to an effect, add that effect, and again, until nothing is left to explain."""

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
from brv_hypo.trace.judge import Prediction, moment_errors, ratio, residual_moments, score
from brv_hypo.trace.result import Errors, Step, Stop, Trace, TriedCandidate
from brv_hypo.trace.step import Applied, Look, Model, Seen, look, see, start_columns, start_model
from brv_hypo.trace.summary import Ending, summary

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
    first = state
    discovery: Discovery | None = None
    for number in range(1, config.max_steps + 1):
        say(f"step {number}: trying the effects")
        step, after, reason, found = course.turn(number, state)
        steps.append(step)
        discovery = found or discovery
        if after is None:
            stopped = reason
            break
        state = after
    end = Ending(state.seen, state.model, state.noise, tuple(steps), stopped, discovery)
    return summary(flight, first.seen, first.model, end, clock.perf_counter() - begun)


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
    """A model with its coefficients, and the flight as it is seen with it."""

    model: Model
    seen: Seen
    values: FloatArray
    noise: NoiseModel
    errors: Prediction
    held_out: Prediction


@dataclass(frozen=True)
class Tried:
    """What an effect did to the held-out part: `score` in both channels, `ratio` of the moments' mean squares."""

    state: State
    score: float
    ratio: float
    ratio_error: float


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
        return self._state(replace(model, columns=columns, added=tuple(m.name for m in start)), seen, noise)

    def turn(self, number: int, state: State) -> tuple[Step, State | None, Stop, Discovery | None]:
        """One step: the residual, the candidates, and the model with the best of them if it is needed."""
        usable = tuple(m for m in self.mechanisms if _applicable(m, state.seen))
        untried = [m for m in usable if m.name not in state.model.added]
        effects = [e for e in self.effects if e.name not in state.model.added]
        most = _GENERIC if self.config.discover else 0
        here = look(
            state.seen,
            state.model,
            state.values,
            untried,
            effects,
            usable,
            self.config,
            most_generic=min(most, 1),
        )
        state = self._state(state.model, state.seen, here.task.noise)
        residual = find(here, state.values)
        ranked = _ranked(here.candidates, here.discovery)
        leader, after, tried = self._judged(here, state, ranked)
        if after is None and most and not residual.white:
            discovery = discover(here.task, here.null, _generic_name(state.model), most)
            if discovery is not None:
                ranked = [discovery.candidate, *here.candidates]
                here = replace(here, discovery=discovery)
                leader, after, tried = self._judged(here, state, ranked)
        chances = adjusted(ranked)
        step = Step(
            step=number,
            residual=residual,
            candidates=tuple(_told(c, chances, here) for c in ranked[:_TOLD]),
            look_alikes=look_alikes(leader, ranked) if leader else (),
            added=leader.name if leader and after else None,
            description=_words(leader, here) if leader else "",
            error_before=_errors(state),
            error_after=None if tried is None else _errors(tried.state),
            error_ratio_held_out=None if tried is None else tried.ratio,
            error_ratio_std_error=None if tried is None else tried.ratio_error,
            held_out_score=None if tried is None else tried.score,
        )
        nothing: Stop = "white" if residual.white else "nothing significant"
        counts = (
            here.discovery is not None
            and adjusted(ranked)[here.discovery.candidate.name] < self.config.significance
        )
        reason: Stop = "nothing improves held-out error" if tried is not None else nothing
        if leader is not None and tried is None:
            reason = "nothing improves held-out error"
        return step, after, reason, here.discovery if counts else None

    def _judged(
        self, here: Look, state: State, ranked: Sequence[Candidate]
    ) -> tuple[Candidate | None, State | None, Tried | None]:
        """The leader where one counts, the model with it where the held-out part agrees, and what came of trying.

        An effect that the specific force shows and the moments do not is named, but it cannot lower their error.
        """
        chances = adjusted(ranked)
        counting = [c for c in ranked if c.gain > 0.0 and chances[c.name] <= self.config.significance]
        leader = next((c for c in counting if c.in_rates > _SHOWN), None)
        if leader is None:
            return (counting[0] if counting else None), None, None
        after = self._with(here, state, leader)
        fallen = score(here.task, state.seen.held_out, here.null, leader.fit)
        tried = Tried(after, fallen, *ratio(state.held_out, after.held_out))
        taken = fallen >= _SIGMAS and tried.ratio < 1.0
        return leader, after if taken else None, tried

    def _with(self, here: Look, state: State, leader: Candidate) -> State:
        """The model with the leader added, fitted to the fitted part."""
        model = state.model
        if leader.effect is None:
            known = {**model.mechanisms, **{m.name: m for m in leader.fit.mechanisms}}
            model = replace(
                model, mechanisms=known, columns=leader.fit.columns, added=(*model.added, leader.name)
            )
            return self._state(model, replace(state.seen, frame=leader.fit.frame), here.task.noise)
        values = leader.fit.values[leader.fit.baseline_size :]
        sizes = {component: (units, size) for component, units, size in leader.effect.components()}
        applied = tuple(
            Applied(leader.effect, component, *sizes[component], float(value))
            for column, value in zip(leader.fit.selected, values, strict=True)
            for component in [here.components[column.term]]
        )
        model = replace(model, applied=(*model.applied, *applied), added=(*model.added, leader.name))
        seen = see(self.flight, model, self.config)
        return self._state(model, seen, here.task.noise)

    def _state(self, model: Model, seen: Seen, noise: NoiseModel) -> State:
        """The model's coefficients on the fitted part, and its errors.

        A model that lacks something fits the moments badly under the noise of one that does not; plain least squares of
        the moments are tried too, and the smaller error of the fitted part decides.
        """
        found = []
        for weight in (noise, difference()):
            values = seen.values(seen.fitted, model.columns, weight)
            left = residual_moments(seen.frame, seen.record, model.columns, values)
            errors, held_out = (moment_errors(part, left) for part in (seen.fitted, seen.held_out))
            found.append(State(model, seen, values, noise, errors, held_out))
        return min(found, key=lambda state: state.errors.mean_square)


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


def _told(candidate: Candidate, chances: dict[str, float], here: Look) -> TriedCandidate:
    return TriedCandidate(
        effect=candidate.name,
        kind=candidate.kind,
        f_ratio=candidate.f_ratio,
        p_value_adjusted=chances[candidate.name],
        explains=candidate.explains,
        description=_words(candidate, here),
    )


def _words(candidate: Candidate, here: Look) -> str:
    """What the candidate says of this flight."""
    if candidate.kind == "discovered" and here.discovery is not None:
        return here.discovery.words
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
        + ("" if column.course.kind == "constant" else f" at {column.course.start:.2f} s")
        for column, value in zip(candidate.fit.selected, values, strict=True)
    )
