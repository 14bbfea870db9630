"""How often `compare` is right on independent flights: false and wrong names, power against the oracle, limits, sigmas.

By hand: python -m tests.independent.study --seed 1000 --flights 120 --jobs 2

Flight k has seed SEED + k; none and the five mechanisms take turns (`--unlisted N`: every N-th flight has a mechanism
that is not in the list); vehicle and amplitude (log-uniform, 0.3 % to 100 % of nominal) are drawn from the seed.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from joblib import Parallel, delayed

from brv_hypo import compare, reconstruct
from brv_hypo.ranking import CompareConfig
from tests.independent.flights import Made, draw_flight
from tests.independent.mechanisms import LISTED, UNLISTED
from tests.independent.oracle import Known, judge

NAMES = ("damping", "inplane", "bodyfixed", "lag", "sticking")
# 2 ln L by which the oracle parts the truth from every rival, from which the program should name it.
PARTED = 10.0
# F of the truth's own column at the detection limit.
DETECTED = 25.0
# Share of what was planted, in squares, from which a listed mechanism is said to reproduce it.
REPRODUCED = 0.9


@dataclass(frozen=True)
class Outcome:
    """One flight: what was planted, what the oracle could know, what the program said.

    `share` is the planted rms over the moment's, whole record; `limit` what the program allows that mechanism;
    `reproduced` the share of what was planted, in squares, that the nearest listed mechanism reproduces on the true
    motion. `stated` are stated over true rms errors of alpha and meridian.
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
    chance: float
    limit: float
    stated: tuple[float, float]


def fly(seed: int, number: int, grade: str, factor: float, unlisted: int) -> Outcome | str:
    """Draw, compare and note one flight; the reason in words where none came of it."""
    names = ("none", *NAMES)
    truth = names[number % len(names)]
    if unlisted and number % unlisted == unlisted - 1:
        truth = UNLISTED[(number // unlisted) % len(UNLISTED)]
    try:
        made = draw_flight(seed, truth=truth, grade=grade, factor=factor)
    except (RuntimeError, ValueError) as error:
        return f"seed {seed}: not flown ({error})"
    found = compare([made.flight], CompareConfig(mechanisms=NAMES, maximum_likelihood="none"))
    known = judge(made) if truth != "none" else None
    verdict = found.verdict
    limits = {limit.mechanism: limit.share_of_moment_95 for limit in verdict.limits}
    return Outcome(
        seed,
        made.vehicle,
        truth,
        _share(made),
        np.inf if known is None else known.f_ratio,
        np.inf if known is None else min(rival.two_ln_l for rival in known.against.values()),
        np.nan if known is None else _reproduced(known),
        verdict.outcome,
        verdict.winner,
        verdict.equivalent,
        max(verdict.probability.values(), default=0.0),
        limits.get(truth, np.nan),
        _stated(made),
    )


def _share(made: Made) -> float:
    whole = np.sqrt(np.mean(np.abs(made.true.moment) ** 2))
    return float(np.sqrt(np.mean(np.abs(made.true.contribution) ** 2)) / whole)


def _reproduced(known: Known) -> float:
    listed = [rival.two_ln_l for name, rival in known.against.items() if name != "none"]
    return 1.0 - min(listed) / known.f_ratio if known.f_ratio > 0.0 else np.nan


def _stated(made: Made) -> tuple[float, float]:
    """Stated over true rms errors of alpha, and of the meridian where alpha is not small."""
    found, true = reconstruct(made.flight), made.true
    alpha = _ratio(found.alpha_sigma, found.motion.alpha - true.alpha)
    clear = true.alpha > 0.2 * np.sqrt(np.mean(true.alpha**2))
    turned = np.angle(np.exp(1j * (found.motion.windward_meridian - true.meridian)))
    meridian = _ratio(found.phi_w_sigma[clear], turned[clear])
    return alpha, meridian


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
    seen = [o for o in listed if o.f_ratio >= DETECTED]
    yield _count("above the detection limit: winner or in `equivalent`", [o.truth in o.equivalent for o in seen])
    yield _count("above the detection limit: 'none adequate'", [o.outcome == "none adequate" for o in seen])
    yield _count("planted: the limit covers the share", [o.share <= o.limit for o in listed])
    apart = [o for o in other if o.f_ratio >= DETECTED and not o.reproduced >= REPRODUCED]
    yield _count(
        "outside the list, above the detection limit, not reproduced: 'none adequate' or undecided",
        [o.winner is None for o in apart],
    )
    yield _count("outside the list, all: a mechanism is named", [o.winner not in (None, "none") for o in other])
    yield _count("records refused", [o.outcome == "record fault" for o in outcomes])
    for k, what in enumerate(("alpha", "meridian")):
        ratios = np.array([o.stated[k] for o in outcomes])
        yield (
            f"stated over true error of {what}: median {np.median(ratios):.2f}, "
            f"at least half in {np.mean(ratios >= 0.5):.0%}"
        )


def _count(what: str, hits: Sequence[bool]) -> str:
    share = f"{np.mean(hits):.1%}" if hits else "-"
    return f"{what}: {sum(hits)} of {len(hits)} ({share})"


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--flights", type=int, default=60)
    parser.add_argument("--grade", default="tactical")
    parser.add_argument("--factor", type=float, default=1.0, help="true errors over the stated tolerances")
    parser.add_argument("--unlisted", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("-v", "--verbose", action="store_true")
    given = parser.parse_args()
    runs = (
        delayed(fly)(given.seed + k, k, given.grade, given.factor, given.unlisted) for k in range(given.flights)
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
                f"{found.outcome} {found.winner} {found.equivalent} limit {found.limit:.4f}",
                flush=True,
            )
    print("\n".join(report(outcomes)))


if __name__ == "__main__":
    main()
