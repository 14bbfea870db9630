"""Several starting points: the best likelihood wins, disagreement is said, a right model is fitted once."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from brv_hypo.likelihood import FitResult, Segment, Status, fit
from brv_hypo.likelihood.starts import chosen, first_noises
from tests.studies.likelihood.problems import short_period

SHORT = short_period()
GOOD = fit(SHORT.dynamics, SHORT.outputs, [SHORT.simulate(200, seed=0)], dict(SHORT.truth))


def ended(log_likelihood: float, status: Status = Status.CONVERGED) -> FitResult:
    return replace(GOOD, log_likelihood=log_likelihood, status=status)


def test_a_right_model_is_fitted_once() -> None:
    assert [each.status for each in GOOD.starting_points] == ["converged"]
    assert "disagree" not in GOOD.message


def test_a_wrong_model_is_begun_from_every_noise_and_the_best_is_kept() -> None:
    """Cubic stiffness fitted by a linear one."""
    t = np.arange(300) / 20
    x, v, step = np.zeros(301), np.zeros(301), 0.05
    x[0] = 1.5
    for k in range(300):
        v[k + 1] = v[k] - step * (x[k] + 2.0 * x[k] ** 3)
        x[k + 1] = x[k] + step * v[k + 1]
    y = x[None, :300] + 0.01 * np.random.default_rng(1).standard_normal((1, 300))

    def dynamics(x: Any, u: Any, theta: Any, t: Any) -> Any:
        return np.stack([x[1], -theta["k"] * x[0] - theta["c"] * x[1]])

    segment = Segment(t, np.zeros((0, 300)), y, np.zeros(2))
    result = fit(dynamics, lambda x, u, theta, t: x[:1], [segment], {"k": 2.0, "c": 0.0})
    assert len(result.starting_points) == 3
    assert result.log_likelihood >= max(each.log_likelihood for each in result.starting_points) - 1.0


@pytest.mark.parametrize("better", [Status.CONVERGED, Status.STALLED])
def test_an_inferior_optimum_is_never_called_converged(better: Status) -> None:
    best = chosen({"a": ended(100.0), "b": ended(200.0, better)})
    assert best.log_likelihood == 200.0
    assert best.status is better
    assert "Starting points disagree" in best.message
    assert "100" in best.message


def test_of_equally_good_ends_one_that_converged_is_chosen() -> None:
    best = chosen({"a": ended(100.1, Status.STALLED), "b": ended(100.0), "c": ended(float("nan"))})
    assert best.status is Status.CONVERGED
    assert best.log_likelihood == 100.0


def test_first_noises_rise() -> None:
    noises = [*first_noises(SHORT.simulate(400, seed=1).y).values()]
    assert np.all(noises[0] <= 1.2 * noises[1])
    assert np.all(noises[1] < noises[2])


@pytest.mark.parametrize("status", list(Status))
def test_every_status_knows_its_cause_and_its_remedy(status: Status) -> None:
    assert status.cause in status.message
    assert bool(status.remedy) == (status is not Status.CONVERGED)
