"""Six degrees of freedom over a flat earth: quaternion, full inertia tensor, DOP853 with its history for delays.

State (13,): position and velocity of the c.g. in earth axes (z down), quaternion body to earth, body rates.
"""

from __future__ import annotations

import cmath
import math
from bisect import bisect_left
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.integrate import DOP853

from tests.studies.independent.air import GRAVITY, Wind, atmosphere, sound_speed, viscosity
from tests.studies.independent.imperfections import Imperfections
from tests.studies.independent.instruments import Errors, inertia_tensor
from tests.studies.independent.mechanisms import Planted, Running
from tests.studies.independent.vehicles import Craft, Start

RELATIVE_TOLERANCE = 1e-9
# Of position (m), velocity (m/s), quaternion, rates (rad/s).
ABSOLUTE_TOLERANCE = np.repeat([1e-5, 1e-7, 1e-10, 1e-9], [3, 3, 4, 3])
LEAST_STEP_FOR_DELAY = 8e-3  # s: a shorter delay is interpolated within the step, by a cubic
MOST_STEPS = 20_000  # of the integration
PAD = 0.05  # s flown before and after the record

Flow = tuple[float, float, complex, complex]


@dataclass(frozen=True)
class Snapshot:
    """Everything at one time, SI; `moment` C_m + i C_n, `contribution` C_N' + i C_Z' of what is planted."""

    alpha: float
    meridian: float
    speed: float
    mach: float
    density: float
    dynamic_pressure: float
    force: np.ndarray  # specific force (3,) m/s^2 at the c.g.
    rates: np.ndarray
    rates_change: np.ndarray
    moment: complex
    contribution: complex
    running: Running


class History:
    """The past of a flight: dense output by step; knows nothing later than its last step."""

    def __init__(self, first: float) -> None:
        self.first = first
        self.ends: list[float] = []
        self.pieces: list[Callable[[float], np.ndarray]] = []

    def add(self, end: float, piece: Callable[[float], np.ndarray]) -> None:
        self.ends.append(end)
        self.pieces.append(piece)

    def at(self, time: float) -> np.ndarray:
        """State (13,); before the flight, its first."""
        time = max(time, self.first)
        return self.pieces[min(bisect_left(self.ends, time), len(self.ends) - 1)](time)

    def many(self, times: np.ndarray) -> np.ndarray:
        """States (n, 13)."""
        return np.array([self.at(float(time)) for time in times])


class Body:
    """Equations of motion of one flight with its planted mechanism and its vehicle's and air's errors."""

    def __init__(
        self,
        craft: Craft,
        start: Start,
        errors: Errors,
        planted: Planted,
        pad: float,
        imperfections: Imperfections | None = None,
    ) -> None:
        self.craft, self.start, self.planted, self.imperfections = craft, start, planted, imperfections
        self.wind = Wind(errors.wind, craft.duration, planted.gust)
        self.still = self.wind.still and imperfections is None
        vehicle = craft.vehicle
        tensor = inertia_tensor(vehicle.ixx, vehicle.iyy, errors)
        if imperfections is not None:
            tensor = imperfections.inertia(tensor)
        self.tensor = tensor.tolist()
        self.inverse = np.linalg.inv(tensor).tolist()
        self.centre = (0.0, *(float(value) for value in errors.cg_offset))
        self.history = History(-pad)
        self.pad = pad
        self.anchor: tuple[float, complex, complex] | None = None
        density, _ = atmosphere(craft.altitude)
        self.scale = vehicle.reference_area * vehicle.reference_length
        pressure = 0.5 * density * craft.speed**2
        self.frequency = math.sqrt(pressure * self.scale * abs(craft.static_slope) / vehicle.iyy)
        self.roll_moment = start.roll_acceleration * vehicle.ixx / (pressure * self.scale)

    def winds(self, time: float) -> tuple[np.ndarray, np.ndarray]:
        """Wind (3,) m/s and its rate (3,) m/s^2: the slow one, and what is imperfect."""
        wind, rate = self.wind.at(time)
        if self.imperfections is None:
            return wind, rate
        climb = self.craft.speed * math.sin(self.craft.flight_path)
        more, quicker = self.imperfections.winds(time, climb)
        return wind + more, rate + quicker

    def static_slope(self, speed: float) -> float:
        craft = self.craft
        return craft.static_slope * (1.0 + craft.stiffness_drift * (speed / craft.speed - 1.0))

    def first_state(self, time: float) -> np.ndarray:
        craft, start = self.craft, self.start
        pitch = craft.flight_path
        along = np.array([math.cos(pitch), 0.0, -math.sin(pitch)])
        nose = math.cos(start.alpha) * along + math.sin(start.alpha) * np.array([0.0, 1.0, 0.0])
        windward = (along - math.cos(start.alpha) * nose) / math.sin(start.alpha)
        across = np.cross(nose, windward)
        sine, cosine = math.sin(start.meridian), math.cos(start.meridian)
        body_y = sine * windward - cosine * across
        body_z = cosine * windward + sine * across
        coning = start.coning * self.frequency * math.sin(start.alpha)
        nutation = start.nutation * self.frequency * start.alpha
        turn = [start.roll_rate, coning * sine - nutation * cosine, coning * cosine + nutation * sine]
        velocity = craft.speed * along + self.winds(time)[0]
        quaternion = _quaternion(np.stack([nose, body_y, body_z], axis=1))
        return np.concatenate([[0.0, 0.0, -craft.altitude], velocity, quaternion, turn])

    def derivative(self, time: float, state: np.ndarray) -> np.ndarray:
        return np.array(self._equations(time, state)[0])

    def snapshot(self, time: float, state: np.ndarray) -> Snapshot:
        """The snapshot at a time already flown."""
        return self._equations(time, state)[1]()

    def _equations(self, time: float, state: np.ndarray) -> tuple[list[float], Callable[[], Snapshot]]:
        craft, vehicle = self.craft, self.craft.vehicle
        _, _, down, vx, vy, vz, *quaternion, p, q, r = state.tolist()
        m = _matrix(quaternion)
        gx, gy, gz = 0.0, 0.0, GRAVITY
        if not self.still:
            wind, gust = self.winds(time)
            vx, vy, vz = vx - wind[0], vy - wind[1], vz - wind[2]
            gx, gy, gz = -gust[0], -gust[1], GRAVITY - gust[2]
        u, v, w = (m[0][k] * vx + m[1][k] * vy + m[2][k] * vz for k in range(3))
        speed = math.sqrt(u * u + v * v + w * w)
        cross = math.hypot(v, w)
        alpha = math.atan2(cross, u)
        per_cross = alpha / cross if cross > 1e-9 else 1.0 / u
        density, temperature = atmosphere(-down)
        if self.imperfections is not None:
            density *= self.imperfections.density(-down)
        pressure = 0.5 * density * speed * speed
        push = pressure * vehicle.reference_area
        normal = craft.normal_slope * craft.bent(craft.normal_bend, alpha)
        fx, fy, fz = (
            -push * craft.axial * craft.bent(craft.axial_bend, alpha),
            -push * normal * per_cross * v,
            -push * normal * per_cross * w,
        )
        ax, ay, az = fx / vehicle.mass, fy / vehicle.mass, fz / vehicle.mass
        ud, vd, wd = (
            a + m[0][k] * gx + m[1][k] * gy + m[2][k] * gz - turn
            for k, (a, turn) in enumerate(((ax, q * w - r * v), (ay, r * u - p * w), (az, p * v - q * u)))
        )
        reduced = vehicle.reference_length / (2.0 * speed)
        slope = self.static_slope(speed)
        air = (density, temperature)
        running = self._running(time, (u, v, w), (ud, vd, wd), alpha, (p, q, r), reduced, slope, air)
        planted = self.planted.contribution(running)
        meridian = running.meridian
        _, cy, cz = self.centre
        unlisted, torque_share = 0j, 1.0
        if self.imperfections is not None:
            unlisted, torque_share = self.imperfections.moment(running), self.imperfections.torque_share(time)
            dy, dz = self.imperfections.centre(time)
            cy, cz = cy + dy, cz + dz
        moment = (
            slope * craft.bent(craft.static_bend, alpha) * per_cross * (w - 1j * v)
            + craft.damping * (q + 1j * r) * reduced
            + (planted + unlisted) * cmath.exp(-1j * meridian)
        )
        roll = self.roll_moment + craft.roll_damping * p * reduced
        twist = pressure * self.scale
        torque = (
            (twist * roll - (cy * fz - cz * fy)) * torque_share,
            (twist * moment.real - cz * fx) * torque_share,
            (twist * moment.imag + cy * fx) * torque_share,
        )
        change = _spin_change(self.tensor, self.inverse, (p, q, r), torque)
        rate = [
            *state[3:6].tolist(),
            *(m[k][0] * ax + m[k][1] * ay + m[k][2] * az for k in range(2)),
            m[2][0] * ax + m[2][1] * ay + m[2][2] * az + GRAVITY,
            *_quaternion_rate(quaternion, p, q, r),
            *change,
        ]

        def snapshot() -> Snapshot:
            return Snapshot(
                alpha, meridian, speed, running.mach, density, pressure, np.array([ax, ay, az]),
                np.array([p, q, r]), np.array(change), moment, planted, running,
            )  # fmt: skip

        return rate, snapshot

    def _running(
        self,
        time: float,
        velocity: tuple[float, float, float],
        change: tuple[float, ...],
        alpha: float,
        rates: tuple[float, float, float],
        reduced: float,
        slope: float,
        air: tuple[float, float],
    ) -> Running:
        (p, q, r), (density, temperature) = rates, air
        u, v, w = velocity
        ud, vd, wd = change
        square = max(v * v + w * w, 1e-18)
        cross = math.sqrt(square)
        cross_change = (v * vd + w * wd) / cross
        speed = math.sqrt(u * u + square)
        meridian = math.atan2(v, w)
        alpha_rate = (u * cross_change - cross * ud) / speed**2
        meridian_rate = (vd * w - v * wd) / square
        here = alpha * cmath.exp(1j * meridian)
        here_rate = (alpha_rate + 1j * alpha * meridian_rate) * cmath.exp(1j * meridian)

        mach, imperfect = speed / sound_speed(temperature), self.imperfections

        def static(angle: float) -> float:
            """The whole of it: what lags or sticks is the moment that the vehicle has."""
            own = slope * angle * self.craft.bent(self.craft.static_bend, angle)
            return own if imperfect is None else own + imperfect.static(angle, mach)

        def past(delay: float) -> tuple[float, float]:
            flow = self._crossflow(time - delay, time, here, here_rate)
            return abs(flow), cmath.phase(flow)

        return Running(
            time, alpha, meridian, alpha_rate, meridian_rate,
            mach, p * reduced, reduced, static, past,
            complex(q, r) * cmath.exp(1j * meridian),
            math.log10(density * speed * self.craft.vehicle.reference_length / viscosity(temperature)),
        )  # fmt: skip

    def _crossflow(self, then: float, time: float, here: complex, rate: complex) -> complex:
        """alpha e^{i phi_w} at an earlier time: from the history, or between its end and now by a cubic."""
        anchor = self.anchor
        if anchor is None or then <= anchor[0] or time <= anchor[0]:
            return self._flow_of(then, self.history.at(then))
        first, value, slope = anchor
        span = time - first
        s = (then - first) / span
        return (
            (1 + 2 * s) * (1 - s) ** 2 * value
            + s * (1 - s) ** 2 * span * slope
            + s * s * (3 - 2 * s) * here
            + s * s * (s - 1) * span * rate
        )

    def _flow_of(self, time: float, state: np.ndarray) -> complex:
        m = _matrix(state[6:10].tolist())
        vx, vy, vz = (state[3:6] - (0.0 if self.still else self.winds(time)[0])).tolist()
        u, v, w = (m[0][k] * vx + m[1][k] * vy + m[2][k] * vz for k in range(3))
        cross = math.hypot(v, w)
        return complex(w, v) * (math.atan2(cross, u) / cross if cross > 1e-9 else 1.0 / u)

    def fly(self) -> None:
        """Fills the history from -pad to duration + pad."""
        time, last = -self.pad, self.craft.duration + self.pad
        state = self.first_state(time)
        for stop in [*(edge for edge in self.planted.edges if time < edge < last), last]:
            if stop - time < 1e-9:
                continue
            time, state = self._fly_piece(time, stop, state)
        self.anchor = None

    def _fly_piece(self, time: float, stop: float, state: np.ndarray) -> tuple[float, np.ndarray]:
        delay = self.planted.delay_at(time)
        longest = max(delay, LEAST_STEP_FOR_DELAY) if delay > 0.0 else np.inf
        # Within a piece the mechanism is wholly on or off: the edge itself belongs to the piece after it.
        inside = 1e-12 * max(stop - time, 1.0)
        solver = DOP853(
            lambda t, y: self.derivative(min(t, stop - inside), y),
            time,
            state,
            stop,
            max_step=longest,
            rtol=RELATIVE_TOLERANCE,
            atol=ABSOLUTE_TOLERANCE,
        )
        self._set_anchor(time, state)
        while solver.status == "running":
            message = solver.step()
            if len(self.history.ends) > MOST_STEPS:
                message = f"more than {MOST_STEPS} steps: the motion runs away"
            if solver.status == "failed" or message:
                raise RuntimeError(f"the flight of {self.craft.name} ends at {solver.t:.4f} s: {message}")
            self.history.add(solver.t, solver.dense_output())
            self._set_anchor(solver.t, solver.y)
        return solver.t, solver.y

    def _set_anchor(self, time: float, state: np.ndarray) -> None:
        if all(part.delay == 0.0 for part in self.planted.parts):
            return
        self.anchor = None
        running = self.snapshot(time, state).running if self.history.ends else None
        if running is None:
            return
        value = running.alpha * cmath.exp(1j * running.meridian)
        rate = (running.alpha_rate + 1j * running.alpha * running.meridian_rate) * cmath.exp(1j * running.meridian)
        self.anchor = (time, value, rate)


def _matrix(quaternion: list[float]) -> tuple[tuple[float, float, float], ...]:
    """Body to earth; the quaternion need not have unit length."""
    a, b, c, d = quaternion
    n = 2.0 / (a * a + b * b + c * c + d * d)
    return (
        (1 - n * (c * c + d * d), n * (b * c - a * d), n * (b * d + a * c)),
        (n * (b * c + a * d), 1 - n * (b * b + d * d), n * (c * d - a * b)),
        (n * (b * d - a * c), n * (c * d + a * b), 1 - n * (b * b + c * c)),
    )


def _quaternion_rate(quaternion: list[float], p: float, q: float, r: float) -> tuple[float, ...]:
    a, b, c, d = quaternion
    return (
        -0.5 * (b * p + c * q + d * r),
        0.5 * (a * p + c * r - d * q),
        0.5 * (a * q + d * p - b * r),
        0.5 * (a * r + b * q - c * p),
    )


def _quaternion(matrix: np.ndarray) -> np.ndarray:
    """Of a rotation (3, 3): the eigenvector of the largest eigenvalue of Bar-Itzhack's matrix."""
    m = matrix
    k = np.array(
        [
            [m[0, 0] + m[1, 1] + m[2, 2], m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]],
            [m[2, 1] - m[1, 2], m[0, 0] - m[1, 1] - m[2, 2], m[0, 1] + m[1, 0], m[0, 2] + m[2, 0]],
            [m[0, 2] - m[2, 0], m[0, 1] + m[1, 0], m[1, 1] - m[0, 0] - m[2, 2], m[1, 2] + m[2, 1]],
            [m[1, 0] - m[0, 1], m[0, 2] + m[2, 0], m[1, 2] + m[2, 1], m[2, 2] - m[0, 0] - m[1, 1]],
        ]
    )
    return np.asarray(np.linalg.eigh(k)[1][:, -1])


def _spin_change(
    tensor: list[list[float]], inverse: list[list[float]], rates: tuple[float, ...], torque: tuple[float, ...]
) -> tuple[float, float, float]:
    """Euler's equations: J^-1 (M - omega x J omega)."""
    p, q, r = rates
    hx, hy, hz = (row[0] * p + row[1] * q + row[2] * r for row in tensor)
    nx, ny, nz = torque[0] - (q * hz - r * hy), torque[1] - (r * hx - p * hz), torque[2] - (p * hy - q * hx)
    x, y, z = (row[0] * nx + row[1] * ny + row[2] * nz for row in inverse)
    return x, y, z


def flown(
    craft: Craft,
    start: Start,
    errors: Errors,
    planted: Planted,
    pad: float = PAD,
    imperfections: Imperfections | None = None,
) -> Body:
    body = Body(craft, start, errors, planted, pad, imperfections)
    body.fly()
    return body


def stack(snapshots: Sequence[Snapshot], name: str) -> np.ndarray:
    """One quantity of many times."""
    values: list[Any] = [getattr(snapshot, name) for snapshot in snapshots]
    return np.array(values)
