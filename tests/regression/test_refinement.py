"""Knots as continuous parameters."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from brv_hypo.model.term import TimeBasis
from brv_hypo.regression.fit import HypothesisFit, self_consistent
from brv_hypo.regression.refinement import nonlinear_parameters
from brv_hypo.regression.uncertainty import with_errors
from tests.ranking.pulse import fitted, problem


def moved(fit: HypothesisFit, shift: float) -> HypothesisFit:
    """The fit with its first knot moved (s), and nothing fitted again."""
    start = min(column.time_basis.start for column in fit.selected)
    columns = tuple(
        replace(column, time_basis=TimeBasis(column.time_basis.kind, start + shift, column.time_basis.stop))
        if column.time_basis.start == start
        else column
        for column in fit.columns
    )
    return replace(fit, columns=columns)


@pytest.mark.parametrize("place", [0.0, 0.5, 1.0])
def test_a_knot_stays_within_the_record(place: float) -> None:
    """Beyond its ends nothing depends on where it is, and its error, with what goes along with it, is rounding."""
    best, told = fitted("bodyfixed"), problem()
    start, stop = float(best.frame.coefficient_time.min()), float(best.frame.coefficient_time.max())
    columns = tuple(
        column.at(column.theta, TimeBasis(column.time_basis.kind, start + place * (stop - start)))
        for column in best.selected
    )
    for knot in nonlinear_parameters(columns, 0, best.frame, told.knots):
        assert start <= knot.bounds[0] <= knot.value <= knot.bounds[1] <= stop
        assert knot.bounds[0] < knot.bounds[1]


@pytest.mark.parametrize("shift", [-0.01, 0.01])
def test_knots_of_a_model_that_is_told_are_where_the_steps_lead_wherever_they_begin(shift: float) -> None:
    best = with_errors(problem(), self_consistent(problem(), fitted("bodyfixed")))
    found = self_consistent(problem(), moved(best, shift))
    for one, other, error in zip(found.nonlinear, best.nonlinear, best.nonlinear_errors, strict=True):
        assert one.value == pytest.approx(other.value, abs=1e-6 * error)


def test_what_lags_is_told_with_the_static_moment_that_goes_with_it() -> None:
    best = with_errors(problem(), self_consistent(problem(), fitted("lag")))
    again = self_consistent(problem(), best)
    errors = np.sqrt(np.diag(best.covariance))
    assert np.max(np.abs(again.values - best.values) / errors) < 1e-2  # where a record is linearised
