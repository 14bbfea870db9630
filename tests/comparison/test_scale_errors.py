"""Errors of the record are no way for a hypothesis to have a share of what it lacks, nor for the baseline."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache

import numpy as np
import pytest

from brv_hypo.comparison import CompareConfig, Comparison, compare
from brv_hypo.simulation import load_config
from tests.chains import judged_cone
from tests.flights import flown

PLANTED = pytest.mark.parametrize("planted", ["bodyfixed", pytest.param("damping", marks=pytest.mark.slow)])


@cache
def compared(planted: str) -> Comparison:
    config = CompareConfig(mechanisms=(planted,), maximum_likelihood="none")
    return compare(flown("research_cone", planted).flight, config)


@PLANTED
def test_no_scale_of_all_moments_replaces_a_large_mechanism(planted: str) -> None:
    """Linearised about the leader, one of its whole moment would replace both: in the baseline's fit there."""
    found = judged_cone(planted)
    none = found.fits[found.null]
    assert found.leading.fit.name == planted
    _, others = found.problem.solution(none.frame, none.columns)
    (errors,) = found.problem.rows.nuisances.values(others, 1)
    sizes = {(item.name, item.component): item.size for item in found.problem.rows.nuisances.items}
    for scale in (("dynamic_pressure_scale", "scale"), ("inertia", "scale")):
        assert abs(errors[scale]) < 5.0 * sizes[scale]


@PLANTED
def test_the_baseline_beside_a_large_mechanism_is_the_vehicles(planted: str) -> None:
    """As `none` had it, C_malpha was twice the true one, and drifted by six times that."""
    leader = judged_cone(planted).leading.fit
    errors = np.sqrt(np.diag(leader.covariance))
    fitted = {
        c.term: (v, e)
        for c, v, e in zip(leader.columns, leader.values, errors, strict=True)
        if c not in leader.selected
    }
    check_vehicle(fitted)


def check_vehicle(fitted: Mapping[str, tuple[float, float]]) -> None:
    """Values and standard errors are those of the vehicle's own coefficients."""
    aerodynamics = load_config("research_cone").aerodynamics
    for name in ("C_malpha", "C_mq"):
        value, error = fitted[name]
        assert abs(value - getattr(aerodynamics, name)) < 4.0 * error
        assert error < 0.06 * abs(value)  # damping may change with the angle of attack


@pytest.mark.thorough
@PLANTED
def test_the_baseline_of_the_result_is_the_vehicles(planted: str) -> None:
    check_vehicle({term.name: (term.value, term.std_error) for term in compared(planted).baseline.terms})


@pytest.mark.thorough
@PLANTED
def test_what_none_is_drawn_with_is_the_static_moment(planted: str) -> None:
    """With errors as the leader has them: its own follow most of what the mechanism does."""
    (series,) = compared(planted).series
    drawn = (series.measured, series.fitted["none"], series.fitted[planted])
    measured, none, leader = (np.array(each)[:, 5:-5] for each in drawn)
    lacking = np.nanmean((measured - none) ** 2) / np.nanmean((leader - none) ** 2)
    assert lacking == pytest.approx(1.0, abs=0.2)
