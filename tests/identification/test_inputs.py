from __future__ import annotations

import numpy as np

from brv_hypo.identification.inputs import PRESSURE, ROLL_RATE, smooth_inputs, smoothed
from brv_hypo.motion import reconstruct
from brv_hypo.simulate import simulate_batch

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


def test_what_noise_leaves_in_the_inputs_is_as_large_as_stated():
    """Weights of unit prior: over flights the square of the true error is that of the stated shapes."""
    quiet = {f"instruments.{name}.noise": np.zeros(4) for name in ("gyro", "dynamic_pressure")}
    seeds = range(300, 304)
    noisy_flights = simulate_batch("research_cone", seeds=seeds)
    quiet_flights = simulate_batch("research_cone", seeds=seeds, variations=quiet)
    ratios: dict[str, list[float]] = {ROLL_RATE: [], PRESSURE: []}
    for noisy, clean in zip(noisy_flights, quiet_flights, strict=True):
        flight, true = noisy.flight, clean.flight
        inputs = smooth_inputs(flight, reconstruct(flight).motion, 0)
        lefts = (inputs.roll_rate - true.p, 1.0 - true.dynamic_pressure / inputs.pressure)
        for name, error, left in zip(ratios, inputs.errors, lefts, strict=True):
            stated = np.sqrt(np.sum(error.shapes(flight.time) ** 2, axis=0))
            ratios[name].append(float(np.mean((left / stated) ** 2)))
    for name, found in ratios.items():
        assert 0.4 < np.mean(found) < 2.0, name
