"""Prediction error on blocks of time that took no part in the fit.

The rows of a block are taken out of the normal equations: coefficients and nuisances are those of the rest.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve

from brv_hypo.arrays import FloatArray, IntArray
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

    `mean_square` of the moment coefficients over all blocks; `by_block` (blocks,) of the whitened rates,
    whose noise hides less.
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


def held_out(problem: Problem, frame: RateFrame, columns: Sequence[Column], count: int) -> HeldOut:
    """Fit the columns without each block in turn, and predict the moments and the rates in it."""
    blocks = block_of_row(problem.frame, count)
    first_other = len(columns) + 2 * len(problem.rows.part.levels)
    square, size = 0.0, 0
    by_block = []
    for without in left_out(problem, frame, columns, count):
        by_block.append(without.error)
        values = without.values
        left = problem.left(frame, columns, values[: len(columns)], values[first_other:])
        moments = residual_moments(frame, problem.records, left.rates)
        inside = (blocks == without.block) & moments.usable
        square += float(np.sum(np.abs(moments.body[inside]) ** 2)) / 2.0
        size += int(np.count_nonzero(inside))
    return HeldOut(square / max(size, 1), np.array(by_block))


@dataclass(frozen=True)
class Without:
    """A fit without one block: coefficients and unknowns `values`, the block's mean square whitened rate `error`, and
    the residual sum of squares of all the `rest`.
    """

    block: int
    values: FloatArray
    error: float
    rest: float


def left_out(
    problem: Problem, frame: RateFrame, columns: Sequence[Column], count: int
) -> Iterator[Without]:
    """The columns fitted without each block in turn."""
    design = problem.whole_design(frame, columns)
    scale = lengths(design)
    design, response = design / scale, problem.raw_response
    normal, right = design.T @ design + _RIDGE * np.eye(scale.size), design.T @ response
    of_row = block_of_whitened_row(problem, count)
    is_rate = np.arange(of_row.size) < problem.rows.rates
    for block in range(int(of_row.max()) + 1):
        out = of_row == block
        if not out.any():
            continue
        own = design[out]
        values = solve(normal - own.T @ own, right - own.T @ response[out], assume_a="sym")
        error = response[out & is_rate] - design[out & is_rate] @ values
        rest = response[~out] - design[~out] @ values
        yield Without(block, values / scale, float(np.mean(error**2)), float(rest @ rest))
