"""Delays as continuous parameters: recovered, with exact derivatives, late instruments."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from brv_hypo.errors import UsageError
from brv_hypo.likelihood import fit
from tests.studies.likelihood.problems import lagging_body, short_period

BODY = lagging_body()


@pytest.mark.parametrize("start", [0.1, pytest.param(0.3, marks=pytest.mark.slow)])
@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (1, 2))])
def test_a_delay_started_a_tenth_of_a_second_off_comes_back(start: float, seed: int) -> None:
    theta0 = {name: 0.7 * value for name, value in BODY.truth.items()} | {"delay": start}
    result = fit(BODY.dynamics, BODY.outputs, [BODY.simulate(900, seed)], theta0, delays=("delay",))
    assert result.converged, result.message
    assert abs(result.theta["delay"] - 0.2) < 3 * result.std_error["delay"]
    assert 0 < result.std_error["delay"] < 0.03


@pytest.mark.slow
def test_it_is_at_the_minimum_of_the_likelihood_in_the_delay() -> None:
    """Profile: with the delay fixed to either side, the NLLF rises as its standard error says."""
    segment = BODY.simulate(800, seed=4)
    free = fit(BODY.dynamics, BODY.outputs, [segment], dict(BODY.truth), delays=("delay",), tolerance=1e-8)
    spread = free.std_error["delay"]
    for side in (-1.0, 1.0):
        aside = free.theta | {"delay": free.theta["delay"] + side * spread}
        fixed = fit(
            BODY.dynamics, BODY.outputs, [segment], aside,
            delays=("delay",), bounds={"delay": (aside["delay"],) * 2}, noise=free.noise_variance,
        )  # fmt: skip
        assert fixed.nllf - free.nllf == pytest.approx(0.5, rel=0.15)


@pytest.mark.slow
@pytest.mark.parametrize("offset", [-0.03, 0.05])
def test_an_instrument_that_is_late_or_early_is_found(offset: float) -> None:
    """The delay is in the outputs only, and may be negative."""
    base = short_period()

    def dynamics(x: Any, u: Any, theta: Any, t: Any, delayed: Any) -> Any:
        return base.dynamics(x, u, theta, t)

    def outputs(x: Any, u: Any, theta: Any, t: Any, delayed: Any) -> Any:
        return np.stack([x[0] + theta["alpha_bias"], delayed["late"].x[1] + theta["q_bias"]])

    problem = replace(
        base, dynamics=dynamics, outputs=outputs, truth=dict(base.truth) | {"late": offset}, delays=("late",)
    )
    plain = base.simulate(800, seed=0)
    shifted = replace(base, noise=np.zeros(2)).simulate(800, seed=0)
    late = np.interp(plain.t - offset, plain.t, shifted.y[1])
    y = np.stack([plain.y[0], late + 0.005 * np.random.default_rng(5).standard_normal(800)])
    result = fit(problem.dynamics, outputs, [replace(plain, y=y)], dict(base.truth) | {"late": 0.0}, delays=("late",))
    assert result.converged, result.message
    assert result.theta["late"] == pytest.approx(offset, abs=max(4 * result.std_error["late"], 1e-3))


def test_a_delay_is_within_a_quarter_of_the_record_by_default() -> None:
    segment = BODY.simulate(200, seed=0)
    result = fit(BODY.dynamics, BODY.outputs, [segment], dict(BODY.truth) | {"late": 0.0}, delays=("delay",))
    assert abs(result.theta["delay"]) <= (segment.t[-1] - segment.t[0]) / 4 + 1e-9


@pytest.mark.parametrize("bounds", [{}, {"delay": (0.2, 0.2)}])
def test_delays_with_process_noise_are_refused_with_a_remedy(bounds: dict[str, tuple[float, float]]) -> None:
    segment = BODY.simulate(200, seed=0)
    with pytest.raises(UsageError, match=r"delays \['delay'\] .* process noise .* Leave process_noise out"):
        fit(
            BODY.dynamics, BODY.outputs, [segment], dict(BODY.truth), process_noise=[0.0, 0.01],
            delays=("delay",), bounds=bounds,
        )  # fmt: skip
    exact = fit(BODY.dynamics, BODY.outputs, [segment], dict(BODY.truth), process_noise=[0.0, 0.0], delays=("delay",))
    assert exact.converged
