"""The motion and the flight record that plugins are checked on: closed-form, so that the past is exact."""

from __future__ import annotations

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.flight.record import Flight, Vehicle
from brv_hypo.motion.kinematics import angle_of_attack, angle_rates
from brv_hypo.motion.motion import Motion

DURATION = 6.0
"""Seconds of the sample motion and of the sample record."""

_SLOW, _FAST = (
    0.05,
    0.012,
)  # crossflow amplitudes of the two epicyclic arms; unequal, so alpha stays above zero
_SLOW_RATE, _FAST_RATE = 7.3, -11.9  # rad/s
_FORCE_SLOPE, _MOMENT_SLOPE = 2.0, -0.3  # 1/rad


def sample_motion(time: FloatArray) -> Motion:
    """An epicyclic entry motion at `time` (s, any shape), 0 to DURATION; `delayed` is exact.

    alpha goes from 2 to 4 deg, the meridian turns at 5 to 12 rad/s, Mach falls from 22 and Reynolds grows
    from 1e5, so that a mechanism of any of these has something to act on.
    """
    arm = _FAST / _SLOW * np.exp(1j * (_FAST_RATE - _SLOW_RATE) * time)
    turn = np.exp(1j * _SLOW_RATE * time)
    crossflow = _SLOW * turn * (1.0 + arm)
    crossflow_rate = 1j * _SLOW * turn * (_SLOW_RATE + _FAST_RATE * arm)
    alpha = angle_of_attack(crossflow)
    alpha_rate, meridian_rate = angle_rates(crossflow, crossflow_rate)
    velocity = 6900.0 - 40.0 * time
    return Motion(
        time=time,
        alpha=alpha,
        alpha_rate=alpha_rate,
        windward_meridian=0.5 * np.pi - (_SLOW_RATE * time + np.angle(1.0 + arm)),
        windward_meridian_rate=meridian_rate,
        p=12.0 + 0.1 * time,
        q=0.4 * np.cos(7.0 * time),
        r=0.4 * np.sin(7.0 * time),
        velocity=velocity,
        dynamic_pressure=2e4 * np.exp(0.3 * time),
        mach=velocity / 310.0,
        reynolds=1e5 * np.exp(0.8 * time),
        in_plane_moment=-0.001 + _MOMENT_SLOPE * alpha,
        reference_length=0.4,
        history=lambda tau: sample_motion(time - tau),
    )


def uniform_time(samples: int = 600) -> FloatArray:
    """Sample times over the whole sample motion, s."""
    return np.linspace(0.0, DURATION, samples, endpoint=False)


def sample_flight() -> Flight:
    """A short record of the sample motion: what its instruments would read, without noise."""
    motion = sample_motion(uniform_time())
    vehicle = Vehicle(
        mass=100.0,
        ixx=1.5,
        iyy=10.0,
        reference_length=motion.reference_length,
        reference_area=0.125,
        accelerometer_position=(0.1, 0.02, -0.01),
    )
    normal = motion.dynamic_pressure * vehicle.reference_area * _FORCE_SLOPE * motion.alpha / vehicle.mass
    return Flight(
        time=motion.time,
        p=motion.p,
        q=motion.q,
        r=motion.r,
        ax=-0.1 * motion.dynamic_pressure * vehicle.reference_area / vehicle.mass,
        ay=-normal * np.sin(motion.windward_meridian),
        az=-normal * np.cos(motion.windward_meridian),
        velocity=motion.velocity,
        dynamic_pressure=motion.dynamic_pressure,
        mach=motion.mach,
        reynolds=motion.reynolds,
        vehicle=vehicle,
        title="sample of the conformance kit",
    )
