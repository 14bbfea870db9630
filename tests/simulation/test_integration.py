"""The integration where the windward meridian turns fast."""

from __future__ import annotations

import numpy as np
import pytest

from brv_hypo.simulation import SimulationConfig, load_config, simulate


def flown(step: float) -> tuple[np.ndarray, np.ndarray]:
    """Rates q + i r (n,) of a lagging flight without noise that passes close by alpha = 0, and alpha (n,)."""
    data = load_config("research_cone", plant=("lag",)).model_dump()
    data["step"] = step
    data["start"] |= {"alpha": 0.0430, "windward_meridian": -1.8604, "roll_rate": 9.0600, "coning_rate": 4.8608}
    for name in ("gyro", "accelerometer", "velocity", "dynamic_pressure", "altitude"):
        data["instruments"][name]["noise"] = 0.0
    data["mechanisms"] = [data["mechanisms"][0] | {"start": 1.8759, "stop": 3.0759}]
    found = simulate(SimulationConfig.model_validate(data), seed=1)
    return found.flight.q + 1j * found.flight.r, found.truth.alpha


@pytest.mark.slow
def test_steps_are_cut_where_a_lagging_moment_turns_with_the_meridian():
    """With uncut steps of 5 ms such a flight is off by 30 times the gyros' noise (0.01 rad/s)."""
    coarse, alpha = flown(0.005)
    fine, _ = flown(0.000625)
    assert np.degrees(alpha.min()) < 0.3
    assert np.max(np.abs(coarse - fine)) < 1e-4
