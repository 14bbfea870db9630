"""Speed of `compare`: `python -m tests.studies.comparison.benchmark`.

Processor seconds of each stage of a comparison of the five mechanisms, on simulated flights of 1,081 samples (or
`--samples`, over the same seconds) or on the records that are named; the least of several runs, after a first one that
loads and compiles nothing more. `--memory`: the most that a comparison holds at once, in kB a sample, and its processor
seconds, instead. Above 20,001 samples the motion is interpolated between as many that were integrated.
"""

from __future__ import annotations

import argparse
import time
import tracemalloc
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from brv_hypo.comparison.compare import compare
from brv_hypo.comparison.config import CompareConfig
from brv_hypo.flight import load_flight
from brv_hypo.flight.record import Flight
from brv_hypo.simulation import load_config, simulate
from brv_hypo.simulation.config import InstrumentsConfig

MECHANISMS = ("damping", "inplane", "bodyfixed", "lag", "sticking")
PLANTED = ("none", "damping", "bodyfixed", "sticking")
SAMPLES = 1081  # 5.4 s at 200 Hz
INTEGRATED = 20_001  # samples at most: an integration takes a millisecond a step
SENSORS = {
    "gyro": ("p", "q", "r"),
    "accelerometer": ("ax", "ay", "az"),
    "velocity": ("velocity",),
    "dynamic_pressure": ("dynamic_pressure",),
    "altitude": ("altitude",),
}
# First words of what `compare` says as a stage begins, and the stage; what it says within one counts to that.
STAGES = {
    "trying": "trial",
    "reconstructing": "reconstruct",
    "linearising what": "prepare",
    "searching": "search",
    "linearising about": "relinearise",
    "predicting": "judge",
    "maximum likelihood": "likelihood",
}
COLUMNS = ("trial", "reconstruct", "prepare", "search", "relinearise", "judge", "likelihood", "whole")


class _Stages:
    """Processor seconds by stage, as a callback for the progress of `compare`."""

    def __init__(self) -> None:
        self.seconds = dict.fromkeys(COLUMNS, 0.0)
        self._began = self._since = time.process_time()
        self._stage = COLUMNS[0]

    def __call__(self, fraction: float | None, message: str) -> None:
        now = time.process_time()
        self.seconds[self._stage] += now - self._since
        self.seconds["whole"] = now - self._began
        self._since = now
        self._stage = next((stage for words, stage in STAGES.items() if message.startswith(words)), self._stage)


def stages(flight: Flight, config: CompareConfig, repeats: int) -> dict[str, float]:
    """Processor seconds of each stage: those of the quickest of `repeats` runs, after one that is not counted."""
    runs = []
    for _ in range(repeats + 1):
        timed = _Stages()
        compare([flight], config, progress=timed)
        timed(None, "")
        runs.append(timed.seconds)
    return min(runs[1:], key=lambda seconds: seconds["whole"])


def memory(flight: Flight, config: CompareConfig) -> tuple[float, float]:
    """The most that a comparison holds at once beside the flight, kB a sample, and processor seconds with its watch."""
    began = time.process_time()
    tracemalloc.start()
    compare([flight], config)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    return peak / 1e3 / flight.samples, time.process_time() - began


def flights(paths: Sequence[str], samples: int = SAMPLES, planted: Sequence[str] = PLANTED) -> Mapping[str, Flight]:
    """The records that are named, or simulated ones of the research cone, by name."""
    if paths:
        return {path: load_flight(path) for path in paths}
    usual = load_config("research_cone")
    rate = (min(samples, INTEGRATED) - 1) / usual.duration
    config = usual.model_copy(update={"sample_rate": rate, "step": min(usual.step, 1.0 / rate)})
    if samples > INTEGRATED:
        config = config.model_copy(update={"instruments": _silent(config.instruments)})
    return {
        name: finer(simulate(config, seed=1, plant=() if name == "none" else (name,)).flight, samples)
        for name in planted
    }


def _silent(instruments: InstrumentsConfig) -> InstrumentsConfig:
    quiet = {name: getattr(instruments, name).model_copy(update={"noise": 0.0}) for name in SENSORS}
    return instruments.model_copy(update=quiet)


def finer(flight: Flight, samples: int) -> Flight:
    """The flight with that many samples, interpolated by cubic splines, under the research cone's noise."""
    if samples <= flight.samples:
        return flight
    usual, rng = load_config("research_cone").instruments, np.random.default_rng(1)
    time = np.linspace(flight.time[0], flight.time[-1], samples)
    channels: dict[str, Any] = {}
    for name, values in flight.columns().items():
        sensor = next((sensor for sensor, own in SENSORS.items() if name in own), None)
        noise = 0.0 if sensor is None else getattr(usual, sensor).noise
        channels[name] = CubicSpline(flight.time, values)(time) + noise * rng.standard_normal(samples)
    return replace(flight, segments=((0, samples),), wind=None, **{**channels, "time": time})


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m tests.studies.comparison.benchmark", description=__doc__)
    parser.add_argument("flights", nargs="*", help="records to compare instead of simulated ones")
    parser.add_argument("--repeats", type=int, default=3, help="comparisons of each flight")
    parser.add_argument("--likelihood", choices=("none", "quick", "full"), default="none")
    parser.add_argument("--samples", type=int, default=SAMPLES, help="of each simulated flight")
    parser.add_argument("--planted", nargs="+", choices=PLANTED, default=PLANTED, help="what is simulated")
    parser.add_argument("--memory", action="store_true", help="memory instead of time")
    given = parser.parse_args(arguments)
    config = CompareConfig(mechanisms=MECHANISMS, maximum_likelihood=given.likelihood)
    heads = ("kB a sample", "watched, s") if given.memory else COLUMNS
    print(f"{'flight':24}{'samples':>8}" + "".join(f"{head:>13}" for head in heads))
    for name, flight in flights(given.flights, given.samples, given.planted).items():
        if given.memory:
            kilobytes, spent = memory(flight, config)
            print(f"{name[-24:]:24}{flight.samples:8}{kilobytes:13.2f}{spent:13.1f}")
            continue
        seconds = stages(flight, config, given.repeats)
        print(f"{name[-24:]:24}{flight.samples:8}" + "".join(f"{seconds[column]:13.3f}" for column in COLUMNS))


if __name__ == "__main__":
    main()
