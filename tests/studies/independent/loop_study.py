"""How often `trace` names what is there, and what is not: findings and hints on independent flights.

By hand: python -m tests.studies.independent.loop_study --seed 1000 --flights 24 --jobs 1 [--drawn | --pairs |
--effects all]

Flight k has seed SEED + k; with nothing planted and with one effect in turn, which the planted flights take one after
another. What is planted is 3 to 10 times as large as its detection limit, or of its nominal amplitude where that is
less. With --effects any effect that `trace` tries is planted, instruments' errors among them, and limits are those in
the record (`effects`); so are those of --pairs, two listed effects at once, each in a region of its own.
"""

from __future__ import annotations

import argparse
import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from joblib import delayed

from brv_hypo.tracing import Trace, TraceConfig, trace
from tests.studies.independent.drawn_vehicles import draw_craft
from tests.studies.independent.effects import EFFECTS, TIMES, baseline_for, deviations, sized, sized_pair
from tests.studies.independent.flights import Made, draw_flight
from tests.studies.independent.mechanisms import LISTED, UNLISTED
from tests.studies.independent.oracle import DETECTED, judge
from tests.studies.independent.record_oracle import f_ratios_in_record
from tests.studies.independent.reporting import fly_and_report

SETTINGS = TraceConfig(max_steps=4)
# Streams of the size that is planted, and of a vehicle that is drawn.
_SIZE, _VEHICLE = 11, 12
JOINED = "+"


@dataclass(frozen=True)
class Added:
    """One effect that the loop added, and what it says of it."""

    name: str
    status: str
    near: tuple[str, ...]
    named_in: float
    ratio: float
    ratio_error: float
    description: str


@dataclass(frozen=True)
class Outcome:
    """One flight: what was planted (of a pair both, joined) and at how many detection limits each, and what the loop
    added. `in_record` are these limits where the motion has to be found along with them, `deviations` the errors of the
    sizes that were found, in their standard errors.
    """

    seed: int
    vehicle: str
    truth: str
    times: tuple[float, ...]
    in_record: tuple[float, ...]
    added: tuple[Added, ...]
    seconds: float
    deviations: tuple[float, ...] = ()


def fly(seed: int, truth: str, drawn: bool = False) -> Outcome | str:
    """Draw, trace and note one flight, its vehicle `drawn` or one of four; in words why none came of it."""
    vehicle = {"vehicle": draw_craft(np.random.default_rng([seed, _VEHICLE]))} if drawn else {}
    try:
        made, times = planted(seed, truth, **vehicle)
    except (RuntimeError, ValueError) as error:
        return f"seed {seed}: not flown ({error})"
    in_record = tuple(float(np.sqrt(f_ratio / DETECTED)) for f_ratio in f_ratios_in_record(made)) if times else ()
    return traced(made, truth, times, in_record)


def fly_effect(seed: int, effect: str) -> Outcome | str:
    """The same with any effect at 3 to 10 times its limit in the record."""
    if effect == "none":
        return fly(seed, effect)
    try:
        own = sized(seed, effect)
    except (RuntimeError, ValueError) as error:
        return f"seed {seed}: {effect} not flown ({error})"
    settings = SETTINGS.model_copy(update={"baseline": baseline_for(effect)})
    found, times = trace(own.made.flight, settings), (own.times,)
    off = deviations(found, own, effect)
    return Outcome(seed, own.made.vehicle, effect, times, times, added_by(found), found.seconds, off)


def fly_pair(seed: int, truth: str) -> Outcome | str:
    """The same with two effects, each at 3 to 10 times its limit in the record beside the other."""
    try:
        made, times = sized_pair(seed, *truth.split(JOINED))
    except (RuntimeError, ValueError) as error:
        return f"seed {seed}: {truth} not flown ({error})"
    return traced(made, truth, times, times)


def traced(made: Made, truth: str, times: tuple[float, ...], in_record: tuple[float, ...]) -> Outcome:
    """What the loop adds on a flight, noted beside what was planted."""
    found = trace(made.flight, SETTINGS)
    return Outcome(made.seed, made.vehicle, truth, times, in_record, added_by(found), found.seconds)


def planted(seed: int, truth: str, **vehicle: Any) -> tuple[Made, tuple[float, ...]]:
    """The flight with its effect at 3 to 10 times the detection limit, and how many times it is."""
    if truth == "none":
        return draw_flight(seed, truth="none", **vehicle), ()
    amplitude, times = _sized(draw_flight(seed, truth=truth, amplitude=1.0, **vehicle))
    return draw_flight(seed, truth=truth, amplitude=amplitude, **vehicle), (times,)


def _sized(nominal: Made) -> tuple[float, float]:
    """The share of the nominal amplitude at which to plant an effect, and how many detection limits that is."""
    wanted = float(np.exp(np.random.default_rng([nominal.seed, _SIZE]).uniform(*np.log(TIMES))))
    limit = judge(nominal, ()).limit_amplitude
    amplitude = min(wanted * limit, 1.0)
    return amplitude, amplitude / limit


def added_by(found: Trace) -> tuple[Added, ...]:
    """What the loop added, in order."""
    return tuple(
        Added(
            step.added,
            step.status or "hint",
            step.candidates[0].near_equals,
            step.named_in or 0.0,
            step.error_ratio_held_out or 1.0,
            step.error_ratio_std_error or 0.0,
            step.description,
        )
        for step in found.steps
        if step.added is not None
    )


def report(outcomes: Sequence[Outcome]) -> Iterable[str]:
    """Lines of counts with their denominators."""
    yield from _report_empty([o for o in outcomes if o.truth == "none"])
    # The ideal observer counts errors of the record by their priors; what it cannot separate from them is not counted.
    detectable = [o for o in outcomes if o.truth != "none" and min(o.times) >= 1.0]
    listed = [o for o in detectable if o.truth in LISTED]
    yield _count("planted, above the limit: something is added", [bool(o.added) for o in detectable])
    yield _count("a listed effect is named first", [_first(o) for o in listed])
    yield _count("a listed effect or its near-equal is named first", [_near(o) for o in listed])
    known = [o for o in listed if min(o.in_record) >= TIMES[0]]
    yield _count("the same, at 3 limits or more once the motion has to be found too", [_near(o) for o in known])
    yield _count("planted: a second effect is added", [bool(_beside_the_first(o.added)) for o in detectable])
    yield _count("planted: a second finding", [bool(_findings(_beside_the_first(o.added))) for o in detectable])


def report_effects(outcomes: Sequence[Outcome]) -> Iterable[str]:
    """Lines of counts by effect and of all."""
    yield from _report_empty([o for o in outcomes if o.truth == "none"])
    planted = [o for o in outcomes if o.truth != "none"]
    for name in dict.fromkeys(o.truth for o in planted):
        own = [o for o in planted if o.truth == name]
        yield _count(f"{name} is first", [_first(o) for o in own]) + _count("; or near", [_near(o) for o in own])
    yield _count("all: named first", [_first(o) for o in planted])
    yield _count("all: it or a near-equal is first", [_near(o) for o in planted])
    yield _count("planted: a second effect is added", [bool(_beside_the_first(o.added)) for o in planted])
    yield _count("planted: a second finding", [bool(_findings(_beside_the_first(o.added))) for o in planted])
    yield _count("sizes within 2 sigma", [abs(each) <= 2.0 for o in planted for each in o.deviations])


def _first(outcome: Outcome) -> bool:
    return bool(outcome.added) and outcome.added[0].name == outcome.truth


def _near(outcome: Outcome) -> bool:
    return bool(outcome.added) and outcome.truth in (outcome.added[0].name, *outcome.added[0].near)


def _report_empty(empty: Sequence[Outcome]) -> Iterable[str]:
    yield _count("nothing planted: a finding", [bool(_findings(o.added)) for o in empty])
    yield _count("nothing planted: a hint at most", [bool(o.added) and not _findings(o.added) for o in empty])


def report_pairs(outcomes: Sequence[Outcome]) -> Iterable[str]:
    """Lines of counts of flights with two effects."""
    yield _count("both are found, by name", [_both_found(o, near=False) for o in outcomes])
    yield _count("both are found, by name or a near-equal", [_both_found(o, near=True) for o in outcomes])
    yield _count("one at least is found, by name or a near-equal", [bool(_found(o)) for o in outcomes])
    more = [_beyond(o) for o in outcomes]
    yield _count("something else is added beside them", [bool(names) for names in more])
    findings = [set(_findings(o.added)) & set(names) for o, names in zip(outcomes, more, strict=True)]
    yield _count("something else is a finding beside them", [bool(names) for names in findings])


def _both_found(outcome: Outcome, near: bool) -> bool:
    """Whether either effect is what a step of its own added."""
    names = [{each.name, *(each.near if near else ())} for each in outcome.added]
    first, second = outcome.truth.split(JOINED)
    return any(first in one and second in other for one, other in itertools.permutations(names, 2))


def _found(outcome: Outcome) -> list[Added]:
    """What was added that is one of the pair, or cannot be distinguished from it."""
    truths = set(outcome.truth.split(JOINED))
    return [each for each in outcome.added if truths & {each.name, *each.near}]


def _beyond(outcome: Outcome) -> list[str]:
    """Names that were added and are neither of the pair, nor cannot be distinguished from it."""
    found = {each.name for each in _found(outcome)}
    return [each.name for each in outcome.added if each.name not in found]


def _beside_the_first(added: Sequence[Added]) -> list[Added]:
    """What was added of other names than the first: an effect may be added in parts."""
    return [each for each in added[1:] if each.name != added[0].name]


def _findings(added: Sequence[Added]) -> list[str]:
    return [each.name for each in added if each.status == "finding"]


def _count(what: str, hits: Sequence[bool]) -> str:
    share = f"{np.mean(hits):.0%}" if hits else "-"
    return f"{what}: {sum(hits)} of {len(hits)} ({share})"


def line(outcome: Outcome) -> str:
    """One flight in words."""
    limits = ""
    if outcome.times:
        limits = f" at {_joined(outcome.times)} limits ({_joined(outcome.in_record)} in the record)"
    steps = "; ".join(
        f"{a.status} {a.name} ({a.description}) {a.ratio:.3f} ± {a.ratio_error:.3f}, named in {a.named_in:.0%}"
        + (f", near {', '.join(a.near)}" if a.near else "")
        for a in outcome.added
    )
    return (
        f"{outcome.seed} {outcome.vehicle} {outcome.truth}{limits}, "
        f"{outcome.seconds:.0f} s: {steps or 'nothing'}"
        + (f"; off by {_joined(outcome.deviations)} sigma" if outcome.deviations else "")
    )


def _joined(times: Sequence[float]) -> str:
    return " and ".join(f"{each:.1f}" for each in times)


def main(arguments: Sequence[str] | None = None) -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--flights", type=int, default=24)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--truths", default=None, metavar="NAME,...", help="what to plant in turn; none for nothing")
    how = parser.add_mutually_exclusive_group()
    how.add_argument("--pairs", action="store_true", help="plant two listed effects at once")
    how.add_argument("--drawn", action="store_true", help="a vehicle drawn for every flight")
    how.add_argument("--effects", default=None, metavar="NAME,...", help="at limits of the record; or all")
    given = parser.parse_args(arguments)
    if given.effects:
        truths = ["none", *EFFECTS] if given.effects == "all" else given.effects.split(",")
        runs = (delayed(fly_effect)(given.seed + k, truths[k % len(truths)]) for k in range(given.flights))
    elif given.pairs:
        truths = given.truths.split(",") if given.truths else _pairs_in_turn()
        runs = (delayed(fly_pair)(given.seed + k, truths[k % len(truths)]) for k in range(given.flights))
    else:
        truths = given.truths.split(",") if given.truths else _in_turn()
        runs = (delayed(fly)(given.seed + k, truths[k % len(truths)], given.drawn) for k in range(given.flights))
    printed = report_effects if given.effects else report_pairs if given.pairs else report
    fly_and_report(runs, given.jobs, line, printed)


def _in_turn() -> list[str]:
    return [name for effect in (*LISTED, *UNLISTED) for name in ("none", effect)]


def _pairs_in_turn() -> list[str]:
    return [JOINED.join(pair) for pair in itertools.combinations(LISTED, 2)]


if __name__ == "__main__":
    main()
