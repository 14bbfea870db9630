"""Effects that one flight cannot tell apart, from the angles between their projected columns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.constants import NEAR_EQUAL_COSINE
from brv_hypo.mechanisms.contract import Mechanism
from brv_hypo.model.term import Regressor
from brv_hypo.regression.problem import Problem
from brv_hypo.residuals.candidates import Candidate
from brv_hypo.residuals.left_out import directions_beyond


def near_equals(
    problem: Problem, candidates: Sequence[Candidate], tried: Sequence[Candidate] = ()
) -> dict[str, tuple[str, ...]]:
    """For each candidate the others whose columns hold nearly all that it predicts, the nearest first.

    An effect that is constant where it is tried may act at the times of another as well: `tried` are all that were.
    """
    design = problem.design(problem.frame, problem.baseline)
    base = directions_beyond(np.zeros((design.shape[0], 0)), design)
    spans = {c.name: _span(problem, base, c, c.fit.selected) for c in candidates}
    found = {}
    for candidate in candidates:
        size = float(np.linalg.norm(candidate.contribution))
        timed = {each.name: columns for each in tried if (columns := _at_the_times_of(candidate, each))}
        own = {each.name: _span(problem, base, each, timed[each.name]) for each in tried if each.name in timed}
        cosines = {
            name: float(np.linalg.norm(span.T @ candidate.contribution)) / size
            for name, span in {**spans, **own}.items()
            if name != candidate.name and size > 0.0
        }
        near = sorted((name for name in cosines if cosines[name] > NEAR_EQUAL_COSINE), key=lambda name: -cosines[name])
        found[candidate.name] = tuple(near)
    return found


def _at_the_times_of(candidate: Candidate, other: Candidate) -> tuple[Regressor, ...]:
    """The other's columns where the candidate's begin, end and change; none where either cannot."""
    if not other.fit.mechanisms or not all(_may_come_and_go(m, other) for m in other.fit.mechanisms):
        return ()
    courses = dict.fromkeys(c.time_basis for c in candidate.fit.selected if c.time_basis.kind != "constant")
    return tuple(replace(column, time_basis=time_basis) for time_basis in courses for column in other.fit.selected)


def _may_come_and_go(mechanism: Mechanism, candidate: Candidate) -> bool:
    """Whether it was tried as constant alone, but is no part of the vehicle and no schedule."""
    flight = candidate.fit.frame.reconstructions[0].flight
    constant = mechanism.time_variation == ("constant",) and mechanism.follows != "mach"
    return constant and not mechanism.of_each_flight(flight)


def _span(problem: Problem, base: FloatArray, candidate: Candidate, columns: Sequence[Regressor]) -> FloatArray:
    """Orthonormal directions (rows, columns) of columns of a candidate's beyond the baseline and the nuisances."""
    return directions_beyond(base, problem.design(candidate.fit.frame, columns))
