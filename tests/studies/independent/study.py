"""How often `compare` is right on independent flights: false and wrong names, power against a bound, limits, sigmas.

By hand: python -m tests.studies.independent.study --seed 1000 --flights 120 --jobs 2

Flight k has seed SEED + k; none and the five mechanisms take turns (`--unlisted N`: every N-th flight has a mechanism
that is not in the list); vehicle and amplitude (log-uniform, 0.3 % to 100 % of nominal) are drawn from the seed.
`--drawn` flies a vehicle with bent aerodynamics that is drawn as well, in place of one of four. `--grade mixed` draws
the grade too, `--coloured` the correlation of neighbouring samples of the inertial unit's noise, which then is as
likely white as coloured.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from joblib import Parallel, delayed

from brv_hypo import compare, reconstruct
from brv_hypo.comparison import CompareConfig
from brv_hypo.comparison.result import OTHER
from tests.studies.independent.drawn_vehicles import draw_craft
from tests.studies.independent.flights import Made, draw_flight
from tests.studies.independent.instruments import GRADES, Noise
from tests.studies.independent.mechanisms import LISTED, UNLISTED
from tests.studies.independent.oracle import Known, judge

NAMES = ("damping", "inplane", "bodyfixed", "lag", "sticking")
# 2 ln L by which the ideal observer separates the truth from every rival, from which the program should name it.
PARTED = 10.0
# F of the truth's own column at the detection limit.
DETECTED = 25.0
# Share of what was planted, in squares, from which a listed mechanism is said to reproduce it.
REPRODUCED = 0.9
# F from one to three detection limits, between which limits are neither idle nor sure.
LIMITS_TRIED = (DETECTED, 9.0 * DETECTED)
# Share of repetitions with the same outcome from which a verdict is called stable.
STABLE = 0.9
# 95 %, one-sided.
ONE_SIDED = 1.645
MIXED = "mixed"
# Correlation of neighbouring samples that is drawn.
COLOURS = (0.3, 0.9)
# Bins of the expected calibration error.
BINS = 10
_STREAM = 5


@dataclass(frozen=True)
class Outcome:
    """One flight: what was planted, what an ideal observer could know, what the program said.

    `share` is the planted rms over the moment's, whole record; `limit` what the program allows that mechanism;
    `reproduced` the share of what was planted, in squares, that the nearest listed mechanism reproduces on the true
    motion. `stated` are stated over true rms errors of alpha, meridian and moments; `leads` has probability `chance`.
    `stability` is the verdict's.
    """

    seed: int
    vehicle: str
    truth: str
    share: float
    f_ratio: float
    parted_by: float
    reproduced: float
    outcome: str
    winner: str | None
    equivalent: tuple[str, ...]
    leads: str
    chance: float
    limit: float
    stated: tuple[float, float, float]
    stability: float


def drawn_flight(
    seed: int, number: int, grade: str, factor: float, unlisted: int, coloured: bool = False, drawn: bool = False
) -> Made:
    """The flight of this number in a study. Raises RuntimeError or ValueError where none can be flown."""
    names = ("none", *NAMES)
    truth = names[number % len(names)]
    if unlisted and number % unlisted == unlisted - 1:
        truth = UNLISTED[(number // unlisted) % len(UNLISTED)]
    rng = np.random.default_rng([seed, _STREAM])
    drawn_grade, colour = str(rng.choice(GRADES)), float(rng.uniform(*COLOURS))
    noise = Noise(colour=colour if coloured and rng.random() < 0.5 else 0.0)
    grade = drawn_grade if grade == MIXED else grade
    vehicle = {"vehicle": draw_craft(rng)} if drawn else {}
    return draw_flight(seed, truth=truth, grade=grade, factor=factor, noise=noise, **vehicle)


def fly(
    seed: int,
    number: int,
    grade: str,
    factor: float,
    unlisted: int,
    coloured: bool = False,
    per_cycle: bool = False,
    drawn: bool = False,
) -> Outcome | str:
    """Draw, compare and note one flight; the reason in words where none came of it.

    `per_cycle`: body-fixed moments are fitted in Chrusciel's variant, anew in each cycle of the meridian. `drawn`:
    the vehicle is drawn too.
    """
    try:
        made = drawn_flight(seed, number, grade, factor, unlisted, coloured, drawn)
    except (RuntimeError, ValueError) as error:
        return f"seed {seed}: not flown ({error})"
    options = {"bodyfixed": {"variant": "per_cycle"}} if per_cycle else {}
    found = compare([made.flight], CompareConfig(mechanisms=NAMES, options=options, maximum_likelihood="none"))
    known = judge(made) if made.truth != "none" else None
    verdict = found.verdict
    limits = {limit.mechanism: limit.share_of_moment_95 for limit in verdict.limits}
    return Outcome(
        seed,
        made.vehicle,
        made.truth,
        share_of(made),
        np.inf if known is None else known.f_ratio,
        np.inf if known is None else min(rival.two_ln_l for rival in known.against.values()),
        np.nan if known is None else _reproduced(known),
        verdict.outcome,
        verdict.winner,
        verdict.equivalent,
        max(verdict.probability, key=verdict.probability.__getitem__, default="record fault"),
        max(verdict.probability.values(), default=0.0),
        limits.get(made.truth, np.nan),
        _stated(made),
        np.nan if verdict.stability is None else verdict.stability,
    )


def share_of(made: Made) -> float:
    """The rms moment of what is planted over that of all that turns the vehicle."""
    whole = np.sqrt(np.mean(np.abs(made.true.turning) ** 2))
    return float(np.sqrt(np.mean(np.abs(made.true.contribution) ** 2)) / whole)


def _reproduced(known: Known) -> float:
    listed = [rival.two_ln_l for name, rival in known.against.items() if name != "none"]
    return 1.0 - min(listed) / known.f_ratio if known.f_ratio > 0.0 else np.nan


def _stated(made: Made) -> tuple[float, float, float]:
    """Stated over true rms errors of alpha, of the meridian where alpha is not small, and of a moment's component."""
    found, true = reconstruct(made.flight), made.true
    alpha = _ratio(found.alpha_sigma, found.motion.alpha - true.alpha)
    clear = true.alpha > 0.2 * np.sqrt(np.mean(true.alpha**2))
    turned = np.angle(np.exp(1j * (found.motion.windward_meridian - true.meridian)))
    meridian = _ratio(found.phi_w_sigma[clear], turned[clear])
    moments, usable = found.moments, found.moments.usable
    missed = (moments.body - true.moment)[usable] / np.sqrt(2.0)
    return alpha, meridian, _ratio(moments.sigma[usable], np.abs(missed))


def _ratio(sigma: np.ndarray, error: np.ndarray) -> float:
    return float(np.sqrt(np.mean(sigma**2) / np.mean(error**2)))


def report(outcomes: Sequence[Outcome]) -> Iterable[str]:
    """Lines of counts with their denominators."""
    empty = [o for o in outcomes if o.truth == "none"]
    listed = [o for o in outcomes if o.truth in LISTED]
    other = [o for o in outcomes if o.truth in UNLISTED]
    yield _count("nothing planted: a mechanism is named", [o.winner not in (None, "none") for o in empty])
    yield _count("nothing planted: none is named", [o.winner == "none" for o in empty])
    yield _count("nothing planted: none stands", ["none" in o.equivalent for o in empty])
    yield _count("nothing planted: 'none adequate'", [o.outcome == "none adequate" for o in empty])
    yield _count("planted: a wrong mechanism wins", [o.winner not in (None, "none", o.truth) for o in listed])
    parted = [o for o in listed if o.parted_by >= PARTED]
    yield _count(f"parted by 2 ln L >= {PARTED:g}: the truth wins", [o.winner == o.truth for o in parted])
    detectable = [o for o in listed if o.f_ratio >= DETECTED]
    yield _count("above the detection limit: winner or in `equivalent`", [o.truth in o.equivalent for o in detectable])
    yield _count("above the detection limit: 'none adequate'", [o.outcome == "none adequate" for o in detectable])
    yield _count("planted: the limit covers the share", [o.share <= o.limit for o in listed])
    tried = [o for o in listed if LIMITS_TRIED[0] <= o.f_ratio <= LIMITS_TRIED[1]]
    yield _count(
        "between one and three detection limits: the limit covers the share", [o.share <= o.limit for o in tried]
    )
    over = [o.limit / _known_limit(o) for o in detectable if np.isfinite(o.limit)]  # a record refused has none
    yield (
        f"limit over the oracle's: median {_median(over):.2f}; names that stand "
        f"above the detection limit: median {_median([len(o.equivalent) for o in detectable]):.0f}"
    )
    apart = [o for o in other if o.f_ratio >= DETECTED and not o.reproduced >= REPRODUCED]
    yield _count(
        "outside the list, above the detection limit, not reproduced: 'none adequate' or undecided",
        [o.winner is None for o in apart],
    )
    yield _count("outside the list, all: a mechanism is named", [o.winner not in (None, "none") for o in other])
    yield f"expected calibration error, above the detection limit: {_calibration_error([*detectable, *apart]):.3f}"
    for said in ("named", "undecided", "none adequate"):
        shares = [o.stability for o in outcomes if o.outcome == said]
        yield _count(f"{said}: stability of 0.9 or more", [share >= STABLE for share in shares])
    yield _count("records refused", [o.outcome == "record fault" for o in outcomes])
    for k, what in enumerate(("alpha", "meridian", "moments")):
        ratios = np.array([o.stated[k] for o in outcomes])
        yield (
            f"stated over true error of {what}: median {np.median(ratios):.2f}, "
            f"at least half in {np.mean(ratios >= 0.5):.0%}"
        )


def _known_limit(outcome: Outcome) -> float:
    """Share that the ideal observer allows at 95 %, on the average."""
    return outcome.share * (1.0 + ONE_SIDED / np.sqrt(outcome.f_ratio))


def _median(values: Sequence[float]) -> float:
    return float(np.median(values)) if values else np.nan


def _calibration_error(outcomes: Sequence[Outcome]) -> float:
    """Mean distance of stated from true share of right leaders, over bins of the leader's probability (Naeini 2015).

    "Something else" is right where what was planted is not in the list.
    """
    if not outcomes:
        return np.nan
    chances = np.array([o.chance for o in outcomes])
    right = np.array([o.leads == (o.truth if o.truth in LISTED else OTHER) for o in outcomes])
    bins = np.minimum((chances * BINS).astype(int), BINS - 1)
    gaps = [np.abs(np.sum(chances[bins == k]) - np.sum(right[bins == k])) for k in range(BINS)]
    return float(np.sum(gaps) / chances.size)


def _count(what: str, hits: Sequence[bool]) -> str:
    share = f"{np.mean(hits):.1%}" if hits else "-"
    return f"{what}: {sum(hits)} of {len(hits)} ({share})"


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--flights", type=int, default=60)
    parser.add_argument("--grade", default="tactical", choices=[*GRADES, MIXED])
    parser.add_argument("--coloured", action="store_true", help="every flight's noise is as likely coloured as white")
    parser.add_argument("--factor", type=float, default=1.0, help="true errors over the stated tolerances")
    parser.add_argument("--unlisted", type=int, default=0)
    parser.add_argument("--per-cycle", action="store_true", help="body-fixed moments anew in each cycle")
    parser.add_argument("--drawn", action="store_true", help="a vehicle drawn for every flight")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("-v", "--verbose", action="store_true")
    given = parser.parse_args()
    runs = (
        delayed(fly)(
            given.seed + k, k, given.grade, given.factor, given.unlisted, given.coloured, given.per_cycle, given.drawn
        )
        for k in range(given.flights)
    )
    outcomes: list[Outcome] = []
    for found in Parallel(n_jobs=given.jobs, return_as="generator")(runs):
        if isinstance(found, str):
            print(found, flush=True)
            continue
        outcomes.append(found)
        if given.verbose:
            print(
                f"{found.seed} {found.vehicle} {found.truth} share {found.share:.4f} F {found.f_ratio:.0f} "
                f"parted {found.parted_by:.0f} reproduced {found.reproduced:.2f}: "
                f"{found.outcome} {found.winner} {found.equivalent} limit {found.limit:.4f} "
                f"stability {found.stability:.2f}",
                flush=True,
            )
    print("\n".join(report(outcomes)))


if __name__ == "__main__":
    main()
