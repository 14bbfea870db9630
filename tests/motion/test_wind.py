"""The direction of the velocity is turned by what acts across it, at the speed relative to the air."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

from brv_hypo.motion.inertial import WindStart, body_crossflow, inertial_record, wind_direction
from brv_hypo.motion.methods import ReconstructionConfig
from tests.motion.truth import CONE, Truth, observe


@pytest.mark.parametrize("along", [0.0, 40.0])
def test_a_wind_along_the_track_turns_nothing_of_itself(truths: dict[str, Truth], along: float) -> None:
    """Against u' = (a - (a u) u) / V, integrated; a wind (m/s) along the track changes V and no force.

    At the speed that forces alone would make the direction was off by 1e-3 of its turn and more.
    """
    flight = observe(truths[CONE.name], 0, gyro_noise=0.0, accel_noise=0.0)
    share = (flight.time - flight.time[0]) / (flight.time[-1] - flight.time[0])
    flight = replace(flight, velocity=flight.velocity + along * np.sin(2.0 * np.pi * share))
    record = inertial_record(flight, ReconstructionConfig())
    first = np.array([0.998, 0.05, -0.03])
    start = WindStart(first / np.linalg.norm(first), np.array([2.0, 5.0, 8.0]))
    pull = CubicSpline(record.time, record.force_inertial + start.gravity)
    speed = CubicSpline(record.time, flight.velocity)

    def turning(time: float, direction: np.ndarray) -> np.ndarray:
        return (pull(time) - (pull(time) @ direction) * direction) / speed(time)

    span = (0.0, float(record.time[-1]))
    expected = solve_ivp(turning, span, start.direction, t_eval=record.time, rtol=1e-10, atol=1e-13).y.T
    found = wind_direction(record, start)
    turned = np.linalg.norm(expected - start.direction, axis=1).max()
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=2e-4 * turned)
    body = record.to_body(expected)
    xi = body_crossflow(record, found)
    np.testing.assert_allclose(xi, body[:, 1] + 1j * body[:, 2], rtol=0.0, atol=2e-4 * turned)
