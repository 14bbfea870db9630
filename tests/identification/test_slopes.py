"""Derivatives that the equations of motion and measurement know of themselves, against differences."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from brv_hypo.identification import IdentificationConfig
from brv_hypo.identification.problem import Problem, build_problem
from brv_hypo.identification.study import flights, trial
from brv_hypo.likelihood.collocation import start_points
from brv_hypo.likelihood.derivatives import evaluate, jacobian
from brv_hypo.likelihood.given import PartlyGiven
from brv_hypo.likelihood.segment import build_grid

NEVER_FELT = ("error of q", "error of a_z", "change of r")
"""What no mechanism's columns change with."""


@cache
def problem(case: str) -> Problem:
    ((simulated, flight),) = flights(case, 1, seed=3)
    work = trial(simulated, flight)
    return build_problem(work.frame, work.columns, work.values, IdentificationConfig())


@pytest.mark.parametrize("case", ["bodyfixed", "damping", "sticking"])
@settings(max_examples=5, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_slopes_are_those_of_differences(case: str, seed: int) -> None:
    """At any states and values near the start; every course moves as its weights do."""
    made, rng = problem(case), np.random.default_rng(seed)
    scale = {name: max(abs(value), 1.0) for name, value in made.theta.items()}
    movers = {mover.name for mover in made.structure.movers}
    theta = {
        name: value + (0.0 if name in movers else 0.1 * scale[name] * rng.standard_normal())
        for name, value in made.theta.items()
    }
    points = start_points(build_grid(made.segments()[0], 0), theta, made.structure.delays)
    points.x[:] *= 1.0 + 0.1 * rng.standard_normal((4, 1))
    names = tuple(name for name in theta if name not in movers)
    known: set[str] = set()
    for function, slopes in (
        (made.model.dynamics, made.model.dynamics_slopes),
        (made.model.outputs, made.model.outputs_slopes),
    ):
        partly = PartlyGiven(function, slopes)
        expected = jacobian(function, points, theta, names, "central", scale)
        found = jacobian(partly, points, theta, names, "central", scale)
        np.testing.assert_array_equal(found.value, evaluate(function, points, theta))
        size = np.abs(expected.by_parameter).max(axis=(0, 2), keepdims=True)
        own = np.abs(expected.by_parameter).max(axis=0, keepdims=True)
        apart = np.abs(found.by_parameter - expected.by_parameter)
        assert np.all(apart <= 1e-6 * own + 1e-8 * size), [
            name for k, name in enumerate(names) if np.any((apart - 1e-6 * own - 1e-8 * size)[:, :, k] > 0.0)
        ]
        known |= set(partly.at(points.x, points.u, _with_courses(points, theta), points.t, points.delayed)[1])
    assert {f"{name} [flight 0]" for name in NEVER_FELT} <= known
    assert not known & set(made.model.moments.shape_parameters)


def _with_courses(points, theta):
    return {course.name: course.at(theta) for course in points.courses} | theta
