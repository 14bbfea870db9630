"""Faults injected in sound records, for studies: each with the kind and the channels that a report has to name.

`planted_faults` lists them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.flight.noise import sigma_of_differences
from brv_hypo.flight.record import ACCELEROMETERS, GYROS, INERTIAL_CHANNELS, Record, RecordFault
from brv_hypo.ranking.result import RecordFaultSummary

STUCK_SECONDS, CLOCK_STEP_SECONDS, CLIPPED_AT, SPIKE_SHARE, PLANTED_SPIKE_SIGMAS = 0.2, 0.1, 0.8, 0.01, 30.0
DEGREES, GRAVITY, FEET, PSF = 180.0 / np.pi, 9.80665, 0.3048, 47.88026

Corruption = Callable[[Record, np.random.Generator], Record]


@dataclass(frozen=True)
class PlantedFault:
    """`corrupt` makes the faulty record; a report has to name the `channels` and the `kind`."""

    name: str
    channels: tuple[str, ...]
    kind: str
    corrupt: Corruption

    def named_by(self, faults: Iterable[RecordFault | RecordFaultSummary]) -> bool:
        """Whether any of `faults` names the channels, all and no others, and the kind."""
        return any(
            fault.fault == self.kind and set(fault.channel.split(", ")) == set(self.channels) for fault in faults
        )


@cache
def planted_faults() -> tuple[PlantedFault, ...]:
    """Every fault of the study."""
    found = [PlantedFault(f"sign of {n}", (n,), "sign", _scaled((n,), -1.0)) for n in INERTIAL_CHANNELS]
    found += [
        PlantedFault(f"{a} and {b} exchanged", (a, b), "axes", _swapped(a, b)) for a, b in (("q", "r"), ("ay", "az"))
    ]
    for names, factor, large, small in (
        (GYROS, DEGREES, "deg/s tagged rad/s", "rad/s tagged deg/s"),
        (ACCELEROMETERS, GRAVITY, "m/s^2 tagged g", "g tagged m/s^2"),
    ):
        for chosen in (*((name,) for name in names), names):
            for value, label in ((factor, large), (1.0 / factor, small)):
                name = f"{label}: {', '.join(chosen)}"
                found.append(PlantedFault(name, chosen, "units", _scaled(chosen, value)))
    for channel, factor, label in (
        ("velocity", 1.0 / FEET, "ft/s tagged m/s"),
        ("dynamic_pressure", 1.0 / PSF, "psf tagged Pa"),
    ):
        found.append(PlantedFault(f"{label}: {channel}", (channel,), "units", _scaled((channel,), factor)))
    return (
        *found,
        PlantedFault("q stuck", ("q",), "stuck", _changed("q", _stuck)),
        PlantedFault("ay clipped", ("ay",), "clipped", _changed("ay", _clipped)),
        PlantedFault("az clipped", ("az",), "clipped", _changed("az", _clipped)),
        PlantedFault("clock step", ("time",), "clock step", _clock_step),
        PlantedFault("samples lost without stamps", ("time",), "clock step", _lost),
        PlantedFault("1 % spikes in q", ("q",), "spikes", _changed("q", _spikes)),
        PlantedFault("burst in ay", ("ay",), "spikes", _changed("ay", _burst)),
        PlantedFault("r dead", ("r",), "dead", _scaled(("r",), 0.0)),
        PlantedFault("az dead", ("az",), "dead", _scaled(("az",), 0.0)),
    )


def fault_called(name: str) -> PlantedFault:
    """The fault of that name."""
    return next(fault for fault in planted_faults() if fault.name == name)


# ---- Faults of whole channels ----


def _scaled(names: Sequence[str], factor: float) -> Corruption:
    return lambda record, _: _with(record, {name: factor * record.channels[name] for name in names})


def _swapped(one: str, other: str) -> Corruption:
    return lambda record, _: _with(record, {one: record.channels[other], other: record.channels[one]})


def _with(record: Record, changes: dict[str, FloatArray]) -> Record:
    return record.model_copy(update={"channels": {**record.channels, **changes}})


# ---- Faults of the values of one channel ----


def _changed(name: str, change: Callable[[FloatArray, Record, np.random.Generator], None]) -> Corruption:
    """`change` writes the fault into a copy of the channel's values."""

    def corrupt(record: Record, random: np.random.Generator) -> Record:
        values = record.channels[name].copy()
        change(values, record, random)
        return _with(record, {name: values})

    return corrupt


def _stuck(values: FloatArray, record: Record, random: np.random.Generator) -> None:
    at = _middle(record, random)
    values[at : at + _samples(record, STUCK_SECONDS)] = values[at]


def _clipped(values: FloatArray, record: Record, random: np.random.Generator) -> None:
    limit = CLIPPED_AT * float(np.max(np.abs(values)))
    np.clip(values, -limit, limit, out=values)


def _spikes(values: FloatArray, record: Record, random: np.random.Generator) -> None:
    count = max(1, round(SPIKE_SHARE * values.size))
    at = random.choice(values.size, size=count, replace=False)
    sigma = sigma_of_differences([values])
    values[at] += PLANTED_SPIKE_SIGMAS * sigma * random.choice([-1.0, 1.0], size=count)


def _burst(values: FloatArray, record: Record, random: np.random.Generator) -> None:
    at = _middle(record, random)
    values[at : at + int(random.integers(3, 20))] += PLANTED_SPIKE_SIGMAS * sigma_of_differences([values])


# ---- Faults of the clock ----


def _clock_step(record: Record, random: np.random.Generator) -> Record:
    time, at = record.time.copy(), _middle(record, random)
    time[at:] += CLOCK_STEP_SECONDS
    return record.model_copy(update={"time": time})


def _lost(record: Record, random: np.random.Generator) -> Record:
    at, count = _middle(record, random), _samples(record, CLOCK_STEP_SECONDS)
    kept = np.delete(np.arange(record.time.size), np.arange(at, at + count))
    channels = {name: values[kept] for name, values in record.channels.items()}
    return record.model_copy(update={"time": record.time[: kept.size], "channels": channels})


def _middle(record: Record, random: np.random.Generator) -> int:
    """A sample away from the ends."""
    return int(random.integers(record.time.size // 5, 4 * record.time.size // 5))


def _samples(record: Record, seconds: float) -> int:
    return max(1, round(seconds / float(np.median(np.diff(record.time)))))
