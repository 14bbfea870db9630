"""Long records: errors for coloured residuals are worked out in blocks, with the same result."""

from __future__ import annotations

import pytest

from brv_hypo.likelihood import FitResult, fit
from tests.studies.likelihood.problems import ModelProblem, short_period

MODULE = "brv_hypo.likelihood"


def fitted(problem: ModelProblem, samples: int) -> FitResult:
    start = {name: 0.8 * value for name, value in problem.truth.items()}
    segment = problem.simulate(samples, seed=2)
    return fit(problem.dynamics, problem.outputs, [segment], start, delays=problem.delays, tolerance=1e-7)


@pytest.mark.thorough
def test_coloured_errors_in_blocks_differ_by_what_crosses_their_edges_only(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = fitted(short_period(), 600)
    monkeypatch.setattr(f"{MODULE}.statistics._BLOCK", 300)
    blocks = fitted(short_period(), 600)
    for name, error in whole.std_error_coloured.items():
        assert blocks.std_error_coloured[name] == pytest.approx(error, rel=0.02)
