"""Attitude, noise levels and the move to the c.g., against closed forms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from brv_hypo.errors import UnanswerableError
from brv_hypo.motion.inertial import derolled_attitude, inertial_record
from brv_hypo.motion.methods import ReconstructionConfig
from brv_hypo.motion.responses import EffectFit, EffectResponses, Perturbation
from brv_hypo.motion.signals import white_noise_level
from tests.motion.truth import CONE, Truth, observe


@given(rate=st.floats(0.05, 2.0), turn=st.floats(-6.0, 6.0))
def test_torque_free_coning_closes_its_cone(rate: float, turn: float) -> None:
    # A transverse rate of constant size that turns at a constant rate carries the nose round the fixed axis
    # (turn, rate, 0) of the first sample.
    time = np.linspace(0.0, 6.0, 1201)
    attitude = derolled_attitude(time, rate * np.exp(1j * turn * time))
    axis = np.array([turn, rate, 0.0]) / np.hypot(rate, turn)
    nose = attitude[:, :, 0]
    np.testing.assert_allclose(nose @ axis, axis[0], rtol=0.0, atol=2e-9)
    orthogonal = np.einsum("nij,nkj->nik", attitude, attitude)
    np.testing.assert_allclose(orthogonal, np.broadcast_to(np.eye(3), attitude.shape), rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("sigma", [1e-5, 3.5e-4, 1e-2])
def test_noise_level_is_found_under_a_strong_motion(sigma: float) -> None:
    rng = np.random.default_rng(5)
    time = np.arange(2000)
    motion = 2.0 * np.sin(2.0 * np.pi * time / 20.0)
    levels = [white_noise_level(motion + sigma * rng.standard_normal(time.size), ((0, 2000),)) for _ in range(20)]
    # At 20 samples a cycle the motion itself leaves 2e-6 of its size.
    assert np.mean(levels) == pytest.approx(sigma, rel=0.05, abs=5e-6)


def test_noise_level_ignores_spikes_and_counts_rounding() -> None:
    rng = np.random.default_rng(6)
    spiky = rng.standard_normal(3000)
    spiky[::151] += 100.0
    assert white_noise_level(spiky, ((0, 3000),)) == pytest.approx(1.0, rel=0.15)
    rounded = np.round(np.sin(np.arange(3000) / 500.0), 2)
    assert white_noise_level(rounded, ((0, 3000),)) >= 0.01 / np.sqrt(12.0) * 0.99


def test_force_is_moved_to_the_cg(truths: dict[str, Truth]) -> None:
    truth = truths["cone"]
    quiet = {"gyro_noise": 0.0, "accel_noise": 0.0}
    far = inertial_record(observe(truth, 0, **quiet), ReconstructionConfig())
    c = truth.scenario
    scale = truth.pressure * c.vehicle.reference_area / c.vehicle.mass
    expected = -scale * c.normal_slope * truth.alpha * (np.sin(truth.meridian) + 1j * np.cos(truth.meridian))
    assert far.transverse_force[20:-20] == pytest.approx(expected[20:-20], abs=2e-3 * np.abs(expected).max())
    assert far.force[20:-20, 0] == pytest.approx(-scale[20:-20] * c.axial, rel=1e-3)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"segments": ((0, 10), (20, 30))}, "10 samples"),
        ({"velocity": np.zeros(1081)}, "velocity falls to 0"),
        ({"dynamic_pressure": np.full(1081, np.nan)}, "dynamic_pressure falls to nan"),
    ],
)
def test_what_cannot_be_integrated_is_refused(truths: dict[str, Truth], change: dict, words: str) -> None:
    flight = replace(observe(truths[CONE.name], 0), **change)
    with pytest.raises(UnanswerableError, match=words):
        inertial_record(flight, ReconstructionConfig())


def test_errors_that_leave_no_pressure_are_refused_by_name(truths: dict[str, Truth]) -> None:
    """Moments over a pressure below zero would have errors below zero."""
    flight = observe(truths[CONE.name], 1)
    effect = Perturbation(
        *("dynamic_pressure_scale", "", "1"),
        size=0.5,
        apply=lambda flight, value: replace(flight, dynamic_pressure=flight.dynamic_pressure * (1.0 + value)),
    )
    responses = replace(EffectResponses.none(inertial_record(flight, ReconstructionConfig())), effects=(effect,))
    found = EffectFit(responses, np.zeros(1), np.array([1.0]), np.eye(1))
    np.testing.assert_allclose(found.corrected(flight).dynamic_pressure, 0.5 * flight.dynamic_pressure)
    with pytest.raises(UnanswerableError, match=r"many times their tolerances \(dynamic_pressure_scale  3\)"):
        replace(found, value=np.array([3.0])).corrected(flight)
