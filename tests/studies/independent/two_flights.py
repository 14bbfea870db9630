"""A step of the stiffness at a Mach number, and one at a time: one flight cannot separate them, two flights can.

By hand: python -m tests.studies.independent.two_flights --seed 1000 --pairs 10

Pair k has seed SEED + k; a step at a Mach number and one at a time take turns, at 3 to 10 times the limit in the first
flight's record. The second flight is of the same vehicle at another speed, at which that Mach number is passed at
another time; the step at a time comes at a third, at which Mach and Reynolds number are others.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from joblib import delayed

from brv_hypo.tracing import Trace, TraceConfig, trace
from tests.studies.independent.dynamics import PAD
from tests.studies.independent.effects import sized
from tests.studies.independent.flights import Made, make_flight
from tests.studies.independent.mechanisms import Planted
from tests.studies.independent.reporting import fly_and_report
from tests.studies.independent.sisters import SECOND, at_speed

KINDS = ("mach_step", "inplane")
# Of the record, where the second flight passes the Mach number; and how far from where the first does at least.
PLACES, APART = (0.2, 0.8), 0.2
STEPS = 2
_STREAM = 31


@dataclass(frozen=True)
class Outcome:
    """One pair: what was planted, at how many limits, and what was reported of the first flight alone and of both.

    `alone` and `both` are descriptions of what was added first; `near`: what the first flight cannot separate.
    """

    seed: int
    vehicle: str
    truth: str
    times: float
    alone: str
    near: tuple[str, ...]
    both: str
    seconds: float

    @property
    def right(self) -> bool:
        """Whether both flights show what the step goes with: a Mach number, or the times of each."""
        named = self.both.split(":")[0]
        by_mach = named == "mach_stiffness" or (named.startswith("discovered") and "Mach" in self.both)
        return by_mach if self.truth == "mach_step" else named == "inplane"


def fly(seed: int, truth: str) -> Outcome | str:
    """Fly and trace one pair; the reason in words where none came of it."""
    try:
        first, second, times = pair(seed, truth)
    except (RuntimeError, ValueError) as error:
        return f"seed {seed}: not flown ({error})"
    settings = TraceConfig(max_steps=STEPS)
    alone = trace(first.flight, settings)
    both = trace((first.flight, second.flight), settings)
    step = alone.steps[0]
    near = step.candidates[0].near_equals if step.added else ()
    return Outcome(seed, first.vehicle, truth, times, first_of(alone), near, first_of(both), both.seconds)


def pair(seed: int, truth: str) -> tuple[Made, Made, float]:
    """Two flights with the same step, and how many limits it is in the first one's record."""
    own = sized(seed, "mach_step")
    # A slope that goes with the speed itself is no function of Mach number on two trajectories.
    first, craft = own.made, replace(own.made.true.craft, stiffness_drift=0.0)
    planted, span = first.true.planted, craft.duration
    crossing = float(np.interp(-planted.values["mach"], -first.true.mach, first.true.time))
    rng = np.random.default_rng([seed, _STREAM])
    places = rng.uniform(*PLACES, 64) * span
    other = next(place for place in places if abs(place - crossing) >= APART * span)
    third = next((p for p in places if min(abs(p - crossing), abs(p - other)) >= APART * span), None)
    if third is None:
        raise ValueError("no third time is far enough from both")
    faster = planted.values["mach"] / float(np.interp(other, first.true.time, first.true.mach))
    sister = at_speed(craft, faster)
    ends = {"start": -2.0 * PAD, "stop": span + 2.0 * PAD}
    steps = [replace(planted, **ends)] * 2
    if truth == "inplane":
        form = {"offset": 0.0, "slope": 1.0}
        steps = [Planted("inplane", planted.amplitude, float(at), ends["stop"], form) for at in (crossing, third)]
    made = [
        make_flight(each, seed=number, planted=step, start=first.true.start)
        for each, number, step in zip((craft, sister), (seed, seed + SECOND), steps, strict=True)
    ]
    return made[0], made[1], own.times


def first_of(found: Trace) -> str:
    """What the first step added, and its description."""
    step = found.steps[0]
    return f"{step.added}: {step.description}" if step.added else "nothing"


def report(outcomes: Sequence[Outcome]) -> Iterable[str]:
    """Lines of counts."""
    for truth in KINDS:
        own = [o for o in outcomes if o.truth == truth]
        yield f"{truth}: two flights tell what it goes with in {sum(o.right for o in own)} of {len(own)}"


def line(outcome: Outcome) -> str:
    """One pair in words."""
    return (
        f"{outcome.seed} {outcome.vehicle} {outcome.truth} at {outcome.times:.1f} limits, {outcome.seconds:.0f} s: "
        f"alone {outcome.alone}, near {', '.join(outcome.near) or 'nothing'}; both {outcome.both}"
    )


def main(arguments: Sequence[str] | None = None) -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--pairs", type=int, default=10)
    parser.add_argument("--jobs", type=int, default=1)
    given = parser.parse_args(arguments)
    runs = (delayed(fly)(given.seed + k, KINDS[k % len(KINDS)]) for k in range(given.pairs))
    fly_and_report(runs, given.jobs, line, report)


if __name__ == "__main__":
    main()
