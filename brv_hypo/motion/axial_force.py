"""The course of the axial force, by which a c.g. off the axis turns the vehicle."""

from __future__ import annotations

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.constants import AXIAL_SEEN
from brv_hypo.motion.inertial import InertialRecord, arm_acceleration


def axial_share(record: InertialRecord, alpha: FloatArray) -> FloatArray | None:
    """The axial force's coefficient over its median (n,): what drifts, and what goes with alpha squared.

    None where it changes the force by no more than the fit leaves, or by what errors of the accelerometers may be: a
    transverse force that they read along the axis goes with alpha too.
    """
    place = np.linspace(-1.0, 1.0, alpha.size)
    shapes = np.column_stack([np.ones_like(place), place, place**2, alpha**2])
    count, scale, seen = shapes.shape[1], record.force_scale, record.measured
    columns = np.column_stack([scale[:, np.newaxis] * shapes, _read_along_the_axis(record)])[seen]
    force = record.force[seen, 0]
    left = max(float(np.std(force - columns @ np.linalg.lstsq(columns, force, rcond=None)[0])), 1e-300)
    priors = np.eye(columns.shape[1])[count:]
    rows = np.vstack([columns / left, priors])
    values = np.linalg.lstsq(rows, np.concatenate([force / left, np.zeros(len(priors))]), rcond=None)[0]
    coefficient = shapes @ values[:count]
    changes = float(np.std(coefficient) * np.median(scale)) > left
    # With the changes last, the triangle's last rows hold what of them is beyond all others.
    others = [0, *range(count, columns.shape[1])]
    _, triangle = np.linalg.qr(rows[:, [*others, *range(1, count)]])
    if not changes or float(np.sum((triangle[len(others) :, len(others) :] @ values[1:count]) ** 2)) < AXIAL_SEEN:
        return None
    return np.asarray(coefficient / np.median(coefficient), dtype=float)


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
