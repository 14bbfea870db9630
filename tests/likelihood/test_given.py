"""Derivatives that the user gives: the same fit as without, and refused where they are wrong."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from brv_hypo.errors import UsageError
from brv_hypo.likelihood import FitResult, Segment, TimeVaryingParameter, fit
from brv_hypo.likelihood.derivatives import PartialJacobian

TRUTH = {"w2": 9.0, "damping": 0.3, "bias": 0.1}
START = {"w2": 7.0, "damping": 0.0, "bias": 0.0}


def pendulum(x: Any, u: Any, theta: Any, t: Any) -> Any:
    return np.stack([x[1], -theta["w2"] * np.sin(x[0]) - theta["damping"] * x[1] + u[0]])


def by_hand(x: Any, u: Any, theta: Any, t: Any) -> Any:
    none, one = np.zeros_like(t), np.ones_like(t)
    by_state = np.array([[none, one], [-theta["w2"] * np.cos(x[0]), -theta["damping"] * one]])
    return by_state, {"w2": np.stack([none, -np.sin(x[0])]), "damping": np.stack([none, -x[1]])}


def angle(x: Any, u: Any, theta: Any, t: Any) -> Any:
    return x[:1] + theta["bias"]


def of_angle(x: Any, u: Any, theta: Any, t: Any) -> Any:
    return np.stack([np.ones_like(x[:1]), np.zeros_like(x[:1])], axis=1), {"bias": np.ones_like(x[:1])}


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


@pytest.mark.parametrize("noise", [None, [0.0, 0.05]])
def test_the_fit_is_the_same(noise: Any) -> None:
    calls = 0

    def counted(x: Any, u: Any, theta: Any, t: Any) -> Any:
        nonlocal calls
        calls += 1
        return by_hand(x, u, theta, t)

    plain = fitted(process_noise=noise)
    same(fitted(process_noise=noise, dynamics_jacobian=counted, outputs_jacobian=of_angle), plain)
    assert calls > 5
    same(fitted(process_noise=noise, dynamics_jacobian=lambda *a: (by_hand(*a)[0], {})), plain)


def test_the_fit_is_the_same_where_some_derivatives_are_known() -> None:
    known = PartialJacobian(pendulum, lambda *arguments: {"damping": by_hand(*arguments)[1]["damping"]})
    same(fit(known, angle, [SEGMENT], START), fitted())


def test_without_errors_the_search_is_the_same() -> None:
    found, expected = fitted(errors=False, max_iterations=2), fitted(max_iterations=2)
    assert found.theta == expected.theta
    assert found.log_likelihood == expected.log_likelihood
    assert not np.isfinite(list(found.std_error.values())).any()


def test_ties_and_courses_follow() -> None:
    def outputs(x: Any, u: Any, theta: Any, t: Any) -> Any:
        return x[:1] + theta["drift"]

    def of_outputs(x: Any, u: Any, theta: Any, t: Any) -> Any:
        return of_angle(x, u, theta, t)[0], {"drift": np.ones_like(x[:1])}

    course = TimeVaryingParameter("drift", ("b0", "b1"), lambda t: np.stack([np.ones_like(t), t]))
    segment = Segment(SEGMENT.t, SEGMENT.u, SEGMENT.y, SEGMENT.x0, hold="linear", time_varying=(course,))
    start = {"length": 1.4, "damping": 0.0, "b0": 0.0, "b1": 0.0}
    options: dict[str, Any] = {"constraints": {"w2": lambda theta: 9.81 / theta["length"]}}

    def with_length(x: Any, u: Any, theta: Any, t: Any) -> Any:
        by_state, found = by_hand(x, u, theta, t)
        return by_state, found | {"length": np.zeros_like(x)}

    plain = fit(pendulum, outputs, [segment], start, **options)
    found = fit(
        pendulum, outputs, [segment], start, dynamics_jacobian=with_length, outputs_jacobian=of_outputs, **options
    )
    same(found, plain)
    assert found.theta["w2"] == pytest.approx(9.81 / found.theta["length"])


def wrong_state(x: Any, u: Any, theta: Any, t: Any) -> Any:
    by_state, found = by_hand(x, u, theta, t)
    by_state[1, 0] *= 1.01
    return by_state, found


def wrong_parameter(x: Any, u: Any, theta: Any, t: Any) -> Any:
    by_state, found = by_hand(x, u, theta, t)
    return by_state, found | {"damping": -found["damping"]}


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (wrong_state, r"dynamics_jacobian: the derivative of row 1 by state 0 is .* differences of dynamics give"),
        (wrong_parameter, "row 1 by parameter 'damping'"),
        (lambda *a: by_hand(*a)[0], "expected a pair"),
        (lambda *a: (by_hand(*a)[0].transpose(2, 0, 1), {}), "rows, states, samples"),
        (lambda *a: (by_hand(*a)[0], {"w2": 0.0}), "derivative by 'w2' of shape"),
    ],
)
def test_wrong_ones_are_refused(given: Any, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        fitted(dynamics_jacobian=given)


def test_they_do_not_go_with_delays() -> None:
    with pytest.raises(UsageError, match="together with delays"):
        fitted(dynamics_jacobian=by_hand, delays=("bias",))


def test_those_of_jax_just_work() -> None:
    jax = pytest.importorskip("jax")
    jax.config.update("jax_enable_x64", True)
    jnp = jax.numpy

    def one(x: Any, u: Any, theta: Any, t: Any) -> Any:
        return jnp.stack([x[1], -theta["w2"] * jnp.sin(x[0]) - theta["damping"] * x[1] + u[0]])

    samples = (1, 1, None, 0)
    given = jax.jit(jax.vmap(jax.jacfwd(one, argnums=(0, 2)), in_axes=samples, out_axes=-1))
    found = fit(
        jax.jit(jax.vmap(one, in_axes=samples, out_axes=-1)), angle, [SEGMENT], START, dynamics_jacobian=given
    )
    same(found, fitted())
