"""The in-plane moment of models of several sizes over time: Figures 5.12 to 5.15 of the report.

Where the curves of two sizes differ by much, the smaller one cannot be believed.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from brv_hypo.ranking.drawn import drawn
from brv_hypo.ranking.histories import in_plane_parts
from brv_hypo.ranking.result import SizeSeries
from brv_hypo.regression.fit import HypothesisFit, likeliest, solved
from brv_hypo.regression.problem import Problem
from brv_hypo.regression.reduced import Reduced
from brv_hypo.regression.search import on_grid


def size_series(problem: Problem, fits: Sequence[HypothesisFit]) -> tuple[SizeSeries, ...]:
    """C_N' at no angle of attack and its slope, of the likeliest hypothesis that has a mechanism, by its terms.

    The baseline alone, the best subsets on the grid of knots and delays with the fewest and the most terms that are
    searched exactly, and the model that was chosen.
    """
    searched = [fit for fit in fits if fit.mechanisms]
    if not searched:
        return ()
    leader = likeliest(searched)
    grid = on_grid(problem, leader.mechanisms, 1)
    reduced = Reduced(problem, grid.frame)
    sizes = sorted({min(grid.best, default=0), max(grid.best, default=0)} - {0, len(leader.selected)})
    models = [fit for fit in fits if not fit.mechanisms]
    for size in sizes:
        columns = (*problem.baseline, *grid.best[size][0][1])
        models.append(solved(reduced, leader.name, leader.mechanisms, columns, leader.searched))
    return tuple(series for fit in (*models, leader) for series in _of(fit, fit is leader))


def _of(fit: HypothesisFit, chosen: bool) -> list[SizeSeries]:
    """One series for each flight."""
    at_zero, slope = in_plane_parts(fit)
    found = []
    for flight in dict.fromkeys(segment.flight for segment in fit.frame.segments):
        own = [
            (segment.time, slice(a, b))
            for segment, (a, b) in zip(fit.frame.segments, fit.frame.pieces, strict=True)
            if segment.flight == flight
        ]
        time, zero, rise = (
            np.concatenate([part[drawn(part.size)] for part in parts])
            for parts in zip(*((time, at_zero[rows], slope[rows]) for time, rows in own), strict=True)
        )
        found.append(
            SizeSeries(
                mechanism=fit.name,
                n_terms=len(fit.selected),
                chosen=chosen,
                flight=flight,
                time_s=tuple(time.tolist()),
                at_zero=tuple(zero.tolist()),
                slope=tuple(rise.tolist()),
            )
        )
    return found
