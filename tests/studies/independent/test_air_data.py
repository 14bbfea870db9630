"""Speed and pressure freed of noise: what smoothing keeps of it, or adds, is no mechanism however quiet the gyros."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from brv_hypo.model.reconstruction import reconstruct
from brv_hypo.motion.inputs import smooth_inputs
from tests.studies.independent.flights import draw_flight
from tests.studies.independent.study import MIXED, Outcome, fly
from tests.studies.independent.vehicles import CAPSULE


@pytest.mark.thorough
def test_accelerometers_that_turn_about_the_axis_do_not_correct_speed() -> None:
    """Half a metre off the axis of a body that spins at 20 rad/s they sense 200 m/s^2 that are no drag."""
    vehicle = replace(CAPSULE.vehicle, accelerometer_position=(0.0, 0.5, 0.0))
    made = draw_flight(
        7, truth="none", grade="laboratory", factor=0.0, vehicle=replace(CAPSULE, vehicle=vehicle, roll_rate=20.0)
    )
    speed = smooth_inputs(reconstruct(made.flight)).speed
    assert np.std(speed / made.true.velocity) < 5e-6


@pytest.mark.thorough
@pytest.mark.parametrize("seed", [121047, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (121020, 121058))])
def test_noise_of_the_pressure_is_no_mechanism(seed: int) -> None:
    """Flights of drawn vehicles with laboratory instruments: two of these were named `inplane` at 0.92."""
    found = fly(seed, 0, MIXED, 1.0, 0, coloured=True, drawn=True)
    assert isinstance(found, Outcome)
    assert found.leads == "none"
    assert found.winner in (None, "none")
