"""Equations of motion and measurement equations of Section 4.4, as the likelihood takes them.

With k = Ix / I, Q = q_inf S d / I, Phi the integral of the measured roll rate and transverse pairs y + i z
times exp(i Phi) ("de-rolled"), the states omega = q + i r and zeta = v + i w follow

    omega' = i (k p + (1 - k) e) omega + Q (C_m + i C_n) exp(i Phi)
    zeta'  = i u omega + i e zeta - (q_inf S / m) C_N (alpha / sin alpha) zeta / V + g - w'

with p measured, e its error, w the wind. De-rolled states turn as slowly as the nose does, whatever the roll rate.
Outputs are q, r, a_y, a_z in body axes. Errors of record, vehicle and air come in as courses (`record_errors`): k, Q,
q_inf, S / m are the true ones; zeta is V times the true direction, V as measured.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Generic, TypeVar

import numpy as np
from numpy.polynomial.legendre import legval

from brv_hypo.arrays import ComplexArray, FloatArray
from brv_hypo.identification.knots import averaged, kink, on_grid, placed
from brv_hypo.identification.moments import MomentModel, Values
from brv_hypo.identification.nodes import ROW, SLOPES, Context, has_knot
from brv_hypo.identification.readings import alpha_over_sine, lever_force
from brv_hypo.identification.record_errors import (
    ACCELEROMETERS,
    CROSSFLOW,
    FORCE_SCALE_ERROR,
    GYROS,
    MOMENT_SCALE_ERROR,
    MOMENTS,
    PRESSURE_ERROR,
    RATIO_ERROR,
    ROLL_RATE_ERROR,
    SPEED_ERROR,
)
from brv_hypo.identification.structure import of_flight
from brv_hypo.likelihood import Delayed
from brv_hypo.model.columns import Column
from brv_hypo.model.common_time import OwnTime
from brv_hypo.motion.frames import angle_of_attack, angle_rates, windward_meridian
from brv_hypo.motion.inputs import PRESSURE, ROLL_RATE
from brv_hypo.motion.motion import Motion

GRAVITY = ("gravity x", "gravity y", "gravity z")
"""m/s^2 in body axes of the first sample."""
FORCE_BEND = "C_Nalpha3_force"
"""1/rad^3: what the normal-force slope gains with the square of alpha."""
RATE_ERRORS = (ROLL_RATE_ERROR, *CROSSFLOW)
"""Errors that change the rates of alpha and of the meridian at a given state."""
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
    here: Point
    own: OwnTime | None = None

    @cached_property
    def on_grid(self) -> tuple[ComplexArray, list[int], ComplexArray]:
        """The accelerations times their courses (columns, n), as `kink` has them where a knot lies between nodes; the
        columns with a knot, and what the angular rate lacks there per unit of each (columns with a knot, n), rad/s.
        """
        time, half, u = self.here.time, self.here.input("half"), self.here.u
        on_grid_too, knotted = self.acceleration.copy(), [j for j, c in enumerate(self.columns) if has_knot(c)]
        lacking = np.empty((len(knotted), time.size), dtype=complex)
        for k, j in enumerate(knotted):
            row, shape = SLOPES + 4 * k, self.acceleration[j]
            here = placed(self.columns[j].course, time, half, self.own)
            first, second = kink(*here)
            slope, curvature = u[row] + 1j * u[row + 1], u[row + 2] + 1j * u[row + 3]
            on_grid_too[j] = on_grid(*here) * shape - first * slope + second * curvature
            lacking[k] = first * shape - 2.0 * second * slope
        return on_grid_too, knotted, lacking

    def averaged(self, block: float) -> ComplexArray:
        """The accelerations (columns, n) times what a block of so many seconds sees of their courses."""
        if block not in self._averaged:
            out = self.acceleration.copy()
            for own, column in zip(out, self.columns, strict=True):
                if has_knot(column):
                    course, time, _ = placed(column.course, self.here.time, self.here.input("half"), self.own)
                    own *= averaged(course, time, block)
            self._averaged[block] = out
        return self._averaged[block]

    @cached_property
    def _averaged(self) -> dict[float, ComplexArray]:
        return {}


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

    def on(self, contexts: Sequence[Context]) -> VehicleModel:
        """The model on segments that were laid out anew; nothing of the old ones is remembered."""
        return VehicleModel(self.moments, contexts, self.force_names, self.span)

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
        courses, knotted, missing = self.shapes(here, theta, delayed or {}).on_grid
        weights = self._coefficients(theta)
        acceleration, lacking = weights @ courses, weights[knotted] @ missing
        scale = self._moment_share(context, theta)
        acceleration, lacking = np.asarray(acceleration * scale), np.asarray(lacking * scale)
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
        omega = here.omega * here.to_body
        force = self._force(here, context, theta) * here.to_body
        arm = context.vehicle.accelerometer_position
        if any(arm):
            shapes = self.shapes(here, theta, delayed or {})
            acceleration = self._coefficients(theta) @ shapes.averaged(context.block)
            scaled = acceleration * self._moment_share(context, theta)
            omega_rate = self._omega_rate(here, context, theta, scaled)
            body_rate = omega_rate * here.to_body - 1j * here.input("p") * omega
            p = here.input("p") - self._roll_rate_error(context, theta)
            force = force + lever_force(arm, omega, body_rate, p, here.input("p_rate"))
        return _rows(omega + _pair(GYROS, context, theta), force + _pair(ACCELEROMETERS, context, theta))

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
        columns, planes = self.moments.planes(now, past, theta, here.input("half"), context.own)
        scale = here.input("pressure") * context.vehicle.moment_scale
        turn = scale * np.exp(-1j * now.windward_meridian) * np.conj(here.to_body)
        return Shapes(columns, planes * turn, planes, now, tuple(past.values()), here, context.own)

    def _motion(self, at: Point, context: Context, theta: Values) -> Motion:
        """The motion of a point; it depends on the parameters of forces and gravity through its rates only.

        What noise leaves in the inputs does too little to the rates for a mechanism to feel it.
        """
        rates = self._rate_values(context, theta) if self.moments.uses_rates else ()
        key = (at.omega.tobytes(), at.zeta.tobytes(), at.time.tobytes(), context.flight, context.start, rates)
        return self._motions(key, lambda: self._moving(at, context, theta))

    def _coefficients(self, theta: Values) -> FloatArray:
        return np.array([theta[name] for name in self.moments.structure.names])

    def _context(self, u: FloatArray) -> Context:
        return self.contexts[round(float(u[ROW["segment"], 0]))]

    def _omega_rate(
        self, here: Point, context: Context, theta: Values, acceleration: ComplexArray
    ) -> ComplexArray:
        k = context.vehicle.inertia_ratio * (1.0 - _error(RATIO_ERROR, context, theta))
        p = here.input("p")
        error = self._roll_rate_error(context, theta)
        tolerated = _pair(MOMENTS, context, theta) * np.conj(here.to_body)
        return np.asarray(1j * (k * p + (1.0 - k) * error) * here.omega + acceleration + tolerated)

    def _zeta_rate(self, here: Point, context: Context, theta: Values) -> ComplexArray:
        forward = np.sqrt(np.maximum(here.input("speed") ** 2 - np.abs(here.zeta) ** 2, 0.0))
        error = self._roll_rate_error(context, theta)
        size = [theta[of_flight(name, context.flight)] for name in GRAVITY]
        first = ROW["gravity_xy"]
        gravity = size @ here.u[first : first + 3] + 1j * (size @ here.u[first + 3 : first + 6])
        gained = gravity + here.input("air_y") + 1j * here.input("air_z") + _pair(CROSSFLOW, context, theta)
        gained = gained + self._force(here, context, theta)
        slower = 1.0 + _error(SPEED_ERROR, context, theta)
        return np.asarray(1j * forward * here.omega + 1j * error * here.zeta + slower * gained)

    def _force(self, at: Point, context: Context, theta: Values) -> ComplexArray:
        """Specific force across the body in de-rolled axes (n,), m/s^2."""
        xi = at.zeta / at.input("speed")
        vehicle = context.vehicle
        scale = at.input("pressure") * (vehicle.reference_area / vehicle.mass) * self._pressure_share(context, theta)
        scale = scale * (1.0 - _error(FORCE_SCALE_ERROR, context, theta))
        slope = legval(self.scaled(context.course_time(at.time)), [theta[name] for name in self.force_names])
        slope = slope + theta[FORCE_BEND] * angle_of_attack(xi) ** 2
        return np.asarray(-scale * slope * alpha_over_sine(xi) * xi)

    def scaled(self, time: FloatArray) -> FloatArray:
        """Times that courses are told in from -1 to 1 over the span."""
        return np.asarray((2.0 * time - self.span[0] - self.span[1]) / (self.span[1] - self.span[0]))

    def _roll_rate_error(self, context: Context, theta: Values) -> FloatArray | float:
        """Measured less true roll rate (n,), rad/s."""
        return _error(ROLL_RATE, context, theta) + _error(ROLL_RATE_ERROR, context, theta)

    def _pressure_share(self, context: Context, theta: Values) -> FloatArray | float:
        """True dynamic pressure over the measured one (n,)."""
        return 1.0 - _error(PRESSURE, context, theta) - _error(PRESSURE_ERROR, context, theta)

    def _moment_share(self, context: Context, theta: Values) -> FloatArray | float:
        """True angular acceleration per unit coefficient over the declared one (n,)."""
        return self._pressure_share(context, theta) * (1.0 - _error(MOMENT_SCALE_ERROR, context, theta))

    def _rate_values(self, context: Context, theta: Values) -> tuple[object, ...]:
        """Parameters that change the rates of alpha and of the meridian at given states."""
        gravity = (theta[of_flight(name, context.flight)] for name in GRAVITY)
        errors = (np.asarray(_error(name, context, theta)).tobytes() for name in RATE_ERRORS)
        return (*(theta[name] for name in (*self.force_names, FORCE_BEND)), *gravity, *errors)

    def _moving(self, at: Point, context: Context, theta: Values) -> Motion:
        theta = {**theta, **_without_noise(context.flight)}
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


def _without_noise(flight: int) -> dict[str, float]:
    """Inputs without what noise leaves in them, and without errors that do too little to the rates to be felt."""
    quiet = (ROLL_RATE, PRESSURE, PRESSURE_ERROR, SPEED_ERROR, FORCE_SCALE_ERROR)
    return {of_flight(name, flight): 0.0 for name in quiet}


def _error(name: str, context: Context, theta: Values) -> FloatArray | float:
    """A course of the flight's errors (n,); 0 where it has none of that name."""
    return theta.get(of_flight(name, context.flight), 0.0)


def _pair(names: tuple[str, str], context: Context, theta: Values) -> ComplexArray:
    """Two courses as one complex pair."""
    return np.asarray(_error(names[0], context, theta) + 1j * _error(names[1], context, theta))


def _rows(first: ComplexArray, second: ComplexArray) -> FloatArray:
    return np.stack([first.real, first.imag, second.real, second.imag])
