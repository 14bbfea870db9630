"""Spikes: isolated ones are found; no clean motion, step, kink or noise is touched."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from brv_hypo.flight.cleaning import despiked, find_spikes
from brv_hypo.flight.format import assemble, unassemble
from tests.flight.records import flight, motion

SAMPLES = 600


@given(st.floats(2.0, 2000.0), st.floats(0.0, 6.3), st.floats(0.0, 0.1), st.integers(0, 2**31))
@settings(max_examples=2 * settings.default.max_examples)
def test_clean_oscillation_is_untouched_up_to_the_nyquist_frequency(
    samples_per_cycle: float, phase: float, growth: float, seed: int
) -> None:
    index = np.arange(SAMPLES)
    envelope = np.exp(growth * index * (100.0 / SAMPLES))
    noise = 1e-3 * np.random.default_rng(seed).standard_normal(SAMPLES)
    wave = envelope * np.sin(2.0 * np.pi * index / samples_per_cycle + phase)
    assert not np.any(find_spikes(wave))
    assert not np.any(find_spikes(wave + noise))


@given(st.integers(0, SAMPLES), st.floats(-100.0, 100.0), st.integers(0, 3), st.sampled_from([0.0, 1e-6, 1.0]))
@settings(max_examples=2 * settings.default.max_examples)
def test_a_jump_of_any_derivative_is_untouched(at: int, size: float, order: int, sigma: float) -> None:
    index = np.arange(SAMPLES)
    after = np.where(index >= at, np.maximum(index - at, 0.0) ** order, 0.0)
    noise = sigma * np.random.default_rng(at).standard_normal(SAMPLES)
    assert not np.any(find_spikes(size * after + np.sin(index / 20.0) + noise))


def test_white_noise_is_untouched() -> None:
    rng = np.random.default_rng(11)
    found = sum(int(np.count_nonzero(find_spikes(rng.standard_normal(2000)))) for _ in range(300))
    assert found == 0  # 600,000 draws


@pytest.mark.parametrize("quantum", [1.0, 0.1])
def test_rounding_of_a_channel_at_rest_is_untouched(quantum: float) -> None:
    rng = np.random.default_rng(5)
    assert not np.any(find_spikes(quantum * np.rint(0.3 * rng.standard_normal(4000))))
    ticks = np.zeros(500)
    ticks[[50, 200, 201, 400]] = quantum
    assert not np.any(find_spikes(ticks))


@given(
    st.lists(st.integers(0, 24), min_size=1, max_size=5, unique=True),
    st.floats(40.0, 1e4),
    st.integers(1, 2),
    st.booleans(),
)
def test_isolated_spikes_are_found_exactly(slots: list[int], height: float, length: int, downward: bool) -> None:
    rng = np.random.default_rng(2)
    values = 50.0 * np.sin(np.arange(SAMPLES) / 30.0) + rng.standard_normal(SAMPLES)
    expected = np.zeros(SAMPLES, dtype=bool)
    for slot in slots:
        expected[20 + 22 * slot : 20 + 22 * slot + length] = True
    values[expected] += -height if downward else height
    np.testing.assert_array_equal(find_spikes(values), expected)


@pytest.mark.parametrize("samples_per_cycle", [41.3, 61.7])
def test_spikes_below_what_the_motion_bends_by_are_found(samples_per_cycle: float) -> None:
    """Thirty sigma, where one sample bends from the next by some hundred: a cubic follows the motion all the same."""
    wave = 5e3 * np.sin(2.0 * np.pi * np.arange(SAMPLES) / samples_per_cycle)
    noise = np.random.default_rng(3).standard_normal(SAMPLES)
    at = np.arange(20, SAMPLES - 20, 60)
    spiked = wave + noise
    spiked[at] += 30.0
    found = np.flatnonzero(find_spikes(spiked))
    assert set(found) <= set(at)
    assert found.size >= at.size // 2
    assert not np.any(find_spikes(wave + noise))


def test_spikes_close_together_and_beside_gaps_are_found() -> None:
    values = np.random.default_rng(2).standard_normal(SAMPLES)
    values[[100, 105, 110]] += [100.0, -70.0, 40.0]
    values[200:210] = np.nan
    values[213] += 80.0
    assert np.flatnonzero(find_spikes(values)).tolist() == [100, 105, 110, 213]


def test_a_channel_full_of_outliers_has_no_spikes() -> None:
    values = np.random.default_rng(2).standard_normal(SAMPLES)
    values[10::20] += 200.0
    assert not np.any(find_spikes(values))


def test_despiking_restores_the_motion_and_says_so() -> None:
    clean = motion()
    q = clean["q"].copy()
    q[[100, 250]] += [1.0, -0.5]
    found = assemble(unassemble(flight(q=q)))
    np.testing.assert_allclose(found.q, clean["q"], atol=6e-3)
    assert np.flatnonzero(found.q != q).tolist() == [100, 250]
    q[250] = clean["q"][250]
    _, spikes, notes = despiked(clean["time"], {"p": clean["p"], "q": q})
    assert {name: np.flatnonzero(at).tolist() for name, at in spikes.items()} == {"q": [100]}
    assert notes == ["q: 1 spike sample replaced by a cubic spline, the first at 11.000 s"]
    assert found.notes[0] == "q: 2 spike samples replaced by a cubic spline, the first at 11.000 s"
