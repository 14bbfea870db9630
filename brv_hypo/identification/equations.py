"""Equations of motion and measurement equations of Section 4.4, as the likelihood takes them.

With k = Ix / I, Q = q_inf S d / I, Phi the integral of the measured roll rate and transverse pairs y + i z times
exp(i Phi) ("de-rolled"), the states omega = q + i r and zeta = v + i w follow

    omega' = i (k p + (1 - k) e) omega + Q (C_m + i C_n) exp(i Phi)
    zeta'  = i u omega + i e zeta - (q_inf S / m) C_N (alpha / sin alpha) zeta / V + g - w'

with p measured, e its error, w the wind. De-rolled states turn as slowly as the nose does, whatever the roll
rate. Outputs are q, r, a_y, a_z in body axes. Errors of record, vehicle and air are time histories
(parameters.py): k, Q, q_inf, S / m are the true ones; zeta is V times the true direction, V as measured.

`MomentColumns` evaluates the regressors at a motion, `Shapes` has them as angular accelerations, and
`VehicleModel` has the functions that `likelihood.fit` takes.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from types import MappingProxyType
from typing import Generic, TypeVar

import numpy as np

from brv_hypo.arrays import ComplexArray, FloatArray
from brv_hypo.errors import UsageError
from brv_hypo.identification import parameters
from brv_hypo.identification.nodes import ROW, SLOPES, Context, has_knot, real_rows
from brv_hypo.likelihood import Delayed
from brv_hypo.linearisation.response import GRAVITY_ERRORS
from brv_hypo.mechanisms.contract import Mechanism
from brv_hypo.model.baseline import scaled
from brv_hypo.model.common_time import OwnTime
from brv_hypo.model.term import Regressor, Theta, evaluated, summed
from brv_hypo.motion.inputs import PRESSURE, ROLL_RATE
from brv_hypo.motion.motion import Motion, angle_of_attack, angle_rates, effective, windward_meridian

_REMEMBERED = 6
T = TypeVar("T")
FORCE_DRIFT = ("C_Nalpha_force", "C_Nalpha_force drift 1")  # 1/rad: the normal-force slope, and its drift over the span
FORCE_BEND = "C_Nalpha3_force"  # 1/rad^3: what the slope gains with the square of alpha
FORCES = (*FORCE_DRIFT, FORCE_BEND)
# What changes the rates of alpha and of the meridian at a state.
RATE_ERRORS = (parameters.ROLL_RATE_ERROR, *parameters.CROSSFLOW)
Values = Mapping[str, float]
AtDelays = Mapping[str, Delayed]  # states and inputs at the delays, by name


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

    @cached_property
    def to_body(self) -> ComplexArray:
        """exp(-i Phi): turns de-rolled pairs into body axes."""
        return np.asarray(np.exp(-1j * self.input("roll")))


def point(x: FloatArray, u: FloatArray, time: FloatArray) -> Point:
    """States (4, n) and inputs as pairs."""
    return Point(time, x[0] + 1j * x[1], x[2] + 1j * x[3], u)


class Memory(Generic[T]):
    """The last few results by key: most parameters leave the columns as they are, a moved state only one motion."""

    def __init__(self) -> None:
        self._known: dict[tuple[object, ...], T] = {}

    def __call__(self, key: tuple[object, ...], compute: Callable[[], T]) -> T:
        """The result for `key`, computed where it is not known."""
        if key not in self._known:
            self._known[key] = compute()
            if len(self._known) > _REMEMBERED:
                del self._known[next(iter(self._known))]
        return self._known[key]


@dataclass(frozen=True)
class Shapes:
    """What the coefficients multiply at some instants."""

    columns: tuple[Regressor, ...]
    acceleration: ComplexArray  # angular accelerations in de-rolled axes per unit of each (columns, n), rad/s^2
    motions: tuple[Motion, ...]  # there and at the delays, kept as long: `VehicleModel` knows them by identity
    here: Point
    context: Context

    @cached_property
    def on_grid(self) -> tuple[ComplexArray, list[int], ComplexArray]:
        """The accelerations times time bases (columns, n), as `kink` has them where a knot lies between nodes; the
        columns with a knot, and what the angular rate lacks there per unit of each (columns with a knot, n), rad/s.
        """
        time, half, u = self.here.time, self.here.input("half"), self.here.u
        on_grid_too, knotted = self.acceleration.copy(), [j for j, c in enumerate(self.columns) if has_knot(c)]
        lacking = np.empty((len(knotted), time.size), dtype=complex)
        for k, j in enumerate(knotted):
            row, shape = SLOPES + 4 * k, self.acceleration[j]
            here = parameters.placed(self.columns[j].time_basis, time, half, self.context.own)
            first, second = parameters.kink(*here)
            slope, curvature = u[row] + 1j * u[row + 1], u[row + 2] + 1j * u[row + 3]
            on_grid_too[j] = parameters.on_grid(*here) * shape - first * slope + second * curvature
            lacking[k] = first * shape - 2.0 * second * slope
        return on_grid_too, knotted, lacking

    @cached_property
    def averaged(self) -> ComplexArray:
        """The accelerations (columns, n) times the block means of their time bases."""
        out, context, half = self.acceleration.copy(), self.context, self.here.input("half")
        for own, column in zip(out, self.columns, strict=True):
            if has_knot(column):
                time_basis, time, _ = parameters.placed(column.time_basis, self.here.time, half, context.own)
                own *= parameters.averaged(time_basis, time, context.block)
        return out


def earlier_motion(motions: Mapping[float, Motion], delay: float) -> Motion:
    """The motion `delay` s earlier, of those at the delays of the structure; UsageError for any other."""
    near = min(motions, key=lambda known: abs(known - delay), default=None)
    if near is None or abs(near - delay) > 1e-9 * max(abs(delay), 1e-9):
        raise UsageError(
            f"a mechanism requested the motion {delay:g} s earlier, but the delays that it had asked for are "
            f"{sorted(motions)}. The likelihood differentiates delays that are parameters with is_delay set: "
            "declare it as one"
        )
    return motions[near]


@dataclass(frozen=True)
class MomentColumns:
    """What the columns of a structure are at any motion; `uses_rates`: whether rates of its angles change them."""

    structure: parameters.Structure
    mechanisms: Mapping[str, Mechanism]
    uses_rates: bool = True

    @cached_property
    def shape_parameters(self) -> tuple[str, ...]:
        """The coefficients and nonlinear parameters that change the columns themselves. C_mw of Eq. 5.1 changes those
        of mechanisms with parameters of their own, as in the regression.
        """
        used = {column.mechanism for column in self.structure.columns}
        nonlinear_parameters = tuple(parameter.name for parameter in self.structure.nonlinear_parameters)
        if not any(self.mechanisms[name].parameters() for name in used):
            return nonlinear_parameters
        return (*nonlinear_parameters, *(name for name, _ in self._wind_fixed(self.structure.columns)))

    def planes(
        self, now: Motion, past: Mapping[float, Motion], theta: Values, half: FloatArray, own: OwnTime | None = None
    ) -> tuple[tuple[Regressor, ...], ComplexArray]:
        """The columns, moved, and (C_N' + i C_Z') per unit of each without its time basis, (columns, n)."""
        columns = self.structure.at(theta)
        motion, *late = (self._with_in_plane_moment(each, theta, columns, half, own) for each in (now, *past.values()))
        if earlier := dict(zip(past, late, strict=True)):
            motion = replace(motion, history=partial(earlier_motion, earlier))
        terms = evaluated(columns, self.mechanisms, motion)
        return columns, np.array([term.in_plane + 1j * term.out_of_plane for term in terms])

    def _wind_fixed(self, columns: Sequence[Regressor]) -> list[tuple[str, Regressor]]:
        named = zip(self.structure.names, columns, strict=True)
        return [(name, column) for name, column in named if self.mechanisms[column.mechanism].wind_fixed]

    def _with_in_plane_moment(
        self, motion: Motion, theta: Values, columns: Sequence[Regressor], half: FloatArray, own: OwnTime | None
    ) -> Motion:
        """C_mw of Eq. 5.1 from the wind-fixed columns."""
        fixed = self._wind_fixed(columns)
        terms, weights = evaluated([column for _, column in fixed], self.mechanisms, motion), []
        for name, column in fixed:
            here = parameters.placed(column.time_basis, motion.time, half, own)
            weights.append(theta[name] * (1.0 if column.time_basis.kind == "constant" else parameters.on_grid(*here)))
        return replace(motion, in_plane_moment=summed((term.in_plane for term in terms), weights, motion.alpha))


def rates_used(columns: Sequence[Regressor], mechanisms: Mapping[str, Mechanism], motion: Motion) -> bool:
    """Whether the columns change with the rates of alpha and of the meridian, tried on a recorded motion."""
    rng = np.random.default_rng(0)
    changes = {name: rng.standard_normal(motion.time.size) for name in ("alpha_rate", "windward_meridian_rate")}
    changed = replace(motion, **{name: getattr(motion, name) + change for name, change in changes.items()})

    def terms(mechanism: str, theta: Theta, motion: Motion) -> list[tuple[FloatArray, FloatArray]]:
        return [(term.in_plane, term.out_of_plane) for term in mechanisms[mechanism].terms(motion, dict(theta))]

    kinds = {(column.mechanism, column.theta) for column in columns}
    return any(not np.array_equal(terms(*kind, motion), terms(*kind, changed)) for kind in kinds)


@dataclass(frozen=True)
class VehicleModel:
    """The functions that `likelihood.fit` takes."""

    moments: MomentColumns
    contexts: Sequence[Context]  # by the input "segment"
    span: tuple[float, float]  # s, that scales the drift of the normal-force slope
    _shapes: Memory[Shapes] = field(default_factory=Memory, compare=False, repr=False)
    _motions: Memory[Motion] = field(default_factory=Memory, compare=False, repr=False)

    def dynamics(
        self, x: FloatArray, u: FloatArray, theta: Values, t: FloatArray, delayed: AtDelays = MappingProxyType({})
    ) -> FloatArray:
        """d/dt of (Re omega, Im omega, Re zeta, Im zeta), (4, n)."""
        here, context = point(x, u, t), self._context(u)
        accelerations, knotted, missing = self.shapes(here, theta, delayed).on_grid
        weights = self.moments.structure.values(theta)
        acceleration, lacking = weights @ accelerations, weights[knotted] @ missing
        scale = self._moment_share(context, theta)
        acceleration, lacking = np.asarray(acceleration * scale), np.asarray(lacking * scale)
        moving = replace(here, omega=here.omega + lacking)
        return real_rows(self._omega_rate(here, context, theta, acceleration), self._zeta_rate(moving, context, theta))

    def outputs(
        self, x: FloatArray, u: FloatArray, theta: Values, t: FloatArray, delayed: AtDelays = MappingProxyType({})
    ) -> FloatArray:
        """q, r (rad/s), a_y, a_z (m/s^2) as the instruments read them, (4, n)."""
        here, context = point(x, u, t), self._context(u)
        omega = here.omega * here.to_body
        force = self._force(here, context, theta) * here.to_body
        arm = context.vehicle.accelerometer_position
        if any(arm):
            acceleration = self.moments.structure.values(theta) @ self.shapes(here, theta, delayed).averaged
            scaled = acceleration * self._moment_share(context, theta)
            omega_rate = self._omega_rate(here, context, theta, scaled)
            body_rate = omega_rate * here.to_body - 1j * here.input("p") * omega
            p = here.input("p") - self._roll_rate_error(context, theta)
            force = force + parameters.lever_force(arm, omega, body_rate, p, here.input("p_rate"))
        gyros, accelerometers = (_pair(e, context, theta) for e in (parameters.GYROS, parameters.ACCELEROMETERS))
        return real_rows(omega + gyros, force + accelerometers)

    def rate_parameters(self, flight: int) -> tuple[str, ...]:
        """Parameters, histories that change rates of alpha and meridian at given states, where columns depend on it."""
        if not self.moments.uses_rates:
            return ()
        return (*FORCES, *(parameters.of_flight(name, flight) for name in (*GRAVITY_ERRORS, *RATE_ERRORS)))

    def shapes(self, here: Point, theta: Values, delayed: Mapping[str, Delayed]) -> Shapes:
        """The columns at some instants."""
        context = self._context(here.u)
        now, past = self._motion(here, context, theta), dict[float, Motion]()
        for name in self.moments.structure.delays:
            before = point(delayed[name].x, delayed[name].u, here.time - theta[name])
            past[theta[name]] = self._motion(before, context, theta)

        def evaluated() -> Shapes:
            columns, planes = self.moments.planes(now, past, theta, here.input("half"), context.own)
            scale = here.input("pressure") * context.vehicle.moment_scale
            turn = scale * np.exp(-1j * now.windward_meridian) * np.conj(here.to_body)
            return Shapes(columns, planes * turn, (now, *past.values()), here, context)

        key = (id(now), *map(id, past.values()), *(theta[name] for name in self.moments.shape_parameters))
        return self._shapes(key, evaluated)

    def _motion(self, at: Point, context: Context, theta: Values) -> Motion:
        """The motion of a point, which depends on its parameters through the rates only."""
        rates = (np.asarray(theta.get(name, 0.0)).tobytes() for name in self.rate_parameters(context.flight))
        key = (at.omega.tobytes(), at.zeta.tobytes(), at.time.tobytes(), context.flight, context.start, *rates)
        return self._motions(key, lambda: self._moving(at, context, theta))

    def _context(self, u: FloatArray) -> Context:
        return self.contexts[round(float(u[ROW["segment"], 0]))]

    def _omega_rate(self, here: Point, context: Context, theta: Values, acceleration: ComplexArray) -> ComplexArray:
        k = context.vehicle.inertia_ratio * (1.0 - _error(parameters.RATIO_ERROR, context, theta))
        p, error = here.input("p"), self._roll_rate_error(context, theta)
        tolerated = _pair(parameters.MOMENTS, context, theta) * np.conj(here.to_body)
        return np.asarray(1j * (k * p + (1.0 - k) * error) * here.omega + acceleration + tolerated)

    def _zeta_rate(self, here: Point, context: Context, theta: Values) -> ComplexArray:
        error = self._roll_rate_error(context, theta)
        # Gravity along each axis of the first sample, by what it adds across the body in de-rolled axes.
        along_y, along_z = (here.u[ROW[f"gravity_x{axis}"] :][:3] for axis in "yz")
        mean, errors = context.gravity
        gravity = (mean + errors @ [theta[name] for name in _own(GRAVITY_ERRORS, context)]) @ (along_y + 1j * along_z)
        gained = gravity + here.input("air_y") + 1j * here.input("air_z") + _pair(parameters.CROSSFLOW, context, theta)
        gained = gained + self._force(here, context, theta)
        slower = 1.0 + _error(parameters.SPEED_ERROR, context, theta)
        forward = np.sqrt(np.maximum(here.input("speed") ** 2 - np.abs(here.zeta) ** 2, 0.0))  # along the axis, m/s
        return np.asarray(1j * forward * here.omega + 1j * error * here.zeta + slower * gained)

    def _force(self, at: Point, context: Context, theta: Values) -> ComplexArray:
        """Specific force across the body in de-rolled axes (n,), m/s^2."""
        xi, vehicle = at.zeta / at.input("speed"), context.vehicle
        drift = scaled(context.coefficient_time(at.time), *self.span)
        shapes = np.stack([np.ones_like(drift), drift, angle_of_attack(xi) ** 2])
        slope = np.array([theta[name] for name in FORCES]) @ shapes
        scale = at.input("pressure") * (vehicle.reference_area / vehicle.mass) * self._pressure_share(context, theta)
        force = -scale * (1.0 - _error(parameters.FORCE_SCALE_ERROR, context, theta)) * effective(xi)
        return np.asarray(force * slope)

    def _roll_rate_error(self, context: Context, theta: Values) -> FloatArray | float:
        """Measured less true roll rate (n,), rad/s."""
        return _error(ROLL_RATE, context, theta) + _error(parameters.ROLL_RATE_ERROR, context, theta)

    def _pressure_share(self, context: Context, theta: Values) -> FloatArray | float:
        """True dynamic pressure over the measured one (n,)."""
        return 1.0 - _error(PRESSURE, context, theta) - _error(parameters.PRESSURE_ERROR, context, theta)

    def _moment_share(self, context: Context, theta: Values) -> FloatArray | float:
        """True angular acceleration per unit coefficient over the declared one (n,)."""
        return self._pressure_share(context, theta) * (1.0 - _error(parameters.MOMENT_SCALE_ERROR, context, theta))

    def _moving(self, at: Point, context: Context, theta: Values) -> Motion:
        # Without what noise leaves in the inputs, and errors that do too little to the rates to matter.
        quiet = (ROLL_RATE, PRESSURE, parameters.PRESSURE_ERROR, parameters.SPEED_ERROR, parameters.FORCE_SCALE_ERROR)
        theta = {**theta, **dict.fromkeys(_own(quiet, context), 0.0)}
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


def _own(names: Sequence[str], context: Context) -> list[str]:
    """Names of a flight's own parameters or histories."""
    return [parameters.of_flight(name, context.flight) for name in names]


def _error(name: str, context: Context, theta: Values) -> FloatArray | float:
    """A history of the flight's errors (n,); 0 where it has none of that name."""
    return theta.get(parameters.of_flight(name, context.flight), 0.0)


def _pair(names: tuple[str, str], context: Context, theta: Values) -> ComplexArray:
    return np.asarray(_error(names[0], context, theta) + 1j * _error(names[1], context, theta))
