"""Cost of `compare` on the flights that come with the program: `python -m brv_hypo.ranking.configs_benchmark --seed N`.

Flights of every config in turn, with nothing planted or one of what it can plant, each of a seed of its own:
processor seconds of the comparison of five mechanisms with the likelihood, in the median and at most, and the most
memory that the process ever had.
"""

from __future__ import annotations

import argparse
import resource
import time
from collections import defaultdict
from collections.abc import Sequence

import numpy as np

from brv_hypo.errors import UnanswerableError
from brv_hypo.ranking.benchmark import MECHANISMS
from brv_hypo.ranking.compare import compare
from brv_hypo.ranking.config import CompareConfig
from brv_hypo.simulation import load_config, simulate

CONFIGS = ("blunt_capsule", "demo", "report_table_5", "research_cone", "sounding_rocket")
_KILOBYTES = 1024  # of what `getrusage` counts memory in


def seconds(name: str, seed: int) -> tuple[str, float]:
    """What was planted, and processor seconds of the comparison (nan where the record is refused)."""
    config = load_config(name)
    plants = ("none", *config.plantable)
    plant = plants[seed // len(CONFIGS) % len(plants)]
    flight = simulate(config, seed=seed, plant=() if plant == "none" else (plant,)).flight
    began = time.process_time()
    try:
        compare([flight], CompareConfig(mechanisms=MECHANISMS, maximum_likelihood="quick"))
    except UnanswerableError:
        return plant, float("nan")
    return plant, time.process_time() - began


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m brv_hypo.ranking.configs_benchmark", description=__doc__)
    parser.add_argument("--seed", type=int, required=True, help="of the first flight; the next has the next")
    parser.add_argument("--flights", type=int, default=200)
    parser.add_argument("-v", "--verbose", action="store_true", help="a line for each flight")
    given = parser.parse_args(arguments)
    found: dict[str, list[float]] = defaultdict(list)
    for seed in range(given.seed, given.seed + given.flights):
        name = CONFIGS[seed % len(CONFIGS)]
        plant, spent = seconds(name, seed)
        found[name].append(spent)
        if given.verbose:
            print(f"{seed} {name} {plant}: {spent:.2f} s", flush=True)
    print(f"{'config':20}{'flights':>8}{'refused':>8}{'median, s':>11}{'most, s':>9}")
    for name, all_seconds in found.items():
        values = np.array(all_seconds)
        print(
            f"{name:20}{values.size:8}{np.count_nonzero(np.isnan(values)):8}"
            f"{np.nanmedian(values):11.2f}{np.nanmax(values):9.2f}"
        )
    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * _KILOBYTES
    print(f"at most {most / 1e9:.2f} GB")


if __name__ == "__main__":
    main()
