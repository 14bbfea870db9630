"""Attitude as a quaternion (w, x, y, z), body to frame: no singularity at any attitude.

Arrays carry their components first: quaternions (4, ...), vectors (3, ...), matrices (3, 3, ...).
"""

from __future__ import annotations

import numpy as np

from brv_hypo.arrays import FloatArray


def matrix(attitude: FloatArray) -> FloatArray:
    """Body to frame, (3, 3, ...); scale of the quaternion drops out, so that stages need no normalising."""
    w, x, y, z = attitude * np.sqrt(2.0 / dot(attitude, attitude))
    xx, yy, zz = x * x, y * y, z * z
    xy, xz, yz, wx, wy, wz = x * y, x * z, y * z, w * x, w * y, w * z
    return np.array(
        [[1.0 - yy - zz, xy - wz, xz + wy], [xy + wz, 1.0 - xx - zz, yz - wx], [xz - wy, yz + wx, 1.0 - xx - yy]]
    )


def transform(tensor: FloatArray, vector: FloatArray) -> FloatArray:
    """A tensor (3, 3, ...) applied to a vector."""
    return np.asarray(np.einsum("ij...,j...->i...", tensor, vector), dtype=float)


def dot(a: FloatArray, b: FloatArray) -> FloatArray:
    """Sum of products over the components."""
    return np.asarray(np.einsum("i...,i...->...", a, b), dtype=float)


def to_frame(rotation: FloatArray, body: FloatArray) -> FloatArray:
    """A body vector in frame axes."""
    return transform(rotation, body)


def to_body(rotation: FloatArray, frame: FloatArray) -> FloatArray:
    """A frame vector in body axes."""
    return transform(rotation.swapaxes(0, 1), frame)


def rate(attitude: FloatArray, rates: FloatArray) -> FloatArray:
    """d/dt of the quaternion at body rates p, q, r (rad/s): half its product with (0, p, q, r)."""
    w, x, y, z = attitude
    p, q, r = 0.5 * rates
    return np.array([-x * p - y * q - z * r, w * p + y * r - z * q, w * q + z * p - x * r, w * r + x * q - y * p])


def from_pitch_roll(pitch: FloatArray, roll: FloatArray) -> FloatArray:
    """The attitude after a pitch, then a roll about the new x axis (rad)."""
    cp, sp, cr, sr = np.cos(pitch / 2), np.sin(pitch / 2), np.cos(roll / 2), np.sin(roll / 2)
    return np.array([cp * cr, cp * sr, sp * cr, -sp * sr])


def cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """a x b, components first (numpy's own is an order of magnitude slower on a single vector)."""
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])
