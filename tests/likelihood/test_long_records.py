"""Long records: worked on a part at a time, with the same result."""

from __future__ import annotations

import numpy as np
import pytest

from brv_hypo.likelihood import FitResult, fit
from tests.studies.likelihood.problems import ModelProblem, lagging_body, short_period

MODULE = "brv_hypo.likelihood"


def fitted(problem: ModelProblem, samples: int) -> FitResult:
    start = {name: 0.8 * value for name, value in problem.truth.items()}
    segment = problem.simulate(samples, seed=2)
    return fit(problem.dynamics, problem.outputs, [segment], start, delays=problem.delays, tolerance=1e-7)


@pytest.mark.parametrize(
    "problem",
    [
        pytest.param(short_period(), id="no delay"),
        pytest.param(lagging_body(), id="a delay", marks=pytest.mark.thorough),
    ],
)
def test_in_parts_a_record_gives_the_same_result(problem: ModelProblem, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = fitted(problem, 600)
    monkeypatch.setattr(f"{MODULE}.collocation._AT_ONCE", 100)
    parts = fitted(problem, 600)
    assert (whole.status, parts.status) == ("converged", "converged")
    for name, error in whole.std_error.items():
        assert parts.theta[name] == pytest.approx(whole.theta[name], abs=1e-4 * error)
        assert parts.std_error[name] == pytest.approx(error, rel=1e-5)
        assert parts.std_error_coloured[name] == pytest.approx(whole.std_error_coloured[name], rel=1e-5)
    np.testing.assert_allclose(parts.states[0], whole.states[0], atol=1e-6 * np.abs(whole.states[0]).max())
    more = [np.random.default_rng(0).standard_normal(whole.innovations[0].shape)]
    found, expected = (np.array([*each.change_by(more).values()]) for each in (parts, whole))
    np.testing.assert_allclose(found, expected, rtol=1e-4, atol=1e-8)


@pytest.mark.thorough
def test_coloured_errors_in_blocks_differ_by_what_crosses_their_edges_only(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = fitted(short_period(), 600)
    monkeypatch.setattr(f"{MODULE}.uncertainty._BLOCK", 300)
    blocks = fitted(short_period(), 600)
    for name, error in whole.std_error_coloured.items():
        assert blocks.std_error_coloured[name] == pytest.approx(error, rel=0.02)
