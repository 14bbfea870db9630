"""Prediction error on blocks of time that took no part in the fit."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from brv_hypo.arrays import FloatArray, IntArray
from brv_hypo.model.term import Regressor
from brv_hypo.regression.frame import RateFrame
from brv_hypo.regression.linear import lengths
from brv_hypo.regression.problem import Problem
from brv_hypo.regression.uncertainty import residual_moments

# Share of the columns' unit length that keeps the normal equations of fewer rows regular.
_RIDGE = 1e-10


def jackknife_error(left_out: FloatArray) -> float:
    """Standard error of an estimate from those without each of some blocks (blocks,).

    Efron and Stein, Ann. Statist. 9, 1981.
    """
    return float(np.sqrt((left_out.size - 1) * np.var(left_out)))


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


def held_out(problem: Problem, frame: RateFrame, columns: Sequence[Regressor], count: int) -> float:
    """Mean square error of the moment coefficients on each of `count` blocks, predicted by the fit without it.

    The rows of a block are taken out of the normal equations of columns and nuisances; the walk of the attitude is
    independent of the rates' noise here, as rows may be left out only then.
    """
    problem = problem.untied()
    of_row, of_sample = block_of_whitened_row(problem, count), block_of_row(problem.frame, count)
    design = problem.whole_design(frame, columns)
    scale = lengths(design)
    unit, response = design / scale, problem.raw_response
    products, right = unit.T @ unit + _RIDGE * np.eye(scale.size), unit.T @ response
    blocks = np.unique(of_row[of_row >= 0])
    found = []
    for block in blocks:
        inside = unit[of_row == block]
        factor = cho_factor(products - inside.T @ inside, check_finite=False)
        found.append(cho_solve(factor, right - inside.T @ response[of_row == block]) / scale)
    values, size = np.stack(found, axis=1), len(columns)
    rest = problem.left(frame, columns, values[:size], values[size + 2 * len(problem.rows.part.levels) :])
    moments = residual_moments(frame, problem.records, rest.rates)
    places = np.searchsorted(blocks, of_sample)
    usable = moments.usable & np.isin(of_sample, blocks)
    errors = moments.body[np.arange(places.size), np.minimum(places, blocks.size - 1)][usable]
    return float(np.sum(np.abs(errors) ** 2) / 2.0 / max(errors.size, 1))
