"""Prediction error on blocks of time that took no part in the fit.

The rows of a block are taken out of the normal equations: coefficients and nuisances are those of the rest. The
nuisances' part of the equations is formed and factorised once for all columns.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg.lapack import dtrtrs

from brv_hypo.arrays import BoolArray, FloatArray, IntArray
from brv_hypo.model.term import Regressor
from brv_hypo.regression.frame import RateFrame
from brv_hypo.regression.linear import lengths
from brv_hypo.regression.problem import Problem
from brv_hypo.regression.uncertainty import residual_moments

# Share of the columns' unit length that keeps the normal equations of fewer rows regular.
_RIDGE = 1e-10


@dataclass(frozen=True)
class HeldOut:
    """Errors on held-out blocks, pitch and yaw together.

    `mean_square` of the moment coefficients over all blocks; `by_block` (blocks,) the score of the whitened rates,
    whose noise hides less: -2 ln of their predictive density given the rest, constants left out. What the rest does
    not settle widens the density, so that an error which was to be expected counts for little.
    """

    mean_square: float
    by_block: FloatArray


def block_of_row(frame: RateFrame, count: int) -> IntArray:
    """Block of each row of the frame (rows,): `count` of equal length a flight."""
    out = np.zeros(frame.observed.size, dtype=np.int64)
    flights = frame.flight_of_row
    for number, flight in enumerate(np.unique(flights)):
        rows = np.flatnonzero(flights == flight)
        out[rows] = number * count + np.arange(rows.size) * count // rows.size
    return out


def block_of_whitened_row(problem: Problem, count: int) -> IntArray:
    """Block of each whitened row (rows,); the rows of priors belong to no block: -1."""
    rows = problem.rows
    blocks = block_of_row(problem.frame, count)[rows.part.rows]
    starts = np.concatenate([np.arange(a, b, rows.noise.thinning) for a, b in rows.part.pieces])
    sample = rows.stretch_of_row()
    return np.where(sample >= 0, blocks[starts][sample], -1)


@dataclass(frozen=True)
class Without:
    """A fit without one block: coefficients and unknowns `values`, the `score` of its whitened rates (see `HeldOut`),
    and the residual sum of squares of all the `rest`.
    """

    block: int
    values: FloatArray
    score: float
    rest: float


class LeavingOut:
    """A problem whose columns are fitted without blocks of time."""

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self.untied = problem.untied()
        self._blocks: dict[int, tuple[_Block, ...]] = {}

    def of(self, frame: RateFrame, columns: Sequence[Regressor]) -> FitsWithout:
        """The fits of these columns."""
        return FitsWithout(self, frame, tuple(columns))

    def blocks(self, count: int) -> tuple[_Block, ...]:
        """The blocks of each of `count` that hold a row."""
        if count not in self._blocks:
            of_row = block_of_whitened_row(self.untied, count)
            is_rate = np.arange(of_row.size) < self.untied.rows.rates
            self._blocks[count] = tuple(
                self._block(b, self._part((of_row == b) & is_rate), self._part((of_row == b) & ~is_rate))
                for b in range(int(of_row.max()) + 1)
                if np.any(of_row == b)
            )
        return self._blocks[count]

    @cached_property
    def whole(self) -> _Rows:
        """All rows."""
        return self._part(np.ones(self.untied.rows.size, dtype=bool))

    @cached_property
    def scale(self) -> FloatArray:
        """Lengths of the nuisances (unknowns,)."""
        return lengths(self.untied.rows.nuisance_design)

    def seen(self, rows: IntArray, others: FloatArray) -> FloatArray:
        """Scalar products of unit nuisances with others over some rows, (rows, columns) or (rows,): (unknowns, ...)."""
        return np.asarray(((self.untied.rows.nuisance_design[rows].T @ others).T / self.scale).T, dtype=float)

    def _part(self, chosen: BoolArray) -> _Rows:
        rows = np.flatnonzero(chosen)
        nuisances, response = self.untied.rows.nuisance_design[rows], self.untied.raw_response[rows]
        products = nuisances.T @ nuisances / np.outer(self.scale, self.scale)
        return _Rows(rows, products, nuisances.T @ response / self.scale)

    def _block(self, number: int, rates: _Rows, force: _Rows) -> _Block:
        products = self.whole.products - rates.products - force.products
        products.flat[:: products.shape[0] + 1] += _RIDGE
        right = self.whole.right - rates.right - force.right
        return _Block(number, rates.rows, force.rows, _factor(products), _factor(products + rates.products), right)


@dataclass(frozen=True)
class _Rows:
    """Some of the rows, and the scalar products of unit nuisances with each other and with the response over them."""

    rows: IntArray
    products: FloatArray
    right: FloatArray


@dataclass(frozen=True)
class _Block:
    """The rows of the rates of a block, and its others; what the nuisances' normal equations are without it.

    `without` and `rateless`: their Cholesky factors without the block, and without its force alone; `right` their right
    side without the block.
    """

    number: int
    rates: IntArray
    force: IntArray
    without: FloatArray
    rateless: FloatArray
    right: FloatArray


@dataclass(frozen=True)
class _Bordered:
    """Cholesky factor of normal equations of nuisances, `first` (unknowns, unknowns), and of columns after them.

    `across` (unknowns, columns), `last` (columns, columns).
    """

    first: FloatArray
    across: FloatArray
    last: FloatArray

    @classmethod
    def of(cls, first: FloatArray, across: FloatArray, own: FloatArray) -> _Bordered:
        """From that of the nuisances and the columns' scalar products with them and with each other."""
        lowered = _lowered(first, across)
        return cls(first, lowered, _factor(own - lowered.T @ lowered))

    def halfway(self, nuisances: FloatArray, columns: FloatArray) -> tuple[FloatArray, FloatArray]:
        """A right side of both, times the inverse of the factor."""
        first = _lowered(self.first, nuisances)
        return first, _lowered(self.last, columns - self.across.T @ first)

    def solve(self, nuisances: FloatArray, columns: FloatArray) -> tuple[FloatArray, FloatArray]:
        """What solves the equations with this right side, of both."""
        first, last = self.halfway(nuisances, columns)
        values = _lowered(self.last, last, transposed=True)
        return _lowered(self.first, first - self.across @ values, transposed=True), values

    @property
    def log_determinant(self) -> float:
        """Of the equations."""
        return 2.0 * float(np.sum(np.log(np.diag(self.first))) + np.sum(np.log(np.diag(self.last))))


class FitsWithout:
    """The same columns fitted without blocks of time."""

    def __init__(self, shared: LeavingOut, frame: RateFrame, columns: tuple[Regressor, ...]) -> None:
        self.shared, self.frame, self.columns = shared, frame, columns
        self._found: dict[int, tuple[Without, ...]] = {}

    def each(self, count: int) -> tuple[Without, ...]:
        """The fits without each of `count` blocks in turn."""
        if count not in self._found:
            self._found[count] = self._without(self.shared.blocks(count))
        return self._found[count]

    @cached_property
    def nothing(self) -> float:
        """Residual sum of squares of all rows, under the same likelihood."""
        whole, own = self.shared.whole, self._whole
        products = whole.products + _RIDGE * np.eye(whole.right.size)
        factor = _Bordered.of(_factor(products), own.across, own.products)
        return float(np.sum(self._left(self._values(factor, whole.right, own.right)[:, np.newaxis]) ** 2))

    @cached_property
    def _own(self) -> FloatArray:
        """The columns themselves, whitened (rows, columns)."""
        return self.shared.untied.raw_design(self.frame, self.columns)

    @cached_property
    def _scale(self) -> FloatArray:
        """Lengths of the columns (columns,)."""
        return lengths(self._own)

    @cached_property
    def _whole(self) -> _OwnProducts:
        whole = self._products(self.shared.whole.rows)
        return replace(whole, products=whole.products + _RIDGE * np.eye(self._scale.size))

    def _products(self, rows: IntArray) -> _OwnProducts:
        own = self._own[rows] / self._scale
        return _OwnProducts(own.T @ own, self.shared.seen(rows, own), own.T @ self.shared.untied.raw_response[rows])

    def _values(self, factor: _Bordered, nuisances: FloatArray, columns: FloatArray) -> FloatArray:
        """Coefficients and unknowns (columns + unknowns,) of unit columns' normal equations with this right side."""
        others, values = factor.solve(nuisances, columns)
        return np.concatenate([values / self._scale, others / self.shared.scale])

    def _left(self, values: FloatArray) -> FloatArray:
        """What `values` (columns + unknowns, fits) leave of the response (rows, fits)."""
        size, untied = self._own.shape[1], self.shared.untied
        fitted = self._own @ values[:size] + untied.rows.nuisance_design @ values[size:]
        return np.asarray(untied.raw_response[:, np.newaxis] - fitted, dtype=float)

    def _without(self, blocks: Sequence[_Block]) -> tuple[Without, ...]:
        seen = [self._products(block.rates) for block in blocks]
        rest = [
            self._whole.less(rates).less(self._products(block.force)) for block, rates in zip(blocks, seen, strict=True)
        ]
        factors = [
            _Bordered.of(block.without, own.across, own.products) for block, own in zip(blocks, rest, strict=True)
        ]
        values = [
            self._values(factor, block.right, own.right)
            for factor, block, own in zip(factors, blocks, rest, strict=True)
        ]
        left = self._left(np.stack(values, axis=1))
        total = np.sum(left**2, axis=0)
        found = []
        for k, (block, own, rates) in enumerate(zip(blocks, rest, seen, strict=True)):
            error, force = left[block.rates, k], left[block.force, k]
            with_rates = _Bordered.of(block.rateless, own.across + rates.across, own.products + rates.products)
            score = _score(error, self._seen(error, block.rates), with_rates, factors[k])
            others = float(total[k] - error @ error - force @ force)
            found.append(Without(block.number, values[k], score, others))
        return tuple(found)

    def _seen(self, error: FloatArray, rows: IntArray) -> tuple[FloatArray, FloatArray]:
        """Scalar products of unit nuisances and columns with an error on some rows."""
        return self.shared.seen(rows, error), self._own[rows].T @ error / self._scale


@dataclass(frozen=True)
class _OwnProducts:
    """Scalar products of unit columns with each other, with unit nuisances (unknowns, columns), and with the response
    over some rows.
    """

    products: FloatArray
    across: FloatArray
    right: FloatArray

    def less(self, other: _OwnProducts) -> _OwnProducts:
        """Those without other rows."""
        return _OwnProducts(self.products - other.products, self.across - other.across, self.right - other.right)


def _factor(products: FloatArray) -> FloatArray:
    """Lower Cholesky factor."""
    return np.asarray(np.linalg.cholesky(products), dtype=float)


def _lowered(factor: FloatArray, rows: FloatArray, transposed: bool = False) -> FloatArray:
    """The inverse of a Cholesky factor, or of its transpose, times something."""
    found, _ = dtrtrs(factor.T, rows, lower=False, trans=not transposed)  # wants columns: of the upper factor
    return np.asarray(found, dtype=float)


def held_out(problem: Problem, without: FitsWithout, count: int) -> HeldOut:
    """Predict the moments and the rates of each block in turn by the fit without it."""
    blocks = block_of_row(problem.frame, count)
    frame, columns = without.frame, without.columns
    first_other = len(columns) + 2 * len(problem.rows.part.levels)
    fits = without.each(count)
    values = np.stack([fit.values for fit in fits], axis=1)
    left = problem.left(frame, columns, values[: len(columns)], values[first_other:])
    moments = residual_moments(frame, problem.records, left.rates)
    square, size = 0.0, 0
    for k, fit in enumerate(fits):
        inside = (blocks == fit.block) & moments.usable
        square += float(np.sum(np.abs(moments.body[inside, k]) ** 2)) / 2.0
        size += int(np.count_nonzero(inside))
    return HeldOut(square / max(size, 1), np.array([fit.score for fit in fits]))


def _score(error: FloatArray, seen: tuple[FloatArray, FloatArray], with_rates: _Bordered, without: _Bordered) -> float:
    """e' S^-1 e + ln |S| of errors (rows,) of unit noise, S = I + X N^-1 X' with the uncertainty of what was fitted.

    `seen` is X'e, of nuisances and columns; the factors are those of N + X'X and of N.
    """
    explained = np.concatenate(with_rates.halfway(*seen))
    known = error @ error - explained @ explained
    return float(known + with_rates.log_determinant - without.log_determinant)
