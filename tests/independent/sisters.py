"""Pairs of sister vehicles: the model found on one, frozen, against the moments and samples of the other.

By hand: python -m tests.independent.sisters --seed 1000 --pairs 6

Pair k has seed SEED + k, and is of the vehicles in turn. Sisters share their aerodynamics; mass, inertia, trim,
instruments, speed at entry and start differ. Trim and instruments of the second are fitted to it (`--refit`).
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from joblib import Parallel, delayed

from brv_hypo.residuals import TraceConfig, predict, trace
from tests.independent.flights import make_flight
from tests.independent.vehicles import CRAFTS, Craft

REFIT = ("trim", "instruments")
# Relative changes of the sister, 1-sigma: of mass and inertia (stated in its record), and of speed at entry.
MASS, SPEED = 0.03, 0.003
EXPLAINED, BAND = 0.95, (0.90, 0.98)
# Share of the samples where both flew, below which a pair is not counted.
SMALLEST = 0.1


@dataclass(frozen=True)
class Outcome:
    """One pair: the share of the moment's mean square that the frozen model explains, noise aside.

    `inside` is the share of samples in the band; `frozen` and `own` are errors over that of the noise. `flown` is the
    share of the samples at Mach numbers and angles of attack that both flew, which the first two are told of.
    """

    seed: int
    vehicle: str
    added: tuple[str, ...]
    explained: float
    inside: float
    flown: float
    frozen: float
    own: float


def fly(seed: int, vehicle: str) -> Outcome | str:
    """Trace one vehicle, predict its sister; the reason in words where none came of it."""
    craft = CRAFTS[vehicle]
    try:
        first = make_flight(craft, seed=seed).flight
        second = make_flight(sister(craft, seed), seed=seed + 500_000).flight
    except (RuntimeError, ValueError) as error:
        return f"seed {seed}: not flown ({error})"
    found = trace(first, TraceConfig(max_steps=2, maximum_likelihood=False))
    predicted = predict(second, found.model.definition, REFIT)
    error = predicted.error
    return Outcome(
        seed,
        vehicle,
        found.added,
        predicted.explained,
        predicted.band.inside,
        predicted.flown,
        error.frozen / error.noise,
        error.own / error.noise,
    )


def sister(craft: Craft, seed: int) -> Craft:
    """The same shape, of another mass and inertia, and at another speed."""
    rng = np.random.default_rng([seed, 21])
    heavier, stouter = 1.0 + MASS * rng.standard_normal(2)
    vehicle = craft.vehicle
    own = replace(vehicle, mass=heavier * vehicle.mass, ixx=stouter * vehicle.ixx, iyy=stouter * vehicle.iyy)
    return replace(at_speed(craft, 1.0 + SPEED * float(rng.standard_normal())), vehicle=own)


def at_speed(craft: Craft, faster: float) -> Craft:
    """The same vehicle at so many times its speed; the slope's change with speed is the design's."""
    slope = craft.static_slope * (1.0 + craft.stiffness_drift * (faster - 1.0))
    drift = craft.stiffness_drift * faster * craft.static_slope / slope
    return replace(craft, speed=faster * craft.speed, static_slope=slope, stiffness_drift=drift)


def report(outcomes: Sequence[Outcome]) -> Iterable[str]:
    """Lines of counts with their denominators."""
    outcomes = [o for o in outcomes if o.flown >= SMALLEST]
    held = [BAND[0] <= o.inside <= BAND[1] for o in outcomes]
    yield _count(f"the frozen model explains at least {EXPLAINED:.0%}", [o.explained >= EXPLAINED for o in outcomes])
    yield _count(f"the 95 % band holds {BAND[0]:.0%} to {BAND[1]:.0%} of the samples", held)
    if outcomes:
        yield f"explained: least {min(o.explained for o in outcomes):.4f}"
        inside = [o.inside for o in outcomes]
        yield f"share in the band: median {np.median(inside):.3f}, from {min(inside):.3f} to {max(inside):.3f}"


def line(outcome: Outcome) -> str:
    """One pair in words."""
    return (
        f"{outcome.seed} {outcome.vehicle}: explained {outcome.explained:.4f}, in the band {outcome.inside:.3f}, "
        f"where both flew {outcome.flown:.2f}, error over noise {outcome.frozen:.2f} frozen, {outcome.own:.2f} fitted "
        f"there; added {', '.join(outcome.added) or 'nothing'}"
    )


def _count(what: str, hits: Sequence[bool]) -> str:
    share = f"{np.mean(hits):.0%}" if hits else "-"
    return f"{what}: {sum(hits)} of {len(hits)} ({share})"


def main(arguments: Sequence[str] | None = None) -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--pairs", type=int, default=6)
    parser.add_argument("--jobs", type=int, default=1)
    given = parser.parse_args(arguments)
    names = sorted(CRAFTS)
    runs = (delayed(fly)(given.seed + k, names[k % len(names)]) for k in range(given.pairs))
    outcomes: list[Outcome] = []
    for found in Parallel(n_jobs=given.jobs, return_as="generator")(runs):
        if isinstance(found, str):
            print(found, flush=True)
            continue
        outcomes.append(found)
        print(line(found), flush=True)
    print("\n".join(report(outcomes)))


if __name__ == "__main__":
    main()
