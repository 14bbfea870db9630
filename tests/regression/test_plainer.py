"""Knots that come to one place become one."""

from __future__ import annotations

from dataclasses import replace

from brv_hypo.model.term import TimeBasis
from brv_hypo.regression.fit import plainer, settled
from tests.ranking.pulse import fitted, problem


def test_two_ramps_that_meet_become_one_knot() -> None:
    """A ramp less the same a little later is a jump: their sizes grow beyond bound as the knots meet."""
    best = fitted("inplane")
    first = best.selected[0]
    ramps = tuple(first.at(first.theta, TimeBasis("ramp", first.time_basis.start + late)) for late in (-5e-4, 5e-4))
    columns = (*problem().baseline, *best.selected[1:], *ramps)
    met = settled(replace(problem(), refine=False), best, columns, columns)
    found = plainer(problem(), met)
    assert found.information < met.information - 1.0
    assert len({column.time_basis.start for column in found.selected}) < len(met.selected)
