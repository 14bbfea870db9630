"""The walk's least squares against the same problem written out densely."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from brv_hypo.motion.smoother import LinearMeasurement, walk_equations

START_VARIANCE = 4.0


def _problem(seed: int, n: int, k: int) -> tuple[list[LinearMeasurement], np.ndarray]:
    rng = np.random.default_rng(seed)
    noise = lambda *shape: rng.standard_normal(shape) + 1j * rng.standard_normal(shape)  # noqa: E731
    measurements = []
    for _ in range(2):
        sigma = rng.uniform(0.2, 2.0, n)
        sigma[rng.random(n) < 0.2] = np.inf
        measurements.append(LinearMeasurement(noise(n), noise(n, 2), noise(n, k).__getitem__, sigma))
    return measurements, np.append(START_VARIANCE, rng.uniform(0.05, 1.0, n - 1))


def _dense(
    measurements: list[LinearMeasurement], steps: np.ndarray, information: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Solution (walk real, walk imaginary, globals) and covariance of all unknowns at once."""
    n, k = measurements[0].columns(slice(None)).shape
    rows, right = [], []
    for measurement in measurements:
        valid = np.isfinite(measurement.sigma)
        first, second = (np.diag(part)[valid] for part in measurement.gain.T)
        a = measurement.columns(slice(None))[valid]
        parts = np.hstack([first.real, second.real, a.real]), np.hstack([first.imag, second.imag, a.imag])
        rows += [part / measurement.sigma[valid, None] for part in parts]
        right += [
            measurement.residual[valid].real / measurement.sigma[valid],
            measurement.residual[valid].imag / measurement.sigma[valid],
        ]
    difference = np.diff(np.eye(n), axis=0, prepend=0.0) / np.sqrt(steps)[:, None]
    zero = np.zeros_like(difference)
    rows += [np.hstack([difference, zero, np.zeros((n, k))]), np.hstack([zero, difference, np.zeros((n, k))])]
    rows.append(np.hstack([np.zeros((k, 2 * n)), np.diag(np.sqrt(information))]))
    right += [np.zeros(2 * n), np.zeros(k)]
    matrix, target = np.vstack(rows), np.concatenate(right)
    covariance = np.linalg.inv(matrix.T @ matrix)
    return covariance @ matrix.T @ target, covariance


@given(seed=st.integers(0, 2**31), n=st.integers(3, 25), k=st.integers(1, 4))
def test_walk_equals_dense_least_squares(seed: int, n: int, k: int) -> None:
    measurements, steps = _problem(seed, n, k)
    information = np.full(k, 0.3)
    solution = walk_equations(measurements, steps).solve(np.zeros(k), np.diag(information))
    expected, covariance = _dense(measurements, steps, information)
    assert solution.walk.real == pytest.approx(expected[:n], rel=1e-7, abs=1e-9)
    assert solution.walk.imag == pytest.approx(expected[n : 2 * n], rel=1e-7, abs=1e-9)
    assert solution.theta == pytest.approx(expected[2 * n :], rel=1e-7, abs=1e-9)
    assert solution.covariance == pytest.approx(covariance[2 * n :, 2 * n :], rel=1e-6, abs=1e-9)


@given(seed=st.integers(0, 2**31), n=st.integers(3, 25))
def test_variance_of_the_walk_counts_the_globals(seed: int, n: int) -> None:
    measurements, steps = _problem(seed, n, 2)
    equations = walk_equations(measurements, steps)
    solution = equations.solve(np.zeros(2), np.diag(np.full(2, 0.3)))
    _, covariance = _dense(measurements, steps, np.full(2, 0.3))
    response = equations.sensitivity()
    response = np.stack([response.real, response.imag], axis=1)
    found = equations.walk_covariance + np.einsum("nik,kl,njl->nij", response, solution.covariance, response)
    parts = np.arange(n)[:, None, None] + n * np.arange(2)
    assert found == pytest.approx(covariance[parts, np.swapaxes(parts, 1, 2)], rel=1e-6, abs=1e-9)


@given(seed=st.integers(0, 2**31), n=st.integers(3, 2000), step=st.sampled_from([0.0, 1e-20, 1e-12]))
def test_a_walk_that_hardly_steps_stays_where_it_starts(seed: int, n: int, step: float) -> None:
    rng = np.random.default_rng(seed)
    gain, observed = rng.standard_normal((2, n, 2)) @ [1.0, 1j]
    column, turned = np.zeros((n, 1), dtype=complex), np.stack([gain, 1j * gain], axis=1)
    measurement = LinearMeasurement(observed, turned, column.__getitem__, np.full(n, 1e3))
    with np.errstate(divide="raise", invalid="raise"):
        found = walk_equations([measurement], np.full(n, step))
    level = 1e3 / np.sqrt(np.sum(np.abs(gain) ** 2))  # standard deviation of one that the measurement alone gives
    assert np.max(np.abs(found.answer[:, 0])) < 1e-2 * level
    for part in (0, 1):
        assert np.all(
            (found.walk_covariance[:, part, part] > 0.0) & (found.walk_covariance[:, part, part] < 1e-3 * level**2)
        )


def test_a_prior_counts_as_one_more_observation() -> None:
    n, size, prior = 400, 0.5, 0.1
    rng = np.random.default_rng(3)
    column = np.ones((n, 1), dtype=complex)
    observed = size * column[:, 0] + 0.1 * (rng.standard_normal(n) + 1j * rng.standard_normal(n))
    measurement = LinearMeasurement(observed, np.zeros((n, 2), dtype=complex), column.__getitem__, np.full(n, 0.1))
    solution = walk_equations([measurement], np.ones(n)).solve(np.array([prior]), np.array([[n / 0.1**2]]))
    assert solution.theta[0] == pytest.approx(0.5 * (np.mean(observed.real) + prior), rel=1e-9)
    assert np.sqrt(solution.covariance[0, 0]) == pytest.approx(0.1 / np.sqrt(2 * n), rel=1e-6)
    residual = np.sum(np.abs(observed - solution.theta[0]) ** 2) / 0.1**2
    assert solution.cost == pytest.approx(residual + n * (solution.theta[0] - prior) ** 2 / 0.1**2, rel=1e-9)
