"""Errors of instruments, declared vehicle and air: record effects, planted as the regression tries them.

`drawn` makes a configuration's errors from its tolerances, `with_errors` plants them in a noise-free record, and
`wind_course` moves the air where an effect says that the record leaves a wind unaccounted for.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.errors import UsageError
from brv_hypo.files.printed import meant
from brv_hypo.flight.record import ACCELEROMETERS, GYROS, Flight
from brv_hypo.mechanisms.carried import carried_effects, carried_mechanisms
from brv_hypo.mechanisms.contract import RecordEffect
from brv_hypo.mechanisms.registry import find_installed
from brv_hypo.motion.motion import Motion
from brv_hypo.simulation import rotation
from brv_hypo.simulation.config import PlantedConfig, SimulationConfig
from brv_hypo.simulation.dynamics import RATES
from brv_hypo.simulation.system import initial_state, system
from brv_hypo.simulation.variation import per_flight
from brv_hypo.simulation.wind import WindCourse

Errors = Mapping[str, Mapping[str, float]]


@dataclass(frozen=True)
class Start:
    """A batch at its first instant: what its records would hold if that lasted; its motion; body axes in the frame."""

    records: tuple[Flight, ...]
    motion: Motion
    body_axes: FloatArray


def drawn(config: SimulationConfig, seed: int) -> SimulationConfig:
    """The configuration with errors and asymmetries drawn from N(0, (draw * tolerance)^2), `draw` then 0.

    Every effect that hypotheses carry draws, from a stream of its own: what else is installed changes nothing.
    """
    factor = config.instruments.draw
    if factor == 0.0:
        return config
    start = start_of((config,))
    (record,) = start.records
    errors = {name: dict(values) for name, values in config.instruments.errors.items()}
    for effect in carried_effects():
        components = effect.components(record)
        values = _values(effect.name, [component.size for component in components], factor, seed)
        own = errors.setdefault(effect.name, {})
        for component, value in zip(components, values, strict=True):
            own[component.name] = own.get(component.name, 0.0) + value
    instruments = config.instruments.model_copy(update={"errors": errors, "draw": 0.0})
    found = _drawn_asymmetries(record, start.motion, factor, seed)
    return config.model_copy(
        update={"instruments": instruments, "asymmetries": (*config.asymmetries, *found)}
    )


def with_errors(flight: Flight, errors: Errors) -> Flight:
    """The record as it would read with these errors, by effect and component, SI; UsageError for an unknown one."""
    for name, values in errors.items():
        effect = find_effect(name)
        known = effect.plantable(flight)
        for component, value in values.items():
            if component not in known:
                hint = meant(component, known, f"it has {', '.join(known)}", cutoff=0.5)
                raise UsageError(f"the record effect '{name}' has no component '{component}' ({hint}).")
            flight = effect.perturb(flight, component, value)
    return flight


def find_effect(name: str) -> RecordEffect:
    """The installed record effect of that name; UsageError with the nearest names."""
    item = find_installed(name)
    if not isinstance(item, RecordEffect):
        raise UsageError(f"'{name}' is no error of the record but a mechanism: plant it under `mechanisms`.")
    return item


def wind_course(configs: Sequence[SimulationConfig]) -> WindCourse | None:
    """The wind that the errors of a batch leave unaccounted for; None where they hold none.

    A record that is said to know less of the wind than there is flew in that much more of it.
    """
    if not any(config.instruments.errors for config in configs):
        return None
    start = start_of(configs)
    known = [
        with_errors(record, config.instruments.errors).wind
        for record, config in zip(start.records, configs, strict=True)
    ]
    if all(wind is None for wind in known):
        return None
    still = np.zeros((configs[0].samples, 3))
    body = np.stack([still if wind is None else -wind for wind in known], axis=1)
    air = rotation.to_frame(start.body_axes, np.moveaxis(body, -1, 0))
    first = configs[0]
    return WindCourse(first.start.time, 1.0 / first.sample_rate, air)


def start_of(configs: Sequence[SimulationConfig]) -> Start:
    """The first instant of a batch."""
    equations = system(configs)
    state = initial_state(configs, equations)
    instant = per_flight(configs, "start", "time")
    air = equations.air_data(instant, state)
    channels = dict(zip(GYROS, state[RATES], strict=True))
    channels |= dict(zip(ACCELEROMETERS, air.specific_force, strict=True))
    channels |= {"velocity": air.speed, "dynamic_pressure": air.dynamic_pressure, "altitude": air.altitude}
    records = []
    for i, config in enumerate(configs):
        time = config.start.time + np.arange(config.samples) / config.sample_rate
        lasting: dict[str, Any] = {name: np.full(time.size, values[i]) for name, values in channels.items()}
        vehicle, instruments = config.vehicle.declared(), config.instruments.declared()
        records.append(Flight(time=time, vehicle=vehicle, instruments=instruments, **lasting))
    motion = equations.motion(instant, state, air)
    return Start(tuple(records), motion, air.rotation)


def _drawn_asymmetries(record: Flight, motion: Motion, factor: float, seed: int) -> tuple[PlantedConfig, ...]:
    """Every carried mechanism, a tolerance of the vehicle: constant in time, without nonlinear parameters."""
    found = []
    for mechanism in carried_mechanisms(record):
        values = _values(mechanism.name, mechanism.tolerance(record) or (), factor, seed)
        names = [term.name for term in mechanism.terms(motion, {})]
        terms = dict(zip(names, values, strict=True))
        found.append(PlantedConfig(mechanism=mechanism.name, terms=terms, kind="constant"))
    return tuple(found)


def _values(name: str, sizes: Sequence[float], factor: float, seed: int) -> list[float]:
    """One draw for each 1-sigma size, from the stream of that name."""
    draws = np.random.default_rng([seed, *name.encode()])
    return [float(value) for value in factor * np.asarray(sizes) * draws.standard_normal(len(sizes))]
