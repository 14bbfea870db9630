"""Functions of Mach number and what is drawn, against the planted."""

from __future__ import annotations

import json

import numpy as np
import pytest

from brv_hypo.comparison import CompareConfig, Comparison, compare
from brv_hypo.comparison.result import beyond_tolerances
from brv_hypo.inference.derivatives import EXTRAPOLATED_SHARE
from brv_hypo.testing import plant
from tests.chains import compared_nominal

PLANTED_SLOPE = -0.0883
"""C_N' by alpha of the research cone, 1/rad."""


@pytest.fixture(scope="module")
def at_half_the_rate() -> Comparison:
    return compared_nominal()


def test_the_slope_is_the_planted_one_within_its_error(at_half_the_rate) -> None:
    """At no angle of attack and at that flown."""
    (slope,) = at_half_the_rate.functions["C_malpha"]
    for value, error in ((slope.at_zero, slope.at_zero_std_error), (slope.at_flown, slope.at_flown_std_error)):
        off = np.abs(np.array(value) - PLANTED_SLOPE)
        assert np.all(off < 4.0 * np.array(error))
        assert np.max(error) < 0.1 * abs(PLANTED_SLOPE)


def test_the_moment_is_what_its_slope_makes_of_the_angle_flown(at_half_the_rate) -> None:
    """The research cone's is linear."""
    (moment,), (slope,) = (at_half_the_rate.functions[name] for name in ("C_m0", "C_malpha"))
    made = np.array(moment.at_zero) + np.array(slope.at_zero) * np.array(moment.alpha_rad)
    apart = np.abs(np.array(moment.at_flown) - made)
    assert np.all(apart < 4.0 * np.array(moment.at_flown_std_error))


def test_json_says_where_the_value_at_zero_is_extrapolated(at_half_the_rate) -> None:
    """As the terminal's parentheses do; `alpha_ends_rad` of the places decide."""
    written = json.loads(at_half_the_rate.to_json())["functions"]["C_malpha"][0]
    low, high = np.array(written["alpha_ends_rad"]).T
    assert written["extrapolated"] == (low**2 > EXTRAPOLATED_SHARE * high**2).tolist()
    assert any(written["extrapolated"])
    assert Comparison.from_json(at_half_the_rate.to_json()) == at_half_the_rate


def test_the_mach_number_at_the_end_is_that_of_the_record(at_half_the_rate) -> None:
    """Functions end with the middle of their last place."""
    drawn, (known,) = at_half_the_rate.series[0], at_half_the_rate.functions["C_m0"]
    assert known.time_s[-1] < drawn.time_s[-1]
    assert at_half_the_rate.mach_at(drawn.time_s[-1]) == pytest.approx(drawn.mach[-1], abs=1e-9)


def test_the_residual_that_is_drawn_is_that_of_the_whole_fit(at_half_the_rate) -> None:
    """Errors of record and vehicle with it: noise, where nothing was planted."""
    drawn = at_half_the_rate.series[0]
    for plane in (0, 1):
        residual = np.subtract(drawn.measured[plane], drawn.fitted["none"][plane]) / drawn.sigma
        assert 0.8 < np.sqrt(np.nanmean(residual**2)) < 1.1


def test_errors_are_the_least_probable_first_and_within_tolerance(at_half_the_rate) -> None:
    """Where nothing was planted all are within their tolerances, and no better known than these."""
    errors = at_half_the_rate.record_errors
    sizes = [each.sigmas for each in errors]
    assert sizes == sorted(sizes, reverse=True)
    assert sizes[0] < 3.0
    assert all(each.sigmas >= abs(each.tolerances) * (1.0 - 1e-12) for each in errors)
    assert all(0.0 <= each.std_error <= each.tolerance for each in errors)
    assert {"trim C_m0", "gyro_bias p"} <= {each.name for each in errors}
    assert beyond_tolerances(errors) == []


@pytest.mark.thorough
def test_a_trim_of_the_vehicle_is_in_the_line_that_is_drawn_and_in_the_answer() -> None:
    """It is an error of the vehicle; without it the line would lie off by all of it."""
    trimmed = plant("trim", {"C_m0": 5e-4, "C_n0": 0.0}).flight
    comparison = compare([trimmed], CompareConfig(mechanisms=("damping",), maximum_likelihood="none", knot_count=5))
    drawn = comparison.series[0]
    residual = np.nanmean(np.square(np.subtract(drawn.measured, drawn.fitted["none"]) / drawn.sigma))
    assert residual < 1.2
    (trim,) = (each for each in comparison.record_errors if each.name == "trim C_m0")
    assert trim.value == pytest.approx(5e-4, rel=0.05)
    assert "beyond their tolerances (--instruments): trim C_m0 is 0.000" in comparison.conclusion()


def test_the_shares_of_the_residual_add_up_and_the_json_has_no_histories(at_half_the_rate) -> None:
    found = at_half_the_rate.verdict.explained
    assert found.share + found.processes + found.noise == pytest.approx(1.0)
    content = at_half_the_rate.model_dump(by_alias=True)
    assert "series" not in content
    assert {"functions", "record_errors", "best_by_size", "collinear"} <= set(content)


def test_every_hypothesis_predicts_what_was_held_out_over_the_baseline(at_half_the_rate) -> None:
    gains = {row.mechanism: row.held_out_gain for row in at_half_the_rate.ranking}
    assert gains["none"] == 0.0
    assert all(np.isfinite(list(gains.values())))
