"""The vehicle in flight: forces, moments and the rate of the state, for a batch of flights at one instant.

State (13, ...): position and velocity in a non-rotating frame (x along the initial track, y to its right, z down,
origin at sea level under the start), attitude quaternion body to frame, rates p, q, r. All functions are elementwise
over the trailing axes: (flights,) in the integration, (nodes, flights) over a whole record. `system` builds the
equations of motion (Eq. 2.2 to 2.4) of a batch from its configurations, `initial_state` its first state.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from brv_hypo.arrays import ComplexArray, FloatArray
from brv_hypo.model.baseline import pitch_damping_term, static_terms
from brv_hypo.motion.kinematics import angle_rates, body_from_plane, windward_meridian
from brv_hypo.motion.motion import Motion, nearest_turn
from brv_hypo.simulation import rotation
from brv_hypo.simulation.air import WindProfile, WindStep, standard_air
from brv_hypo.simulation.config import AerodynamicsConfig, SimulationConfig, per_flight
from brv_hypo.simulation.planted import Planted, planted

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
        turn = rotation.matrix(state[ATTITUDE])
        gravity, altitude = self.gravity_and_altitude(state[POSITION])
        wind, wind_rate = self.wind(time)
        velocity = rotation.to_body(turn, state[VELOCITY] - wind)
        crossed = velocity[1] + 1j * velocity[2]
        speed = np.sqrt(rotation.dot(velocity, velocity))
        air = standard_air(altitude)
        density = air.density if self.density is None else self.density
        pressure = 0.5 * density * speed**2
        force = self._specific_force(pressure, velocity, crossed)
        velocity_rate = rotation.to_body(turn, gravity - wind_rate) + force - rotation.cross(state[RATES], velocity)
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
            acceleration=gravity + rotation.to_frame(turn, force),
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
            rotation.dot(air.velocity, air.velocity_rate) / air.speed**2
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
        momentum = rotation.transform(self.inertia, rates)
        angular = rotation.transform(self.inertia_inverse, moment - rotation.cross(rates, momentum))
        return np.concatenate([state[VELOCITY], air.acceleration, rotation.rate(state[ATTITUDE], rates), angular])

    def body_moments(self, state: FloatArray, angular: FloatArray, air: AirData) -> FloatArray:
        """C_l, C_m, C_n (3, ...) from angular accelerations (3, ...) rad/s^2: Euler's equations, inverted."""
        momentum = rotation.transform(self.inertia, state[RATES])
        moment = rotation.transform(self.inertia, angular) + rotation.cross(state[RATES], momentum)
        scale = air.dynamic_pressure * self.reference_area * self.reference_length
        return np.asarray(np.divide(moment, scale, out=np.zeros_like(moment), where=scale > 0.0))

    def gravity_and_altitude(self, position: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Gravity (3, ...) m/s^2 in the frame and altitude m; inverse-square."""
        x, y, z = position
        down = np.array([-x, -y, EARTH_RADIUS - z])
        radius = np.sqrt(rotation.dot(down, down))
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
    state[ATTITUDE] = rotation.from_pitch_roll(path + per_flight(configs, "start", "alpha"), meridian)
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
