"""How often `compare` is right where alpha passes near zero, and the meridian turns at hundreds of rad/s.

By hand: python -m tests.studies.independent.near_zero --seed 1000 --seeds 4

Each seed flies each vehicle with strong damping (the nominal amplitude) and with nothing planted; the coning at the
start is the one that brings the plain motion nearest to alpha = 0.
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np
from scipy.optimize import minimize_scalar

from brv_hypo import compare
from brv_hypo.comparison import CompareConfig
from tests.studies.independent.dynamics import flown, stack
from tests.studies.independent.flights import Made, make_flight, stream
from tests.studies.independent.instruments import no_errors
from tests.studies.independent.mechanisms import LISTED, Planted
from tests.studies.independent.vehicles import CRAFTS, Craft, Start, draw_start

# Coning tried, in shares of the natural frequency, and times at which alpha is evaluated.
CONING = np.linspace(-0.45, 0.45, 19)
TIMES = 4000


def make_through_zero(vehicle: str, truth: str, seed: int) -> Made:
    """A flight with strong `truth` whose motion without it comes as near to alpha = 0 as its coning can bring it."""
    start = _through_zero(CRAFTS[vehicle], draw_start(CRAFTS[vehicle], stream(seed, "start")))
    return make_flight(vehicle, truth, 1.0, seed, start=start)


def _through_zero(craft: Craft, start: Start) -> Start:
    plain = replace(start, nutation=0.0)

    def nearest(coning: float) -> float:
        body = flown(craft, replace(plain, coning=float(coning)), no_errors(), Planted())
        times = np.linspace(0.0, craft.duration, TIMES)
        snapshots = [body.snapshot(float(t), state) for t, state in zip(times, body.history.many(times), strict=True)]
        return float(np.min(stack(snapshots, "alpha")))

    tried = [nearest(coning) for coning in CONING]
    place, width = CONING[int(np.argmin(tried))], CONING[1] - CONING[0]
    found = minimize_scalar(nearest, bounds=(place - width, place + width), method="bounded")
    return replace(plain, coning=float(found.x))


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--seeds", type=int, default=4)
    given = parser.parse_args()
    right: dict[str, list[bool]] = {"damping": [], "none": []}
    for seed in range(given.seed, given.seed + given.seeds):
        for vehicle in CRAFTS:
            for truth, named in right.items():
                made = make_through_zero(vehicle, truth, seed)
                found = compare(made.flight, CompareConfig(mechanisms=LISTED, maximum_likelihood="none")).verdict
                named.append(found.winner == truth)
                print(
                    f"{seed} {vehicle} {truth}: least alpha {np.degrees(made.true.alpha.min()):.3f} deg, "
                    f"meridian up to {np.abs(made.true.meridian_rate).max():.0f} rad/s: {found.outcome} {found.winner}",
                    flush=True,
                )
    for truth, named in right.items():
        print(f"{truth}: named in {sum(named)} of {len(named)}")


if __name__ == "__main__":
    main()
