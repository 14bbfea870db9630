"""Gaps of seconds, and half of the samples gone: bridged by the model."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from brv_hypo.likelihood import fit
from brv_hypo.likelihood.starts import pieces_of, stretches
from tests.studies.likelihood.problems import growing_body, short_period

BODY = growing_body()
START = {name: 0.7 * value for name, value in BODY.truth.items()}


@pytest.mark.thorough
@pytest.mark.parametrize("seed", [0, pytest.param(2, marks=pytest.mark.slow)])
@pytest.mark.parametrize("thinned", [pytest.param(False, marks=pytest.mark.slow), True])
def test_a_gap_of_three_seconds_and_half_of_the_rest_missing(seed: int, thinned: bool) -> None:
    segment = BODY.simulate(250, seed)
    rng = np.random.default_rng(seed)
    y = segment.y.copy()
    y[:, 90:165] = np.nan
    if thinned:
        y[:, rng.random(250) < 0.5] = np.nan
    gappy = replace(segment, y=y)
    result = fit(BODY.dynamics, BODY.outputs, [gappy], START)
    reference = fit(BODY.dynamics, BODY.outputs, [gappy], BODY.truth)
    assert result.converged, result.message
    assert result.nllf < reference.nllf + 0.5
    score = [(result.theta[k] - v) / result.std_error[k] for k, v in BODY.truth.items()]
    assert np.abs(score).max() < 4.0


def test_a_known_start_and_inputs_are_kept_across_a_gap() -> None:
    aircraft = short_period()
    segment = replace(aircraft.simulate(300, seed=3), x0=aircraft.x0, x0_std=0.0)
    y = segment.y.copy()
    y[:, 100:180] = np.nan
    result = fit(
        aircraft.dynamics, aircraft.outputs, [replace(segment, y=y)], {k: 0.6 * v for k, v in aircraft.truth.items()}
    )  # fmt: skip
    assert result.converged
    np.testing.assert_allclose(result.states[0][:, 0], aircraft.x0, atol=1e-9)


def test_stretches_lie_between_long_gaps_only() -> None:
    segment = BODY.simulate(200, seed=1)
    assert stretches([segment]) == []
    slow = segment.y.copy()
    slow[:, np.arange(200) % 5 != 0] = np.nan
    assert stretches([replace(segment, y=slow)]) == []
    y = segment.y.copy()
    y[:, 60:120] = np.nan
    gappy = replace(segment, y=y)
    between = stretches([segment, gappy])
    assert between == [[slice(0, 200)], [slice(0, 60), slice(120, 200)]]
    assert [piece.t.size for piece in pieces_of([segment, gappy], between)] == [200, 60, 80]


@pytest.mark.parametrize("process_noise", [None, pytest.param([0.01, 0.01], marks=pytest.mark.slow)])
def test_an_output_without_samples_has_a_remark(process_noise: list[float] | None) -> None:
    problem = short_period()
    record = problem.simulate(200, seed=0)
    alone = np.array(record.y)
    alone[1] = np.nan
    options: dict[str, Any] = {"process_noise": process_noise, "estimate_process_noise": process_noise is not None}
    start = {name: 0.9 * value for name, value in problem.truth.items()}
    result = fit(problem.dynamics, problem.outputs, [replace(record, y=alone)], start, **options)
    remarks = [remark for remark in result.remarks if "outputs [1]" in remark]
    assert len(remarks) == 1
    assert "no samples" in remarks[0]
    assert not np.isfinite(result.std_error["q_bias"])
    assert np.isfinite(result.std_error["M_alpha"])
