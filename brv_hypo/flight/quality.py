"""What a record holds and how good it is: `inspect_flight`, for `brv-hypo inspect`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.constants import (
    INSPECTED_AGREES,
    INSPECTED_FEWEST_SAMPLES,
    INSPECTED_LEVEL,
    INSPECTED_PER_CYCLE,
)
from brv_hypo.flight.assemble import assemble, unassemble
from brv_hypo.flight.noise import sigma_of_differences
from brv_hypo.flight.phases import Phase, find_phases
from brv_hypo.flight.record import CHANNELS, INERTIAL_CHANNELS, OPTIONAL_CHANNELS, Flight, Vehicle
from brv_hypo.flight.resample import runs, strongest_frequency
from brv_hypo.flight.schema import CHANNEL_DIMENSIONS, Record
from brv_hypo.flight.spikes import find_spikes, without_spikes
from brv_hypo.flight.store import read_record, windowed
from brv_hypo.flight.units import SI


@dataclass(frozen=True)
class Noise:
    """White-noise standard deviation `sigma`, in the units of the values.

    `trusted` is False where motion, coloured or quantised noise, or too few samples spoil the estimate, which
    is then no more than a guide.
    """

    sigma: float
    trusted: bool


@dataclass(frozen=True)
class ChannelQuality:
    """One channel: `units` as recorded; range and `noise` in SI; `missing` and `longest_gap` in samples."""

    name: str
    units: str
    si_units: str
    derived: bool
    missing: int
    longest_gap: int
    spikes: int
    minimum: float
    maximum: float
    noise: Noise


@dataclass(frozen=True)
class Inspection:
    """A record at a glance. Times in s, rates in Hz, dynamic pressure in Pa.

    `segments` are the stretches that can be analysed. `transverse_frequency` is the dominant frequency of q
    and r over the longest of them (0 where they do not vary). `phases` are those of a
    rocket's flight. `notes` say what reading changed or derived; `warnings` what limits the use of the record.
    """

    path: str
    title: str
    source: str
    planet: str
    samples: int
    start: float
    stop: float
    sample_rate: float
    channels: tuple[ChannelQuality, ...]
    absent: tuple[str, ...]
    segments: tuple[tuple[float, float], ...]
    dynamic_pressure_range: tuple[float, float]
    transverse_frequency: float
    samples_per_cycle: float
    vehicle: Vehicle
    phases: tuple[Phase, ...]
    notes: tuple[str, ...]
    warnings: tuple[str, ...]


def inspect_flight(
    flight: Flight | str | Path, *, start: float | None = None, stop: float | None = None
) -> Inspection:
    """Inspect a format 1 file, as recorded, or a flight in memory; from `start` to `stop` in s.

    Raises FlightRecordError where the record cannot be used at all, UsageError for a window without samples.
    """
    record = unassemble(flight) if isinstance(flight, Flight) else read_record(flight)
    whole = flight if isinstance(flight, Flight) else assemble(record)
    return _inspection(_part(record, start, stop), windowed(whole, start, stop))


def _part(record: Record, start: float | None, stop: float | None) -> Record:
    """The samples of a record from `start` to `stop`."""
    first = np.searchsorted(record.time, -np.inf if start is None else start, side="left")
    last = np.searchsorted(record.time, np.inf if stop is None else stop, side="right")
    channels = {name: values[first:last] for name, values in record.channels.items()}
    return record.model_copy(update={"time": record.time[first:last], "channels": channels})


def _inspection(record: Record, ready: Flight) -> Inspection:
    """What was recorded, beside what is `ready` to be analysed."""
    frequency = strongest_frequency(ready.q, ready.r, ready.step, ready.segments)
    channels = tuple(_channels(record, ready))
    phases = find_phases(ready.time, ready.ax, ready.ay, ready.az)
    per_cycle = ready.sample_rate / frequency if frequency > 0.0 else float("inf")
    pressure = np.concatenate([ready.dynamic_pressure[a:b] for a, b in ready.segments])
    return Inspection(
        path=record.path,
        title=record.title,
        source=record.source,
        planet=record.planet,
        samples=int(record.time.size),
        start=float(record.time[0]),
        stop=float(record.time[-1]),
        sample_rate=ready.sample_rate,
        channels=channels,
        absent=tuple(name for name in OPTIONAL_CHANNELS if getattr(ready, name) is None),
        segments=tuple((float(ready.time[a]), float(ready.time[b - 1])) for a, b in ready.segments),
        dynamic_pressure_range=(float(pressure.min()), float(pressure.max())),
        transverse_frequency=frequency,
        samples_per_cycle=per_cycle,
        vehicle=ready.vehicle,
        phases=phases,
        notes=ready.notes,
        warnings=(*_warnings(channels, per_cycle), *_of_phases(phases)),
    )


def white_noise(values: FloatArray) -> Noise:
    """White-noise sigma of `values` (n,), NaN where missing, from their differences of high order.

    It is trusted where the periodogram of the longest run is level (within 1.5) over the upper half of the
    band, and at that sigma (within 1.25). Spikes spoil the periodogram: take them out first.
    """
    sigma = sigma_of_differences([values])
    if np.isnan(sigma):
        return Noise(sigma, trusted=False)
    start, stop = max(runs(np.isfinite(values)), key=lambda run: run[1] - run[0])
    levels = _upper_band(values[start:stop])
    level = float(np.median(levels))
    agrees = 0.0 < sigma <= INSPECTED_AGREES * level and level <= INSPECTED_AGREES * sigma
    return Noise(sigma, trusted=agrees and bool(levels.max() <= INSPECTED_LEVEL * levels.min()))


def _upper_band(values: FloatArray) -> FloatArray:
    """White-noise sigma (4,) that each quarter of the upper half of the band would have; Hann window."""
    if values.size < INSPECTED_FEWEST_SAMPLES:
        return np.zeros(4)
    window = np.hanning(values.size)
    power = np.abs(np.fft.rfft((values - np.mean(values)) * window)) ** 2 / np.sum(window**2)
    quarters = np.array_split(power[power.size // 2 : -1], 4)
    return np.sqrt([float(np.mean(quarter)) for quarter in quarters])


def _channels(record: Record, ready: Flight) -> list[ChannelQuality]:
    """Recorded channels as they were recorded, derived ones as they were derived."""
    found = []
    for name in (*CHANNELS, *OPTIONAL_CHANNELS):
        if name in record.channels:
            units = record.recorded_units.get(name, SI[CHANNEL_DIMENSIONS[name]])
            found.append(_channel(name, record.time, record.channels[name], units, derived=False))
        elif (values := getattr(ready, name)) is not None:
            found.append(_channel(name, ready.time, values, SI[CHANNEL_DIMENSIONS[name]], derived=True))
    return found


def _channel(name: str, time: FloatArray, values: FloatArray, units: str, *, derived: bool) -> ChannelQuality:
    missing = np.isnan(values)
    known = values[~missing]
    spikes = find_spikes(values)
    return ChannelQuality(
        name=name,
        units=units,
        si_units=SI[CHANNEL_DIMENSIONS[name]],
        derived=derived,
        missing=int(np.count_nonzero(missing)),
        longest_gap=max((stop - start for start, stop in runs(missing)), default=0),
        spikes=int(np.count_nonzero(spikes)),
        minimum=float(known.min()) if known.size else float("nan"),
        maximum=float(known.max()) if known.size else float("nan"),
        noise=white_noise(without_spikes(time, values, spikes)),
    )


def _warnings(channels: tuple[ChannelQuality, ...], per_cycle: float) -> list[str]:
    warnings = []
    if per_cycle < INSPECTED_PER_CYCLE:
        warnings.append(
            f"only {per_cycle:.1f} samples a cycle of the transverse motion: rates can hardly be "
            "differentiated, and delays shorter than a sample cannot be told"
        )
    doubtful = [one.name for one in channels if one.name in INERTIAL_CHANNELS and not one.noise.trusted]
    if doubtful:
        warnings.append(
            f"the noise of {', '.join(doubtful)} is not white, or is hidden by motion or rounding: its sigma "
            "is no more than a guide"
        )
    return warnings


def _of_phases(phases: tuple[Phase, ...]) -> list[str]:
    """What of the record no model of the moments covers, and the window that leaves it out."""
    coast = next((phase for phase in phases if phase.name == "coast"), None)
    beside = [phase for phase in phases if phase.name != "coast"]
    if not beside:
        return []
    told = ", ".join(f"{phase.name} {phase.start_s:.2f} to {phase.stop_s:.2f} s" for phase in beside)
    window = "" if coast is None else f": analyse the coast, --start {coast.start_s:.2f} --stop {coast.stop_s:.2f}"
    return [f"the record holds {told}, where thrust, rest or a parachute act, which no mechanism describes{window}"]
