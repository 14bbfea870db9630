"""What the record declares of vehicle and air, and errs by: inertia, dynamic pressure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import ClassVar

from brv_hypo.flight.record import Flight
from brv_hypo.mechanisms import Component, RecordEffect, hookimpl


class Declared(RecordEffect):
    """What the record declares is larger than the truth by a share, of which `flight.instruments` has the size."""

    kind = "instrument"
    component: ClassVar[str] = "scale"

    def components(self, flight: Flight) -> tuple[Component, ...]:
        """The relative error."""
        return (Component(self.component, "1", getattr(flight.instruments, self.name)[0]),)


class DynamicPressureScale(Declared):
    """The record's dynamic pressure is a constant factor too large."""

    name, family = "dynamic_pressure_scale", "air"
    title = "scale error of the dynamic pressure"
    claims = "the dynamic pressure, and with it every coefficient, is off by a constant factor"
    source = "Morelli and Klein, Aircraft System Identification, 2016, chapter 10 (data compatibility)"

    def perturb(self, flight: Flight, component: str, value: float) -> Flight:
        """The record with a dynamic pressure larger by the share `value`."""
        return replace(flight, dynamic_pressure=flight.dynamic_pressure * (1.0 + value))


class InertiaRatio(Declared):
    """The declared Ix / I is too large: the coupling of roll and transverse rates comes out wrong."""

    name = "inertia_ratio"
    title = "error of the ratio of inertias"
    claims = "spin inertia over transverse inertia is off by a constant factor"
    source = "report, Eq. 2.3"
    component = "ratio"

    def perturb(self, flight: Flight, component: str, value: float) -> Flight:
        """The record with a declared spin inertia larger by the share `value`."""
        return replace(flight, vehicle=replace(flight.vehicle, ixx=flight.vehicle.ixx * (1.0 + value)))


class Inertia(Declared):
    """The declared inertia is too large, spin and transverse alike: every moment comes out in proportion."""

    name = "inertia"
    title = "error of the inertia"
    claims = "the inertia, and with it every moment, is off by a constant factor"
    source = "report, Eq. 2.3"

    def perturb(self, flight: Flight, component: str, value: float) -> Flight:
        """The record with declared inertias larger by the share `value`."""
        vehicle = flight.vehicle
        larger = replace(vehicle, ixx=vehicle.ixx * (1.0 + value), iyy=vehicle.iyy * (1.0 + value))
        return replace(flight, vehicle=larger)


@hookimpl
def brv_hypo_record_effects() -> Sequence[RecordEffect]:
    """The effects of this module."""
    return [DynamicPressureScale(), InertiaRatio(), Inertia()]
