"""Coefficients over time: by the regression and by the likelihood, against the planted ones."""

from __future__ import annotations

import numpy as np
import pytest

from brv_hypo.ranking import CompareConfig, Comparison, compare
from brv_hypo.ranking.result import CoefficientSeries
from brv_hypo.simulation.simulator import SimulatedFlight
from brv_hypo.testing import plant
from tests.chains import compared_nominal
from tests.flights import USUAL_RATE_HZ, nominal

PLANTED_SLOPE = -0.0883
"""C_N' by alpha of the research cone, 1/rad."""


@pytest.fixture(scope="module")
def flown() -> SimulatedFlight:
    return nominal(USUAL_RATE_HZ)


def compared(flown: SimulatedFlight, *, likelihood: bool) -> Comparison:
    chosen = "quick" if likelihood else "none"
    return compare([flown.flight], CompareConfig(mechanisms=("bodyfixed",), maximum_likelihood=chosen))


@pytest.fixture(scope="module")
def by_regression(flown: SimulatedFlight) -> Comparison:
    return compared(flown, likelihood=False)


@pytest.fixture(scope="module")
def by_likelihood(flown: SimulatedFlight) -> Comparison:
    return compared(flown, likelihood=True)


@pytest.fixture(scope="module")
def at_half_the_rate() -> Comparison:
    return compared_nominal()


def of_none(comparison: Comparison, name: str) -> CoefficientSeries:
    return next(s for s in comparison.coefficients if (s.mechanism, s.name) == ("none", name))


@pytest.mark.parametrize(
    ("method", "fixture"),
    [
        pytest.param("regression", "by_regression", marks=pytest.mark.thorough),
        pytest.param("maximum likelihood", "by_likelihood", marks=pytest.mark.thorough),
        pytest.param("maximum likelihood", "at_half_the_rate"),
    ],
)
def test_values_are_the_planted_ones_and_bands_hold_them(method, fixture, request) -> None:
    flown = nominal() if fixture == "at_half_the_rate" else request.getfixturevalue("flown")
    comparison = request.getfixturevalue(fixture)
    moment, slope = of_none(comparison, "C_N'"), of_none(comparison, "C_N' by alpha")
    assert moment.method == slope.method == method
    expected = np.interp(moment.time_s, flown.truth.time, flown.truth.C_N)
    assert np.all(np.abs(np.array(moment.value) - expected) < 1e-2 * np.std(expected))
    error = np.abs(np.array(slope.value) - PLANTED_SLOPE)
    assert np.all(error < 4.0 * np.array(slope.std_error))


@pytest.mark.thorough
@pytest.mark.parametrize("fixture", ["by_regression", "by_likelihood"])
def test_bands_are_as_wide_as_the_tolerances(flown, fixture, request) -> None:
    """The noise says the slope to a thousandth; dynamic pressure and inertia are known no better.

    Where alpha is largest the bend of the moment widens the band of its derivative by up to a seventh.
    """
    slope = of_none(request.getfixturevalue(fixture), "C_N' by alpha")
    known = flown.flight.instruments
    scale = abs(PLANTED_SLOPE) * np.hypot(known.dynamic_pressure_scale[0], known.inertia[0])
    ratio = np.array(slope.std_error) / scale
    assert np.all(np.abs(np.quantile(ratio, [0.0, 0.5]) - 1.0) < 0.1)
    assert ratio.max() < 1.15


@pytest.mark.thorough
def test_the_moment_is_the_fitted_one_but_for_errors_of_the_record(by_regression) -> None:
    """These are of the size of their tolerances on a flight with instruments that are good."""
    drawn = by_regression.series[0]
    for plane, name in enumerate(("C_N'", "C_Z'")):
        apart = np.subtract(of_none(by_regression, name).value, drawn.fitted["none"][plane])
        known = np.isfinite(apart)
        assert np.mean(known) > 0.95
        assert np.max(np.abs(apart[known])) < 0.01 * np.nanstd(drawn.measured[0])


def test_what_is_drawn_as_left_is_what_all_that_is_fitted_leaves(at_half_the_rate) -> None:
    """Errors of record and vehicle with it: noise, where nothing was planted."""
    drawn = at_half_the_rate.series[0]
    for plane in (0, 1):
        left = np.subtract(drawn.measured[plane], drawn.fitted["none"][plane]) / drawn.sigma
        assert 0.8 < np.sqrt(np.nanmean(left**2)) < 1.1


@pytest.mark.thorough
def test_a_trim_of_the_vehicle_is_in_the_line_that_is_drawn() -> None:
    """It is an error of the vehicle, within its tolerance; without it the line would lie off by all of it."""
    trimmed = plant("trim", {"C_m0": 2e-5, "C_n0": 0.0}).flight
    comparison = compare([trimmed], CompareConfig(mechanisms=("damping",), maximum_likelihood="none", knot_count=5))
    drawn = comparison.series[0]
    shape = [of_none(comparison, name).value for name in ("C_N'", "C_Z'")]
    without = np.nanmean(np.square(np.subtract(drawn.measured, shape) / drawn.sigma))
    left = np.nanmean(np.square(np.subtract(drawn.measured, drawn.fitted["none"]) / drawn.sigma))
    assert left < 1.2 < without


def test_every_hypothesis_has_histories_and_the_json_has_none(at_half_the_rate) -> None:
    names = {row.mechanism for row in at_half_the_rate.ranking}
    assert {series.mechanism for series in at_half_the_rate.coefficients} == names
    assert "C_Nalpha_force" in {series.name for series in at_half_the_rate.coefficients}
    assert "coefficients" not in at_half_the_rate.model_dump(by_alias=True)
