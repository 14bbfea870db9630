"""Pairs of sister vehicles: the model found on one, frozen, against the moments and samples of the other.

By hand: python -m tests.studies.independent.sisters --seed 1000 --pairs 6 [--changed | --damped | --lagged]

Pair k has seed SEED + k, and is of the vehicles in turn. Sisters share their aerodynamics; mass, inertia, trim,
instruments, speed at entry and start differ. Trim and instruments of the second are fitted to it (`--refit`).
`--changed`: the second's slope is another between two Mach numbers, 3 to 10 times what shows in its record (F of 25).
`--damped`: the second's pitch damping is 3 % more. `--lagged`: the same lag acts on both at the same times, and its
size is fitted to the second too.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from joblib import delayed

from brv_hypo.prediction import predict
from brv_hypo.prediction.result import LocalChange
from brv_hypo.tracing import TraceConfig, trace
from tests.studies.independent.dynamics import PAD
from tests.studies.independent.flights import Made, make_flight
from tests.studies.independent.mechanisms import Planted
from tests.studies.independent.oracle import DETECTED
from tests.studies.independent.record_oracle import f_ratios_in_record
from tests.studies.independent.reporting import fly_and_report
from tests.studies.independent.vehicles import CRAFTS, Craft

REFIT = ("trim", "instruments")
SECOND = 500_000  # added to a seed for that of the second flight
# Relative changes of the sister, 1-sigma: of mass and inertia (stated in its record), and of speed at entry.
MASS, SPEED = 0.03, 0.003
EXPLAINED, BAND = 0.95, (0.90, 0.98)
# Share of the samples where both flew, below which a pair is not counted.
SMALLEST = 0.1
# A planted local change: how much of the record it takes, and its edges' width, of that; detection limits between which
# its size is drawn, and the relative change of the slope at which the limit is calculated.
WIDE, EDGE, TIMES, FIRST = (0.15, 0.35), 0.05, (3.0, 10.0), 0.02
DAMPED = 0.03  # how much more damping a sister has
NAMED = 0.5  # share that planted and named Mach numbers have in common of both together
_CHANGE = 22  # the stream that draws it


@dataclass(frozen=True)
class Outcome:
    """One pair: the share of the moment's mean square that the frozen model explains, noise aside.

    `inside` is the share of samples in the band; `frozen` and `own` are errors over that of the noise. `flown` is the
    share of the samples at Mach numbers and angles of attack that both flew, which the first two are of.
    `change` is what is said to differ; `planted` are the Mach numbers between which the slope does, and `times` how
    many limits that is. `refused` is the coefficient that is said to contradict the model, of a sister whose damping is
    another (`damped`) or the same.
    """

    seed: int
    vehicle: str
    added: tuple[str, ...]
    explained: float
    inside: float
    flown: float
    frozen: float
    own: float
    change: LocalChange | None = None
    planted: tuple[float, float] | None = None
    times: float = 0.0
    refused: str = ""
    damped: bool = False

    @property
    def common(self) -> float:
        """Share that the planted and the named Mach numbers have in common of both together; 0 where none is named."""
        if self.change is None or self.change.mach is None or self.planted is None:
            return 0.0
        (low, high), (lowest, highest) = self.change.mach, self.planted
        return max(min(high, highest) - max(low, lowest), 0.0) / (max(high, highest) - min(low, lowest))


def fly(seed: int, vehicle: str, *, changed: bool = False, damped: bool = False, lagged: bool = False) -> Outcome | str:
    """Trace one vehicle, predict its sister; the reason in words where none came of it."""
    craft = CRAFTS[vehicle]
    times = 0.0
    try:
        plain = make_flight(craft, "lag" if lagged else "none", seed=seed)
        other = sister(craft, seed)
        other = replace(other, damping=(1.0 + DAMPED * damped) * other.damping)
        made = make_flight(other, seed=seed + SECOND, planted=plain.true.planted)
        if changed:
            made, times = with_change(made)
    except (RuntimeError, ValueError) as error:
        return f"seed {seed}: not flown ({error})"
    found = trace(plain.flight, TraceConfig(max_steps=2))
    if lagged and "lag" not in found.added:
        return f"seed {seed}: lag not found (added {', '.join(found.added) or 'nothing'})"
    predicted = predict(made.flight, found.model.definition, (*REFIT, "lag") if lagged else REFIT)
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
        predicted.local_change,
        (made.true.planted.values["low"], made.true.planted.values["high"]) if changed else None,
        times,
        predicted.difference.term if predicted.refused and predicted.difference is not None else "",
        damped,
    )


def with_change(plain: Made) -> tuple[Made, float]:
    """The flight with its slope changed between two Mach numbers, and at how many detection limits."""
    rng, true = np.random.default_rng([plain.seed, _CHANGE]), plain.true
    wide, wanted = rng.uniform(*WIDE), float(np.exp(rng.uniform(*np.log(TIMES))))
    begin = rng.uniform(0.1, 0.9 - wide)
    high, low = np.interp([begin, begin + wide], true.time / true.time[-1], true.mach)
    band = {"low": float(low), "high": float(high), "width": float(EDGE * (high - low))}
    ends = -2.0 * PAD, true.craft.duration + 2.0 * PAD

    def flown(amplitude: float) -> tuple[Made, float]:
        made = make_flight(
            true.craft, seed=plain.seed, start=true.start, planted=Planted("mach_band", amplitude, *ends, band)
        )
        return made, float(np.sqrt(f_ratios_in_record(made)[0] / DETECTED))

    size = FIRST * true.craft.static_slope * rng.choice([-1.0, 1.0])
    _, limits = flown(size)
    return flown(wanted * size / limits)


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
    covered = [BAND[0] <= o.inside <= BAND[1] for o in outcomes]
    yield _count(f"the frozen model explains at least {EXPLAINED:.0%}", [o.explained >= EXPLAINED for o in outcomes])
    yield _count(f"the 95 % band holds {BAND[0]:.0%} to {BAND[1]:.0%} of the samples", covered)
    if outcomes:
        yield f"explained: least {min(o.explained for o in outcomes):.4f}"
        inside = [o.inside for o in outcomes]
        yield f"share in the band: median {np.median(inside):.3f}, from {min(inside):.3f} to {max(inside):.3f}"
    changed = [o for o in outcomes if o.planted is not None]
    unchanged = [o for o in outcomes if o.planted is None]
    yield _count("the slope is another between two Mach numbers: they are named", [o.common > NAMED for o in changed])
    yield _count("the damping is another: the model is refused", [bool(o.refused) for o in outcomes if o.damped])
    same = [o for o in unchanged if not o.damped]
    yield _count("the aerodynamics are the same: the model is refused", [bool(o.refused) for o in same])
    yield _count("the schedule is the same: a change is named", [o.change is not None for o in unchanged])


def line(outcome: Outcome) -> str:
    """One pair in words."""
    refused = f"; refused for {outcome.refused}" if outcome.refused else ""
    return (
        f"{outcome.seed} {outcome.vehicle}: explained {outcome.explained:.4f}, in the band {outcome.inside:.3f}, "
        f"where both flew {outcome.flown:.2f}, error over noise {outcome.frozen:.2f} frozen, {outcome.own:.2f} fitted "
        f"there; added {', '.join(outcome.added) or 'nothing'}; {_difference(outcome)}{refused}"
    )


def _difference(outcome: Outcome) -> str:
    """What was planted of a local change, and what was named."""
    planted = "nothing" if outcome.planted is None else f"{_numbers(outcome.planted)} at {outcome.times:.1f} limits"
    change = outcome.change
    if change is None:
        return f"differs nowhere ({planted} planted)"
    size = f"{change.term} {change.value:.3g} +- {change.std_error:.2g}, F {change.f_ratio:.0f}"
    return f"differs at {_numbers(change.mach or (np.nan, np.nan))}: {size} ({planted} planted)"


def _numbers(mach: tuple[float, float]) -> str:
    return f"Mach {mach[1]:.4g} to {mach[0]:.4g}"


def _count(what: str, hits: Sequence[bool]) -> str:
    share = f"{np.mean(hits):.0%}" if hits else "-"
    return f"{what}: {sum(hits)} of {len(hits)} ({share})"


def main(arguments: Sequence[str] | None = None) -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--pairs", type=int, default=6)
    parser.add_argument("--jobs", type=int, default=1)
    how = parser.add_mutually_exclusive_group()
    how.add_argument("--changed", action="store_true", help="the second's slope is another between two Mach numbers")
    how.add_argument("--damped", action="store_true", help="the second's pitch damping is 3 % more")
    how.add_argument("--lagged", action="store_true", help="the same lag acts on both, at the same times")
    given = parser.parse_args(arguments)
    names = sorted(CRAFTS)
    each = ((given.seed + k, names[k % len(names)]) for k in range(given.pairs))
    runs = (delayed(fly)(*pair, changed=given.changed, damped=given.damped, lagged=given.lagged) for pair in each)
    fly_and_report(runs, given.jobs, line, report)


if __name__ == "__main__":
    main()
