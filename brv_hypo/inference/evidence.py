"""The evidence of a hypothesis, and all that is read off it.

    y = U b + X c + Z a + e,   a ~ N(0, s^2 S^2),   c ~ N(0, s^2 t^2 T^2),   b ~ flat or N(0, s^2),   e ~ N(0, s^2)

With b, c and a integrated out, log p(y | S, t, s) is maximised together with the logarithms' Gaussian priors over the
amplitudes S of processes, t of the mechanism and the noise s, by L-BFGS with the exact gradient. Knots and delays are
columns of X, linear about where the search found them, with the spread of a uniform prior: their posterior widths over
their ranges are Occam's share of what was searched. With M = 1 + S Z' Z S of each flight its processes are eliminated
first (Woodbury's identity), and what remains is as large as U and X:

    A = [U X]' [U X] + P - sum of W' W,   W = L^-1 S Z' [U X],   M = L L',   P the prior's precision
    2 log p = -n log s^2 - sum log |M| - log |A| + log |P| - (y' y - sum w' w - u' A^-1 u) / s^2

Source: Rasmussen and Williams, Gaussian Processes for Machine Learning, 2006, sections 2.7 and 5.4.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import cho_solve, cholesky, solve_triangular
from scipy.linalg.lapack import dtrtri
from scipy.optimize import minimize

from brv_hypo.arrays import BoolArray, FloatArray
from brv_hypo.inference.rows import Rows, Terms
from brv_hypo.thresholds import MECHANISM_AMPLITUDE, NOISE_LEVEL

_LARGEST, _SMALLEST = float(np.log(3.0)), float(np.log(1e-5))  # amplitudes
_NOISE = (-1.0, 3.0)  # logarithm of the noise over what the record states: least and most
_SMALL = np.log(1e-3)  # amplitudes from which one maximisation begins
_ITERATIONS = 80
# Relative fall of the cost at which a maximisation ends that is polished, one that is not, and the polished: some nats,
# 0.1 and 1e-5 of them.
_ROUGH, _QUICK, _PRECISION = 1e-4, 1e-7, 1e-10


_Block = tuple[FloatArray, FloatArray, FloatArray]


class Products(NamedTuple):
    """Scalar products of rows: what the likelihood needs of the data. `blocks`: Z'Z, Z'[U X] and Z'y of each flight."""

    rows: int
    square: float
    across: FloatArray
    right: FloatArray
    blocks: tuple[_Block, ...]

    @classmethod
    def of(cls, rows: Rows, border: FloatArray, chosen: BoolArray | None = None) -> Products:
        """Of all rows, or of those chosen (n,)."""
        use = np.ones(rows.y.size, dtype=bool) if chosen is None else chosen
        y_used, own = rows.y[use], border[use]
        blocks = []
        for block in rows.blocks:
            here = use[block.rows]
            z, those = block.z[here], block.rows[here]
            blocks.append((z.T @ z, z.T @ border[those], z.T @ rows.y[those]))
        count = rows.size if chosen is None else int(np.sum(use))
        return cls(count, float(y_used @ y_used), own.T @ own, own.T @ y_used, tuple(blocks))

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
    """b and c with their covariance under noise of 1, and each flight's standardised a with its variances."""

    level: float
    """Half of the log determinants."""
    misfit: float
    border: FloatArray
    covariance: FloatArray
    modes: tuple[FloatArray, ...]
    variances: tuple[FloatArray, ...]


@dataclass(frozen=True)
class Evidence:
    """A hypothesis at its most probable amplitudes; `level` is its log evidence, but for a constant of the rows."""

    rows: Rows
    terms: Terms
    products: Products
    at: FloatArray
    """Logarithms of the noise, of every process's amplitude, and of the mechanism's."""
    level: float

    @property
    def noise(self) -> float:
        """Noise over what the record states."""
        return float(np.exp(self.at[0]))

    @property
    def residual(self) -> FloatArray:
        """Rows (n,) less all that is fitted, under the stated noise."""
        out = self.rows.y - np.concatenate([self.rows.shared, self.terms.x], axis=1) @ self.solution.border
        for block, mode in zip(self.rows.blocks, self.solution.modes, strict=True):
            scale = np.repeat(_amplitudes(self.rows, self.at), [own.stop - own.start for own in block.columns])
            out[block.rows] -= block.z @ (scale * mode)
        return out

    @property
    def amplitudes(self) -> FloatArray:
        """Of every process (groups,), in its units."""
        return self.noise * _amplitudes(self.rows, self.at)

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
        known, rank = self.rows.coefficients.shape
        count, first = self.terms.spread.size, self.rows.shared.shape[1]
        made = np.zeros((known + count, self.solution.border.size))
        made[:known, :rank] = self.rows.coefficients
        made[known:, first:] = np.eye(count)
        return np.asarray(self.noise**2 * made @ self.solution.covariance @ made.T)

    def made_by(self, process: int) -> FloatArray:
        """What a process's columns make of the rows before whitening (n,), at their mode."""
        out, amplitude = np.zeros(self.rows.y.size), _amplitudes(self.rows, self.at)[process]
        for block, mode in zip(self.rows.blocks, self.solution.modes, strict=True):
            own = block.columns[process]
            out[block.rows] = block.raw[:, own] @ (amplitude * mode[own])
        return out

    def spline_coefficients(self, process: int) -> tuple[FloatArray, FloatArray]:
        """The coefficients of a process, of all flights after one another, and their standard errors, in its units."""
        unit = _amplitudes(self.rows, self.at)[process] * self.rows.groups[process].size
        each = zip(self.rows.blocks, self.solution.modes, self.solution.variances, strict=True)
        found = [(mode[b.columns[process]], spread[b.columns[process]]) for b, mode, spread in each]
        modes, variances = (np.concatenate(part) for part in zip(*found, strict=True))
        return unit * modes, self.noise * unit * np.sqrt(np.maximum(variances, 0.0))

    @cached_property
    def held_out(self) -> FloatArray:
        """Log predictive density of each stretch of time given the others (stretches,)."""
        border = np.concatenate([self.rows.shared, self.terms.x], axis=1)
        rests = (
            self.products.less(Products.of(self.rows, border, self.rows.time_blocks == k))
            for k in np.unique(self.rows.time_blocks)
        )
        whole, *rest = [-_cost(each, self.rows, self.terms, self.at) for each in (self.products, *rests)]
        return whole - np.array(rest)

    def projected_products(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """X'PX and X'Py of further columns (n, k), where P is the inverse covariance with all else integrated out."""
        border = np.concatenate([self.rows.shared, self.terms.x, x], axis=1)
        products = Products.of(self.rows, border)
        inner, right, *_ = _eliminated(products, self.rows, self.at)
        first = border.shape[1] - x.shape[1]
        inner[:first, :first] += np.diag(_spreads(self.rows, self.terms, self.at) ** -2.0)
        known = np.linalg.solve(inner[:first, :first], np.column_stack([inner[:first, first:], right[:first]]))
        found = np.column_stack([inner[first:, first:], right[first:]]) - inner[first:, :first] @ known
        return found[:, :-1] / self.noise**2, found[:, -1] / self.noise**2


def maximised(rows: Rows, terms: Terms, starts: Sequence[FloatArray] = (), quick: bool = False) -> Evidence:
    """The evidence of terms at its most probable amplitudes, from small ones, and from those given; `quick`: roughly,
    and from those given alone.
    """
    border = np.concatenate([rows.shared, terms.x], axis=1)
    products = Products.of(rows, border)
    groups, has_terms = rows.groups, bool(np.any(terms.scaled))
    priors = [NOISE_LEVEL, *(group.prior for group in groups), *([MECHANISM_AMPLITUDE] if has_terms else [])]
    centre, width = np.array(priors, dtype=float).T

    def cost(at: FloatArray) -> tuple[float, FloatArray]:
        found = _solved(products, rows, terms, at)
        off = (at - centre) / width
        value = _value(products, rows, found, at) + 0.5 * float(off @ off)
        return value, np.asarray(_slope(products, rows, terms, at, found) + off / width)

    small = np.array([0.0, *(_SMALL for _ in groups), *([centre[-1]] if has_terms else [])])
    begun = [small, *(np.append(s, [centre[-1]] if has_terms else []) for s in starts or [centre[: 1 + len(groups)]])]
    bounds = [_NOISE, *[(_SMALLEST, _LARGEST)] * (centre.size - 1)]

    def end(start: FloatArray, precision: float) -> Any:
        options: Any = {"maxiter": _ITERATIONS, "ftol": precision}
        return minimize(cost, start, jac=True, method="L-BFGS-B", bounds=bounds, options=options)

    first = _QUICK if quick else _ROUGH
    rough = min((end(start, first) for start in begun[quick:]), key=lambda each: float(each.fun))
    best = rough if quick else end(rough.x, _PRECISION)
    return Evidence(rows, terms, products, np.asarray(best.x), -float(best.fun))


def _amplitudes(rows: Rows, at: FloatArray) -> FloatArray:
    return np.asarray(np.exp(at[1 : 1 + len(rows.groups)]))


def _spreads(rows: Rows, terms: Terms, at: FloatArray) -> FloatArray:
    """Prior 1-sigma of b and c under noise of 1."""
    amplitude = np.exp(at[-1]) if np.any(terms.scaled) else 1.0
    return np.concatenate([rows.spread, np.where(terms.scaled, amplitude, 1.0) * terms.spread])


_Parts = list[_Block]


def _eliminated(products: Products, rows: Rows, at: FloatArray) -> tuple[FloatArray, FloatArray, float, float, _Parts]:
    """Normal equations of U and X with all processes eliminated: matrix, right side, squares, half log determinants,
    and of each flight L, W and w.
    """
    amplitudes = _amplitudes(rows, at)
    parts: _Parts = []
    inner, right, misfit, level = products.across, products.right, products.square, 0.0
    for block, (gram, with_border, with_y) in zip(rows.blocks, products.blocks, strict=True):
        scale = np.repeat(amplitudes, [own.stop - own.start for own in block.columns])
        matrix = scale[:, np.newaxis] * gram * scale
        matrix[np.diag_indices_from(matrix)] += 1.0
        factor = cholesky(matrix, lower=True, check_finite=False, overwrite_a=True)
        both = scale[:, np.newaxis] * np.column_stack([with_border, with_y])
        made = solve_triangular(factor, both, lower=True, check_finite=False)
        inner = inner - made[:, :-1].T @ made[:, :-1]
        right = right - made[:, :-1].T @ made[:, -1]
        misfit -= float(made[:, -1] @ made[:, -1])
        level += float(np.sum(np.log(np.diag(factor))))
        parts.append((factor, made[:, :-1], made[:, -1]))
    return inner, right, misfit, level, parts


def _solved(products: Products, rows: Rows, terms: Terms, at: FloatArray, with_modes: bool = True) -> _Solution:
    """What is integrated out; modes and variances of processes only where they are wanted."""
    spread = _spreads(rows, terms, at)
    inner, right, misfit, level, parts = _eliminated(products, rows, at)
    inner = inner + np.diag(spread**-2.0)
    outer = cholesky(inner, lower=True, check_finite=False)
    border = cho_solve((outer, True), right, check_finite=False)
    level += float(np.sum(np.log(np.diag(outer)))) + float(np.sum(np.log(spread[np.isfinite(spread)])))
    covariance = cho_solve((outer, True), np.eye(border.size), check_finite=False)
    modes, variances = [], []
    for factor, made, own in parts if with_modes else ():
        inverse, _ = dtrtri(factor, lower=1)
        follows = inverse.T @ made
        modes.append(inverse.T @ own - follows @ border)
        variances.append(np.einsum("ij,ij->j", inverse, inverse) + np.sum((follows @ covariance) * follows, axis=1))
    return _Solution(level, misfit - float(right @ border), border, covariance, tuple(modes), tuple(variances))


def _value(products: Products, rows: Rows, found: _Solution, at: FloatArray) -> float:
    """Minus log p, but for a constant and the priors of amplitudes."""
    freedom = products.rows - int(np.sum(np.isinf(rows.spread)))
    return float(found.level + freedom * at[0] + 0.5 * found.misfit * np.exp(-2.0 * at[0]))


def _cost(products: Products, rows: Rows, terms: Terms, at: FloatArray) -> float:
    return _value(products, rows, _solved(products, rows, terms, at, with_modes=False), at)


def _slope(products: Products, rows: Rows, terms: Terms, at: FloatArray, found: _Solution) -> FloatArray:
    """Derivative of `_value` by the logarithms (noise, amplitudes of processes, of the mechanism)."""
    slope, per_noise = np.zeros(at.size), np.exp(-2.0 * at[0])
    for block, mode, variance in zip(rows.blocks, found.modes, found.variances, strict=True):
        each = 1.0 - per_noise * mode**2 - variance
        for k, own in enumerate(block.columns, start=1):
            slope[k] += float(np.sum(each[own]))
    slope[0] = products.rows - int(np.sum(np.isinf(rows.spread))) - found.misfit * per_noise
    if np.any(terms.scaled):
        chosen = np.concatenate([np.zeros(rows.spread.size, dtype=bool), terms.scaled])
        precision = _spreads(rows, terms, at)[chosen] ** -2.0
        squares = per_noise * found.border[chosen] ** 2 + np.diag(found.covariance)[chosen]
        slope[-1] = float(np.sum(1.0 - precision * squares))
    return slope
