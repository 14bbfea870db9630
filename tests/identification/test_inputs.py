from __future__ import annotations

import numpy as np

from brv_hypo.identification.inputs import smoothed

TIME = np.linspace(0.0, 6.0, 1201)


def test_smoothing_takes_out_all_but_the_noise_of_a_few_coefficients():
    clean = 4e5 * np.exp(0.3 * TIME)
    noise = np.random.default_rng(1).normal(0.0, 200.0, TIME.size)
    assert np.std(smoothed(clean + noise) - clean) < 0.15 * 200.0


def test_smoothing_keeps_what_is_more_than_noise():
    clean = 8.0 + 0.1 * np.sin(5.0 * TIME)
    noise = np.random.default_rng(1).normal(0.0, 1e-4, TIME.size)
    assert np.std(smoothed(clean + noise) - clean) < 6e-5


def test_a_constant_stays_what_it_is():
    np.testing.assert_allclose(smoothed(np.full(50, 7.0)), 7.0, rtol=1e-12)
