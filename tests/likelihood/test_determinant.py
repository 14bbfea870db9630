"""What integrating the states out adds: against a Kalman filter, its gradient against differences."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.linalg import block_diag

from brv_hypo.likelihood.collocation import System, linearise_segment
from brv_hypo.likelihood.elimination import Eliminated
from brv_hypo.likelihood.filter_error import determinant, determinant_gradients, kalman_innovations
from brv_hypo.likelihood.gauss_newton import Iterate, Setup, sensitivities
from brv_hypo.likelihood.segment import Hold, Segment, build_grid, build_parameters

THETA = {"mu": 0.8, "gain": 1.3, "slope": 0.4}


def oscillator(x: Any, u: Any, theta: Any, t: Any) -> Any:
    return np.stack([x[1], theta["mu"] * (1 - x[0] ** 2) * x[1] - x[0] + theta["gain"] * x[1] * u[0]])


def bent(x: Any, u: Any, theta: Any, t: Any) -> Any:
    return np.stack([np.exp(theta["slope"] * x[0]), x[0] * x[1]])


def place(hold: Hold, method: Any) -> tuple[Setup, Iterate]:
    """Two segments with gaps, states anywhere near a motion."""
    rng = np.random.default_rng(0)
    segments = []
    for n in (15, 12):
        t = 0.3 * np.arange(n)
        y = rng.standard_normal((2, n))
        y[0, 3:6], y[:, 8] = np.nan, np.nan
        segments.append(Segment(t, np.sign(np.sin(2 * t))[None], y, np.ones(2), hold=hold))
    grids = tuple(build_grid(segment, s) for s, segment in enumerate(segments))
    parameters = build_parameters(THETA, {}, {})
    model = System(oscillator, bent, method=method)
    drive = np.array([0.0, 0.3])
    problem = Setup(model, grids, parameters, np.array([1.2, 0.7]), drive, np.full(3, np.inf))
    x = tuple(np.stack([np.sin(g.t[: g.n]), np.cos(g.t[: g.n])]) + 0.1 * rng.standard_normal((2, g.n)) for g in grids)
    return problem, Iterate(x, parameters.start, np.array([0.04, 0.09]))


@pytest.mark.parametrize("hold", ["zero", "linear"])
def test_it_is_that_of_the_outputs_covariance(hold: Hold) -> None:
    """C = R + H D^-1 Q D^-T H', by dense algebra, the initial state fixed; a Kalman filter finds the same."""
    problem, iterate = place(hold, "complex")
    expected, squares = 0.0, 0.0
    for grid, x in zip(problem.grids, iterate.x, strict=True):
        linear = linearise_segment(problem.model, grid, x, problem.parameters.as_mapping(iterate.theta), ())
        n = grid.n
        dynamics = np.eye(2 * n)
        for k, (before, after) in enumerate(linear.defect_by_state):
            rows = slice(2 * k + 2, 2 * k + 4)
            dynamics[rows, 2 * k : 2 * k + 2], dynamics[rows, rows] = before, after
        drive = np.concatenate([np.zeros((1, 2)), problem.process_noise**2 * grid.step[:, None]])
        observe, noise = block_diag(*linear.output_by_state), np.diag(np.tile(iterate.variance, n))
        follow = observe @ np.linalg.inv(dynamics)
        kept = np.flatnonzero(grid.measured.T)
        noise = noise[np.ix_(kept, kept)]
        whole = noise + (follow @ np.diag(drive.ravel()) @ follow.T)[np.ix_(kept, kept)]
        shift = np.concatenate([np.zeros((1, 2)), linear.defect]).ravel()
        residual = ((grid.y.T - linear.output).ravel() + follow @ shift)[kept]
        expected += 0.5 * (np.linalg.slogdet(whole)[1] - np.linalg.slogdet(noise)[1])
        squares += 0.5 * float(residual @ np.linalg.solve(whole, residual)) + 0.5 * np.linalg.slogdet(whole)[1]
    assert determinant(problem, iterate) == pytest.approx(expected, rel=1e-9)
    innovations, nllf = kalman_innovations(problem, iterate)
    assert nllf == pytest.approx(squares, rel=1e-9)
    for found, grid in zip(innovations, problem.grids, strict=True):
        np.testing.assert_array_equal(np.isfinite(found), grid.measured)


@pytest.mark.parametrize("hold", ["zero", "linear"])
@pytest.mark.parametrize("method", ["complex", "central"])
def test_its_gradient_is_that_of_its_differences(hold: Hold, method: str) -> None:
    problem, iterate = place(hold, method)
    segments = sensitivities(problem, iterate)
    here = [(problem.process_noise, iterate.variance)]
    found = determinant_gradients(problem, iterate, segments, here)[0]
    expected = [_slope(problem, iterate, segments, i) for i in range(3)]
    np.testing.assert_allclose(found, expected, rtol=2e-5, atol=1e-5 * np.abs(expected).max())


def _slope(problem: Setup, iterate: Iterate, segments: tuple[Eliminated, ...], i: int) -> float:
    """Central difference along one parameter, the states following."""
    h = 1e-4

    def at(step: float) -> float:
        change = np.zeros(3)
        change[i] = step
        x = [
            old + (segment.x @ np.append(0.0, change)).T * problem.size[:, None]
            for old, segment in zip(iterate.x, segments, strict=True)
        ]
        return determinant(problem, replace(iterate, theta=iterate.theta + change, x=tuple(x)))

    return (at(h) - at(-h)) / (2 * h)
