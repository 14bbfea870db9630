"""Errors of the rate gyros."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from brv_hypo.flight.record import Flight
from brv_hypo.mechanisms import RecordEffect, hookimpl


class GyroBias(RecordEffect):
    """A constant added to each rate gyro."""

    name = "gyro_bias"
    title = "bias of the rate gyros"
    claims = "a rate gyro reads a constant too much"
    source = "report, Appendix B"
    kind = "instrument"

    def components(self) -> tuple[tuple[str, str, float], ...]:
        """One bias for each gyro."""
        return tuple((name, "rad/s", 1e-3) for name in ("p", "q", "r"))

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

    def components(self) -> tuple[tuple[str, str, float], ...]:
        """One scale error for each gyro."""
        return tuple((name, "1", 1e-3) for name in ("p", "q", "r"))

    def perturb(self, flight: Flight, component: str, value: float) -> Flight:
        """The record with that gyro's reading larger by the share `value`."""
        return replace(flight, **{component: getattr(flight, component) * (1.0 + value)})


@hookimpl
def brv_hypo_record_effects() -> Sequence[RecordEffect]:
    """The effects of this module."""
    return [GyroBias(), GyroScale()]
