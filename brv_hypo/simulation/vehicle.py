"""The vehicle in flight: attitude, air and what is planted; forces, moments and the rate of the state.

State (13, ...): position and velocity in a non-rotating frame (x along the initial track, y to its right, z down,
origin at sea level under the start), attitude quaternion (w, x, y, z) body to frame, rates p, q, r. Arrays carry their
components first: quaternions (4, ...), vectors (3, ...), matrices (3, 3, ...). All functions are elementwise over the
trailing axis: (1,) in the integration, (nodes,) over a whole record. `system` builds the equations of motion (Eq. 2.2
to 2.4) from a configuration, `initial_state` their first state.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
from scipy.interpolate import CubicSpline

from brv_hypo.arrays import ComplexArray, FloatArray
from brv_hypo.errors import UsageError
from brv_hypo.flight.derived import HIGHEST_ALTITUDE, LOWEST_ALTITUDE, atmosphere
from brv_hypo.mechanisms import find
from brv_hypo.mechanisms.contract import Mechanism, MomentProcess
from brv_hypo.model.baseline import pitch_damping_term, static_terms
from brv_hypo.model.term import TimeBasis, summed
from brv_hypo.motion.motion import Motion, angle_rates, body_from_plane, nearest_turn, windward_meridian
from brv_hypo.simulation.config import PlantedConfig, SimulationConfig

POSITION, VELOCITY, ATTITUDE, RATES = slice(0, 3), slice(3, 6), slice(6, 10), slice(10, 13)
STATES = 13
EARTH_RADIUS = 6.371e6


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


def standard_air(altitude: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Density kg/m^3, speed of sound m/s, viscosity Pa s at `altitude` (m), held beyond -5 and 81 km; ICAO to 1e-6."""
    values = _table()(np.minimum(np.maximum(altitude, LOWEST_ALTITUDE), HIGHEST_ALTITUDE))
    return np.exp(values[..., 0]), values[..., 1], values[..., 2]


@lru_cache(maxsize=1)
def _table() -> CubicSpline:
    altitude = np.arange(LOWEST_ALTITUDE, HIGHEST_ALTITUDE + 1.0, 50.0)
    columns = [atmosphere(altitude, quantity) for quantity in ("density", "speed_of_sound", "dynamic_viscosity")]
    return CubicSpline(altitude, np.stack([np.log(columns[0]), *columns[1:]], axis=-1))


@dataclass(frozen=True)
class WindProfile:
    """A wind: `samples` (3, n) m/s in the frame, `spacing` s apart from `begin` s on, straight between, held beyond."""

    begin: float
    spacing: float
    samples: FloatArray

    def at(self, time: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Velocity of the air in the frame and its change, (3, ...) m/s and m/s^2, at `time` (...) s."""
        last = self.samples.shape[1] - 1
        place = (time - self.begin) / self.spacing
        held = np.minimum(np.maximum(place, 0.0), last)
        left = np.minimum(held.astype(np.intp), last - 1)
        before = self.samples[:, left]
        change = self.samples[:, left + 1] - before
        return before + (held - left) * change, change * ((held == place) / self.spacing)


@dataclass(frozen=True)
class Planted:
    """One mechanism with its theta, coefficients and time basis."""

    mechanism: Mechanism
    theta: Mapping[str, float]
    coefficients: Mapping[str, float]
    time_basis: TimeBasis

    def contribution(self, motion: Motion) -> tuple[FloatArray, FloatArray]:
        """C_N' and C_Z' that the mechanism adds, on the motion's shape."""
        time_basis = self.time_basis(motion.time)
        terms = [term for term in self.mechanism.terms(motion, self.theta) if term.name in self.coefficients]
        weights = [self.coefficients[term.name] * time_basis for term in terms]
        channels = ((term.in_plane for term in terms), (term.out_of_plane for term in terms))
        in_plane, out_of_plane = (summed(channel, weights, motion.alpha) for channel in channels)
        return in_plane, out_of_plane

    def check_terms(self, motion: Motion) -> None:
        """Raise UsageError for a coefficient of a term that the mechanism does not have."""
        known = [term.name for term in self.mechanism.terms(motion, self.theta)]
        for name in self.coefficients:
            if name not in known:
                found = f"mechanism '{self.mechanism.name}' has no term '{name}'; its terms are {', '.join(known)}"
                raise UsageError(f"{found}. Correct the key under `terms`.")


def planted(config: SimulationConfig, entries: Sequence[PlantedConfig]) -> tuple[Planted, ...]:
    """The mechanisms of a flight that `entries` of its configuration plant, looked up among those installed."""
    found = []
    for entry in entries:
        mechanism = find(entry.mechanism, entry.options)
        if isinstance(mechanism, MomentProcess):  # its splines lie over the flight
            span = {"start": config.start.time, "stop": config.start.time + config.duration}
            mechanism = find(entry.mechanism, {**span, **entry.options})
        expected = {parameter.name for parameter in mechanism.parameters()}
        if expected != set(entry.theta):
            got = f"got theta {sorted(entry.theta)}, expected {sorted(expected)}"
            remedy = "Give each parameter of the mechanism one value under `theta`."
            raise UsageError(f"planted mechanism '{mechanism.name}': {got}. {remedy}")
        if entry.kind == "ramp" and entry.start is None:
            raise UsageError(f"planted mechanism '{mechanism.name}': a ramp needs a `start` (s) to rise from.")
        ends = {"start": entry.start, "stop": entry.stop}
        time_basis = TimeBasis(entry.kind, **{name: end for name, end in ends.items() if end is not None})
        found.append(Planted(mechanism, entry.theta, entry.terms, time_basis))
    return tuple(found)


@dataclass(frozen=True)
class AirData:
    """Velocity relative to the air and what follows from it; vectors (3, ...)."""

    rotation: FloatArray  # body to frame (3, 3, ...)
    velocity: FloatArray  # relative to the air, in body axes, m/s
    velocity_rate: FloatArray  # its change in body axes, m/s^2
    speed: FloatArray  # relative to the air, m/s
    altitude: FloatArray  # above sea level, m
    dynamic_pressure: FloatArray  # Pa
    mach: FloatArray  # Mach number
    reynolds: FloatArray  # Reynolds number by the reference length
    crossflow: ComplexArray  # (v + i w) / V
    specific_force: FloatArray  # aerodynamic force per mass in body axes, m/s^2
    acceleration: FloatArray  # in the frame: gravity and aerodynamic force, m/s^2


@dataclass(frozen=True)
class Equations:
    """The equations of motion of a flight (Eq. 2.2 to 2.4)."""

    config: SimulationConfig
    planted: tuple[Planted, ...]  # asymmetries, then mechanisms
    wind_profile: WindProfile | None = None  # the wind that the errors of the record leave unaccounted for

    @cached_property
    def inertia(self) -> FloatArray:
        """About body x, y and z, (3, 1) kg m^2."""
        return np.array([[self.config.vehicle.ixx], [self.config.vehicle.iyy], [self.config.vehicle.iyy]])

    def air_data(self, time: FloatArray, state: FloatArray) -> AirData:
        """Forces and air-relative kinematics; the moments have no part in them."""
        turn = attitude_matrix(state[ATTITUDE])
        gravity, altitude = self.gravity_and_altitude(state[POSITION])
        wind, wind_rate = self.wind(time)
        velocity = to_body(turn, state[VELOCITY] - wind)
        crossed = velocity[1] + 1j * velocity[2]
        speed = np.sqrt(dot(velocity, velocity))
        standard_density, speed_of_sound, viscosity = standard_air(altitude)
        constant = self.config.environment.constant_density
        density = standard_density if constant is None else constant
        pressure = 0.5 * density * speed**2
        # Axial and normal force per mass in body axes; the normal force opposes the crossflow.
        aerodynamics, size = self.config.aerodynamics, np.abs(crossed)
        scale = pressure * self.config.vehicle.reference_area / self.config.vehicle.mass
        slope = scale * aerodynamics.C_Nalpha_force * np.arctan2(size, velocity[0])
        normal = crossed * (slope / np.maximum(size, 1e-300))
        force = np.array([-scale * aerodynamics.C_A, -normal.real, -normal.imag])
        velocity_rate = to_body(turn, gravity - wind_rate) + force - cross(state[RATES], velocity)
        return AirData(
            rotation=turn,
            velocity=velocity,
            velocity_rate=velocity_rate,
            speed=speed,
            altitude=altitude,
            dynamic_pressure=pressure,
            mach=speed / speed_of_sound,
            reynolds=density * speed * self.config.vehicle.reference_length / viscosity,
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
        past: Callable[[FloatArray], Motion] | None = None,
    ) -> Motion:
        """What mechanisms see at this state; the meridian is the turn nearest to `near` (rad)."""
        xi_rate = (air.velocity_rate[1] + 1j * air.velocity_rate[2]) / air.speed - air.crossflow * (
            dot(air.velocity, air.velocity_rate) / air.speed**2
        )
        alpha_rate, meridian_rate = angle_rates(air.crossflow, xi_rate)
        p, q, r = state[RATES]
        motion = Motion(
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
            reference_length=self.config.vehicle.reference_length,
            history=None if past is None else lambda tau: past(time - tau),
        )
        # C_mw of Eq. 5.1: the static terms, and planted mechanisms that are wind-fixed.
        (offset, slope), aerodynamics = static_terms(motion), self.config.aerodynamics
        moment = aerodynamics.C_m0 * offset.in_plane + aerodynamics.C_malpha * slope.in_plane
        moment = moment + aerodynamics.C_malpha3 * motion.alpha**3
        for item in self.planted:
            if item.mechanism.wind_fixed:
                moment = moment + item.contribution(motion)[0]
        vehicle, rates = self.config.vehicle, q + 1j * r
        turning = body_from_plane(moment, np.zeros_like(moment), motion.windward_meridian)
        change = air.dynamic_pressure * vehicle.moment_scale * turning - 1j * (1.0 - vehicle.inertia_ratio) * p * rates
        return replace(motion, in_plane_moment=np.asarray(moment, dtype=float), transverse_acceleration=change)

    def plane_moments(self, motion: Motion) -> tuple[FloatArray, FloatArray]:
        """C_N' and C_Z': static moment, pitch damping and all that is planted."""
        damping = pitch_damping_term(motion)
        in_plane = motion.in_plane_moment + self.config.aerodynamics.C_mq * damping.in_plane
        out_of_plane = self.config.aerodynamics.C_mq * damping.out_of_plane
        for item in self.planted:
            along, across = item.contribution(motion)
            out_of_plane = out_of_plane + across
            if not item.mechanism.wind_fixed:
                in_plane = in_plane + along
        return in_plane, out_of_plane

    def state_rate(self, state: FloatArray, air: AirData, motion: Motion) -> FloatArray:
        """d/dt of the state (13, ...): a rigid body of revolution (Eq. 2.2 to 2.4)."""
        rates, aerodynamics = state[RATES], self.config.aerodynamics
        transverse = body_from_plane(*self.plane_moments(motion), motion.windward_meridian)
        scale = air.dynamic_pressure * self.config.vehicle.reference_area * self.config.vehicle.reference_length
        roll = aerodynamics.C_l0 + aerodynamics.C_lp * motion.p * motion.rate_factor
        moment = scale * np.array([roll, transverse.real, transverse.imag])
        angular = 1.0 / self.inertia * (moment - cross(rates, self.inertia * rates))
        return np.concatenate([state[VELOCITY], air.acceleration, attitude_rate(state[ATTITUDE], rates), angular])

    def body_moments(self, state: FloatArray, angular: FloatArray, air: AirData) -> FloatArray:
        """C_l, C_m, C_n (3, ...) from angular accelerations (3, ...) rad/s^2: Euler's equations, inverted."""
        moment = self.inertia * angular + cross(state[RATES], self.inertia * state[RATES])
        scale = air.dynamic_pressure * self.config.vehicle.reference_area * self.config.vehicle.reference_length
        return np.asarray(np.divide(moment, scale, out=np.zeros_like(moment), where=scale > 0.0))

    def gravity_and_altitude(self, position: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Gravity (3, ...) m/s^2 in the frame and altitude m; inverse-square."""
        x, y, z = position
        down = np.array([-x, -y, EARTH_RADIUS - z])
        radius = np.sqrt(dot(down, down))
        return down * (self.config.environment.gravity * EARTH_RADIUS**2 / radius**3), radius - EARTH_RADIUS

    def wind(self, time: FloatArray) -> tuple[FloatArray | float, FloatArray | float]:
        """Velocity of the air in the frame and its change, (3, ...) m/s and m/s^2."""
        return (0.0, 0.0) if self.wind_profile is None else self.wind_profile.at(time)


def system(config: SimulationConfig) -> Equations:
    """The equations of motion of a flight; what is planted is looked up among the installed mechanisms."""
    return Equations(config, (*planted(config, config.asymmetries), *planted(config, config.mechanisms)))


def initial_state(equations: Equations) -> FloatArray:
    """State (13, 1) at the start; alpha lies in the vertical plane of the track."""
    start = equations.config.start
    path, meridian = np.array([start.flight_path_angle]), np.array([start.windward_meridian])
    # such that alpha and its plane turn as configured on a straight path
    turned = complex(start.alpha_rate, start.coning_rate * np.tan(start.alpha))
    transverse = complex(turned * np.exp(-1j * start.windward_meridian))
    state = np.zeros((STATES, 1))
    state[2] = -start.altitude
    state[VELOCITY] = start.velocity * np.array([np.cos(path), np.zeros(1), -np.sin(path)])
    state[VELOCITY] += equations.wind(np.array([start.time]))[0]
    state[ATTITUDE] = from_pitch_roll(path + start.alpha, meridian)
    state[RATES, 0] = start.roll_rate, transverse.real, transverse.imag
    return state
