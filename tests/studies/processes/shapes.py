"""Processes: a physical shape times an unknown smooth course in time, as cubic B-splines with a Gaussian amplitude.

Moments are `MomentProcess`, a mechanism with one term for each spline; drifts of instruments and air are
`CourseEffect`, a record effect with one component for each. One unit of an amplitude is `SIZES`' or, of a moment, the
rms of the static moment.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np
from scipy.interpolate import BSpline

from brv_hypo.arrays import ComplexArray, FloatArray
from brv_hypo.flight.record import Flight
from brv_hypo.mechanisms.contract import Component, Mechanism, RecordEffect, Term
from brv_hypo.motion.motion import Motion


def splines(time: FloatArray, first: float, last: float, count: int) -> FloatArray:
    """Cubic B-splines (n, count) that are even over [first, last] and sum to one; a column of ones for a count of 1."""
    if count == 1:
        return np.ones((time.size, 1))
    cells = count - 3
    place = np.clip((time - first) / (last - first), 0.0, 1.0 - 1e-12) * cells
    return np.asarray(BSpline.design_matrix(place, np.arange(-3.0, count + 1.0), 3).toarray())


# ---- Of instruments and air ----


class CourseEffect(RecordEffect):
    """A record effect that changes with time: components are a channel and the number of a spline."""

    title = claims = source = "a process"
    kind = "instrument"
    channels: ClassVar[tuple[str, ...]]
    count: ClassVar[int]
    units: ClassVar[str]
    size: ClassVar[float]

    def components(self, flight: Flight) -> tuple[Component, ...]:
        """Each channel's splines, of one unit each."""
        return tuple(
            Component(f"{channel} {k}", self.units, self.size) for channel in self.channels for k in range(self.count)
        )

    def perturb(self, flight: Flight, component: str, value: float) -> Flight:
        """The record with that much of one spline more."""
        channel, number = component.split()
        course = splines(flight.time, flight.time[0], flight.time[-1], self.count)[:, int(number)]
        return self.changed(flight, channel, value * course)

    def changed(self, flight: Flight, channel: str, course: FloatArray) -> Flight:
        """The record with a course (n,) added to a channel."""
        return replace(flight, **{channel: getattr(flight, channel) + course})


class GyroDrift(CourseEffect):
    """A gyro's bias that drifts."""

    name = "gyro_drift"
    channels, count, units, size = ("p", "q", "r"), 8, "rad/s", float(np.radians(0.05))


class AccelDrift(CourseEffect):
    """An accelerometer's bias that drifts."""

    name = "accel_drift"
    channels, count, units, size = ("ax", "ay", "az"), 8, "m/s^2", 0.05


class DensityCourse(CourseEffect):
    """Air that is denser or thinner than the record's dynamic pressure says, by the time."""

    name = "density_course"
    channels, count, units, size = ("dynamic_pressure",), 10, "1", 0.02

    def changed(self, flight: Flight, channel: str, course: FloatArray) -> Flight:
        """The record with a dynamic pressure that is larger by a relative course."""
        return replace(flight, dynamic_pressure=flight.dynamic_pressure * (1.0 + course))


class Turbulence(CourseEffect):
    """Wind across the track that changes within the record."""

    name = "turbulence"
    channels, count, units, size = ("y", "z"), 36, "m/s", 1.0

    def changed(self, flight: Flight, channel: str, course: FloatArray) -> Flight:
        """The record with a wind course that is not accounted for."""
        wind = np.zeros((flight.samples, 3)) if flight.wind is None else flight.wind.copy()
        wind[:, "xyz".index(channel)] -= course
        return replace(flight, wind=wind)


EFFECTS = (GyroDrift(), AccelDrift(), DensityCourse(), Turbulence())
FAMILIES = {
    **{"gyro_drift": "gyros", "accel_drift": "accelerometers", "density_course": "air", "turbulence": "air"},
    **{"static": "stiffness", "bend": "stiffness", "side": "side", "body": "body", "flow": "body"},
    **{"damping": "rate", "cross": "rate", "damping_alpha": "rate", "two": "harmonic", "three": "harmonic"},
}

# ---- Of the moment ----

# Splines of each process over the record.
COUNTS = {
    **{"static": 16, "side": 16, "damping": 12, "cross": 12, "damping_alpha": 1},
    **{"body": 16, "flow": 40, "two": 5, "three": 5, "bend": 1},
}


class MomentProcess(Mechanism):
    """A moment of one shape with a smooth course; `scale` makes the shape's rms one, `size` is that of one unit."""

    title = claims = source = "a process"
    which: str
    first: float
    last: float
    scale: float = 1.0
    size: float = 1.0

    def shapes(self, motion: Motion) -> list[ComplexArray]:
        """C_m,in + i C_n,side of each component on the motion."""
        alpha, turn = motion.alpha, np.exp(1j * motion.windward_meridian)
        across = alpha * (motion.p - motion.windward_meridian_rate)
        rates = (motion.alpha_rate + 1j * across) * motion.rate_factor
        found: dict[str, list[Any]] = {
            "static": [alpha + 0j],
            "bend": [alpha**3 + 0j, alpha**2 + 0j],
            "side": [1j * alpha],
            "damping": [rates],
            "cross": [1j * rates],
            "damping_alpha": [rates * alpha**2],
            "two": [alpha * turn**2, 1j * alpha * turn**2],
            "three": [alpha * turn**3, 1j * alpha * turn**3],
            "body": [turn, 1j * turn],
            "flow": [turn, 1j * turn],
        }
        return [np.asarray(shape / self.scale) for shape in found[self.which]]

    def terms(self, motion: Motion, theta: Mapping[str, float]) -> tuple[Term, ...]:
        """One term for each component and spline."""
        courses = self.size * splines(motion.time, self.first, self.last, COUNTS[self.which])
        products = [
            (f"{j} {k}", shape * course)
            for j, shape in enumerate(self.shapes(motion))
            for k, course in enumerate(courses.T)
        ]
        return tuple(Term(name, product.real.copy(), product.imag.copy()) for name, product in products)


_CLASSES = {name: type(f"Process_{name}", (MomentProcess,), {"name": f"process_{name}"}) for name in COUNTS}


def moment_processes(motion: Motion, size: float) -> list[MomentProcess]:
    """Every process on a motion, one unit of each of rms `size`."""
    found = []
    for name, kind in _CLASSES.items():
        plain = kind(which=name, first=float(motion.time[0]), last=float(motion.time[-1]))
        scale = float(np.sqrt(np.mean(np.abs(np.concatenate(plain.shapes(motion))) ** 2)))
        found.append(plain.model_copy(update={"scale": scale, "size": size}))
    return found
