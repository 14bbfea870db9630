"""Open-loop methods: the velocity is propagated from a start, where gyro noise adds up as a random walk.

`velocity` is method 1 (Eq. 3.1), `rates` method 2, Belknap's angular rate method (Section 3.2.2); both start by the
nose's mean direction (`nose_start`). `polar` is Appendix A: the wind from the instruments at one instant, in polar
coordinates (A.11 to A.20, erratum E9).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.errors import UnanswerableError
from brv_hypo.motion.inertial import (
    InertialRecord,
    WindStart,
    body_crossflow,
    cycles,
    force_impulse,
    gravity_size,
    start_from_nose,
    wind_direction,
)
from brv_hypo.motion.methods import ReconstructionConfig
from brv_hypo.motion.motion import crossflow
from brv_hypo.motion.reconstruction import WindHistory
from brv_hypo.motion.responses import EffectFit, Perturbation, effect_responses, nonzero_responses
from brv_hypo.motion.signals import Derivative, differentiate

NO_GRAVITY = "gravity is left out: it turns the velocity by about g t / V"


def nose_start(
    record: InertialRecord, config: ReconstructionConfig, *, forces: bool = True
) -> tuple[WindStart, float, float]:
    """The start by the nose's mean direction; the standard deviations of each part of it, rad, and of gravity, m/s^2.

    The mean errs by what a broken cycle adds, and gravity, which follows from the nose's drift, by that over time.
    Where gravity is left out it is its own standard deviation.
    """
    size = config.gravity_magnitude or gravity_size(record.flight)
    start = start_from_nose(record, size if config.gravity else 0.0, forces=forces)
    xi = body_crossflow(record, wind_direction(record, start, forces=forces))
    sigma = float(np.sqrt(0.5 * np.mean(np.abs(xi) ** 2)) / (np.pi * cycles(record)))
    if not config.gravity:
        return start, sigma, size
    return start, sigma, float(np.sqrt(12.0) * sigma * np.mean(record.flight.velocity) / record.time[-1])


def from_nose(
    record: InertialRecord, config: ReconstructionConfig, perturbations: Sequence[Perturbation], *, forces: bool
) -> WindHistory:
    """`open_loop` from the nose's mean direction, which is best known in the middle of the record."""
    start, sigma, gravity_sigma = nose_start(record, config, forces=forces)
    middle = 0.5 * float(record.time[-1])
    return open_loop(record, config, perturbations, start, (sigma, gravity_sigma), middle, forces=forces)


def open_loop(
    record: InertialRecord,
    config: ReconstructionConfig,
    perturbations: Sequence[Perturbation],
    start: WindStart,
    sigmas: tuple[float, float],
    known_at: float,
    *,
    forces: bool = True,
    warnings: tuple[str, ...] = (),
) -> WindHistory:
    """Attitude about a velocity propagated from `start`: gyro noise adds up as a random walk.

    `sigmas`: those of each part of the direction, rad, which is known best `known_at` s after the first sample, and of
    each part of gravity, m/s^2. Errors of the record are as large as expected: nothing here measures them.
    """
    speed = record.flight.velocity
    xi = body_crossflow(record, wind_direction(record, start, forces=forces))
    elapsed = np.abs(record.time - known_at)
    walk = record.gyro_sigma**2 * record.flight.step * elapsed
    responses = nonzero_responses(effect_responses(record, xi, record.transverse_force, perturbations))
    drift = responses.rows.all_of(responses.drift)
    moved = drift - drift[int(np.argmin(elapsed))]
    errors = np.sum(moved**2, axis=(1, 2)) / (2.0 * speed**2)
    none, prior = np.zeros(len(responses.effects)), np.eye(len(responses.effects))
    sigma = np.sqrt(sigmas[0] ** 2 + walk + (sigmas[1] * elapsed / speed) ** 2 + errors)
    return WindHistory(
        record=record,
        crossflow=xi,
        radial_sigma=sigma,
        tangential_sigma=sigma,
        gravity=start.gravity,
        normal_force_slope=np.full(xi.size, np.nan),
        accel_sigma=record.accel_sigma,
        effects=EffectFit(responses, none, none, prior),
        warnings=warnings if config.gravity else (*warnings, NO_GRAVITY),
    )


def velocity(
    record: InertialRecord, config: ReconstructionConfig, perturbations: Sequence[Perturbation]
) -> WindHistory:
    """v and w by Eq. 3.1, speed by the record, started from the mean direction of the nose.

    Gravity is found with the start unless `config.gravity` is off. The equation is neutrally stable: what
    the start and the gyros err by stays.
    """
    return from_nose(record, config, perturbations, forces=True)


def rates(record: InertialRecord, config: ReconstructionConfig, perturbations: Sequence[Perturbation]) -> WindHistory:
    """Eq. 3.2 (erratum E4), started from the mean direction of the nose.

    The velocity keeps its direction, as the report has it, or turns by gravity alone (`config.gravity`).
    """
    return from_nose(record, config, perturbations, forces=False)


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


METHODS = (velocity, rates, polar)
