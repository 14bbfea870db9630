"""Frames, atmosphere and the first state: what is configured is what is flown."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from brv_hypo.simulation import load_config
from brv_hypo.simulation.vehicle import (
    WindProfile,
    attitude_matrix,
    attitude_rate,
    from_pitch_roll,
    initial_state,
    standard_air,
    system,
)

angles = st.floats(-3.0, 3.0)
CONE = load_config("research_cone").model_dump(exclude={"plantable"})


@pytest.mark.parametrize(
    ("altitude", "density", "speed_of_sound"),
    # US Standard Atmosphere, 1976, Table I and III (geometric altitude): kg/m^3 to 4 digits, m/s to 5.
    [(0.0, 1.2250, 340.29), (10e3, 0.41351, 299.53), (20e3, 0.088910, 295.07), (30e3, 0.018410, 301.71)],
)
def test_standard_air(altitude: float, density: float, speed_of_sound: float) -> None:
    rho, sound, _ = standard_air(np.array([altitude]))
    assert rho[0] == pytest.approx(density, rel=2e-4)
    assert sound[0] == pytest.approx(speed_of_sound, rel=2e-5)


@given(st.lists(st.floats(-2.0, 2.0), min_size=4, max_size=4).filter(lambda q: np.hypot(*q[:2]) > 0.1))
def test_rotations_are_proper_at_any_scale_of_the_quaternion(quaternion: list[float]) -> None:
    turn = attitude_matrix(np.array(quaternion))
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(turn) == pytest.approx(1.0)


@given(angles, angles, st.tuples(angles, angles, angles))
def test_the_quaternions_rate_turns_the_axes_at_the_body_rates(
    pitch: float, roll: float, rates: tuple[float, float, float]
) -> None:
    """d(matrix)/dt = matrix [omega x], by central difference."""
    attitude, omega = from_pitch_roll(np.array(pitch), np.array(roll)), np.array(rates)
    change = 1e-6 * attitude_rate(attitude, omega)
    slope = (attitude_matrix(attitude + change) - attitude_matrix(attitude - change)) / 2e-6
    np.testing.assert_allclose(slope, attitude_matrix(attitude) @ np.cross(np.eye(3), omega), atol=1e-8)


@given(
    alpha=st.floats(0.001, 3.1).filter(lambda a: abs(a - np.pi / 2) > 0.05),
    meridian=angles,
    path=st.floats(-1.5, 1.5),
    alpha_rate=angles,
    coning=angles,
)
def test_the_start_is_as_configured(
    alpha: float, meridian: float, path: float, alpha_rate: float, coning: float
) -> None:
    """Alpha over the whole sphere, its meridian and both rates, in a wind, without forces."""
    start = {
        "altitude": 30e3,
        "velocity": 5000.0,
        "flight_path_angle": path,
        "alpha": alpha,
        "windward_meridian": meridian,
        "alpha_rate": alpha_rate,
        "coning_rate": coning,
        "roll_rate": 4.0,
    }
    wind = WindProfile(0.0, 1.0, np.repeat([[30.0], [-20.0], [10.0]], 2, axis=1))
    config = load_config({**CONE, "start": start, "environment": {"constant_density": 0.0, "gravity": 0.0}})
    equations = replace(system(config), wind_profile=wind)
    state, time = initial_state(equations), np.zeros(1)
    air = equations.air_data(time, state)
    motion = equations.motion(time, state, air, np.array([meridian]), None)
    assert motion.velocity[0] == pytest.approx(5000.0)
    assert motion.alpha[0] == pytest.approx(alpha, abs=1e-9)
    assert motion.windward_meridian[0] == pytest.approx(meridian, abs=1e-9)
    assert motion.alpha_rate[0] == pytest.approx(alpha_rate, abs=1e-5)
    assert motion.windward_meridian_rate[0] == pytest.approx(4.0 - coning, abs=1e-4)
