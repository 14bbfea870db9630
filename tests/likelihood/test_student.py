"""Noise with tails: against scipy's density, by recovery, and coverage beside outliers."""

from __future__ import annotations

import pickle
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy import stats

from brv_hypo.errors import UsageError
from brv_hypo.likelihood import FitResult, Segment, fit, student
from tests.studies.likelihood.problems import short_period
from tests.studies.likelihood.study import with_outliers

PROBLEM = short_period()
START = {name: 0.8 * value for name, value in PROBLEM.truth.items()}


def fitted(segment: Segment, noise: Any = "student", **options: Any) -> FitResult:
    return fit(PROBLEM.dynamics, PROBLEM.outputs, [segment], START, noise=noise, **options)


def test_the_likelihood_is_that_of_students_density() -> None:
    v = np.array([[0.3, -2.0, np.nan, 9.0], [1.0, 0.1, -0.4, np.nan]])
    square, freedom = np.array([0.5, 2.0]), np.array([3.0, 40.0])
    density = [stats.t(f, scale=np.sqrt(s)).logpdf(row) for row, s, f in zip(v, square, freedom, strict=True)]
    expected = -np.nansum(density) - 0.5 * 6 * np.log(2 * np.pi)
    assert student.negative_log_likelihood(v, square, freedom) == pytest.approx(expected)


def test_scale_and_freedom_are_the_most_likely() -> None:
    v = 0.2 * np.random.default_rng(0).standard_t(3.0, size=(1, 4000))
    square, freedom = student.fitted(v, np.array([1.0]), np.array([1e-12]), held=False)
    f, _, scale = stats.t.fit(v[0], floc=0.0)
    assert freedom[0] == pytest.approx(f, rel=1e-2)
    assert np.sqrt(square[0]) == pytest.approx(scale, rel=1e-3)


def test_gaussian_noise_is_next_to_gaussian() -> None:
    segment = PROBLEM.simulate(400, seed=1)
    result, plain = fitted(segment), fitted(segment, "diagonal")
    assert result.converged
    assert np.all(result.noise_freedom > 10.0)
    assert result.log_likelihood > plain.log_likelihood - 1.0
    for name, error in plain.std_error.items():
        assert abs(result.theta[name] - plain.theta[name]) < 0.5 * error
        assert result.std_error[name] == pytest.approx(error, rel=0.1)


def test_gross_outliers_do_no_harm() -> None:
    clean = PROBLEM.simulate(400, seed=2)
    rng = np.random.default_rng(2)
    y = clean.y + np.where(rng.random(clean.y.shape) < 0.03, 5.0 * np.abs(clean.y).max(axis=1, keepdims=True), 0.0)
    result = fitted(replace(clean, y=y))
    assert result.converged
    off = y != clean.y
    assert result.weights[0][off].max() < 0.01 < np.quantile(result.weights[0][~off], 0.01)
    for name, value in PROBLEM.truth.items():
        assert abs(result.theta[name] - value) < 4.0 * result.std_error_coloured[name]
    assert "degrees of freedom" in result.report()
    assert pickle.loads(pickle.dumps(result)).theta == result.theta


def test_what_does_not_go_with_it_is_refused() -> None:
    segment = PROBLEM.simulate(100, seed=3)
    with pytest.raises(UsageError, match="Gaussian noise only"):
        fitted(segment, process_noise=[0.01, 0.01])
    with pytest.raises(UsageError, match="expected one of"):
        fitted(segment, "cauchy")
    with pytest.raises(UsageError, match="of Gaussian noise"):
        fitted(segment).theta_without([np.zeros(100, dtype=np.bool_)])


@pytest.mark.thorough
def test_standard_errors_cover_beside_outliers() -> None:
    """One sample in 20 with ten times the noise: the noise is no t, and the intervals hold all the same."""
    scores, plain = [], []
    for seed in range(100):
        segment = with_outliers(PROBLEM, 300, seed)
        result = fitted(segment)
        assert result.converged, result.message
        scores.append([(result.theta[k] - v) / result.std_error[k] for k, v in PROBLEM.truth.items()])
        if seed < 20:
            gauss = fitted(segment, "diagonal")
            plain.append([(gauss.theta[k] - v) / result.std_error[k] for k, v in PROBLEM.truth.items()])
    assert 0.93 < np.mean(np.abs(scores) <= 1.96) < 0.97
    assert np.sqrt(np.mean(np.square(scores))) < 1.1
    assert np.sqrt(np.mean(np.square(plain))) > 2.0


def test_an_output_that_was_never_measured_costs_its_own_parameters_only() -> None:
    segment = PROBLEM.simulate(300, seed=4)
    both = np.concatenate([segment.y, np.full((1, 300), np.nan)])

    def outputs(x: Any, u: Any, theta: Any, t: Any) -> Any:
        return np.concatenate([PROBLEM.outputs(x, u, theta, t), x[:1] + theta["unseen"]])

    found = fit(
        PROBLEM.dynamics, outputs, [replace(segment, y=both)], START | {"unseen": 0.0}, noise="student"
    )
    assert found.converged, found.message
    assert np.isnan(found.std_error["unseen"])
    expected = fitted(segment)
    for name in PROBLEM.truth:
        assert found.std_error[name] == pytest.approx(expected.std_error[name], rel=1e-3)


@pytest.mark.parametrize(
    ("constant", "other"),
    [("_FIRST_FREEDOM", 2.0), ("_FIRST_FREEDOM", 30.0), ("_ROUNDS", 50), ("_SAME", 1e-6), ("_LEAST_SLOPE", 1e-2)],
)
def test_what_is_found_hangs_on_no_constant_of_the_search(
    constant: str, other: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem = short_period()
    record = with_outliers(problem, 300, 5)
    usual = fit(problem.dynamics, problem.outputs, [record], problem.truth, noise="student")
    monkeypatch.setattr(student, constant, other)
    result = fit(problem.dynamics, problem.outputs, [record], problem.truth, noise="student")
    assert usual.converged
    assert result.converged
    assert usual.noise_freedom == pytest.approx(result.noise_freedom, rel=2e-2)
    for name in usual.names:
        assert result.theta[name] == pytest.approx(usual.theta[name], abs=0.02 * usual.std_error[name])
        assert result.std_error[name] == pytest.approx(usual.std_error[name], rel=0.01)
