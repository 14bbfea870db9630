"""Least squares with a random walk: a complex walk seen through noise, and a few real globals.

Observation k of a tie is   y = h_k z_k + A_k theta + noise,   z_k = z_(k-1) + step,

with noise and steps Gaussian and alike in both parts of the complex numbers. Given the globals theta the
walk has a tridiagonal information matrix, so the solution and its covariance cost a time linear in n. This
is the fixed-interval smoother (Rauch, Tung and Striebel, AIAA J. 3:1445, 1965) in information form.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.linalg import cholesky_banded
from scipy.linalg.lapack import dtbtrs

from brv_hypo.arrays import ComplexArray, FloatArray
from brv_hypo.motion.kept_rows import blocks

# Keeps unknowns that the data do not see from making the normal equations singular; they stay at zero.
_RIDGE = 1e-11
# All steps together vary by this share at least of the variance that the ties leave of one level, which changes
# no answer: steps without noise, of rates that were computed, make the information singular in double precision.
_LEAST_WANDER = 1e-4


class Columns(Protocol):
    """Columns (n, k) that need not all exist at once: an array, or what makes the rows that are asked for."""

    def __getitem__(self, rows: slice, /) -> ComplexArray:
        """These rows of all columns."""


@dataclass(frozen=True)
class Tie:
    """One observation at each sample: residual (n,), gain h (n,), columns A (n, k), noise sigma (n,).

    `sigma` is the standard deviation of each part of the complex noise; inf where nothing is seen.
    """

    residual: ComplexArray
    gain: ComplexArray
    columns: Columns
    sigma: FloatArray


@dataclass(frozen=True)
class WalkEquations:
    """The problem once the walk is eliminated: normal equations of the globals.

    `answer` (n, 2 k + 2): the walk at theta = 0 and less its change per unit of each global, real parts before
    imaginary ones; `walk_variance` (n,) per part, given the globals; `gram` (k + 1, k + 1): inner products of residual
    (first) and columns, whitened.
    """

    ties: tuple[Tie, ...]
    answer: FloatArray
    walk_variance: FloatArray
    gram: FloatArray

    def sensitivity(self, rows: slice = slice(None)) -> ComplexArray:
        """Change of the walk per unit of each global (rows, k)."""
        count = self.gram.shape[0]
        return np.asarray(-(self.answer[rows, 1:count] + 1j * self.answer[rows, count + 1 :]))

    def solve(self, mean: FloatArray, information: FloatArray) -> WalkSolution:
        """Walk and globals with Gaussian priors of the globals: mean (k,), information (k,), 0 where free."""
        normal = self.gram[1:, 1:] + np.diag(information)
        scale = 1.0 / np.sqrt(np.maximum(np.diag(normal), 1e-300))
        inverse = np.linalg.inv(normal * scale[:, None] * scale + _RIDGE * np.eye(mean.size))
        covariance = inverse * scale[:, None] * scale
        theta = covariance @ (self.gram[1:, 0] + information * mean)
        cost = self.gram[0, 0] - 2.0 * theta @ self.gram[1:, 0] + theta @ self.gram[1:, 1:] @ theta
        cost += float(information @ (theta - mean) ** 2)
        weights = np.append(1.0, -theta)
        walk = self.answer[:, : weights.size] @ weights + 1j * (self.answer[:, weights.size :] @ weights)
        return WalkSolution(walk, theta, covariance, float(cost))

    def residual(self, index: int, solution: WalkSolution) -> ComplexArray:
        """What the solution leaves of the tie number `index`, (n,)."""
        tie = self.ties[index]
        fitted = [tie.columns[rows] @ solution.theta for rows in blocks(tie.residual.size)]
        return np.asarray(tie.residual - np.concatenate(fitted) - tie.gain * solution.walk)


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
    gram, seen = _normal_equations(ties)
    factor = cholesky_banded(information)
    half, _ = dtbtrs(factor, seen, uplo="U", trans="T", overwrite_b=True)
    for part in (half[:, : gram.shape[0]], half[:, gram.shape[0] :]):
        gram -= part.T @ part
    answer, _ = dtbtrs(factor, half, uplo="U", overwrite_b=True)
    return WalkEquations(tuple(ties), answer, _inverse_diagonal(information), gram)


def _normal_equations(ties: Sequence[Tie]) -> tuple[FloatArray, FloatArray]:
    """Inner products (k + 1, k + 1) of residual and columns, whitened; and what the walk sees of them (n, 2 k + 2)."""
    n, count = ties[0].residual.size, ties[0].columns[:1].shape[1] + 1
    gram, seen = np.zeros((count, count)), np.zeros((n, 2 * count), order="F")
    for tie in ties:
        gain = np.conj(tie.gain) / tie.sigma
        for rows in blocks(n):
            white = np.column_stack([tie.residual[rows], tie.columns[rows]])
            white /= tie.sigma[rows, np.newaxis]
            both = np.concatenate([white.real, white.imag])
            gram += both.T @ both
            white *= gain[rows, np.newaxis]
            seen[rows, :count] += white.real
            seen[rows, count:] += white.imag
    return gram, seen


def _inverse_diagonal(band: FloatArray) -> FloatArray:
    """Diagonal of the inverse of a tridiagonal matrix: its pivots from both ends meet at each sample."""
    upward = cholesky_banded(band)[1] ** 2
    reverse = np.zeros_like(band)
    reverse[1], reverse[0, 1:] = band[1, ::-1], band[0, :0:-1]
    downward = cholesky_banded(reverse)[1, ::-1] ** 2
    return np.asarray(1.0 / (upward + downward - band[1]))
