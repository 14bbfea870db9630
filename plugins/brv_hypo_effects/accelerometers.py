"""Errors of the accelerometers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from brv_hypo.flight.record import Flight
from brv_hypo.mechanisms import RecordEffect, hookimpl
from brv_hypo_effects.triads import Triad, TriadBias, TriadScale, turned


class AccelBias(TriadBias):
    """A constant added to each accelerometer."""

    name = "accel_bias"
    title = "bias of the accelerometers"
    claims = "an accelerometer reads a constant too much"
    source = "report, Appendix B"
    prefix = "a"
    units = "m/s^2"


class AccelScale(TriadScale):
    """A scale error of each accelerometer."""

    name = "accel_scale"
    title = "scale error of the accelerometers"
    claims = "an accelerometer reads a constant factor too much"
    source = "report, Appendix B"
    prefix = "a"


class AccelPosition(Triad):
    """The accelerometers sit elsewhere than the record declares: true less declared place along each body axis."""

    name = "accel_position"
    title = "position of the accelerometers"
    claims = "the accelerometers sit off their declared place, and sense the rotation's accelerations there"
    source = "report, Appendix B; errata E10 and E11"
    units = "m"

    def perturb(self, flight: Flight, component: str, value: float) -> Flight:
        """The record with the declared place that much short of the true one."""
        place = list(flight.vehicle.accelerometer_position)
        place[self.axes.index(component)] -= value
        return replace(
            flight, vehicle=replace(flight.vehicle, accelerometer_position=(place[0], place[1], place[2]))
        )


class AccelMisalignment(Triad):
    """The accelerometers' axes are turned by a small rotation against the body's: a reading gains f x m."""

    name = "accel_misalignment"
    title = "misalignment of the accelerometers"
    claims = "the accelerometers' axes are turned against the body's, so that the transverse ones read axial force"
    source = "report, Appendix B"
    units = "rad"

    def perturb(self, flight: Flight, component: str, value: float) -> Flight:
        """The record of accelerometers that are turned by `value` rad more about that body axis."""
        return turned(flight, ("ax", "ay", "az"), component, value)


@hookimpl
def brv_hypo_record_effects() -> Sequence[RecordEffect]:
    """The effects of this module."""
    return [AccelBias(), AccelScale(), AccelMisalignment(), AccelPosition()]
