"""Each criterion against its definition, computed the long way on statsmodels or by refitting."""

from __future__ import annotations

import numpy as np
import pytest
from statsmodels.regression.linear_model import OLS

from brv_hypo.subset import Criteria, best_subsets


@pytest.fixture(scope="module")
def problem() -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(11)
    X = np.column_stack([np.ones(60), rng.standard_normal((60, 7))])
    return X, X[:, 1] - 2.0 * X[:, 4] + rng.standard_normal(60)


@pytest.mark.parametrize("size", range(1, 8))
def test_against_statsmodels(problem: tuple[np.ndarray, np.ndarray], size: int) -> None:
    X, y = problem
    subset = best_subsets(X, y, 7).best(size)
    fitted = OLS(y, X[:, list(subset.terms)]).fit()
    criteria = subset.criteria
    assert subset.rss == pytest.approx(fitted.ssr, rel=1e-12)
    np.testing.assert_allclose(subset.coefficients, fitted.params, rtol=1e-9)
    np.testing.assert_allclose(subset.std_errors, fitted.bse, rtol=1e-9)
    assert criteria.r2 == pytest.approx(fitted.rsquared, rel=1e-10)
    assert criteria.adjusted_r2 == pytest.approx(fitted.rsquared_adj, rel=1e-10)
    assert criteria.f_ratio == pytest.approx(fitted.fvalue, rel=1e-9)
    # statsmodels keeps the constant of the Gaussian log-likelihood, n (1 + log 2 pi).
    constant = 60 * (1.0 + np.log(2.0 * np.pi))
    assert criteria.aic == pytest.approx(fitted.aic - constant, rel=1e-9)
    assert criteria.bic == pytest.approx(fitted.bic - constant, rel=1e-9)
    left_out = fitted.resid / (1.0 - np.einsum("ij,ji->i", X[:, list(subset.terms)], fitted.model.pinv_wexog))
    assert criteria.press == pytest.approx(float(np.sum(left_out**2)), rel=1e-9)


@pytest.mark.parametrize("size", [1, 3, 6])
def test_closed_forms(problem: tuple[np.ndarray, np.ndarray], size: int) -> None:
    X, y = problem
    result = best_subsets(X, y, 7)
    c, n, p = result.best(size).criteria, 60, size + 1
    variance = result.best(7).rss / (60 - 8)
    assert c.adjusted_rss == pytest.approx(c.rss / (n - p))
    assert c.prediction_error == pytest.approx(c.rss * (n + p) / (n * (n - p)))
    assert c.cp == pytest.approx(c.rss / variance - n + 2 * p)
    assert c.expected_variance == pytest.approx(p * c.rss / (n * (n - p)))


def test_allens_error_is_the_mean_over_the_rows(problem: tuple[np.ndarray, np.ndarray]) -> None:
    """The variance of the prediction at each row, and the square of its bias against the complete model."""
    X, y = problem
    result = best_subsets(X, y, 7)
    subset, complete = result.best(2), result.best(7)
    own, variance = X[:, list(subset.terms)], complete.rss / (60 - 8)
    leverage, leverage_of_all = (np.einsum("ij,ji->i", Z, np.linalg.pinv(Z)) for Z in (own, X))
    bias = own @ subset.coefficients - X @ complete.coefficients
    error = variance * (1.0 - leverage_of_all) + bias**2 + 2.0 * variance * leverage
    assert subset.criteria.point_error == pytest.approx(float(error.mean()), rel=1e-9)


def test_weights_are_rows_scaled_by_their_roots(problem: tuple[np.ndarray, np.ndarray]) -> None:
    X, y = problem
    weights = np.random.default_rng(3).uniform(0.2, 3.0, size=60)
    root = np.sqrt(weights)
    weighted = best_subsets(X, y, 3, weights=weights).best(3)
    scaled = best_subsets(X * root[:, None], y * root, 3).best(3)
    assert weighted.columns == scaled.columns
    assert weighted.rss == pytest.approx(scaled.rss, rel=1e-12)


def test_without_degrees_of_freedom_criteria_are_nan() -> None:
    rng = np.random.default_rng(5)
    X = np.column_stack([np.ones(4), rng.standard_normal((4, 3))])
    criteria: Criteria = best_subsets(X, rng.standard_normal(4), 3).best(3).criteria
    assert np.isnan(criteria.press)
    assert np.isnan(criteria.cp)
