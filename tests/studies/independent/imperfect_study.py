"""How `compare` answers on flights with what no list of tolerances holds: one kind of imperfection in turn, or all.

By hand: python -m tests.studies.independent.imperfect_study --seed 1000 --flights 75 --jobs 2

Flight k has seed SEED + k and the kind k of `imperfections.KINDS` (`--all`: every kind at half of its ordinary size).
Nothing and one of the five mechanisms take turns, one in three empty; the mechanism has 30 to 100 % of its full size.
Counts come with exact 95 % intervals (Clopper and Pearson 1934).
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from joblib import delayed
from scipy.stats import beta

from brv_hypo import compare
from brv_hypo.ranking import CompareConfig
from tests.studies.independent.flights import Made, make_flight
from tests.studies.independent.imperfections import KINDS
from tests.studies.independent.instruments import GRADES
from tests.studies.independent.mechanisms import LISTED
from tests.studies.independent.reporting import fly_and_report
from tests.studies.independent.vehicles import CRAFTS

AMPLITUDE = (0.3, 1.0)  # of a mechanism's full size
EMPTY_EVERY = 3  # flights, of which one has nothing planted
HALF = 0.5  # of the ordinary size, where all kinds come together
_STREAM = 7


@dataclass(frozen=True)
class Outcome:
    """One flight: what it had, what the program said."""

    seed: int
    kind: str
    vehicle: str
    truth: str
    share: float
    outcome: str
    winner: str | None
    leads: str
    chance: float


def drawn_flight(seed: int, number: int, grade: str, everything: bool) -> tuple[Made, str]:
    """The flight of this number and the kind of its imperfection. Raises RuntimeError where none can be flown."""
    rng = np.random.default_rng([seed, _STREAM])
    vehicle = str(rng.choice(sorted(CRAFTS)))
    truth, amplitude = str(rng.choice(LISTED)), float(rng.uniform(*AMPLITUDE))
    if (number // len(KINDS) + number) % EMPTY_EVERY == 0:
        truth = "none"
    kinds, size = (KINDS, HALF) if everything else ((KINDS[number % len(KINDS)],), 1.0)
    made = make_flight(vehicle, truth, amplitude, seed, grade, imperfect=kinds, imperfect_size=size)
    return made, "all" if everything else kinds[0]


def fly(seed: int, number: int, grade: str, everything: bool) -> Outcome | str:
    """Draw, compare and note one flight; the reason in words where it cannot be flown."""
    try:
        made, kind = drawn_flight(seed, number, grade, everything)
    except (RuntimeError, ValueError) as error:
        return f"seed {seed}: not flown ({error})"
    verdict = compare([made.flight], CompareConfig(mechanisms=LISTED, maximum_likelihood="none")).verdict
    leads = max(verdict.probability, key=verdict.probability.__getitem__, default="record fault")
    return Outcome(
        seed=seed,
        kind=kind,
        vehicle=made.vehicle,
        truth=made.truth,
        share=made.true.share,
        outcome=verdict.outcome,
        winner=verdict.winner,
        leads=leads,
        chance=verdict.probability.get(leads, 0.0),
    )


def line(found: Outcome) -> str:
    """One flight in a line."""
    return (
        f"{found.seed} {found.kind} {found.vehicle} {found.truth} share {found.share:.3f}: {found.outcome} "
        f"{found.winner}, {found.leads} leads with {found.chance:.2f}"
    )


def report(outcomes: Sequence[Outcome]) -> Iterable[str]:
    """Counts with their intervals, and the kinds with which a planted mechanism is not named."""
    planted = [o for o in outcomes if o.truth != "none"]
    empty = [o for o in outcomes if o.truth == "none"]
    yield count("planted: named right", [o.winner == o.truth for o in planted])
    yield count("planted: a wrong mechanism is named", [o.winner not in (None, "none", o.truth) for o in planted])
    yield count("planted: 'none adequate'", [o.outcome == "none adequate" for o in planted])
    yield count("planted: the truth leads", [o.leads == o.truth for o in planted])
    yield count("nothing planted: a mechanism is named", [o.winner not in (None, "none") for o in empty])
    yield count("nothing planted: baseline only is named", [o.winner == "none" for o in empty])
    yield count("nothing planted: 'none adequate'", [o.outcome == "none adequate" for o in empty])
    yield count("records refused", [o.outcome == "record fault" for o in outcomes])
    for kind in dict.fromkeys(o.kind for o in outcomes):
        own = [o for o in planted if o.kind == kind]
        if own:
            yield f"{kind}: {sum(o.winner == o.truth for o in own)} of {len(own)} named right"


def count(what: str, hits: Sequence[bool]) -> str:
    """A count, its share and its exact 95 % interval."""
    if not hits:
        return f"{what}: none tried"
    k, n = sum(hits), len(hits)
    low = float(beta.ppf(0.025, k, n - k + 1)) if k else 0.0
    high = float(beta.ppf(0.975, k + 1, n - k)) if k < n else 1.0
    return f"{what}: {k} of {n} ({k / n:.0%}, {low:.0%} to {high:.0%})"


def main(arguments: Sequence[str] | None = None) -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--flights", type=int, default=len(KINDS))
    parser.add_argument("--grade", default="tactical", choices=GRADES)
    parser.add_argument("--all", action="store_true", help="all kinds together, at half of their ordinary size")
    parser.add_argument("--jobs", type=int, default=1)
    given = parser.parse_args(arguments)
    runs = (delayed(fly)(given.seed + k, k, given.grade, given.all) for k in range(given.flights))
    fly_and_report(runs, given.jobs, line, report)


if __name__ == "__main__":
    main()
