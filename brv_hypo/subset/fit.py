"""The final fit of a chosen subset: QR, then iterative refinement with residuals in extended precision."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from brv_hypo.arrays import FloatArray

MOST_REFINEMENTS = 8
# Correction, against the coefficients, that is below the last digit of extended precision by ten and more.
NEGLIGIBLE = 1e-21
# Condition number of the scaled columns from which the variances are refined too.
REFINE_VARIANCES_FROM = 1e6


@dataclass(frozen=True)
class LeastSquares:
    """A least-squares fit of k columns to n rows.

    ``basis`` (n, k) is an orthonormal basis of the columns, ``residuals`` (n,), ``inverse_diagonal`` (k,) the
    diagonal of (X'X)^-1.
    """

    coefficients: FloatArray
    rss: float
    residuals: FloatArray
    basis: FloatArray
    inverse_diagonal: FloatArray


def least_squares(X: FloatArray, y: FloatArray, *, variances: bool = True) -> LeastSquares:
    """Fit y (n,) on the columns of X (n, k), to nearly the precision that the data allow.

    Residuals and gradients are evaluated in extended precision (80 bits where the machine has them), the
    corrections in double. The columns must be independent. Without ``variances``, ``inverse_diagonal`` is not
    refined.
    """
    n, k = X.shape
    if k == 0:
        residuals = y.astype(np.float64)
        return LeastSquares(np.empty(0), float(y @ y), residuals, np.empty((n, 0)), np.empty(0))
    scale = np.linalg.norm(X.astype(np.float64), axis=0)
    scale = np.exp2(np.round(np.log2(np.where(scale > 0.0, scale, 1.0))))
    wide: Any = X.astype(np.longdouble) / scale
    Q, R = np.linalg.qr(wide.astype(np.float64))
    inverse = np.asarray(np.linalg.solve(R, np.eye(k)), dtype=np.float64)
    target: Any = y.astype(np.longdouble)
    beta = _augmented(wide, Q, inverse, target[:, None], np.zeros((k, 1)))[:, 0]
    residuals = target - wide @ beta
    if variances and np.linalg.norm(R) * np.linalg.norm(inverse) > REFINE_VARIANCES_FROM:
        diagonal = _augmented(wide, Q, inverse, np.zeros((n, k)), -np.eye(k)).diagonal()
    else:
        diagonal = np.sum(inverse**2, axis=1)
    return LeastSquares(
        coefficients=(beta / scale).astype(np.float64),
        rss=float(residuals @ residuals),
        residuals=residuals.astype(np.float64),
        basis=Q,
        inverse_diagonal=np.asarray(diagonal / scale**2, dtype=np.float64),
    )


def _augmented(wide: Any, Q: FloatArray, inverse: FloatArray, f: Any, g: Any) -> Any:
    """Solve r + X b = f, X'r = g for b (k, m), refined until the corrections no longer shrink.

    With (f, g) = (y, 0) b is the least-squares solution, with (0, -I) the inverse of X'X. Source: Bjorck,
    Numer. Math. 7 (1967) 257.
    """
    beta = np.zeros((inverse.shape[0], f.shape[1]), dtype=np.longdouble)
    r = np.zeros(f.shape, dtype=np.longdouble)
    left, inside = f.astype(np.float64), -(inverse.T @ g.astype(np.float64))
    last = np.inf
    for _ in range(MOST_REFINEMENTS):
        inside = Q.T @ left + inside
        step = inverse @ inside
        size = float(np.linalg.norm(step))
        if size >= 0.5 * last:
            break
        beta = beta + step
        r = r + left - Q @ inside
        # Corrections shrink by one factor: the next would be size^2 / last.
        following = size * (size / last) if np.isfinite(last) else size
        if following <= NEGLIGIBLE * float(np.linalg.norm(beta.astype(np.float64))):
            break
        last = size
        left = (f - r - wide @ beta).astype(np.float64)
        inside = -(inverse.T @ (g - wide.T @ r).astype(np.float64))
    return beta
