from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from brv_hypo.arrays import ComplexArray
from brv_hypo.linearisation.channels import (
    Noise,
    Part,
    Whitening,
    effective_samples,
    fit_noise,
    lasting_autocovariance,
    lasting_noise,
    white,
)
from brv_hypo.motion.signals import ColouredNoise


def coloured(rng: np.random.Generator, n: int, feedback: float) -> ComplexArray:
    noise = rng.normal(size=(2, n + 500))
    red = lfilter([1.0], [1.0, -feedback], noise, axis=1)[:, 500:]
    return red[0] + 1j * red[1]


@pytest.mark.parametrize("feedback", [0.0, 0.5, 0.95])
def test_the_filter_makes_an_autoregression_white(feedback: float) -> None:
    rng = np.random.default_rng(3)
    noise = fit_noise([coloured(rng, 4000, feedback)])
    fresh = noise.operator(4000) @ coloured(rng, 4000, feedback)
    correlation = np.real(np.vdot(fresh[:-1], fresh[1:])) / np.real(np.vdot(fresh, fresh))
    assert abs(correlation) < 4.0 / np.sqrt(8000)
    assert noise.sigma == pytest.approx(1.0, rel=0.05)


def test_the_first_rows_are_whitened_exactly() -> None:
    """Durbin-Levinson: over many short segments each row has the variance of the innovation."""
    rng = np.random.default_rng(4)
    noise = fit_noise([coloured(rng, 20000, 0.9)])
    segments = np.column_stack([coloured(rng, 6, 0.9) for _ in range(4000)])
    power = np.mean(np.abs(noise.operator(6) @ segments) ** 2, axis=1) / 2.0
    np.testing.assert_allclose(power, 1.0, rtol=0.1)


def test_constants_of_integration_are_projected_out_piece_by_piece() -> None:
    rng = np.random.default_rng(5)
    noise = fit_noise([coloured(rng, 3000, 0.6)])
    pieces = ((0, 40), (40, 100))
    part = Part(np.arange(100), np.ones(100, dtype=bool), pieces, pieces, (0, 0))
    white = Whitening(part, Noise(noise, noise)).rates
    level = np.concatenate([np.full(40, 2.0 - 1.0j), np.full(60, -7.0 + 0.5j)])
    _, unexplained, *_ = np.linalg.lstsq(white(part.constants()), white(level[:, None])[:, 0], rcond=None)
    assert unexplained[0] < 1e-20


def test_white_noise_keeps_all_its_samples() -> None:
    rng = np.random.default_rng(6)
    parts = [rng.normal(size=3000), rng.normal(size=3000)]
    assert effective_samples(parts) > 0.9 * 6000


def test_an_autoregression_counts_for_fewer_samples() -> None:
    """n (1 - a) / (1 + a) for feedback a: Bayley and Hammersley (1946)."""
    rng = np.random.default_rng(7)
    both = coloured(rng, 20000, 0.6)
    expected = 40000 * (1.0 - 0.6) / (1.0 + 0.6)
    assert effective_samples([both.real, both.imag]) == pytest.approx(expected, rel=0.15)


def test_white_filter_changes_nothing() -> None:
    rows = np.arange(10, dtype=complex)
    np.testing.assert_array_equal(white().operator(10) @ rows, rows)


@pytest.mark.parametrize("frequency", [0.02, 0.07, -0.2])
def test_what_acts_for_some_of_the_time_is_no_colour(frequency: float) -> None:
    """A moment of many cycles, over a third of the record, would pose as noise of its own frequency."""
    rng = np.random.default_rng(8)
    plain = coloured(rng, 1500, 0.0)
    tone = 5.0 * np.exp(2j * np.pi * frequency * np.arange(1500))
    acting = np.arange(1500) // 500 == 1
    noise = fit_noise([plain + acting * tone])
    assert noise.sigma == pytest.approx(fit_noise([plain]).sigma, rel=0.15)
    whitened = noise.operator(1500) @ (plain + acting * tone)
    assert np.mean(np.abs(whitened[acting]) ** 2) > 4.0 * np.mean(np.abs(whitened[~acting]) ** 2)


@pytest.mark.parametrize("feedback", [0.0, 0.6])
def test_what_lasts_is_estimated_without_bias(feedback: float) -> None:
    rng = np.random.default_rng(9)
    found = np.mean([lasting_autocovariance([coloured(rng, 1000, feedback)], 3) for _ in range(100)], axis=0)
    expected = feedback ** np.arange(4) / (1.0 - feedback**2)
    np.testing.assert_allclose(found, expected, atol=0.03 * expected[0])


def test_pieces_shorter_than_a_stretch_are_used_as_they_are() -> None:
    rng = np.random.default_rng(10)
    noise = fit_noise([coloured(rng, 20, 0.0) for _ in range(40)])
    assert 0.5 < noise.sigma < 1.2


@pytest.mark.parametrize("colour", [0.0, 0.5, 0.7, 0.9])
@pytest.mark.parametrize("above", [0.3, 1.0])
def test_level_at_the_motion_is_read_beyond_it(colour: float, above: float) -> None:
    """A motion that is a hundred times as large as the noise does not enter."""
    ratios = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        fresh = rng.standard_normal((4000, 2)) @ np.array([1.0, 1j])
        noise = lfilter([1.0], [1.0, -colour], fresh)
        motion = 100.0 * np.exp(0.1j * np.arange(fresh.size))
        found = lasting_noise([noise + motion], above, 0.1)
        ratios.append(found.sigma_at(0.1) / ColouredNoise(1.0, colour).sigma_at(0.1))
    low, median, high = np.quantile(ratios, [0.1, 0.5, 0.9])
    assert low > 0.75
    assert 0.9 < median < 1.15
    assert high < 1.35


def test_white_noise_is_not_given_a_colour() -> None:
    """None, however much its spectrum scatters."""
    rng = np.random.default_rng(8)
    noise = [rng.standard_normal((800, 2)) @ np.array([1.0, 1j]) for _ in range(20)]
    found = [lasting_noise([each], 0.5, 0.2).sigma_at(0.2) for each in noise]
    assert np.all(np.abs(np.array(found) - 1.0) < 0.25)
