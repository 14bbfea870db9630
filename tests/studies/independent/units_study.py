"""Three inertial units aboard one vehicle: whether `compare` says the same of each record, within its errors.

By hand: python -m tests.studies.independent.units_study --seed 1000 --flights 12 --jobs 2

Flight k has seed SEED + k and what `imperfect_study` draws for it; its units differ in errors, noise and drifts, and
share vehicle, motion and air data. Two estimates of one quantity agree within 1.96 of the root of their variances' sum.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from joblib import delayed

from brv_hypo import compare
from brv_hypo.comparison import CompareConfig, Comparison
from tests.studies.identification.study import NORMAL_95
from tests.studies.independent.imperfect_study import command_line, count, drawn_flight
from tests.studies.independent.mechanisms import LISTED
from tests.studies.independent.reporting import fly_and_report

UNITS = 3


@dataclass(frozen=True)
class Outcome:
    """What the records of one vehicle's units said."""

    seed: int
    truth: str
    names: tuple[str | None, ...]
    apart: dict[str, tuple[float, ...]]
    """Of values that all of them state: differences of any two, in standard errors."""
    alpha: tuple[float, ...]
    """rms of the differences of alpha over what is stated of them."""


def fly(seed: int, number: int, grade: str, world: str) -> Outcome | str:
    """Draw, compare and note the units of one flight; the reason in words where it cannot be flown."""
    try:
        made = [drawn_flight(seed, number, grade, world, unit=unit)[0] for unit in range(UNITS)]
    except (RuntimeError, ValueError) as error:
        return f"seed {seed}: not flown ({error})"
    found = [compare(one.flight, CompareConfig(mechanisms=LISTED, maximum_likelihood="none")) for one in made]
    names = tuple(each.verdict.winner for each in found)
    apart: dict[str, tuple[float, ...]] = {}
    if set(names) == {made[0].truth} != {"none"}:
        planted = made[0].true.planted
        stated = [_stated(each, 0.5 * (planted.start + planted.stop)) for each in found]
        for name in set.intersection(*(set(each) for each in stated)):
            pairs = combinations([each[name] for each in stated], 2)
            apart[name] = tuple((a[0] - b[0]) / float(np.hypot(a[1], b[1])) for a, b in pairs)
    motions = [each.series[0] for each in found]
    alpha = tuple(
        float(np.sqrt(np.mean((np.array(a.alpha_rad) - np.array(b.alpha_rad)) ** 2)))
        / float(np.hypot(*(each.reconstruction.alpha_rms_sigma_rad for each in pair)))
        for (a, b), pair in zip(combinations(motions, 2), combinations(found, 2), strict=True)
    )
    return Outcome(made[0].seed, made[0].truth, names, apart, alpha)


def _stated(found: Comparison, middle: float) -> dict[str, tuple[float, float]]:
    """Values of the leader at mid-region, and its delays: each with its standard error."""
    leader = found.ranking[0]
    values = [v for own in leader.intervals if own.start_s <= middle < own.stop_s for v in own.values]
    delays = [each for each in leader.derived if each.name.endswith(" delay")]
    return {each.name: (each.value, each.std_error) for each in (*values, *delays[:1])}


def line(found: Outcome) -> str:
    """One vehicle in a line."""
    apart = ", ".join(f"{name} {max(map(abs, own)):.1f}" for name, own in found.apart.items())
    return f"{found.seed} {found.truth}: {', '.join(map(str, found.names))}; apart {apart or '-'}; alpha {found.alpha}"


def report(outcomes: Sequence[Outcome]) -> Iterable[str]:
    """Counts with their intervals."""
    yield count("the same verdict of all units", [len(set(o.names)) == 1 for o in outcomes])
    yield count("two units name different mechanisms", [len({*o.names} - {None, "none"}) > 1 for o in outcomes])
    differences = [abs(each) for o in outcomes for own in o.apart.values() for each in own]
    yield count("stated values agree within 1.96", [each <= NORMAL_95 for each in differences])
    yield count("alpha agrees within twice what is stated", [each <= 2.0 for o in outcomes for each in o.alpha])


def main(arguments: Sequence[str] | None = None) -> None:
    """The command."""
    given = command_line(__doc__.splitlines()[0], 12, "all", arguments)
    runs = (delayed(fly)(given.seed + k, k, given.grade, given.world) for k in range(given.flights))
    fly_and_report(runs, given.jobs, line, report)


if __name__ == "__main__":
    main()
