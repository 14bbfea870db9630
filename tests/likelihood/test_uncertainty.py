"""Coloured residuals, near-null directions and whiteness against what is known of them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import kstest

from brv_hypo.likelihood.statistics import (
    Whitened,
    coloured_covariance,
    covariance_from_information,
    identifiability,
    whiteness,
)
from tests.studies.likelihood.problems import markov_noise


@pytest.mark.parametrize("correlation", [0.0, 0.5, 0.8])
def test_the_correction_of_a_mean_is_the_known_inflation(correlation: float) -> None:
    """The variance of the mean of first-order Markov noise is (1 + r) / (1 - r) times that of white noise."""
    n = 20_000
    noise = markov_noise(np.random.default_rng(0), (20, n), correlation)
    segments = [Whitened(np.zeros(1, dtype=int), row[:, None], np.ones((n, 1, 1))) for row in noise]
    white = np.array([[1.0 / (20 * n)]])
    got = coloured_covariance(white, np.zeros(1), segments)[0, 0] / white[0, 0]
    assert got == pytest.approx((1 + correlation) / (1 - correlation), rel=0.08)


def test_covariance_and_near_null_directions() -> None:
    rng = np.random.default_rng(1)
    rows = rng.standard_normal((50, 3)) * np.array([1.0, 1e-4, 1e5])
    rows[:, 2] = 1e9 * rows[:, 1] + 1e-3 * rng.standard_normal(50)
    triangle = np.linalg.qr(rows, mode="r")
    free = np.full(3, np.inf)
    found = identifiability(triangle, free, ("a", "b", "c"))
    assert set(found.near_null[0].weights) == {"b", "c"}
    assert found.condition > 1e5
    assert "b" in str(found)
    well = np.linalg.qr(rows[:, :2], mode="r")
    got = covariance_from_information(well, free[:2], np.array([0, 1]))
    np.testing.assert_allclose(got, np.linalg.inv(rows[:, :2].T @ rows[:, :2]), rtol=1e-9)
    fixed = covariance_from_information(well, free[:2], np.array([0]))
    assert fixed[0, 0] == pytest.approx(1.0 / (rows[:, 0] @ rows[:, 0]))
    assert np.isnan(fixed[1]).all()


def test_p_values_of_white_noise_are_uniform_and_colour_is_found() -> None:
    rng = np.random.default_rng(2)
    p_values = [whiteness([rng.standard_normal((1, 400))], lags=20)[0].p_value for _ in range(300)]
    assert kstest(p_values, "uniform").pvalue > 1e-3
    coloured = whiteness([markov_noise(rng, (1, 400), 0.6)], lags=20)[0]
    assert not coloured.white
    assert coloured.largest_lag == 1
