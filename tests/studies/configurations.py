"""How long a comparison of five mechanisms takes on flights of each configuration, and how much memory, at fresh seeds.

    python -m tests.studies.configurations --seeds 5 [--first 1000] [--config configs/demo.yaml ...]

Each flight is simulated, with nothing planted or one of what its configuration can plant, and compared in a process of
its own, likelihood included; the median and the worst of them are printed, by configuration.
"""

from __future__ import annotations

import argparse
import multiprocessing
import resource
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np

from brv_hypo.comparison import CompareConfig, compare
from brv_hypo.errors import UnanswerableError
from brv_hypo.flight.record import Flight
from brv_hypo.simulation import config_names, load_config, simulate

COMPARED = CompareConfig(mechanisms=("damping", "inplane", "bodyfixed", "lag", "sticking"), maximum_likelihood="quick")
MOST_SECONDS, MOST_MB = 10.0, 1024.0
_MB_PER_UNIT = 1 / 1024 if sys.platform == "linux" else 1 / 1024**2  # of what the system states of memory


@dataclass(frozen=True)
class Cost:
    """Of one comparison: processor time without the simulation's, s, and the largest memory of its process, MB."""

    seed: int
    seconds: float
    megabytes: float
    outcome: str


def cost(config: str, seed: int) -> Cost:
    """Simulate and compare a flight in a process of its own."""
    context = multiprocessing.get_context("fork")
    here, there = context.Pipe(duplex=False)
    process = context.Process(target=_measured, args=(config, seed, there))
    process.start()
    there.close()
    try:
        return here.recv()  # type: ignore[no-any-return]
    except EOFError:
        return Cost(seed, float("nan"), float("nan"), "ended without an answer")
    finally:
        process.join()


def _measured(config: str, seed: int, answer: Connection) -> None:
    flight = _flown(config, seed)
    begun = _seconds()
    try:
        outcome: str = compare([flight], COMPARED).verdict.outcome
    except UnanswerableError:
        outcome = "refused"
    used = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * _MB_PER_UNIT
    answer.send(Cost(seed, _seconds() - begun, used, outcome))


def _flown(config: str, seed: int) -> Flight:
    plants = (None, *load_config(config).plantable)
    plant = plants[seed % len(plants)]
    return simulate(config, seed=seed, plant=() if plant is None else (plant,)).flight


def _seconds() -> float:
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


def main(arguments: Sequence[str] | None = None) -> int:
    """Print a line for each configuration; 1 where a flight took more than is allowed."""
    parser = argparse.ArgumentParser(prog="python -m tests.studies.configurations", description=__doc__)
    parser.add_argument("--seeds", type=int, default=5, help="flights of each configuration")
    parser.add_argument("--first", type=int, default=1000, help="seed of the first")
    parser.add_argument("--config", nargs="+", default=list(config_names()), help="file or name; all by default")
    given = parser.parse_args(arguments)
    print(
        f"{'configuration':24} {'flights':>7} {'CPU, s':>8} {'most':>8} {'at seed':>8} {'MB':>6} {'at seed':>8}"
        "  outcomes"
    )
    compare([_flown("demo", 0)], COMPARED)  # what is loaded and compiled once is in no flight's time
    kept = True
    for config in given.config:
        costs = [cost(config, seed) for seed in range(given.first, given.first + given.seeds)]
        slowest, largest = max(costs, key=lambda each: each.seconds), max(costs, key=lambda each: each.megabytes)
        outcomes = ", ".join(sorted({each.outcome for each in costs}))
        middle = np.median([each.seconds for each in costs])
        print(
            f"{Path(config).stem:24} {len(costs):7} {middle:8.1f} {slowest.seconds:8.1f} {slowest.seed:8} "
            f"{largest.megabytes:6.0f} {largest.seed:8}  {outcomes}",
            flush=True,
        )
        kept &= all(each.seconds <= MOST_SECONDS and each.megabytes <= MOST_MB for each in costs)
    print("all" if kept else "not all", f"within {MOST_SECONDS:g} s and {MOST_MB:g} MB")
    return 0 if kept else 1


if __name__ == "__main__":
    sys.exit(main())
