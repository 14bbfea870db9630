"""The vehicle in flight: attitude, air and what is planted; forces, moments and the rate of the state, for a batch.

State (13, ...): position and velocity in a non-rotating frame (x along the initial track, y to its right, z down,
origin at sea level under the start), attitude quaternion (w, x, y, z) body to frame, rates p, q, r. Arrays carry their
components first: quaternions (4, ...), vectors (3, ...), matrices (3, 3, ...). All functions are elementwise over the
trailing axes: (flights,) in the integration, (nodes, flights) over a whole record. `system` builds the equations of
motion (Eq. 2.2 to 2.4) of a batch from its configurations, `initial_state` its first state.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any, Literal

import numpy as np
from scipy.interpolate import CubicSpline

from brv_hypo.arrays import ComplexArray, FloatArray
from brv_hypo.errors import UsageError
from brv_hypo.mechanisms import find
from brv_hypo.mechanisms.contract import Mechanism, MomentProcess
from brv_hypo.model.baseline import pitch_damping_term, static_terms
from brv_hypo.model.moment import summed
from brv_hypo.model.term import TimeBasis, delays_among
from brv_hypo.motion.kinematics import angle_rates, body_from_plane, windward_meridian
from brv_hypo.motion.motion import Motion, nearest_turn
from brv_hypo.simulation.config import AerodynamicsConfig, PlantedConfig, SimulationConfig, per_flight

# ---- Attitude as a quaternion, body to frame: no singularity at any attitude ----


def attitude_matrix(attitude: FloatArray) -> FloatArray:
    """Body to frame, (3, 3, ...); scale of the quaternion drops out, so that stages need no normalising."""
    w, x, y, z = attitude * np.sqrt(2.0 / dot(attitude, attitude))
    xx, yy, zz = x * x, y * y, z * z
    xy, xz, yz, wx, wy, wz = x * y, x * z, y * z, w * x, w * y, w * z
    return np.array(
        [[1.0 - yy - zz, xy - wz, xz + wy], [xy + wz, 1.0 - xx - zz, yz - wx], [xz - wy, yz + wx, 1.0 - xx - yy]]
    )


def transform(tensor: FloatArray, vector: FloatArray) -> FloatArray:
    """A tensor (3, 3, ...) applied to a vector; the rotation of a body takes body axes to the frame."""
    return np.asarray(np.einsum("ij...,j...->i...", tensor, vector), dtype=float)


def dot(a: FloatArray, b: FloatArray) -> FloatArray:
    """Sum of products over the components."""
    return np.asarray(np.einsum("i...,i...->...", a, b), dtype=float)


def to_body(rotation: FloatArray, frame: FloatArray) -> FloatArray:
    """A frame vector in body axes."""
    return transform(rotation.swapaxes(0, 1), frame)


def attitude_rate(attitude: FloatArray, rates: FloatArray) -> FloatArray:
    """d/dt of the quaternion at body rates p, q, r (rad/s): half its product with (0, p, q, r)."""
    w, x, y, z = attitude
    p, q, r = 0.5 * rates
    return np.array([-x * p - y * q - z * r, w * p + y * r - z * q, w * q + z * p - x * r, w * r + x * q - y * p])


def from_pitch_roll(pitch: FloatArray, roll: FloatArray) -> FloatArray:
    """The attitude after a pitch, then a roll about the new x axis (rad)."""
    cp, sp, cr, sr = np.cos(pitch / 2), np.sin(pitch / 2), np.cos(roll / 2), np.sin(roll / 2)
    return np.array([cp * cr, cp * sr, sp * cr, -sp * sr])


def cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """a x b, components first (numpy's own is an order of magnitude slower on a single vector)."""
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


# ---- The air: standard atmosphere, a step of the wind, and the wind that record effects leave unaccounted for ----


LOWEST, HIGHEST = -5000.0, 81000.0
_SPACING = 50.0


@dataclass(frozen=True)
class Air:
    """Density kg/m^3, speed of sound m/s, dynamic viscosity Pa s."""

    density: FloatArray
    speed_of_sound: FloatArray
    viscosity: FloatArray


def standard_air(altitude: FloatArray) -> Air:
    """Air at `altitude` (m, any shape), within 1e-6 of the ICAO tables; held at -5 and 81 km beyond them."""
    values = _table()(np.minimum(np.maximum(altitude, LOWEST), HIGHEST))
    return Air(np.exp(values[..., 0]), values[..., 1], values[..., 2])


@lru_cache(maxsize=1)
def _table() -> CubicSpline:
    from ambiance import Atmosphere

    altitude = np.arange(LOWEST, HIGHEST + 1.0, _SPACING)
    air = Atmosphere(altitude)
    return CubicSpline(altitude, np.stack([np.log(air.density), air.speed_of_sound, air.dynamic_viscosity], axis=-1))


@dataclass(frozen=True)
class WindStep:
    """`EnvironmentConfig.wind_step` for a batch: at time (flights,) s the air begins to move.

    `after` (3, flights) m/s, in the frame, is its velocity from then on.
    """

    time: FloatArray
    after: FloatArray

    def velocity(self, time: FloatArray) -> FloatArray:
        """Velocity of the air in the frame, (3, ...) m/s, at `time` (..., flights) s."""
        shape = (3,) + (1,) * (time.ndim - 1) + self.after.shape[1:]
        return np.asarray(self.after.reshape(shape) * (time >= self.time), dtype=float)


@dataclass(frozen=True)
class WindProfile:
    """A wind along the record: `samples` (3, n, flights) m/s in the frame, `spacing` s apart from `begin` s on.

    Straight between its samples, and held before the first and after the last.
    """

    begin: float
    spacing: float
    samples: FloatArray

    def at(self, time: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Velocity of the air in the frame and its change, (3, ...) m/s and m/s^2, at `time` (..., flights) s."""
        last = self.samples.shape[1] - 1
        place = (time - self.begin) / self.spacing
        held = np.minimum(np.maximum(place, 0.0), last)
        left = np.minimum(held.astype(np.intp), last - 1)
        flight = np.arange(self.samples.shape[2])
        before = self.samples[:, left, flight]
        change = self.samples[:, left + 1, flight] - before
        return before + (held - left) * change, change * ((held == place) / self.spacing)


# ---- Planted mechanisms: the installed definitions, evaluated at the running state ----


@dataclass(frozen=True)
class Planted:
    """One mechanism in all flights of a batch: theta and coefficients (flights,), or one number."""

    mechanism: Mechanism
    theta: Mapping[str, float]
    coefficients: Mapping[str, FloatArray]
    time_basis: TimeBasis

    def contribution(self, motion: Motion) -> tuple[FloatArray, FloatArray]:
        """C_N' and C_Z' that the mechanism adds, on the motion's shape."""
        time_basis = self.time_basis(motion.time)
        terms = [term for term in self.mechanism.terms(motion, self.theta) if term.name in self.coefficients]
        weights = [self.coefficients[term.name] * time_basis for term in terms]
        return (
            summed((term.in_plane for term in terms), weights, motion.alpha),
            summed((term.out_of_plane for term in terms), weights, motion.alpha),
        )

    def edges(self) -> FloatArray:
        """Times (s) at which the time basis has a jump or a kink."""
        found = np.concatenate([np.ravel(self.time_basis.start), np.ravel(self.time_basis.stop)])
        return np.asarray(found[np.isfinite(found)], dtype=float)

    def delays(self) -> FloatArray:
        """The delays (s) among theta, every flight's."""
        late_by = delays_among(self.mechanism.parameters())
        found = [np.ravel(self.theta[parameter.name]) * parameter.seconds for parameter in late_by]
        return np.unique(np.concatenate([np.zeros(0), *found]))


def planted(configs: Sequence[SimulationConfig], place: Literal["mechanisms", "asymmetries"]) -> tuple[Planted, ...]:
    """The mechanisms, or the vehicle's asymmetries, of a batch: all its configurations have the same, in one order."""
    return tuple(_planted(configs, place, index) for index in range(len(getattr(configs[0], place))))


def check_terms(items: Sequence[Planted], motion: Motion) -> None:
    """Raise UsageError for a coefficient of a term that its mechanism does not have."""
    for item in items:
        known = [term.name for term in item.mechanism.terms(motion, item.theta)]
        unknown = [name for name in item.coefficients if name not in known]
        if unknown:
            raise UsageError(
                f"mechanism '{item.mechanism.name}' has no term '{unknown[0]}'; its terms are "
                f"{', '.join(known)}. Correct the key under `terms`."
            )


def _planted(configs: Sequence[SimulationConfig], place: str, index: int) -> Planted:
    entry: PlantedConfig = getattr(configs[0], place)[index]
    mechanism = find(entry.mechanism, entry.options)
    if isinstance(mechanism, MomentProcess):  # its splines lie over the flight
        start = configs[0].start.time
        span = {"start": start, "stop": start + configs[0].duration}
        mechanism = find(entry.mechanism, {**span, **entry.options})
    _check_theta(mechanism, entry)

    def column(*path: str, missing: float = np.nan) -> Any:
        values = per_flight(configs, place, index, *path, missing=missing)
        # One number where flights agree: mechanisms are written for scalar theta.
        return float(values[0]) if np.all(values == values[0]) else values

    return Planted(
        mechanism,
        {name: column("theta", name) for name in entry.theta},
        {name: column("terms", name) for name in entry.terms},
        TimeBasis(entry.kind, column("start", missing=-np.inf), column("stop", missing=np.inf)),
    )


def _check_theta(mechanism: Mechanism, entry: PlantedConfig) -> None:
    expected = {parameter.name for parameter in mechanism.parameters()}
    if expected != set(entry.theta):
        raise UsageError(
            f"planted mechanism '{mechanism.name}': got theta {sorted(entry.theta)}, expected "
            f"{sorted(expected)}. Give each parameter of the mechanism one value under `theta`."
        )
    if entry.kind == "ramp" and entry.start is None:
        raise UsageError(f"planted mechanism '{mechanism.name}': a ramp needs a `start` (s) to rise from.")


# ---- The equations of motion ----


POSITION, VELOCITY, ATTITUDE, RATES = slice(0, 3), slice(3, 6), slice(6, 10), slice(10, 13)
STATES = 13
EARTH_RADIUS = 6.371e6

Past = Callable[[FloatArray], Motion]


class RunningMotion(Motion):
    """A motion at the running state; a delay may differ from flight to flight."""

    def delayed(self, tau: float | FloatArray) -> Motion:
        """The motion tau earlier; tau is one number or (flights,)."""
        if self.history is None or isinstance(tau, float | int):
            return super().delayed(tau)  # type: ignore[arg-type]
        return self.history(tau)  # type: ignore[arg-type]


@dataclass(frozen=True)
class AirData:
    """Velocity relative to the air and what follows from it; vectors (3, ...)."""

    rotation: FloatArray
    """Body to frame (3, 3, ...)."""
    velocity: FloatArray
    """Relative to the air, in body axes, m/s."""
    velocity_rate: FloatArray
    """Its change in body axes, m/s^2."""
    speed: FloatArray
    """Relative to the air, m/s."""
    altitude: FloatArray
    """Above sea level, m."""
    dynamic_pressure: FloatArray
    """Pa."""
    mach: FloatArray
    """Mach number."""
    reynolds: FloatArray
    """Reynolds number by the reference length."""
    crossflow: ComplexArray
    """(v + i w) / V."""
    specific_force: FloatArray
    """Aerodynamic force per mass in body axes, m/s^2."""
    acceleration: FloatArray
    """In the frame: gravity and aerodynamic force, m/s^2."""


@dataclass(frozen=True)
class System:
    """The equations of motion of a batch."""

    mass: FloatArray
    """(flights,) kg."""
    inertia: FloatArray
    """Tensor (3, 3, flights) kg m^2."""
    reference_length: FloatArray
    """(flights,) m."""
    reference_area: FloatArray
    """(flights,) m^2."""
    coefficients: dict[str, FloatArray]
    """Those of `AerodynamicsConfig`, each (flights,)."""
    gravity: FloatArray
    """At sea level (flights,) m/s^2."""
    density: FloatArray | None
    """(flights,) kg/m^3 where it is the same everywhere; None: the standard atmosphere's."""
    wind_step: WindStep | None
    """A step of the wind."""
    planted: tuple[Planted, ...]
    """Asymmetries, then mechanisms."""
    wind_profile: WindProfile | None = None
    """The wind that the errors of the record leave unaccounted for."""

    @cached_property
    def inertia_inverse(self) -> FloatArray:
        """Inverse of the tensor (3, 3, flights)."""
        return np.asarray(np.moveaxis(np.linalg.inv(np.moveaxis(self.inertia, -1, 0)), 0, -1), dtype=float)

    def air_data(self, time: FloatArray, state: FloatArray) -> AirData:
        """Forces and air-relative kinematics; the moments have no part in them."""
        turn = attitude_matrix(state[ATTITUDE])
        gravity, altitude = self.gravity_and_altitude(state[POSITION])
        wind, wind_rate = self.wind(time)
        velocity = to_body(turn, state[VELOCITY] - wind)
        crossed = velocity[1] + 1j * velocity[2]
        speed = np.sqrt(dot(velocity, velocity))
        air = standard_air(altitude)
        density = air.density if self.density is None else self.density
        pressure = 0.5 * density * speed**2
        force = self._specific_force(pressure, velocity, crossed)
        velocity_rate = to_body(turn, gravity - wind_rate) + force - cross(state[RATES], velocity)
        return AirData(
            rotation=turn,
            velocity=velocity,
            velocity_rate=velocity_rate,
            speed=speed,
            altitude=altitude,
            dynamic_pressure=pressure,
            mach=speed / air.speed_of_sound,
            reynolds=density * speed * self.reference_length / air.viscosity,
            crossflow=crossed / speed,
            specific_force=force,
            acceleration=gravity + transform(turn, force),
        )

    def motion(
        self,
        time: FloatArray,
        state: FloatArray,
        air: AirData,
        near: FloatArray | float = 0.0,
        past: Past | None = None,
    ) -> Motion:
        """What mechanisms see at this state; the meridian is the turn nearest to `near` (rad)."""
        xi_rate = (air.velocity_rate[1] + 1j * air.velocity_rate[2]) / air.speed - air.crossflow * (
            dot(air.velocity, air.velocity_rate) / air.speed**2
        )
        alpha_rate, meridian_rate = angle_rates(air.crossflow, xi_rate)
        p, q, r = state[RATES]
        motion = RunningMotion(
            time=time,
            # Over the whole sphere (CONVENTIONS).
            alpha=np.arctan2(np.abs(air.crossflow) * air.speed, air.velocity[0]),
            # `angle_rates` knows the forward half: beyond 90 degrees the crossflow shrinks as alpha grows.
            alpha_rate=np.copysign(1.0, air.velocity[0]) * alpha_rate,
            windward_meridian=nearest_turn(windward_meridian(air.crossflow), np.asarray(near)),
            windward_meridian_rate=meridian_rate,
            p=p,
            q=q,
            r=r,
            velocity=air.speed,
            dynamic_pressure=air.dynamic_pressure,
            mach=air.mach,
            reynolds=air.reynolds,
            in_plane_moment=np.zeros_like(air.speed),
            reference_length=self.reference_length,  # type: ignore[arg-type]  # (flights,) where it varies
            history=None if past is None else lambda tau: past(time - tau),
        )
        return replace(motion, in_plane_moment=self._wind_fixed_moment(motion))

    def plane_moments(self, motion: Motion) -> tuple[FloatArray, FloatArray]:
        """C_N' and C_Z': static moment, pitch damping and all that is planted."""
        damping = pitch_damping_term(motion)
        in_plane = motion.in_plane_moment + self.coefficients["C_mq"] * damping.in_plane
        out_of_plane = self.coefficients["C_mq"] * damping.out_of_plane
        for item in self.planted:
            along, across = item.contribution(motion)
            out_of_plane = out_of_plane + across
            if not item.mechanism.wind_fixed:
                in_plane = in_plane + along
        return in_plane, out_of_plane

    def state_rate(self, state: FloatArray, air: AirData, motion: Motion) -> FloatArray:
        """d/dt of the state (13, ...): a rigid body with its full inertia tensor (Eq. 2.2 to 2.4)."""
        rates = state[RATES]
        transverse = body_from_plane(*self.plane_moments(motion), motion.windward_meridian)
        scale = air.dynamic_pressure * self.reference_area * self.reference_length
        roll = self.coefficients["C_l0"] + self.coefficients["C_lp"] * motion.p * motion.rate_factor
        moment = scale * np.array([roll, transverse.real, transverse.imag])
        momentum = transform(self.inertia, rates)
        angular = transform(self.inertia_inverse, moment - cross(rates, momentum))
        return np.concatenate([state[VELOCITY], air.acceleration, attitude_rate(state[ATTITUDE], rates), angular])

    def body_moments(self, state: FloatArray, angular: FloatArray, air: AirData) -> FloatArray:
        """C_l, C_m, C_n (3, ...) from angular accelerations (3, ...) rad/s^2: Euler's equations, inverted."""
        momentum = transform(self.inertia, state[RATES])
        moment = transform(self.inertia, angular) + cross(state[RATES], momentum)
        scale = air.dynamic_pressure * self.reference_area * self.reference_length
        return np.asarray(np.divide(moment, scale, out=np.zeros_like(moment), where=scale > 0.0))

    def gravity_and_altitude(self, position: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Gravity (3, ...) m/s^2 in the frame and altitude m; inverse-square."""
        x, y, z = position
        down = np.array([-x, -y, EARTH_RADIUS - z])
        radius = np.sqrt(dot(down, down))
        return down * (self.gravity * EARTH_RADIUS**2 / radius**3), radius - EARTH_RADIUS

    def wind(self, time: FloatArray) -> tuple[FloatArray | float, FloatArray | float]:
        """Velocity of the air in the frame and its change, (3, ...) m/s and m/s^2; a step's change is not in it."""
        step = 0.0 if self.wind_step is None else self.wind_step.velocity(time)
        if self.wind_profile is None:
            return step, 0.0
        velocity, rate = self.wind_profile.at(time)
        return step + velocity, rate

    def _specific_force(self, pressure: FloatArray, velocity: FloatArray, crossed: ComplexArray) -> FloatArray:
        """Axial and normal force per mass, (3, ...) in body axes; the normal force opposes the crossflow."""
        scale = pressure * self.reference_area / self.mass
        size = np.abs(crossed)
        slope = scale * self.coefficients["C_Nalpha_force"] * np.arctan2(size, velocity[0])
        normal = crossed * (slope / np.maximum(size, 1e-300))
        return np.array([-scale * self.coefficients["C_A"], -normal.real, -normal.imag])

    def _wind_fixed_moment(self, motion: Motion) -> FloatArray:
        """C_mw of Eq. 5.1: the static terms, and planted mechanisms that are wind-fixed."""
        offset, slope = static_terms(motion)
        moment = self.coefficients["C_m0"] * offset.in_plane + self.coefficients["C_malpha"] * slope.in_plane
        moment = moment + self.coefficients["C_malpha3"] * motion.alpha**3
        for item in self.planted:
            if item.mechanism.wind_fixed:
                moment = moment + item.contribution(motion)[0]
        return np.asarray(moment, dtype=float)


# ---- From configurations, one per flight, to the equations of motion of a batch and its first state ----


def system(configs: Sequence[SimulationConfig]) -> System:
    """The equations of motion of a batch; what is planted is looked up among the installed mechanisms."""
    first = configs[0].environment
    bodies = [config.vehicle for config in configs]
    inertia = [[b.ixx, -b.ixy, -b.ixz, -b.ixy, b.iyy, 0.0, -b.ixz, 0.0, b.iyy] for b in bodies]
    return System(
        mass=per_flight(configs, "vehicle", "mass"),
        inertia=np.moveaxis(np.reshape(np.array(inertia, dtype=float), (-1, 3, 3)), 0, -1),
        reference_length=per_flight(configs, "vehicle", "reference_length"),
        reference_area=per_flight(configs, "vehicle", "reference_area"),
        coefficients={name: per_flight(configs, "aerodynamics", name) for name in AerodynamicsConfig.model_fields},
        gravity=per_flight(configs, "environment", "gravity"),
        density=None if first.constant_density is None else per_flight(configs, "environment", "constant_density"),
        wind_step=None if first.wind_step is None else _wind_step(configs),
        planted=(*planted(configs, "asymmetries"), *planted(configs, "mechanisms")),
    )


def initial_state(configs: Sequence[SimulationConfig], equations: System) -> FloatArray:
    """State (13, flights) at the start; alpha lies in the vertical plane of the track."""
    path = per_flight(configs, "start", "flight_path_angle")
    meridian = per_flight(configs, "start", "windward_meridian")
    along = np.array([np.cos(path), np.zeros_like(path), -np.sin(path)])
    transverse = np.array([_transverse_rate(config) for config in configs])
    state = np.zeros((STATES, len(configs)))
    state[2] = -per_flight(configs, "start", "altitude")
    state[VELOCITY] = per_flight(configs, "start", "velocity") * along
    state[VELOCITY] += equations.wind(per_flight(configs, "start", "time"))[0]
    state[ATTITUDE] = from_pitch_roll(path + per_flight(configs, "start", "alpha"), meridian)
    state[RATES] = np.array([per_flight(configs, "start", "roll_rate"), transverse.real, transverse.imag])
    return state


def _transverse_rate(config: SimulationConfig) -> complex:
    """q + i r: as given, or such that alpha and its plane turn as asked on a straight path."""
    start = config.start
    if start.q is not None and start.r is not None:
        return complex(start.q, start.r)
    turned = complex(start.alpha_rate, start.coning_rate * np.tan(start.alpha))
    return complex(turned * np.exp(-1j * start.windward_meridian))


def _wind_step(configs: Sequence[SimulationConfig]) -> WindStep:
    time = per_flight(configs, "environment", "wind_step", "time", missing=np.inf)
    velocity = [per_flight(configs, "environment", "wind_step", "velocity", i, missing=0.0) for i in range(3)]
    return WindStep(time, np.array(velocity))
