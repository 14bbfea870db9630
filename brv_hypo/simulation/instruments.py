"""What the instruments say of a flight: Appendix B of the report, with errata E10 and E11.

Order of the errors: late clock and averaging, misalignment, scale, bias, noise; then spikes, then gaps (NaN).
Every channel draws from its own stream of the seed, so that one instrument's errors do not move another's.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from brv_hypo.arrays import FloatArray
from brv_hypo.simulation.config import GapConfig, GaugeConfig, InstrumentsConfig, TriadConfig
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


def measured(
    signals: Signals,
    instruments: InstrumentsConfig,
    position: tuple[float, float, float],
    time: FloatArray,
    seed: int,
) -> dict[str, FloatArray]:
    """The channels of a flight record at `time` (m,) s, NaN in gaps; `position` (3,) m is that declared."""
    streams = {
        name: np.random.default_rng(child)
        for name, child in zip(_STREAMS, np.random.SeedSequence(seed).spawn(len(_STREAMS)), strict=True)
    }
    averaging = float(time[1] - time[0]) if instruments.averaged else 0.0

    def seen(values: FloatArray, delay: float) -> FloatArray:
        return _seen(signals.time, values, time, delay, averaging)

    place = np.array(instruments.accelerometer.position or position)
    force = specific_force_at(place, signals)
    gyro, accelerometer = instruments.gyro, instruments.accelerometer
    p, q, r = _triad(seen(signals.rates, gyro.delay), gyro, streams["gyro"])
    ax, ay, az = _triad(seen(force, accelerometer.delay), accelerometer, streams["accelerometer"])
    channels = {"p": p, "q": q, "r": r, "ax": ax, "ay": ay, "az": az}
    for name in ("velocity", "dynamic_pressure", "altitude"):
        gauge: GaugeConfig = getattr(instruments, name)
        channels[name] = _gauge(seen(getattr(signals, name), gauge.delay), gauge, streams[name])
    for name in ("velocity", "dynamic_pressure"):
        channels[name] = np.maximum(channels[name], 0.0)  # their gauges have a stop at zero
    if instruments.roll_rate_mag is not None:
        magnetometer = instruments.roll_rate_mag
        roll = seen(signals.rates[0], magnetometer.delay)
        channels["roll_rate_mag"] = _gauge(roll, magnetometer, streams["roll_rate_mag"])
    for spikes in instruments.spikes:
        chosen = streams["spikes"].choice(time.size, size=min(spikes.count, time.size), replace=False)
        channels[spikes.channel][chosen] += spikes.size * streams["spikes"].choice(
            [-1.0, 1.0], size=chosen.size
        )
    for gap in instruments.gaps:
        _cut(channels, gap, time, streams["gaps"])
    return channels


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


def _triad(true: FloatArray, sensor: TriadConfig, draws: np.random.Generator) -> FloatArray:
    """(3, m) as three sensors read it: axes turned by a small rotation, then scale, bias and noise."""
    turned = true + cross(true, np.array(sensor.misalignment)[:, None] * np.ones(true.shape[1]))
    scaled = (1.0 + np.array(sensor.scale)[:, None]) * turned + np.array(sensor.bias)[:, None]
    return np.asarray(scaled + sensor.noise * draws.standard_normal(true.shape), dtype=float)


def _gauge(true: FloatArray, sensor: GaugeConfig, draws: np.random.Generator) -> FloatArray:
    """(m,) as a scalar sensor reads it."""
    return np.asarray(
        (1.0 + sensor.scale) * true + sensor.bias + sensor.noise * draws.standard_normal(true.shape)
    )


def _cut(
    channels: dict[str, FloatArray], gap: GapConfig, time: FloatArray, draws: np.random.Generator
) -> None:
    latest = max(time[-1] - gap.duration, time[0])
    starts = [gap.start] if gap.start is not None else draws.uniform(time[0], latest, size=gap.count)
    for start in starts:
        missing = (time >= start - 1e-9) & (time < start + gap.duration - 1e-9)
        for name in gap.channels:
            channels[name][missing] = np.nan
