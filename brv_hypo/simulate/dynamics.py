"""The vehicle in flight: forces, moments and the rate of the state, for a batch of flights at one instant.

State (13, ...): position and velocity in a non-rotating frame (x along the initial track, y to its right, z down,
origin at sea level under the start), attitude quaternion body to frame, rates p, q, r. Every function is elementwise
over the trailing axes: (flights,) in the integration, (nodes, flights) over a whole record.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from brv_hypo.arrays import ComplexArray, FloatArray
from brv_hypo.design.baseline import pitch_damping_term, static_terms
from brv_hypo.motion.frames import angle_rates, body_from_plane, windward_meridian
from brv_hypo.motion.motion import Motion
from brv_hypo.simulate import rotation
from brv_hypo.simulate.atmosphere import standard_air
from brv_hypo.simulate.config import SimulationConfig
from brv_hypo.simulate.planting import Planted, planted
from brv_hypo.simulate.variation import per_flight

POSITION, VELOCITY, ATTITUDE, RATES = slice(0, 3), slice(3, 6), slice(6, 10), slice(10, 13)
STATES = 13
EARTH_RADIUS = 6.371e6

Past = Callable[[FloatArray], Motion]


class RunningMotion(Motion):
    """A motion at the running state; a delay may differ from flight to flight."""

    def delayed(self, tau: float | FloatArray) -> Motion:
        """The motion tau earlier; tau is one number or (flights,)."""
        if np.all(np.equal(tau, 0.0)) or self.history is None:
            return super().delayed(0.0 if self.history is not None else 1.0)
        return self.history(tau)  # type: ignore[arg-type]


@dataclass(frozen=True)
class AirData:
    """Velocity relative to the air and what follows from it; vectors (3, ...) in body axes, SI."""

    rotation: FloatArray
    velocity: FloatArray
    velocity_rate: FloatArray
    speed: FloatArray
    altitude: FloatArray
    dynamic_pressure: FloatArray
    mach: FloatArray
    reynolds: FloatArray
    crossflow: ComplexArray
    specific_force: FloatArray
    acceleration: FloatArray
    """In the frame: gravity and aerodynamic force."""


@dataclass(frozen=True)
class System:
    """The equations of motion of a batch: each parameter is (flights,)."""

    mass: FloatArray
    inertia: FloatArray
    inertia_inverse: FloatArray
    reference_length: FloatArray
    reference_area: FloatArray
    coefficients: dict[str, FloatArray]
    slope_variations: tuple[tuple[str, str, FloatArray, FloatArray, FloatArray], ...]
    gravity: FloatArray
    spherical: bool
    density: FloatArray | None
    wind: tuple[FloatArray, FloatArray] | None
    planted: tuple[Planted, ...]

    def air_data(self, time: FloatArray, state: FloatArray) -> AirData:
        """Forces and air-relative kinematics; the moments have no part in them."""
        turn = rotation.matrix(state[ATTITUDE])
        altitude, gravity = self._gravity(state[POSITION])
        velocity = rotation.to_body(turn, state[VELOCITY] - self._wind(time))
        crossed = velocity[1] + 1j * velocity[2]
        speed = np.sqrt(np.sum(velocity**2, axis=0))
        air = standard_air(altitude)
        density = air.density if self.density is None else self.density
        pressure = 0.5 * density * speed**2
        force = self._specific_force(pressure, velocity, crossed)
        velocity_rate = rotation.to_body(turn, gravity) + force - rotation.cross(state[RATES], velocity)
        return AirData(
            rotation=turn, velocity=velocity, velocity_rate=velocity_rate, speed=speed, altitude=altitude,
            dynamic_pressure=pressure, mach=speed / air.speed_of_sound,
            reynolds=density * speed * self.reference_length / air.viscosity, crossflow=crossed / speed,
            specific_force=force, acceleration=gravity + rotation.to_frame(turn, force),
        )

    def motion(
        self, time: FloatArray, state: FloatArray, air: AirData, near: FloatArray, past: Past | None
    ) -> Motion:
        """What mechanisms see at this state; the meridian is the turn nearest to `near` (rad)."""
        xi_rate = (air.velocity_rate[1] + 1j * air.velocity_rate[2]) / air.speed - air.crossflow * (
            np.sum(air.velocity * air.velocity_rate, axis=0) / air.speed**2
        )
        alpha_rate, meridian_rate = angle_rates(air.crossflow, xi_rate)
        meridian = windward_meridian(air.crossflow)
        p, q, r = state[RATES]
        motion = RunningMotion(
            time=time,
            alpha=_alpha(air),
            # `angle_rates` knows the forward half only; beyond 90 degrees the crossflow shrinks as alpha grows.
            alpha_rate=np.copysign(1.0, air.velocity[0]) * alpha_rate,
            windward_meridian=meridian + 2.0 * np.pi * np.round((near - meridian) / (2.0 * np.pi)),
            windward_meridian_rate=meridian_rate,
            p=p, q=q, r=r,
            velocity=air.speed, dynamic_pressure=air.dynamic_pressure, mach=air.mach, reynolds=air.reynolds,
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
        """d/dt of the state (13, ...): rigid body with the full inertia tensor (Eq. 2.2 to 2.4 without their poles)."""
        rates = state[RATES]
        transverse = body_from_plane(*self.plane_moments(motion), motion.windward_meridian)
        scale = air.dynamic_pressure * self.reference_area * self.reference_length
        roll = self.coefficients["C_l0"] + self.coefficients["C_lp"] * motion.p * motion.rate_factor
        moment = scale * np.array([roll, transverse.real, transverse.imag])
        momentum = np.einsum("ij...,j...->i...", self.inertia, rates)
        angular = np.einsum("ij...,j...->i...", self.inertia_inverse, moment - rotation.cross(rates, momentum))
        return np.concatenate([state[VELOCITY], air.acceleration, rotation.rate(state[ATTITUDE], rates), angular])

    def body_moments(self, state: FloatArray, angular: FloatArray, air: AirData) -> FloatArray:
        """C_l, C_m, C_n (3, ...) from angular accelerations (3, ...) rad/s^2: the inverse of the Euler equations."""
        momentum = np.einsum("ij...,j...->i...", self.inertia, state[RATES])
        moment = np.einsum("ij...,j...->i...", self.inertia, angular) + rotation.cross(state[RATES], momentum)
        scale = air.dynamic_pressure * self.reference_area * self.reference_length
        return np.divide(moment, scale, out=np.zeros_like(moment), where=scale > 0.0)

    def _gravity(self, position: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Altitude m and gravity (3, ...) m/s^2 in the frame."""
        down = np.zeros_like(position)
        if not self.spherical:
            altitude = -position[2]
            down[2] = self.gravity * (EARTH_RADIUS / (EARTH_RADIUS + altitude)) ** 2
            return altitude, down
        down[:] = -position
        down[2] += EARTH_RADIUS
        radius = np.sqrt(np.sum(down**2, axis=0))
        return radius - EARTH_RADIUS, down * (self.gravity * EARTH_RADIUS**2 / radius**3)

    def _wind(self, time: FloatArray) -> FloatArray | float:
        if self.wind is None:
            return 0.0
        start, velocity = self.wind
        shape = (3,) + (1,) * (time.ndim - 1) + velocity.shape[1:]
        return np.asarray(velocity.reshape(shape) * (time >= start), dtype=float)

    def _specific_force(self, pressure: FloatArray, velocity: FloatArray, crossed: ComplexArray) -> FloatArray:
        """Axial and normal force per mass, (3, ...) in body axes; the normal force opposes the crossflow."""
        size = np.abs(crossed)
        alpha = np.arctan2(size, velocity[0])
        normal = -self.coefficients["C_Nalpha_force"] * alpha * crossed / np.maximum(size, 1e-300)
        axial = np.broadcast_to(-self.coefficients["C_A"], pressure.shape)
        return (pressure * self.reference_area / self.mass) * np.array([axial, normal.real, normal.imag])

    def _wind_fixed_moment(self, motion: Motion) -> FloatArray:
        """C_mw of Eq. 5.1: the static terms, their variations, and planted mechanisms that are wind-fixed."""
        offset, slope = static_terms(motion)
        moment = self.coefficients["C_N0"] * offset.in_plane + self._slope(motion) * slope.in_plane
        moment = moment + self.coefficients["C_Nalpha3"] * motion.alpha**3
        for item in self.planted:
            if item.mechanism.wind_fixed:
                moment = moment + item.contribution(motion)[0]
        return np.asarray(moment, dtype=float)

    def _slope(self, motion: Motion) -> FloatArray:
        slope = self.coefficients["C_Nalpha"]
        for variable, kind, change, at, width in self.slope_variations:
            beyond = getattr(motion, variable) - at
            if kind == "step":
                with np.errstate(divide="ignore", invalid="ignore"):
                    smooth = 0.5 * (1.0 + np.tanh(beyond / width))
                beyond = np.where(width > 0.0, smooth, beyond >= 0.0)
            slope = slope + change * beyond
        return slope


def system(configs: Sequence[SimulationConfig]) -> System:
    """The equations of motion of a batch, one configuration per flight."""
    first = configs[0]
    inertia = np.stack([_inertia(config) for config in configs], axis=-1)
    names = [name for name in type(first.aerodynamics).model_fields if name != "slope_variations"]
    wind = first.environment.wind_step
    thin = first.environment.constant_density is None
    return System(
        mass=per_flight(configs, lambda c: c.vehicle.mass),
        inertia=inertia,
        inertia_inverse=np.moveaxis(np.linalg.inv(np.moveaxis(inertia, -1, 0)), 0, -1),
        reference_length=per_flight(configs, lambda c: c.vehicle.reference_length),
        reference_area=per_flight(configs, lambda c: c.vehicle.reference_area),
        coefficients={n: per_flight(configs, lambda c, n=n: getattr(c.aerodynamics, n)) for n in names},
        slope_variations=tuple(_slope_variation(configs, i) for i in range(len(first.aerodynamics.slope_variations))),
        gravity=per_flight(configs, lambda c: c.environment.gravity),
        spherical=first.environment.planet_shape == "spherical",
        density=None if thin else per_flight(configs, lambda c: c.environment.constant_density or 0.0),
        wind=None if wind is None else (_wind_time(configs), _wind_velocity(configs)),
        planted=planted(configs),
    )


def initial_state(configs: Sequence[SimulationConfig], equations: System) -> FloatArray:
    """State (13, flights) at the start: alpha and meridian relative to the air, in the vertical plane of the track."""
    start = {
        name: per_flight(configs, lambda c, name=name: getattr(c.start, name))
        for name in ("altitude", "velocity", "flight_path_angle", "alpha", "windward_meridian", "roll_rate")
    }
    state = np.zeros((STATES, len(configs)))
    state[2] = -start["altitude"]
    path = start["flight_path_angle"]
    state[VELOCITY] = start["velocity"] * np.array([np.cos(path), np.zeros_like(path), -np.sin(path)])
    state[VELOCITY] += equations._wind(per_flight(configs, lambda c: c.start.time))
    state[ATTITUDE] = rotation.from_pitch_roll(path + start["alpha"], start["windward_meridian"])
    transverse = np.array([_transverse_rate(config) for config in configs])
    state[RATES] = np.array([start["roll_rate"], transverse.real, transverse.imag])
    return state


def _transverse_rate(config: SimulationConfig) -> complex:
    """q + i r: given, or that at which alpha and its plane turn as asked: crossflow kinematics, path bending aside."""
    start = config.start
    if start.q is not None and start.r is not None:
        return complex(start.q, start.r)
    turned = complex(start.alpha_rate, start.coning_rate * np.tan(start.alpha))
    return complex(turned * np.exp(-1j * start.windward_meridian))


def _inertia(config: SimulationConfig) -> FloatArray:
    body = config.vehicle
    return np.array([
        [body.ixx, -body.ixy, -body.ixz],
        [-body.ixy, body.iyy, 0.0],
        [-body.ixz, 0.0, body.iyy],
    ])


def _slope_variation(
    configs: Sequence[SimulationConfig], index: int
) -> tuple[str, str, FloatArray, FloatArray, FloatArray]:
    first = configs[0].aerodynamics.slope_variations[index]
    change, at, width = (
        per_flight(configs, lambda c, n=n: getattr(c.aerodynamics.slope_variations[index], n))
        for n in ("change", "at", "width")
    )
    return first.variable, first.kind, change, at, width


def _wind_time(configs: Sequence[SimulationConfig]) -> FloatArray:
    return per_flight(configs, lambda c: c.environment.wind_step.time if c.environment.wind_step else np.inf)


def _wind_velocity(configs: Sequence[SimulationConfig]) -> FloatArray:
    still = (0.0, 0.0, 0.0)
    return np.array([c.environment.wind_step.velocity if c.environment.wind_step else still for c in configs]).T


def _alpha(air: AirData) -> FloatArray:
    """Total angle of attack, rad, over the whole sphere (CONVENTIONS)."""
    return np.asarray(np.arctan2(np.abs(air.crossflow) * air.speed, air.velocity[0]), dtype=float)
