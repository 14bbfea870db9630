"""The study and the benchmark, in small: the full figures are those of their commands."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.studies.likelihood.benchmark import Timing, growth_exponent, time_problem
from tests.studies.likelihood.problems import growing_body, short_period, spinning_body
from tests.studies.likelihood.study import coverage, cramer_rao, delay, filter_error, growth_in_two_seconds, hard_motion


@pytest.mark.slow
def test_intervals_cover_in_white_noise_and_once_corrected_in_coloured() -> None:
    """60 trials, 8 parameters: the mean share has a standard deviation of about 1.5 %."""
    white = coverage(short_period(), 300, trials=60, seed=1)
    assert white.converged == 1.0
    assert white.white.mean() == pytest.approx(0.95, abs=0.045)
    assert np.sqrt(np.mean(white.efficiency**2)) == pytest.approx(1.0, abs=0.1)
    coloured = coverage(short_period(), 600, trials=60, seed=2, correlation=0.7)
    assert coloured.white.mean() < 0.75
    assert coloured.coloured.mean() > 0.88


def test_the_bound_is_in_proportion_to_the_noise() -> None:
    quieter = replace(spinning_body(), noise=spinning_body().noise / 4)
    np.testing.assert_allclose(cramer_rao(quieter, 250), cramer_rao(spinning_body(), 250) / 4, rtol=1e-4)


@pytest.mark.slow
def test_hard_motion_grows_twentyfold_and_is_fitted() -> None:
    assert growth_in_two_seconds(growing_body()) >= 20
    found = hard_motion(trials=6, seed=3, shooting=False)
    assert found.collocation.all()


@pytest.mark.slow
def test_filter_error_converges_quickly_with_errors_of_the_right_size() -> None:
    found = filter_error(trials=8, seed=2, samples=400)
    assert found.converged.all()
    assert found.iterations.max() <= 15
    for scores in (found.theta, found.process, found.measurement):
        assert np.sqrt(np.mean(scores**2)) < 1.6


@pytest.mark.slow
@pytest.mark.parametrize("start", [0.1, 0.3])
def test_delays_come_back(start: float) -> None:
    found = delay(trials=8, seed=4, start=start, samples=600)
    assert found.converged.all()
    assert np.sqrt(np.mean(found.score**2)) < 1.8


def test_a_timing_has_its_wall_time_and_growth_is_a_slope() -> None:
    timing = time_problem("short period", short_period(), 200, repeats=1, target=0.1)
    assert timing.status == "converged"
    assert 0 < timing.best <= timing.wall
    line = [Timing("", n, 0.0, 0.0, 1e-4 * n, 4, "converged") for n in (1000, 3000, 30_000)]
    assert growth_exponent(line) == pytest.approx(1.0)
