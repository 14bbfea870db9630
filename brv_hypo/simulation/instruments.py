"""From the true motion to a record: errors of instruments, declared vehicle and air, noise, spikes and gaps.

Errors are record effects, planted exactly as the regression tries them (`with_errors`); `drawn` takes a
configuration's errors from its tolerances, `wind_profile` moves the air where an effect says that the record leaves
a wind unaccounted for. `recorded` is the entrance.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.errors import UsageError
from brv_hypo.flight.record import ACCELEROMETERS, GYROS, Flight, Record, checked_vehicle, validated
from brv_hypo.io.text import meant
from brv_hypo.mechanisms.contract import RecordEffect
from brv_hypo.mechanisms.registry import find_installed, nuisance_effects, nuisance_mechanisms
from brv_hypo.motion.motion import Motion
from brv_hypo.simulation.config import PlantedConfig, SimulationConfig
from brv_hypo.simulation.vehicle import RATES, AirData, WindProfile, cross, initial_state, system, transform

Errors = Mapping[str, Mapping[str, float]]
_GAUGES = ("velocity", "dynamic_pressure", "altitude")
# Streams of random numbers by their place in a seed, which stays so that a seed's flight stays the same.
_STREAMS = {"gyro": 0, "accelerometer": 1, **{name: k for k, name in enumerate(_GAUGES, 2)}, "spikes": 6, "gaps": 7}


def true_channels(state: FloatArray, air: AirData) -> dict[str, FloatArray]:
    """What perfect instruments at the c.g. read, by channel, on the shape of the state's trailing axes."""
    channels = dict(zip((*GYROS, *ACCELEROMETERS), (*state[RATES], *air.specific_force), strict=True))
    return channels | {"velocity": air.speed, "dynamic_pressure": air.dynamic_pressure, "altitude": air.altitude}


def sensed_channels(
    state: FloatArray, air: AirData, angular: FloatArray, place: Sequence[float]
) -> dict[str, FloatArray]:
    """What perfect instruments read, accelerometers at their `place` (m), at angular accelerations (3, n) rad/s^2."""
    # f = a_cg + omega_dot x r + omega x (omega x r), no gravity (errata E10, E11)
    rates, arm = state[RATES], np.array(place)[:, np.newaxis] * np.ones_like(state[0])
    force = air.specific_force + cross(angular, arm) + cross(rates, cross(rates, arm))
    return true_channels(state, air) | dict(zip(ACCELEROMETERS, force, strict=True))


def drawn(config: SimulationConfig, seed: int) -> SimulationConfig:
    """The configuration with errors and asymmetries drawn from N(0, (draw * tolerance)^2), `draw` then 0. Every effect
    that hypotheses carry draws, from a stream of its own: what else is installed changes nothing.
    """
    factor = config.instruments.draw
    if factor == 0.0:
        return config
    record, motion, _ = start_of(config)
    errors = {name: dict(values) for name, values in config.instruments.errors.items()}
    for effect in nuisance_effects():
        if not (components := effect.components(record)):  # of a gap that the record lacks
            continue
        values = _values(effect.name, [component.size for component in components], factor, seed)
        own = errors.setdefault(effect.name, {})
        for component, value in zip(components, values, strict=True):
            own[component.name] = own.get(component.name, 0.0) + value
    instruments = config.instruments.model_copy(update={"errors": errors, "draw": 0.0})
    asymmetries = list(config.asymmetries)
    for mechanism in nuisance_mechanisms(record):  # constant in time, without nonlinear parameters
        values = _values(mechanism.name, mechanism.tolerance(record) or (), factor, seed)
        terms = dict(zip((term.name for term in mechanism.terms(motion, {})), values, strict=True))
        asymmetries.append(PlantedConfig(mechanism=mechanism.name, terms=terms, kind="constant"))
    return config.model_copy(update={"instruments": instruments, "asymmetries": tuple(asymmetries)})


def with_errors(flight: Flight, errors: Errors) -> Flight:
    """The record as it would read with these errors, by effect and component, SI; UsageError for an unknown one."""
    for name, values in errors.items():
        effect = find_installed(name)
        if not isinstance(effect, RecordEffect):
            raise UsageError(f"'{name}' is no error of the record but a mechanism: plant it under `mechanisms`.")
        known = [each.name for each in effect.components(flight)]
        for component, value in values.items():
            if component not in known:
                hint = meant(component, known, f"it has {', '.join(known)}", cutoff=0.5)
                raise UsageError(f"the record effect '{name}' has no component '{component}' ({hint}).")
            flight = effect.perturb(flight, component, value)
    return flight


def wind_profile(config: SimulationConfig) -> WindProfile | None:
    """The wind that the errors of a flight leave unaccounted for; None where they hold none. A record that is said to
    know less of the wind than there is flew in that much more of it.
    """
    if not config.instruments.errors:
        return None
    record, _, body_axes = start_of(config)
    known = with_errors(record, config.instruments.errors).wind
    if known is None:
        return None
    return WindProfile(config.start.time, 1.0 / config.sample_rate, transform(body_axes, -known.T))


def start_of(config: SimulationConfig) -> tuple[Flight, Motion, FloatArray]:
    """A flight at its first instant: what its record would hold if that lasted; its motion; body axes in the frame."""
    equations = system(config)
    state = initial_state(equations)
    instant = np.array([config.start.time])
    air = equations.air_data(instant, state)
    time = config.start.time + np.arange(config.samples) / config.sample_rate
    lasting = {name: np.full(time.size, value) for name, value in true_channels(state, air).items()}
    return _perfect(time, lasting, config), equations.motion(instant, state, air), air.rotation


def _values(name: str, sizes: Sequence[float], factor: float, seed: int) -> list[float]:
    """One draw for each 1-sigma size, from the stream of that name."""
    draws = np.random.default_rng([seed, *name.encode()])
    return [float(value) for value in factor * np.asarray(sizes) * draws.standard_normal(len(sizes))]


def recorded(time: FloatArray, sensed: Mapping[str, Any], config: SimulationConfig, seed: int) -> Record:
    """The flight record at `time` (n,) s, NaN in gaps, of instruments that sense these channels (n,)."""
    instruments = config.instruments
    streams = {
        name: np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(place,)))
        for name, place in _STREAMS.items()
    }
    flight = with_errors(_perfect(time, sensed, config), instruments.errors)
    channels: dict[str, FloatArray] = {}
    for names, stream in ((GYROS, "gyro"), (ACCELEROMETERS, "accelerometer")):
        readings = np.array([getattr(flight, name) for name in names])
        readings += getattr(instruments, stream).noise * streams[stream].standard_normal(readings.shape)
        channels |= dict(zip(names, readings, strict=True))
    for name in _GAUGES:
        noise = getattr(instruments, name).noise * streams[name].standard_normal(time.shape)
        channels[name] = getattr(flight, name) + noise
    for name in ("velocity", "dynamic_pressure"):
        channels[name] = np.maximum(channels[name], 0.0)  # their gauges have a stop at zero
    for spikes in instruments.spikes:
        channel, draws = channels[spikes.channel], streams["spikes"]
        chosen = draws.choice(channel.size, size=min(spikes.count, channel.size), replace=False)
        channel[chosen] += spikes.size * draws.choice([-1.0, 1.0], size=chosen.size)
    for gap in instruments.gaps:
        latest = max(time[-1] - gap.duration, time[0])
        random = streams["gaps"].uniform(time[0], latest, size=gap.count) if gap.start is None else [gap.start]
        for start in random:
            missing = (time >= start - 1e-9) & (time < start + gap.duration - 1e-9)
            for name in gap.channels:
                channels[name][missing] = np.nan
    content = {
        "time": time,
        "channels": channels,
        "vehicle": checked_vehicle(vars(flight.vehicle)),
        "instruments": instruments.declared(),
        "planet": config.environment.planet,
        "title": config.title,
        "source": f"simulated, seed {seed}",
    }
    return validated(Record, content)


def _perfect(time: FloatArray, sensed: Mapping[str, Any], config: SimulationConfig) -> Flight:
    """What perfect instruments say at `time` (n,) s, of a vehicle that is as it was built."""
    return Flight(time=time, vehicle=config.vehicle, instruments=config.instruments.declared(), **sensed)
