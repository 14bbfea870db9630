"""Today's verdict beside that with processes, on independent flights with imperfections that no tolerance covers.

By hand: python -m tests.studies.processes.study --seed 520000 --flights 26 --jobs 2

Flight k has seed SEED + k, as in `tests.studies.independent.imperfect_study`, whose counts are printed for both.
`--world tolerances` flies nothing but errors within the tolerances instead, `--world all` all kinds together at half of
their ordinary size.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from joblib import delayed

from brv_hypo import compare
from brv_hypo.errors import BrvHypoError
from brv_hypo.ranking import CompareConfig
from tests.studies.independent.flights import Made, make_flight
from tests.studies.independent.imperfect_study import count, drawn_flight
from tests.studies.independent.mechanisms import LISTED
from tests.studies.independent.reporting import fly_and_report
from tests.studies.independent.vehicles import CRAFTS
from tests.studies.processes.evidence import answers, probabilities

NAMED = 0.9  # probability from which a hypothesis is named
SMALLEST = 0.03  # of a full size, in the world of tolerances: drawn log-uniformly up to 1
_STREAM = 11


@dataclass(frozen=True)
class Outcome:
    """One flight: today's name, and that with processes with its probability."""

    seed: int
    kind: str
    truth: str
    share: float
    outcome: str
    today: str | None
    leads: str
    chance: float
    family: str


def within_tolerances(seed: int, number: int) -> Made:
    """A flight that has what the tolerances list: nothing, or a mechanism of 3 to 100 % of its full size."""
    rng = np.random.default_rng([seed, _STREAM])
    truth = ("none", *LISTED)[number % (1 + len(LISTED))]
    amplitude = float(np.exp(rng.uniform(np.log(SMALLEST), 0.0)))
    return make_flight(str(rng.choice(sorted(CRAFTS))), truth, amplitude, seed)


def fly(seed: int, number: int, world: str) -> Outcome | str:
    """Draw, compare both ways and note one flight; the reason in words where nothing came of it."""
    try:
        if world == "tolerances":
            made, kind = within_tolerances(seed, number), world
        else:
            made, kind = drawn_flight(seed, number, "tactical", world == "all")
        verdict = compare([made.flight], CompareConfig(mechanisms=LISTED, maximum_likelihood="none")).verdict
        found = answers(made.flight, LISTED)
    except (RuntimeError, ValueError, BrvHypoError) as error:
        return f"seed {seed}: nothing came of it ({error})"
    chances = probabilities(found)
    leads = max(chances, key=chances.__getitem__)
    families = found[leads].by_family()
    return Outcome(
        seed=seed,
        kind=kind,
        truth=made.truth,
        share=made.true.share,
        outcome=verdict.outcome,
        today=verdict.winner,
        leads=leads,
        chance=chances[leads],
        family=max(families, key=families.__getitem__),
    )


def line(found: Outcome) -> str:
    """One flight in a line."""
    return (
        f"{found.seed} {found.kind} {found.truth} share {found.share:.3f}: today {found.outcome} {found.today}; with "
        f"processes {found.leads} {found.chance:.2f}, largest in {found.family}"
    )


def report(outcomes: Sequence[Outcome]) -> Iterable[str]:
    """Counts for both, with exact 95 % intervals."""
    for label, name in (("today", lambda o: o.today), ("processes", lambda o: o.leads if o.chance >= NAMED else None)):
        planted = [(o, name(o)) for o in outcomes if o.truth != "none"]
        empty = [name(o) for o in outcomes if o.truth == "none"]
        yield count(f"{label}, planted: named right", [found == o.truth for o, found in planted])
        yield count(f"{label}, planted: a wrong name", [found not in (None, "none", o.truth) for o, found in planted])
        yield count(f"{label}, nothing planted: a false name", [found not in (None, "none") for found in empty])
        yield count(f"{label}, nothing planted: baseline only", [found == "none" for found in empty])


def main(arguments: Sequence[str] | None = None) -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--flights", type=int, default=26)
    parser.add_argument("--world", default="one", choices=("one", "all", "tolerances"))
    parser.add_argument("--jobs", type=int, default=1)
    given = parser.parse_args(arguments)
    runs = (delayed(fly)(given.seed + k, k, given.world) for k in range(given.flights))
    fly_and_report(runs, given.jobs, line, report)


if __name__ == "__main__":
    main()
