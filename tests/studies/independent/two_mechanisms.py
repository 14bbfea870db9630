"""Two mechanisms at two times of one flight: is their sum named where it is listed, and nothing where it is not?

By hand: python -m tests.studies.independent.two_mechanisms --seed 1000 --flights 20 --jobs 2

Flight k has seed SEED + k and two mechanisms that are drawn, each at 30 to 100 % of full size, one in the first half
of the record and the other in the second; one kind of imperfection in turn (world one), all of them, or none. It is
compared with the five mechanisms, and with two sums beside these: that which acts, and its first with a third.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from joblib import delayed

from brv_hypo import compare
from brv_hypo.comparison import CompareConfig
from brv_hypo.errors import UnanswerableError
from tests.studies.independent.flights import Made, make_flight
from tests.studies.independent.imperfect_study import AMPLITUDE, HALF, command_line, count
from tests.studies.independent.imperfections import KINDS
from tests.studies.independent.mechanisms import LISTED
from tests.studies.independent.reporting import fly_and_report
from tests.studies.independent.vehicles import CRAFTS

REGIONS = ((0.12, 0.42), (0.55, 0.85))  # of the record, within a tenth of which each begins and ends
_STREAM = 31


@dataclass(frozen=True)
class Outcome:
    """One flight: which two acted, what was named of single mechanisms, and what with sums."""

    seed: int
    vehicle: str
    truth: tuple[str, str]
    alone: str | None
    described: str | None
    advised: str
    """The sum that the comparison of single mechanisms advises; empty where none."""
    winner: str | None
    leads: str
    seconds: float


def drawn(seed: int, number: int, grade: str, world: str) -> tuple[Made, tuple[str, str], str]:
    """The flight of this number, its two mechanisms, and a third.

    Raises RuntimeError where none can be flown.
    """
    rng = np.random.default_rng([seed, _STREAM])
    vehicle, names = str(rng.choice(sorted(CRAFTS))), rng.permutation(LISTED).tolist()
    sizes, kind = rng.uniform(*AMPLITUDE, size=2), KINDS[number % len(KINDS)]
    kinds = {"tolerances": (), "all": KINDS}.get(world, (kind,))
    span = CRAFTS[vehicle].duration
    first, second = (tuple(span * (np.array(each) + rng.uniform(-0.05, 0.05, size=2))) for each in REGIONS)
    later = make_flight(vehicle, names[1], float(sizes[1]), seed, grade, region=second).true.planted
    known = {"imperfect": kinds, "imperfect_size": HALF if world == "all" else 1.0}
    made = make_flight(vehicle, names[0], float(sizes[0]), seed, grade, region=first, beside=later, **known)
    return made, (names[0], names[1]), names[2]


def fly(seed: int, number: int, grade: str, world: str) -> Outcome | str:
    """Draw and compare one flight; the reason in words where it cannot be flown."""
    try:
        made, truth, third = drawn(seed, number, grade, world)
    except (RuntimeError, ValueError) as error:
        return f"seed {seed}: not flown ({error})"
    sums = ("+".join(truth), f"{truth[0]}+{third}")
    try:
        alone, found = (
            compare([made.flight], CompareConfig(mechanisms=each, maximum_likelihood="none"))
            for each in (LISTED, (*LISTED, *sums))
        )
    except UnanswerableError as error:  # it tumbles
        return f"seed {seed}: {error}"
    chances = found.verdict.probability
    return Outcome(
        seed=seed,
        vehicle=made.vehicle,
        truth=truth,
        alone=alone.verdict.winner,
        described=alone.verdict.described,
        advised="".join(re.findall(r"compare (\S+) as well", alone.verdict.reason)),
        winner=found.verdict.winner,
        leads=max(chances, key=chances.__getitem__, default="record fault"),
        seconds=found.seconds.total,
    )


def line(found: Outcome) -> str:
    """One flight in a line."""
    return (
        f"{found.seed} {found.vehicle} {'+'.join(found.truth)}: alone {found.alone} ({found.described}), advised "
        f"{found.advised or 'nothing'}; with sums "
        f"{found.winner}, {found.leads} leads; {found.seconds:.1f} s"
    )


def report(outcomes: Sequence[Outcome]) -> Iterable[str]:
    """Counts with their intervals."""
    yield count("sum listed: it is named", [o.winner == "+".join(o.truth) for o in outcomes])
    yield count("sum listed: it leads", [o.leads == "+".join(o.truth) for o in outcomes])
    yield count("sum listed: one of the two is named", [o.winner in o.truth for o in outcomes])
    others = [o.winner not in (None, "none", "+".join(o.truth), *o.truth) for o in outcomes]
    yield count("sum listed: something else is named", others)
    yield count("not listed: one of the two is named", [o.alone in o.truth for o in outcomes])
    yield count("not listed: a third is named", [o.alone not in (None, "none", *o.truth) for o in outcomes])
    yield count("not listed: one of the two is described, not named", [o.described in o.truth for o in outcomes])
    yield count("not listed: their sum is advised", [set(o.advised.split("+")) == set(o.truth) for o in outcomes])
    others = [bool(o.advised) and set(o.advised.split("+")) != set(o.truth) for o in outcomes]
    yield count("not listed: another sum is advised", others)


def main(arguments: Sequence[str] | None = None) -> None:
    """The command."""
    given = command_line(__doc__.splitlines()[0], 20, "one", arguments)
    runs = (delayed(fly)(given.seed + k, k, given.grade, given.world) for k in range(given.flights))
    fly_and_report(runs, given.jobs, line, report)


if __name__ == "__main__":
    main()
