"""Hermite-Simpson defects: order of accuracy, and derivatives against differences of the defects."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from brv_hypo.likelihood.collocation import System, evaluate_segment, linearise_segment
from brv_hypo.likelihood.elimination import block_rows
from brv_hypo.likelihood.segment import Segment, build_grid
from tests.studies.likelihood.problems import ModelProblem, lagging_body, spinning_body


def late_output() -> ModelProblem:
    """An instrument that is late: the delay is in the outputs."""
    body = lagging_body()
    return replace(body, outputs=lambda x, u, theta, t, delayed: np.stack([delayed["delay"].x[0] + x[1], x[1]]))


def by_state(blocks: Any, delayed: Any, dx: Any) -> Any:
    """Change by that of the states (n, n_states)."""
    whole = block_rows(blocks) if delayed is None else block_rows(blocks) + delayed
    return (whole @ dx.ravel()).reshape(len(blocks), -1)


@pytest.mark.parametrize("problem", [spinning_body(), lagging_body(), late_output()], ids=["no delay", "delay", "late"])
def test_derivatives_by_states_and_parameters(problem: ModelProblem) -> None:
    rng = np.random.default_rng(0)
    n, n_states = 23, problem.x0.size
    t = np.cumsum(rng.uniform(0.03, 0.05, n))
    u = problem.inputs(t)
    y = np.zeros((problem.noise.size, n))
    grid = build_grid(Segment(t, u, y, np.zeros(n_states)), 0)
    model = System(problem.dynamics, problem.outputs, problem.delays)
    x = 0.1 * rng.standard_normal((n_states, n))
    names = tuple(problem.truth)
    linear = linearise_segment(model, grid, x, problem.truth, names)
    dx = rng.standard_normal(x.shape)
    dp = dict(zip(names, rng.standard_normal(len(names)), strict=True))
    step = 1e-6

    def ends(sign: int) -> tuple[np.ndarray, np.ndarray]:
        moved = {name: problem.truth[name] + sign * step * dp[name] for name in names}
        return evaluate_segment(model, grid, x + sign * step * dx, moved)

    (defect_up, output_up), (defect_down, output_down) = ends(1), ends(-1)
    by_parameter = np.array(list(dp.values()))
    got = by_state(linear.defect_by_state, linear.defect_by_delayed, dx.T) + linear.defect_by_parameter @ by_parameter
    np.testing.assert_allclose(got, (defect_up - defect_down) / (2 * step), atol=1e-6)
    got = (
        by_state(linear.output_by_state[:, None], linear.output_by_delayed, dx.T)
        + linear.output_by_parameter @ by_parameter
    )
    scale = np.abs(got).max()
    np.testing.assert_allclose(got, (output_up - output_down) / (2 * step), atol=1e-6 * scale)


def test_the_defect_of_the_true_motion_falls_with_the_fifth_power_of_the_step() -> None:
    sizes = []
    for rate in (25.0, 50.0):
        problem = replace(spinning_body(), rate=rate)
        segment = problem.simulate(int(4 * rate), seed=0)
        truth = problem.trajectory(segment.t, np.random.default_rng(0))
        grid = build_grid(segment, 0)
        defect, _ = evaluate_segment(System(problem.dynamics, problem.outputs), grid, truth, problem.truth)
        sizes.append(np.abs(defect[5:-5]).max())
    assert np.log2(sizes[0] / sizes[1]) == pytest.approx(5, abs=0.5)
