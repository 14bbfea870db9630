"""Errors of the rate gyros."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from brv_hypo.flight.record import Flight
from brv_hypo.mechanisms import Component, RecordEffect, hookimpl
from brv_hypo_effects.triads import turned

_GYROS = ("p", "q", "r")


class GyroBias(RecordEffect):
    """A constant added to each rate gyro."""

    name = "gyro_bias"
    title = "bias of the rate gyros"
    claims = "a rate gyro reads a constant too much"
    source = "report, Appendix B"
    kind = "instrument"

    def components(self, flight: Flight) -> tuple[Component, ...]:
        """One bias for each gyro."""
        sizes = flight.instruments.gyro_bias
        return tuple(Component(name, "rad/s", size) for name, size in zip(_GYROS, sizes, strict=True))

    def perturb(self, flight: Flight, component: str, value: float) -> Flight:
        """The record with `value` rad/s more on that gyro."""
        return replace(flight, **{component: getattr(flight, component) + value})


class GyroScale(RecordEffect):
    """A scale error of each rate gyro."""

    name = "gyro_scale"
    title = "scale error of the rate gyros"
    claims = "a rate gyro reads a constant factor too much"
    source = "report, Appendix B"
    kind = "instrument"

    def components(self, flight: Flight) -> tuple[Component, ...]:
        """One scale error for each gyro."""
        sizes = flight.instruments.gyro_scale
        return tuple(Component(name, "1", size) for name, size in zip(_GYROS, sizes, strict=True))

    def perturb(self, flight: Flight, component: str, value: float) -> Flight:
        """The record with that gyro's reading larger by the share `value`."""
        return replace(flight, **{component: getattr(flight, component) * (1.0 + value)})


class GyroMisalignment(RecordEffect):
    """The gyros' axes are turned by a small rotation against the body's: a reading gains omega x m."""

    name = "gyro_misalignment"
    title = "misalignment of the rate gyros"
    claims = "the gyros' axes are turned against the body's, so that the transverse ones read roll rate"
    source = "report, Appendix B"
    kind = "instrument"

    def components(self, flight: Flight) -> tuple[Component, ...]:
        """The rotation about each body axis."""
        sizes = flight.instruments.gyro_misalignment
        return tuple(Component(axis, "rad", size) for axis, size in zip("xyz", sizes, strict=True))

    def perturb(self, flight: Flight, component: str, value: float) -> Flight:
        """The record of gyros that are turned by `value` rad more about that body axis."""
        return turned(flight, _GYROS, component, value)


@hookimpl
def brv_hypo_record_effects() -> Sequence[RecordEffect]:
    """The effects of this module."""
    return [GyroBias(), GyroScale(), GyroMisalignment()]
