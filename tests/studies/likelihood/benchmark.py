"""Speed of `fit`: `python -m tests.studies.likelihood.benchmark`.

Each problem is fitted several times after a first fit that loads and compiles nothing more; the median wall
and processor times are shown. Start values are the truth off by a fifth, initial states free.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from brv_hypo.likelihood.fit import fit
from tests.studies.likelihood.problems import ModelProblem, lagging_body, short_period, spinning_body

_START = 0.8


@dataclass(frozen=True)
class Timing:
    """One problem: `wall` and `processor`, medians in s, best wall time, iterations, status."""

    name: str
    samples: int
    wall: float
    best: float
    processor: float
    iterations: int
    status: str
    target: float | None = None


def time_problem(name: str, problem: ModelProblem, samples: int, repeats: int, target: float | None = None) -> Timing:
    """Median time of fitting one simulated record of the problem."""
    segment = problem.simulate(samples, seed=0)
    start = problem.start(_START)
    wall, processor = [], []
    for _ in range(repeats + 1):
        began = time.perf_counter(), time.process_time()
        result = fit(problem.dynamics, problem.outputs, [segment], start, delays=problem.delays)
        wall.append(time.perf_counter() - began[0])
        processor.append(time.process_time() - began[1])
    return Timing(
        name=name,
        samples=samples,
        wall=float(np.median(wall[1:])),
        best=min(wall[1:]),
        processor=float(np.median(processor[1:])),
        iterations=result.iterations,
        status=result.status,
        target=target,
    )


def run(repeats: int = 9) -> list[Timing]:
    """All problems; the last four show how the time grows with the samples."""
    timings = [
        time_problem("short period, 2 states, 8 parameters", short_period(), 1252, repeats, target=0.1),
        time_problem("spinning body, 4 states, 10 parameters", spinning_body(), 1080, repeats, target=0.5),
        time_problem("late moment, 2 states, a delay of 10 samples", lagging_body(), 1080, repeats, target=0.5),
    ]
    for samples in (1000, 3000, 10_000, 30_000):
        fewer = max(1, repeats * 1000 // samples)
        timings.append(time_problem("spinning body, growth with samples", spinning_body(), samples, fewer))
    return timings


def growth_exponent(timings: Sequence[Timing]) -> float:
    """Slope of log processor time per iteration over log samples: 1 is linear."""
    samples = np.log([t.samples for t in timings])
    per_iteration = np.log([t.processor / (t.iterations + 1) for t in timings])
    return float(np.polyfit(samples, per_iteration, 1)[0])


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m tests.studies.likelihood.benchmark", description=__doc__)
    parser.add_argument("--repeats", type=int, default=9, help="fits of each problem")
    timings = run(parser.parse_args(arguments).repeats)
    print(f"{'problem':46}{'samples':>8}{'wall, s':>9}{'best, s':>9}{'cpu, s':>9}{'steps':>7}  status")
    for t in timings:
        times = "".join(f"{value:9.3f}" for value in (t.wall, t.best, t.processor))
        target = "" if t.target is None else f", target {t.target:g} s {'met' if t.wall < t.target else 'MISSED'}"
        print(f"{t.name:46}{t.samples:8}{times}{t.iterations:7}  {t.status}{target}")
    print(f"processor time per iteration grows as samples^{growth_exponent(timings[-4:]):.2f}")


if __name__ == "__main__":
    main()
