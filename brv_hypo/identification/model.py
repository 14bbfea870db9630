"""Equations of motion and measurement equations of Section 4.4, as the likelihood takes them.

With k = Ix / I, Q = q_inf S d / I, Phi the integral of the measured roll rate and transverse pairs y + i z times
exp(i Phi) ("de-rolled"), the states omega = q + i r and zeta = v + i w follow

    omega' = i (k p + (1 - k) e) omega + Q (C_m + i C_n) exp(i Phi)
    zeta'  = i u omega + i e zeta - (q_inf S / m) C_N (alpha / sin alpha) zeta / V + g

with p measured, e its error. De-rolled states turn as slowly as the nose does, whatever the roll rate. Outputs are
q, r, a_y, a_z in body axes.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.polynomial.legendre import legval

from brv_hypo.arrays import ComplexArray, FloatArray
from brv_hypo.design.columns import Column
from brv_hypo.identification.courses import averaged, kink, on_grid
from brv_hypo.identification.instruments import (
    ROLL_RATE_ERRORS,
    TIME_SKEW,
    InstrumentReadings,
    lever_force,
    of_flight,
)
from brv_hypo.identification.moments import MomentModel, Values
from brv_hypo.identification.nodes import ROW, SLOPES, Context, alpha_over_sine, has_knot
from brv_hypo.likelihood import Delayed
from brv_hypo.motion.frames import angle_of_attack, angle_rates, windward_meridian
from brv_hypo.motion.motion import Motion

_REMEMBERED = 3


@dataclass(frozen=True)
class Point:
    """States and inputs at some instants (n,), as complex pairs; `time` s."""

    time: FloatArray
    omega: ComplexArray
    zeta: ComplexArray
    u: FloatArray

    def input(self, name: str) -> FloatArray:
        """One input (n,)."""
        return self.u[ROW[name]]

    @property
    def to_body(self) -> ComplexArray:
        """exp(-i Phi): turns de-rolled pairs into body axes."""
        return np.exp(-1j * self.input("roll"))


@dataclass(frozen=True)
class Shapes:
    """What the coefficients multiply at some instants: angular accelerations in de-rolled axes, (columns, n) rad/s^2."""

    columns: tuple[Column, ...]
    acceleration: ComplexArray
    in_plane: ComplexArray
    motion: Motion


@dataclass(frozen=True)
class VehicleModel:
    """The functions that `likelihood.fit` takes; `contexts` by the input "segment".

    `span` (start, stop) s scales the drift of the normal-force slope, of `force_names` coefficients.
    """

    moments: MomentModel
    contexts: Sequence[Context]
    force_names: tuple[str, ...]
    span: tuple[float, float]
    _recent: OrderedDict[tuple[object, ...], Shapes] = field(default_factory=OrderedDict, compare=False, repr=False)

    def dynamics(
        self, x: FloatArray, u: FloatArray, theta: Values, t: FloatArray, delayed: Mapping[str, Delayed] | None = None
    ) -> FloatArray:
        """d/dt of (Re omega, Im omega, Re zeta, Im zeta), (4, n)."""
        here, context = point(x, u, t), self._context(u)
        shapes = self.shapes(here, theta, delayed or {})
        weights = self._coefficients(theta)
        half = here.input("half")
        acceleration = np.zeros(t.size, dtype=complex)
        lacking = np.zeros(t.size, dtype=complex)
        row = SLOPES
        for weight, column, shape in zip(weights, shapes.columns, shapes.acceleration, strict=True):
            if not has_knot(column):
                acceleration += weight * shape
                continue
            first, second = kink(column.course, t, half)
            slope, curvature = u[row] + 1j * u[row + 1], u[row + 2] + 1j * u[row + 3]
            acceleration += weight * (on_grid(column.course, t, half) * shape - first * slope + second * curvature)
            lacking += weight * (first * shape - 2.0 * second * slope)
            row += 4
        moving = replace(here, omega=here.omega + lacking)
        return _rows(self._omega_rate(here, context, theta, acceleration), self._zeta_rate(moving, context, theta))

    def outputs(
        self, x: FloatArray, u: FloatArray, theta: Values, t: FloatArray, delayed: Mapping[str, Delayed] | None = None
    ) -> FloatArray:
        """q, r (rad/s), a_y, a_z (m/s^2) as the instruments read them, (4, n)."""
        here, context = point(x, u, t), self._context(u)
        delayed = delayed or {}
        readings = InstrumentReadings(theta, context.flight)
        p = here.input("p") - readings.roll_rate_error(here.input("p"))
        omega = here.omega * here.to_body
        seen = self._late(here, context, theta, delayed)
        force = self._force(seen, context, theta) * seen.to_body
        arm = readings.arm(context.vehicle.accelerometer_position)
        if any(arm):
            shapes = self.shapes(here, theta, delayed)
            courses = [
                averaged(column.course, t, context.block) if has_knot(column) else 1.0 for column in shapes.columns
            ]
            acceleration = sum(
                weight * course * shape
                for weight, course, shape in zip(self._coefficients(theta), courses, shapes.acceleration, strict=True)
            )
            omega_rate = self._omega_rate(here, context, theta, np.asarray(acceleration))
            body_rate = omega_rate * here.to_body - 1j * here.input("p") * omega
            force = force + lever_force(arm, omega, body_rate, p, here.input("p_rate"))
        return _rows(readings.gyros(omega, p), readings.accelerometers(force, here.input("axial")))

    def shapes(self, here: Point, theta: Values, delayed: Mapping[str, Delayed]) -> Shapes:
        """The columns at some instants; remembered, because most parameters leave them as they are."""
        context = self._context(here.u)
        key = self._key(here, context, theta, delayed)
        if key in self._recent:
            return self._recent[key]
        now = self._motion(here, context, theta)
        past = {}
        for name in self.moments.structure.delays:
            before = point(delayed[name].x, delayed[name].u, here.time - theta[name])
            past[theta[name]] = self._motion(before, context, theta)
        columns, planes = self.moments.planes(now, past, theta, here.input("half"))
        scale = here.input("pressure") * context.vehicle.moment_scale
        turn = scale * np.exp(-1j * now.windward_meridian) * np.conj(here.to_body)
        found = Shapes(columns, planes * turn, planes, now)
        self._recent[key] = found
        if len(self._recent) > _REMEMBERED:
            self._recent.popitem(last=False)
        return found

    def _key(
        self, here: Point, context: Context, theta: Values, delayed: Mapping[str, Delayed]
    ) -> tuple[object, ...]:
        """What the columns depend on."""
        roll = (of_flight(name, context.flight) for name in ROLL_RATE_ERRORS)
        gravity = (of_flight(f"gravity {axis}", context.flight) for axis in "xyz")
        names = (*self.moments.shape_parameters, *self.force_names, *roll, *gravity)
        past = tuple(delayed[name].x.tobytes() for name in self.moments.structure.delays)
        return (
            here.omega.tobytes(), here.zeta.tobytes(), past, here.time.tobytes(),
            tuple(theta.get(name) for name in names), context.start, context.flight,
        )

    def _coefficients(self, theta: Values) -> list[float]:
        return [theta[name] for name in self.moments.structure.names]

    def _context(self, u: FloatArray) -> Context:
        return self.contexts[round(float(u[ROW["segment"], 0]))]

    def _omega_rate(self, here: Point, context: Context, theta: Values, acceleration: ComplexArray) -> ComplexArray:
        k = context.vehicle.inertia_ratio
        p = here.input("p")
        error = InstrumentReadings(theta, context.flight).roll_rate_error(p)
        return np.asarray(1j * (k * p + (1.0 - k) * error) * here.omega + acceleration)

    def _zeta_rate(self, here: Point, context: Context, theta: Values) -> ComplexArray:
        forward = np.sqrt(np.maximum(here.input("speed") ** 2 - np.abs(here.zeta) ** 2, 0.0))
        error = InstrumentReadings(theta, context.flight).roll_rate_error(here.input("p"))
        size = [theta[of_flight(f"gravity {axis}", context.flight)] for axis in "xyz"]
        first = ROW["gravity_xy"]
        gravity = size @ here.u[first : first + 3] + 1j * (size @ here.u[first + 3 : first + 6])
        force = self._force(here, context, theta)
        return np.asarray(1j * forward * here.omega + 1j * error * here.zeta + force + gravity)

    def _force(self, at: Point, context: Context, theta: Values) -> ComplexArray:
        """Specific force across the body in de-rolled axes (n,), m/s^2."""
        xi = at.zeta / at.input("speed")
        scale = at.input("pressure") * (context.vehicle.reference_area / context.vehicle.mass)
        middle, reach = 0.5 * (self.span[0] + self.span[1]), 0.5 * (self.span[1] - self.span[0])
        slope = legval((at.time - middle) / reach, [theta[name] for name in self.force_names])
        return np.asarray(-scale * slope * alpha_over_sine(xi) * xi)

    def _late(self, here: Point, context: Context, theta: Values, delayed: Mapping[str, Delayed]) -> Point:
        """Where the accelerometers' clock stands."""
        name = of_flight(TIME_SKEW, context.flight)
        if name not in delayed:
            return here
        return point(delayed[name].x, delayed[name].u, here.time - theta[name])

    def _motion(self, at: Point, context: Context, theta: Values) -> Motion:
        speed, p, turn = at.input("speed"), at.input("p"), at.to_body
        xi, omega = at.zeta / speed * turn, at.omega * turn
        slowing = at.zeta * at.input("speed_rate") / speed
        rate = (self._zeta_rate(at, context, theta) - slowing) / speed * turn - 1j * p * xi
        alpha_rate, meridian_rate = angle_rates(xi, rate)
        meridian = windward_meridian(xi)
        turns = np.round((at.input("meridian") - meridian) / (2.0 * np.pi))
        before = np.minimum(at.time - context.start, 0.0) * context.meridian_rate
        return Motion(
            time=at.time, alpha=angle_of_attack(xi), alpha_rate=alpha_rate,
            windward_meridian=meridian + 2.0 * np.pi * turns + before, windward_meridian_rate=meridian_rate,
            p=p, q=omega.real, r=omega.imag, velocity=speed, dynamic_pressure=at.input("pressure"),
            mach=at.input("mach"), reynolds=at.input("reynolds"), in_plane_moment=np.zeros_like(speed),
            reference_length=context.vehicle.reference_length,
        )


def point(x: FloatArray, u: FloatArray, time: FloatArray) -> Point:
    """States (4, n) and inputs as pairs."""
    return Point(time, x[0] + 1j * x[1], x[2] + 1j * x[3], u)


def _rows(first: ComplexArray, second: ComplexArray) -> FloatArray:
    return np.stack([first.real, first.imag, second.real, second.imag])
