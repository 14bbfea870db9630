"""Strapdown navigation: attitude, specific force at the c.g. and noise levels, and the velocity that follows from them.

`inertial_record` integrates the gyros and moves the accelerometers to the c.g., before any wind is assumed. In axes
that do not turn, Eq. 3.1 is then a quadrature, linear in the velocity at the start and in gravity:

    V(t) = V_0 + integral of specific force + g t

The attitude comes by way of the de-rolled axes, which turn with the body but for its roll: x is the body's, and a
transverse pair is y + i z times exp(i roll). What is left to integrate varies with the slow pitching motion only,
whatever the roll rate. The magnitude of V is the speed through still air; what turns the air's flow is divided by the
speed relative to the air, the record's `velocity`, which a wind along the track changes. `start_from_nose` is the start
of the angular rate method (Section 3.2.1), `NominalMotion` what a record makes of a start.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from brv_hypo.arrays import BoolArray, ComplexArray, FloatArray
from brv_hypo.errors import UnanswerableError
from brv_hypo.flight.record import Flight
from brv_hypo.motion.interpolation import running_integral
from brv_hypo.motion.methods import ReconstructionConfig
from brv_hypo.motion.motion import unit
from brv_hypo.motion.signals import ColouredNoise, Filtered, differentiate, differentiated, white_noise_level
from brv_hypo.thresholds import MINIMUM_SAMPLES

START_STEP = 1e-7  # rad, and of gravity's size, in derivatives by the start
FREE_GRAVITY = 30.0  # m/s^2 that gravity may be where the planet is not known
FAR_OFF_AXIS = 0.9  # cosine to an axis, beyond which axes across are built on the next
LEAST_CYCLES = 0.5  # of the nose, that a record counts as
GRAVITY_KNOWN = 0.02  # 1-sigma of its size: it is taken as constant over the record, in size and direction
HEIGHTS = 9  # parts of the record, of whose mean altitudes each has an error of its own
HEIGHT_READ, HEIGHT_KNOWN = 30.0, 0.05  # m; and of a height that is lost, by air that is no standard air: 1-sigma
# Surface gravity m/s^2 and mean radius m.
_PLANETS = {
    "earth": (9.80665, 6.371e6),
    "mars": (3.721, 3.3895e6),
    "venus": (8.87, 6.0518e6),
    "titan": (1.352, 2.5747e6),
}


@dataclass(frozen=True)
class InertialRecord:
    """A flight of n samples, its gyros integrated; transverse pairs are y + i z."""

    flight: Flight  # the record
    roll: FloatArray  # integral of p (n,), rad
    attitude: FloatArray  # turns body axes into those of the first sample (n, 3, 3)
    transverse_rate: ComplexArray  # q + i r (n,) rad/s, smoothed
    rate_change: ComplexArray  # its derivative (n,), rad/s^2
    spin_rate: Filtered  # the derivative of (q + i r) exp(i `spin_angle`), from which spin coupling drops out
    spin_angle: FloatArray  # (1 - Ix/I) of the roll (n,), rad
    force: FloatArray  # specific force at the c.g. in body axes (n, 3), m/s^2
    measured: BoolArray  # where the instruments were read (n,), not bridged
    gyro_sigma: float  # white noise of the transverse gyros, rad/s
    gyro_walk: ColouredNoise  # the noise that the attitude is integrated with, rad/s
    accel_sigma: float  # white noise of the transverse accelerometers, m/s^2
    force_sigma: FloatArray  # noise (n,) of the transverse force once moved to the c.g., m/s^2

    @property
    def time(self) -> FloatArray:
        """Time since the first sample, s."""
        return np.asarray(self.flight.time - self.flight.time[0])

    @property
    def transverse_force(self) -> ComplexArray:
        """Specific force f_y + i f_z at the c.g., m/s^2."""
        return np.asarray(self.force[:, 1] + 1j * self.force[:, 2])

    @property
    def force_scale(self) -> FloatArray:
        """q_inf S / m in m/s^2: specific force per unit force coefficient (Eq. 2.2)."""
        vehicle = self.flight.vehicle
        return np.asarray(self.flight.dynamic_pressure * vehicle.reference_area / vehicle.mass)

    @property
    def moment_scale(self) -> FloatArray:
        """q_inf S d / I in 1/s^2: angular acceleration per unit moment coefficient (Eq. 2.3)."""
        return np.asarray(self.flight.dynamic_pressure * self.flight.vehicle.moment_scale)

    @property
    def rate_noise(self) -> FloatArray:
        """Standard deviation (n,) of either part of the derolled rates' derivative by the gyros' noise, rad/s^2."""
        return np.asarray(self.gyro_sigma * self.spin_rate.rate_gain)

    @property
    def moment(self) -> ComplexArray:
        """C_m + i C_n (n,) by Euler's equations from the smoothed rates (Eq. 2.3)."""
        spin = 1.0 - self.flight.vehicle.inertia_ratio
        turning = 1j * spin * self.flight.p * self.transverse_rate
        return np.asarray((self.rate_change + turning) / self.moment_scale)

    @property
    def force_inertial(self) -> FloatArray:
        """Specific force at the c.g. in the axes of the first sample (n, 3), m/s^2."""
        return np.asarray(np.einsum("nij,nj->ni", self.attitude, self.force))

    @cached_property
    def force_impulse(self) -> FloatArray:
        """Velocity (n, 3) m/s gained by forces and by changes of wind, in the axes of the first sample."""
        impulse: FloatArray = running_integral(self.time, self.force_inertial)
        wind = self.flight.wind
        return impulse if wind is None else impulse - (wind - wind[0])

    def to_body(self, vectors: FloatArray) -> FloatArray:
        """Vectors (n, 3) in the axes of the first sample, turned into body axes."""
        return np.asarray(np.einsum("nji,nj->ni", self.attitude, vectors))


def inertial_record(flight: Flight, config: ReconstructionConfig) -> InertialRecord:
    """Gyros integrated, accelerometers moved to the c.g.; UnanswerableError where the record is too short for that."""
    longest = max(b - a for a, b in flight.segments)
    if longest < MINIMUM_SAMPLES:
        raise UnanswerableError(
            f"the longest stretch without a gap has {longest} samples; reconstruction needs at least "
            f"{MINIMUM_SAMPLES}. Widen --start and --stop, or bridge the gaps of the record."
        )
    for name in ("velocity", "dynamic_pressure"):
        lowest = float(np.min(getattr(flight, name)))
        if not lowest > 0.0:
            raise UnanswerableError(
                f"{name} falls to {lowest:.3g}; angles and coefficients need it above zero throughout. "
                "Likely cause: the record goes on after landing or before entry. Narrow it with --start and --stop."
            )
    rates = flight.q + 1j * flight.r
    gyro_sigma = config.gyro_sigma or white_noise_level(rates, flight.segments)
    accel_sigma = config.accel_sigma or white_noise_level(flight.ay + 1j * flight.az, flight.segments)
    roll, attitude = body_attitude(flight.time - flight.time[0], flight.p, rates)
    spin_angle = (1.0 - flight.vehicle.inertia_ratio) * roll
    spin = differentiate(rates * np.exp(1j * spin_angle), flight.step, gyro_sigma, flight.segments)
    rate = spin.value * np.exp(-1j * spin_angle)
    turning = 1j * (1.0 - flight.vehicle.inertia_ratio) * flight.p * rate
    change = spin.rate * np.exp(-1j * spin_angle) - turning
    force, force_sigma = sensed_force(flight), np.full(flight.samples, accel_sigma)
    arm = flight.vehicle.accelerometer_position
    if any(arm):
        p_change = differentiated(flight, flight.p).rate.real
        force = force - arm_acceleration(flight.p, p_change, rate, change, arm)
        gain = np.where(np.isfinite(spin.rate_gain), spin.rate_gain, 0.0)
        force_sigma = np.sqrt(accel_sigma**2 + (np.linalg.norm(arm) * gyro_sigma * gain) ** 2)
    return InertialRecord(
        flight=flight,
        roll=roll,
        attitude=attitude,
        transverse_rate=rate,
        rate_change=change,
        spin_rate=spin,
        spin_angle=spin_angle,
        force=force,
        measured=flight.measured(),
        gyro_sigma=gyro_sigma,
        gyro_walk=config.gyro_walk or ColouredNoise(gyro_sigma),
        accel_sigma=accel_sigma,
        force_sigma=force_sigma,
    )


def arm_acceleration(
    p: FloatArray, p_change: FloatArray, rate: ComplexArray, change: ComplexArray, arm: Iterable[float]
) -> FloatArray:
    """omega_dot x r + omega x (omega x r), (n, 3) m/s^2 at `arm` (3,) m from the c.g. (errata E10, E11). `p` and q + i
    r = `rate` (n,) rad/s; `p_change`, `change` their derivatives.
    """
    x, y, z = arm
    q, r, q_change, r_change = rate.real, rate.imag, change.real, change.imag
    pq, pr, qr, pp, qq, rr = p * q, p * r, q * r, p * p, q * q, r * r
    out = np.empty((p.size, 3))
    out[:, 0] = -(qq + rr) * x + (pq - r_change) * y + (pr + q_change) * z
    out[:, 1] = (pq + r_change) * x - (pp + rr) * y + (qr - p_change) * z
    out[:, 2] = (pr - q_change) * x + (qr + p_change) * y - (pp + qq) * z
    return out


def sensed_force(flight: Flight) -> FloatArray:
    """What the accelerometers read (n, 3), m/s^2."""
    return np.stack([flight.ax, flight.ay, flight.az], axis=1)


# ---- Attitude from rate gyros: the roll angle, and the de-rolled axes in the axes of the first sample ----


def derolled_attitude(time: FloatArray, transverse_rate: ComplexArray) -> FloatArray:
    """Rotation matrices (n, ..., 3, 3) from de-rolled axes to those of the first sample. `transverse_rate` (n, ...) is
    (q + i r) exp(i roll) in rad/s. Where its direction changes within a step, rotations do not commute: what that
    leaves about x, to second order, is added (Bortz, IEEE Trans. AES 7:61, 1971).
    """
    angle = running_integral(time, transverse_rate)
    steps = np.diff(angle, prepend=angle[:1], axis=0)
    coning = np.zeros(angle.shape)
    share = (np.diff(time) ** 2 / 12.0).reshape(-1, *(1,) * (angle.ndim - 1))
    coning[1:] = share * (np.conj(transverse_rate[:-1]) * transverse_rate[1:]).imag
    # Unit quaternions a + b j of the rotation vectors (coning, Re, Im): a = w + i x, b = y + i z.
    half = 0.5 * np.hypot(coning, np.abs(steps))
    scale = 0.5 * np.sinc(half / np.pi)
    return _matrices(*_running_product(np.cos(half) + 1j * (scale * coning), scale * steps))


def body_attitude(time: FloatArray, p: FloatArray, transverse_rate: ComplexArray) -> tuple[FloatArray, FloatArray]:
    """Roll (n, ...) rad, and rotations (n, ..., 3, 3) from body axes to the first sample's, by p and q + i r, rad/s."""
    roll = running_integral(time, p)
    turn = np.exp(1j * roll)
    first, second, third = np.moveaxis(derolled_attitude(time, transverse_rate * turn), -1, 0)
    cosine, sine = turn.real[..., np.newaxis], turn.imag[..., np.newaxis]
    return roll, np.stack([first, second * cosine + third * sine, third * cosine - second * sine], axis=-1)


def _running_product(a: ComplexArray, b: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
    """Products of the first 1, 2, ... n of quaternions a + b j, by doubling: log2(n) vectorised passes."""
    reach = 1
    while reach < a.shape[0]:
        before_a, before_b, own_a, own_b = a[:-reach], b[:-reach], a[reach:], b[reach:]
        a, b = (
            np.concatenate([a[:reach], before_a * own_a - before_b * np.conj(own_b)]),
            np.concatenate([b[:reach], before_a * own_b + before_b * np.conj(own_a)]),
        )
        reach *= 2
    length = np.sqrt(np.abs(a) ** 2 + np.abs(b) ** 2)
    return a / length, b / length


def _matrices(a: ComplexArray, b: ComplexArray) -> FloatArray:
    """Rotation matrices (n, ..., 3, 3) of unit quaternions a + b j."""
    w, x, y, z = a.real, a.imag, b.real, b.imag
    out = np.empty((*a.shape, 3, 3))
    xx, yy, zz, xy, xz, yz, wx, wy, wz = x * x, y * y, z * z, x * y, x * z, y * z, w * x, w * y, w * z
    out[..., 0, 0], out[..., 0, 1], out[..., 0, 2] = 1.0 - 2.0 * (yy + zz), 2.0 * (xy - wz), 2.0 * (xz + wy)
    out[..., 1, 0], out[..., 1, 1], out[..., 1, 2] = 2.0 * (xy + wz), 1.0 - 2.0 * (xx + zz), 2.0 * (yz - wx)
    out[..., 2, 0], out[..., 2, 1], out[..., 2, 2] = 2.0 * (xz - wy), 2.0 * (yz + wx), 1.0 - 2.0 * (xx + yy)
    return out


# ---- The velocity from a start, by forces and gravity ----


@dataclass(frozen=True)
class WindStart:
    """Unit velocity (3,) at the first sample and gravity (3,) m/s^2, both in the body axes of that sample."""

    direction: FloatArray
    gravity: FloatArray

    def moved(self, across: complex, gravity: FloatArray) -> WindStart:
        """A start that is turned by so many rad along its two transverse axes, under so much more gravity (3,)."""
        second, third = (axis[0] for axis in transverse_axes(self.direction[np.newaxis]))
        direction = self.direction + across.real * second + across.imag * third
        return WindStart(direction / np.linalg.norm(direction), self.gravity + gravity)


def gravity_magnitude(flight: Flight) -> float | None:
    """Gravity in m/s^2 at the record's mean altitude; None for a planet that is not known."""
    if flight.planet not in _PLANETS:
        return None
    surface, radius = _PLANETS[flight.planet]
    height = 0.0 if flight.altitude is None else float(np.nanmean(flight.altitude))
    return surface * (radius / (radius + height)) ** 2


def gravity_size(flight: Flight) -> float:
    """How large gravity may be, m/s^2."""
    return gravity_magnitude(flight) or FREE_GRAVITY


def wind_direction(record: InertialRecord, start: WindStart, *, forces: bool = True) -> FloatArray:
    """Unit velocity (n, 3) in the axes of the first sample; `forces` False: turned by gravity alone."""
    speed = record.flight.velocity
    if forces:
        pulled = speed[0] * start.direction + record.force_impulse + record.time[:, None] * start.gravity
        size = np.linalg.norm(pulled, axis=1)
        direction, more = pulled / size[:, None], speed - size
        # What changes the speed acts along the velocity v: v' = |v| u' + |v|' u has the airspeed's V' in place of |v|',
        # and the integral of V' u + |v| u' is V u less that of (V - |v|) u'.
        velocity = np.asarray(speed[:, None] * direction, dtype=float)
        velocity[1:] -= np.cumsum(0.5 * (more[1:] + more[:-1])[:, None] * np.diff(direction, axis=0), axis=0)
    else:
        turned = running_integral(record.time, start.gravity / speed[:, None])
        velocity = start.direction + turned - np.outer(turned @ start.direction, start.direction)
    return np.asarray(velocity / np.linalg.norm(velocity, axis=1, keepdims=True))


def body_crossflow(record: InertialRecord, direction: FloatArray) -> ComplexArray:
    """Crossflow (v + i w) / V (n,) of a velocity direction (n, 3)."""
    body = record.to_body(direction)
    return np.asarray(body[:, 1] + 1j * body[:, 2])


def transverse_axes(direction: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Two axes (n, 3) across the velocity, carried along by the smallest turn; a start that moves turns them little."""
    first = direction[0]
    helper = np.eye(3)[1 if abs(first[1]) < FAR_OFF_AXIS else 2]
    third = np.cross(first, helper)
    third /= np.linalg.norm(third)
    second = np.cross(third, first)
    both = first + direction
    size = 1.0 + direction @ first
    second, third = (axis - ((direction @ axis) / size)[:, None] * both for axis in (second, third))
    return second, third


@dataclass(frozen=True)
class NominalMotion:
    """What gyros and accelerometers alone make of a start; errors of it are in its wind axes."""

    record: InertialRecord
    start: WindStart

    @cached_property
    def direction(self) -> FloatArray:
        """Unit velocity (n, 3) in the axes of the first sample."""
        return wind_direction(self.record, self.start)

    @cached_property
    def crossflow(self) -> ComplexArray:
        """Its crossflow (n,)."""
        return body_crossflow(self.record, self.direction)

    @cached_property
    def axes(self) -> tuple[FloatArray, FloatArray]:
        """Its wind axes, two (n, 3) across the velocity."""
        return transverse_axes(self.direction)

    @cached_property
    def turn(self) -> ComplexArray:
        """Unit number (n,) that turns a transverse pair from wind axes into body axes."""
        second, third = (body_crossflow(self.record, axis) for axis in self.axes)
        return unit(second - 1j * third)

    def across(self, vectors: FloatArray, rows: slice = slice(None)) -> ComplexArray:
        """Transverse pairs (rows, k) in wind axes of velocities (rows, 3, k) that the vehicle has too much of."""
        second, third = (np.einsum("ni,nik->nk", axis[rows], vectors) for axis in self.axes)
        return np.asarray(-(second + 1j * third))

    def with_offset(self, offset: ComplexArray) -> ComplexArray:
        """The crossflow (n,) of a motion that is off it by so many rad (n,) in wind axes."""
        return np.asarray(self.crossflow + self.turn * offset)

    def by_start(self, crossflow: Callable[[NominalMotion], ComplexArray]) -> ComplexArray:
        """Change (n, 5) of a crossflow per rad of the start along its axes, and per m/s^2 of gravity along x, y, z."""
        size = START_STEP * np.array([1.0, 1.0, *np.full(3, gravity_size(self.record.flight))])
        starts = [self.start.moved(complex(*step[:2]), step[2:]) for step in np.diag(size)]
        ends = np.stack([crossflow(NominalMotion(self.record, start)) for start in starts], axis=1)
        return np.asarray((ends - crossflow(self)[:, np.newaxis]) / size)


def gravity_known(nominal: NominalMotion) -> tuple[FloatArray, FloatArray]:
    """Mean (3,) m/s^2 and information (3, 3) of gravity before any force is used, in axes of the first sample. Its
    size is that of the planet, linear about a start's gravity; along the path u from the start it does what the
    altitude h loses: g . integral of V u dt = |g| (h_0 - h).
    """
    record, start = nominal.record, nominal.start
    flight, size = record.flight, gravity_size(record.flight)
    information, right = np.eye(3) / size**2, np.zeros(3)
    if gravity_magnitude(flight) is None:
        return right, information
    if (pull := float(np.linalg.norm(start.gravity))) > 0.0:
        down = start.gravity / (pull * GRAVITY_KNOWN * size)
        information, right = information + np.outer(down, down), down / GRAVITY_KNOWN
    if flight.altitude is not None and (known := np.flatnonzero(np.isfinite(flight.altitude))).size >= HEIGHTS:
        path = running_integral(record.time, flight.velocity[:, np.newaxis] * nominal.direction)
        rows = np.column_stack([path / size, record.time, -flight.altitude])
        means = np.stack([rows[part].mean(axis=0) for part in np.array_split(known, HEIGHTS)])
        columns, elapsed, lost = np.split(means - means[0], [3, 4], axis=1)
        off = np.hstack([max(flight.instruments.wind) * elapsed, HEIGHT_KNOWN * lost, np.full_like(lost, HEIGHT_READ)])
        weighted = np.linalg.solve(off @ off.T + HEIGHT_READ**2 * np.eye(HEIGHTS), columns)
        information, right = information + weighted.T @ columns, right + (weighted.T @ lost)[:, 0]
    return np.asarray(np.linalg.solve(information, right), dtype=float), information


def cycles(record: InertialRecord) -> float:
    """How often the nose goes round or to and fro in the record, by the length of its path; at least 0.5."""
    nose = record.attitude[:, 1:, 0] - record.attitude[:, 1:, 0].mean(axis=0)
    path = float(np.sum(np.linalg.norm(np.diff(nose, axis=0), axis=1)))
    size = float(np.sqrt(np.mean(np.sum(nose**2, axis=1))))
    return max(path / (2.0 * np.pi * max(size, 1e-12)), LEAST_CYCLES)


def start_from_nose(record: InertialRecord, *, forces: bool = True) -> WindStart:
    """Start by the angular rate method, Section 3.2.1: the nose circles about the velocity. The report takes the mean
    Euler angles over a cycle; here the nose's mean offset from a velocity that gravity and forces turn is least.
    """
    speed = record.flight.velocity
    nose = record.attitude[:, :, 0]
    if forces:
        target, elapsed = nose * speed[:, None] - record.force_impulse, record.time
    else:
        target, elapsed = nose, running_integral(record.time, 1.0 / speed)
    spread = float(np.mean(np.abs(target - target.mean(axis=0)) ** 2))
    per_sample = record.time.size / (2.0 * cycles(record))
    columns = np.column_stack([np.ones(record.time.size), elapsed])
    normal = columns.T @ columns + np.diag([0.0, per_sample * spread / gravity_size(record.flight) ** 2])
    velocity, gravity = np.linalg.solve(normal, columns.T @ target)
    return WindStart(velocity / np.linalg.norm(velocity), gravity)
