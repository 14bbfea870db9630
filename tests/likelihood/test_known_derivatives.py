"""A function that is affine in parameters: one difference gives the same fit as two."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from brv_hypo.likelihood import Differenced, FitResult, Segment, TimeVaryingParameter, fit

TRUTH = {"w2": 9.0, "damping": 0.3, "bias": 0.1}
START = {"w2": 7.0, "damping": 0.0, "bias": 0.0}


def pendulum(x: Any, u: Any, theta: Any, t: Any) -> Any:
    return np.stack([x[1], -theta["w2"] * np.sin(x[0]) - theta["damping"] * x[1] + u[0]])


def angle(x: Any, u: Any, theta: Any, t: Any) -> Any:
    return x[:1] + theta["bias"]


def record(n: int = 200) -> Segment:
    t = np.arange(n) / 25
    u = np.sin(1.7 * t)
    x = np.array([0.8, 0.0])
    states = [x]
    for k in range(n - 1):
        for s in range(10):
            force = u[k] + (u[k + 1] - u[k]) * s / 10
            x = x + 0.004 * np.array([x[1], -9.0 * np.sin(x[0]) - 0.3 * x[1] + force])
        states.append(x)
    y = np.array(states).T[:1] + 0.1 + 0.01 * np.random.default_rng(0).standard_normal((1, n))
    return Segment(t, u[None], y, np.zeros(2), hold="linear")


SEGMENT = record()


def fitted(**options: Any) -> FitResult:
    return fit(pendulum, angle, [SEGMENT], START, **options)


def same(found: FitResult, expected: FitResult) -> None:
    assert found.converged
    for name, error in expected.std_error.items():
        assert found.theta[name] == pytest.approx(expected.theta[name], abs=1e-4 * error)
        assert found.std_error[name] == pytest.approx(error, rel=1e-4)


def test_the_fit_is_the_same_where_a_function_is_known_to_be_affine() -> None:
    same(fit(Differenced(pendulum, frozenset({"damping"})), angle, [SEGMENT], START), fitted())


def test_time_varying_parameters_follow() -> None:
    def outputs(x: Any, u: Any, theta: Any, t: Any) -> Any:
        return x[:1] + theta["drift"]

    drift = TimeVaryingParameter("drift", ("b0", "b1"), lambda t: np.stack([np.ones_like(t), t]))
    segment = Segment(SEGMENT.t, SEGMENT.u, SEGMENT.y, SEGMENT.x0, hold="linear", time_varying=(drift,))
    start = {"w2": 7.0, "damping": 0.0, "b0": 0.0, "b1": 0.0}
    plain = fit(pendulum, outputs, [segment], start)
    known = Differenced(outputs, frozenset({"drift"}))
    same(fit(pendulum, known, [segment], start), plain)
