"""Two flights of one design, at the same Mach numbers at other times: is what begins and ends at one named, and placed?

By hand: python -m tests.independent.joint --seed 1000 --pairs 10 --jobs 2

Pair k has seed SEED + k; vehicles and mechanisms (those whose size does not hang on the flight) take turns. The second
flight enters lower and at another speed, and the mechanism begins and ends there at the Mach numbers of the first.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tests.independent.flights import Made, make_flight
from tests.independent.sisters import at_speed
from tests.independent.vehicles import CRAFTS

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
    """One pair: what was planted, the verdict, and the largest error of a planted edge.

    `error` is the distance from a planted edge to the nearest knot of the leader, as a share of the Mach numbers that
    the first flight ran over; `ratio` the residual over what instruments explain.
    """

    seed: int
    vehicle: str
    truth: str
    outcome: str
    winner: str | None
    ratio: float
    error: float


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
