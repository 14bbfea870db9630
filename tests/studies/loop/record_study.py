"""Known effects planted, undeclared, into a measured record: are they found?

By hand: python -m tests.studies.loop.record_study FLIGHT.h5 --effects magnus,stiffness_asymmetry --times 5

Each is planted at so many times its detection limit on that record, and traced from the model that the record itself
ends with. The errors before and after are those of the step that adds it.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from brv_hypo.arrays import FloatArray
from brv_hypo.errors import UnanswerableError
from brv_hypo.flight.format import load_flight
from brv_hypo.flight.record import Flight
from brv_hypo.inference.fit import fit_hypothesis
from brv_hypo.inference.problem import Problem, given_column
from brv_hypo.mechanisms.contract import Mechanism, RecordEffect
from brv_hypo.mechanisms.registry import find, find_installed
from brv_hypo.model.baseline import StaticBend
from brv_hypo.model.model import Model, SavedModel, read_structure, restored
from brv_hypo.model.term import Regressor, TimeBasis
from brv_hypo.tracing import Trace, TraceConfig, trace
from brv_hypo.tracing.additions import analyse_step
from brv_hypo.tracing.baseline import is_bend
from brv_hypo.tracing.families import RECORD_EFFECT_LARGEST
from brv_hypo.tracing.fit import Fit, Flights, converged
from tests.studies.loop.planting import DETECTED, free_length, free_part
from tests.studies.loop.planting_on_record import with_moment

FAMILIES = 3  # printed


@dataclass(frozen=True)
class Ground:
    """A measured record with the model that it ends with, and its regression there."""

    flight: Flight
    model: SavedModel
    state: Fit
    here: Fit


def ground(flight: Flight, steps: int) -> Ground:
    """The record traced for `steps` steps; with none, its scheduled baseline alone."""
    settings = TraceConfig(max_steps=max(steps, 1))
    if steps == 0:
        settings = settings.model_copy(update={"effects": (), "discover": False})
    return with_model(flight, trace(flight, settings).model.definition)


def with_model(flight: Flight, found: SavedModel) -> Ground:
    """The record with a model that was found on it."""
    settings = TraceConfig()
    with threadpool_limits(limits=1, user_api="blas"):
        state = converged(Flights((flight,), settings), restored(found, (flight,)))
        here, _ = analyse_step(state, (), ())
    return Ground(flight, found, state, here)


def planted(base: Ground, effect: str, times: float, seed: int, onset: float | None = None) -> tuple[Flight, str]:
    """The record with the effect at `times` its detection limit, in a random direction of its terms; its size.

    A moment that may change in time begins at `onset` (s), where one is given. One that the vehicle could not bear is
    planted with the other sign. Raises UnanswerableError where nothing of that size is possible.
    """
    draw = np.random.default_rng([seed, *(ord(letter) for letter in effect)])
    item = find_installed(effect)
    if isinstance(item, RecordEffect):
        return _with_error(base, item, times, draw)
    if item.parameters():
        raise UnanswerableError(f"{effect} looks back in time; what is planted acts on the motion of the instant alone")
    motion = base.state.data.frame.motions[0]
    ground_of = _unbent(base) if is_bend(item, motion) else base
    names = [term.name for term in item.terms(motion, {})]
    direction = draw.standard_normal(len(names)) if item.terms_enter_together else np.eye(len(names))[-1]
    begin = None if item.time_variation == ("constant",) else onset
    values = times * _limit(ground_of.here, effect, names, direction, begin) * direction
    try:
        flight = with_moment(base.flight, base.state, item, values.tolist(), begin)
    except UnanswerableError:
        values = -values
        flight = with_moment(base.flight, base.state, item, values.tolist(), begin)
    words = ", ".join(f"{name} {value:.3g}" for name, value in zip(names, values, strict=True))
    words += "" if begin is None else f" from {begin:.0f} s"
    there, shown = limits_there(ground_of, flight, item, values, begin)
    return flight, f"{words}, {there:.1f} limits on the motion that it makes, of which the record shows {shown:.1f}"


def _unbent(base: Ground) -> Ground:
    """The record with a model whose static moment does not bend: the loop tests whether it does."""
    columns = tuple(column for column in base.model.columns if column.mechanism != StaticBend.name)
    return with_model(base.flight, base.model.model_copy(update={"columns": columns, "bend": None}))


def limits_there(
    base: Ground, flight: Flight, item: Mechanism, values: FloatArray, onset: float | None
) -> tuple[float, float]:
    """How many detection limits the planted moment is on the record that it made, and how many that record shows.

    It acts on the changed motion. The first counts the model's residual as noise, which no moment goes with. On a
    record that the model does not explain, residual and nuisance effects may absorb the planted moment, or
    give as much again: the second is what there is of it beside the model, at its time and with its terms.
    """
    model = restored(base.model, (flight,))
    names = [term.name for term in item.terms(base.state.data.frame.motions[0], {})]
    own = tuple(Regressor(item.name, name, (), _time_basis(onset), "1") for name in names)
    settings = TraceConfig()
    both = model + Model(mechanisms={item.name: item}, columns=own)
    with threadpool_limits(limits=1, user_api="blas"):
        problem = converged(Flights((flight,), settings), both).problem
        problem = replace(problem, efficiency=problem.efficiency_of(fit_hypothesis(problem, "none", ()).residual))
        others, last = problem.baseline[: -len(own)], problem.baseline[-len(own) :]
        moment = problem.design(problem.frame, last) @ values
        problem = replace(problem, baseline=others)
        there, residual = 1.0 / _limit_of(problem, moment), free_part(problem, problem.response)
        free = free_part(problem, moment)
        return there, there * float(free @ residual) / float(free @ free)


def _with_error(base: Ground, effect: RecordEffect, times: float, draw: np.random.Generator) -> tuple[Flight, str]:
    """The record with an error of one component of an instrument, of those that have errors so large."""
    with threadpool_limits(limits=1, user_api="blas"):
        here, _ = analyse_step(base.state, (), (effect,))
    problem = replace(here.problem, efficiency=here.problem.efficiency_of(here.null.residual))
    limits = {
        component: _limit_of(problem, problem.design(problem.frame, [given_column(name)])[:, 0])
        for name in problem.given
        for component in effect.components(base.flight)
        if f" {component.name} " in name
    }
    possible = [c for c, limit in limits.items() if times * limit <= RECORD_EFFECT_LARGEST * c.size]
    if not possible:
        least = min(limits, key=lambda c: limits[c] / c.size)
        raise UnanswerableError(
            f"on this record an error of {effect.name} {least.name} shows from {limits[least]:.3g} {least.units} on, "
            f"{limits[least] / least.size:.0f} of its tolerance: at {times:g} times that no instrument errs so much, "
            f"and the loop believes up to {RECORD_EFFECT_LARGEST:.0f}. Plant less (--times)."
        )
    component = possible[int(draw.integers(len(possible)))]
    value = float(times * limits[component])
    words = f"{component.name} {value:.3g} {component.units}, {value / component.size:.1f} of its tolerance"
    return effect.perturb(base.flight, component.name, value), words


def _limit(here: Fit, effect: str, names: Sequence[str], direction: FloatArray, onset: float | None) -> float:
    """Detection limit along a direction of the terms, as a multiple of it.

    The residual of a measured record is more than noise, of long correlation: the limit counts it, and its effective
    samples.
    """
    problem = replace(here.problem, efficiency=here.problem.efficiency_of(here.null.residual))
    frame = problem.frame.with_mechanisms([find(effect)])
    columns = [Regressor(effect, name, (), _time_basis(onset), "1") for name in names]
    return _limit_of(problem, problem.design(frame, columns) @ direction)


def _time_basis(onset: float | None) -> TimeBasis:
    return TimeBasis("constant") if onset is None else TimeBasis("jump", onset)


def _limit_of(problem: Problem, column: FloatArray) -> float:
    """Detection limit of a whitened column's coefficient."""
    return DETECTED / float(np.sqrt(problem.efficiency) * free_length(problem, column))


def found_in(base: Ground, flight: Flight) -> Trace:
    """The planted record traced from the model of the record itself."""
    start = base.model.model_copy(update={"covariance": ()})
    return trace(replace(flight), TraceConfig(start=start, max_steps=2))


def families(result: Trace) -> str:
    """The families that explain most of the residual before anything is added, largest first."""
    shares = sorted(result.steps[0].families.items(), key=lambda each: -each[1])
    return ", ".join(f"{name} {100.0 * share:.0f} %" for name, share in shares[:FAMILIES] if share > 0.0)


def line(effect: str, size: str, result: Trace) -> str:
    """One planted effect in words."""
    steps = [
        f"{step.status} {step.added} ({step.description}): held out {step.error_before.held_out:.3g} to "
        f"{step.error_after.held_out:.3g}"
        + (f", confounded with {', '.join(near)}" if (near := step.candidates[0].near_equals) else "")
        for step in result.steps
        if step.added is not None and step.error_after is not None
    ]
    named = effect in result.added or any(
        effect in step.candidates[0].near_equals for step in result.steps if step.added
    )
    found = f"{effect} ({size}) {'found' if named else 'not found'}: {'; '.join(steps) or 'nothing is added'}"
    return f"{found}; families: {families(result)}"


def main(arguments: Sequence[str] | None = None) -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("flight", type=Path)
    parser.add_argument("--effects", default="magnus,stiffness_asymmetry,cubic_stiffness,gyro_scale")
    parser.add_argument("--times", type=float, default=5.0, help="of the detection limit")
    parser.add_argument("--steps", type=int, default=8, help="of the record's own trace")
    parser.add_argument("--model", type=Path, default=None, help="of that trace, as it was written, instead")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--instruments", default=None)
    parser.add_argument("--onset", type=float, default=None, help="s, from which moments that may change act")
    parser.add_argument("--start", type=float, default=None)
    parser.add_argument("--stop", type=float, default=None)
    given = parser.parse_args(arguments)
    flight = load_flight(given.flight, instruments=given.instruments).window(given.start, given.stop)
    base = with_model(flight, read_structure(given.model)) if given.model else ground(flight, given.steps)
    print(f"the record itself: {', '.join(base.state.model.added) or 'nothing is added'}", flush=True)
    print(line("none", "nothing planted", found_in(base, base.flight)), flush=True)
    for effect in given.effects.split(","):
        try:
            flight, size = planted(base, effect, given.times, given.seed, given.onset)
            print(line(effect, size, found_in(base, flight)), flush=True)
        except UnanswerableError as error:
            print(f"{effect} not planted: {error}", flush=True)


if __name__ == "__main__":
    main()
