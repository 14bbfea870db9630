"""Axes and angles of CONVENTIONS: crossflow, windward meridian, in-plane and out-of-plane axes.

A transverse pair (y, z) in body axes is one complex number y + i z. With it the conventions read

    crossflow        xi = (v + i w) / V = i sin(alpha) exp(-i phi_w)
    moment           C_m + i C_n = (C_N' + i C_Z') exp(-i phi_w)
    transverse rate  omega = q + i r

All functions are elementwise over arrays of any one shape.
"""

from __future__ import annotations

import numpy as np

from brv_hypo.arrays import ComplexArray, FloatArray

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
