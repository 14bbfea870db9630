"""Knots as continuous parameters."""

from __future__ import annotations

import numpy as np
import pytest

from brv_hypo.inference.fit import self_consistent, with_errors
from brv_hypo.inference.refinement import nonlinear_parameters
from brv_hypo.model.term import TimeBasis
from tests.comparison.pulse import fitted, problem


@pytest.mark.parametrize("place", [0.0, 0.5, 1.0])
def test_a_knot_stays_within_the_record(place: float) -> None:
    """Beyond its ends nothing depends on where it is, and its error, with what goes along with it, is rounding."""
    best, whole = fitted("bodyfixed"), problem()
    start, stop = float(best.frame.coefficient_time.min()), float(best.frame.coefficient_time.max())
    columns = tuple(
        column.at(column.theta, TimeBasis(column.time_basis.kind, start + place * (stop - start)))
        for column in best.selected
    )
    for knot in nonlinear_parameters(columns, best.frame, whole.knots):
        assert start <= knot.bounds[0] <= knot.value <= knot.bounds[1] <= stop
        assert knot.bounds[0] < knot.bounds[1]


def test_a_self_consistent_lag_does_not_change_in_a_further_pass() -> None:
    best = with_errors(problem(), self_consistent(problem(), fitted("lag")))
    again = self_consistent(problem(), best)
    errors = np.sqrt(np.diag(best.covariance))
    assert np.max(np.abs(again.values - best.values) / errors) < 1e-2  # where a record is linearised
