"""Errors of the record: instruments and their clocks, what is declared of vehicle and air, wind.

A reading y becomes y + b (bias), y (1 + s) (scale); vectors become v + v x m (misalignment).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import ClassVar

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.flight.record import ACCELEROMETERS, GYROS, Flight
from brv_hypo.mechanisms import Component, RecordEffect, hookimpl


class Triad(RecordEffect):
    """One error of each of three sensors, or body axes; `flight.instruments` has the sizes under the effect's name."""

    kind = "instrument"
    source = "report, Appendix B"
    axes: ClassVar[tuple[str, str, str]] = ("x", "y", "z")  # of the components; behind the `prefix`, of their channels
    prefix: ClassVar[str] = ""
    units: ClassVar[str]

    def components(self, flight: Flight) -> tuple[Component, ...]:
        """One of each sensor, or about or along each axis."""
        sizes = getattr(flight.instruments, self.name)
        return tuple(Component(axis, self.units, size) for axis, size in zip(self.axes, sizes, strict=True))

    def perturb(self, flight: Flight, component: str, value: float) -> Flight:
        """The record with `value` more on that channel, or, without unit, larger by that share."""
        channel = f"{self.prefix}{component}"
        reads = getattr(flight, channel)
        return replace(flight, **{channel: reads * (1.0 + value) if self.units == "1" else reads + value})


def turned(flight: Flight, channels: Sequence[str], axis: str, angle: float) -> Flight:
    """The record with the sensors of these three channels turned by `angle` rad about a body axis: v gains v x m."""
    vectors = np.array([getattr(flight, name) for name in channels], dtype=float)
    read = vectors + np.cross(vectors, angle * np.eye(3)["xyz".index(axis)], axisa=0, axisc=0)
    return replace(flight, **dict(zip(channels, read, strict=True)))


def sheared(flight: Flight, channels: Sequence[str], pair: str, angle: float) -> Flight:
    """The record with the sensors of two body axes turned by `angle` rad toward each other: each reads of the other."""
    first, second = (channels["xyz".index(axis)] for axis in pair)
    one, other = (np.asarray(getattr(flight, name), dtype=float) for name in (first, second))
    return replace(flight, **{first: one + angle * other, second: other + angle * one})  # type: ignore[arg-type]


_PAIRS = ("yz", "xz", "xy")


class GyroBias(Triad):
    """A constant added to each rate gyro."""

    name, title, family = "gyro_bias", "bias of the rate gyros", "gyros"
    claims = "a rate gyro reads a constant too much"
    axes = GYROS
    units = "rad/s"


class GyroScale(Triad):
    """A scale error of each rate gyro."""

    name, title, family = "gyro_scale", "scale error of the rate gyros", "gyros"
    claims = "a rate gyro reads a constant factor too much"
    axes = GYROS
    units = "1"


class GyroMisalignment(Triad):
    """Each gyro's axis is turned a little against the body's: together, a rotation, or two toward each other.

    A rotation makes a reading gain omega x m; two axes that are not orthogonal read of each other with the same sign.
    """

    name, title, family = "gyro_misalignment", "misalignment of the rate gyros", "gyros"
    claims = "the gyros' axes are turned against the body's, so that the transverse ones read roll rate"
    units = "rad"

    def components(self, flight: Flight) -> tuple[Component, ...]:
        """The rotation about each body axis, and how far each two axes are from orthogonal, shared between them.

        Axes that are turned independently leave half of the sum of their squares to either.
        """
        rotations = super().components(flight)
        sizes = {axis.name: axis.size for axis in rotations}
        shared = (0.5 * math.hypot(*(sizes[axis] for axis in pair)) for pair in _PAIRS)
        return rotations + tuple(Component(pair, "rad", size) for pair, size in zip(_PAIRS, shared, strict=True))

    def perturb(self, flight: Flight, component: str, value: float) -> Flight:
        """The record of gyros turned by `value` rad more about that body axis, or toward each other."""
        change = sheared if component in _PAIRS else turned
        return change(flight, GYROS, component, value)


class AccelBias(Triad):
    """A constant added to each accelerometer."""

    name, title, family = "accel_bias", "bias of the accelerometers", "accelerometers"
    claims = "an accelerometer reads a constant too much"
    prefix = "a"
    units = "m/s^2"


class AccelScale(Triad):
    """A scale error of each accelerometer."""

    name, title, family = "accel_scale", "scale error of the accelerometers", "accelerometers"
    claims = "an accelerometer reads a factor too much"
    prefix = "a"
    units = "1"


class AccelPosition(Triad):
    """The accelerometers sit elsewhere than the record declares: true less declared place along each body axis."""

    name, title, family = "accel_position", "position of the accelerometers", "accelerometers"
    claims = "the accelerometers sit off their declared place, and sense the rotation's accelerations there"
    source = "report, Appendix B; errata E10 and E11"
    units = "m"

    def perturb(self, flight: Flight, component: str, value: float) -> Flight:
        """The record with the declared place that much short of the true one."""
        place = flight.vehicle.accelerometer_position - value * np.eye(3)[self.axes.index(component)]
        x, y, z = place.tolist()
        return replace(flight, vehicle=replace(flight.vehicle, accelerometer_position=(x, y, z)))


class AccelMisalignment(Triad):
    """The accelerometers' axes are turned by a small rotation against the body's: a reading gains f x m."""

    name, title, family = "accel_misalignment", "misalignment of the accelerometers", "accelerometers"
    claims = "the accelerometers' axes are turned against the body's, so that the transverse ones read axial force"
    units = "rad"

    def perturb(self, flight: Flight, component: str, value: float) -> Flight:
        """The record of accelerometers that are turned by `value` rad more about that body axis."""
        return turned(flight, ACCELEROMETERS, component, value)


# The gyros' clock is the record's: all instruments late together are a motion that much later, which nothing shows but
# the ends of the record, where a shifted channel has to be continued.
_OTHERS = {"accelerometers": ACCELEROMETERS, "air data": ("velocity", "dynamic_pressure", "mach", "reynolds")}


class TimeSkew(RecordEffect):
    """The channels of one instrument hold what was so a constant time before their stamp, that of the gyros."""

    name, title = "time_skew", "time skew between instruments"
    claims = "one instrument is late against the gyros by a constant time"
    source = "Morelli and Klein, Aircraft System Identification, 2016, chapter 10 (data compatibility)"
    kind = "instrument"

    def components(self, flight: Flight) -> tuple[Component, ...]:
        """One delay for each instrument beside the gyros; the tolerance is that of one clock against another."""
        size = float(flight.instruments.time_skew[0])
        return tuple(Component(name, "s", size) for name in _OTHERS)

    def perturb(self, flight: Flight, component: str, value: float) -> Flight:
        """The record with that instrument late by `value` s more; the gyros too: the others are early then.

        Shifted in the spectrum, so that white noise stays white: interpolation between samples would smooth it.
        """
        late: dict[str, FloatArray] = {
            name: _late(channel, flight.segments, value / flight.step)
            for name in (_OTHERS | {"gyros": GYROS})[component]
            if (channel := getattr(flight, name)) is not None
        }
        return replace(flight, **late)  # type: ignore[arg-type]


def _late(channel: FloatArray, segments: Sequence[tuple[int, int]], samples: float) -> FloatArray:
    """The channel (n,) some samples later, by segments: a straight line, and the rest as an odd periodic function."""
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


class GapTurn(RecordEffect):
    """What the vehicle turned by, and was pushed, in each gap of the record beyond what the samples about it say.

    Channels in a gap follow from those about it (`flight.clock.crossed`), attitude and velocity after it from these.
    Each errs, about the roll axis and along two that do not roll, by as much as what was measured elsewhere makes.
    """

    name, title = "gap_turn", "attitude and velocity across gaps"
    claims = "a gap of the record hides a turn, or a push"
    source = "dead reckoning: what a gap hides is an error of attitude and velocity from there on"
    kind = "instrument"
    axes: ClassVar = {"x": ("rad", "p", "p")} | dict.fromkeys("yz", ("rad", "q", "r"))
    axes |= dict.fromkeys(("vy", "vz"), ("m/s", "ay", "az"))

    def components(self, flight: Flight) -> tuple[Component, ...]:
        """Of each axis and gap."""
        measured, found = flight.measured(), list[Component]()
        for number, gap in enumerate(flight.gaps, start=1):
            for axis, (units, *channels) in self.axes.items():
                rates = np.stack([getattr(flight, channel)[measured] for channel in channels])
                size = float(np.sqrt(np.mean(np.var(rates, axis=1)))) * (gap.stop - gap.start) * flight.step
                found += [Component(f"{axis} {number}", units, size)] if size > 0.0 else []
        return tuple(found)

    def perturb(self, flight: Flight, component: str, value: float) -> Flight:
        """The record with so much more in that gap, evenly."""
        axis, number = component.split()
        gap, (_, one, other) = flight.gaps[int(number) - 1], self.axes[axis]
        more = np.zeros(flight.samples, dtype=complex)
        more[gap] = value / ((gap.stop - gap.start) * flight.step)
        if one != other:
            more[gap] *= np.exp(-1j * np.cumsum(flight.p[gap]) * flight.step) * (1.0 if axis.endswith("y") else 1j)
        return replace(flight, **{other: getattr(flight, other) + more.imag, one: getattr(flight, one) + more.real})


class Declared(RecordEffect):
    """What the record declares is larger than the truth by a share, of which `flight.instruments` has the size."""

    kind = "instrument"
    component: ClassVar[str] = "scale"
    properties: ClassVar[tuple[str, ...]] = ()  # those of the vehicle

    def components(self, flight: Flight) -> tuple[Component, ...]:
        """The relative error."""
        return (Component(self.component, "1", getattr(flight.instruments, self.name)[0]),)

    def perturb(self, flight: Flight, component: str, value: float) -> Flight:
        """The record with declared properties larger by the share `value`."""
        larger = {name: getattr(flight.vehicle, name) * (1.0 + value) for name in self.properties}
        return replace(flight, vehicle=replace(flight.vehicle, **larger))


class DynamicPressureScale(Declared):
    """The record's dynamic pressure is a constant factor too large."""

    name, title, family = "dynamic_pressure_scale", "scale error of the dynamic pressure", "air"
    claims = "the dynamic pressure, and with it every coefficient, is off by a constant factor"
    source = "Morelli and Klein, Aircraft System Identification, 2016, chapter 10 (data compatibility)"

    def perturb(self, flight: Flight, component: str, value: float) -> Flight:
        """The record with a dynamic pressure larger by the share `value`."""
        return replace(flight, dynamic_pressure=flight.dynamic_pressure * (1.0 + value))


class InertiaRatio(Declared):
    """The declared Ix / I is too large: the coupling of roll and transverse rates comes out wrong."""

    name, title = "inertia_ratio", "error of the ratio of inertias"
    claims, source = "spin inertia over transverse inertia is off by a constant factor", "report, Eq. 2.3"
    component = "ratio"
    properties = ("ixx",)


class Inertia(Declared):
    """The declared inertia is too large, spin and transverse alike: every moment comes out in proportion."""

    name, title = "inertia", "error of the inertia"
    claims, source = "the inertia, and with it every moment, is off by a constant factor", "report, Eq. 2.3"
    properties = ("ixx", "iyy")


# Half waves that a slow wind makes over the record, the k-th 1/k as large as the first: so many, or one for so many
# metres of height, as waves in the atmosphere have vertical wavelengths of some kilometres, but no more than are worth
# their columns. Judgement; Opportunity's entry passes 43 km: its held-out error before any step is 3.7e-8 with 5, 2.2,
# 1.9, 1.6 and 1.7e-8 with 16, 20, 24 and 32.
WIND_HALF_WAVES = 5  # at least
WIND_HALF_WAVE_HEIGHT = 2000.0  # m
WIND_MOST_HALF_WAVES = 24  # at most
# Instants at which a step of the wind is tried first: the attitude's own errors follow all of it but what happens
# within a part of a second, so that one a grid's step away looks like nothing (with 16, 3 of 4 were misnamed).
WIND_STEP_INSTANTS = 48
WIND_STEP_CLOSER = 7  # instants tried next, over 3/4 of the spacing to either side


_AXES = {"y": 1, "z": 2}
_SHAPES = {"": np.cos, "s": np.sin}


def with_wind(flight: Flight, axis: str, speed: FloatArray) -> Flight:
    """The record with that wind (n,) m/s, along a body axis of the first sample, left unaccounted for."""
    wind = np.zeros((flight.samples, 3)) if flight.wind is None else flight.wind.copy()
    wind[:, _AXES[axis]] -= speed
    return replace(flight, wind=wind)


class Wind(RecordEffect):
    """A wind across the track that changes slowly: half waves over the record, the k-th 1/k as large as the first.

    Cosines and sines alike: cosines alone would hold the wind still at both ends. A constant wind is in the direction
    of the velocity at the start; wind along the track is in the record's `velocity` already.
    """

    name, title, family = "wind", "slowly changing wind", "air"
    claims = "the air moves across the track, slowly changing along the record"
    source = "kinematics of the velocity relative to the air"
    kind = "environment"

    def components(self, flight: Flight) -> tuple[Component, ...]:
        """Cosines and sines of 1, 2, ... half waves along body axes y and z of the first sample, rms the tolerance."""
        passed = 0.0 if flight.altitude is None else float(np.nanmax(flight.altitude) - np.nanmin(flight.altitude))
        count = min(max(WIND_HALF_WAVES, int(passed / WIND_HALF_WAVE_HEIGHT)), WIND_MOST_HALF_WAVES)
        shares = 1.0 / np.arange(1.0, count + 1.0)
        shares /= np.sqrt(np.sum(shares**2))
        return tuple(
            Component(f"{axis} {shape}{wave}", "m/s", float(share * flight.instruments.wind[place]))
            for axis, place in _AXES.items()
            for shape in _SHAPES
            for wave, share in enumerate(shares, start=1)
        )

    def perturb(self, flight: Flight, component: str, value: float) -> Flight:
        """The record with that much of one half wave left unaccounted for."""
        axis, wave = component.split()
        place = (flight.time - flight.time[0]) / (flight.time[-1] - flight.time[0])
        count = wave.removeprefix("s")
        return with_wind(flight, axis, value * _SHAPES[wave[: -len(count)]](np.pi * int(count) * place))


class WindStep(RecordEffect):
    """A step of the wind across the track at `time` s (None: the middle of the record), known to `spread` s.

    No channel senses it: the velocity relative to the air turns while the inertial velocity does not.
    A step along the track is in the record's `velocity` already.
    """

    name, title, family = "wind_step", "step of the wind", "air"
    claims = "from one instant on, the air moves across the track"
    source = "kinematics of the velocity relative to the air"
    kind = "environment"
    carried = False

    time: float | None = None
    spread: float | None = None

    def components(self, flight: Flight) -> tuple[Component, ...]:
        """Wind along the body axes y and z of the first sample."""
        return tuple(Component(axis, "m/s", flight.instruments.wind[place]) for axis, place in _AXES.items())

    def variants(self, flight: Flight) -> tuple[RecordEffect, ...]:
        """Instants over the record; once `time` and `spread` are set, 7 instants near it."""
        instants = np.linspace(flight.time[0], flight.time[-1], WIND_STEP_INSTANTS + 2)[1:-1]
        if self.time is not None and self.spread is not None:
            instants = self.time + self.spread * np.linspace(-0.75, 0.75, WIND_STEP_CLOSER)
        spread = float(instants[1] - instants[0])
        return tuple(self.model_copy(update={"time": time, "spread": spread}) for time in instants.tolist())

    def perturb(self, flight: Flight, component: str, value: float) -> Flight:
        """The record with that much wind left unaccounted for."""
        at = 0.5 * (flight.time[0] + flight.time[-1]) if self.time is None else self.time
        return with_wind(flight, component, np.where(flight.time >= at, value, 0.0))


@hookimpl
def brv_hypo_record_effects() -> Sequence[RecordEffect]:
    """The effects of this module."""
    gyros = [GyroBias(), GyroScale(), GyroMisalignment()]
    accelerometers = [AccelBias(), AccelScale(), AccelMisalignment(), AccelPosition()]
    declared = [DynamicPressureScale(), InertiaRatio(), Inertia()]
    return [*gyros, *accelerometers, TimeSkew(), GapTurn(), *declared, Wind(), WindStep()]
