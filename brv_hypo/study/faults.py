"""Faults that a record may have, planted in sound ones: for studies, and for counting what the trial names."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Protocol

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.flight.noise import sigma_of_differences
from brv_hypo.flight.record import ACCELEROMETERS, GYROS, INERTIAL_CHANNELS, Record

STUCK_SECONDS, CLOCK_STEP_SECONDS, CLIPPED_AT, SPIKE_SHARE, PLANTED_SPIKE_SIGMAS = 0.2, 0.1, 0.8, 0.01, 30.0

Channels = Mapping[str, FloatArray]
DEGREES, GRAVITY, FEET, PSF = 180.0 / np.pi, 9.80665, 0.3048, 47.88026


class Named(Protocol):
    """A fault as a trial, or a comparison, names it."""

    @property
    def channel(self) -> str:
        """The channel; several joined by commas."""

    @property
    def fault(self) -> str:
        """The kind."""


@dataclass(frozen=True)
class PlantedFault:
    """`corrupt` makes the faulty record; `channels` must be named, and `kind` be the fault's."""

    name: str
    channels: tuple[str, ...]
    kinds: tuple[str, ...]
    corrupt: Callable[[Record, np.random.Generator], Record]

    def named_by(self, faults: Iterable[Named]) -> bool:
        """Whether any of `faults` names the channels, all and no others, and the kind."""
        return any(
            fault.fault in self.kinds and set(fault.channel.split(", ")) == set(self.channels)
            for fault in faults
        )


@cache
def planted_faults() -> tuple[PlantedFault, ...]:
    """Every fault of the study."""
    found = [PlantedFault(f"sign of {n}", (n,), ("sign",), _scaled((n,), -1.0)) for n in INERTIAL_CHANNELS]
    found += [
        PlantedFault(f"{a} and {b} exchanged", (a, b), ("axes",), _swapped(a, b))
        for a, b in (("q", "r"), ("ay", "az"))
    ]
    for names, factor, large, small in (
        (GYROS, DEGREES, "deg/s tagged rad/s", "rad/s tagged deg/s"),
        (ACCELEROMETERS, GRAVITY, "m/s^2 tagged g", "g tagged m/s^2"),
    ):
        for chosen in (*((name,) for name in names), names):
            for value, label in ((factor, large), (1.0 / factor, small)):
                name = f"{label}: {', '.join(chosen)}"
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


def fault_called(name: str) -> PlantedFault:
    """The fault of that name."""
    return next(fault for fault in planted_faults() if fault.name == name)


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
    def corrupt(record: Record, _: np.random.Generator) -> Record:
        values = record.channels[name]
        limit = CLIPPED_AT * float(np.max(np.abs(values)))
        return _changed(record, {name: np.clip(values, -limit, limit)})

    return corrupt


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
    values[at] += PLANTED_SPIKE_SIGMAS * sigma * random.choice([-1.0, 1.0], size=count)
    return _changed(record, {"q": values})


def _burst(record: Record, random: np.random.Generator) -> Record:
    values, at = record.channels["ay"].copy(), _middle(record, random)
    values[at : at + int(random.integers(3, 20))] += PLANTED_SPIKE_SIGMAS * sigma_of_differences([values])
    return _changed(record, {"ay": values})
