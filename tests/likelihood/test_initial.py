"""Standard errors of the initial states: by Monte Carlo, with what was known before, with process noise."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from brv_hypo.likelihood import Segment, fit
from tests.studies.likelihood.problems import growing_body, short_period

SHORT = short_period()


@pytest.mark.slow
def test_the_scatter_of_two_segments_initial_states_is_their_standard_error() -> None:
    """120 trials of 4 initial states: each ratio has a standard deviation of 6.5 %, their mean one of 3 %."""
    t = np.arange(240) / SHORT.rate
    truth = SHORT.trajectory(t, np.random.default_rng(0))
    starts = (0, 120)
    error, predicted = [], []
    for child in np.random.SeedSequence(7).spawn(120):
        whole = SHORT.measure(t, truth, np.random.default_rng(child), 0.0)
        parts = [
            Segment(t[k : k + 120], whole.u[:, k : k + 120], whole.y[:, k : k + 120], np.zeros(2))
            for k in starts
        ]
        found = fit(SHORT.dynamics, SHORT.outputs, parts, dict(SHORT.truth))
        assert found.converged, found.message
        error.append([x[:, 0] - truth[:, k] for x, k in zip(found.states, starts, strict=True)])
        predicted.append(found.initial_state_std_error)
    ratio = np.sqrt(np.mean(np.square(error), axis=0)) / np.mean(predicted, axis=0)
    assert np.all((ratio > 0.78) & (ratio < 1.22))
    assert np.mean(ratio) == pytest.approx(1.0, abs=0.1)


def test_a_held_start_has_no_error_and_a_known_one_at_most_its_own() -> None:
    segment = SHORT.simulate(200, seed=1)
    free = fit(SHORT.dynamics, SHORT.outputs, [segment], dict(SHORT.truth)).initial_state_std_error[0]
    spread = np.array([0.0, 0.3 * free[1]])
    known = replace(segment, x0=SHORT.x0, x0_std=spread)
    error = fit(SHORT.dynamics, SHORT.outputs, [known], dict(SHORT.truth)).initial_state_std_error[0]
    assert error[0] == 0.0
    assert 0.0 < error[1] < spread[1] * 1.02
    loose = replace(segment, x0_std=1e4 * free)
    wide = fit(SHORT.dynamics, SHORT.outputs, [loose], dict(SHORT.truth)).initial_state_std_error[0]
    np.testing.assert_allclose(wide, free, rtol=1e-2)


def test_unstable_motion_tells_its_start_well() -> None:
    body = growing_body()
    result = fit(body.dynamics, body.outputs, [body.simulate(75, seed=2)], dict(body.truth))
    error = result.initial_state_std_error[0]
    assert np.all(error > 0.0)
    assert np.all(np.abs(result.states[0][:, 0] - body.x0) < 4.0 * error)


def test_with_process_noise_it_is_that_of_the_outputs_joint_density() -> None:
    """x' = a x + w, y = x + v: y is Gaussian about x(0) times the transition's powers."""
    n, h, a, q, r = 40, 0.1, -0.7, 0.3, 0.04

    def dynamics(x: Any, u: Any, theta: Any, t: Any) -> Any:
        return theta["a"] * x

    y = np.random.default_rng(0).standard_normal(n).cumsum() * 0.1
    segment = Segment(np.arange(n) * h, np.zeros((0, n)), y[None], np.zeros(1))
    result = fit(
        dynamics, lambda x, u, theta, t: x, [segment], {"a": a}, [np.sqrt(q)],
        priors={"a": (a, 1e-9)}, noise_covariance=np.array([[r]]),
    )  # fmt: skip
    z = a * h
    before, after = 1 + z / 2 + z**2 / 12, 1 - z / 2 + z**2 / 12
    transition, driven = before / after, q * h / after**2
    k = np.arange(n)
    common = np.minimum(k[:, None], k)
    together = sum(
        np.where(common >= j, transition ** (k[:, None] + k - 2.0 * j), 0.0) * driven for j in range(1, n)
    )
    shape = transition**k
    expected = 1.0 / np.sqrt(shape @ np.linalg.solve(together + r * np.eye(n), shape))
    np.testing.assert_allclose(result.initial_state_std_error[0], [expected], rtol=1e-6)
