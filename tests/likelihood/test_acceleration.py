"""Slow steps of models that are not quite right: extrapolated to the same optimum in fewer of them."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from brv_hypo.arrays import FloatArray
from brv_hypo.likelihood import fit, gauss_newton
from brv_hypo.likelihood.gauss_newton import Extrapolation, Iterate, NewtonStep, Setup
from tests.studies.likelihood.problems import short_period, stalled_aircraft

GOAL = np.array([1.0, -2.0, 0.5])
_TURN = np.linalg.qr(np.random.default_rng(0).standard_normal((3, 3)))[0]
SHRINKS = _TURN @ np.diag([0.9, 0.5, -0.3]) @ _TURN.T
"""What a step leaves of the distance to the goal."""


def problem(reach: float = np.inf, process_noise: float = 0.0) -> Setup:
    parameters = SimpleNamespace(prior_std=np.full(3, np.inf))
    known = {"reach": np.full(3, reach), "process_noise": np.full(1, process_noise), "parameters": parameters}
    return cast(Setup, SimpleNamespace(**known))


def step_from(theta: FloatArray) -> NewtonStep:
    move = (SHRINKS - np.eye(3)) @ (theta - GOAL)
    return NewtonStep(move, (move[None],), np.eye(3), float(np.linalg.norm(move)), 0.0, 0.0, 0.0, 0.0)


def distances(extrapolation: Extrapolation, steps: int, start: FloatArray) -> list[float]:
    found = []
    at = Iterate((start[None],), start, np.eye(1))
    for _ in range(steps):
        step = extrapolation.improved(at, step_from(at.theta))
        at = replace(at, theta=at.theta + step.theta, x=(at.x[0] + step.x[0],))
        np.testing.assert_allclose(at.x[0][0], at.theta, atol=1e-9)  # the states follow theta
        found.append(float(np.linalg.norm(at.theta - GOAL)))
    return found


def test_as_many_steps_as_unknowns_find_the_goal_of_linear_steps() -> None:
    assert distances(Extrapolation(problem()), 6, GOAL + 0.3)[-1] < 1e-8
    alone = np.linalg.matrix_power(SHRINKS, 6) @ np.full(3, 0.3)
    assert np.linalg.norm(alone) > 0.1


@pytest.mark.parametrize("held", [problem(reach=1e-3), problem(process_noise=0.1)])
def test_steps_stay_as_they_are_where_they_may_not_be_extrapolated(held: Setup) -> None:
    left = distances(Extrapolation(held), 5, GOAL + 0.3)
    assert left[-1] == pytest.approx(np.linalg.norm(np.linalg.matrix_power(SHRINKS, 5) @ np.full(3, 0.3)))


def test_far_steps_are_not_extrapolated() -> None:
    extrapolation = Extrapolation(problem())
    far = step_from(GOAL + 100.0)
    at = Iterate((np.zeros((1, 3)),), GOAL + 100.0, np.eye(1))
    assert all(extrapolation.improved(at, far) is far for _ in range(4))


@pytest.mark.slow
def test_the_optimum_of_a_very_wrong_model_is_the_same_in_fewer_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    flown, model = stalled_aircraft(6.0)
    segment = flown.simulate(480, seed=1)
    quick = fit(model.dynamics, model.outputs, [segment], model.truth)
    monkeypatch.setattr(gauss_newton, "_NEAR", 0.0)
    plain = fit(model.dynamics, model.outputs, [segment], model.truth, max_iterations=100)
    assert quick.converged, quick.message
    assert plain.converged, plain.message
    assert quick.iterations < 0.8 * plain.iterations
    assert quick.log_likelihood == pytest.approx(plain.log_likelihood, abs=1e-4)
    for name, error in plain.std_error.items():
        assert quick.theta[name] == pytest.approx(plain.theta[name], abs=1e-2 * error)


def test_a_right_model_needs_no_more_steps_than_before(monkeypatch: pytest.MonkeyPatch) -> None:
    aircraft = short_period()
    segment = aircraft.simulate(200, seed=0)
    quick = fit(aircraft.dynamics, aircraft.outputs, [segment], aircraft.truth)
    monkeypatch.setattr(gauss_newton, "_NEAR", 0.0)
    plain = fit(aircraft.dynamics, aircraft.outputs, [segment], aircraft.truth)
    assert quick.iterations <= plain.iterations
    assert quick.log_likelihood == pytest.approx(plain.log_likelihood, abs=1e-6)
