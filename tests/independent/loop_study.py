"""How often `trace` names what is there, and what is not: findings and hints on independent flights.

By hand: python -m tests.independent.loop_study --seed 1000 --flights 24 --jobs 1

Flight k has seed SEED + k; with nothing planted and with one effect in turn, which the planted flights take one after
another. What is planted is 3 to 10 times as large as its detection limit, or of its nominal amplitude where that is
less.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from joblib import Parallel, delayed

from brv_hypo.residuals import Trace, TraceConfig, trace
from tests.independent.flights import Made, draw_flight
from tests.independent.mechanisms import LISTED, UNLISTED
from tests.independent.oracle import judge

# What is planted, in detection limits (F = 25 of the truth's own column).
TIMES = (3.0, 10.0)
STEPS = 4


@dataclass(frozen=True)
class Added:
    """One effect that the loop added, and what it says of it."""

    name: str
    standing: str
    near: tuple[str, ...]
    named_in: float
    ratio: float
    ratio_error: float
    description: str


@dataclass(frozen=True)
class Outcome:
    """One flight: what was planted and at how many detection limits, and what the loop added."""

    seed: int
    vehicle: str
    truth: str
    times: float
    added: tuple[Added, ...]
    seconds: float


def fly(seed: int, truth: str) -> Outcome | str:
    """Draw, trace and note one flight; the reason in words where none came of it."""
    try:
        made, times = planted(seed, truth)
    except (RuntimeError, ValueError) as error:
        return f"seed {seed}: not flown ({error})"
    found = trace(made.flight, TraceConfig(max_steps=STEPS, maximum_likelihood=False))
    return Outcome(seed, made.vehicle, truth, times, added_by(found), found.seconds)


def planted(seed: int, truth: str) -> tuple[Made, float]:
    """The flight with its effect at 3 to 10 times the detection limit, and how many times it is."""
    if truth == "none":
        return draw_flight(seed, truth="none"), 0.0
    nominal = draw_flight(seed, truth=truth, amplitude=1.0)
    wanted = float(np.exp(np.random.default_rng([seed, 11]).uniform(*np.log(TIMES))))
    limit = judge(nominal, ()).limit_amplitude
    amplitude = min(wanted * limit, 1.0)
    return draw_flight(seed, truth=truth, amplitude=amplitude), amplitude / limit


def added_by(found: Trace) -> tuple[Added, ...]:
    """What the loop added, in order."""
    return tuple(
        Added(
            step.added,
            step.standing or "hint",
            tuple(dict.fromkeys((*step.candidates[0].near_equals, *step.look_alikes))),
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
    empty = [o for o in outcomes if o.truth == "none"]
    yield _count("nothing planted: a finding", [bool(_findings(o.added)) for o in empty])
    yield _count("nothing planted: a hint at most", [bool(o.added) and not _findings(o.added) for o in empty])
    # The oracle counts the errors of the record by their priors; what it cannot part from them is not asked for.
    seen = [o for o in outcomes if o.truth != "none" and o.times >= 1.0]
    listed = [o for o in seen if o.truth in LISTED]
    yield _count("planted, above the limit: something is added", [bool(o.added) for o in seen])
    yield _count("a listed effect is named first", [bool(o.added) and o.added[0].name == o.truth for o in listed])
    yield _count(
        "a listed effect or its near-equal is named first",
        [bool(o.added) and o.truth in (o.added[0].name, *o.added[0].near) for o in listed],
    )
    yield _count("planted: a second effect is added", [bool(_beside_the_first(o.added)) for o in seen])
    yield _count("planted: a second finding", [bool(_findings(_beside_the_first(o.added))) for o in seen])


def _beside_the_first(added: Sequence[Added]) -> list[Added]:
    """What was added of other names than the first: an effect may be added in parts."""
    return [each for each in added[1:] if each.name != added[0].name]


def _findings(added: Sequence[Added]) -> list[str]:
    return [each.name for each in added if each.standing == "finding"]


def _count(what: str, hits: Sequence[bool]) -> str:
    share = f"{np.mean(hits):.0%}" if hits else "-"
    return f"{what}: {sum(hits)} of {len(hits)} ({share})"


def line(outcome: Outcome) -> str:
    """One flight in words."""
    steps = "; ".join(
        f"{a.standing} {a.name} ({a.description}) {a.ratio:.3f} ± {a.ratio_error:.3f}, named in {a.named_in:.0%}"
        + (f", near {', '.join(a.near)}" if a.near else "")
        for a in outcome.added
    )
    return (
        f"{outcome.seed} {outcome.vehicle} {outcome.truth} at {outcome.times:.1f} limits, "
        f"{outcome.seconds:.0f} s: {steps or 'nothing'}"
    )


def main(arguments: Sequence[str] | None = None) -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--flights", type=int, default=24)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--truths", default=None, metavar="NAME,...", help="what to plant in turn; none for nothing")
    given = parser.parse_args(arguments)
    truths = given.truths.split(",") if given.truths else _in_turn()
    runs = (delayed(fly)(given.seed + k, truths[k % len(truths)]) for k in range(given.flights))
    outcomes: list[Outcome] = []
    for found in Parallel(n_jobs=given.jobs, return_as="generator")(runs):
        print(found if isinstance(found, str) else line(found), flush=True)
        if not isinstance(found, str):
            outcomes.append(found)
    print("\n".join(report(outcomes)))


def _in_turn() -> list[str]:
    return [name for effect in (*LISTED, *UNLISTED) for name in ("none", effect)]


if __name__ == "__main__":
    main()
