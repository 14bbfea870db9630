"""Errors of the rate gyros."""

from __future__ import annotations

import math
from collections.abc import Sequence

from brv_hypo.flight.record import Flight
from brv_hypo.mechanisms import Component, RecordEffect, hookimpl
from brv_hypo_effects.triads import TriadBias, TriadScale, sheared, turned

_GYROS = ("p", "q", "r")
_PAIRS = ("yz", "xz", "xy")


class GyroBias(TriadBias):
    """A constant added to each rate gyro."""

    name = "gyro_bias"
    title = "bias of the rate gyros"
    claims = "a rate gyro reads a constant too much"
    source = "report, Appendix B"
    axes = _GYROS
    units = "rad/s"


class GyroScale(TriadScale):
    """A scale error of each rate gyro."""

    name = "gyro_scale"
    title = "scale error of the rate gyros"
    claims = "a rate gyro reads a constant factor too much"
    source = "report, Appendix B"
    axes = _GYROS


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
