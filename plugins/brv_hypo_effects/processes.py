"""Processes: what a baseline with constant coefficients and a record with constant errors lack of any real flight.

Moments have a known shape and an unknown history: powers of alpha in its plane and across it, the transverse rates,
what is fixed in the body, lobes of the cross-section. One unit of a spline of an instrument's or the air's drift is
that of an ordinary instrument or day: a gyro by 0.05 deg/s, an accelerometer by 5 mg, the air by 2 % of density and
1 m/s of wind.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Self

import numpy as np

from brv_hypo.arrays import ComplexArray, FloatArray
from brv_hypo.flight.record import Flight
from brv_hypo.mechanisms import MomentProcess, RecordProcess, hookimpl
from brv_hypo.motion.motion import Motion
from brv_hypo_effects.record import with_wind


class Listed(MomentProcess):
    """One of the processes that `brv_hypo_mechanisms` lists, by what it is called and how many splines it has."""

    name: str = "listed"  # type: ignore[misc]
    title: str = "a process of the list"  # type: ignore[misc]
    family: str = "stiffness"  # type: ignore[misc]
    splines: int = 16  # type: ignore[misc]
    across: bool = False  # of alpha's plane, instead of in it

    @classmethod
    def of(cls, name: str, family: str, splines: int, title: str, **shape: Any) -> Self:
        """The process of that name and title, of a family, with so many splines for each shape."""
        return cls(name=name, family=family, splines=splines, title=title, **shape)


class Powers(Listed):
    """Powers of alpha, in its plane or across it."""

    powers: tuple[int, ...] = (1,)

    def shapes(self, motion: Motion) -> Sequence[ComplexArray]:
        """One for each power."""
        turn = 1j if self.across else 1.0
        return tuple(np.asarray(turn * motion.alpha**power) for power in self.powers)


class Rates(Listed):
    """The transverse rates, or these turned by a right angle, times a power of alpha."""

    power: int = 0

    def shapes(self, motion: Motion) -> Sequence[ComplexArray]:
        """The rates of the axis across the wind times d / 2V, in the plane of alpha and across it (n,)."""
        turn, about = 1j if self.across else 1.0, motion.alpha * (motion.p - motion.windward_meridian_rate)
        rates = np.asarray((motion.alpha_rate + 1j * about) * motion.rate_factor)
        return (np.asarray(motion.alpha**self.power * (turn * rates)),)


class Body(Listed):
    """A moment in body axes."""

    def shapes(self, motion: Motion) -> Sequence[ComplexArray]:
        """Pitch and yaw, as the plane of alpha has them."""
        turn = np.exp(1j * motion.windward_meridian)
        return turn, 1j * turn


class Lobes(Listed):
    """A moment of a cross-section of so many lobes; of two, unequal stiffness in pitch and yaw."""

    lobes: int = 2

    def shapes(self, motion: Motion) -> Sequence[ComplexArray]:
        """Cosine and sine of so many times the meridian."""
        turn = motion.alpha * np.exp(1j * self.lobes * motion.windward_meridian)
        return turn, 1j * turn


class UnequalInertia(Listed):
    """Iy and Iz that differ, or I_yz: J conj((q' + i r') - i p (q + i r)) / q_inf by Euler's equations."""

    def shapes(self, motion: Motion) -> Sequence[ComplexArray]:
        """Of half the difference and of the product of inertia."""
        change = 0.0 if motion.transverse_acceleration is None else motion.transverse_acceleration
        rates = change - 1j * motion.p * (motion.q + 1j * motion.r)
        turned = motion.to_plane(np.asarray(np.conj(rates) / motion.dynamic_pressure, dtype=complex))
        return turned, 1j * turned


@hookimpl
def brv_hypo_mechanisms() -> Sequence[MomentProcess]:
    """Every process of the moment."""
    return [
        Powers.of("static_change", "stiffness", 16, "static moment that changes along the flight"),
        Powers.of("static_bend", "stiffness", 5, "static moment that bends with the angle of attack", powers=(2, 3)),
        Powers.of("side_change", "side", 16, "side moment that changes along the flight", across=True),
        Powers.of("side_bend", "side", 5, "side moment that bends with alpha", across=True, powers=(2, 3)),
        Rates.of("damping_change", "rate", 12, "damping that changes along the flight"),
        Rates.of("cross_damping_change", "rate", 12, "cross-damping moment that changes along the flight", across=True),
        Rates.of("damping_bend", "rate", 5, "damping that changes with the angle of attack", power=2),
        Rates.of("cross_damping_bend", "rate", 5, "cross-damping that changes with alpha", across=True, power=2),
        Body.of("body_change", "body", 16, "moment fixed in the body that grows or fades"),
        Body.of("flow", "body", 40, "random moment of the flow"),
        Lobes.of("two_lobes", "harmonic", 5, "moment of a two-lobed cross-section"),
        Lobes.of("three_lobes", "harmonic", 5, "moment of a three-lobed cross-section", lobes=3),
        UnequalInertia.of("unequal_inertia", "harmonic", 1, "moments of inertia that differ in pitch and yaw"),
    ]


class _Added(RecordProcess):
    """A history that is added to a channel."""

    def changed(self, flight: Flight, channel: str, history: FloatArray) -> Flight:
        """The record with so much (n,) more in that channel."""
        return replace(flight, **{channel: getattr(flight, channel) + history})


class GyroDrift(_Added):
    """A gyro's bias that wanders."""

    name, family, kind = "gyro_drift", "gyros", "instrument"
    title = "drift of the gyros' bias"
    channels, splines, units, size = ("p", "q", "r"), 8, "rad/s", float(np.radians(0.05))


class AccelDrift(_Added):
    """An accelerometer's bias that wanders, vibration rectified included."""

    name, family, kind = "accel_drift", "accelerometers", "instrument"
    title = "drift of the accelerometers' bias"
    channels, splines, units, size = ("ax", "ay", "az"), 8, "m/s^2", 0.05


class DensityChange(RecordProcess):
    """Air that is denser or thinner than the record's dynamic pressure says, by a share that changes."""

    name, family, kind = "density_change", "air", "environment"
    title = "air density off the record's, by a share that changes"
    channels, splines, units, size = ("dynamic_pressure",), 10, "1", 0.02

    def changed(self, flight: Flight, channel: str, history: FloatArray) -> Flight:
        """The record with its dynamic pressure larger by a share (n,)."""
        return replace(flight, dynamic_pressure=flight.dynamic_pressure * (1.0 + history))


class Turbulence(RecordProcess):
    """Wind across the track that the record does not know, from shear to gusts."""

    name, family, kind = "turbulence", "air", "environment"
    title = "wind across the track that changes"
    channels, splines, units, size = ("y", "z"), 36, "m/s", 1.0

    def changed(self, flight: Flight, channel: str, history: FloatArray) -> Flight:
        """The record with so much (n,) m/s less of the wind known."""
        return with_wind(flight, channel, history)


@hookimpl
def brv_hypo_record_effects() -> Sequence[RecordProcess]:
    """Every process of the record."""
    return [GyroDrift(), AccelDrift(), DensityChange(), Turbulence()]
