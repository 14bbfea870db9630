"""The integration against closed forms, conserved quantities and its own order."""

from __future__ import annotations

import numpy as np
import pytest

from brv_hypo.arrays import ComplexArray, FloatArray
from brv_hypo.simulation import SimulationConfig, load_config
from brv_hypo.simulation.simulator import Trajectory, flown
from brv_hypo.simulation.vehicle import ATTITUDE, EARTH_RADIUS, RATES, VELOCITY, attitude_matrix, system, transform

BODY = {"mass": 100.0, "ixx": 6.0, "iyy": 60.0, "reference_length": 0.6, "reference_area": 0.28}


def body(*, density: float = 0.0, gravity: float = 0.0, **changes: object) -> SimulationConfig:
    """A body in a uniform gas, by default none, without gravity."""
    data = {
        "duration": 10.0,
        "step": 0.005,
        "sample_rate": 100.0,
        "vehicle": BODY,
        "aerodynamics": {},
        "start": {
            "altitude": 30e3,
            "velocity": 7000.0,
            "flight_path_angle": 0.0,
            "alpha": 0.05,
            "roll_rate": 8.0,
            "alpha_rate": 0.3,
            "coning_rate": -0.2 / np.tan(0.05),
        },
        "environment": {"constant_density": density, "gravity": gravity},
    }
    return load_config({**data, **changes})


def fly(config: SimulationConfig) -> Trajectory:
    return flown(system(config))


def pointing(trajectory: Trajectory) -> ComplexArray:
    """The nose in the frame, y + i z."""
    nose = attitude_matrix(np.moveaxis(trajectory.states[:, ATTITUDE], 1, 0))[:, 0, :, 0]
    return nose[1] + 1j * nose[2]


def momentum(config: SimulationConfig, trajectory: Trajectory) -> tuple[FloatArray, FloatArray]:
    """Angular momentum (3, n) in the frame and rotational energy (n,)."""
    rates = np.moveaxis(trajectory.states[:, RATES], 1, 0)
    spin = system(config).inertia[..., np.newaxis] * rates
    turn = attitude_matrix(np.moveaxis(trajectory.states[:, ATTITUDE], 1, 0))
    return transform(turn, spin)[..., 0], 0.5 * np.sum(rates * spin, axis=0)[..., 0]


def test_torque_free_coning_follows_the_closed_form() -> None:
    """q + i r turns at -(1 - Ix/I) p; p and the cone about the angular momentum stay (Eq. 2.3, no moment)."""
    config = body(step=0.0025, duration=1.0)
    trajectory = fly(config)
    p, q, r = np.moveaxis(trajectory.states[:, RATES, 0], 1, 0)
    turn = -(1.0 - BODY["ixx"] / BODY["iyy"]) * 8.0
    expected = (0.3 - 0.2j) * np.exp(1j * turn * trajectory.nodes)
    np.testing.assert_allclose(q + 1j * r, expected, atol=1e-7)
    np.testing.assert_allclose(p, 8.0, rtol=1e-12)
    axis = momentum(config, trajectory)[0]
    nose = attitude_matrix(np.moveaxis(trajectory.states[:, ATTITUDE], 1, 0))[:, 0, :, 0]
    cosine = np.sum(axis * nose, axis=0) / np.linalg.norm(axis, axis=0)
    np.testing.assert_allclose(cosine, cosine[0], atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("roll_rate", [0.0, 8.0, -25.0])
def test_undamped_linear_epicyclic_frequencies(roll_rate: float) -> None:
    """s'' - i (Ix/I) p s' + w0^2 s = 0 for the nose s in the frame: two frequencies, here to 1e-6."""
    start = {
        "altitude": 30e3,
        "velocity": 7000.0,
        "flight_path_angle": 0.0,
        "alpha": 1e-4,
        "roll_rate": roll_rate,
        "coning_rate": 3.0,
    }
    config = body(density=0.02, step=0.0025, duration=4.0, aerodynamics={"C_malpha": -0.1}, start=start)
    stiffness = 0.5 * 0.02 * 7000.0**2 * BODY["reference_area"] * BODY["reference_length"] * 0.1 / BODY["iyy"]
    half = 0.5 * BODY["ixx"] / BODY["iyy"] * roll_rate
    expected = sorted([half + np.hypot(half, np.sqrt(stiffness)), half - np.hypot(half, np.sqrt(stiffness))])
    trajectory = fly(config)
    np.testing.assert_allclose(_two_frequencies(pointing(trajectory), 0.0025), expected, rtol=1e-6)


def _two_frequencies(series: ComplexArray, step: float, stride: int = 60) -> FloatArray:
    """Prony: s(t + 2h) = a s(t + h) + b s(t) for a sum of two exponentials, h = stride * step."""
    before = np.stack([series[stride:-stride], series[: -2 * stride]], axis=1)
    a, b = np.linalg.lstsq(before, series[2 * stride :], rcond=None)[0]
    return np.sort(np.angle(np.roots([1.0, -a, -b])) / (stride * step))


def test_free_fall_conserves_energy_and_angular_momentum() -> None:
    """A tumbling body under inverse-square gravity, without air."""
    tumbling = {
        "altitude": 60e3,
        "velocity": 3000.0,
        "flight_path_angle": 0.5,
        "alpha": 1.2,
        "roll_rate": 5.0,
        "alpha_rate": 4.0,
        "coning_rate": -3.0 / np.tan(1.2),
    }
    config = body(gravity=9.8, start=tumbling, duration=1.5)
    trajectory = fly(config)
    position, velocity = trajectory.states[:, :3, 0], trajectory.states[:, VELOCITY, 0]
    radius = np.linalg.norm(position - [0.0, 0.0, EARTH_RADIUS], axis=1)
    energy = 0.5 * np.sum(velocity**2, axis=1) - 9.8 * EARTH_RADIUS**2 / radius
    np.testing.assert_allclose(energy, energy[0], rtol=1e-12)
    spin, rotational = momentum(config, trajectory)
    np.testing.assert_allclose(spin, spin[:, :1] * np.ones(spin.shape[1]), atol=1e-7 * np.linalg.norm(spin[:, 0]))
    np.testing.assert_allclose(rotational, rotational[0], rtol=1e-8)


def test_a_fall_from_rest_is_timed_right() -> None:
    """Nearly uniform gravity over a short fall: h = h0 - g t^2 / 2 with g at altitude."""
    config = body(
        gravity=9.81,
        duration=2.0,
        step=0.02,
        sample_rate=50.0,
        start={"altitude": 1000.0, "velocity": 1e-3, "flight_path_angle": 0.0, "alpha": 0.0},
    )
    trajectory = fly(config)
    g = 9.81 * (EARTH_RADIUS / (EARTH_RADIUS + 990.0)) ** 2
    assert -trajectory.states[-1, 2, 0] == pytest.approx(1000.0 - 0.5 * g * 4.0, abs=1e-3)


PLANTS = {
    "nothing": (),
    "sticking": (
        {"mechanism": "sticking", "theta": {"delay": 0.0803}, "terms": {"eps": 0.3}, "start": 0.5013, "stop": 1.1007},
    ),
    "lag from the start": ({"mechanism": "lag", "theta": {"delay": 0.03}, "terms": {"lag fraction": 0.5}},),
    "jump off the grid": ({"mechanism": "inplane", "terms": {"C_m0": 3e-4, "C_malpha": 0.02}, "start": 0.7117},),
    "jump that sticks": (
        {"mechanism": "inplane", "terms": {"C_m0": 3e-4}, "start": 0.7117},
        {"mechanism": "sticking", "theta": {"delay": 0.1}, "terms": {"eps": 0.3}},
    ),
}
THOROUGH = "jump that sticks"
"""A delay and a region that begins between the nodes."""


@pytest.mark.parametrize(
    "plant",
    [pytest.param(plant, marks=pytest.mark.thorough if plant == THOROUGH else pytest.mark.slow) for plant in PLANTS],
)
def test_step_halving_shows_fourth_order(plant: str) -> None:
    """Errors fall sixteenfold, also with delays and with regions that begin between the nodes."""
    cone = load_config("research_cone").model_dump()
    # Nearly a circle: where alpha passes zero the meridian turns too fast for these steps.
    cone["start"]["coning_rate"] = 5.8
    config = load_config({**cone, "mechanisms": PLANTS[plant], "duration": 1.4, "sample_rate": 50.0})
    states = []
    for step in (0.02, 0.01, 0.005):
        trajectory = fly(config.model_copy(update={"step": step}))
        states.append(trajectory.states[trajectory.samples, RATES, 0])
    coarse, fine = np.max(np.abs(states[0] - states[1])), np.max(np.abs(states[1] - states[2]))
    assert fine > 1e-10  # above rounding, else the ratio means nothing
    assert np.log2(coarse / fine) == pytest.approx(4.0, abs=0.15)


@pytest.mark.slow
def test_roll_damping_and_torque_reach_their_balance() -> None:
    """p tends to -2 V C_l0 / (d C_lp) exponentially."""
    config = body(
        density=0.02,
        aerodynamics={"C_l0": 2e-4, "C_lp": -1.0},
        duration=5.0,
        start={"altitude": 30e3, "velocity": 7000.0, "flight_path_angle": 0.0, "alpha": 0.0},
    )
    trajectory = fly(config)
    scale = 0.5 * 0.02 * 7000.0**2 * BODY["reference_area"] * BODY["reference_length"] / BODY["ixx"]
    rate = scale * BODY["reference_length"] / (2.0 * 7000.0)
    final = 2e-4 * scale / rate
    np.testing.assert_allclose(
        trajectory.states[:, 10, 0], final * (1.0 - np.exp(-rate * trajectory.nodes)), rtol=1e-7, atol=1e-9
    )
