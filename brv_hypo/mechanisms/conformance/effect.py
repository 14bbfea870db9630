"""The checks of a record effect: a perturbation of the record that is small, pure and linear."""

from __future__ import annotations

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.flight.record import CHANNELS, Flight
from brv_hypo.flight.units import is_unit
from brv_hypo.mechanisms.conformance.check import Check, expect, named
from brv_hypo.mechanisms.conformance.samples import sample_flight
from brv_hypo.mechanisms.contract import RecordEffect

# Units in which wind (m/s) and the place of the accelerometers (m) are compared.
_WIND, _PLACE = 10.0, 0.1


def _channels(flight: Flight) -> FloatArray:
    """All that an effect may act on, (rows, samples): channels by their size in the sample, wind, place, inertia."""
    channels = np.array([getattr(flight, name) for name in CHANNELS], dtype=float)
    sizes = np.array([np.max(np.abs(getattr(sample_flight(), name))) for name in CHANNELS], dtype=float)
    wind = np.zeros((3, flight.samples)) if flight.wind is None else flight.wind.T / _WIND
    place = np.array(flight.vehicle.accelerometer_position)[:, np.newaxis] * np.ones(flight.samples) / _PLACE
    known = sample_flight().vehicle
    inertia = np.array([[flight.vehicle.ixx / known.ixx], [flight.vehicle.iyy / known.iyy]])
    return np.concatenate([channels / sizes[:, np.newaxis], wind, place, inertia * np.ones(flight.samples)])


def is_declared(effect: RecordEffect) -> None:
    """It has a name, a title, claims, a source and a kind."""
    for attribute in ("name", "title", "claims", "source"):
        value = getattr(type(effect), attribute, None)
        expect(
            isinstance(value, str) and bool(value.strip()), f"`{attribute}` is {value!r}: set a line of text"
        )
    expect(effect.kind in ("instrument", "environment"), f"`kind` is {effect.kind!r}")


def has_sane_components(effect: RecordEffect) -> None:
    """Each component has a name of its own, a unit and a typical size above zero."""
    components = effect.components(sample_flight())
    names = [name for name, _, _ in components]
    expect(bool(names) and len(set(names)) == len(names), f"components need names, each its own: {names}")
    for name, units, size in components:
        expect(is_unit(units), f"'{name}': '{units}' is not a unit")
        expect(bool(np.isfinite(size)) and size > 0.0, f"'{name}': the typical size is {size}")


def leaves_the_record_alone_at_zero(effect: RecordEffect) -> None:
    """The value zero changes nothing."""
    flight = sample_flight()
    for name, _, _ in effect.components(sample_flight()):
        change = np.max(np.abs(_channels(effect.perturb(flight, name, 0.0)) - _channels(flight)))
        expect(bool(change < 1e-12), f"'{name}' = 0 changes the record by {change:.1e} of its size")


def changes_the_record(effect: RecordEffect) -> None:
    """The typical size changes the record, keeps the number of samples and leaves all finite."""
    flight = sample_flight()
    for name, _, size in effect.components(sample_flight()):
        changed = _channels(effect.perturb(flight, name, size))
        expect(changed.shape == _channels(flight).shape, f"'{name}' changes the number of samples")
        expect(bool(np.isfinite(changed).all()), f"'{name}' leaves values that are not finite")
        expect(bool(np.any(changed != _channels(flight))), f"'{name}' = {size} changes nothing")


def is_linear_for_small_values(effect: RecordEffect) -> None:
    """Half the typical size does half of what the typical size does, within 5 %."""
    flight = sample_flight()
    for name, _, size in effect.components(sample_flight()):
        whole = _channels(effect.perturb(flight, name, size)) - _channels(flight)
        half = _channels(effect.perturb(flight, name, 0.5 * size)) - _channels(flight)
        off = float(np.max(np.abs(whole - 2.0 * half)) / np.max(np.abs(whole)))
        expect(off < 0.05, f"'{name}' departs from linear by {100 * off:.0f} % at its typical size {size}")


def is_pure(effect: RecordEffect) -> None:
    """The given record is left as it was, and the same call gives the same record."""
    flight = sample_flight()
    for name, _, size in effect.components(sample_flight()):
        first, again = (_channels(effect.perturb(flight, name, size)) for _ in range(2))
        expect(bool(np.array_equal(first, again)), f"two calls with the same '{name}' differ")
        expect(
            bool(np.array_equal(_channels(flight), _channels(sample_flight()))),
            f"'{name}' writes into its input",
        )


EFFECT_CHECKS: tuple[Check[RecordEffect], ...] = tuple(
    named(check)
    for check in (
        is_declared,
        has_sane_components,
        leaves_the_record_alone_at_zero,
        changes_the_record,
        is_linear_for_small_values,
        is_pure,
    )
)
"""Every check of a record effect."""
