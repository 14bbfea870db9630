"""Motion that is fast for its samples: the estimated effect of the mesh, refinement, and the status."""

from __future__ import annotations

from dataclasses import replace
from typing import Any
from unittest import mock

import numpy as np
import pytest

from brv_hypo.arrays import FloatArray
from brv_hypo.likelihood import FitResult, Segment, Status, fit, starts
from brv_hypo.likelihood.starts import finer
from tests.studies.likelihood.hard_study import TRUTH, followed, measured, motion, reaction, slow_reaction
from tests.studies.likelihood.problems import short_period

SIGMA = 0.01
INTERVAL = 0.05
TIMES = np.linspace(0.0, 149 * INTERVAL, 150)


def dynamics(x: Any, u: Any, theta: Any, t: Any) -> Any:
    return np.stack([x[1], -theta["stiffness"] * x[0] - theta["damping"] * x[1]])


def oscillator(frequency: float) -> tuple[Segment, dict[str, float]]:
    """An oscillator in closed form, rad/s, 20 samples a second, its angle measured."""
    truth = {"stiffness": frequency**2, "damping": 0.3}
    decay, turn = 0.15, np.sqrt(frequency**2 - 0.15**2)
    x: FloatArray = np.exp(-decay * TIMES) * (np.cos(turn * TIMES) + decay / turn * np.sin(turn * TIMES))
    y = x + SIGMA * np.random.default_rng(0).standard_normal(TIMES.size)
    return Segment(TIMES, np.zeros((0, TIMES.size)), y[None], np.array([1.0, 0.0])), truth


def run(frequency: float, steps: int | None = None, **options: Any) -> tuple[FitResult, dict[str, float]]:
    """The fit, on a mesh of so many steps between samples if they are given, and the truth."""
    segment, truth = oscillator(frequency)
    start = {name: 0.95 * value for name, value in truth.items()}
    if steps is None:
        return fit(dynamics, lambda x, u, theta, t: x[:1], [segment], start, **options), truth
    with mock.patch.object(starts, "MOST_STEPS", 1):
        found = fit(dynamics, lambda x, u, theta, t: x[:1], [finer(segment, 0, steps)], start, **options)
    return found, truth


@pytest.mark.parametrize("frequency", [8.0, 20.0])
def test_the_estimated_shift_is_what_a_fine_mesh_makes_of_the_estimate(frequency: float) -> None:
    known = np.array([SIGMA**2])
    coarse, _ = run(frequency, 1, noise=known)
    fine, _ = run(frequency, 8, noise=known)
    moved = max(abs(fine.theta[k] - coarse.theta[k]) / coarse.std_error[k] for k in coarse.names)
    assert coarse.mesh_shift == pytest.approx(moved, rel=0.4)
    assert fine.mesh_shift < 0.01 * coarse.mesh_shift


@pytest.mark.thorough
def test_process_noise_between_samples_is_no_error_of_the_mesh() -> None:
    problem = replace(short_period(), process_noise=np.array([0.005, 0.03]), hold="linear")
    segment = problem.simulate(1000, seed=1)

    def fitted(segment: Segment) -> FitResult:
        return fit(
            problem.dynamics, problem.outputs, [segment], problem.truth, problem.process_noise,
            noise=problem.noise**2,
        )  # fmt: skip

    coarse, fine = fitted(segment), fitted(finer(segment, 0, 2))
    moved = max(abs(fine.theta[k] - coarse.theta[k]) / coarse.std_error[k] for k in coarse.names)
    assert coarse.mesh_steps == 1
    assert moved < 2e-3
    assert coarse.mesh_shift < 2e-3


@pytest.mark.parametrize("frequency", [40.0, *(pytest.param(f, marks=pytest.mark.thorough) for f in (4.0, 20.0))])
def test_the_mesh_is_refined_until_the_estimate_is_right(frequency: float) -> None:
    result, truth = run(frequency)
    assert result.converged, result.message
    assert (result.mesh_steps == 1) == (frequency < 10.0)
    assert result.mesh_shift < 0.1
    finest, _ = run(frequency, 32)
    for name, value in truth.items():
        assert abs(result.theta[name] - value) < 4.0 * result.std_error[name]
        assert result.std_error[name] == pytest.approx(finest.std_error[name], rel=0.2)
    assert result.states[0].shape == (2, TIMES.size)
    assert result.innovations[0].shape == (1, TIMES.size)


def test_a_mesh_that_stays_coarse_is_a_status(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(starts, "MOST_STEPS", 1)
    result, _ = run(20.0)
    assert result.status == Status.COARSE
    assert not result.converged
    assert result.mesh_shift > 1.0
    assert "standard errors with 1 steps between samples" in result.message
    assert Status.COARSE.remedy in result.message


@pytest.mark.parametrize("hold", ["zero", "linear", "cubic"])
def test_a_finer_segment_has_the_inputs_of_the_coarse_one(hold: Any) -> None:
    t = np.linspace(0.0, 2.0, 21)
    u = np.stack([np.sin(2.0 * t), np.sign(np.sin(5.0 * t))])
    segment = Segment(t, u, np.cos(t)[None], np.zeros(1), hold=hold)
    fine = finer(segment, 0, 4)
    np.testing.assert_allclose(fine.u[:, ::4], u)
    np.testing.assert_array_equal(np.isfinite(fine.y[0]), np.arange(fine.t.size) % 4 == 0)
    assert fine.u_mid is not None
    if hold == "zero":
        np.testing.assert_array_equal(fine.u[:, 1:4], np.repeat(u[:, :1], 3, axis=1))
    else:
        inside = np.interp(fine.t, t, u[0]) if hold == "linear" else np.sin(2.0 * fine.t)
        np.testing.assert_allclose(fine.u[0], inside, atol=2e-4)


def robertson(times: FloatArray) -> Segment:
    segment = measured(times, motion(times), np.random.default_rng(0))
    return replace(segment, x0_std=np.inf)


def test_dynamics_far_too_stiff_for_the_samples_are_called_so() -> None:
    segment = robertson(np.append(0.0, np.geomspace(1e-5, 1e4, 80)))
    result = fit(reaction, lambda x, u, theta, t: x, [segment], TRUTH)
    assert result.status == Status.STIFF
    assert "not determined by its outputs" not in result.message
    assert Status.STIFF.remedy in result.message
    assert all(np.isnan(error) for error in result.std_error.values())


@pytest.mark.thorough
def test_what_that_status_advises_solves_them() -> None:
    """The fastest state follows at once: one state, and all three outputs."""
    segment = robertson(np.append(0.0, np.geomspace(0.4, 4e6, 60)))
    measured = np.where(np.asarray(segment.t) > 0.0, segment.y, np.nan)
    slow = replace(segment, y=measured, x0=np.array([1.0]), x0_std=0.0)
    result = fit(slow_reaction, followed, [slow], {name: 0.5 * value for name, value in TRUTH.items()})
    assert result.converged, result.message
    for name, value in TRUTH.items():
        assert abs(result.theta[name] - value) < 4.0 * result.std_error[name]
        assert result.std_error[name] < 0.03 * value


@pytest.mark.thorough
def test_a_search_that_fails_on_a_coarse_mesh_names_the_mesh(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(starts, "MOST_STEPS", 2)
    result = fit(reaction, lambda x, u, theta, t: x, [robertson(np.linspace(0.0, 40.0, 41))], TRUTH)
    assert not result.converged
    assert "The mesh is a likely cause" in result.message


def test_a_fit_on_a_finer_mesh_goes_on_from_one_that_was_near() -> None:
    result, _ = run(9.0)
    again, _ = run(9.0, result.mesh_steps)
    assert result.mesh_steps > 1
    assert result.iterations <= again.iterations
    assert [point.source for point in result.starting_points] == ["differences of the outputs", "an earlier fit"]
    for name in result.names:
        assert result.theta[name] == pytest.approx(again.theta[name], abs=1e-3 * again.std_error[name])
        assert result.std_error[name] == pytest.approx(again.std_error[name], rel=1e-3)
