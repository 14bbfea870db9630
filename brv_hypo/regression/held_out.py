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
from brv_hypo.regression.linear import lengths, solve_scaled
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


def held_out(problem: Problem, frame: RateFrame, columns: Sequence[Column], count: int) -> HeldOut:
    """Fit the columns without each block in turn, and predict the moments and the rates in it."""
    blocks = block_of_row(problem.frame, count)
    first_other = len(columns) + 2 * len(problem.rows.part.levels)
    square, size = 0.0, 0
    by_block = []
    for without in left_out(problem, frame, columns, count):
        by_block.append(without.score)
        values = without.values
        left = problem.left(frame, columns, values[: len(columns)], values[first_other:])
        moments = residual_moments(frame, problem.records, left.rates)
        inside = (blocks == without.block) & moments.usable
        square += float(np.sum(np.abs(moments.body[inside]) ** 2)) / 2.0
        size += int(np.count_nonzero(inside))
    return HeldOut(square / max(size, 1), np.array(by_block))


@dataclass(frozen=True)
class Without:
    """A fit without one block: coefficients and unknowns `values`, the `score` of its whitened rates (see `HeldOut`),
    and the residual sum of squares of all the `rest`.
    """

    block: int
    values: FloatArray
    score: float
    rest: float


def left_out(
    problem: Problem, frame: RateFrame, columns: Sequence[Column], count: int
) -> Iterator[Without]:
    """The columns fitted without each block in turn."""
    problem = problem.untied()
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
        own, rates = design[out], design[out & is_rate]
        others = normal - own.T @ own
        values = solve(others, right - own.T @ response[out], assume_a="sym")
        rest = response[~out] - design[~out] @ values
        score = _score(response[out & is_rate] - rates @ values, rates, others)
        yield Without(block, values / scale, score, float(rest @ rest))


def nothing_left_out(problem: Problem, frame: RateFrame, columns: Sequence[Column]) -> float:
    """Residual sum of squares of all rows, under the likelihood of `left_out`."""
    problem = problem.untied()
    design, response = problem.whole_design(frame, columns), problem.raw_response
    left = response - design @ solve_scaled(design, response)
    return float(left @ left)


def _score(error: FloatArray, design: FloatArray, normal: FloatArray) -> float:
    """e' S^-1 e + ln |S| of errors (rows,) of unit noise, S = I + X N^-1 X' with the uncertainty of what was fitted."""
    with_block = normal + design.T @ design
    seen = design.T @ error
    known = error @ error - seen @ solve(with_block, seen, assume_a="sym")
    wider = np.linalg.slogdet(with_block)[1] - np.linalg.slogdet(normal)[1]
    return float(known + wider)
