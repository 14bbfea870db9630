"""Measured inputs freed of noise: roll rate, speed and pressure enter the equations of motion, and their
noise accumulates.

What is left of it is slow: a polynomial in time per input, whose coefficients are known beforehand to the
noise over the root of the number of samples. They are parameters with just that prior (`NOISY_INPUTS`), so
that standard errors know of them.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.interpolate import BSpline

from brv_hypo.arrays import ComplexArray, FloatArray
from brv_hypo.flight.record import Flight
from brv_hypo.motion.attitude import running_integral

_INTERVALS = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64)
_PATIENCE = 3
_SAMPLES_PER_INTERVAL = 6


NOISY_INPUTS = ("roll rate", "pressure")
NOISE_DEGREE = 2


def noise_name(channel: str, degree: int) -> str:
    """Name of the Legendre coefficient of the error that smoothing leaves in an input."""
    return f"{channel} noise {degree}"


def noise_size(values: FloatArray, smooth: FloatArray, degree: int) -> float:
    """Standard deviation of that coefficient, in the units of the input."""
    return float(np.sqrt((2 * degree + 1) * np.mean((values - smooth) ** 2) / values.size))


def smoothed(values: FloatArray) -> FloatArray:
    """Cubic least-squares spline (n,) through evenly spaced samples; its number of intervals by BIC.

    What varies faster than the finest spline stays as it was measured, where it is more than noise.
    """
    n = values.size
    best, least, worse = values, np.inf, 0
    for intervals in _INTERVALS:
        if intervals * _SAMPLES_PER_INTERVAL > n:
            break
        basis = _orthonormal(n, intervals)
        fitted = basis @ (basis.T @ values)
        rss = float(np.sum((values - fitted) ** 2))
        score = n * np.log(max(rss, 1e-24 * float(values @ values))) + basis.shape[1] * np.log(n)
        if score < least:
            best, least, worse = fitted, score, 0
        else:
            worse += 1
        if worse == _PATIENCE:
            break
    return np.asarray(best)


def smooth_speed(flight: Flight, xi: ComplexArray) -> FloatArray:
    """Speed (n,), m/s: the integral of the force along the velocity, at the crossflow `xi`, plus what varies
    slowly.

    Drag follows the angle of attack, so that the speed itself is not slow; what the accelerometers leave over
    is.
    """
    forward = np.sqrt(np.maximum(1.0 - np.abs(xi) ** 2, 0.0))
    along = flight.ax * forward + ((flight.ay + 1j * flight.az) * np.conj(xi)).real
    impulse = running_integral(flight.time, along)
    return smoothed(flight.velocity - impulse) + impulse


def smooth_pressure(flight: Flight, speed: FloatArray) -> FloatArray:
    """Dynamic pressure (n,), Pa: a slow density times the square of the speed."""
    return smoothed(flight.dynamic_pressure / speed**2) * speed**2


@lru_cache(maxsize=32)
def _orthonormal(n: int, intervals: int) -> FloatArray:
    """Orthonormal basis (n, intervals + 3) of the cubic splines on evenly spaced intervals."""
    inner = np.linspace(0.0, n - 1.0, intervals + 1)
    knots = np.concatenate([[0.0] * 3, inner, [n - 1.0] * 3])
    return np.linalg.qr(BSpline.design_matrix(np.arange(n, dtype=float), knots, 3).toarray())[0]
