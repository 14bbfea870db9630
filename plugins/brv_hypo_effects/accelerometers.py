"""Errors of the accelerometers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from brv_hypo.flight.record import Flight
from brv_hypo.mechanisms import Component, RecordEffect, hookimpl
from brv_hypo_effects.triads import turned

_AXES = ("x", "y", "z")


class AccelBias(RecordEffect):
    """A constant added to each accelerometer."""

    name = "accel_bias"
    title = "bias of the accelerometers"
    claims = "an accelerometer reads a constant too much"
    source = "report, Appendix B"
    kind = "instrument"

    def components(self, flight: Flight) -> tuple[Component, ...]:
        """One bias for each accelerometer."""
        sizes = flight.instruments.accel_bias
        return tuple(Component(axis, "m/s^2", size) for axis, size in zip(_AXES, sizes, strict=True))

    def perturb(self, flight: Flight, component: str, value: float) -> Flight:
        """The record with `value` m/s^2 more on that accelerometer."""
        channel = f"a{component}"
        return replace(flight, **{channel: getattr(flight, channel) + value})


class AccelScale(RecordEffect):
    """A scale error of each accelerometer."""

    name = "accel_scale"
    title = "scale error of the accelerometers"
    claims = "an accelerometer reads a constant factor too much"
    source = "report, Appendix B"
    kind = "instrument"

    def components(self, flight: Flight) -> tuple[Component, ...]:
        """One scale error for each accelerometer."""
        sizes = flight.instruments.accel_scale
        return tuple(Component(axis, "1", size) for axis, size in zip(_AXES, sizes, strict=True))

    def perturb(self, flight: Flight, component: str, value: float) -> Flight:
        """The record with that accelerometer's reading larger by the share `value`."""
        channel = f"a{component}"
        return replace(flight, **{channel: getattr(flight, channel) * (1.0 + value)})


class AccelPosition(RecordEffect):
    """The accelerometers sit elsewhere than the record declares."""

    name = "accel_position"
    title = "position of the accelerometers"
    claims = "the accelerometers sit off their declared place, and sense the rotation's accelerations there"
    source = "report, Appendix B; errata E10 and E11"
    kind = "instrument"

    def components(self, flight: Flight) -> tuple[Component, ...]:
        """One offset for each body axis: true less declared place."""
        sizes = flight.instruments.accel_position
        return tuple(Component(axis, "m", size) for axis, size in zip(_AXES, sizes, strict=True))

    def perturb(self, flight: Flight, component: str, value: float) -> Flight:
        """The record with the declared place that much short of the true one."""
        place = list(flight.vehicle.accelerometer_position)
        place[_AXES.index(component)] -= value
        return replace(
            flight, vehicle=replace(flight.vehicle, accelerometer_position=(place[0], place[1], place[2]))
        )


class AccelMisalignment(RecordEffect):
    """The accelerometers' axes are turned by a small rotation against the body's: a reading gains f x m."""

    name = "accel_misalignment"
    title = "misalignment of the accelerometers"
    claims = "the accelerometers' axes are turned against the body's, so that the transverse ones read axial force"
    source = "report, Appendix B"
    kind = "instrument"

    def components(self, flight: Flight) -> tuple[Component, ...]:
        """The rotation about each body axis."""
        sizes = flight.instruments.accel_misalignment
        return tuple(Component(axis, "rad", size) for axis, size in zip(_AXES, sizes, strict=True))

    def perturb(self, flight: Flight, component: str, value: float) -> Flight:
        """The record of accelerometers that are turned by `value` rad more about that body axis."""
        return turned(flight, ("ax", "ay", "az"), component, value)


@hookimpl
def brv_hypo_record_effects() -> Sequence[RecordEffect]:
    """The effects of this module."""
    return [AccelBias(), AccelScale(), AccelMisalignment(), AccelPosition()]
