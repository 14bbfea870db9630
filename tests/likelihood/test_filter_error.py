"""Process noise: against the exact density of a linear Gaussian system, and by recovery."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from brv_hypo.likelihood import Segment, fit
from brv_hypo.likelihood.problems import short_period

DRIVE = np.array([0.005, 0.03])
BUMPY = replace(short_period(), process_noise=DRIVE)


def test_the_likelihood_is_that_of_the_outputs_with_the_states_integrated_out() -> None:
    """x' = a x + w, y = x + v: the outputs are jointly Gaussian, so their density is known in closed form."""
    n, h, a, q, r = 40, 0.1, -0.7, 0.3, 0.04
    rng = np.random.default_rng(0)
    y = rng.standard_normal(n).cumsum() * 0.1

    def dynamics(x: Any, u: Any, theta: Any, t: Any) -> Any:
        return theta["a"] * x

    segment = Segment(np.arange(n) * h, np.zeros((0, n)), y[None], np.zeros(1))
    result = fit(
        dynamics, lambda x, u, theta, t: x, [segment], {"a": a, "idle": 0.0}, [np.sqrt(q)], fixed=("idle",),
        priors={"a": (a, 1e-9)}, noise_covariance=np.array([[r]]),
    )  # fmt: skip
    assert result.converged, result.message
    # Hermite-Simpson step of a linear system: after x_k+1 = before x_k + w, with w of variance q h
    z = a * h
    before, after = 1 + z / 2 + z**2 / 12, 1 - z / 2 + z**2 / 12
    transition, driven = before / after, q * h / after**2
    mean = result.states[0][0, 0] * transition ** np.arange(n)
    covariance = np.zeros((n, n))
    for i in range(n):
        for j in range(n):
            common = min(i, j)
            covariance[i, j] = sum(transition ** (i + j - 2 * k) for k in range(1, common + 1)) * driven
    density = multivariate_normal(mean, covariance + r * np.eye(n)).logpdf(y) + 0.5 * n * np.log(2 * np.pi)
    assert result.log_likelihood == pytest.approx(density, rel=1e-9)
    assert result.history[-1].cost == pytest.approx(-density, rel=1e-6)


@pytest.mark.slow
def test_parameters_are_recovered_with_honest_errors_where_output_error_is_overconfident() -> None:
    scores, overconfident = [], []
    start = {name: 0.7 * value for name, value in BUMPY.truth.items()}
    for seed in range(6):
        segment = BUMPY.simulate(400, seed)
        result = fit(BUMPY.dynamics, BUMPY.outputs, [segment], start, process_noise=DRIVE, tolerance=1e-3)
        assert result.converged, result.message
        assert all(test.p_value > 1e-4 for test in result.whiteness)
        plain = fit(BUMPY.dynamics, BUMPY.outputs, [segment], start)
        assert result.nllf < plain.nllf - 100
        assert not any(test.white for test in plain.whiteness)
        scores += [(result.theta[k] - v) / result.std_error[k] for k, v in BUMPY.truth.items()]
        overconfident += [(plain.theta[k] - v) / plain.std_error[k] for k, v in BUMPY.truth.items()]
    assert 0.7 < np.sqrt(np.mean(np.square(scores))) < 1.35
    assert np.sqrt(np.mean(np.square(overconfident))) > 1.6


@pytest.mark.slow
def test_measurement_and_process_noise_are_told_apart() -> None:
    segment = BUMPY.simulate(1500, seed=1)
    result = fit(
        BUMPY.dynamics, BUMPY.outputs, [segment], dict(BUMPY.truth), process_noise=3 * DRIVE,
        estimate_process_noise=True, tolerance=1e-3,
    )  # fmt: skip
    assert result.converged, result.message
    np.testing.assert_allclose(result.process_noise, DRIVE, rtol=0.25)
    np.testing.assert_allclose(np.sqrt(np.diag(result.noise_covariance)), BUMPY.noise, rtol=0.1)
    b = result.innovation_covariance
    assert np.all(np.diag(b) > np.diag(result.noise_covariance))


def test_no_process_noise_is_output_error() -> None:
    quiet = short_period()
    segment = quiet.simulate(300, seed=0)
    plain = fit(quiet.dynamics, quiet.outputs, [segment], dict(quiet.truth))
    zero = fit(quiet.dynamics, quiet.outputs, [segment], dict(quiet.truth), process_noise=[0.0, 0.0])
    nearly = fit(quiet.dynamics, quiet.outputs, [segment], dict(quiet.truth), process_noise=[1e-7, 1e-7])
    assert zero.theta == plain.theta
    assert nearly.nllf == pytest.approx(plain.nllf, abs=1e-2)
    for name in quiet.truth:
        assert nearly.theta[name] == pytest.approx(plain.theta[name], abs=1e-2 * plain.std_error[name])
