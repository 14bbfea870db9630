"""Least squares with a random walk: a complex walk seen through noise, and a few real globals.

Observation k of a tie is   y = h_k z_k + A_k theta + noise,   z_k = z_(k-1) + step,

with noise and steps Gaussian and alike in both parts of the complex numbers. Given the globals theta the
walk has a tridiagonal information matrix, so the solution and its covariance cost a time linear in n. This
is the fixed-interval smoother (Rauch, Tung and Striebel, AIAA J. 3:1445, 1965) in information form.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_solve_banded, cholesky_banded

from brv_hypo.arrays import ComplexArray, FloatArray

# Keeps unknowns that the data do not see from making the normal equations singular; they stay at zero.
_RIDGE = 1e-11
# All steps together vary by this share at least of the variance that the ties leave of one level, which changes
# no answer: steps without noise, of rates that were computed, make the information singular in double precision.
_LEAST_WANDER = 1e-4


@dataclass(frozen=True)
class Tie:
    """One observation at each sample: residual (n,), gain h (n,), columns A (n, k), noise sigma (n,).

    `sigma` is the standard deviation of each part of the complex noise; inf where nothing is seen.
    """

    residual: ComplexArray
    gain: ComplexArray
    columns: ComplexArray
    sigma: FloatArray


@dataclass(frozen=True)
class WalkEquations:
    """The problem once the walk is eliminated: normal equations of the globals.

    `walk` (n,) at theta = 0 and `sensitivity` (n, k), its change per unit of each global; `walk_variance`
    (n,) per part, given the globals; `gram` (k + 1, k + 1): inner products of residual (first) and columns,
    whitened.
    """

    ties: tuple[Tie, ...]
    walk: ComplexArray
    sensitivity: ComplexArray
    walk_variance: FloatArray
    gram: FloatArray

    def solve(self, mean: FloatArray, information: FloatArray) -> WalkSolution:
        """Walk and globals with Gaussian priors of the globals: mean (k,), information (k,), 0 where free."""
        normal = self.gram[1:, 1:] + np.diag(information)
        scale = 1.0 / np.sqrt(np.maximum(np.diag(normal), 1e-300))
        inverse = np.linalg.inv(normal * scale[:, None] * scale + _RIDGE * np.eye(mean.size))
        covariance = inverse * scale[:, None] * scale
        theta = covariance @ (self.gram[1:, 0] + information * mean)
        cost = self.gram[0, 0] - 2.0 * theta @ self.gram[1:, 0] + theta @ self.gram[1:, 1:] @ theta
        cost += float(information @ (theta - mean) ** 2)
        return WalkSolution(self.walk + self.sensitivity @ theta, theta, covariance, float(cost))

    def residual(self, index: int, solution: WalkSolution) -> ComplexArray:
        """What the solution leaves of the tie number `index`, (n,)."""
        tie = self.ties[index]
        return np.asarray(tie.residual - tie.columns @ solution.theta - tie.gain * solution.walk)


@dataclass(frozen=True)
class WalkSolution:
    """Walk (n,), globals (k,) and their covariance (k, k).

    `cost`: minus twice the log of likelihood times prior, but for a constant.
    """

    walk: ComplexArray
    theta: FloatArray
    covariance: FloatArray
    cost: float


def walk_equations(ties: Sequence[Tie], step_variance: FloatArray, start_variance: float) -> WalkEquations:
    """Eliminate the walk, which starts at 0 with `start_variance`; `step_variance` (n - 1,) per part."""
    n = ties[0].residual.size
    information = np.zeros((2, n))
    information[1, 0] = 1.0 / start_variance
    for tie in ties:
        information[1] += np.abs(tie.gain) ** 2 / tie.sigma**2
    steps = 1.0 / np.maximum(step_variance, _LEAST_WANDER / (n * information[1].sum()))
    information[1, :-1] += steps
    information[1, 1:] += steps
    information[0, 1:] = -steps
    stacked = [np.column_stack([tie.residual, tie.columns]) for tie in ties]
    weighted = [values / (tie.sigma**2)[:, None] for tie, values in zip(ties, stacked, strict=True)]
    seen = sum(np.conj(tie.gain)[:, None] * values for tie, values in zip(ties, weighted, strict=True))
    answer = _solve_complex((cholesky_banded(information), False), np.asarray(seen))
    gram = sum((np.conj(raw).T @ values).real for raw, values in zip(stacked, weighted, strict=True))
    gram = np.asarray(gram - (np.conj(seen).T @ answer).real)
    return WalkEquations(tuple(ties), answer[:, 0], -answer[:, 1:], _inverse_diagonal(information), gram)


def _solve_complex(factor: tuple[FloatArray, bool], right: ComplexArray) -> ComplexArray:
    both = cho_solve_banded(factor, np.concatenate([right.real, right.imag], axis=1))
    k = right.shape[1]
    return np.asarray(both[:, :k] + 1j * both[:, k:])


def _inverse_diagonal(band: FloatArray) -> FloatArray:
    """Diagonal of the inverse of a tridiagonal matrix: its pivots from both ends meet at each sample."""
    upward = cholesky_banded(band)[1] ** 2
    reverse = np.zeros_like(band)
    reverse[1], reverse[0, 1:] = band[1, ::-1], band[0, :0:-1]
    downward = cholesky_banded(reverse)[1, ::-1] ** 2
    return np.asarray(1.0 / (upward + downward - band[1]))
