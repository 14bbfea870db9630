"""Steps that overshoot: how much of the next is taken."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from brv_hypo.model.reconstruction import reconstruct
from brv_hypo.motion.methods.joint import RandomWalkSmoother, relaxed
from brv_hypo.simulation import load_config, simulate


@given(factor=st.floats(1.0, 9.0), seed=st.integers(0, 99))
def test_steps_that_overshoot_by_one_factor_end_at_once(factor: float, seed: int) -> None:
    """The step that is wanted at x is factor (truth - x)."""
    rng = np.random.default_rng(seed)
    truth, x = (rng.standard_normal(5) + 1j * rng.standard_normal(5) for _ in range(2))
    before = factor * (truth - x)
    x = x + before
    step = factor * (truth - x)
    np.testing.assert_allclose(x + relaxed(1.0, before, step) * step, truth, atol=1e-9)


@given(share=st.floats(0.1, 1.0), left=st.floats(-0.9, 0.9))
def test_no_more_than_a_whole_step_is_taken(share: float, left: float) -> None:
    step = np.array([1.0 + 2.0j, -0.5j])
    assert 0.0 < relaxed(share, step, left * step) <= 1.0


@pytest.mark.thorough
def test_a_motion_of_large_angles_is_found_in_few_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    """Alpha reaches 35 deg; half steps took 13 to 25 of them for a fit."""
    steps: list[int] = []
    usual = RandomWalkSmoother._linear

    def counted(self: RandomWalkSmoother, *arguments: object) -> object:
        steps.append(1)
        return usual(self, *arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(RandomWalkSmoother, "_linear", counted)
    flight = simulate(load_config("demo"), seed=150006, plant=("sticking",)).flight
    motion = reconstruct(flight).motion
    assert np.degrees(np.max(motion.alpha)) > 30.0
    assert len(steps) < 110
