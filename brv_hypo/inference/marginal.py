"""All that is linear in the rows integrated out, at amplitudes that are given, and its derivatives by these.

    y = U b + X c + Z a + e,   a ~ N(0, s^2 S^2),   c ~ N(0, s^2 t^2 T^2),   b ~ flat or N(0, s^2),   e ~ N(0, s^2)

With b, c and a integrated out, log p(y | S, t, s) remains, for processes of amplitudes S, a mechanism of t and a noise
of s. Knots and delays are columns of X, linear about where they are. With M = 1 + S Z' Z S of each flight its processes
are eliminated first (Woodbury's identity), and what remains is as large as U and X:

    A = [U X]' [U X] + P - sum of W' W,   W = L^-1 S Z' [U X],   M = L L',   P the prior's precision
    2 log p = -n log s^2 - sum log |M| - log |A| + log |P| - (y' y - sum w' w - u' A^-1 u) / s^2

Source: Rasmussen and Williams, Gaussian Processes for Machine Learning, 2006, sections 2.7 and 5.4; the curvature
is that of restricted likelihood (Searle, Casella and McCulloch, Variance Components, 1992, 6.6).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.linalg import LinAlgError, cho_solve, cholesky, solve_triangular
from scipy.linalg.lapack import dpotri

from brv_hypo.arrays import FloatArray
from brv_hypo.inference.rows import Block, Products, Rows, Terms

_KEPT = 4  # amplitudes of which factors are kept


class _Solution(NamedTuple):
    """b and c with their covariance under noise of 1."""

    level: float  # half of the log determinants
    misfit: float
    border: FloatArray
    covariance: FloatArray


class _OfProcesses(NamedTuple):
    """Of one flight the standardised a at its mode, with its variances under noise of 1."""

    mode: FloatArray
    inverse: FloatArray  # that of its `_Factor`
    follows: FloatArray  # by how much a falls as b and c rise (columns, border)
    variances: FloatArray


@dataclass(frozen=True)
class Integrated:
    """All that is integrated out at some amplitudes; what is of processes only where it is requested."""

    rows: Rows
    terms: Terms
    products: Products
    at: FloatArray  # logarithms of the noise, of every process's amplitude, and of the mechanism's

    @cached_property
    def _parts(self) -> dict[int, _Eliminated]:
        return eliminated(self.products, factors_of(self.rows, self.at))

    @cached_property
    def solution(self) -> _Solution:
        """b and c, at their mode."""
        return solution_of(self.products, self._parts, self.rows, self.terms, self.at)

    @cached_property
    def processes(self) -> tuple[_OfProcesses, ...]:
        """a of each flight: large, and wanted of few."""
        solution, found = self.solution, []
        for part, factor in zip(self._parts.values(), factors_of(self.rows, self.at).values(), strict=True):
            both = np.column_stack([part.made, part.own])
            both = solve_triangular(factor.lower, both, lower=True, trans="T", check_finite=False, overwrite_b=True)
            follows, inverse = both[:, :-1], factor.inverse
            variances = np.diag(inverse) + np.sum((follows @ solution.covariance) * follows, axis=1)
            found.append(_OfProcesses(both[:, -1] - follows @ solution.border, inverse, follows, variances))
        return tuple(found)


def amplitudes(rows: Rows, at: FloatArray) -> FloatArray:
    """Those of the processes of all flights, over their sizes."""
    return np.asarray(np.exp(at[1 : 1 + len(rows.groups)]))


def scale_of(rows: Rows, block: Block, at: FloatArray) -> FloatArray:
    """S of one flight: the amplitude of each column of its Z (columns,)."""
    return np.repeat(amplitudes(rows, at), [own.stop - own.start for own in block.columns])


def spreads(rows: Rows, terms: Terms, at: FloatArray) -> FloatArray:
    """Prior 1-sigma of b and c under noise of 1."""
    amplitude = np.exp(at[-1]) if np.any(terms.scaled) else 1.0
    return np.concatenate([rows.spread, np.where(terms.scaled, amplitude, 1.0) * terms.spread])


@dataclass(frozen=True)
class _Factor:
    """Of one flight S, a value for each column of Z, and L."""

    scale: FloatArray
    lower: FloatArray

    @cached_property
    def inverse(self) -> FloatArray:
        """M^-1, zero above its diagonal."""
        return np.asarray(dpotri(self.lower, lower=1)[0]) if self.lower.size else self.lower


def factors_of(rows: Rows, at: FloatArray) -> dict[int, _Factor]:
    """Those of each flight with all of its rows, the same beside any terms; of the latest amplitudes they are kept."""
    key, known = amplitudes(rows, at).tobytes(), rows.factors
    found: dict[int, _Factor] = known.pop(key, None) or factored(rows.products, rows, at)
    known[key] = found
    if len(known) > _KEPT:
        del known[next(iter(known))]
    return found


def factored(products: Products, rows: Rows, at: FloatArray) -> dict[int, _Factor]:
    """S and L of each flight, by its number, at these amplitudes."""
    factors = {}
    for number, known in products.flights.items():
        scale = scale_of(rows, rows.blocks[number], at)
        matrix = known.own * scale
        matrix *= scale[:, np.newaxis]
        matrix[np.diag_indices_from(matrix)] += 1.0
        factors[number] = _Factor(scale, lower_factor(matrix, float(np.max(np.diag(matrix), initial=1.0))))
    return factors


def lower_factor(matrix: FloatArray, largest: float) -> FloatArray:
    """Its lower factor; eigenvalues lost in rounding, as without noise, are at what that leaves of the `largest`."""
    try:
        return np.asarray(cholesky(matrix, lower=True, check_finite=False))
    except LinAlgError:
        rounding = matrix.shape[0] * np.finfo(float).eps * largest
        return np.asarray(cholesky(matrix + rounding * np.eye(matrix.shape[0]), lower=True, check_finite=False))


class _Eliminated(NamedTuple):
    """Of one flight W and w, what they take of the normal equations and of the squares, and log |L|."""

    made: FloatArray
    own: FloatArray
    square: FloatArray
    right: FloatArray
    misfit: float
    level: float


def eliminated(products: Products, factors: Mapping[int, _Factor]) -> dict[int, _Eliminated]:
    """Each flight by its number with its processes eliminated."""
    parts = {}
    for number, factor in factors.items():
        known = products.flights[number]
        both = factor.scale[:, np.newaxis] * np.column_stack([known.with_border, known.with_y])
        made = solve_triangular(factor.lower, both, lower=True, check_finite=False, overwrite_b=True)
        border, own = made[:, :-1], made[:, -1]
        level = float(np.sum(np.log(np.diag(factor.lower))))
        parts[number] = _Eliminated(border, own, border.T @ border, border.T @ own, float(own @ own), level)
    return parts


def reduced(products: Products, parts: Mapping[int, _Eliminated]) -> tuple[FloatArray, FloatArray]:
    """Normal equations of U and X with all processes eliminated: matrix and right side."""
    inner = products.across - sum(each.square for each in parts.values())
    return np.asarray(inner), np.asarray(products.right - sum(each.right for each in parts.values()))


def solution_of(
    products: Products, parts: Mapping[int, _Eliminated], rows: Rows, terms: Terms, at: FloatArray
) -> _Solution:
    """b and c with all processes eliminated."""
    spread = spreads(rows, terms, at)
    inner, right = reduced(products, parts)
    inner = inner + np.diag(spread**-2.0)
    outer = lower_factor(inner, float(np.max(np.diag(products.across))))
    border = cho_solve((outer, True), right, check_finite=False)
    level = sum(each.level for each in parts.values())
    level += float(np.sum(np.log(np.diag(outer)))) + float(np.sum(np.log(spread[np.isfinite(spread)])))
    covariance = cho_solve((outer, True), np.eye(border.size), check_finite=False)
    rest = products.square - sum(each.misfit for each in parts.values()) - float(right @ border)
    return _Solution(level, rest, border, covariance)


def cost_of(products: Products, rows: Rows, found: _Solution, at: FloatArray) -> float:
    """Minus log p, but for a constant and the priors of amplitudes."""
    freedom = products.rows - int(np.sum(np.isinf(rows.spread)))
    return float(found.level + freedom * at[0] + 0.5 * found.misfit * np.exp(-2.0 * at[0]))


def slope_of(there: Integrated) -> FloatArray:
    """Derivative of `cost_of` by the logarithms (noise, amplitudes of processes, of the mechanism)."""
    rows, terms, at, found = there.rows, there.terms, there.at, there.solution
    slope, per_noise = np.zeros(at.size), np.exp(-2.0 * at[0])
    for block, of_flight in zip(rows.blocks, there.processes, strict=True):
        each = 1.0 - per_noise * of_flight.mode**2 - of_flight.variances
        for k, own in enumerate(block.columns, start=1):
            slope[k] += float(np.sum(each[own]))
    slope[0] = there.products.rows - int(np.sum(np.isinf(rows.spread))) - found.misfit * per_noise
    if np.any(terms.scaled):
        chosen = np.concatenate([np.zeros(rows.spread.size, dtype=bool), terms.scaled])
        precision = spreads(rows, terms, at)[chosen] ** -2.0
        squares = per_noise * found.border[chosen] ** 2 + np.diag(found.covariance)[chosen]
        slope[-1] = float(np.sum(1.0 - precision * squares))
    return slope


def curvature_of(there: Integrated) -> FloatArray:
    """Second derivatives of `cost_of`. With Q = 1 - C of the standardised unknowns u = [a c] of covariance C, mode m,
    d Q_ij / d log S_k takes Q_ik Q_kj and d m_i / d log S_k takes Q_ik m_k. Processes of different flights have what
    they share alone in common, so that of two flights sums over their columns suffice.
    """
    rows, terms, at, found = there.rows, there.terms, there.at, there.solution
    per_noise, mechanism = np.exp(-2.0 * at[0]), bool(np.any(terms.scaled))
    squares, traces, pairs = np.zeros(at.size - 1), np.zeros(at.size - 1), np.zeros((at.size - 1, at.size - 1))
    chosen = np.concatenate([np.zeros(rows.spread.size, dtype=bool), terms.scaled])
    precision = np.where(chosen, 1.0 / spreads(rows, terms, at), 0.0)
    sums, grams = np.zeros((at.size - 1, chosen.size)), np.zeros((at.size - 1, chosen.size, chosen.size))

    def gather(mode: FloatArray, makes: FloatArray, inverse: FloatArray, groups: Sequence[slice], first: int) -> None:
        """What unknowns of one flight, or of all, have among themselves; `makes` of each by what all share."""
        places, starts = np.arange(first, first + len(groups)), [own.start for own in groups]
        through, diagonal = makes @ found.covariance, np.diag_indices_from(inverse)
        rest = -inverse  # Q beside what all share, below the diagonal and on it
        rest[diagonal] += 1.0
        both = np.column_stack([4.0 * through, 4.0 * per_noise * mode]) @ np.column_stack([makes, mode]).T
        both -= rest
        both -= rest
        both *= rest
        both[diagonal] *= 0.5
        half = np.add.reduceat(np.add.reduceat(both, starts, axis=1), starts, axis=0)
        pairs[np.ix_(places, places)] += half + half.T
        squares[places] += np.add.reduceat(per_noise * mode**2, starts)
        traces[places] += np.add.reduceat(np.diag(rest) - np.sum(through * makes, axis=1), starts)
        for place, own in zip(places, groups, strict=True):
            sums[place] += makes[own].T @ mode[own]
            grams[place] += makes[own].T @ makes[own]

    for block, own in zip(rows.blocks, there.processes, strict=True):
        gather(own.mode, -own.follows, own.inverse, block.columns, 0)
    if mechanism:
        makes = np.diag(precision)[chosen]
        mode = makes @ found.border
        gather(mode, makes, np.zeros((mode.size, mode.size)), [slice(0, mode.size)], at.size - 2)
    pairs -= 4.0 * per_noise * sums @ found.covariance @ sums.T
    through = grams @ found.covariance
    pairs -= 2.0 * np.einsum("iab,jba->ij", through, through)
    out = np.zeros((at.size, at.size))
    out[1:, 1:] = pairs + np.diag(2.0 * (traces - squares))
    out[0, 1:] = out[1:, 0] = 2.0 * squares
    out[0, 0] = 2.0 * found.misfit * per_noise
    return out
