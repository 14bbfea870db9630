"""The final fit of a chosen subset: QR, then iterative refinement with residuals in extended precision."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from brv_hypo.arrays import FloatArray

REFINEMENTS = 4


@dataclass(frozen=True)
class LeastSquares:
    """A least-squares fit. ``basis`` (n, k) is an orthonormal basis of the columns, ``residuals`` (n,)."""

    coefficients: FloatArray
    rss: float
    residuals: FloatArray
    basis: FloatArray
    inverse_diagonal: FloatArray


def least_squares(X: FloatArray, y: FloatArray) -> LeastSquares:
    """Fit y (n,) on the columns of X (n, k), to nearly the precision that the data allow.

    Bjorck's refinement of the augmented system (Numer. Math. 7 (1967) 257): residual and gradient are
    evaluated in extended precision (80 bits where the machine has them), the corrections in double.
    """
    k = X.shape[1]
    if k == 0:
        return LeastSquares(
            np.empty(0), float(y @ y), y.astype(np.float64), np.empty((y.size, 0)), np.empty(0)
        )
    scale = np.linalg.norm(X.astype(np.float64), axis=0)
    scale[scale == 0.0] = 1.0
    scale = np.exp2(np.round(np.log2(scale)))
    wide: Any = X.astype(np.longdouble) / scale
    target: Any = y.astype(np.longdouble)
    Q, R = np.linalg.qr(wide.astype(np.float64))
    inverse = np.linalg.solve(R, np.eye(k))
    beta = np.zeros(k, dtype=np.longdouble)
    r = np.zeros(target.size, dtype=np.longdouble)
    for _ in range(REFINEMENTS):
        f = (target - r - wide @ beta).astype(np.float64)
        g = (-(wide.T @ r)).astype(np.float64)
        h = inverse.T @ g
        inside = Q.T @ f
        beta = beta + inverse @ (inside - h)
        r = r + f - Q @ (inside - h)
    exact = target - wide @ beta
    return LeastSquares(
        coefficients=(beta / scale).astype(np.float64), rss=float(exact @ exact),
        residuals=exact.astype(np.float64), basis=Q,
        inverse_diagonal=np.sum(inverse**2, axis=1) / scale**2,
    )  # fmt: skip
