"""Appendix B: each instrument error by itself, on known signals."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from brv_hypo.errors import UsageError
from brv_hypo.simulation import load_config, simulate
from brv_hypo.simulation.simulator import flown
from brv_hypo.simulation.vehicle import ATTITUDE, attitude_matrix, system, to_body, transform

CONE = load_config("research_cone").model_dump(exclude={"plantable"}) | {"duration": 0.5}


def channels(instruments: dict[str, Any], seed: int = 1, **changes: Any) -> dict[str, np.ndarray]:
    flight = simulate(load_config({**CONE, **changes, "instruments": instruments}), seed=seed)
    return {"time": flight.record.time, **flight.record.channels}


CLEAN = channels({})


def test_accelerometer_off_the_cg_feels_the_acceleration_of_its_place() -> None:
    """Against the second derivative of the place in the frame, less gravity, turned into the body."""
    place = [0.3, -0.2, 0.15]
    config = load_config({**CONE, "instruments": {}, "vehicle": CONE["vehicle"] | {"accelerometer_position": place}})
    equations = system(config)
    trajectory = flown(equations)
    turn = attitude_matrix(np.moveaxis(trajectory.states[:, ATTITUDE], 1, 0))[..., 0]
    position = trajectory.states[:, :3, 0].T
    there = position + transform(turn, np.array(place)[:, None] * np.ones(position.shape[1]))
    acceleration = CubicSpline(trajectory.nodes, there - position, axis=1).derivative(2)(trajectory.nodes)
    acceleration += trajectory.rates[:, 3:6, 0].T - equations.gravity_and_altitude(position)[0]
    expected = to_body(turn, acceleration)[:, trajectory.samples]
    found = simulate(config, seed=1).record.channels
    for name, values in zip(("ax", "ay", "az"), expected, strict=True):
        np.testing.assert_allclose(found[name][4:-4], values[4:-4], atol=2e-3)
    assert np.max(np.abs(found["ax"] - CLEAN["ax"])) > 0.3  # the place matters


def test_accelerometers_off_their_declared_place_read_as_before() -> None:
    instruments = {"errors": {"accel_position": {"x": 0.002}}}
    found = simulate(load_config({**CONE, "instruments": instruments}), seed=1).record
    x, y, z = CONE["vehicle"]["accelerometer_position"]
    assert found.vehicle.accelerometer_position == pytest.approx((x - 0.002, y, z))
    np.testing.assert_array_equal(found.channels["ay"], CLEAN["ay"])


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


def test_one_instruments_errors_do_not_change_the_draws_of_the_others() -> None:
    some = channels({"gyro": {"noise": 0.01}, "accelerometer": {"noise": 0.1}})
    other = channels({"accelerometer": {"noise": 0.1}})
    np.testing.assert_array_equal(some["ay"], other["ay"])


def test_errors_are_those_of_the_record_effects_in_the_order_given() -> None:
    errors = {
        "gyro_misalignment": {"x": 0.01},
        "gyro_scale": {"q": 0.02, "r": 0.03},
        "gyro_bias": {"p": 0.1, "q": 0.2},
        "dynamic_pressure_scale": {"scale": 0.005},
    }
    found = channels({"errors": errors})
    expected = {
        "p": CLEAN["p"] + 0.1,
        "q": 1.02 * (CLEAN["q"] + 0.01 * CLEAN["r"]) + 0.2,
        "r": 1.03 * (CLEAN["r"] - 0.01 * CLEAN["q"]),
        "dynamic_pressure": 1.005 * CLEAN["dynamic_pressure"],
        "velocity": CLEAN["velocity"],
        "az": CLEAN["az"],
    }
    for name, values in expected.items():
        np.testing.assert_allclose(found[name], values, rtol=1e-12, atol=1e-12)


def test_errors_do_not_change_the_noise() -> None:
    noise = {"accelerometer": {"noise": 0.1}}
    found = channels({**noise, "errors": {"accel_scale": {"y": 0.5}}})
    np.testing.assert_allclose(found["ay"] - channels(noise)["ay"], 0.5 * CLEAN["ay"], atol=1e-12)


@pytest.mark.parametrize(
    ("errors", "message"),
    [
        ({"gyro_bais": {"q": 0.1}}, "did you mean gyro_bias"),
        ({"gyro_bias": {"Q": 0.1}}, "no component 'Q'.*p, q, r"),
        ({"trim": {"C_m0": 0.1}}, "plant it under `mechanisms`"),
    ],
)
def test_errors_that_no_effect_has_are_refused(errors: dict[str, Any], message: str) -> None:
    with pytest.raises(UsageError, match=message):
        channels({"errors": errors})


@pytest.mark.parametrize(("key", "effect"), [("bias", "gyro_bias"), ("misalignment", "gyro_misalignment")])
def test_an_error_beside_the_noise_is_sent_to_its_effect(key: str, effect: str) -> None:
    with pytest.raises(UsageError, match=f"'{effect}' meant.*instruments.errors"):
        channels({"gyro": {key: [0.0, 0.0, 0.1]}})


@pytest.mark.parametrize("delay", [0.0005, 0.005, 0.0125, -0.01])
def test_a_late_clock_shows_the_past(delay: float) -> None:
    """The record's ends, which the effect continues straight on, leave ripples of 1e-6 of the range further in."""
    found = channels({"errors": {"time_skew": {"accelerometers": delay}}})
    expected = CubicSpline(CLEAN["time"], CLEAN["az"])(CLEAN["time"] - delay)
    np.testing.assert_allclose(found["az"][20:-20], expected[20:-20], atol=1e-6 * np.ptp(CLEAN["az"]))
    np.testing.assert_array_equal(found["q"], CLEAN["q"])


def test_spikes_have_their_count_and_size() -> None:
    found = channels({"spikes": [{"channel": "q", "count": 4, "size": 2.0}]})
    off = np.abs(found["q"] - CLEAN["q"])
    assert np.count_nonzero(off) == 4
    np.testing.assert_allclose(off[off > 0], 2.0)


def test_gaps_are_missing_samples_and_load_bridged_or_cut() -> None:
    instruments = {"gaps": [{"start": 0.3, "duration": 0.015, "channels": ["q"]}, {"start": 0.6, "duration": 0.2}]}
    flight = simulate(load_config({**CONE, "duration": 1.0, "instruments": instruments}), seed=1)
    missing = np.isnan(flight.record.channels["q"])
    time = flight.record.time
    expected = ((time > 0.299) & (time < 0.314)) | ((time > 0.599) & (time < 0.799))
    np.testing.assert_array_equal(missing, expected)
    assert flight.flight.segments == ((0, 120), (160, 201))
    np.testing.assert_allclose(flight.flight.q[:100], CLEAN["q"][:100], atol=1e-4)


@pytest.mark.thorough
def test_random_gaps_follow_the_seed() -> None:
    instruments = {"gaps": [{"duration": 0.02, "count": 5, "channels": ["velocity"]}]}
    first, again, other = (np.isnan(channels(instruments, seed=s)["velocity"]) for s in (3, 3, 4))
    assert 4 <= np.count_nonzero(first) <= 20
    np.testing.assert_array_equal(first, again)
    assert np.any(first != other)


def test_a_gap_with_a_start_is_one_gap() -> None:
    with pytest.raises(UsageError, match="one gap"):
        channels({"gaps": [{"start": 0.3, "duration": 0.1, "count": 2}]})
