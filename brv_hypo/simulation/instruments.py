"""What the instruments say of a flight: Appendix B of the report, with errata E10 and E11.

Perfect instruments read the motion at their place and clock, averaged where asked; the record effects of the
configuration err on that; then come noise, spikes and gaps (NaN). Every channel draws from its own stream of the
seed, so that one instrument's errors do not move another's.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from brv_hypo.arrays import FloatArray
from brv_hypo.flight.record import ACCELEROMETERS, GYROS, Flight
from brv_hypo.flight.schema import Record, VehicleRecord
from brv_hypo.simulation.config import (
    GapConfig,
    GaugeConfig,
    ScaledGaugeConfig,
    SimulationConfig,
    SpikesConfig,
)
from brv_hypo.simulation.errors import with_errors
from brv_hypo.simulation.rotation import cross

_STREAMS = (
    "gyro",
    "accelerometer",
    "velocity",
    "dynamic_pressure",
    "altitude",
    "roll_rate_mag",
    "spikes",
    "gaps",
)


@dataclass(frozen=True)
class Signals:
    """One flight as it was, at the integration's nodes (n,): s, rad/s, rad/s^2, m/s^2, m/s, Pa, m."""

    time: FloatArray
    rates: FloatArray
    angular_acceleration: FloatArray
    specific_force: FloatArray
    velocity: FloatArray
    dynamic_pressure: FloatArray
    altitude: FloatArray


def recorded(signals: Signals, config: SimulationConfig, time: FloatArray, seed: int) -> Record:
    """The flight record at `time` (m,) s, NaN in gaps."""
    instruments = config.instruments
    streams = {
        name: np.random.default_rng(child)
        for name, child in zip(_STREAMS, np.random.SeedSequence(seed).spawn(len(_STREAMS)), strict=True)
    }
    flight = with_errors(perfect(signals, config, time), instruments.errors)
    channels = _triad(flight, GYROS, instruments.gyro.noise, streams["gyro"])
    channels |= _triad(flight, ACCELEROMETERS, instruments.accelerometer.noise, streams["accelerometer"])
    for name, gauge in _gauges(config).items():
        channels[name] = _gauge(getattr(flight, name), gauge, streams[name])
    for name in ("velocity", "dynamic_pressure"):
        channels[name] = np.maximum(channels[name], 0.0)  # their gauges have a stop at zero
    for spikes in instruments.spikes:
        _spike(channels, spikes, streams["spikes"])
    for gap in instruments.gaps:
        _cut(channels, gap, time, streams["gaps"])
    return Record(
        time=time,
        channels=channels,
        vehicle=VehicleRecord(**vars(flight.vehicle)),
        instruments=instruments.declared(),
        planet=config.environment.planet,
        title=config.title,
        source=f"simulated, seed {seed}",
    )


def perfect(signals: Signals, config: SimulationConfig, time: FloatArray) -> Flight:
    """What perfect instruments say at `time` (m,) s, of a vehicle that is as it was built."""
    averaging = float(time[1] - time[0]) if config.instruments.averaged else 0.0

    def seen(values: FloatArray, delay: float = 0.0) -> FloatArray:
        return _seen(signals.time, values, time, delay, averaging)

    vehicle = config.vehicle.declared()
    force = specific_force_at(np.array(vehicle.accelerometer_position), signals)
    channels = dict(zip(GYROS, seen(signals.rates), strict=True))
    channels |= dict(zip(ACCELEROMETERS, seen(force), strict=True))
    for name, gauge in _gauges(config).items():
        true = signals.rates[0] if name == "roll_rate_mag" else getattr(signals, name)
        channels[name] = seen(true, gauge.delay)
    return Flight(time=time, vehicle=vehicle, instruments=config.instruments.declared(), **channels)


def specific_force_at(position: FloatArray, signals: Signals) -> FloatArray:
    """f = a_cg + omega_dot x r + omega x (omega x r), (3, n) m/s^2; no gravity (errata E10, E11)."""
    arm = position[:, None] * np.ones_like(signals.time)
    swing = cross(signals.rates, cross(signals.rates, arm))
    return np.asarray(signals.specific_force + cross(signals.angular_acceleration, arm) + swing, dtype=float)


def _seen(
    nodes: FloatArray, values: FloatArray, time: FloatArray, delay: float, averaging: float
) -> FloatArray:
    """`values` (..., n) as a clock `delay` s late reads them at `time`, averaged over the interval before.

    Before the first node the end of the spline is extended: a delay or interval of a few samples.
    """
    if delay == 0.0 and averaging == 0.0:
        return np.array(values[..., np.searchsorted(nodes, time - 1e-9)])
    spline = CubicSpline(nodes, values, axis=-1)
    if averaging == 0.0:
        return np.asarray(spline(time - delay), dtype=float)
    total = spline.antiderivative()
    return np.asarray((total(time - delay) - total(time - delay - averaging)) / averaging, dtype=float)


def _gauges(config: SimulationConfig) -> dict[str, GaugeConfig]:
    """The scalar instruments that are carried, by channel."""
    names = ("velocity", "dynamic_pressure", "altitude", "roll_rate_mag")
    carried = {name: getattr(config.instruments, name) for name in names}
    return {name: gauge for name, gauge in carried.items() if gauge is not None}


def _triad(
    flight: Flight, names: tuple[str, str, str], noise: float, draws: np.random.Generator
) -> dict[str, FloatArray]:
    """Three channels with their noise."""
    readings = np.array([getattr(flight, name) for name in names])
    return dict(zip(names, readings + noise * draws.standard_normal(readings.shape), strict=True))


def _gauge(true: FloatArray, sensor: GaugeConfig, draws: np.random.Generator) -> FloatArray:
    """(m,) as a scalar sensor reads it."""
    scale = sensor.scale if isinstance(sensor, ScaledGaugeConfig) else 0.0
    return np.asarray((1.0 + scale) * true + sensor.bias + sensor.noise * draws.standard_normal(true.shape))


def _spike(channels: dict[str, FloatArray], spikes: SpikesConfig, draws: np.random.Generator) -> None:
    channel = channels[spikes.channel]
    chosen = draws.choice(channel.size, size=min(spikes.count, channel.size), replace=False)
    channel[chosen] += spikes.size * draws.choice([-1.0, 1.0], size=chosen.size)


def _cut(
    channels: dict[str, FloatArray], gap: GapConfig, time: FloatArray, draws: np.random.Generator
) -> None:
    latest = max(time[-1] - gap.duration, time[0])
    starts = [gap.start] if gap.start is not None else draws.uniform(time[0], latest, size=gap.count)
    for start in starts:
        missing = (time >= start - 1e-9) & (time < start + gap.duration - 1e-9)
        for name in gap.channels:
            channels[name][missing] = np.nan
