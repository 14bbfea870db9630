"""Eq. 3.10 with erratum E8, Eq. 3.11, and gaps."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import norm

from brv_hypo.likelihood.statistics import (
    estimate_variance,
    least_variance,
    negative_log_likelihood,
    noise_from_differences,
    whitening,
)

RNG = np.random.default_rng(0)
VARIANCE = np.array([2.0, 1.0, 0.5])
RESIDUAL = np.sqrt(VARIANCE)[:, None] * RNG.standard_normal((3, 400))
RESIDUAL[RNG.random(RESIDUAL.shape) < 0.25] = np.nan


def test_nllf_is_the_gaussian_log_density_of_what_was_measured_without_its_constant() -> None:
    log_density = np.nansum(norm(scale=np.sqrt(VARIANCE)[:, None]).logpdf(RESIDUAL))
    constant = -0.5 * np.count_nonzero(np.isfinite(RESIDUAL)) * np.log(2 * np.pi)
    assert -negative_log_likelihood(RESIDUAL, VARIANCE) + constant == pytest.approx(log_density, rel=1e-12)


def test_whitening_squares_to_the_inverse_variance_of_what_was_measured() -> None:
    weights = whitening(VARIANCE, np.isfinite(RESIDUAL))
    np.testing.assert_allclose(weights**2, np.where(np.isfinite(RESIDUAL), 1.0 / VARIANCE[:, None], 0.0).T)


def test_eq_3_11_is_the_maximum_of_the_likelihood_and_keeps_its_floor() -> None:
    found = estimate_variance(RESIDUAL, np.zeros(3))
    np.testing.assert_allclose(found, np.nanmean(RESIDUAL**2, axis=1), rtol=1e-12)
    best = negative_log_likelihood(RESIDUAL, found)
    assert all(negative_log_likelihood(RESIDUAL, found * factor) > best for factor in (0.99, 1.01))
    np.testing.assert_array_equal(estimate_variance(0.0 * RESIDUAL, np.full(3, 1e-9)), 1e-9)


def test_third_differences_have_the_noise_and_not_the_motion() -> None:
    t = np.arange(2000) / 25
    y = np.stack([np.sin(2 * t), 5 * np.cos(t)]) + np.array([[0.01], [0.3]]) * RNG.standard_normal((2, 2000))
    y[0, 100:120] = np.nan
    np.testing.assert_allclose(np.sqrt(noise_from_differences(y)), [0.01, 0.3], rtol=0.1)


def test_a_perfect_record_keeps_a_positive_variance() -> None:
    assert np.all(noise_from_differences(np.zeros((2, 50))) > 0)
    assert np.all(least_variance(np.zeros((2, 50))) > 0)
