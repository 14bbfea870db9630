"""Errors of the rate gyros."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from brv_hypo.flight.record import Flight
from brv_hypo.mechanisms import Component, RecordEffect, hookimpl
from brv_hypo_effects.triads import sheared, turned

_GYROS = ("p", "q", "r")
_PAIRS = ("yz", "xz", "xy")


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
    """Each gyro's axis is turned a little against the body's: together, a rotation, or two toward each other.

    A rotation makes a reading gain omega x m; two axes that are not orthogonal read of each other with the same sign.
    """

    name = "gyro_misalignment"
    title = "misalignment of the rate gyros"
    claims = "the gyros' axes are turned against the body's, so that the transverse ones read roll rate"
    source = "report, Appendix B"
    kind = "instrument"

    def components(self, flight: Flight) -> tuple[Component, ...]:
        """The rotation about each body axis, and how far each two axes are from orthogonal, shared between them.

        Axes that are turned independently leave half of the sum of their squares to either.
        """
        sizes = dict(zip("xyz", flight.instruments.gyro_misalignment, strict=True))
        rotations = tuple(Component(axis, "rad", size) for axis, size in sizes.items())
        return rotations + tuple(
            Component(pair, "rad", 0.5 * math.hypot(sizes[pair[0]], sizes[pair[1]])) for pair in _PAIRS
        )

    def perturb(self, flight: Flight, component: str, value: float) -> Flight:
        """The record of gyros turned by `value` rad more about that body axis, or toward each other."""
        change = sheared if component in _PAIRS else turned
        return change(flight, _GYROS, component, value)


@hookimpl
def brv_hypo_record_effects() -> Sequence[RecordEffect]:
    """The effects of this module."""
    return [GyroBias(), GyroScale(), GyroMisalignment()]
