"""Eq. 3.10 with erratum E8, Eq. 3.11, and gaps."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from brv_hypo.likelihood.statistics import (
    estimate_covariance,
    least_variance,
    negative_log_likelihood,
    noise_from_differences,
    whitening,
)

RNG = np.random.default_rng(0)
COVARIANCE = np.array([[2.0, 0.6, 0.0], [0.6, 1.0, -0.3], [0.0, -0.3, 0.5]])
RESIDUAL = RNG.multivariate_normal(np.zeros(3), COVARIANCE, 400).T
GAPS = RNG.random(RESIDUAL.shape) > 0.25


def test_nllf_is_the_gaussian_log_density_without_its_constant() -> None:
    everywhere = np.ones_like(RESIDUAL, dtype=bool)
    log_density = multivariate_normal(cov=COVARIANCE).logpdf(RESIDUAL.T).sum()
    constant = -0.5 * RESIDUAL.size * np.log(2 * np.pi)
    got = -negative_log_likelihood(RESIDUAL, everywhere, COVARIANCE) + constant
    assert got == pytest.approx(log_density, rel=1e-12)


def test_with_gaps_each_sample_counts_by_what_was_measured() -> None:
    expected = 0.0
    for v, seen in zip(RESIDUAL.T, GAPS.T, strict=True):
        if seen.any():
            b = COVARIANCE[np.ix_(seen, seen)]
            expected += 0.5 * (v[seen] @ np.linalg.inv(b) @ v[seen] + np.log(np.linalg.det(b)))
    assert negative_log_likelihood(RESIDUAL, GAPS, COVARIANCE) == pytest.approx(expected, rel=1e-12)


def test_whitening_squares_to_the_inverse_covariance_of_what_was_measured() -> None:
    weights = whitening(COVARIANCE, GAPS)
    for w, seen in zip(weights, GAPS.T, strict=True):
        expected = np.zeros((3, 3))
        expected[np.ix_(seen, seen)] = np.linalg.inv(COVARIANCE[np.ix_(seen, seen)])
        np.testing.assert_allclose(w.T @ w, expected, atol=1e-12)


def test_eq_3_11_full_and_diagonal() -> None:
    everywhere = np.ones_like(RESIDUAL, dtype=bool)
    mean = RESIDUAL @ RESIDUAL.T / RESIDUAL.shape[1]
    floor = np.zeros(3)
    full = estimate_covariance(RESIDUAL, everywhere, "full", np.eye(3), floor)
    np.testing.assert_allclose(full, mean, rtol=1e-12)
    diagonal = estimate_covariance(RESIDUAL, everywhere, "diagonal", np.eye(3), floor)
    np.testing.assert_allclose(diagonal, np.diag(np.diag(mean)), rtol=1e-12)


def test_the_full_covariance_with_gaps_climbs_to_the_maximum_of_the_likelihood() -> None:
    estimate = np.eye(3)
    for _ in range(60):
        estimate = estimate_covariance(RESIDUAL, GAPS, "full", estimate, np.zeros(3))
    best = negative_log_likelihood(RESIDUAL, GAPS, estimate)
    for _ in range(20):
        change = 1e-2 * RNG.standard_normal((3, 3))
        assert negative_log_likelihood(RESIDUAL, GAPS, estimate + change + change.T) > best


def test_third_differences_see_the_noise_and_not_the_motion() -> None:
    t = np.arange(2000) / 25
    y = np.stack([np.sin(2 * t), 5 * np.cos(t)]) + np.array([[0.01], [0.3]]) * RNG.standard_normal((2, 2000))
    y[0, 100:120] = np.nan
    np.testing.assert_allclose(np.sqrt(np.diag(noise_from_differences(y))), [0.01, 0.3], rtol=0.1)


def test_a_perfect_record_keeps_a_positive_variance() -> None:
    assert np.all(np.diag(noise_from_differences(np.zeros((2, 50)))) > 0)
    assert np.all(least_variance(np.zeros((2, 50))) > 0)


@pytest.mark.parametrize("outputs", [3, 70])
def test_samples_of_one_pattern_of_gaps_are_found_together(outputs: int) -> None:
    rng = np.random.default_rng(5)
    kinds = rng.random((outputs, 4)) > 0.4
    which = rng.integers(0, 4, 50)
    weights = whitening(np.eye(outputs), kinds[:, which])
    for weight, kind in zip(weights, which, strict=True):
        np.testing.assert_array_equal(weight, np.diag(kinds[:, kind].astype(float)))
