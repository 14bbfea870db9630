"""Attitude from rate gyros: the roll angle, and the de-rolled axes in the axes of the first sample.

The de-rolled axes turn with the body but for its roll: x is the body's, and a transverse pair is y + i z
times exp(i roll). What is left to integrate varies with the slow pitching motion only, whatever the roll
rate.
"""

from __future__ import annotations

import numpy as np

from brv_hypo.arrays import ComplexArray, FloatArray
from brv_hypo.motion.splines import running_integral


def derolled_attitude(time: FloatArray, transverse_rate: ComplexArray) -> FloatArray:
    """Rotation matrices (n, 3, 3) from de-rolled axes to those of the first sample.

    `transverse_rate` (n,) is (q + i r) exp(i roll) in rad/s. Where its direction changes within a step,
    rotations do not commute: what that leaves about x, to second order, is added (Bortz, IEEE Trans. AES
    7:61, 1971).
    """
    angle = running_integral(time, transverse_rate)
    steps = np.diff(angle, prepend=angle[:1])
    coning = np.zeros(time.size)
    coning[1:] = np.diff(time) ** 2 / 12.0 * (np.conj(transverse_rate[:-1]) * transverse_rate[1:]).imag
    return _matrices(_running_product(_quaternions(coning, steps)))


def rolled(derolled: FloatArray, roll: FloatArray) -> FloatArray:
    """De-rolled axes (n, 3, 3) turned on by the roll angle (n,): the body's."""
    cosine, sine = np.cos(roll)[:, np.newaxis], np.sin(roll)[:, np.newaxis]
    second, third = derolled[:, :, 1], derolled[:, :, 2]
    return np.stack(
        [derolled[:, :, 0], second * cosine + third * sine, third * cosine - second * sine], axis=2
    )


def body_attitude(
    time: FloatArray, p: FloatArray, transverse_rate: ComplexArray
) -> tuple[FloatArray, FloatArray]:
    """Roll angle (n,) rad, and rotations (n, 3, 3) from body axes to those of the first sample.

    `p` (n,) and q + i r (n,), rad/s, in body axes.
    """
    roll = running_integral(time, p)
    return roll, rolled(derolled_attitude(time, transverse_rate * np.exp(1j * roll)), roll)


def _quaternions(axial: FloatArray, transverse: ComplexArray) -> FloatArray:
    """Unit quaternions (n, 4), scalar first, of rotation vectors (axial, Re, Im) in rad."""
    half = 0.5 * np.hypot(axial, np.abs(transverse))
    scale = 0.5 * np.sinc(half / np.pi)
    return np.stack([np.cos(half), scale * axial, scale * transverse.real, scale * transverse.imag], axis=1)


def _product(a: FloatArray, b: FloatArray) -> FloatArray:
    """Quaternion products a b, (n, 4)."""
    a0, a1, a2, a3 = a.T
    b0, b1, b2, b3 = b.T
    return np.stack(
        [
            a0 * b0 - a1 * b1 - a2 * b2 - a3 * b3,
            a0 * b1 + a1 * b0 + a2 * b3 - a3 * b2,
            a0 * b2 - a1 * b3 + a2 * b0 + a3 * b1,
            a0 * b3 + a1 * b2 - a2 * b1 + a3 * b0,
        ],
        axis=1,
    )


def _running_product(quaternions: FloatArray) -> FloatArray:
    """Products of the first 1, 2, ... n, by doubling: log2(n) vectorised passes."""
    product = quaternions.copy()
    reach = 1
    while reach < product.shape[0]:
        product[reach:] = _product(product[:-reach], product[reach:])
        reach *= 2
    return np.asarray(product / np.linalg.norm(product, axis=1, keepdims=True))


def _matrices(quaternions: FloatArray) -> FloatArray:
    w, x, y, z = quaternions.T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), 2, 0)
