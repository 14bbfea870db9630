"""Measurement noise with heavy tails: Student's t in place of Gauss (Lange, Little & Taylor, JASA 84 (1989) 881).

Each output has its own scale and degrees of freedom f. With v the residual over the scale the likelihood is had from
least squares in which each sample weighs (f + 1) / (f + v^2), weights and fit in turn (expectation-maximisation): what
lies far off hardly counts, and no sample has to be called an outlier. Of the fit's errors

    cov = A^-1 B A^-1,  A = sum S'S psi'(v),  B = sum S'S psi(v)^2,  psi = (f + 1) v / (f + v^2)

with the means of psi' and psi^2 over the samples of an output, which holds where the noise is no t either (Huber, Ann.
Statist. 1 (1973) 799).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from brv_hypo.arrays import FloatArray

# What is found hangs on none of the constants but the range (tests/likelihood/test_student.py, "hangs_on_no_constant").
_FIRST_FREEDOM = 4.0
"""Degrees of freedom that the first weights are of."""
_LEAST, _MOST = 1.0, 200.0
"""Degrees of freedom: of Cauchy, below which the likelihood of a scale that goes to 0 has no bound; next to Gauss."""
_LEAST_SLOPE = 1e-3
"""Mean of psi' that keeps an output never measured from dividing by 0; t's own is (f + 1) / (f + 3), a half or more."""
_ROUNDS = 100
"""Steps of expectation-maximisation at most; it takes some 20."""
_SAME = 1e-8
"""Relative change of a scale's square at which it has settled."""
_TO_SIGMA = 1.4826
"""Standard deviation of Gaussian noise over the median of its magnitude."""


@dataclass(frozen=True)
class Tails:
    """`freedom` (n_outputs,), and what samples weigh: by segment, (n_outputs, n); 1 where nothing was measured."""

    freedom: FloatArray
    weights: tuple[FloatArray, ...]


class Influence(NamedTuple):
    """By segment, `psi` (n_outputs, n), 0 where nothing was measured; `slope` (n_outputs,) the mean of psi'."""

    psi: tuple[FloatArray, ...]
    slope: FloatArray

    @property
    def spread(self) -> float:
        """Mean of psi^2 over that of psi': 1 where the noise is what it is taken for."""
        squares = [np.concatenate([each[i] for each in self.psi]) ** 2 for i in range(self.slope.size)]
        observed = [square[square > 0.0] for square in squares]
        return float(np.mean([s.mean() / slope for s, slope in zip(observed, self.slope, strict=True) if s.size]))


def first_tails(residual: Sequence[FloatArray], floor: FloatArray) -> tuple[FloatArray, Tails]:
    """Squares of the scales, (n_outputs,), from the median residual, and the weights that follow."""
    rows = [row[np.isfinite(row)] for row in np.concatenate(residual, axis=1)]
    middle = np.array([np.median(np.abs(row)) if row.size else 1.0 for row in rows])
    square = np.maximum((_TO_SIGMA * middle) ** 2, floor)
    return square, tails_of(residual, square, np.full(square.size, _FIRST_FREEDOM))


def tails_of(residual: Sequence[FloatArray], square: FloatArray, freedom: FloatArray) -> Tails:
    """Weights of residuals (n_outputs, n), nan in gaps, at squares of scales and degrees of freedom, (n_outputs,)."""
    f = freedom[:, None]
    weights = (np.where(np.isfinite(v), (f + 1.0) / (f + v**2 / square[:, None]), 1.0) for v in residual)
    return Tails(freedom, tuple(weights))


def fitted(
    residual: FloatArray, square: FloatArray, floor: FloatArray, held: bool
) -> tuple[FloatArray, FloatArray]:
    """Squares of the scales, which may be `held`, and degrees of freedom that are most likely, (n_outputs,) each."""
    from scipy.optimize import minimize_scalar

    squares, freedom = square.copy(), np.full(square.size, _FIRST_FREEDOM)
    for i, row in enumerate(residual):
        v = row[np.isfinite(row)]
        if not v.size:
            continue

        def cost(log_freedom: float, i: int = i, v: FloatArray = v) -> float:
            f = float(np.exp(log_freedom))
            scale = square[i] if held else _scale(v, square[i], f, floor[i])
            return _cost(v, scale, f)

        found = minimize_scalar(cost, bounds=(np.log(_LEAST), np.log(_MOST)), method="bounded")
        freedom[i] = np.exp(found.x)
        squares[i] = square[i] if held else _scale(v, square[i], freedom[i], floor[i])
    return squares, freedom


def negative_log_likelihood(residual: FloatArray, square: FloatArray, freedom: FloatArray) -> float:
    """Of residuals (n_outputs, n), nan in gaps, less the constant that a Gaussian one leaves out."""
    return sum(
        _cost(row[np.isfinite(row)], float(s), float(f))
        for row, s, f in zip(residual, square, freedom, strict=True)
    )


def influence(residual: Sequence[FloatArray], square: FloatArray, freedom: FloatArray) -> Influence:
    """What each sample pulls with, and how that changes with the residual, in scales."""
    f = freedom[:, None]
    scaled = [v / np.sqrt(square)[:, None] for v in residual]
    psi = tuple(np.nan_to_num((f + 1.0) * v / (f + v**2)) for v in scaled)
    together = np.concatenate(scaled, axis=1)
    slopes = np.nan_to_num((f + 1.0) * (f - together**2) / (f + together**2) ** 2)
    slope = slopes.sum(axis=1) / np.maximum(np.isfinite(together).sum(axis=1), 1)
    return Influence(psi, np.maximum(slope, _LEAST_SLOPE))


def _scale(v: FloatArray, square: float, freedom: float, floor: float) -> float:
    """Square of the scale: sum w v^2 / sum w (Kent, Tyler & Vardi, Comm. Statist. B 23 (1994) 441)."""
    for _ in range(_ROUNDS):
        weight = (freedom + 1.0) / (freedom + v**2 / square)
        new = max(float(weight @ v**2 / weight.sum()), floor)
        converged, square = abs(new / square - 1.0) < _SAME, new
        if converged:
            break
    return square


def _cost(v: FloatArray, square: float, freedom: float) -> float:
    from scipy.special import gammaln

    constant = gammaln((freedom + 1.0) / 2.0) - gammaln(freedom / 2.0) + 0.5 * np.log(2.0 / freedom)
    tail = 0.5 * (freedom + 1.0) * float(np.sum(np.log1p(v**2 / (freedom * square))))
    return tail + v.size * float(0.5 * np.log(square) - constant)
