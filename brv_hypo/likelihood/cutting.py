"""Long segments cut into shorter ones with first states of their own: for a start, whose dynamics are loose."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.likelihood.interpolation import WIDTH
from brv_hypo.likelihood.segment import Grid, History
from brv_hypo.likelihood.step import Iterate, Problem

PIECE = 8192
"""Samples of a piece: far more than loose dynamics remember, few enough to be solved in little memory."""


def cut(problem: Problem, iterate: Iterate) -> tuple[Problem, Iterate]:
    """The problem with every long segment as several; what a delay sees before a piece is held where it stands."""
    grids: list[Grid] = []
    states: list[FloatArray] = []
    index = []
    for grid, x, own in zip(problem.grids, iterate.x, problem.parameters.segment_index, strict=True):
        edges = _edges(grid.n)
        for first, last in pairwise(edges):
            grids.append(_piece(grid, x, first, last, bool(problem.model.delays)) if len(edges) > 2 else grid)
            states.append(x[:, first:last])
            index.append(own)
    parameters = replace(problem.parameters, segment_index=tuple(index))
    return (
        replace(problem, grids=tuple(grids), parameters=parameters),
        replace(iterate, x=tuple(states)),
    )


def joined(whole: Problem, states: Sequence[FloatArray]) -> tuple[FloatArray, ...]:
    """The states of the whole segments from those of their pieces."""
    remaining = iter(states)
    return tuple(
        np.concatenate([next(remaining) for _ in _edges(grid.n)[1:]], axis=1) for grid in whole.grids
    )


def _edges(n: int) -> list[int]:
    """Where pieces begin, and n."""
    return np.linspace(0, n, max(round(n / PIECE), 1) + 1).astype(np.int64).tolist()  # type: ignore[no-any-return]


def _piece(grid: Grid, x: FloatArray, first: int, last: int, delayed: bool) -> Grid:
    intervals = np.arange(first, last - 1)
    ends = 2 * grid.n - 1 + intervals if grid.jumps else intervals[:0]
    where = np.concatenate([np.arange(first, last), grid.n + intervals, ends])
    history = grid.history
    if delayed and first >= WIDTH:
        before = slice(0, first + 1)
        history = History(grid.t[before], x[:, before], grid.u[:, before])
    return Grid(
        t=grid.t[where],
        u=grid.u[:, where],
        y=grid.y[:, first:last],
        measured=grid.measured[:, first:last],
        step=grid.step[first : last - 1],
        start=grid.first if first == 0 else x[:, first],
        start_std=grid.start_std if first == 0 else np.full_like(grid.start_std, np.inf),
        interpolator=grid.interpolator.part(first, last),
        history=history,
        courses=tuple(course.part(where) for course in grid.courses),
        ignores=grid.ignores,
        jumps=grid.jumps,
    )
