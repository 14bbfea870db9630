"""Axes, angles and attitude, as CONVENTIONS defines them.

A transverse pair (y, z) in body axes is one complex number y + i z. With it the conventions read

    crossflow        xi = (v + i w) / V = i sin(alpha) exp(-i phi_w)
    moment           C_m + i C_n = (C_N' + i C_Z') exp(-i phi_w)
    transverse rate  omega = q + i r

The angles are elementwise over arrays of any one shape. Attitude comes from the rate gyros by way of the de-rolled
axes, which turn with the body but for its roll: x is the body's, and a transverse pair is y + i z times exp(i roll).
What is left to integrate varies with the slow pitching motion only, whatever the roll rate. The entrance is
`body_attitude`.
"""

from __future__ import annotations

import numpy as np

from brv_hypo.arrays import ComplexArray, FloatArray
from brv_hypo.motion.interpolation import running_integral

# Below this crossflow (rad) the meridian rate is damped towards zero: it is undefined at alpha = 0.
CROSSFLOW_FLOOR = 1e-6


def angle_of_attack(crossflow: ComplexArray) -> FloatArray:
    """Total angle of attack in rad, >= 0, from the crossflow (v + i w) / V (Eq. 3.3)."""
    return np.asarray(np.arcsin(np.clip(np.abs(crossflow), 0.0, 1.0)), dtype=float)


def windward_meridian(crossflow: ComplexArray) -> FloatArray:
    """phi_w = atan2(v, w) in rad, from body z toward body y (Eq. 3.4, erratum E5); wrapped to (-pi, pi]."""
    return np.arctan2(crossflow.real, crossflow.imag)


def crossflow(alpha: FloatArray, phi_w: FloatArray) -> ComplexArray:
    """(v + i w) / V of an angle of attack and a windward meridian, both in rad (Eq. 2.5, erratum E1)."""
    return np.asarray(1j * np.sin(alpha) * np.exp(-1j * phi_w), dtype=complex)


def unit(xi: ComplexArray) -> ComplexArray:
    """Unit numbers of the same direction; zero stays zero."""
    return np.asarray(xi / np.maximum(np.abs(xi), 1e-12))


def effective(xi: ComplexArray) -> ComplexArray:
    """Crossflow of size alpha rather than sin(alpha): what a force linear in alpha follows."""
    size = np.abs(xi)
    return np.asarray(xi * (np.arcsin(np.minimum(size, 1.0)) / np.maximum(size, 1e-12)))


def angle_rates(xi: ComplexArray, xi_rate: ComplexArray) -> tuple[FloatArray, FloatArray]:
    """Rates of alpha and phi_w, rad/s, from the crossflow and its rate (1/s)."""
    product = xi_rate * np.conj(xi)
    size_squared = np.abs(xi) ** 2
    size = np.sqrt(size_squared + CROSSFLOW_FLOOR**2)
    cos_alpha = np.sqrt(np.maximum(1.0 - size_squared, 1e-12))
    return product.real / (size * cos_alpha), -product.imag / size**2


def body_from_plane(in_plane: FloatArray, out_of_plane: FloatArray, phi_w: FloatArray) -> ComplexArray:
    """C_m + i C_n from C_N' and C_Z' (Eq. 2.6, erratum E2)."""
    return np.asarray((in_plane + 1j * out_of_plane) * np.exp(-1j * phi_w), dtype=complex)


def plane_from_body(moment: ComplexArray, phi_w: FloatArray) -> ComplexArray:
    """C_N' + i C_Z' from C_m + i C_n: the inverse of `body_from_plane`."""
    return np.asarray(moment * np.exp(1j * phi_w), dtype=complex)


# ---- Attitude from rate gyros: the roll angle, and the de-rolled axes in the axes of the first sample ----


def derolled_attitude(time: FloatArray, transverse_rate: ComplexArray) -> FloatArray:
    """Rotation matrices (n, ..., 3, 3) from de-rolled axes to those of the first sample.

    `transverse_rate` (n, ...) is (q + i r) exp(i roll) in rad/s. Where its direction changes within a step, rotations
    do not commute: what that leaves about x, to second order, is added (Bortz, IEEE Trans. AES 7:61, 1971).
    """
    angle = running_integral(time, transverse_rate)
    steps = np.diff(angle, prepend=angle[:1], axis=0)
    coning = np.zeros(angle.shape)
    share = (np.diff(time) ** 2 / 12.0).reshape(-1, *(1,) * (angle.ndim - 1))
    coning[1:] = share * (np.conj(transverse_rate[:-1]) * transverse_rate[1:]).imag
    return _matrices(*_running_product(*_quaternions(coning, steps)))


def rolled(derolled: FloatArray, roll: FloatArray) -> FloatArray:
    """De-rolled axes (n, ..., 3, 3) turned on by the roll angle (n, ...): the body's."""
    cosine, sine = np.cos(roll)[..., np.newaxis], np.sin(roll)[..., np.newaxis]
    second, third = derolled[..., 1], derolled[..., 2]
    return np.stack([derolled[..., 0], second * cosine + third * sine, third * cosine - second * sine], axis=-1)


def body_attitude(time: FloatArray, p: FloatArray, transverse_rate: ComplexArray) -> tuple[FloatArray, FloatArray]:
    """Roll angle (n, ...) rad, and rotations (n, ..., 3, 3) from body axes to those of the first sample.

    `p` and q + i r (n, ...), rad/s, in body axes: one record, or several of the same times.
    """
    roll = running_integral(time, p)
    return roll, rolled(derolled_attitude(time, transverse_rate * np.exp(1j * roll)), roll)


def _quaternions(axial: FloatArray, transverse: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
    """Unit quaternions a + b j (n, ...) each, of rotation vectors (axial, Re, Im) in rad: a = w + i x, b = y + i z."""
    half = 0.5 * np.hypot(axial, np.abs(transverse))
    scale = 0.5 * np.sinc(half / np.pi)
    return np.cos(half) + 1j * (scale * axial), scale * transverse


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
