"""Appendix A: the wind from the instruments at one instant, in polar coordinates (A.11 to A.20, erratum E9)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.errors import UnanswerableError
from brv_hypo.motion.config import ReconstructionConfig
from brv_hypo.motion.inertial import InertialRecord, WindStart, force_impulse
from brv_hypo.motion.kinematics import crossflow
from brv_hypo.motion.method import WindHistory, nose_start, open_loop
from brv_hypo.motion.responses import Perturbation
from brv_hypo.motion.signals import Derivative, differentiate

POLAR_DOUBTFUL = 0.1  # relative, or rad: instants whose meridian or precession is known no better are passed over


def polar(record: InertialRecord, config: ReconstructionConfig, perturbations: Sequence[Perturbation]) -> WindHistory:
    """Start from the best-conditioned instant, then the attitude about a fixed velocity as in method 2.

    The meridian is where the transverse force points away from (A.11). The transverse rate then is (q + i r) exp(i
    phi_w) = alpha_rate + i alpha psi_c_rate (A.15 to A.17 as one complex equation), with psi_c_rate = p - phi_w_rate
    (A.16), whose imaginary part gives alpha without the square root of A.18. The rate at which the force itself turns
    the velocity, which A.15 leaves out, is taken off first. From there on the velocity is propagated as in method 1.
    One instant cannot tell gravity: where it is wanted, it comes from the nose's mean, as in method 1.
    """
    spin = np.exp(1j * record.roll)
    flight = record.flight
    force = differentiate(record.transverse_force * spin, flight.step, record.accel_sigma, flight.segments)
    alpha, meridian, sigma = _polar_angles(record, force)
    sigma = np.where(record.measured & force.interior, sigma, np.inf)
    best = int(np.argmin(sigma))
    if not np.isfinite(sigma[best]):
        raise UnanswerableError(
            "at no instant do the accelerometers give the windward meridian and its rate well enough for "
            "the polar start of Appendix A: the transverse force is too small against its noise. "
            "Use method joint."
        )
    xi = crossflow(alpha[best : best + 1], meridian[best : best + 1])[0]
    body = np.array([np.sqrt(max(1.0 - abs(xi) ** 2, 0.0)), xi.real, xi.imag])
    nose, _, gravity_sigma = nose_start(record, config)
    velocity = record.flight.velocity[best] * (record.attitude[best] @ body)
    velocity = velocity - force_impulse(record)[best] - record.time[best] * nose.gravity
    start = WindStart(velocity / np.linalg.norm(velocity), nose.gravity)
    warning = (
        f"the start is from the single instant {record.flight.time[best]:.3f} s, taking the transverse "
        "force to lie in the plane of the angle of attack; method joint uses the whole record"
    )
    sigmas = float(sigma[best]), gravity_sigma
    return open_loop(
        record, config, perturbations, start, sigmas, known_at=float(record.time[best]), warnings=(warning,)
    )


def _polar_angles(record: InertialRecord, force: Derivative) -> tuple[FloatArray, FloatArray, FloatArray]:
    """alpha and phi_w (n,) at every instant and the direction's standard deviation, all in rad."""
    windward = -force.value * np.exp(-1j * record.roll)
    meridian = np.arctan2(windward.real, windward.imag)
    size_squared = np.maximum(np.abs(force.value) ** 2, 1e-300)
    precession_rate = (force.rate * np.conj(force.value)).imag / size_squared
    carried = 1j * force.value * np.exp(-1j * record.roll) / record.flight.velocity
    turned = (record.transverse_rate - carried) * np.exp(1j * meridian)
    alpha = turned.imag / np.where(precession_rate == 0.0, 1e-300, precession_rate)
    size = np.sqrt(size_squared)
    meridian_error = record.accel_sigma * force.value_gain / size
    precession_error = record.accel_sigma * force.rate_gain / size
    sigma = np.hypot(
        np.hypot(record.gyro_sigma, alpha * precession_error) / np.abs(precession_rate), alpha * meridian_error
    )
    doubtful = (precession_error > POLAR_DOUBTFUL * np.abs(precession_rate)) | (meridian_error > POLAR_DOUBTFUL)
    return np.abs(alpha), meridian, np.where(doubtful | (alpha < 0.0), np.inf, sigma)
