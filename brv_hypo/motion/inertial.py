"""What the instruments say before any wind is assumed: attitude, forces at the c.g., noise levels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from brv_hypo.arrays import BoolArray, ComplexArray, FloatArray
from brv_hypo.errors import UnanswerableError
from brv_hypo.flight.record import Flight
from brv_hypo.motion.attitude import body_attitude
from brv_hypo.motion.config import ReconstructionConfig
from brv_hypo.motion.differentiation import Derivative, differentiate
from brv_hypo.motion.noise import ColouredNoise, transverse_noise_level, white_noise_level

FEWEST_SAMPLES = 16  # of the longest segment: the fewest that a record may have (FLIGHT_FORMAT)


@dataclass(frozen=True)
class InertialRecord:
    """A flight, integrated; transverse pairs are y + i z, arrays are over time (n,).

    `roll` rad, the integral of p; `attitude` (n, 3, 3) turns body axes into those of the first sample;
    `transverse_rate` q + i r rad/s, smoothed, and `rate_change` its derivative, rad/s^2; `spin_rate` is the
    filter's work on (q + i r) exp(i `spin_angle`), `spin_angle` being (1 - Ix/I) of the roll, where spin
    coupling drops out; `force` (n, 3) m/s^2 the specific force at the c.g. in body axes; `measured` where
    the instruments were read, not bridged; `gyro_sigma` rad/s, `accel_sigma` m/s^2 white noise;
    `gyro_walk` rad/s the noise that the attitude is integrated with; `force_sigma` (n,) m/s^2 that of the transverse
    force once moved to the c.g.
    """

    flight: Flight
    roll: FloatArray
    attitude: FloatArray
    transverse_rate: ComplexArray
    rate_change: ComplexArray
    spin_rate: Derivative
    spin_angle: FloatArray
    force: FloatArray
    measured: BoolArray
    gyro_sigma: float
    gyro_walk: ColouredNoise
    accel_sigma: float
    force_sigma: FloatArray

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

    def to_body(self, vectors: FloatArray) -> FloatArray:
        """Vectors (n, 3) in the axes of the first sample, turned into body axes."""
        return np.asarray(np.einsum("nji,nj->ni", self.attitude, vectors))


def inertial_record(flight: Flight, config: ReconstructionConfig) -> InertialRecord:
    """Integrate the gyros and move the accelerometers to the c.g.

    Raises UnanswerableError where the record is too short for any of it.
    """
    _refuse_what_cannot_be_integrated(flight)
    gyro_sigma = config.gyro_sigma or transverse_noise_level(flight.q, flight.r, flight.segments)
    accel_sigma = config.accel_sigma or transverse_noise_level(flight.ay, flight.az, flight.segments)
    time = flight.time - flight.time[0]
    roll, attitude = body_attitude(time, flight.p, flight.q + 1j * flight.r)
    spin_angle = (1.0 - flight.vehicle.inertia_ratio) * roll
    spin = differentiate(
        (flight.q + 1j * flight.r) * np.exp(1j * spin_angle), flight.step, gyro_sigma, flight.segments
    )
    rate = spin.value * np.exp(-1j * spin_angle)
    turning = 1j * (1.0 - flight.vehicle.inertia_ratio) * flight.p * rate
    change = spin.rate * np.exp(-1j * spin_angle) - turning
    force, force_sigma = _force_at_cg(flight, rate, change, spin, gyro_sigma, accel_sigma)
    return InertialRecord(
        flight=flight,
        roll=roll,
        attitude=attitude,
        transverse_rate=rate,
        rate_change=change,
        spin_rate=spin,
        spin_angle=spin_angle,
        force=force,
        measured=_measured(flight),
        gyro_sigma=gyro_sigma,
        gyro_walk=config.gyro_walk or ColouredNoise(gyro_sigma),
        accel_sigma=accel_sigma,
        force_sigma=force_sigma,
    )


def _refuse_what_cannot_be_integrated(flight: Flight) -> None:
    longest = max(b - a for a, b in flight.segments)
    if longest < FEWEST_SAMPLES:
        raise UnanswerableError(
            f"the longest stretch without a gap has {longest} samples; reconstruction needs at least "
            f"{FEWEST_SAMPLES}. Widen --start and --stop, or bridge the gaps of the record."
        )
    for name in ("velocity", "dynamic_pressure"):
        lowest = float(np.min(getattr(flight, name)))
        if not lowest > 0.0:
            raise UnanswerableError(
                f"{name} falls to {lowest:.3g}; angles and coefficients need it above zero throughout. "
                "Likely cause: the record goes on after landing or before entry. Narrow it with --start and "
                "--stop."
            )


def _measured(flight: Flight) -> BoolArray:
    inside = np.zeros(flight.samples, dtype=bool)
    for start, stop in flight.segments:
        inside[start:stop] = True
    return inside


def arm_acceleration(
    p: FloatArray, p_change: FloatArray, rate: ComplexArray, change: ComplexArray, arm: FloatArray
) -> FloatArray:
    """omega_dot x r + omega x (omega x r), (n, 3) m/s^2 at `arm` (3,) m from the c.g. (errata E10, E11).

    `p` and q + i r = `rate` (n,) rad/s; `p_change`, `change` their derivatives.
    """
    x, y, z = arm
    q, r, q_change, r_change = rate.real, rate.imag, change.real, change.imag
    pq, pr, qr, pp, qq, rr = p * q, p * r, q * r, p * p, q * q, r * r
    out = np.empty((p.size, 3))
    out[:, 0] = -(qq + rr) * x + (pq - r_change) * y + (pr + q_change) * z
    out[:, 1] = (pq + r_change) * x - (pp + rr) * y + (qr - p_change) * z
    out[:, 2] = (pr - q_change) * x + (qr + p_change) * y - (pp + qq) * z
    return out


def _force_at_cg(
    flight: Flight,
    rate: ComplexArray,
    change: ComplexArray,
    spin: Derivative,
    gyro_sigma: float,
    accel_sigma: float,
) -> tuple[FloatArray, FloatArray]:
    """Specific force at the c.g. (n, 3) and its transverse noise (n,), from CONVENTIONS."""
    arm = np.asarray(flight.vehicle.accelerometer_position, dtype=float)
    sensed = np.stack([flight.ax, flight.ay, flight.az], axis=1)
    if not np.any(arm):
        return sensed, np.full(flight.samples, accel_sigma)
    roll_rate = differentiate(
        flight.p.astype(complex), flight.step, white_noise_level(flight.p, flight.segments), flight.segments
    )
    moved = sensed - arm_acceleration(flight.p, roll_rate.rate.real, rate, change, arm)
    gain = np.where(np.isfinite(spin.rate_gain), spin.rate_gain, 0.0)
    return moved, np.sqrt(accel_sigma**2 + (np.linalg.norm(arm) * gyro_sigma * gain) ** 2)
