"""Cubic smoothing splines, and what they leave of the noise as a few independent shapes in time.

The weight of each shape is known beforehand to be of unit standard deviation: a parameter with just that prior lets
standard errors know of it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.interpolate import BSpline
from scipy.linalg import solve_triangular

from brv_hypo.arrays import FloatArray
from brv_hypo.constants import SMOOTH_INTERVALS, SMOOTH_ORDER, SMOOTH_PENALTIES, SMOOTH_PER_INTERVAL

_ROUGHNESS = np.logspace(*SMOOTH_PENALTIES)  # penalties tried
_RIDGE = 1e-14  # of the mean diagonal: keeps coefficients that no sample sees from being singular
_LEAST_ROUGHNESS = 1e-15  # of the roughest mode's: below is rounding


@dataclass(frozen=True)
class Smooth:
    """A smoothed signal: `values` (n,), and the independent shapes of its error as coefficients of a spline.

    `scale` (coefficients, shapes) has shapes of unit standard deviation, the smoothest first.
    """

    values: FloatArray
    scale: FloatArray


@dataclass(frozen=True)
class InputError:
    """What smoothing leaves of an input's noise: rad/s of the roll rate, a fraction of the pressure.

    `scale` are shapes of unit standard deviation, as coefficients of a cubic spline over `span` (s).
    """

    name: str
    span: tuple[float, float]
    scale: FloatArray

    @property
    def count(self) -> int:
        """Number of shapes."""
        return int(self.scale.shape[1])

    def shapes(self, time: FloatArray) -> FloatArray:
        """The shapes (count, n) at times (n,) s."""
        place = np.clip((time - self.span[0]) / (self.span[1] - self.span[0]), 0.0, 1.0)
        return np.asarray((_splines(place, self.scale.shape[0]) @ self.scale).T, dtype=float)


def smoothed(values: FloatArray, weight: FloatArray | None = None) -> Smooth:
    """Cubic smoothing spline through evenly spaced samples whose noise is as one over the weight, each (n,).

    Roughness (third differences of the coefficients) and noise are those of greatest likelihood (Wahba,
    Ann. Statist. 13:1378, 1985): error bands then hold on average, the bias of smoothing included. What varies
    faster than the spline can is taken for noise.
    """
    n = values.size
    count = _count(n)
    basis = _splines(np.linspace(0.0, 1.0, n), count)
    if weight is None:
        weight, weighted = np.ones(n), basis
        rough, modes = _even_modes(n, count)
    else:
        weight = weight / np.sqrt(np.mean(weight**2))
        weighted = weight[:, None] * basis
        rough, modes = _modes(weighted)
    relative = np.maximum(rough / rough[-1], _LEAST_ROUGHNESS)
    relative[:SMOOTH_ORDER] = 0.0
    level = float(np.mean(values))
    seen = weight * (values - level)
    size = modes.T @ (weighted.T @ seen)
    rest = max(float(seen @ seen - size @ size), 0.0)
    shrink = 1.0 / (1.0 + _ROUGHNESS[:, None] * relative)
    power = (rest + (1.0 - shrink[:, SMOOTH_ORDER:]) @ size[SMOOTH_ORDER:] ** 2) / (n - SMOOTH_ORDER)
    power = np.maximum(power, 1e-28 * float(np.mean((weight * values) ** 2)) + 1e-300)
    freedom = np.log1p(1.0 / (_ROUGHNESS[:, None] * relative[SMOOTH_ORDER:]))
    misfit = (n - SMOOTH_ORDER) * np.log(power) + np.sum(freedom, axis=1)
    best = int(np.argmin(misfit))
    scale = modes * np.sqrt(power[best] * shrink[best])
    return Smooth(np.asarray(level + basis @ (modes @ (shrink[best] * size))), scale)


def unsmoothed(n: int, sigma: float) -> FloatArray:
    """The shapes, as `Smooth.scale` has them, of white noise of n evenly spaced samples that was left as it is."""
    return _even_modes(n, _count(n))[1] * sigma


def _count(n: int) -> int:
    """Coefficients of the spline through n samples."""
    return min(SMOOTH_INTERVALS, max(n // SMOOTH_PER_INTERVAL, 1)) + 3


@lru_cache(maxsize=4)
def _even_modes(n: int, count: int) -> tuple[FloatArray, FloatArray]:
    """The modes of so many splines on `n` samples that count alike."""
    return _modes(_splines(np.linspace(0.0, 1.0, n), count))


def _modes(weighted: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Roughness (count,) and coefficients (count, count) of orthonormal combinations of the columns (n, count).

    From singular values: the roughness of the smoothest is 1e-11 of the roughest's, of which eigenvalues of squares
    keep five digits.
    """
    count = weighted.shape[1]
    normal = weighted.T @ weighted
    normal += _RIDGE * float(np.trace(normal)) / count * np.eye(count)
    triangle = np.linalg.cholesky(normal)
    penalty = np.diff(np.eye(count), SMOOTH_ORDER, axis=0)
    _, size, turned = np.linalg.svd(solve_triangular(triangle, penalty.T, lower=True).T)
    rough = np.concatenate([np.zeros(SMOOTH_ORDER), size[::-1] ** 2])
    return rough, np.asarray(solve_triangular(triangle, turned[::-1].T, lower=True, trans="T"), dtype=float)


def _splines(place: FloatArray, count: int) -> FloatArray:
    """The cubic splines (n, count) on knots evenly spaced over 0 to 1, and as evenly three more on each
    side.
    """
    knots = np.arange(-3, count + 1) / (count - 3)
    return np.asarray(BSpline.design_matrix(place, knots, 3).toarray(), dtype=float)
