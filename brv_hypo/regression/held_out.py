"""Prediction error on blocks of time that took no part in the fit.

The rows of a block are taken out of the normal equations: coefficients and nuisances are those of the rest. The
nuisances' part of the equations is formed once for all columns.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from brv_hypo.arrays import BoolArray, FloatArray, IntArray
from brv_hypo.model.columns import Column
from brv_hypo.regression.frame import RateFrame
from brv_hypo.regression.linear import lengths
from brv_hypo.regression.problem import Problem
from brv_hypo.regression.residual_moments import residual_moments

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

    def of(self, frame: RateFrame, columns: Sequence[Column]) -> FitsWithout:
        """The fits of these columns."""
        return FitsWithout(self, frame, tuple(columns))

    def blocks(self, count: int) -> tuple[_Block, ...]:
        """The blocks of each of `count` that hold a row."""
        if count not in self._blocks:
            of_row = block_of_whitened_row(self.untied, count)
            is_rate = np.arange(of_row.size) < self.untied.rows.rates
            self._blocks[count] = tuple(
                _Block(b, self._part((of_row == b) & is_rate), self._part((of_row == b) & ~is_rate))
                for b in range(int(of_row.max()) + 1)
                if np.any(of_row == b)
            )
        return self._blocks[count]

    @cached_property
    def whole(self) -> _Rows:
        """All rows."""
        return self._part(np.ones(self.untied.rows.size, dtype=bool))

    def _part(self, chosen: BoolArray) -> _Rows:
        nuisances, response = self.untied.rows.nuisance_design[chosen], self.untied.raw_response[chosen]
        return _Rows(np.flatnonzero(chosen), _gram(nuisances, response))


@dataclass(frozen=True)
class _Rows:
    """Some of the rows, and the scalar products of the nuisances and the response (last) over them."""

    rows: IntArray
    products: FloatArray


@dataclass(frozen=True)
class _Block:
    """The rates of a block, and what else it has."""

    number: int
    rates: _Rows
    force: _Rows


class FitsWithout:
    """The same columns fitted without blocks of time."""

    def __init__(self, shared: LeavingOut, frame: RateFrame, columns: tuple[Column, ...]) -> None:
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
        left = self._left(self._solved(self._whole)[1][:, np.newaxis])
        return float(np.sum(left**2))

    @cached_property
    def _own(self) -> FloatArray:
        """The columns themselves, whitened (rows, columns)."""
        return self.shared.untied.raw_design(self.frame, self.columns)

    @cached_property
    def _scale(self) -> FloatArray:
        """Lengths of columns and nuisances, and 1 for the response."""
        design = self.shared.untied.rows.nuisance_design
        return np.concatenate([lengths(self._own), lengths(design), [1.0]])

    @cached_property
    def _whole(self) -> FloatArray:
        return self._products(self.shared.whole)

    def _products(self, part: _Rows) -> FloatArray:
        """Scalar products of unit columns, nuisances and response over some rows."""
        own, size = self._own[part.rows], self._own.shape[1]
        out = np.empty((self._scale.size,) * 2)
        out[:size, :size] = own.T @ own
        out[:size, size:-1] = own.T @ self.shared.untied.rows.nuisance_design[part.rows]
        out[:size, -1] = own.T @ self.shared.untied.raw_response[part.rows]
        out[size:, :size] = out[:size, size:].T
        out[size:, size:] = part.products
        return out / (self._scale[:, np.newaxis] * self._scale)

    def _solved(self, products: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Normal equations of unit columns, and the values (columns + unknowns,) that solve them."""
        count = self._scale.size - 1
        normal = products[:count, :count] + _RIDGE * np.eye(count)
        return normal, cho_solve(cho_factor(normal), products[:count, -1]) / self._scale[:-1]

    def _left(self, values: FloatArray) -> FloatArray:
        """What `values` (columns + unknowns, fits) leave of the response (rows, fits)."""
        size, untied = self._own.shape[1], self.shared.untied
        fitted = self._own @ values[:size] + untied.rows.nuisance_design @ values[size:]
        return np.asarray(untied.raw_response[:, np.newaxis] - fitted, dtype=float)

    def _without(self, blocks: Sequence[_Block]) -> tuple[Without, ...]:
        seen = [self._products(block.rates) for block in blocks]
        solved = [
            self._solved(self._whole - rates - self._products(block.force))
            for block, rates in zip(blocks, seen, strict=True)
        ]
        left = self._left(np.stack([values for _, values in solved], axis=1))
        total = np.sum(left**2, axis=0)
        found = []
        for k, (block, (normal, values), rates) in enumerate(zip(blocks, solved, seen, strict=True)):
            error, force = left[block.rates.rows, k], left[block.force.rows, k]
            score = _score(error, self._seen(error, block.rates.rows), rates[:-1, :-1], normal)
            rest = float(total[k] - error @ error - force @ force)
            found.append(Without(block.number, values, score, rest))
        return tuple(found)

    def _seen(self, error: FloatArray, rows: IntArray) -> FloatArray:
        """Scalar products of unit columns and nuisances with an error on some rows."""
        design = self.shared.untied.rows.nuisance_design[rows]
        return np.concatenate([self._own[rows].T @ error, design.T @ error]) / self._scale[:-1]


def _gram(nuisances: FloatArray, response: FloatArray) -> FloatArray:
    size = nuisances.shape[1]
    out = np.empty((size + 1, size + 1))
    out[:size, :size] = nuisances.T @ nuisances
    out[:size, size] = out[size, :size] = nuisances.T @ response
    out[size, size] = response @ response
    return out


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


def _score(error: FloatArray, seen: FloatArray, rates: FloatArray, normal: FloatArray) -> float:
    """e' S^-1 e + ln |S| of errors (rows,) of unit noise, S = I + X N^-1 X' with the uncertainty of what was fitted.

    `seen` is X'e, `rates` X'X, `normal` N.
    """
    with_block = cho_factor(normal + rates)
    known = error @ error - seen @ cho_solve(with_block, seen)
    return float(known + _log_determinant(with_block[0]) - _log_determinant(cho_factor(normal)[0]))


def _log_determinant(factor: FloatArray) -> float:
    """Of the matrix with this Cholesky factor."""
    return 2.0 * float(np.sum(np.log(np.diag(factor))))
