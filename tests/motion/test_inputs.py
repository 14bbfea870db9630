from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from brv_hypo.identification.parameters import input_error
from brv_hypo.motion import reconstruct
from brv_hypo.motion.inputs import PRESSURE, ROLL_RATE, follows, log_density, significant_shapes, smooth_inputs
from brv_hypo.motion.signals import InputError, smoothed, unsmoothed
from tests.flights import nominal
from tests.harness.last_digit import last_digit_off

TIME = np.linspace(0.0, 6.0, 1201)


def test_smoothing_takes_out_all_but_the_noise_of_a_few_coefficients():
    clean = 4e5 * np.exp(0.3 * TIME)
    noise = np.random.default_rng(1).normal(0.0, 200.0, TIME.size)
    assert np.std(smoothed(clean + noise).values - clean) < 0.15 * 200.0


def test_smoothing_keeps_what_is_more_than_noise():
    clean = 8.0 + 0.1 * np.sin(5.0 * TIME)
    noise = np.random.default_rng(1).normal(0.0, 1e-4, TIME.size)
    assert np.std(smoothed(clean + noise).values - clean) < 6e-5


def test_a_constant_stays_what_it_is():
    np.testing.assert_allclose(smoothed(np.full(50, 7.0)).values, 7.0, rtol=1e-12)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_last_digit_of_signal_and_weight_moves_the_curve_by_rounding(seed: int):
    """Modes from squares of differences move it by 5e-9."""
    weight = np.exp(0.3 * TIME)
    signal = 11.0 + 0.1 * TIME**2 + np.random.default_rng(seed).normal(0.0, 1e-3, TIME.size) / weight
    before = smoothed(signal, weight).values
    after = smoothed(last_digit_off(signal, seed), last_digit_off(weight, seed)).values
    np.testing.assert_allclose(after, before, rtol=1e-12)


@pytest.mark.parametrize("turns", [0.0, 1.0, 6.0])
@pytest.mark.parametrize("weight", ["even", "growing"])
def test_the_error_of_a_smoothed_input_is_as_large_as_stated(turns: float, weight: str):
    """Over draws, the square of the true error is that of all shapes."""
    clean = np.exp(0.2 * TIME) + 0.05 * np.sin(turns * TIME)
    weights = np.ones_like(TIME) if weight == "even" else np.exp(0.3 * TIME)
    draws = np.random.default_rng(5)
    ratios = []
    for _ in range(20):
        found = smoothed(clean + 2e-3 / weights * draws.standard_normal(TIME.size), weights)
        error = InputError(ROLL_RATE, (float(TIME[0]), float(TIME[-1])), found.scale)
        stated = np.sum(error.shapes(TIME) ** 2, axis=0)
        ratios.append(float(np.sum((weights * (found.values - clean)) ** 2) / np.sum(weights**2 * stated)))
    assert 0.6 < np.mean(ratios) < 1.6


def test_the_density_is_found_where_pressure_is_lost_in_noise():
    flight = nominal().flight
    pressure = 2e3 * np.exp(1.5 * flight.time)
    noise = np.random.default_rng(2).normal(0.0, 3e3, flight.samples)
    found = log_density(replace(flight, dynamic_pressure=pressure + noise), flight.velocity, np.zeros(flight.samples))
    late = flight.time > 4.0
    smooth = np.exp(found.values) * flight.velocity**2
    assert np.all(np.isfinite(found.values))
    assert np.median(np.abs(smooth - pressure)[late]) < 0.3 * 3e3


def test_the_errors_are_sampled_parameters_of_their_flight():
    flight = nominal().flight
    inputs = smooth_inputs(reconstruct(flight))
    sampled = [input_error(error, 2) for error in inputs.errors]
    assert [each.name for each in sampled] == [f"{name} [flight 2]" for name in (ROLL_RATE, PRESSURE)]
    for each, error in zip(sampled, inputs.errors, strict=True):
        assert each.shapes(flight.time[:7]).shape == (len(each.weights), 7) == (error.count, 7)


@pytest.mark.parametrize("grows", [False, True])
def test_a_spline_follows_a_channel_whose_noise_grows_with_it(grows: bool) -> None:
    """Pressure that falls fivefold, with a thousandth of itself, or of its mean, for noise."""
    flight = nominal().flight
    clean = 2e4 * np.exp(-1.6 * flight.time / flight.time[-1])
    noise = 1e-3 * (clean if grows else clean.mean()) * np.random.default_rng(3).standard_normal(clean.size)
    assert follows(clean + noise, clean, flight)
    assert not follows(clean + noise + 3e-3 * clean * np.sin(6.0 * flight.time), clean, flight)


def test_shapes_are_significant_as_far_as_the_rates_observe_them() -> None:
    """Quiet gyros observe finer errors of the pressure than ten shapes have; with 100 times the noise they do not."""
    reconstruction = reconstruct(nominal().flight)
    scale = 1e-2 * np.eye(67) / np.arange(1.0, 68.0)
    shares = np.ones(40)
    fine = significant_shapes(scale, shares, reconstruction).shape[1]
    assert 20 <= fine <= 40
    noisy = replace(reconstruction, gyro_sigma=100.0 * reconstruction.gyro_sigma)
    assert significant_shapes(scale, shares, noisy).shape[1] < fine


def test_an_input_that_is_not_smoothed_has_all_of_its_slow_noise() -> None:
    """Over draws: projected on the shapes, white noise has unit weights."""
    shapes = InputError(ROLL_RATE, (float(TIME[0]), float(TIME[-1])), unsmoothed(TIME.size, 2e-3)).shapes(TIME)[:20]
    noise = 2e-3 * np.random.default_rng(6).standard_normal((TIME.size, 400))
    weights = np.linalg.lstsq(shapes.T, noise, rcond=None)[0]
    assert np.std(weights) == pytest.approx(1.0, abs=0.05)


def test_a_roll_rate_that_swings_is_kept_and_its_errors_are_stated() -> None:
    """A tenth of a rad/s at 12 rad/s is beyond the spline, and not noise."""
    flight = nominal().flight
    swinging = replace(flight, p=flight.p + 0.1 * np.sin(12.0 * flight.time))
    found = smooth_inputs(replace(reconstruct(flight), flight=swinging))
    noise = np.std(np.diff(flight.p, 3)) / np.sqrt(20.0)
    assert np.std(found.roll_rate - swinging.p) < 1.2 * noise
    stated = {error.name: np.sqrt(np.sum(error.shapes(flight.time) ** 2, axis=0)) for error in found.errors}
    assert np.median(stated[ROLL_RATE]) == pytest.approx(noise * np.sqrt(10 / flight.samples), rel=0.2)
