"""What errors of three sensors along the body axes do to their channels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import ClassVar

import numpy as np

from brv_hypo.flight.record import Flight
from brv_hypo.mechanisms import Component, RecordEffect


class Triad(RecordEffect):
    """One error of each of three sensors, or body axes; `flight.instruments` has the sizes under the effect's name."""

    kind = "instrument"
    axes: ClassVar[tuple[str, str, str]] = ("x", "y", "z")
    """Names of the components; behind the `prefix`, of their channels."""
    prefix: ClassVar[str] = ""
    units: ClassVar[str]

    def components(self, flight: Flight) -> tuple[Component, ...]:
        """One of each sensor, or about or along each axis."""
        sizes = getattr(flight.instruments, self.name)
        return tuple(Component(axis, self.units, size) for axis, size in zip(self.axes, sizes, strict=True))


class TriadBias(Triad):
    """A constant added to each of the sensors."""

    def perturb(self, flight: Flight, component: str, value: float) -> Flight:
        """The record with `value` more on that channel."""
        channel = f"{self.prefix}{component}"
        return replace(flight, **{channel: getattr(flight, channel) + value})


class TriadScale(Triad):
    """A scale error of each of the sensors."""

    units = "1"

    def perturb(self, flight: Flight, component: str, value: float) -> Flight:
        """The record with that channel larger by the share `value`."""
        channel = f"{self.prefix}{component}"
        return replace(flight, **{channel: getattr(flight, channel) * (1.0 + value)})


def turned(flight: Flight, channels: Sequence[str], axis: str, angle: float) -> Flight:
    """The record with the sensors of these three channels turned by `angle` rad about a body axis: v gains v x m."""
    x, y, z = (np.asarray(getattr(flight, name), dtype=float) for name in channels)
    if axis == "x":
        read = (x, y + angle * z, z - angle * y)
    elif axis == "y":
        read = (x - angle * z, y, z + angle * x)
    else:
        read = (x + angle * y, y - angle * x, z)
    return replace(flight, **dict(zip(channels, read, strict=True)))  # type: ignore[arg-type]


def sheared(flight: Flight, channels: Sequence[str], pair: str, angle: float) -> Flight:
    """The record with the sensors of two body axes turned by `angle` rad toward each other: each reads of the other."""
    first, second = (channels["xyz".index(axis)] for axis in pair)
    one, other = (np.asarray(getattr(flight, name), dtype=float) for name in (first, second))
    return replace(flight, **{first: one + angle * other, second: other + angle * one})  # type: ignore[arg-type]
