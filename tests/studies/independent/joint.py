"""Flights of one design, at the same Mach numbers at other times: is what begins and ends at one named, and placed?

By hand: python -m tests.studies.independent.joint --seed 1000 --pairs 10 --jobs 2
What many cost: python -m tests.studies.independent.joint --seed 1000 --pairs 1 --flights 10
Events off one Mach number: python -m tests.studies.independent.joint --seed 1000 --pairs 12 --apart 0.04

Pair k has seed SEED + k; vehicles and mechanisms (those whose size does not hang on the flight) take turns. The others
enter higher and at another speed than the first flight, the last of them farthest, and the mechanism begins and ends
there at the Mach numbers of the first, or so many seconds (1-sigma, drawn) before or after these.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from resource import RUSAGE_SELF, getrusage
from time import process_time

import numpy as np
from joblib import delayed

from brv_hypo import compare
from brv_hypo.comparison import CompareConfig
from tests.studies.independent.flights import Made, make_flight
from tests.studies.independent.mechanisms import LISTED, Planted
from tests.studies.independent.reporting import fly_and_report
from tests.studies.independent.sisters import at_speed
from tests.studies.independent.vehicles import CRAFTS

# Linear in their amplitude, and pushed rather than fed by the coning: the same size serves both flights.
TRUTHS = ("damping", "inplane", "bodyfixed")
# Speed over the first flight's, and height of entry over it (m): the same Mach number comes 0.5 to 2 s apart.
OTHERWISE = {
    "cone": (1.005, -3000.0),
    "capsule": (0.975, -1500.0),
    "slender": (1.01, -3000.0),
    "biconic": (1.005, -4000.0),
}
# Seeds of the second flights.
SECOND = 500_000
_STREAM = 23
# How often a second flight is flown with what is planted: its drag moves the times of the Mach numbers.
_ROUNDS = 3


@dataclass(frozen=True)
class Outcome:
    """One pair: what was planted, and what is said of both together.

    `share` is what was planted on the first flight, of its moment's rms; `ratio` the residual over what instruments
    explain; `errors` how far from each planted edge the leader's nearest knot is, in s on the first flight.
    """

    seed: int
    vehicle: str
    truth: str
    share: float
    outcome: str
    winner: str | None
    ratio: float
    errors: tuple[float, ...]
    cpu: float
    memory: float


def fly(seed: int, vehicle: str, truth: str, amplitude: float, count: int = 2, apart: float = 0.0) -> Outcome | str:
    """Compare some flights; the reason in words where they were not flown or not compared."""
    try:
        first, *others = fly_several(vehicle, truth, seed, amplitude, count=count, apart=apart)
    except (RuntimeError, ValueError) as error:
        return f"seed {seed}: not flown ({error})"
    begun = process_time()
    config = CompareConfig(mechanisms=LISTED, maximum_likelihood="none" if count == 2 else "quick")
    found = compare([each.flight for each in (first, *others)], config)
    cpu, memory = process_time() - begun, 1e-6 * getrusage(RUSAGE_SELF).ru_maxrss
    verdict = found.verdict
    if verdict.adequacy is None:
        return f"seed {seed}, {vehicle} {truth}: not compared ({verdict.reason})"
    leader = found.ranking[0]
    knots = [term.region_s[0] for term in leader.terms if term.region_s is not None]
    # In the time of the flight that is the reference of all: far from those of the others.
    each = [_apart(knots, made.true.planted) for made in (first, *others)]
    return Outcome(
        seed,
        vehicle,
        truth,
        first.true.share,
        verdict.outcome,
        verdict.winner,
        verdict.adequacy.ratio,
        min(each, key=sum),
        cpu,
        memory,
    )


def _apart(knots: Sequence[float], planted: Planted) -> tuple[float, ...]:
    """How far from each edge of what is planted the nearest knot is, s."""
    return tuple(min((abs(knot - edge) for knot in knots), default=np.inf) for edge in (planted.start, planted.stop))


def fly_several(
    vehicle: str,
    truth: str,
    seed: int,
    amplitude: float = 1.0,
    grade: str = "tactical",
    count: int = 2,
    apart: float = 0.0,
) -> list[Made]:
    """The flights, one mechanism acting between the same Mach numbers on all, or `apart` (s, 1-sigma) from these."""
    craft = CRAFTS[vehicle]
    made = [make_flight(craft, truth, amplitude, seed, grade)]
    faster, higher = OTHERWISE[vehicle]
    for number in range(1, count):
        share, own = number / (count - 1), seed + SECOND * number
        other = replace(at_speed(craft, 1.0 + share * (faster - 1.0)), altitude=craft.altitude + share * higher)
        flown = make_flight(other, seed=own, grade=grade)
        late = apart * np.random.default_rng([own, _STREAM]).standard_normal(2)
        for _ in range(_ROUNDS):
            start, stop = np.array([time_at(flown, mach) for mach in machs(made[0])]) + late
            planted = replace(made[0].true.planted, start=float(start), stop=float(stop))
            flown = make_flight(other, seed=own, grade=grade, planted=planted)
        made.append(flown)
    return made


def machs(made: Made) -> tuple[float, float]:
    """Mach numbers at which what is planted begins and ends."""
    true = made.true
    start, stop = np.interp([true.planted.start, true.planted.stop], true.time, true.mach)
    return float(start), float(stop)


def time_at(made: Made, mach: float) -> float:
    """When the flight's falling Mach number is so much, s."""
    return float(np.interp(-mach, -made.true.mach, made.true.time))


def report(outcomes: Sequence[Outcome]) -> Iterable[str]:
    """Lines of counts with their denominators."""
    named = [o for o in outcomes if o.winner == o.truth]
    yield f"named rightly: {len(named)} of {len(outcomes)}"
    yield f"named wrongly: {sum(o.winner not in (None, o.truth) for o in outcomes)} of {len(outcomes)}"
    yield f"none adequate: {sum(o.outcome == 'none adequate' for o in outcomes)} of {len(outcomes)}"
    errors = [error for o in named for error in o.errors]
    if errors:
        cpu, memory = np.median([o.cpu for o in outcomes]), max(o.memory for o in outcomes)
        yield f"CPU: median {cpu:.1f} s; memory at most {memory:.1f} GB"
        yield f"edges of those named rightly: median {np.median(errors):.4f} s off, at most {max(errors):.4f} s"


def line(outcome: Outcome) -> str:
    """One pair in words."""
    return (
        f"{outcome.seed} {outcome.vehicle} {outcome.truth} ({outcome.share:.3g} of the moment): {outcome.outcome} "
        f"{outcome.winner or ''}, {outcome.ratio:.2f} times the noise, edges off by "
        f"{' and '.join(f'{error:.4f}' for error in outcome.errors)} s"
    )


def main(arguments: Sequence[str] | None = None) -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--pairs", type=int, default=12)
    parser.add_argument("--flights", type=int, default=2, help="that are fitted jointly")
    parser.add_argument("--apart", type=float, default=0.0, help="s, 1-sigma, of the events from one Mach number")
    parser.add_argument("--amplitude", type=float, default=1.0, help="of the nominal one")
    parser.add_argument("--jobs", type=int, default=1)
    given = parser.parse_args(arguments)
    cases = [(vehicle, truth) for truth in TRUTHS for vehicle in sorted(CRAFTS)]
    runs = (
        delayed(fly)(given.seed + k, *cases[k % len(cases)], given.amplitude, given.flights, given.apart)
        for k in range(given.pairs)
    )
    fly_and_report(runs, given.jobs, line, report)


if __name__ == "__main__":
    main()
