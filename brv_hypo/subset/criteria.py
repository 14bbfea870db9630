"""Least-squares fits of chosen subsets, and the selection criteria of Section 3.3.2 of the report.

A fit is a QR factorisation with iterative refinement, residuals in extended precision. Criteria: those of the report
with AIC, BIC and a held-out error. n rows, p coefficients (forced ones included), k of them chosen, RSS the residual
sum of squares, RSS_0 that of the forced columns alone, s^2 the residual variance of the complete model, e the
residuals, h the leverages. `least_squares` and `evaluate` are the entrances.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from brv_hypo.arrays import FloatArray

MOST_REFINEMENTS = 8
# Correction, against the coefficients, that is below the last digit of extended precision by ten and more.
NEGLIGIBLE = 1e-21
REFINE_VARIANCES_FROM = 1e6  # condition number of the scaled columns from which the variances are refined too


@dataclass(frozen=True)
class LeastSquares:
    """A least-squares fit of k columns to n rows."""

    coefficients: FloatArray  # (k,)
    rss: float  # residual sum of squares
    residuals: FloatArray  # (n,)
    basis: FloatArray  # orthonormal basis of the columns (n, k)
    inverse_diagonal: FloatArray  # diagonal of (X'X)^-1 (k,)


def least_squares(X: FloatArray, y: FloatArray, *, variances: bool = True) -> LeastSquares:
    """Fit y (n,) on the columns of X (n, k), to nearly the precision that the data allow. Residuals and gradients are
    evaluated in extended precision (80 bits where the machine has them), the corrections in double. The columns must be
    independent. Without ``variances``, ``inverse_diagonal`` is not refined.
    """
    n, k = X.shape
    if k == 0:
        none = np.empty(0)
        return LeastSquares(none, float(y @ y), y.astype(np.float64), basis=np.empty((n, 0)), inverse_diagonal=none)
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
    """Solve r + X b = f, X'r = g for b (k, m), refined until the corrections no longer shrink. With (f, g) = (y, 0) b
    is the least-squares solution, with (0, -I) the inverse of X'X. Source: Bjorck, Numer. Math. 7 (1967) 257.
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


@dataclass(frozen=True)
class Criteria:
    """Criteria of one subset: the report's seven, 3.3.2 (a) to (g), and the usual; nan without degrees of freedom."""

    rss: float  # (a) Sum of e^2
    adjusted_rss: float  # (b) RSS / (n - p). Hocking, Biometrics 32 (1976) 1.
    r2: float  # 1 - RSS / RSS_0
    adjusted_r2: float  # 1 less the ratio of RSS / (n - p) to RSS_0 / (n - p + k)
    prediction_error: float  # (c) RSS (n + p) / (n (n - p)). Akaike, Ann. Inst. Stat. Math. 21 (1969) 243.
    cp: float  # (d) RSS / s^2 - n + 2 p. Mallows, Technometrics 15 (1973) 661.
    f_ratio: float  # (e) ((RSS_0 - RSS) / k) / (RSS / (n - p)), the total equation F
    expected_variance: float  # (f) p RSS / (n (n - p)). Helms, Comm. Stat. 3 (1974) 261.
    # (g) s^2 (1 - g) + bias^2 + 2 s^2 g_A, averaged over the rows (Allen, Technometrics 13 (1971) 469): at row x, g is
    # x'(X'X)^-1 x of the complete model, g_A the same of the subset, bias the difference of their predictions.
    point_error: float
    press: float  # sum of (e / (1 - h))^2: each row predicted from all others. Allen, Technometrics 16 (1974) 125.
    aic: float  # n log(RSS / n) + 2 p. Akaike, IEEE Trans. Automatic Control 19 (1974) 716.
    bic: float  # n log(RSS / n) + p log n. Schwarz, Ann. Stat. 6 (1978) 461.


@dataclass(frozen=True)
class Reference:
    """What criteria compare with."""

    rss_forced: float  # of the forced model
    n_forced: int  # columns of it
    complete: LeastSquares  # the fit of all columns


def evaluate(fit: LeastSquares, reference: Reference) -> Criteria:
    """All criteria of one fit."""
    n, p = fit.basis.shape
    k, rss, free = p - reference.n_forced, fit.rss, n - p
    r2 = 1.0 - _ratio(rss, reference.rss_forced)
    if free <= 0:
        undefined = dict.fromkeys((each.name for each in fields(Criteria)), float("nan"))
        return Criteria(**{**undefined, "rss": rss, "r2": r2})
    mean_square = rss / free
    rank = reference.complete.basis.shape[1]
    variance = reference.complete.rss / (n - rank) if n > rank else float("nan")
    log_likelihood = n * float(np.log(rss / n)) if rss > 0 else -np.inf
    return Criteria(
        rss=rss,
        adjusted_rss=mean_square,
        r2=r2,
        adjusted_r2=1.0 - _ratio(mean_square, reference.rss_forced / (free + k)),
        prediction_error=mean_square * (n + p) / n,
        cp=_ratio(rss, variance) - n + 2 * p,
        f_ratio=_ratio((reference.rss_forced - rss) / k, mean_square) if k else float("nan"),
        expected_variance=mean_square * p / n,
        point_error=variance * (1.0 - rank / n) + (rss - reference.complete.rss) / n + 2.0 * variance * p / n,
        press=press(fit),
        aic=log_likelihood + 2 * p,
        bic=log_likelihood + p * float(np.log(n)),
    )


def press(fit: LeastSquares) -> float:
    """Allen's PRESS: each row predicted from all the others."""
    left = 1.0 - np.sum(fit.basis**2, axis=1)
    if left.min() <= 1e-12:
        return float("nan")
    return float(np.sum((fit.residuals / left) ** 2))


def _ratio(a: float, b: float) -> float:
    return a / b if b > 0 else float("nan")
