"""Equations of motion and measurement equations of Section 4.4, as the likelihood takes them.

With k = Ix / I, Q = q_inf S d / I, Phi the integral of the measured roll rate and transverse pairs y + i z
times exp(i Phi) ("de-rolled"), the states omega = q + i r and zeta = v + i w follow

    omega' = i (k p + (1 - k) e) omega + Q (C_m + i C_n) exp(i Phi)
    zeta'  = i u omega + i e zeta - (q_inf S / m) C_N (alpha / sin alpha) zeta / V + g

with p measured, e its error. De-rolled states turn as slowly as the nose does, whatever the roll rate.
Outputs are q, r, a_y, a_z in body axes.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Generic, TypeVar

import numpy as np
from numpy.polynomial.legendre import legval

from brv_hypo.arrays import ComplexArray, FloatArray
from brv_hypo.identification.inputs import PRESSURE, ROLL_RATE
from brv_hypo.identification.instruments import (
    ROLL_RATE_ERRORS,
    TIME_SKEW,
    InstrumentReadings,
    lever_force,
    of_flight,
)
from brv_hypo.identification.knots import averaged, kink, on_grid
from brv_hypo.identification.moments import MomentModel, Values
from brv_hypo.identification.nodes import ROW, SLOPES, Context, alpha_over_sine, has_knot
from brv_hypo.likelihood import Delayed
from brv_hypo.model.columns import Column
from brv_hypo.motion.frames import angle_of_attack, angle_rates, windward_meridian
from brv_hypo.motion.motion import Motion

_REMEMBERED = 6
T = TypeVar("T")


@dataclass(frozen=True)
class Point:
    """States and inputs at some instants (n,), as complex pairs; `time` s."""

    time: FloatArray
    omega: ComplexArray
    zeta: ComplexArray
    u: FloatArray

    def input(self, name: str) -> FloatArray:
        """One input (n,)."""
        return np.asarray(self.u[ROW[name]])

    @property
    def to_body(self) -> ComplexArray:
        """exp(-i Phi): turns de-rolled pairs into body axes."""
        return np.asarray(np.exp(-1j * self.input("roll")))


class Memory(Generic[T]):
    """The last few results by key: most parameters leave the columns as they are, and a moved state only one
    motion.
    """

    def __init__(self) -> None:
        self._known: OrderedDict[tuple[object, ...], T] = OrderedDict()

    def __call__(self, key: tuple[object, ...], compute: Callable[[], T]) -> T:
        """The result for `key`, computed where it is not known."""
        if key not in self._known:
            self._known[key] = compute()
            if len(self._known) > _REMEMBERED:
                self._known.popitem(last=False)
        return self._known[key]


@dataclass(frozen=True)
class Shapes:
    """What the coefficients multiply at some instants: angular accelerations in de-rolled axes, (columns, n)
    rad/s^2.
    """

    columns: tuple[Column, ...]
    acceleration: ComplexArray
    in_plane: ComplexArray
    motion: Motion
    past: tuple[Motion, ...]


@dataclass(frozen=True)
class VehicleModel:
    """The functions that `likelihood.fit` takes; `contexts` by the input "segment".

    `span` (start, stop) s scales the drift of the normal-force slope, of `force_names` coefficients.
    """

    moments: MomentModel
    contexts: Sequence[Context]
    force_names: tuple[str, ...]
    span: tuple[float, float]
    _shapes: Memory[Shapes] = field(default_factory=Memory, compare=False, repr=False)
    _motions: Memory[Motion] = field(default_factory=Memory, compare=False, repr=False)

    def dynamics(
        self,
        x: FloatArray,
        u: FloatArray,
        theta: Values,
        t: FloatArray,
        delayed: Mapping[str, Delayed] | None = None,
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
            acceleration += weight * (
                on_grid(column.course, t, half) * shape - first * slope + second * curvature
            )
            lacking += weight * (first * shape - 2.0 * second * slope)
            row += 4
        density = self._pressure(here, context, theta) / here.input("pressure")
        acceleration, lacking = acceleration * density, lacking * density
        moving = replace(here, omega=here.omega + lacking)
        return _rows(
            self._omega_rate(here, context, theta, acceleration), self._zeta_rate(moving, context, theta)
        )

    def outputs(
        self,
        x: FloatArray,
        u: FloatArray,
        theta: Values,
        t: FloatArray,
        delayed: Mapping[str, Delayed] | None = None,
    ) -> FloatArray:
        """q, r (rad/s), a_y, a_z (m/s^2) as the instruments read them, (4, n)."""
        here, context = point(x, u, t), self._context(u)
        delayed = delayed or {}
        readings = InstrumentReadings(theta, context.flight)
        p = here.input("p") - self._roll_rate_error(here, context, theta)
        omega = here.omega * here.to_body
        seen = self._late(here, context, theta, delayed)
        force = self._force(seen, context, theta) * seen.to_body
        arm = readings.arm(context.vehicle.accelerometer_position)
        if any(arm):
            shapes = self.shapes(here, theta, delayed)
            courses = [
                averaged(column.course, t, context.block) if has_knot(column) else 1.0
                for column in shapes.columns
            ]
            acceleration = sum(
                weight * course * shape
                for weight, course, shape in zip(
                    self._coefficients(theta), courses, shapes.acceleration, strict=True
                )
            )
            density = self._pressure(here, context, theta) / here.input("pressure")
            omega_rate = self._omega_rate(here, context, theta, acceleration * density)
            body_rate = omega_rate * here.to_body - 1j * here.input("p") * omega
            force = force + lever_force(arm, omega, body_rate, p, here.input("p_rate"))
        return _rows(readings.gyros(omega, p), readings.accelerometers(force, here.input("axial")))

    def shapes(self, here: Point, theta: Values, delayed: Mapping[str, Delayed]) -> Shapes:
        """The columns at some instants."""
        context = self._context(here.u)
        now = self._motion(here, context, theta)
        past = {}
        for name in self.moments.structure.delays:
            before = point(delayed[name].x, delayed[name].u, here.time - theta[name])
            past[theta[name]] = self._motion(before, context, theta)
        key = (id(now), *map(id, past.values()), *(theta[name] for name in self.moments.shape_parameters))
        return self._shapes(key, lambda: self._evaluated(here, context, now, past, theta))

    def _evaluated(
        self, here: Point, context: Context, now: Motion, past: Mapping[float, Motion], theta: Values
    ) -> Shapes:
        columns, planes = self.moments.planes(now, past, theta, here.input("half"))
        scale = here.input("pressure") * context.vehicle.moment_scale
        turn = scale * np.exp(-1j * now.windward_meridian) * np.conj(here.to_body)
        return Shapes(columns, planes * turn, planes, now, tuple(past.values()))

    def _motion(self, at: Point, context: Context, theta: Values) -> Motion:
        """The motion of a point; it depends on the parameters of forces and gravity through its rates only.

        What noise leaves in the inputs does too little to the rates for a mechanism to feel it.
        """
        rates = self._rate_values(context, theta) if self.moments.uses_rates else ()
        key = (at.omega.tobytes(), at.zeta.tobytes(), at.time.tobytes(), context.flight, context.start, rates)
        return self._motions(key, lambda: self._moving(at, context, theta))

    def _coefficients(self, theta: Values) -> list[float]:
        return [theta[name] for name in self.moments.structure.names]

    def _context(self, u: FloatArray) -> Context:
        return self.contexts[round(float(u[ROW["segment"], 0]))]

    def _omega_rate(
        self, here: Point, context: Context, theta: Values, acceleration: ComplexArray
    ) -> ComplexArray:
        k = context.vehicle.inertia_ratio
        p = here.input("p")
        error = self._roll_rate_error(here, context, theta)
        return np.asarray(1j * (k * p + (1.0 - k) * error) * here.omega + acceleration)

    def _zeta_rate(self, here: Point, context: Context, theta: Values) -> ComplexArray:
        forward = np.sqrt(np.maximum(here.input("speed") ** 2 - np.abs(here.zeta) ** 2, 0.0))
        error = self._roll_rate_error(here, context, theta)
        size = [theta[of_flight(f"gravity {axis}", context.flight)] for axis in "xyz"]
        first = ROW["gravity_xy"]
        gravity = size @ here.u[first : first + 3] + 1j * (size @ here.u[first + 3 : first + 6])
        force = self._force(here, context, theta)
        return np.asarray(1j * forward * here.omega + 1j * error * here.zeta + force + gravity)

    def _force(self, at: Point, context: Context, theta: Values) -> ComplexArray:
        """Specific force across the body in de-rolled axes (n,), m/s^2."""
        xi = at.zeta / at.input("speed")
        scale = self._pressure(at, context, theta) * (context.vehicle.reference_area / context.vehicle.mass)
        slope = legval(self.scaled(at.time), [theta[name] for name in self.force_names])
        return np.asarray(-scale * slope * alpha_over_sine(xi) * xi)

    def scaled(self, time: FloatArray) -> FloatArray:
        """Time from -1 to 1 over the span."""
        return np.asarray((2.0 * time - self.span[0] - self.span[1]) / (self.span[1] - self.span[0]))

    def _roll_rate_error(self, at: Point, context: Context, theta: Values) -> FloatArray:
        """Measured less true roll rate (n,), rad/s."""
        instrument = InstrumentReadings(theta, context.flight).roll_rate_error(at.input("p"))
        return np.asarray(instrument + theta[of_flight(ROLL_RATE, context.flight)])

    def _pressure(self, at: Point, context: Context, theta: Values) -> FloatArray:
        """True dynamic pressure (n,), Pa."""
        return np.asarray(at.input("pressure") * (1.0 - theta[of_flight(PRESSURE, context.flight)]))

    def _late(self, here: Point, context: Context, theta: Values, delayed: Mapping[str, Delayed]) -> Point:
        """Where the accelerometers' clock stands."""
        name = of_flight(TIME_SKEW, context.flight)
        if name not in delayed:
            return here
        return point(delayed[name].x, delayed[name].u, here.time - theta[name])

    def _rate_values(self, context: Context, theta: Values) -> tuple[float | None, ...]:
        """Parameters that change the rates of alpha and of the meridian at given states."""
        own = (*ROLL_RATE_ERRORS, *(f"gravity {axis}" for axis in "xyz"))
        return (
            *(theta[n] for n in self.force_names),
            *(theta.get(of_flight(n, context.flight)) for n in own),
        )

    def _moving(self, at: Point, context: Context, theta: Values) -> Motion:
        theta = {**theta, **_quiet(context.flight)}
        speed, p, turn = at.input("speed"), at.input("p"), at.to_body
        xi, omega = at.zeta / speed * turn, at.omega * turn
        slowing = at.zeta * at.input("speed_rate") / speed
        rate = (self._zeta_rate(at, context, theta) - slowing) / speed * turn - 1j * p * xi
        alpha_rate, meridian_rate = angle_rates(xi, rate)
        meridian = windward_meridian(xi)
        turns = np.round((at.input("meridian") - meridian) / (2.0 * np.pi))
        before = np.minimum(at.time - context.start, 0.0) * context.meridian_rate
        return Motion(
            time=at.time,
            alpha=angle_of_attack(xi),
            alpha_rate=alpha_rate,
            windward_meridian=meridian + 2.0 * np.pi * turns + before,
            windward_meridian_rate=meridian_rate,
            p=p,
            q=omega.real,
            r=omega.imag,
            velocity=speed,
            dynamic_pressure=at.input("pressure"),
            mach=at.input("mach"),
            reynolds=at.input("reynolds"),
            in_plane_moment=np.zeros_like(speed),
            reference_length=context.vehicle.reference_length,
        )


def point(x: FloatArray, u: FloatArray, time: FloatArray) -> Point:
    """States (4, n) and inputs as pairs."""
    return Point(time, x[0] + 1j * x[1], x[2] + 1j * x[3], u)


def _quiet(flight: int) -> dict[str, float]:
    """Inputs without what noise leaves in them."""
    return {of_flight(ROLL_RATE, flight): 0.0, of_flight(PRESSURE, flight): 0.0}


def _rows(first: ComplexArray, second: ComplexArray) -> FloatArray:
    return np.stack([first.real, first.imag, second.real, second.imag])
