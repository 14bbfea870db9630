"""Prediction error on blocks of time that took no part in the fit."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from brv_hypo.arrays import BoolArray, ComplexArray, FloatArray
from brv_hypo.model.columns import Column
from brv_hypo.regression.fit import HypothesisFit
from brv_hypo.regression.frame import Piece, RateFrame, whiten
from brv_hypo.regression.linear import solve_scaled
from brv_hypo.regression.problem import Task


@dataclass(frozen=True)
class HeldOut:
    """Errors on held-out blocks, pitch and yaw together.

    `mean_square` of the moment coefficients over all blocks; `by_block` (blocks,) of the whitened rates,
    whose noise hides less.
    """

    mean_square: float
    by_block: FloatArray


def blocks(frame: RateFrame, count: int) -> tuple[tuple[Piece, ...], ...]:
    """`count` blocks of rows a flight, of equal length; each block as its row ranges."""
    found: list[tuple[Piece, ...]] = []
    flights = frame.flight_of_row
    for flight in np.unique(flights):
        rows = np.flatnonzero(flights == flight)
        edges = np.linspace(rows[0], rows[-1] + 1, count + 1).astype(int)
        found.extend(_cut(frame.pieces, int(a), int(b)) for a, b in itertools.pairwise(edges))
    return tuple(block for block in found if block)


def _cut(pieces: tuple[Piece, ...], a: int, b: int) -> tuple[Piece, ...]:
    return tuple((max(s, a), min(e, b)) for s, e in pieces if s < b and e > a)


def _without(pieces: tuple[Piece, ...], block: tuple[Piece, ...], shortest: int = 8) -> tuple[Piece, ...]:
    kept = list(pieces)
    for a, b in block:
        kept = [
            part
            for s, e in kept
            for part in ((s, min(e, a)), (max(s, b), e))
            if part[1] - part[0] >= shortest
        ]
    return tuple(kept)


def measured_moments(frame: RateFrame) -> tuple[ComplexArray, BoolArray]:
    """C_m + i C_n of the reconstruction (rows,), and where it is usable."""
    body = np.empty(frame.observed.size, dtype=complex)
    usable = np.empty(frame.observed.size, dtype=bool)
    for segment, (a, b) in zip(frame.segments, frame.pieces, strict=True):
        moments = frame.reconstructions[segment.flight].moments
        body[a:b], usable[a:b] = moments.body[segment.rows], moments.usable[segment.rows]
    return body, usable


def held_out(task: Task, fit: HypothesisFit, count: int) -> HeldOut:
    """Regress the hypothesis's columns without each block in turn, and predict the moments in it."""
    rates = fit.frame.columns(fit.columns)

    def without(block: tuple[Piece, ...]) -> FloatArray:
        return coefficients(task, fit.frame, rates, _without(fit.frame.pieces, block))

    return predicted(task, fit.frame, fit.columns, count, without)


def predicted(
    task: Task,
    frame: RateFrame,
    columns: Sequence[Column],
    count: int,
    without: Callable[[tuple[Piece, ...]], FloatArray],
) -> HeldOut:
    """Errors of the moments and of the whitened rates in each block, with the coefficients had `without` it."""
    rates, moments = frame.columns(columns), frame.moments(columns)
    measured, usable = measured_moments(frame)
    square, size = 0.0, 0
    by_block = []
    for block in blocks(frame, count):
        values = without(block)
        rows = np.concatenate([np.arange(a, b) for a, b in block])
        rows = rows[usable[rows]]
        square += float(np.sum(np.abs(measured[rows] - moments[rows] @ values) ** 2)) / 2.0
        size += rows.size
        left = whiten((frame.observed - rates @ values)[:, None], block, task.noise)
        by_block.append(float(np.mean(left**2)))
    return HeldOut(square / max(size, 1), np.array(by_block))


def coefficients(task: Task, frame: RateFrame, rates: ComplexArray, pieces: tuple[Piece, ...]) -> FloatArray:
    """Coefficients (columns,) from some pieces of the record alone."""
    rows = task.rows_without(pieces)
    design, response = rows.of(rates), rows.of(frame.observed[:, None])[:, 0]
    return solve_scaled(design, response, 1e-10)
