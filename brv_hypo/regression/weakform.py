"""The weak form of Eq. 2.3: moment columns integrated to transverse rates.

With omega = q + i r, k = Ix / I and Phi the integral of (1 - k) p, the pitch and yaw equations are one,

    d/dt (omega e^{i Phi}) = (q_inf S d / I) (C_m + i C_n) e^{i Phi},

so the derolled rate is a constant plus the integrals of the columns, and its error is the gyro's own: no
differentiation colours it. Integrals run on cubic splines; jumps and ramps at a knot are exact combinations
of the antiderivatives, for any time of the knot, so that knots can be refined continuously.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import CubicSpline

from brv_hypo.arrays import ComplexArray, FloatArray
from brv_hypo.flight.record import Flight
from brv_hypo.model.time_variation import TimeFunction

Antiderivative = Callable[[FloatArray | float], ComplexArray]


@dataclass(frozen=True)
class Integrals:
    """Antiderivatives of a column g and of (t - origin) g over one segment, as functions of time."""

    time: FloatArray
    integrand: ComplexArray

    @cached_property
    def plain(self) -> Antiderivative:
        """Antiderivative of g."""
        return CubicSpline(self.time, self.integrand).antiderivative()

    @cached_property
    def plain_at_samples(self) -> ComplexArray:
        """Antiderivative of g at the segment's samples (m,)."""
        return self.plain(self.time)

    @cached_property
    def first_at_samples(self) -> ComplexArray:
        """Antiderivative of (t - origin) g at the segment's samples (m,)."""
        return self.first(self.time)

    @cached_property
    def first(self) -> Antiderivative:
        """Antiderivative of (t - origin) g, which ramps need."""
        return CubicSpline(self.time, (self.time - self.time[0]) * self.integrand).antiderivative()


@dataclass(frozen=True)
class WeakSegment:
    """One contiguous part of a flight: derolled rates `observed` (m,) rad/s, factor of the integrand (m,)."""

    time: FloatArray
    observed: ComplexArray
    factor: ComplexArray
    flight: int
    rows: slice

    def integrate(self, body_moment: ComplexArray) -> Integrals:
        """Antiderivatives for a column C_m + i C_n (m,) on the segment's samples."""
        return Integrals(self.time, self.factor * body_moment)

    def column(self, integrals: Integrals, course: TimeFunction) -> ComplexArray:
        """The column times its course, integrated from the segment's first sample to each sample (m,)."""
        origin, last = float(self.time[0]), float(self.time[-1])
        start = min(max(course.start, origin), last)
        stop = min(max(course.stop, origin), last)
        plain = self._between(integrals.plain, integrals.plain_at_samples, start, stop)
        if course.kind != "ramp":
            return plain
        slope = self._between(integrals.first, integrals.first_at_samples, start, stop)
        after = self._between(integrals.plain, integrals.plain_at_samples, stop, last)
        held = min(course.stop, last) - course.start
        return slope + (origin - course.start) * plain + held * after

    def _between(
        self, integral: Antiderivative, at_samples: ComplexArray, start: float, stop: float
    ) -> ComplexArray:
        """Integral from `start` to each sample, 0 before it and constant after `stop` (m,)."""
        first, after = np.searchsorted(self.time, [start, stop])
        out = np.zeros(self.time.size, dtype=complex)
        base = integral(start)
        out[first:after] = at_samples[first:after] - base
        out[after:] = integral(stop) - base
        return out


def weak_segments(flight: Flight, index: int, shortest: int = 8) -> tuple[WeakSegment, ...]:
    """The usable segments of a flight (those of at least `shortest` samples), with their derolled rates."""
    derotation = np.exp(1j * (1.0 - flight.vehicle.inertia_ratio) * integral(flight.time, flight.p))
    factor = derotation * flight.dynamic_pressure * flight.vehicle.moment_scale
    observed = (flight.q + 1j * flight.r) * derotation
    return tuple(
        WeakSegment(flight.time[a:b], observed[a:b], factor[a:b], index, slice(a, b))
        for a, b in flight.segments
        if b - a >= shortest
    )


def integral(time: FloatArray, rate: FloatArray) -> FloatArray:
    """Integral of a sampled rate from the first sample, by cubic spline."""
    return np.asarray(CubicSpline(time, rate).antiderivative()(time), dtype=float)
