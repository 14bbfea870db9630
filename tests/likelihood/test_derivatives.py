"""Derivatives of the user's functions against exact ones."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from brv_hypo.likelihood.derivatives import (
    Delayed,
    Method,
    Points,
    choose_method,
    jacobian,
    parameter_scales,
)

RNG = np.random.default_rng(3)
THETA = {"a": 0.7, "b": 0.0, "tau": 0.2}
POINTS = Points(
    x=RNG.standard_normal((2, 9)) * np.array([[1.0], [1e3]]),
    u=RNG.standard_normal((1, 9)),
    t=np.arange(9.0),
    delayed={"tau": Delayed(RNG.standard_normal((2, 9)), RNG.standard_normal((1, 9)))},
    rates={"tau": Delayed(RNG.standard_normal((2, 9)), RNG.standard_normal((1, 9)))},
)


def smooth(x: Any, u: Any, theta: Any, t: Any, delayed: Any) -> Any:
    past = delayed["tau"]
    return np.stack(
        [theta["a"] * np.sin(x[0]) + theta["b"] * x[1], x[0] * u[0] + np.exp(past.x[0]) * past.u[0]]
    )


@pytest.mark.parametrize(("method", "tolerance"), [("complex", 1e-14), ("central", 1e-8)])
def test_both_methods_give_the_exact_derivatives(method: Method, tolerance: float) -> None:
    """Central differences stay within 1e-8 of the size of each block, the complex step at rounding."""
    names = ("a", "b", "tau")
    found = jacobian(smooth, POINTS, THETA, names, method, dict.fromkeys(names, 1.0))
    x, u, past, rate = POINTS.x, POINTS.u[0], POINTS.delayed["tau"], POINTS.rates["tau"]
    zero = np.zeros(9)
    e = np.exp(past.x[0])
    exact = {
        "by_state": [[THETA["a"] * np.cos(x[0]), zero], [u, zero]],
        "by_parameter": [[np.sin(x[0]), x[1], zero], [zero, zero, -e * (past.u[0] * rate.x[0] + rate.u[0])]],
        "by_delayed": [[zero, zero], [e * past.u[0], zero]],
    }
    got = {
        "by_state": found.by_state,
        "by_parameter": found.by_parameter,
        "by_delayed": found.by_delayed["tau"],
    }
    for name, rows in exact.items():
        expected = np.array(rows).transpose(2, 0, 1)
        np.testing.assert_allclose(got[name], expected, atol=tolerance * np.abs(expected).max(), err_msg=name)


@pytest.mark.parametrize(
    ("function", "expected"),
    [
        (lambda x, u, theta, t: theta["a"] * np.sin(x), "complex"),
        (lambda x, u, theta, t: theta["a"] * np.abs(x), "central"),
        (lambda x, u, theta, t: theta["a"] * np.arctan2(x[:1], x[1:]), "central"),
        (lambda x, u, theta, t: theta["a"] * np.hypot(x[:1], x[1:]), "central"),
        (lambda x, u, theta, t: theta["a"] * np.asarray(x, dtype=float), "central"),
        (lambda x, u, theta, t: theta["a"] * x.real, "central"),
    ],
)
def test_functions_that_defeat_the_complex_step_are_found_out(function: Any, expected: str) -> None:
    points = Points(POINTS.x[:, :4], POINTS.u[:, :4], POINTS.t[:4])
    assert choose_method((function,), points, {"a": 2.0}, ("a",), {"a": 2.0}) == expected


@pytest.mark.parametrize("method", ["complex", "central"])
def test_a_function_may_return_its_own_argument_or_a_view_of_it(method: Method) -> None:
    points = Points(POINTS.x, POINTS.u, POINTS.t)
    found = jacobian(lambda x, u, theta, t: x[::-1], points, {}, (), method, {})
    np.testing.assert_allclose(
        found.by_state, np.broadcast_to([[0.0, 1.0], [1.0, 0.0]], (9, 2, 2)), atol=1e-9
    )


def test_a_parameter_at_zero_gets_a_step_in_the_functions_own_scale() -> None:
    def stiff(x: Any, u: Any, theta: Any, t: Any) -> Any:
        return x + 1e6 * theta["tiny"] * x**2

    points = Points(np.ones((1, 4)), np.zeros((0, 4)), np.arange(4.0))
    scale = parameter_scales((stiff,), points, {"tiny": 0.0}, ("tiny",))
    assert scale["tiny"] == pytest.approx(1e-6, rel=0.01)
    found = jacobian(stiff, points, {"tiny": 0.0}, ("tiny",), "central", scale)
    np.testing.assert_allclose(found.by_parameter, 1e6, rtol=1e-8)
