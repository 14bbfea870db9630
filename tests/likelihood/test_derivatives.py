"""Derivatives of the user's functions against exact ones."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from brv_hypo.errors import UsageError
from brv_hypo.likelihood.collocation import (
    Delayed,
    Differenced,
    Method,
    Points,
    choose_method,
    jacobian,
    parameter_scales,
)
from brv_hypo.likelihood.segment import SampledParameter, TimeVaryingParameter, sampled

RNG = np.random.default_rng(3)
THETA = {"a": 0.7, "b": 0.0, "tau": 0.2}
POINTS = Points(
    x=RNG.standard_normal((2, 9)) * np.array([[1.0], [1e3]]),
    u=RNG.standard_normal((1, 9)),
    t=np.arange(9.0),
    delayed={"tau": Delayed(RNG.standard_normal((2, 9)), RNG.standard_normal((1, 9)))},
    rates={"tau": Delayed(RNG.standard_normal((2, 9)), RNG.standard_normal((1, 9)))},
)


def affine(function: Any, *names: str) -> Differenced:
    return Differenced(function, frozenset(names))


def smooth(x: Any, u: Any, theta: Any, t: Any, delayed: Any) -> Any:
    past = delayed["tau"]
    return np.stack([theta["a"] * np.sin(x[0]) + theta["b"] * x[1], x[0] * u[0] + np.exp(past.x[0]) * past.u[0]])


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
    got = {"by_state": found.by_state, "by_parameter": found.by_parameter, "by_delayed": found.by_delayed["tau"]}
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
    np.testing.assert_allclose(found.by_state, np.broadcast_to([[0.0, 1.0], [1.0, 0.0]], (9, 2, 2)), atol=1e-9)


@pytest.mark.parametrize("start", [0.0, 1e-14])
def test_a_parameter_next_to_zero_gets_a_step_in_the_functions_own_scale(start: float) -> None:
    def stiff(x: Any, u: Any, theta: Any, t: Any) -> Any:
        return x + 1e6 * theta["tiny"] * x**2

    points = Points(np.ones((1, 4)), np.zeros((0, 4)), np.arange(4.0))
    scale = parameter_scales((stiff,), points, {"tiny": start}, ("tiny",))
    assert scale["tiny"] == pytest.approx(1e-6, rel=0.01)
    found = jacobian(stiff, points, {"tiny": start}, ("tiny",), "central", scale)
    np.testing.assert_allclose(found.by_parameter, 1e6, rtol=1e-8)


@pytest.mark.parametrize("method", ["complex", "central"])
def test_weights_of_a_sampled_parameter_have_the_derivatives_of_parameters(method: Method) -> None:
    rng = np.random.default_rng(3)
    t = np.linspace(0.0, 2.0, 40)
    shapes = np.stack([np.ones_like(t), t, np.sin(3.0 * t)])
    x, u = rng.standard_normal((2, t.size)), np.zeros((0, t.size))
    theta = {"a": 0.4, "b": -1.2, "c": 0.0, "k": 2.0}

    def plain(x: Any, u: Any, theta: Any, t: Any) -> Any:
        drift = theta["a"] * shapes[0] + theta["b"] * shapes[1] + theta["c"] * shapes[2]
        return np.stack([theta["k"] * x[0] * drift**2, x[1] + drift])

    def with_sampled(x: Any, u: Any, theta: Any, t: Any) -> Any:
        return np.stack([theta["k"] * x[0] * theta["drift"] ** 2, x[1] + theta["drift"]])

    sampled = SampledParameter("drift", ("a", "b", "c"), shapes)
    names = tuple(theta)
    expected = jacobian(plain, Points(x, u, t), theta, names, method, {})
    found = jacobian(with_sampled, Points(x, u, t, time_varying=(sampled,)), theta, names, method, {})
    np.testing.assert_allclose(found.value, expected.value, rtol=1e-14)
    np.testing.assert_allclose(found.by_state, expected.by_state, rtol=1e-8, atol=1e-10)
    np.testing.assert_allclose(found.by_parameter, expected.by_parameter, rtol=1e-7, atol=1e-8)


def test_a_weight_of_two_sampled_parameters_acts_through_both() -> None:
    t = np.linspace(0.0, 2.0, 40)
    slow, fast = np.ones((1, t.size)), np.stack([np.sin(3.0 * t), t])
    x, theta = np.random.default_rng(5).standard_normal((1, t.size)), {"a": 0.4, "b": -1.2}
    time_varying = (SampledParameter("slow", ("a",), slow), SampledParameter("fast", ("a", "b"), fast))

    def function(x: Any, u: Any, theta: Any, t: Any) -> Any:
        return x * theta["slow"] + theta["fast"]

    points = Points(x, np.zeros((0, t.size)), t, time_varying=time_varying)
    found = jacobian(affine(function, "slow", "fast"), points, theta, ("a", "b"), "central", {})
    np.testing.assert_allclose(found.by_parameter[:, 0, 0], x[0] + fast[0], rtol=1e-12)
    np.testing.assert_allclose(found.by_parameter[:, 0, 1], fast[1], rtol=1e-12)


def test_shapes_of_the_wrong_size_are_refused() -> None:
    with pytest.raises(UsageError, match="one row for each weight"):
        sampled((TimeVaryingParameter("drift", ("a", "b"), lambda t: np.ones((1, t.size))),), np.arange(5.0), 0)


def test_a_small_parameter_of_a_sensitive_function_keeps_its_own_magnitude() -> None:
    points = Points(np.ones((1, 4)), np.zeros((0, 4)), np.arange(4.0))
    scale = parameter_scales(
        (lambda x, u, theta, t: x * (1.0 + 1e9 * theta["fine"]),), points, {"fine": 2e-9}, ("fine",)
    )
    assert scale["fine"] == 2e-9


def test_parameters_next_to_zero_do_not_set_each_others_scale() -> None:
    """All start at 1e-14, so that the function is as small; beside a state of size 1 such steps would be lost."""
    points = Points(np.zeros((1, 4)), np.ones((1, 4)), np.arange(4.0))
    start = {"slope": 1e-14, "drive": 1e-14, "bias": 1e-14}

    def function(x: Any, u: Any, theta: Any, t: Any) -> Any:
        return theta["slope"] * x + theta["drive"] * u + theta["bias"]

    scale = parameter_scales((function,), points, start, tuple(start))
    later = Points(np.ones((1, 4)), points.u, points.t)
    found = jacobian(function, later, start | {"slope": 1.0}, tuple(start), "central", scale)
    np.testing.assert_allclose(found.by_parameter, 1.0, rtol=1e-8)


def test_one_difference_is_exact_where_the_function_is_affine() -> None:
    rng = np.random.default_rng(4)
    x, t = np.abs(rng.standard_normal((1, 30))) + 0.1, np.arange(30.0)
    calls: list[dict[str, float]] = []

    def function(x: Any, u: Any, theta: Any, t: Any) -> Any:
        calls.append(dict(theta))
        return theta["k"] * np.abs(x) + theta["k"] * theta["c"] + theta["c"] * t

    points, theta = Points(x, np.zeros((0, 30)), t), {"k": 0.3, "c": 0.0}
    both = jacobian(function, points, theta, ("k", "c"), "central", {"c": 1e-3})
    plain = len(calls)
    once = jacobian(affine(function, "k", "c"), points, theta, ("k", "c"), "central", {"c": 1e-3})
    assert len(calls) - plain < plain
    np.testing.assert_allclose(once.by_parameter[:, 0, 0], x[0] + theta["c"], rtol=1e-12)
    np.testing.assert_allclose(once.by_parameter[:, 0, 1], theta["k"] + t, rtol=1e-11)
    np.testing.assert_allclose(once.by_state, both.by_state, rtol=1e-12)
