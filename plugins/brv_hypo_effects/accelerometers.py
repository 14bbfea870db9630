"""Errors of the accelerometers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from brv_hypo.flight.record import Flight
from brv_hypo.mechanisms import RecordEffect, hookimpl

_AXES = ("x", "y", "z")


class AccelBias(RecordEffect):
    """A constant added to each accelerometer."""

    name = "accel_bias"
    title = "bias of the accelerometers"
    claims = "an accelerometer reads a constant too much"
    source = "report, Appendix B"
    kind = "instrument"

    def components(self) -> tuple[tuple[str, str, float], ...]:
        """One bias for each accelerometer."""
        return tuple((axis, "m/s^2", 0.05) for axis in _AXES)

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

    def components(self) -> tuple[tuple[str, str, float], ...]:
        """One scale error for each accelerometer."""
        return tuple((axis, "1", 5e-3) for axis in _AXES)

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

    def components(self) -> tuple[tuple[str, str, float], ...]:
        """One offset for each body axis: true less declared place."""
        return tuple((axis, "m", 5e-3) for axis in _AXES)

    def perturb(self, flight: Flight, component: str, value: float) -> Flight:
        """The record with the declared place that much short of the true one."""
        place = list(flight.vehicle.accelerometer_position)
        place[_AXES.index(component)] -= value
        return replace(
            flight, vehicle=replace(flight.vehicle, accelerometer_position=(place[0], place[1], place[2]))
        )


@hookimpl
def brv_hypo_record_effects() -> Sequence[RecordEffect]:
    """The effects of this module."""
    return [AccelBias(), AccelScale(), AccelPosition()]
