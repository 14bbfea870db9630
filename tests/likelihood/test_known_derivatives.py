"""Derivatives that come with a function: the same fit as without."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from brv_hypo.likelihood import FitResult, PartialJacobian, Segment, TimeVaryingParameter, fit

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


def test_the_fit_is_the_same_where_some_derivatives_are_known() -> None:
    known = PartialJacobian(pendulum, lambda x, u, theta, t: {"damping": np.stack([np.zeros_like(t), -x[1]])})
    same(fit(known, angle, [SEGMENT], START), fitted())


def test_time_varying_parameters_follow() -> None:
    """Known by a slope, or by one difference where the function is affine in it."""

    def outputs(x: Any, u: Any, theta: Any, t: Any) -> Any:
        return x[:1] + theta["drift"]

    drift = TimeVaryingParameter("drift", ("b0", "b1"), lambda t: np.stack([np.ones_like(t), t]))
    segment = Segment(SEGMENT.t, SEGMENT.u, SEGMENT.y, SEGMENT.x0, hold="linear", time_varying=(drift,))
    start = {"w2": 7.0, "damping": 0.0, "b0": 0.0, "b1": 0.0}
    plain = fit(pendulum, outputs, [segment], start)
    for known in (
        PartialJacobian(outputs, lambda x, u, theta, t: {"drift": np.ones_like(x[:1])}),
        PartialJacobian(outputs, lambda x, u, theta, t: {}, frozenset({"drift"})),
    ):
        same(fit(pendulum, known, [segment], start), plain)
