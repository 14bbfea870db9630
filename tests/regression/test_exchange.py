"""Knots that keep one another where they are off, exchanged for better ones."""

from __future__ import annotations

from dataclasses import replace

import pytest
from brv_hypo.ranking.fitting import exchanged

from brv_hypo.mechanisms import find
from brv_hypo.model.term import Regressor, TimeBasis
from brv_hypo.regression.fit import HypothesisFit, fit_hypothesis, plainer, renewed, settled
from brv_hypo.regression.problem import Problem
from tests.chains import prepared
from tests.ranking.pulse import fitted, problem


def moved(given: Problem, fit: HypothesisFit, kind: str, shift: float) -> HypothesisFit:
    """The fit with the columns of its first knot at another time and of another course, the others held."""
    first = min(column.time_basis.start for column in fit.selected)

    def at(column: Regressor) -> Regressor:
        if column.time_basis.start != first:
            return column
        return column.at(column.theta, TimeBasis(kind, first + shift))  # type: ignore[arg-type]

    columns = (*given.baseline, *(at(column) for column in fit.selected))
    return settled(replace(given, refine=False), fit, columns, columns)


@pytest.mark.parametrize("shift", [pytest.param(-0.6, marks=pytest.mark.thorough), 0.6])
@pytest.mark.parametrize(
    "name", ["bodyfixed", *(pytest.param(name, marks=pytest.mark.thorough) for name in ("damping", "inplane"))]
)
def test_a_knot_that_is_off_is_found_again(name: str, shift: float) -> None:
    given = prepared(name, max_terms=4, exact_terms=4)
    best = renewed(given, fit_hypothesis(given, name, (find(name),)))
    off = moved(given, best, "jump", shift)
    assert off.information > best.information + 10.0
    assert exchanged(given, off).information <= best.information + 1.0


@pytest.mark.parametrize("name", ["bodyfixed", "damping", pytest.param("sticking", marks=pytest.mark.thorough)])
def test_the_best_model_stays(name: str) -> None:
    best = fitted(name)
    assert exchanged(problem(), best).information <= best.information


def test_a_model_of_the_grid_alone_is_left_as_it_is() -> None:
    """Without refinement there is no better place for a knot."""
    rough = replace(problem(), refine=False)
    fit = fit_hypothesis(rough, "damping", fitted("damping").mechanisms)
    assert exchanged(rough, fit).columns == fit.columns


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
