from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import savgol_coeffs, savgol_filter

from brv_hypo.motion.signals import _WIDE, _correlated, _filter, derivatives, differentiate

STEP = 0.01


@pytest.mark.parametrize("derivative", [0, 1])
@pytest.mark.parametrize(("order", "half_width"), [(2, 1), (2, 7), (4, 5), (6, 9)])
def test_weights_are_those_of_savitzky_and_golay(order: int, half_width: int, derivative: int) -> None:
    found = _filter(order, half_width, derivative)
    middle, before = found.middle, found.places @ found.basis.T
    width = 2 * half_width + 1
    assert middle == pytest.approx(savgol_coeffs(width, order, deriv=derivative, use="dot"), abs=1e-8)
    for place, weights in enumerate(before):
        assert weights == pytest.approx(savgol_coeffs(width, order, derivative, pos=place, use="dot"), abs=1e-8)


@given(coefficients=st.lists(st.floats(-5, 5), min_size=3, max_size=3), cut=st.integers(60, 140))
def test_exact_on_parabolas_in_each_segment_and_at_its_ends(coefficients: list[float], cut: int) -> None:
    time = STEP * np.arange(200)
    signal = np.polyval(coefficients, time) * (1.0 - 0.5j)
    answer = differentiate(signal, STEP, 1e-6, ((0, cut), (cut, 200)))
    expected = np.polyval(np.polyder(coefficients), time) * (1.0 - 0.5j)
    np.testing.assert_allclose(answer.rate, expected, rtol=0.0, atol=1e-7 * (1.0 + max(np.abs(coefficients))))
    assert answer.interior.tolist()[::199] == [False, False]
    assert not answer.interior[cut]
    assert answer.interior[30]


@pytest.mark.parametrize(("frequency", "sigma"), [(1.0, 0.05), (5.0, 0.01), (12.0, 0.001), (2.0, 0.5)])
def test_stated_error_is_the_error(frequency: float, sigma: float) -> None:
    rng = np.random.default_rng(7)
    time = STEP * np.arange(1500)
    turn = 2.0 * np.pi * frequency
    truth = np.exp(1j * turn * time) + 0.5 * np.exp(-0.6j * turn * time)
    rate = 1j * turn * np.exp(1j * turn * time) - 0.3j * turn * np.exp(-0.6j * turn * time)
    ratios = []
    for _ in range(20):
        noise = sigma * (rng.standard_normal(time.size) + 1j * rng.standard_normal(time.size))
        answer = differentiate(truth + noise, STEP, sigma, ((0, time.size),))
        stated = np.hypot(sigma * answer.rate_gain, answer.rate_bias)[answer.interior]
        error = (answer.rate - rate)[answer.interior]
        ratios.append(np.sqrt(np.mean(np.abs(error) ** 2) / np.mean(2.0 * stated**2)))
    assert np.sqrt(np.mean(np.square(ratios))) == pytest.approx(1.0, abs=0.2)


def test_stated_colour_is_the_colour() -> None:
    rng = np.random.default_rng(11)
    n = 200_000
    noise = rng.standard_normal(n) + 1j * rng.standard_normal(n)
    signal = 300.0 * np.exp(0.05j * np.arange(n)) + noise
    answer = differentiate(signal, 1.0, 1.0, ((0, n),))
    carrier = np.exp(0.05j * np.arange(n))[answer.interior]
    error = answer.rate[answer.interior]
    error = error - carrier * np.mean(error * np.conj(carrier))
    found = [np.mean(error[: error.size - lag] * np.conj(error[lag:])).real for lag in range(2 * answer.half_width + 1)]
    assert np.array(found) / found[0] == pytest.approx(answer.noise_correlation, abs=0.02)


@pytest.mark.parametrize("half_width", [40, _WIDE // 2, 700])
def test_wide_filters_are_the_same_as_narrow_ones(half_width: int) -> None:
    rows = np.cumsum(np.random.default_rng(2).standard_normal((2, 3, 4000)), axis=-1)
    expected = savgol_filter(rows, 2 * half_width + 1, 4, 1, STEP)
    np.testing.assert_allclose(
        derivatives(rows, 4, half_width, STEP), expected, atol=1e-7 * np.max(np.abs(expected)), rtol=0.0
    )
    signal, weights = rows[0, 0] + 1j * rows[0, 1], _filter(4, half_width, 1).middle
    expected = np.correlate(signal, weights, "valid")
    np.testing.assert_allclose(_correlated(signal, weights), expected, atol=1e-12, rtol=0.0)
