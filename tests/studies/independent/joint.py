"""Two flights of one design, at the same Mach numbers at other times: is what begins and ends at one named, and placed?

By hand: python -m tests.studies.independent.joint --seed 1000 --pairs 10 --jobs 2

Pair k has seed SEED + k; vehicles and mechanisms (those whose size does not hang on the flight) take turns. The second
flight enters lower and at another speed, and the mechanism begins and ends there at the Mach numbers of the first.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from joblib import delayed

from brv_hypo import compare
from brv_hypo.ranking import CompareConfig
from tests.studies.independent.flights import Made, make_flight
from tests.studies.independent.mechanisms import LISTED
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


def fly(seed: int, vehicle: str, truth: str, amplitude: float) -> Outcome | str:
    """Compare one pair; the reason in words where it was not flown or not compared."""
    try:
        first, second = fly_pair(vehicle, truth, seed, amplitude)
    except (RuntimeError, ValueError) as error:
        return f"seed {seed}: not flown ({error})"
    found = compare([first.flight, second.flight], CompareConfig(mechanisms=LISTED, maximum_likelihood="none"))
    verdict = found.verdict
    if verdict.adequacy is None:
        return f"seed {seed}, {vehicle} {truth}: not compared ({verdict.reason})"
    leader = found.ranking[0]
    knots = [term.region_s[0] for term in leader.terms if term.region_s is not None]
    edges = (first.true.planted.start, first.true.planted.stop)
    return Outcome(
        seed,
        vehicle,
        truth,
        first.true.share,
        verdict.outcome,
        verdict.winner,
        verdict.adequacy.ratio,
        tuple(min((abs(knot - edge) for knot in knots), default=np.inf) for edge in edges),
    )


def fly_pair(vehicle: str, truth: str, seed: int, amplitude: float = 1.0, grade: str = "tactical") -> tuple[Made, Made]:
    """The flights, one mechanism acting between the same Mach numbers on both."""
    craft = CRAFTS[vehicle]
    first = make_flight(craft, truth, amplitude, seed, grade)
    faster, higher = OTHERWISE[vehicle]
    other = replace(at_speed(craft, faster), altitude=craft.altitude + higher)
    second = make_flight(other, seed=seed + SECOND, grade=grade)
    for _ in range(_ROUNDS):
        start, stop = (time_at(second, mach) for mach in machs(first))
        planted = replace(first.true.planted, start=start, stop=stop)
        second = make_flight(other, seed=seed + SECOND, grade=grade, planted=planted)
    return first, second


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
    parser.add_argument("--amplitude", type=float, default=1.0, help="of the nominal one")
    parser.add_argument("--jobs", type=int, default=1)
    given = parser.parse_args(arguments)
    cases = [(vehicle, truth) for truth in TRUTHS for vehicle in sorted(CRAFTS)]
    runs = (delayed(fly)(given.seed + k, *cases[k % len(cases)], given.amplitude) for k in range(given.pairs))
    fly_and_report(runs, given.jobs, line, report)


if __name__ == "__main__":
    main()
