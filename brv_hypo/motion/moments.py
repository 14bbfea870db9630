"""Moment coefficients from the gyros, and the axial force, by which a c.g. off the axis turns the vehicle.

Euler's equations inverted (Eq. 2.3, Section 3.2.4): with y = (q + i r) exp(i (1 - Ix/I) roll) the spin coupling drops
out,   y' = exp(i (1 - Ix/I) roll) (q_inf S d / I) (C_m + i C_n).

`moment_estimate` is the entrance; `axial_share` the axial coefficient over its median.
"""

from __future__ import annotations

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.motion.inertial import InertialRecord, arm_acceleration
from brv_hypo.motion.reconstruction import MomentEstimate
from brv_hypo.motion.responses import EffectFit

AXIAL_SIGNIFICANT = 25.0  # squares of standard errors by which the axial coefficient has to change (seed 162023)


def moment_estimate(record: InertialRecord, effects: EffectFit) -> MomentEstimate:
    """C_m + i C_n and its standard deviation, in which noise and estimated bias of the differentiation count.

    `record` is corrected by the `known` of its errors; the rest of the estimates is subtracted here, and their
    covariance counts in `sigma`.
    """
    spin = record.spin_rate
    responses = effects.responses.moment
    noise = error_of_differentiation(record)
    return MomentEstimate(
        body=record.moment - responses.of(effects.value - effects.known),
        sigma=np.sqrt(noise**2 + 0.5 * responses.variance(effects.covariance)),
        noise_sigma=noise,
        usable=record.measured & spin.interior,
        noise_correlation=spin.noise_correlation,
        spin_angle=record.spin_angle,
    )


def error_of_differentiation(record: InertialRecord) -> FloatArray:
    """Standard deviation (n,) of C_m and of C_n by the gyros' noise and the estimated bias of their differentiation.

    Positive too where errors that were taken out of an accepted record turned the sign of its dynamic pressure.
    """
    return np.asarray(np.hypot(record.rate_noise, record.spin_rate.rate_bias) / np.abs(record.moment_scale))


def static_in_plane(in_plane: FloatArray, alpha: FloatArray, weight: FloatArray) -> FloatArray:
    """C_m0 + C_malpha alpha (n,) fitted to the in-plane moment by weighted least squares."""
    root = np.sqrt(weight)
    columns = np.column_stack([np.ones_like(alpha), alpha])
    return np.asarray(columns @ np.linalg.lstsq(columns * root[:, None], in_plane * root, rcond=None)[0])


def axial_share(record: InertialRecord, alpha: FloatArray) -> FloatArray | None:
    """The axial force's coefficient over its median (n,): what drifts, and what goes with alpha squared.

    None where it changes the force by no more than the fit leaves, or by what errors of the accelerometers may be: a
    transverse force that they read along the axis goes with alpha too.
    """
    place = np.linspace(-1.0, 1.0, alpha.size)
    shapes = np.column_stack([np.ones_like(place), place, place**2, alpha**2])
    count, scale, valid = shapes.shape[1], record.force_scale, record.measured
    columns = np.column_stack([scale[:, np.newaxis] * shapes, _read_along_the_axis(record)])[valid]
    force = record.force[valid, 0]
    left = max(float(np.std(force - columns @ np.linalg.lstsq(columns, force, rcond=None)[0])), 1e-300)
    priors = np.eye(columns.shape[1])[count:]
    rows = np.vstack([columns / left, priors])
    values = np.linalg.lstsq(rows, np.concatenate([force / left, np.zeros(len(priors))]), rcond=None)[0]
    coefficient = shapes @ values[:count]
    # With the changes last, the triangle's last rows hold what of them is beyond all others.
    others = [0, *range(count, columns.shape[1])]
    _, triangle = np.linalg.qr(rows[:, [*others, *range(1, count)]])
    squares = float(np.sum((triangle[len(others) :, len(others) :] @ values[1:count]) ** 2))
    significant = float(np.std(coefficient) * np.median(scale)) > left and squares >= AXIAL_SIGNIFICANT
    return np.asarray(coefficient / np.median(coefficient), dtype=float) if significant else None


def _read_along_the_axis(record: InertialRecord) -> FloatArray:
    """What the axial accelerometer reads (n, errors) m/s^2 by one tolerance of its bias, tilt and place."""
    flight, tolerances = record.flight, record.flight.instruments
    _, tilt_y, tilt_z = tolerances.accel_misalignment
    still = np.zeros_like(flight.p)
    places = [
        arm_acceleration(flight.p, still, record.transverse_rate, record.rate_change, arm)[:, 0]
        for arm in np.diag(tolerances.accel_position)
    ]
    bias = np.full_like(flight.p, tolerances.accel_bias[0])
    return np.column_stack([bias, tilt_z * flight.ay, tilt_y * flight.az, *places])
