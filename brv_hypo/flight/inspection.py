"""What a record holds and how good it is: `inspect_flight`, for `brv-hypo inspect`; phases of a rocket's flight.

On the pad the axial accelerometer reads gravity; while the motor burns it reads much more; coasting, drag makes it read
less than nothing; a parachute jerks (`find_phases`). Thrust and a changing mass are in no model of the moments: of a
rocket's flight only the coast can be compared. A record of an entry has no phase but, at its end, the parachute. The
white noise of a channel is trusted where its spectrum is level over the upper half of the band.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from brv_hypo import thresholds as limits
from brv_hypo.arrays import FloatArray
from brv_hypo.flight.cleaning import find_holds, find_spikes, without_spikes
from brv_hypo.flight.clock import joined, runs, sigma_of_differences, strongest_frequency
from brv_hypo.flight.format import assemble, read_record, unassemble, windowed
from brv_hypo.flight.plausibility import GRAVITY, REST_OFF, THRUST
from brv_hypo.flight.record import CHANNEL_DIMENSIONS, CHANNELS, INERTIAL_CHANNELS, OPTIONAL_CHANNELS, Flight, Vehicle
from brv_hypo.flight.units import SI

PHASE_SMOOTHED = 0.1  # s: a median over this takes vibration and spikes out
PHASE_SHORTEST = 0.3  # s of a phase
PHASE_RESTING = 0.9  # share of the samples before ignition that have to read so for a pad
PHASE_BURNT_OUT = 0.0  # m/s^2 along the axis: drag alone is left
# A parachute pulls with so many times what was sensed in the seconds before it, and with so many gravities.
PARACHUTE_TIMES = 5.0
PARACHUTE_BEFORE = 2.0  # s
PARACHUTE_LEAST = 2.0  # gravities
# What `inspect` says of the noise: trusted where the upper half of the spectrum is level within the first factor, and
# at the estimate within the second; warnings below so many samples a cycle.
INSPECTED_LEVEL = 1.5
INSPECTED_AGREES = 1.25
INSPECTED_FEWEST_SAMPLES = 50  # of a periodogram
INSPECTED_PER_CYCLE = 10.0  # samples
# A record was low-passed whose noise, in the last of eight parts of the band above the motion, is less than this share
# of what is left there of any of the lower four if it falls with the square of the frequency: as rates where a moment
# jumps.
FILTERED_TO, FILTERED_PARTS = 0.3, 8
FILTERED_ABOVE = (8.0, 0.1)  # times the motion's frequency, and of half the sample rate: what is noise

PhaseName = Literal["pad", "burn", "coast", "parachute"]


@dataclass(frozen=True)
class Phase:
    """One phase, from `start_s` to `stop_s` of the record's time."""

    name: PhaseName
    start_s: float
    stop_s: float


def find_phases(time: FloatArray, ax: FloatArray, ay: FloatArray, az: FloatArray) -> tuple[Phase, ...]:
    """The phases, in order of time, of uniform `time` (n,) s and specific forces (n,) m/s^2, NaN where missing. Empty
    where the record holds neither thrust nor a parachute: it is one phase, and needs no window.
    """
    from scipy.ndimage import median_filter

    step = float(time[-1] - time[0]) / max(time.size - 1, 1)
    width = max(1, 2 * round(0.5 * PHASE_SMOOTHED / step) + 1)
    axial = median_filter(joined(ax), width, mode="nearest")
    force = median_filter(np.sqrt(sum(joined(each) ** 2 for each in (ax, ay, az))), width, mode="nearest")
    resting, least = np.abs(axial - GRAVITY) < REST_OFF, max(2, round(PHASE_SHORTEST / step))
    ignition = burnout = 0
    thrust = next((run for run in runs(axial > THRUST) if run[1] - run[0] >= least), None)  # the first that lasts
    if thrust is not None:
        rested = np.flatnonzero(resting[: thrust[0]])
        ignition = int(rested[-1]) + 1 if rested.size else thrust[0]
        dragged = (run for run in runs(axial < PHASE_BURNT_OUT) if run[0] > ignition and run[1] - run[0] >= least)
        burnout = next(dragged, (axial.size,))[0]
    # A parachute opens at the first sample at which the force leaves what it was.
    before = max(2, round(PARACHUTE_BEFORE / step))
    pulls = (int(at) for at in np.flatnonzero(force > PARACHUTE_LEAST * GRAVITY) if at >= burnout + before)
    opens = (at for at in pulls if force[at] > PARACHUTE_TIMES * np.median(force[at - before : at - before // 4]))
    jerk = next(opens, force.size)
    edges: dict[PhaseName, tuple[int, int]] = {
        "pad": (0, ignition if ignition and np.mean(resting[:ignition]) > PHASE_RESTING else 0),
        "burn": (ignition, burnout),
        "coast": (burnout, jerk),
        "parachute": (jerk, time.size),
    }
    if burnout == 0 and jerk == time.size:
        return ()
    return tuple(Phase(name, float(time[a]), float(time[b - 1])) for name, (a, b) in edges.items() if b - a >= least)


@dataclass(frozen=True)
class NoiseEstimate:
    """White noise of a channel."""

    sigma: float  # its standard deviation, in the units of the values
    trusted: bool  # False where motion, coloured or quantised noise or too few samples leave no more than a guide


@dataclass(frozen=True)
class ChannelQuality:
    """One channel as it was recorded, or derived."""

    name: str
    units: str  # as recorded
    si_units: str
    derived: bool
    missing: int  # samples
    longest_gap: int  # samples
    spikes: int  # samples of isolated spikes
    minimum: float  # SI; NaN where nothing is known, as the maximum
    maximum: float
    noise: NoiseEstimate  # SI


@dataclass(frozen=True)
class Inspection:
    """A record at a glance."""

    path: str
    title: str
    source: str
    planet: str
    samples: int
    start: float  # s
    stop: float  # s
    sample_rate: float  # Hz
    channels: tuple[ChannelQuality, ...]
    absent: tuple[str, ...]  # optional channels that were neither recorded nor derived
    segments: tuple[tuple[float, float], ...]  # the stretches that can be analysed, s
    dynamic_pressure_range: tuple[float, float]  # Pa
    transverse_frequency: float  # dominant frequency of q and r over the longest segment, Hz; 0 where they do not vary
    samples_per_cycle: float  # of that frequency
    vehicle: Vehicle
    phases: tuple[Phase, ...]  # those of a rocket's flight
    notes: tuple[str, ...]  # what reading changed or derived
    warnings: tuple[str, ...]  # what limits the use of the record


def inspect_flight(flight: Flight | str | Path, *, start: float | None = None, stop: float | None = None) -> Inspection:
    """Inspect a format 1 file or a flight in memory from `start` to `stop` (s); FlightRecordError if unusable."""
    record = unassemble(flight) if isinstance(flight, Flight) else read_record(flight)
    ready = windowed(flight if isinstance(flight, Flight) else assemble(record), start, stop)
    first = np.searchsorted(record.time, -np.inf if start is None else start, side="left")
    last = np.searchsorted(record.time, np.inf if stop is None else stop, side="right")
    time, recorded = record.time[first:last], {n: v[first:last] for n, v in record.channels.items()}
    channels = []
    for name in (*CHANNELS, *OPTIONAL_CHANNELS):
        si = SI[CHANNEL_DIMENSIONS[name]]
        if name in recorded:
            units = record.recorded_units.get(name, si)
            channels.append(_channel(name, time, recorded[name], units, derived=False))
        elif (values := getattr(ready, name)) is not None:
            channels.append(_channel(name, ready.time, values, si, derived=True))
    frequency = strongest_frequency(ready.q, ready.r, ready.step, ready.segments)
    phases = find_phases(ready.time, ready.ax, ready.ay, ready.az)
    per_cycle = ready.sample_rate / frequency if frequency > 0.0 else float("inf")
    warnings = _warnings(channels, per_cycle, phases)
    warnings += [FILTERED] if low_passed(ready) else []
    warnings += filter(None, (held_or_rounded(name, time, values) for name, values in recorded.items()))
    pressure = np.concatenate([ready.dynamic_pressure[a:b] for a, b in ready.segments])
    return Inspection(
        **{name: getattr(record, name) for name in ("path", "title", "source", "planet")},
        samples=int(time.size),
        start=float(time[0]),
        stop=float(time[-1]),
        sample_rate=ready.sample_rate,
        channels=tuple(channels),
        absent=tuple(name for name in OPTIONAL_CHANNELS if getattr(ready, name) is None),
        segments=tuple((float(ready.time[a]), float(ready.time[b - 1])) for a, b in ready.segments),
        dynamic_pressure_range=(float(pressure.min()), float(pressure.max())),
        transverse_frequency=frequency,
        samples_per_cycle=per_cycle,
        vehicle=ready.vehicle,
        phases=phases,
        notes=ready.notes,
        warnings=tuple(warnings),
    )


def white_noise(values: FloatArray) -> NoiseEstimate:
    """White-noise sigma of `values` (n,), NaN where missing, no spikes; trusted by the longest run's periodogram."""
    sigma = sigma_of_differences([values])
    if np.isnan(sigma):
        return NoiseEstimate(sigma, trusted=False)
    start, stop = max(runs(np.isfinite(values)), key=lambda run: run[1] - run[0])
    longest, levels = values[start:stop], np.zeros(4)  # that each quarter of the upper half of the band would have
    if longest.size >= INSPECTED_FEWEST_SAMPLES:
        window = np.hanning(longest.size)
        power = np.abs(np.fft.rfft((longest - np.mean(longest)) * window)) ** 2 / np.sum(window**2)
        levels = np.sqrt([float(np.mean(each)) for each in np.array_split(power[power.size // 2 : -1], 4)])
    level = float(np.median(levels))
    agrees = 0.0 < sigma <= INSPECTED_AGREES * level and level <= INSPECTED_AGREES * sigma
    return NoiseEstimate(sigma, trusted=agrees and bool(levels.max() <= INSPECTED_LEVEL * levels.min()))


FILTERED = (
    "q and r have little noise at their highest frequencies: they were low-passed (import's `rate` does so, without "
    "delay). Errors of coefficients allow for that; no stated error includes that a filter's delay makes knots late, "
    "and its width makes jumps gradual"
)


def low_passed(flight: Flight) -> bool:
    """Whether the noise of q and r ends within the band, in the longest segment."""
    from scipy.signal.windows import blackmanharris

    start, stop = max(flight.segments, key=lambda segment: segment[1] - segment[0])
    window = blackmanharris(stop - start)  # whose side lobes lie below any noise
    spectra = (np.fft.rfft((each[start:stop] - np.mean(each[start:stop])) * window) for each in (flight.q, flight.r))
    size, at = np.sqrt(sum(np.abs(each) ** 2 for each in spectra)), np.fft.rfftfreq(stop - start, flight.step)
    frequency = strongest_frequency(flight.q, flight.r, flight.step, flight.segments)  # of the motion, Hz
    cycles, share = FILTERED_ABOVE
    parts = np.array_split(np.flatnonzero(at > max(cycles * frequency, share * at[-1])), FILTERED_PARTS)
    if parts[-1].size < INSPECTED_FEWEST_SAMPLES // FILTERED_PARTS:
        return False
    levels = [float(np.median(size[part] * at[part] ** 2)) for part in parts]
    return levels[-1] < FILTERED_TO * max(levels[: FILTERED_PARTS // 2])


def held_or_rounded(name: str, time: FloatArray, values: FloatArray) -> str | None:
    """What to say of a channel (n,) that is held over several samples, or rounded beyond its noise; None of others."""
    changes = np.diff(values[np.isfinite(values)])
    moved = np.flatnonzero(changes)
    if moved.size < limits.HELD_FEWEST or name not in CHANNEL_DIMENSIONS:
        return None
    unit, new = SI[CHANNEL_DIMENSIONS[name]], find_holds(values)
    if new is not None:
        rate, step = 1.0 / np.median(np.diff(time[new])), np.median(np.abs(np.diff(values[new])))
        advice = (
            "give it its own recorder and rate, or leave the repeated samples empty"
            if name in INERTIAL_CHANNELS
            else "it is interpolated between these"
        )
        return f"{name} is held, a staircase: new values at {rate:.3g} Hz, in steps of {step:.3g} {unit}; {advice}"
    quantum = float(np.min(np.abs(changes[moved])))
    counts = changes[moved] / quantum
    coarse = float(np.mean(changes == 0.0)) > limits.ROUNDED_REPEATS
    if coarse and np.max(np.abs(counts - np.rint(counts))) < limits.ROUNDED_WITHIN:
        return f"{name} is rounded to {quantum:.3g} {unit}, coarser than its noise"
    return None


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


def _warnings(channels: list[ChannelQuality], per_cycle: float, phases: tuple[Phase, ...]) -> list[str]:
    warnings = []
    if per_cycle < INSPECTED_PER_CYCLE:
        warnings.append(
            f"only {per_cycle:.1f} samples a cycle of the strongest transverse motion: rates can hardly "
            "be differentiated, and delays shorter than a sample cannot be determined"
        )
    doubtful = [one.name for one in channels if one.name in INERTIAL_CHANNELS and not one.noise.trusted]
    if doubtful:
        warnings.append(
            f"the noise of {', '.join(doubtful)} is not white, or is hidden by motion or rounding: its sigma "
            "is no more than a guide"
        )
    spans = {phase.name: (phase.start_s, phase.stop_s) for phase in phases}
    coast = spans.pop("coast", None)
    if spans:
        intervals = ", ".join(f"{name} {start:.2f} to {stop:.2f} s" for name, (start, stop) in spans.items())
        window = "" if coast is None else ": analyse the coast, --start {:.2f} --stop {:.2f}".format(*coast)
        act = "where thrust, rest or a parachute act, which no mechanism describes"
        warnings.append(f"the record holds {intervals}, {act}{window}")
    return warnings
