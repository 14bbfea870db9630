"""What the terms that several flights share predict of each, known from the others alone: the hardest held-out test.

What belongs to the flight itself (trim, instruments, what changes at times of its record) is fitted to it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from brv_hypo.arrays import BoolArray, FloatArray
from brv_hypo.model.term import Regressor
from brv_hypo.regression.frame import RateFrame
from brv_hypo.regression.problem import GIVEN, Problem
from brv_hypo.regression.residual_moments import residual_moments
from brv_hypo.residuals.candidates import Candidate
from brv_hypo.residuals.judge import Prediction, moment_errors
from brv_hypo.residuals.linearisation import Seen
from brv_hypo.residuals.problem import constrained
from brv_hypo.residuals.result import FlightLeftOut


def flight_left_out(problem: Problem, seen: Seen, candidate: Candidate) -> FlightLeftOut | None:
    """Errors on each flight without and with the candidate; None for one flight, or where nothing of it is shared."""
    shared = any(column.flight is None and column.mechanism != GIVEN for column in candidate.fit.selected)
    if len(seen.records) < 2 or not shared:
        return None
    flights = range(len(seen.records))
    before = [_predicted(problem, seen, problem.frame, problem.baseline, k) for k in flights]
    after = [_predicted(problem, seen, candidate.fit.frame, candidate.fit.columns, k) for k in flights]
    sums = [sum(float(each.squares.sum()) for each in errors) for errors in (before, after)]
    return FlightLeftOut(
        before=tuple(each.mean_square for each in before),
        after=tuple(each.mean_square for each in after),
        ratio=sums[1] / sums[0],
    )


def _predicted(
    problem: Problem, seen: Seen, frame: RateFrame, columns: Sequence[Regressor], number: int
) -> Prediction:
    """Errors on one flight of the shared coefficients that the others have."""
    items = problem.rows.nuisances.items
    own = np.array([column.flight == number for column in columns], dtype=bool)
    shared = np.array([column.flight is None for column in columns], dtype=bool)
    here = np.array([item.flight == number for item in items], dtype=bool)
    others = problem.on(seen.part_of([k for k in range(len(seen.records)) if k != number]))
    known = constrained(others, frame, columns, _held_at_zero(own), _held_at_zero(here))
    held = np.where(shared, known.values, _held_at_zero(~own & ~shared))
    of_all = np.array([item.flight is None for item in items], dtype=bool)
    nuisances = np.where(of_all, known.others, _held_at_zero(~here & ~of_all))
    part = seen.part_of([number])
    left = constrained(problem.on(part), frame, columns, held, nuisances).left
    return moment_errors(part, residual_moments(frame, problem.records, left.rates))


def _held_at_zero(which: BoolArray) -> FloatArray:
    """Zero for these, NaN (free) for the others."""
    return np.where(which, 0.0, np.nan)
