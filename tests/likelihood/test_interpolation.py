"""The delay interpolant: exact on cubics, smooth across samples, held outside."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from brv_hypo.likelihood.segment import interpolation

TIMES = np.cumsum(np.random.default_rng(1).uniform(0.5, 1.5, 25))


@given(
    coefficients=st.lists(st.floats(-3, 3), min_size=4, max_size=4),
    where=st.lists(st.floats(float(TIMES[0]), float(TIMES[-1])), min_size=1, max_size=8),
)
@settings(max_examples=60)
def test_cubics_and_their_rates_are_exact_on_an_uneven_time_base(coefficients: list[float], where: list[float]) -> None:
    cubic = np.polynomial.Polynomial(coefficients, domain=[TIMES[0], TIMES[-1]])
    query = np.array(where)
    value, rate = interpolation(TIMES, query)
    np.testing.assert_allclose(value @ cubic(TIMES), cubic(query), atol=1e-10)
    np.testing.assert_allclose(rate @ cubic(TIMES), cubic.deriv()(query), atol=1e-9)


def test_value_and_rate_are_continuous_as_the_query_passes_a_sample() -> None:
    signal = np.sin(1.7 * TIMES)
    (value, rate), (value_after, rate_after) = (interpolation(TIMES, TIMES[1:-1] + side * 1e-9) for side in (-1, 1))
    np.testing.assert_allclose(value @ signal, value_after @ signal, atol=1e-8)
    np.testing.assert_allclose(rate @ signal, rate_after @ signal, atol=1e-7)


def test_the_error_falls_with_the_fourth_power_of_the_step() -> None:
    errors = []
    for n in (40, 80):
        t = np.linspace(0, 4, n + 1)
        query = np.linspace(0.3, 3.7, 333)
        errors.append(np.abs(interpolation(t, query)[0] @ np.sin(3 * t) - np.sin(3 * query)).max())
    assert np.log2(errors[0] / errors[1]) == pytest.approx(4, abs=0.4)


def test_outside_the_samples_the_end_value_is_held() -> None:
    value, rate = interpolation(TIMES, np.array([TIMES[0] - 3.0, TIMES[-1] + 3.0]))
    np.testing.assert_allclose(value @ np.cos(TIMES), np.cos(TIMES[[0, -1]]))
    np.testing.assert_array_equal(rate @ np.cos(TIMES), 0.0)
