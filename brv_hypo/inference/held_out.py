"""Prediction error on blocks of time that took no part in the fit."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from brv_hypo.arrays import FloatArray, IntArray
from brv_hypo.inference.problem import Problem
from brv_hypo.linearisation.frame import RateFrame, residual_moments
from brv_hypo.linearisation.linear import lengths
from brv_hypo.model.term import Regressor

_RIDGE = 1e-10  # of the columns' unit length: keeps the normal equations of fewer rows regular


def jackknife_error(left_out: FloatArray) -> float:
    """Standard error from estimates without each block (blocks,): Efron and Stein, Ann. Statist. 9, 1981."""
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
    blocks = block_of_row(problem.frame, count)[problem.rows.samples]
    return np.append(np.tile(blocks, 4), np.full(problem.rows.nuisances.bounded.size, -1))


def held_out(problem: Problem, models: Sequence[tuple[RateFrame, Sequence[Regressor]]], count: int) -> list[float]:
    """Mean square error of the moment coefficients on each of `count` blocks a flight, predicted by the fit without it.
    One of each of the `models`, columns in their frame. The rows of a block are taken out of the normal equations of
    columns and nuisances; the walk of the attitude is independent of the rates' noise here, as rows may be left out
    only then. A block concerns its flight's own unknowns and what all flights share: the others' are eliminated once.
    """
    problem = problem.untied()
    flights = [_Flight.of(problem, number, count) for number in range(len(problem.rows.of_flights))]
    return [_error(problem, flights, *model, count) for model in models]


@dataclass(frozen=True)
class _Flight:
    """A flight's own unknowns at unit length (rows, unknowns), their products, and its rows of each block."""

    unit: FloatArray
    scale: FloatArray
    response: FloatArray
    products: FloatArray
    right: FloatArray
    blocks: dict[int, IntArray]

    @classmethod
    def of(cls, problem: Problem, number: int, count: int) -> _Flight:
        """That of one flight of a problem."""
        unknowns = problem.rows.unknowns
        own, response = unknowns.own[number], unknowns.by_flight(problem.raw_response)[number]
        ranges, of_row = unknowns.ranges[number], block_of_whitened_row(problem, count)
        block = np.concatenate([of_row[each] for each in (*ranges, slice(0, 0))])
        scale = lengths(own)
        unit = own / scale
        products = unit.T @ unit + _RIDGE * np.eye(scale.size)
        blocks = {int(k): np.flatnonzero(block == k) for k in np.unique(block) if k >= 0}
        return cls(unit, scale, response, products, unit.T @ response, blocks)


def _error(
    problem: Problem, flights: Sequence[_Flight], frame: RateFrame, columns: Sequence[Regressor], count: int
) -> float:
    """The held-out error of one model."""
    unknowns, histories = problem.rows.unknowns, problem.rows.nuisances.flights
    shared = np.column_stack([problem.raw_design(frame, columns), unknowns.shared])
    scale = lengths(shared)
    shared = shared / scale
    parts = unknowns.by_flight(shared)
    corner = shared.T @ shared + _RIDGE * np.eye(scale.size)
    right = shared.T @ problem.raw_response
    borders = [own.unit.T @ part for own, part in zip(flights, parts, strict=True)]
    eliminated = [_schur(own.products, border, own.right)[:2] for own, border in zip(flights, borders, strict=True)]
    corner = corner - sum(square for square, _ in eliminated)
    right = right - sum(beyond for _, beyond in eliminated)
    constants, moments = 2 * len(problem.rows.part.levels), frame.columns(columns)
    rest = np.zeros((frame.observed.size, count), dtype=complex)
    for number, (own, part, border, known) in enumerate(zip(flights, parts, borders, eliminated, strict=True)):
        values, others = np.zeros((len(columns), count)), np.zeros((unknowns.size, count))
        for block, rows in own.blocks.items():
            inside, beside, y = own.unit[rows], part[rows], own.response[rows]
            products, across = own.products - inside.T @ inside, border - inside.T @ beside
            own_right = own.right - inside.T @ y
            square, beyond, solve = _schur(products, across, own_right)
            common = np.linalg.solve(
                corner + known[0] - beside.T @ beside - square, right + known[1] - beside.T @ y - beyond
            )
            place = block % count
            values[:, place] = (common / scale)[: len(columns)]
            others[problem.rows.order[unknowns.places[number]], place] = solve(own_right - across @ common) / own.scale
            others[problem.rows.order[unknowns.places[-1]], place] = (common / scale)[len(columns) :]
        mine, span = histories[number], histories[number].span
        made = mine.grid.all_of(mine.kept.rates @ others[constants:][mine.places])
        rest[span] = frame.observed[span, np.newaxis] - moments[span] @ values - made
    found, block_of = residual_moments(frame, problem.records, rest), block_of_row(problem.frame, count)
    use = found.usable & np.isin(block_of, [block for own in flights for block in own.blocks])
    errors = found.body[np.arange(rest.shape[0]), block_of % count][use]
    return float(np.sum(np.abs(errors) ** 2) / 2.0 / max(errors.size, 1))


def _schur(
    products: FloatArray, border: FloatArray, right: FloatArray
) -> tuple[FloatArray, FloatArray, Callable[[FloatArray], FloatArray]]:
    """What eliminating a flight's unknowns takes of the shared products and right side; what solves for them."""
    factor = cho_factor(products, check_finite=False)

    def solve(rows: FloatArray) -> FloatArray:
        return np.asarray(cho_solve(factor, rows, check_finite=False), dtype=float)

    both = solve(np.column_stack([border, right]))
    return border.T @ both[:, :-1], border.T @ both[:, -1], solve
