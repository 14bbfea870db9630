"""What the equations of motion and measurement are affine in: one difference by it is enough."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from brv_hypo.identification.identify import IdentificationProblem, build_problem
from brv_hypo.likelihood.collocation import Differenced, Function, Points, System, evaluate, jacobian, start_points
from brv_hypo.likelihood.segment import build_grid
from brv_hypo.linearisation.response import GRAVITY_ERRORS
from tests.studies.identification.study import flights, trial


@cache
def problem(case: str) -> IdentificationProblem:
    ((simulated, flight),) = flights(case, 1, seed=3)
    work = trial(simulated, flight)
    return build_problem(work.frame, work.columns, work.values)


def moved(case: str, seed: int) -> tuple[IdentificationProblem, Points, dict[str, float]]:
    """A problem, and states and values near its start; what moves columns stays."""
    made, rng = problem(case), np.random.default_rng(seed)
    nonlinear_parameters = {parameter.name for parameter in made.structure.nonlinear_parameters}
    theta = {
        name: value + (0.0 if name in nonlinear_parameters else 0.1 * max(abs(value), 1.0) * rng.standard_normal())
        for name, value in made.theta.items()
    }
    model = System(made.model.dynamics, made.model.outputs, made.structure.delays)
    points = start_points(model, build_grid(made.segments()[0], 0), theta)
    points.x[:] *= 1.0 + 0.1 * rng.standard_normal((4, 1))
    return made, points, theta


def agree(function: Function, other: Function, points: Points, theta: dict[str, float]) -> None:
    """By parameters and weights of time-varying ones."""
    scale = {name: max(abs(value), 1.0) for name, value in theta.items()}
    found = jacobian(function, points, theta, tuple(theta), "central", scale)
    expected = jacobian(other, points, theta, tuple(theta), "central", scale)
    np.testing.assert_array_equal(found.value, evaluate(other, points, theta))
    largest = np.abs(expected.by_parameter).max(axis=0, keepdims=True)
    allowed = 1e-6 * largest + 1e-8 * largest.max(axis=2, keepdims=True)
    apart = np.any(np.abs(found.by_parameter - expected.by_parameter) > allowed, axis=(0, 1))
    assert not [name for name, wrong in zip(theta, apart, strict=True) if wrong]


@pytest.mark.thorough
@settings(max_examples=5, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_one_difference_is_enough_by_what_the_equations_are_affine_in(seed: int) -> None:
    made, points, theta = moved("damping", seed)
    assert "error of q [flight 0]" in made.affine
    assert f"{GRAVITY_ERRORS[0]} [flight 0]" not in made.affine
    for function in (made.model.dynamics, made.model.outputs):
        agree(Differenced(function, made.affine), function, points, theta)


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("case", "use"),
    [
        ("bodyfixed", False),
        pytest.param("damping", True, marks=pytest.mark.thorough),
        *(pytest.param(*each, marks=pytest.mark.slow) for each in (("sticking", False), ("lag", True))),
    ],
)
def test_whether_columns_change_with_rates(case: str, use: bool) -> None:
    assert problem(case).model.moments.uses_rates is use
