"""How often the trial of the record names a fault, and how often it cries wolf.

`python -m tests.studies.record_faults --seed N --flights K` flies three vehicles, each without and with every planted
mechanism, K times with instruments of one grade after the other, and tries each record as it is and with one fault at
a time.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence

import numpy as np

from brv_hypo.errors import FlightRecordError
from brv_hypo.flight.clock import sigma_of_differences
from brv_hypo.flight.format import assemble
from brv_hypo.flight.record import Record, RecordFault
from brv_hypo.flight.tolerances import GRADES
from brv_hypo.motion import try_record
from brv_hypo.simulation import SimulationConfig, load_config, simulate
from brv_hypo.study.config import planted_faults
from tests.varied import varied

VEHICLES = ("research_cone", "blunt_capsule", "sounding_rocket")
PLANTED: tuple[tuple[str, ...], ...] = ((), ("lag",), ("bodyfixed",), ("sticking",), ("damping",), ("inplane",))
ALPHA, ROLL_RATE, GYRO_NOISE = (0.4, 1.5), (0.5, 1.6), (0.5, 5.0)
"""Factors on the configuration's start and noise, drawn evenly in the logarithm."""
SIGNAL_OVER_NOISE = 5.0


def records(seed: int, flights: int) -> Iterator[Record]:
    """Sound records: every vehicle with every planted mechanism, `flights` times, errors of each grade in turn."""
    for place, vehicle in enumerate(VEHICLES):
        config = load_config(vehicle)
        for number, planted in enumerate(PLANTED):
            random = np.random.default_rng([seed, place, number])
            for flight in range(flights):
                grade = GRADES[(place + number + flight) % len(GRADES)]
                graded = {"grade": grade, "tolerances": {}, "draw": 1.0}
                instruments = config.instruments.model_copy(update=graded)
                stated = config.model_copy(update={"instruments": instruments})
                seed = int(random.integers(2**31))
                yield simulate(varied(stated, _start(config, random)), seed=seed, plant=planted).record


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m tests.studies.record_faults", description=__doc__)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--flights", type=int, default=1, help="of each vehicle and mechanism (18 in all)")
    options = parser.parse_args(arguments)
    named: dict[str, list[bool]] = {}
    alarms = []
    for number, record in enumerate(records(options.seed, options.flights)):
        sound = _faults_of(record)
        alarms.append(bool(sound))
        for fault in planted_faults().values():
            if shows(record, fault.channels):
                random = np.random.default_rng([options.seed, number])
                found = _faults_of(fault.corrupt(record, random))
                named.setdefault(fault.name, []).append(fault.named_by(found))
    print(f"sound records: {len(alarms)}, false alarms {sum(alarms)} ({100.0 * np.mean(alarms):.1f} %)")
    print(f"{'fault':40s} {'records':>7s} {'named':>7s}")
    for name, right in named.items():
        print(f"{name:40s} {len(right):7d} {100.0 * np.mean(right):6.0f} %")
    everything = [right for one in named.values() for right in one]
    print(f"{'all':40s} {len(everything):7d} {100.0 * np.mean(everything):6.1f} %")


def _faults_of(record: Record) -> Sequence[RecordFault]:
    try:
        return try_record(assemble(record))[1].faults
    except FlightRecordError:
        return ()


def shows(record: Record, channels: Sequence[str]) -> bool:
    """Whether the signal of each channel exceeds its noise and an industrial bias."""
    bias = {"p": 0.0035, "q": 0.0035, "r": 0.0035, "ax": 0.05, "ay": 0.05, "az": 0.05}
    return all(
        float(np.std(record.channels[name]) + (name == "p") * abs(np.mean(record.channels[name])))
        > SIGNAL_OVER_NOISE * sigma_of_differences([record.channels[name]]) + bias.get(name, 0.0)
        for name in channels
        if name in bias
    )


def _start(config: SimulationConfig, random: np.random.Generator) -> dict[str, float]:
    """Start and noise of one flight, as factors on the configuration's own."""

    def factor(span: tuple[float, float]) -> float:
        return float(np.exp(random.uniform(np.log(span[0]), np.log(span[1]))))

    return {
        "start.alpha": config.start.alpha * factor(ALPHA),
        "start.roll_rate": config.start.roll_rate * factor(ROLL_RATE),
        "start.windward_meridian": float(random.uniform(-np.pi, np.pi)),
        "instruments.gyro.noise": config.instruments.gyro.noise * factor(GYRO_NOISE),
    }


if __name__ == "__main__":
    main()
