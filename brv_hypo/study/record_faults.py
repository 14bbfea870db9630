"""How often the trial of the record names a fault, and how often it cries wolf.

`python -m brv_hypo.study.record_faults --seed N --flights K` flies three vehicles, each without and with every planted
mechanism, K times with instruments of every grade, and tries each record as it is and with one fault at a time.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.errors import FlightRecordError
from brv_hypo.flight.assemble import assemble
from brv_hypo.flight.faults import RecordFault
from brv_hypo.flight.noise import sigma_of_differences
from brv_hypo.flight.schema import Record
from brv_hypo.motion import try_record
from brv_hypo.simulation import SimulationConfig, load_config, simulate_batch

VEHICLES = ("research_cone", "blunt_capsule", "sounding_rocket")
PLANTED: tuple[tuple[str, ...], ...] = (
    (),
    ("lag",),
    ("bodyfixed",),
    ("sticking",),
    ("damping",),
    ("inplane",),
)
# 1-sigma tolerances of laboratory, tactical and industrial instruments, by their path in a configuration.
TOLERANCES = {
    "gyro.bias": tuple(np.radians((0.002, 0.02, 0.2))),
    "gyro.scale": (1e-4, 5e-4, 3e-3),
    "gyro.misalignment": (1e-4, 5e-4, 3e-3),
    "accelerometer.bias": (0.001, 0.01, 0.05),
    "accelerometer.scale": (1e-4, 1e-3, 5e-3),
    "accelerometer.misalignment": (1e-4, 5e-4, 3e-3),
}
TIME_SKEW = (5e-5, 5e-4, 2e-3)
DYNAMIC_PRESSURE_SCALE = (1e-3, 5e-3, 2e-2)
ALPHA, ROLL_RATE, GYRO_NOISE = (0.4, 1.5), (0.5, 1.6), (0.5, 5.0)
"""Factors on the configuration's start and noise, drawn evenly in the logarithm."""
SIGNAL_OVER_NOISE = 5.0
STUCK_SECONDS, CLOCK_STEP_SECONDS, CLIPPED_AT, SPIKE_SHARE, SPIKE_SIGMAS = 0.2, 0.1, 0.8, 0.01, 30.0

Channels = Mapping[str, FloatArray]
DEGREES, GRAVITY, FEET, PSF = 180.0 / np.pi, 9.80665, 0.3048, 47.88026


@dataclass(frozen=True)
class PlantedFault:
    """`spoil` makes the faulty record; `channels` must be named, and `kind` be the fault's."""

    name: str
    channels: tuple[str, ...]
    kinds: tuple[str, ...]
    spoil: Callable[[Record, np.random.Generator], Record]

    def named_by(self, faults: Sequence[RecordFault]) -> bool:
        """Whether any of `faults` names the channels, all and no others, and the kind."""
        return any(
            fault.fault in self.kinds and set(fault.channel.split(", ")) == set(self.channels)
            for fault in faults
        )


def planted_faults() -> tuple[PlantedFault, ...]:
    """Every fault of the study."""
    gyros, forces = ("p", "q", "r"), ("ax", "ay", "az")
    found = [PlantedFault(f"sign of {n}", (n,), ("sign",), _scaled((n,), -1.0)) for n in (*gyros, *forces)]
    found += [
        PlantedFault(f"{a} and {b} exchanged", (a, b), ("axes",), _swapped(a, b))
        for a, b in (("q", "r"), ("ay", "az"))
    ]
    for names, factor, large, small in (
        (gyros, DEGREES, "deg/s tagged rad/s", "rad/s tagged deg/s"),
        (forces, GRAVITY, "m/s^2 tagged g", "g tagged m/s^2"),
    ):
        for chosen in (*((name,) for name in names), names):
            for value, told in ((factor, large), (1.0 / factor, small)):
                name = f"{told}: {', '.join(chosen)}"
                found.append(PlantedFault(name, chosen, ("units",), _scaled(chosen, value)))
    found += [
        PlantedFault(
            "ft/s tagged m/s: velocity", ("velocity",), ("units",), _scaled(("velocity",), 1.0 / FEET)
        ),
        PlantedFault(
            "psf tagged Pa: dynamic_pressure",
            ("dynamic_pressure",),
            ("units",),
            _scaled(("dynamic_pressure",), 1.0 / PSF),
        ),
        PlantedFault("q stuck", ("q",), ("stuck",), _stuck),
        PlantedFault("ay clipped", ("ay",), ("clipped",), _clipped("ay")),
        PlantedFault("az clipped", ("az",), ("clipped",), _clipped("az")),
        PlantedFault("clock step", ("time",), ("clock step",), _clock_step),
        PlantedFault("samples lost without stamps", ("time",), ("clock step",), _lost),
        PlantedFault("1 % spikes in q", ("q",), ("spikes",), _spikes),
        PlantedFault("burst in ay", ("ay",), ("spikes",), _burst),
        PlantedFault("r dead", ("r",), ("dead",), _scaled(("r",), 0.0)),
        PlantedFault("az dead", ("az",), ("dead",), _scaled(("az",), 0.0)),
    ]
    return tuple(found)


def records(seed: int, flights: int) -> Iterator[Record]:
    """Sound records: every vehicle with every planted mechanism, `flights` times."""
    for place, vehicle in enumerate(VEHICLES):
        config = load_config(vehicle)
        for number, planted in enumerate(PLANTED):
            random = np.random.default_rng([seed, place, number])
            seeds = [int(one) for one in random.integers(2**31, size=flights)]
            drawn = simulate_batch(
                config, seeds=seeds, plant=planted, variations=_instruments(config, flights, random)
            )
            yield from (one.record for one in drawn)


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m brv_hypo.study.record_faults", description=__doc__)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--flights", type=int, default=1, help="of each vehicle and mechanism (18 in all)")
    options = parser.parse_args(arguments)
    named: dict[str, list[bool]] = {}
    alarms = []
    for number, record in enumerate(records(options.seed, options.flights)):
        sound = _faults_of(record)
        alarms.append(bool(sound))
        for fault in planted_faults():
            if _shows(record, fault.channels):
                random = np.random.default_rng([options.seed, number])
                found = _faults_of(fault.spoil(record, random))
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


def _shows(record: Record, channels: Sequence[str]) -> bool:
    """Whether the signal of each channel stands out of its noise and of an industrial bias."""
    bias = {"p": 0.0035, "q": 0.0035, "r": 0.0035, "ax": 0.05, "ay": 0.05, "az": 0.05}
    return all(
        float(np.std(record.channels[name]) + (name == "p") * abs(np.mean(record.channels[name])))
        > SIGNAL_OVER_NOISE * sigma_of_differences([record.channels[name]]) + bias.get(name, 0.0)
        for name in channels
        if name in bias
    )


def _instruments(
    config: SimulationConfig, flights: int, random: np.random.Generator
) -> dict[str, FloatArray]:
    grade = np.arange(flights) % 3 if flights > 1 else random.integers(3, size=1)
    drawn: dict[str, FloatArray] = {}
    for path, tolerance in TOLERANCES.items():
        for axis in range(3):
            sizes = np.array(tolerance)[grade]
            drawn[f"instruments.{path}.{axis}"] = sizes * random.standard_normal(flights)
    drawn["instruments.accelerometer.delay"] = np.array(TIME_SKEW)[grade] * np.abs(
        random.standard_normal(flights)
    )
    drawn["instruments.dynamic_pressure.scale"] = np.array(DYNAMIC_PRESSURE_SCALE)[
        grade
    ] * random.standard_normal(flights)

    def factor(span: tuple[float, float]) -> FloatArray:
        return np.asarray(np.exp(random.uniform(np.log(span[0]), np.log(span[1]), size=flights)))

    drawn["start.alpha"] = config.start.alpha * factor(ALPHA)
    drawn["start.roll_rate"] = config.start.roll_rate * factor(ROLL_RATE)
    drawn["start.windward_meridian"] = random.uniform(-np.pi, np.pi, size=flights)
    drawn["instruments.gyro.noise"] = config.instruments.gyro.noise * factor(GYRO_NOISE)
    return drawn


def _changed(record: Record, changes: Channels) -> Record:
    return record.model_copy(update={"channels": {**record.channels, **changes}})


def _scaled(names: Sequence[str], factor: float) -> Callable[[Record, np.random.Generator], Record]:
    return lambda record, _: _changed(record, {name: factor * record.channels[name] for name in names})


def _swapped(one: str, other: str) -> Callable[[Record, np.random.Generator], Record]:
    return lambda record, _: _changed(record, {one: record.channels[other], other: record.channels[one]})


def _middle(record: Record, random: np.random.Generator) -> int:
    """A sample away from the ends."""
    return int(random.integers(record.time.size // 5, 4 * record.time.size // 5))


def _samples(record: Record, seconds: float) -> int:
    return max(1, round(seconds / float(np.median(np.diff(record.time)))))


def _stuck(record: Record, random: np.random.Generator) -> Record:
    values, at = record.channels["q"].copy(), _middle(record, random)
    values[at : at + _samples(record, STUCK_SECONDS)] = values[at]
    return _changed(record, {"q": values})


def _clipped(name: str) -> Callable[[Record, np.random.Generator], Record]:
    def spoil(record: Record, _: np.random.Generator) -> Record:
        values = record.channels[name]
        limit = CLIPPED_AT * float(np.max(np.abs(values)))
        return _changed(record, {name: np.clip(values, -limit, limit)})

    return spoil


def _clock_step(record: Record, random: np.random.Generator) -> Record:
    time, at = record.time.copy(), _middle(record, random)
    time[at:] += CLOCK_STEP_SECONDS
    return record.model_copy(update={"time": time})


def _lost(record: Record, random: np.random.Generator) -> Record:
    at, count = _middle(record, random), _samples(record, CLOCK_STEP_SECONDS)
    kept = np.delete(np.arange(record.time.size), np.arange(at, at + count))
    channels = {name: values[kept] for name, values in record.channels.items()}
    return record.model_copy(update={"time": record.time[: kept.size], "channels": channels})


def _spikes(record: Record, random: np.random.Generator) -> Record:
    values = record.channels["q"].copy()
    count = max(1, round(SPIKE_SHARE * values.size))
    at = random.choice(values.size, size=count, replace=False)
    sigma = sigma_of_differences([values])
    values[at] += SPIKE_SIGMAS * sigma * random.choice([-1.0, 1.0], size=count)
    return _changed(record, {"q": values})


def _burst(record: Record, random: np.random.Generator) -> Record:
    values, at = record.channels["ay"].copy(), _middle(record, random)
    values[at : at + int(random.integers(3, 20))] += SPIKE_SIGMAS * sigma_of_differences([values])
    return _changed(record, {"ay": values})


if __name__ == "__main__":
    main()
