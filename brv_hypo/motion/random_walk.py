"""Least squares with a random walk: a complex walk seen through noise, and a few real globals.

Observation k of a tie is   y = h_k z_k + A_k theta + noise,   z_k = z_(k-1) + step,

with noise and steps Gaussian and alike in both parts of the complex numbers. Given the globals theta the walk has
a tridiagonal information matrix, so the solution and its covariance cost a time linear in n. This is
the fixed-interval smoother (Rauch, Tung and Striebel, AIAA J. 3:1445, 1965) in information form.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_solve_banded, cholesky_banded

from brv_hypo.arrays import ComplexArray, FloatArray


@dataclass(frozen=True)
class Tie:
    """One observation at each sample: residual (n,), gain h (n,), columns A (n, k), noise sigma (n,), inf = none.

    `sigma` is the standard deviation of each part of the complex noise.
    """

    residual: ComplexArray
    gain: ComplexArray
    columns: ComplexArray
    sigma: FloatArray


@dataclass(frozen=True)
class WalkSolution:
    """Walk (n,) and globals (k,) with their covariances.

    `walk_variance` (n,) per part, given the globals; `sensitivity` (n, k): the walk's change per unit of each global;
    `covariance` (k, k) of the globals; `cost`: minus twice the log-likelihood but for a constant, without the prior;
    `residuals`: of each tie (n,).
    """

    walk: ComplexArray
    theta: FloatArray
    walk_variance: FloatArray
    sensitivity: ComplexArray
    covariance: FloatArray
    cost: float
    residuals: tuple[ComplexArray, ...]


def solve_walk(
    ties: Sequence[Tie], step_variance: FloatArray, start_variance: float,
    prior_mean: FloatArray, prior_information: FloatArray,
) -> WalkSolution:
    """Most probable walk and globals.

    `step_variance` (n - 1,) per part; the walk starts at 0 with `start_variance`. The globals have a Gaussian prior of
    `prior_mean` (k,) and diagonal `prior_information` (k,), zero where nothing is known.
    """
    n = ties[0].residual.size
    information = np.zeros((2, n))
    information[1, 0] = 1.0 / start_variance
    information[1, :-1] += 1.0 / step_variance
    information[1, 1:] += 1.0 / step_variance
    information[0, 1:] = -1.0 / step_variance
    for tie in ties:
        information[1] += np.abs(tie.gain) ** 2 / tie.sigma**2
    factor = (cholesky_banded(information), False)

    stacked = [np.column_stack([tie.residual, tie.columns]) for tie in ties]
    weighted = [values / (tie.sigma**2)[:, None] for tie, values in zip(ties, stacked, strict=True)]
    seen = sum(np.conj(tie.gain)[:, None] * values for tie, values in zip(ties, weighted, strict=True))
    answer = _solve_complex(factor, np.asarray(seen))
    gram = sum((np.conj(raw).T @ values).real for raw, values in zip(stacked, weighted, strict=True))
    gram = gram - (np.conj(seen).T @ answer).real

    normal = gram[1:, 1:] + np.diag(prior_information)
    right = gram[1:, 0] + prior_information * prior_mean
    scale = 1.0 / np.sqrt(np.maximum(np.diag(normal), 1e-300))
    covariance = scale[:, None] * np.linalg.pinv(normal * np.outer(scale, scale), hermitian=True) * scale
    theta = covariance @ right
    walk = answer[:, 0] - answer[:, 1:] @ theta
    residuals = tuple(tie.residual - tie.columns @ theta - tie.gain * walk for tie in ties)
    cost = float(gram[0, 0] - 2.0 * theta @ gram[1:, 0] + theta @ gram[1:, 1:] @ theta)
    return WalkSolution(walk, theta, _inverse_diagonal(information), -answer[:, 1:], covariance, cost, residuals)


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
