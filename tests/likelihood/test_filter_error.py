"""Process noise: against the exact density of a linear Gaussian system, and by recovery."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from brv_hypo.arrays import FloatArray
from brv_hypo.likelihood import FitResult, Segment, fit
from tests.studies.likelihood.problems import ModelProblem, short_period

pytestmark = pytest.mark.thorough

DRIVE = np.array([0.005, 0.03])
BUMPY = replace(short_period(), process_noise=DRIVE)


def test_the_likelihood_is_that_of_the_outputs_with_the_states_integrated_out() -> None:
    """x' = a x + w, y = x + v: the outputs are jointly Gaussian, so their density is known in closed form."""
    n, h, a, q, r = 40, 0.1, -0.7, 0.3, 0.04
    rng = np.random.default_rng(0)
    y = rng.standard_normal(n).cumsum() * 0.1

    def dynamics(x: Any, u: Any, theta: Any, t: Any) -> Any:
        return theta["a"] * x

    t = np.linspace(0.0, (n - 1) * h, n)
    segment = Segment(t, np.zeros((0, n)), y[None], np.zeros(1))
    result = fit(
        dynamics, lambda x, u, theta, t: x, [segment], {"a": a, "idle": 0.0}, [np.sqrt(q)],
        {"idle": (0.0, 0.0)}, priors={"a": (a, 1e-9)}, noise=np.array([r]),
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


SHORT_RECORD = BUMPY.simulate(400, seed=3)
POOR_START = {name: 0.8 * value for name, value in BUMPY.truth.items()}


def estimated(segment: Segment, times: float, **options: Any) -> FitResult:
    return fit(
        BUMPY.dynamics, BUMPY.outputs, [segment], POOR_START, process_noise=times * DRIVE,
        estimate_process_noise=True, **options,
    )  # fmt: skip


@cache
def near() -> FitResult:
    """The estimate from a first guess of the process noise twice as large."""
    return estimated(SHORT_RECORD, 2.0)


def test_measurement_and_process_noise_are_separated_with_their_errors() -> None:
    result = near()
    assert result.converged, result.message
    assert result.iterations <= 15
    assert np.all(np.abs(result.process_noise - DRIVE) < 3.5 * result.process_noise_std_error)
    noise = np.sqrt(result.noise_variance)
    assert np.all(np.abs(noise - BUMPY.noise) < 3.5 * result.noise_std_error)
    assert np.all(result.process_noise_std_error < 0.3 * DRIVE)
    assert np.all(np.nanmean(result.innovations[0] ** 2, axis=1) > result.noise_variance)
    assert result.remarks == ()


@pytest.mark.thorough
@pytest.mark.parametrize("times", [pytest.param(1e3, marks=pytest.mark.slow), 1e-3])
def test_a_poor_first_guess_of_the_process_noise_does_no_harm(times: float) -> None:
    far = estimated(SHORT_RECORD, times)
    assert far.converged, far.message
    assert far.iterations <= 15
    assert far.nllf == pytest.approx(near().nllf, abs=1e-3)
    np.testing.assert_allclose(far.process_noise, near().process_noise, rtol=1e-3)


@pytest.mark.thorough
def test_the_noise_is_at_the_stationary_point_of_its_restricted_likelihood() -> None:
    """The score against differences of NLLF + 1/2 log det I(theta), theta and the states following."""
    gappy = SHORT_RECORD.y.copy()
    gappy[0, 50:70] = np.nan
    segment = replace(SHORT_RECORD, y=gappy, x0=BUMPY.x0, x0_std=0.0)
    result = estimated(segment, 1.0)
    assert result.converged, result.message

    def restricted(process: FloatArray, noise: FloatArray) -> float:
        found = fit(
            BUMPY.dynamics, BUMPY.outputs, [segment], result.theta, process, noise=noise, near_start=True
        )  # fmt: skip
        assert found.converged, found.message
        return found.nllf - 0.5 * float(np.linalg.slogdet(found.covariance)[1])

    best = restricted(result.process_noise, result.noise_variance)
    changes = [(np.array([1.1, 1.0]), np.ones(2)), (np.array([1.0, 1.1]), np.ones(2))]
    changes += [(np.ones(2), np.array(d)) for d in ([1.1, 1.0], [1.0, 1.1])]
    for process, factor in changes:
        up = restricted(result.process_noise * process, result.noise_variance * factor)
        down = restricted(result.process_noise / process, result.noise_variance / factor)
        curvature = up + down - 2.0 * best
        assert curvature > 0.0
        assert abs(up - down) < 0.2 * curvature


def test_a_measurement_noise_that_goes_to_zero_is_a_stated_outcome() -> None:
    problem = replace(BUMPY, noise=np.array([0.002, 1e-9]))
    result = estimated(problem.simulate(400, seed=3), 2.0)
    assert result.converged, result.message
    assert result.iterations <= 15
    assert len(result.remarks) == 1
    assert "measurement noise of outputs [1] went to 0" in result.remarks[0]
    np.testing.assert_array_equal(np.isnan(result.noise_std_error), [False, True])
    assert all(np.isfinite(error) for error in result.std_error.values())


@pytest.mark.thorough
def test_a_process_noise_that_goes_to_zero_is_a_stated_outcome() -> None:
    """Its variance is estimated about 0: below, it is said to have gone to 0; above, it is not significant."""
    problem = replace(BUMPY, process_noise=np.array([0.0, 0.03]))
    stated = 0
    for seed in (3, 4, 5):
        result = estimated(problem.simulate(400, seed=seed), 2.0)
        assert result.converged, result.message
        assert result.iterations <= 15
        assert all(np.isfinite(error) for error in result.std_error.values())
        gone = bool(np.isnan(result.process_noise_std_error[0]))
        assert np.isfinite(result.process_noise_std_error[1])
        assert [remark.startswith("the process noise of states [0] went to 0") for remark in result.remarks] == (
            [True] if gone else []
        )
        assert gone or result.process_noise[0] ** 2 < 3.0 * (
            2.0 * result.process_noise[0] * result.process_noise_std_error[0]
        )
        stated += gone
    assert stated > 0


@pytest.mark.thorough
def test_only_what_is_undetermined_loses_its_error() -> None:
    def outputs(x: Any, u: Any, theta: Any, t: Any) -> Any:
        return np.stack([x[0] + theta["alpha_bias"] + theta["alpha_trim"], x[1] + theta["q_bias"]])

    twice = fit(
        BUMPY.dynamics, outputs, [SHORT_RECORD], POOR_START | {"alpha_trim": 0.0}, DRIVE, estimate_process_noise=True
    )  # fmt: skip
    assert twice.converged, twice.message
    lost = {name for name, error in twice.std_error.items() if np.isnan(error)}
    assert lost == {"alpha_bias", "alpha_trim"}
    for name in set(BUMPY.truth) - lost:
        assert twice.std_error[name] == pytest.approx(near().std_error[name], rel=1e-3)


@pytest.mark.parametrize("drive", [(0.0, 0.0), (0.05, 0.05)])
def test_with_an_unobservable_state_there_are_no_errors(drive: tuple[float, float]) -> None:
    def dynamics(x: Any, u: Any, theta: Any, t: Any) -> Any:
        return np.stack([theta["a"] * x[0] + u[0], theta["b"] * x[1]])

    t: FloatArray = np.arange(150) / 20
    y: FloatArray = np.exp(-0.5 * t) + 0.01 * np.random.default_rng(0).standard_normal(150)
    segment = Segment(t, np.zeros((1, 150)), y[None], np.ones(2))
    both = fit(dynamics, lambda x, u, theta, t: x[:1], [segment], {"a": -0.3, "b": -0.3}, drive)
    assert both.status == "undetermined"
    assert np.all(np.isnan([*both.std_error.values()]))


def test_no_process_noise_is_output_error() -> None:
    quiet = short_period()
    segment = quiet.simulate(300, seed=0)
    known = quiet.noise**2
    plain, zero, nearly = (
        fit(quiet.dynamics, quiet.outputs, [segment], dict(quiet.truth), drive, noise=known)
        for drive in (None, [0.0, 0.0], [1e-7, 1e-7])
    )
    assert zero.theta == plain.theta
    assert nearly.nllf == pytest.approx(plain.nllf, abs=1e-2)
    for name in quiet.truth:
        assert nearly.theta[name] == pytest.approx(plain.theta[name], abs=1e-2 * plain.std_error[name])
        assert nearly.std_error[name] == pytest.approx(plain.std_error[name], rel=1e-3)


def test_measurement_noise_makes_up_for_what_the_fit_took_out() -> None:
    """Beside next to no process noise, 8 parameters and 2 initial states take 10 of 600 degrees of freedom."""
    quiet = short_period()
    segment = quiet.simulate(300, seed=0)
    plain, nearly = (
        fit(quiet.dynamics, quiet.outputs, [segment], dict(quiet.truth), drive) for drive in (None, [1e-7, 1e-7])
    )
    ratio = nearly.noise_variance / plain.noise_variance
    assert 300.0 * np.sum(1.0 - 1.0 / ratio) == pytest.approx(10.0, abs=0.2)
    for name in quiet.truth:
        assert nearly.std_error[name] == pytest.approx(plain.std_error[name], rel=0.02)


@pytest.mark.parametrize("seed", [2, 12])
def test_nonlinear_motion_in_noise_converges(seed: int) -> None:
    """Of steps this short the merit does not show whether they help: the determinant goes with the states too."""

    def oscillator(x: Any, u: Any, theta: Any, t: Any) -> Any:
        return np.stack([x[1], theta["mu"] * (1 - x[0] ** 2) * x[1] - theta["k"] * x[0]])

    truth = {"mu": 1.0, "k": 1.0}
    problem = ModelProblem(
        oscillator, lambda x, u, theta, t: x[:1], truth, lambda t: np.zeros((0, t.size)), np.array([1.0, 0.0]),
        np.array([0.1]), 10.0, process_noise=np.array([0.0, 0.2]), guess=np.array([1.0, 0.0]),
    )  # fmt: skip
    result = fit(
        oscillator, problem.outputs, [problem.simulate(300, seed)], {"mu": 0.5, "k": 0.7}, [0.0, 0.5],
        estimate_process_noise=True,
    )  # fmt: skip
    assert result.converged, result.message
    assert result.iterations <= 10
    assert all(abs(result.theta[k] - v) < 4 * result.std_error[k] for k, v in truth.items())


@pytest.mark.thorough
def test_errors_include_those_of_the_process_noise() -> None:
    """With one variance unknown: its error times what the parameters move as it does, by fits with it fixed."""

    def spring(x: Any, u: Any, theta: Any, t: Any) -> Any:
        return np.stack([x[1], theta["a"] * x[0] + theta["b"] * x[1] + u[0]])

    sigma, drive, truth = np.array([0.02, 0.05]), np.array([0.0, 0.1]), {"a": -4.0, "b": -1.0}
    problem = ModelProblem(
        spring, lambda x, u, theta, t: x, truth, lambda t: 0.3 * np.sin(2.1 * t)[None], np.array([0.1, 0.0]), sigma,
        25.0, process_noise=drive,
    )  # fmt: skip
    segment = problem.simulate(150, seed=2)

    def fitted(size: FloatArray, estimate: bool = False) -> FitResult:
        return fit(
            spring, problem.outputs, [segment], truth, size, noise=sigma**2, tolerance=1e-7,
            estimate_process_noise=estimate,
        )  # fmt: skip

    found = fitted(drive, estimate=True)
    assert found.converged
    alone, up, down = (fitted(found.process_noise * factor) for factor in (1.0, 1.02, 1 / 1.02))
    relative = found.process_noise_std_error[1] / found.process_noise[1]
    slope = (up.theta["b"] - down.theta["b"]) / (2 * np.log(1.02))
    added = np.sqrt(found.std_error["b"] ** 2 - alone.std_error["b"] ** 2)
    assert added > 0.2 * alone.std_error["b"]
    assert added == pytest.approx(abs(slope) * relative, rel=0.1)
