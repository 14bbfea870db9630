"""Errors of the instruments: bias, scale, misalignment and place of gyros and accelerometers, and their clocks.

bias           y + b
scale          y (1 + s)
misalignment   v + v x m, and for gyros also two axes that are not orthogonal
position       specific force at a place other than the declared one
time skew      the channels of one instrument, late by a constant time against the gyros
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import ClassVar

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.flight.record import Flight
from brv_hypo.mechanisms import Component, RecordEffect, hookimpl

# ---- What errors of three sensors along the body axes do to their channels ----


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


_GYROS = ("p", "q", "r")
_PAIRS = ("yz", "xz", "xy")


class GyroBias(TriadBias):
    """A constant added to each rate gyro."""

    name, family = "gyro_bias", "gyros"
    title = "bias of the rate gyros"
    claims = "a rate gyro reads a constant too much"
    source = "report, Appendix B"
    axes = _GYROS
    units = "rad/s"


class GyroScale(TriadScale):
    """A scale error of each rate gyro."""

    name, family = "gyro_scale", "gyros"
    title = "scale error of the rate gyros"
    claims = "a rate gyro reads a constant factor too much"
    source = "report, Appendix B"
    axes = _GYROS


class GyroMisalignment(RecordEffect):
    """Each gyro's axis is turned a little against the body's: together, a rotation, or two toward each other.

    A rotation makes a reading gain omega x m; two axes that are not orthogonal read of each other with the same sign.
    """

    name, family = "gyro_misalignment", "gyros"
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


# ---- Errors of the accelerometers ----


class AccelBias(TriadBias):
    """A constant added to each accelerometer."""

    name, family = "accel_bias", "accelerometers"
    title = "bias of the accelerometers"
    claims = "an accelerometer reads a constant too much"
    source = "report, Appendix B"
    prefix = "a"
    units = "m/s^2"


class AccelScale(TriadScale):
    """A scale error of each accelerometer."""

    name, family = "accel_scale", "accelerometers"
    title = "scale error of the accelerometers"
    claims = "an accelerometer reads a constant factor too much"
    source = "report, Appendix B"
    prefix = "a"


class AccelPosition(Triad):
    """The accelerometers sit elsewhere than the record declares: true less declared place along each body axis."""

    name, family = "accel_position", "accelerometers"
    title = "position of the accelerometers"
    claims = "the accelerometers sit off their declared place, and sense the rotation's accelerations there"
    source = "report, Appendix B; errata E10 and E11"
    units = "m"

    def perturb(self, flight: Flight, component: str, value: float) -> Flight:
        """The record with the declared place that much short of the true one."""
        place = list(flight.vehicle.accelerometer_position)
        place[self.axes.index(component)] -= value
        return replace(flight, vehicle=replace(flight.vehicle, accelerometer_position=(place[0], place[1], place[2])))


class AccelMisalignment(Triad):
    """The accelerometers' axes are turned by a small rotation against the body's: a reading gains f x m."""

    name, family = "accel_misalignment", "accelerometers"
    title = "misalignment of the accelerometers"
    claims = "the accelerometers' axes are turned against the body's, so that the transverse ones read axial force"
    source = "report, Appendix B"
    units = "rad"

    def perturb(self, flight: Flight, component: str, value: float) -> Flight:
        """The record of accelerometers that are turned by `value` rad more about that body axis."""
        return turned(flight, ("ax", "ay", "az"), component, value)


_INSTRUMENTS = {
    "gyros": ("p", "q", "r"),
    "accelerometers": ("ax", "ay", "az"),
    "air data": ("velocity", "dynamic_pressure", "mach", "reynolds"),
}
# Its clock is the record's: all instruments late together are a motion that much later, which nothing tells but the
# ends of the record, where a shifted channel has to be continued.
_CLOCK = "gyros"


class TimeSkew(RecordEffect):
    """The channels of one instrument hold what was so a constant time before their stamp, that of the gyros."""

    name = "time_skew"
    title = "time skew between instruments"
    claims = "one instrument is late against the gyros by a constant time"
    source = "Morelli and Klein, Aircraft System Identification, 2016, chapter 10 (data compatibility)"
    kind = "instrument"

    def components(self, flight: Flight) -> tuple[Component, ...]:
        """One delay for each instrument beside the gyros; the tolerance is that of one clock against another."""
        size = float(flight.instruments.time_skew[0])
        return tuple(Component(name, "s", size) for name in _INSTRUMENTS if name != _CLOCK)

    def plantable(self, flight: Flight) -> tuple[str, ...]:
        """Any instrument may be late, the gyros too: the others are early against them then."""
        return tuple(_INSTRUMENTS)

    def perturb(self, flight: Flight, component: str, value: float) -> Flight:
        """The record with that instrument late by `value` s more.

        Shifted in the spectrum, so that white noise stays white: interpolation between samples would smooth it.
        """
        late: dict[str, FloatArray] = {
            name: _late(channel, flight.segments, value / flight.step)
            for name in _INSTRUMENTS[component]
            if (channel := getattr(flight, name)) is not None
        }
        return replace(flight, **late)  # type: ignore[arg-type]


def _late(channel: FloatArray, segments: Sequence[tuple[int, int]], samples: float) -> FloatArray:
    """The channel (n,) some samples later, each segment by itself.

    What is left of a straight line between its ends, continued as an odd function, is periodic and smooth.
    """
    out = np.array(channel, dtype=float)
    for a, b in segments:
        place = np.arange(b - a) / max(b - a - 1, 1)
        first, last = channel[a], channel[b - 1]
        left = channel[a:b] - first - (last - first) * place
        periodic = np.concatenate([left, -left[-2:0:-1]])
        turn = np.exp(-2j * np.pi * np.fft.rfftfreq(periodic.size) * samples)
        shifted = np.fft.irfft(np.fft.rfft(periodic) * turn, periodic.size)[: b - a]
        out[a:b] = shifted + first + (last - first) * (place - samples / max(b - a - 1, 1))
    return out


@hookimpl
def brv_hypo_record_effects() -> Sequence[RecordEffect]:
    """The effects of this module."""
    return [
        GyroBias(),
        GyroScale(),
        GyroMisalignment(),
        AccelBias(),
        AccelScale(),
        AccelMisalignment(),
        AccelPosition(),
        TimeSkew(),
    ]
