"""Appendix B: each instrument error by itself, on known signals."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from brv_hypo.errors import UsageError
from brv_hypo.simulation import load_config, simulate
from brv_hypo.simulation.dynamics import ATTITUDE
from brv_hypo.simulation.rotation import matrix, to_body, to_frame
from brv_hypo.simulation.simulator import flown
from brv_hypo.simulation.system import system

CONE = load_config("research_cone").model_dump(exclude={"plantable"}) | {"duration": 1.0}


def channels(instruments: dict[str, Any], seed: int = 1, **changes: Any) -> dict[str, np.ndarray]:
    flight = simulate(load_config({**CONE, **changes, "instruments": instruments}), seed=seed)
    return {"time": flight.record.time, **flight.record.channels}


CLEAN = channels({})


def test_accelerometer_off_the_cg_feels_the_acceleration_of_its_place() -> None:
    """Against the second derivative of the place in the frame, less gravity, turned into the body."""
    place = [0.3, -0.2, 0.15]
    config = load_config({**CONE, "instruments": {"accelerometer": {"position": place}}})
    equations = system((config,))
    trajectory = flown((config,), equations, lambda fraction: None)
    turn = matrix(np.moveaxis(trajectory.states[:, ATTITUDE], 1, 0))[..., 0]
    position = trajectory.states[:, :3, 0].T
    there = position + to_frame(turn, np.array(place)[:, None] * np.ones(position.shape[1]))
    acceleration = CubicSpline(trajectory.nodes, there - position, axis=1).derivative(2)(trajectory.nodes)
    acceleration += trajectory.rates[:, 3:6, 0].T - equations.gravity_and_altitude(position)[0]
    expected = to_body(turn, acceleration)[:, trajectory.samples]
    found = simulate(config, seed=1).record.channels
    for name, values in zip(("ax", "ay", "az"), expected, strict=True):
        np.testing.assert_allclose(found[name][4:-4], values[4:-4], atol=2e-3)
    assert np.max(np.abs(found["ax"] - CLEAN["ax"])) > 0.3  # the place matters


def test_record_declares_the_vehicles_position_not_the_true_one() -> None:
    flight = simulate(
        load_config({**CONE, "instruments": {"accelerometer": {"position": [0.3, 0.0, 0.0]}}}), seed=1
    )
    assert flight.record.vehicle.accelerometer_position == tuple(CONE["vehicle"]["accelerometer_position"])


@pytest.mark.slow
def test_noise_has_its_standard_deviation_and_follows_the_seed() -> None:
    """241 x 3 draws: the standard deviation within 10 % at four sigma."""
    noisy = channels({"gyro": {"noise": 0.01}}, duration=2.0)
    clean = channels({}, duration=2.0)
    errors = np.concatenate([noisy[name] - clean[name] for name in ("p", "q", "r")])
    assert np.std(errors) == pytest.approx(0.01, rel=4.0 / np.sqrt(2.0 * errors.size))
    assert abs(np.mean(errors)) < 4.0 * 0.01 / np.sqrt(errors.size)
    np.testing.assert_array_equal(noisy["ax"], clean["ax"])
    np.testing.assert_array_equal(channels({"gyro": {"noise": 0.01}}, duration=2.0)["q"], noisy["q"])
    assert np.all(channels({"gyro": {"noise": 0.01}}, seed=2, duration=2.0)["q"] != noisy["q"])


def test_one_instruments_errors_leave_the_draws_of_the_others() -> None:
    some = channels({"gyro": {"noise": 0.01}, "accelerometer": {"noise": 0.1}})
    other = channels({"accelerometer": {"noise": 0.1}})
    np.testing.assert_array_equal(some["ay"], other["ay"])


def test_bias_and_scale() -> None:
    found = channels(
        {
            "gyro": {"bias": [0.1, 0.2, 0.3], "scale": [0.01, 0.02, 0.03]},
            "velocity": {"bias": 3.0, "scale": -0.01},
        }
    )
    for name, bias, scale in (("p", 0.1, 0.01), ("q", 0.2, 0.02), ("r", 0.3, 0.03), ("velocity", 3.0, -0.01)):
        np.testing.assert_allclose(found[name], (1.0 + scale) * CLEAN[name] + bias, rtol=1e-12)


def test_misalignment_turns_the_axes() -> None:
    """Instrument axes turned by a small angle about x see y + angle z and z - angle y."""
    found = channels({"gyro": {"misalignment": [0.01, 0.0, 0.0]}})
    np.testing.assert_allclose(found["q"], CLEAN["q"] + 0.01 * CLEAN["r"], atol=1e-12)
    np.testing.assert_allclose(found["r"], CLEAN["r"] - 0.01 * CLEAN["q"], atol=1e-12)
    np.testing.assert_allclose(found["p"], CLEAN["p"], atol=1e-12)


@pytest.mark.parametrize("delay", [0.005, 0.0125, -0.01])
def test_a_late_clock_shows_the_past(delay: float) -> None:
    found = channels({"gyro": {"delay": delay}})
    expected = CubicSpline(CLEAN["time"], CLEAN["q"])(CLEAN["time"] - delay)
    np.testing.assert_allclose(found["q"][5:-5], expected[5:-5], atol=2e-6)
    np.testing.assert_array_equal(found["az"], CLEAN["az"])


def test_averaged_samples_are_means_over_the_interval_before() -> None:
    found = channels({"averaged": True})
    spline = CubicSpline(CLEAN["time"], CLEAN["r"])
    expected = [spline.integrate(t - 0.005, t) / 0.005 for t in CLEAN["time"][1:]]
    np.testing.assert_allclose(found["r"][1:], expected, atol=1e-6)


def test_spikes_stand_out_where_they_were_put() -> None:
    found = channels({"spikes": [{"channel": "q", "count": 4, "size": 2.0}]})
    off = np.abs(found["q"] - CLEAN["q"])
    assert np.count_nonzero(off) == 4
    np.testing.assert_allclose(off[off > 0], 2.0)


def test_gaps_are_missing_samples_and_load_bridged_or_cut() -> None:
    instruments = {
        "gaps": [{"start": 0.3, "duration": 0.015, "channels": ["q"]}, {"start": 0.6, "duration": 0.2}]
    }
    flight = simulate(load_config({**CONE, "instruments": instruments}), seed=1)
    missing = np.isnan(flight.record.channels["q"])
    time = flight.record.time
    expected = ((time > 0.299) & (time < 0.314)) | ((time > 0.599) & (time < 0.799))
    np.testing.assert_array_equal(missing, expected)
    assert flight.flight.segments == ((0, 120), (160, 201))
    np.testing.assert_allclose(flight.flight.q[:120], CLEAN["q"][:120], atol=1e-4)


def test_random_gaps_follow_the_seed() -> None:
    instruments = {"gaps": [{"duration": 0.02, "count": 5, "channels": ["velocity"]}]}
    first, again, other = (np.isnan(channels(instruments, seed=s)["velocity"]) for s in (3, 3, 4))
    assert 4 <= np.count_nonzero(first) <= 20
    np.testing.assert_array_equal(first, again)
    assert np.any(first != other)


def test_magnetometer_is_recorded_where_it_is_carried() -> None:
    found = channels({"roll_rate_mag": {"bias": 0.5}})
    np.testing.assert_allclose(found["roll_rate_mag"], CLEAN["p"] + 0.5, atol=1e-12)
    assert "roll_rate_mag" not in CLEAN


def test_a_gap_with_a_start_is_one_gap() -> None:
    with pytest.raises(UsageError, match="one gap"):
        channels({"gaps": [{"start": 0.3, "duration": 0.1, "count": 2}]})
