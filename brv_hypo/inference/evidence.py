"""The evidence of a hypothesis, and all that is read off it.

    y = U b + X c + Z a + e,   a ~ N(0, S^2),   c ~ N(0, t^2 T^2),   b ~ flat or N(0, 1),   e ~ N(0, s^2)

With b, c and a integrated out, log p(y | S, t, s) is maximised together with the logarithms' Gaussian priors over the
amplitudes S of processes, t of the mechanism and the noise s, by L-BFGS with the exact gradient. Knots and delays are
columns of X, linear about where the search found them, with the spread of a uniform prior: their posterior widths over
their ranges are Occam's share of what was searched. With M = 1 + S Z' Z S / s^2 of each flight, all of Z is eliminated
first (Woodbury's identity), and what remains is as large as U and X:

    A = [U X]' [U X] / s^2 + P - sum of W' W,   W = L^-1 S Z' [U X] / s^2,   M = L L'
    2 log p = -n log s^2 - sum log |M| - log |A| - log |P^-1| - (y' y / s^2 - sum w' w - u' A^-1 u)

Source: Rasmussen and Williams, Gaussian Processes for Machine Learning, 2006, sections 2.7 and 5.4.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_solve, cholesky, solve_triangular
from scipy.linalg.lapack import dtrtri
from scipy.optimize import minimize

from brv_hypo.arrays import BoolArray, FloatArray
from brv_hypo.inference.rows import Rows, Terms
from brv_hypo.thresholds import MECHANISM_AMPLITUDE, NOISE_LEVEL

_LARGEST, _SMALLEST = np.log(3.0), np.log(1e-5)  # amplitudes
_NOISE = (-1.0, 3.0)  # logarithm of the noise over what the record states: least and most
_SMALL = np.log(1e-3)  # amplitudes from which one maximisation begins
_ITERATIONS = 80
_PRECISION = 1e-6  # relative fall of the cost at which a maximisation ends: some 0.001 nats


class Products(NamedTuple):
    """Scalar products of rows: what the likelihood needs of the data. `blocks`: Z'Z, Z'[U X] and Z'y of each flight."""

    rows: int
    square: float
    across: FloatArray
    right: FloatArray
    blocks: tuple[tuple[FloatArray, FloatArray, FloatArray], ...]

    @classmethod
    def of(cls, rows: Rows, border: FloatArray, chosen: BoolArray | None = None) -> Products:
        """Of all rows, or of those chosen (n,)."""
        use = np.ones(rows.y.size, dtype=bool) if chosen is None else chosen
        y, own = rows.y[use], border[use]
        blocks = []
        for block in rows.blocks:
            here = use[block.rows]
            z, those = block.z[here], block.rows[here]
            blocks.append((z.T @ z, z.T @ border[those], z.T @ rows.y[those]))
        count = rows.size if chosen is None else int(np.sum(use))
        return cls(count, float(y @ y), own.T @ own, own.T @ y, tuple(blocks))

    def less(self, other: Products) -> Products:
        """Of all rows but those of `other`."""
        blocks = tuple(
            (mine[0] - less[0], mine[1] - less[1], mine[2] - less[2])
            for mine, less in zip(self.blocks, other.blocks, strict=True)
        )
        return Products(
            self.rows - other.rows,
            self.square - other.square,
            self.across - other.across,
            self.right - other.right,
            blocks,
        )


class _Solution(NamedTuple):
    """b and c with their covariance, and each flight's standardised a with its variances."""

    cost: float
    """Minus log p, but for a constant and the priors of the amplitudes."""
    misfit: float
    border: FloatArray
    covariance: FloatArray
    modes: tuple[FloatArray, ...]
    variances: tuple[FloatArray, ...]
    factors: tuple[FloatArray, ...]
    """L of each flight."""


@dataclass(frozen=True)
class Evidence:
    """A hypothesis at its most probable amplitudes; `level` is its log evidence, but for a constant of the rows."""

    rows: Rows
    terms: Terms
    products: Products
    at: FloatArray
    """Logarithms of the noise, of every group's amplitude but the first, and of the mechanism's."""
    level: float

    @property
    def noise(self) -> float:
        """Noise over what the record states."""
        return float(np.exp(self.at[0]))

    @property
    def amplitudes(self) -> FloatArray:
        """Of every group (groups,); 1 where it is not estimated."""
        return _amplitudes(self.rows, self.at)

    @cached_property
    def solution(self) -> _Solution:
        """What is integrated out, at its mode."""
        return _solved(self.products, self.rows, self.terms, self.at)

    @property
    def values(self) -> FloatArray:
        """Coefficients of the baseline's columns and of the hypothesis's terms, then shifts of knots and delays."""
        rank = self.rows.coefficients.shape[1]
        border = self.solution.border
        return np.concatenate([self.rows.coefficients @ border[:rank], border[self.rows.shared.shape[1] :]])

    @property
    def covariance(self) -> FloatArray:
        """That of `values`, everything else free."""
        rank, count = self.rows.coefficients.shape[1], self.terms.spread.size
        first = self.rows.shared.shape[1]
        made = np.zeros((self.rows.coefficients.shape[0] + count, self.solution.border.size))
        made[: self.rows.coefficients.shape[0], :rank] = self.rows.coefficients
        made[self.rows.coefficients.shape[0] :, first:] = np.eye(count)
        return np.asarray(made @ self.solution.covariance @ made.T)

    def made_by_terms(self, coefficients: FloatArray | None = None) -> FloatArray:
        """What the hypothesis's terms make of the rows (n, ...), at their mode or these coefficients (terms, ...)."""
        count, first = int(np.sum(self.terms.scaled)), self.rows.shared.shape[1]
        at_mode = self.solution.border[first : first + count]
        return np.asarray(self.terms.x[:, :count] @ (at_mode if coefficients is None else coefficients))

    def made_by(self, group: int) -> FloatArray:
        """What a group's columns make of the rows (n,), at their mode."""
        out = np.zeros(self.rows.y.size)
        for block, mode in zip(self.rows.blocks, self.solution.modes, strict=True):
            own = block.columns[group]
            out[block.rows] = block.z[:, own] @ (self.amplitudes[group] * mode[own])
        return out

    def spline_coefficients(self, group: int) -> tuple[FloatArray, FloatArray]:
        """The coefficients of a group, of all flights after one another, and their standard errors, in its units."""
        unit = self.amplitudes[group] * self.rows.groups[group].size
        each = zip(self.rows.blocks, self.solution.modes, self.solution.variances, strict=True)
        found = [(mode[block.columns[group]], spread[block.columns[group]]) for block, mode, spread in each]
        modes, variances = (np.concatenate(part) for part in zip(*found, strict=True))
        return unit * modes, unit * np.sqrt(np.maximum(variances, 0.0))

    @cached_property
    def left_out(self) -> FloatArray:
        """Log evidence without each stretch of time in turn (blocks,), amplitudes as they are."""
        border = np.concatenate([self.rows.shared, self.terms.x], axis=1)
        blocks = np.unique(self.rows.time_blocks)
        rests = (self.products.less(Products.of(self.rows, border, self.rows.time_blocks == k)) for k in blocks)
        return np.array([-_solved(rest, self.rows, self.terms, self.at).cost for rest in rests])

    @property
    def held_out(self) -> FloatArray:
        """Log predictive density of each stretch of time given the others (blocks,)."""
        return -self.solution.cost - self.left_out

    def without_processes(self, rows: FloatArray) -> FloatArray:
        """Rows (n, columns) less their best fit by the baseline and what tolerances allow, under the stated noise."""
        parts = [(np.arange(self.rows.y.size), self.rows.shared, self.rows.spread)]
        parts += [(b.rows, b.z[:, b.columns[0]], np.ones(b.columns[0].stop)) for b in self.rows.blocks]
        columns = np.zeros((self.rows.y.size, sum(part.shape[1] for _, part, _ in parts)))
        precision, first = [], 0
        for own, part, spread in parts:
            columns[own, first : first + part.shape[1]] = part
            first += part.shape[1]
            precision.append(1.0 / spread)
        ridge = np.diag(np.concatenate(precision))
        stacked = np.concatenate([columns, ridge[np.any(ridge, axis=1)]])
        basis = np.linalg.qr(stacked)[0][: columns.shape[0]]
        return np.asarray(rows - basis @ (basis.T @ rows))

    def projected_products(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """X'PX and X'Py of further columns (n, k), where P is the inverse covariance with all else integrated out."""
        border = np.concatenate([self.rows.shared, self.terms.x], axis=1)
        variance = self.noise**2
        inside, right, across = x.T @ x / variance, x.T @ self.rows.y / variance, x.T @ border / variance
        for block, factor, own in zip(self.rows.blocks, self.solution.factors, self.products.blocks, strict=True):
            scale = _scales(block.columns, self.amplitudes)
            made = solve_triangular(factor, scale[:, np.newaxis] * (block.z.T @ x[block.rows]), lower=True) / variance
            with_border = solve_triangular(factor, scale[:, np.newaxis] * own[1], lower=True) / variance
            inside = inside - made.T @ made
            across = across - made.T @ with_border
            right = right - made.T @ (solve_triangular(factor, scale * own[2], lower=True) / variance)
        inside = inside - across @ self.solution.covariance @ across.T
        return inside, right - across @ self.solution.border


def maximised(rows: Rows, terms: Terms, starts: Sequence[FloatArray] = ()) -> Evidence:
    """The evidence of terms at its most probable amplitudes, from small ones, and from those given."""
    border = np.concatenate([rows.shared, terms.x], axis=1)
    products = Products.of(rows, border)
    groups, has_terms = rows.groups[1:], bool(np.any(terms.scaled))
    priors = [NOISE_LEVEL, *(group.prior or (0.0, 1.0) for group in groups)]
    priors += [MECHANISM_AMPLITUDE] if has_terms else []
    centre, width = (np.array(part) for part in zip(*priors, strict=True))

    def cost(at: FloatArray) -> tuple[float, FloatArray]:
        found = _solved(products, rows, terms, at)
        slope = _slope(products, rows, terms, at, found)
        off = (at - centre) / width
        return found.cost + 0.5 * float(off @ off), slope + off / width

    small = np.array([0.0, *(_SMALL for _ in groups), *([centre[-1]] if has_terms else [])])
    begun = [
        small,
        *(np.append(start, [centre[-1]] if has_terms else []) for start in starts or [centre[: 1 + len(groups)]]),
    ]
    bounds = [_NOISE, *((_SMALLEST, _LARGEST) for _ in centre[1:])]
    ends = [
        minimize(
            cost,
            start,
            jac=True,
            method="L-BFGS-B",
            bounds=bounds,
            options={"maxiter": _ITERATIONS, "ftol": _PRECISION},
        )
        for start in begun
    ]
    best = min(ends, key=lambda end: float(end.fun))
    return Evidence(rows, terms, products, np.asarray(best.x), -float(best.fun))


def _amplitudes(rows: Rows, at: FloatArray) -> FloatArray:
    return np.concatenate([[1.0], np.exp(at[1 : len(rows.groups)])])


def _scales(columns: Sequence[slice], amplitudes: FloatArray) -> FloatArray:
    """The amplitude of each column of Z."""
    return np.repeat(amplitudes, [own.stop - own.start for own in columns])


def _spreads(rows: Rows, terms: Terms, at: FloatArray) -> FloatArray:
    """Prior 1-sigma of b and c."""
    amplitude = np.exp(at[-1]) if np.any(terms.scaled) else 1.0
    return np.concatenate([rows.spread, np.where(terms.scaled, amplitude, 1.0) * terms.spread])


def _solved(products: Products, rows: Rows, terms: Terms, at: FloatArray) -> _Solution:
    variance, amplitudes = float(np.exp(2.0 * at[0])), _amplitudes(rows, at)
    spread = _spreads(rows, terms, at)
    inner = products.across / variance + np.diag(spread**-2.0)
    right, misfit = products.right / variance, products.square / variance
    cost = products.rows * at[0] + float(np.sum(np.log(spread[np.isfinite(spread)])))
    factors, inside, across = [], [], []
    for block, (gram, with_border, with_y) in zip(rows.blocks, products.blocks, strict=True):
        scale = _scales(block.columns, amplitudes)
        matrix = scale[:, np.newaxis] * gram * scale / variance
        matrix[np.diag_indices_from(matrix)] += 1.0
        factor = cholesky(matrix, lower=True, check_finite=False, overwrite_a=True)
        made = solve_triangular(
            factor,
            scale[:, np.newaxis] * np.column_stack([with_border, with_y]) / variance,
            lower=True,
            check_finite=False,
        )
        inner = inner - made[:, :-1].T @ made[:, :-1]
        right = right - made[:, :-1].T @ made[:, -1]
        misfit -= float(made[:, -1] @ made[:, -1])
        cost += float(np.sum(np.log(np.diag(factor))))
        factors.append(factor)
        inside.append(made[:, -1])
        across.append(made[:, :-1])
    outer = cholesky(inner, lower=True, check_finite=False)
    border = cho_solve((outer, True), right, check_finite=False)
    covariance = np.asarray(np.linalg.inv(inner), dtype=float)
    misfit -= float(right @ border)
    cost += 0.5 * misfit + float(np.sum(np.log(np.diag(outer))))
    modes, variances = [], []
    for factor, own, made in zip(factors, inside, across, strict=True):
        inverse, _ = dtrtri(factor, lower=1)
        follows = inverse.T @ made
        modes.append(inverse.T @ own - follows @ border)
        variances.append(np.sum(inverse**2, axis=0) + np.sum((follows @ covariance) * follows, axis=1))
    return _Solution(cost, misfit, border, covariance, tuple(modes), tuple(variances), tuple(factors))


def _slope(products: Products, rows: Rows, terms: Terms, at: FloatArray, found: _Solution) -> FloatArray:
    """Derivative of the cost by the logarithms (noise, amplitudes of groups, of the mechanism)."""
    slope = np.zeros(at.size)
    precision = _spreads(rows, terms, at) ** -2.0
    squares = found.border**2 + np.diag(found.covariance)
    fixed = float(np.sum(precision * found.border**2)) + sum(float(mode @ mode) for mode in found.modes)
    freedom = float(np.sum(1.0 - precision * np.diag(found.covariance)))
    for block, mode, spread in zip(rows.blocks, found.modes, found.variances, strict=True):
        freedom += float(np.sum(1.0 - spread))
        for k, own in enumerate(block.columns[1:], start=1):
            slope[k] += own.stop - own.start - float(np.sum(mode[own] ** 2 + spread[own]))
    slope[0] = products.rows - freedom - (found.misfit - fixed)
    if np.any(terms.scaled):
        chosen = np.concatenate([np.zeros(rows.spread.size, dtype=bool), terms.scaled])
        slope[-1] = float(np.sum(1.0 - precision[chosen] * squares[chosen]))
    return slope
