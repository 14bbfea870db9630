"""Readings against the simulator's instruments, written independently of them."""

from __future__ import annotations

import numpy as np
import pytest

from brv_hypo.identification.instruments import InstrumentReadings, lever_force, of_flight

RNG = np.random.default_rng(3)
OMEGA, CHANGE, FORCE = RNG.standard_normal((3, 3, 20))


def test_lever_force_is_that_of_the_conventions():
    arm = (0.3, -0.2, 0.1)
    expected = np.cross(CHANGE.T, arm) + np.cross(OMEGA.T, np.cross(OMEGA.T, arm))
    found = lever_force(arm, OMEGA[1] + 1j * OMEGA[2], CHANGE[1] + 1j * CHANGE[2], OMEGA[0], CHANGE[0])
    np.testing.assert_allclose(found, expected[:, 1] + 1j * expected[:, 2], atol=1e-14)


@pytest.mark.parametrize("kind", ["gyro", "accel"])
def test_a_triad_turns_then_scales_then_shifts(kind):
    axes = "qr" if kind == "gyro" else "yz"
    turn, scale, bias = np.array([0.01, -0.02, 0.03]), (0.1, -0.2), (0.5, -0.7)
    theta = {f"{kind}_misalignment {axis}": value for axis, value in zip("xyz", turn, strict=True)}
    theta |= {f"{kind}_scale {axis}": value for axis, value in zip(axes, scale, strict=True)}
    theta |= {f"{kind}_bias {axis}": value for axis, value in zip(axes, bias, strict=True)}
    readings = InstrumentReadings({of_flight(name, 2): value for name, value in theta.items()}, 2)
    turned = FORCE + np.cross(FORCE.T, turn).T
    expected = (1.0 + scale[0]) * turned[1] + bias[0] + 1j * ((1.0 + scale[1]) * turned[2] + bias[1])
    read = readings.gyros if kind == "gyro" else readings.accelerometers
    np.testing.assert_allclose(read(FORCE[1] + 1j * FORCE[2], FORCE[0]), expected, atol=1e-14)


def test_another_flights_errors_do_not_show():
    readings = InstrumentReadings({of_flight("accel_bias y", 0): 1.0}, 1)
    signal = FORCE[1] + 1j * FORCE[2]
    np.testing.assert_array_equal(readings.accelerometers(signal, FORCE[0]), signal)
