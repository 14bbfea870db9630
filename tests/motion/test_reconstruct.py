"""The reconstruction against an independent truth, and on the measured record."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from brv_hypo.errors import UnanswerableError
from brv_hypo.flight import load_flight
from brv_hypo.flight.clock import crossed
from brv_hypo.flight.tolerances import of_grade, with_stated
from brv_hypo.mechanisms.conformance import sample_flight
from brv_hypo.model.reconstruction import reconstruct as reconstruct_record
from brv_hypo.motion import Perturbation, Reconstruction, ReconstructionConfig, reconstruct
from tests.motion.study import Score, score, score_with_errors
from tests.motion.truth import CAPSULE, CONE, SLENDER, Scenario, Truth, fly, observe
from tests.shared_data import shared_file

SEEDS = range(12)


@pytest.fixture(scope="module")
def cone(truths: dict[str, Truth]) -> Reconstruction:
    return reconstruct(observe(truths["cone"], 1))


@pytest.fixture(scope="module")
def scored(truths: dict[str, Truth]) -> Callable[[str], Score]:
    """The score of a scenario as its own instruments measure it, over all seeds."""
    return cache(lambda name: score(truths[name], SEEDS))


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["cone", pytest.param("slender", marks=pytest.mark.slow)])
def test_accuracy_at_200_hz(scored: Callable[[str], Score], name: str) -> None:
    found = scored(name)
    assert found.alpha_deg < 0.003
    assert found.phi_w_rad < 0.005
    assert found.moment_percent < 2.0


@pytest.mark.slow
def test_blunt_capsule_is_limited_by_its_small_normal_force(scored: Callable[[str], Score]) -> None:
    # The normal force is 13 times the accelerometers' noise: a coarser, but honest, answer.
    found = scored("capsule")
    assert found.alpha_deg < 0.01
    assert found.phi_w_rad < 0.005
    assert found.moment_percent < 2.0


@pytest.mark.parametrize(
    "name", ["cone", *(pytest.param(name, marks=pytest.mark.slow) for name in ("capsule", "slender"))]
)
def test_stated_sigmas_are_right_within_30_percent(scored: Callable[[str], Score], name: str) -> None:
    found = scored(name)
    assert 0.7 < found.alpha_ratio < 1.3
    assert 0.7 < found.phi_w_ratio < 1.3
    assert 0.7 < found.moment_ratio < 1.3


@pytest.mark.slow
@pytest.mark.parametrize("noise", [0.1, 5.0])
def test_sigmas_follow_the_noise(truths: dict[str, Truth], noise: float) -> None:
    found = score(
        truths["slender"], SEEDS, gyro_noise=noise * SLENDER.gyro_noise, accel_noise=noise * SLENDER.accel_noise
    )
    assert 0.7 < found.alpha_ratio < 1.3
    assert 0.7 < found.phi_w_ratio < 1.3
    assert 0.7 < found.moment_ratio < 1.3


@pytest.mark.parametrize(
    "scenario",
    [
        pytest.param(replace(CONE, roll_rate=20.0, duration=3.0), id="fast roll", marks=pytest.mark.thorough),
        pytest.param(replace(CONE, roll_rate=0.2), id="slow roll", marks=pytest.mark.slow),
        pytest.param(replace(CONE, alpha=np.radians(12.0)), id="12 deg", marks=pytest.mark.slow),
        pytest.param(replace(CONE, trim=0.002 + 0.001j), id="trim", marks=pytest.mark.slow),
        pytest.param(replace(SLENDER, sample_rate=50.0), id="50 Hz", marks=pytest.mark.slow),
        pytest.param(replace(CONE, gravity=3.71, planet="mars"), id="Mars", marks=pytest.mark.slow),
        pytest.param(replace(CONE, planet="unheard of"), id="unknown planet", marks=pytest.mark.slow),
    ],
)
def test_accuracy_elsewhere(scenario: Scenario) -> None:
    found = score(fly(scenario), range(4))
    assert found.alpha_deg < 0.003
    assert found.phi_w_rad < 0.005
    assert found.moment_percent < 2.0


@pytest.mark.slow
def test_biases_within_the_tolerances_are_borne_and_found(truths: dict[str, Truth]) -> None:
    biases = {"gyro_bias": (2e-4, -3e-4, 2e-4), "accel_bias": (0.05, 0.03, -0.04)}
    known = with_stated(of_grade("tactical"), {"accel_bias": 0.05})
    found = reconstruct_record(replace(observe(truths["cone"], 0, **biases), instruments=known))
    error = np.sqrt(np.mean((found.motion.alpha - truths["cone"].alpha) ** 2))
    assert np.degrees(error) < 0.003
    assert error < 2.0 * found.alpha_rms_sigma
    bias = {e.component: e for e in found.effects if e.effect == "accel_bias"}
    for axis, true in zip("yz", (0.03, -0.04), strict=True):
        assert abs(bias[axis].value - true) < 3.0 * bias[axis].std_error
        assert bias[axis].std_error < bias[axis].size


@pytest.mark.slow
def test_stated_sigmas_count_what_the_tolerances_allow() -> None:
    """Every error drawn at its tolerance, c.g. and axis of inertia too: stated sigmas neither claim more than the
    record shows nor give it up.

    The error of one flight is that of a few unknowns, so that single flights scatter as |N(0, 1)| does.
    """
    flights = [
        score_with_errors(replace(scenario, sample_rate=100.0), seed, "tactical")
        for scenario in (CONE, CAPSULE, SLENDER)
        for seed in range(4)
    ]
    honesty = np.array([flight.honesty for flight in flights])
    assert np.all(np.median(honesty, axis=0) > 0.7)
    assert np.all(np.median(honesty, axis=0) < 1.6)
    assert np.mean(honesty >= 0.5) >= 0.9
    assert np.degrees(max(flight.error[0] for flight in flights)) < 0.15


def test_an_error_without_effect_on_the_record_is_no_nuisance(truths: dict[str, Truth]) -> None:
    flight = observe(truths["cone"], 0)
    idle = Perturbation("idle", "x", "1", 1.0, lambda record, value: record)
    assert reconstruct(flight, None, (idle,)).effects == ()


def test_the_estimate_of_an_error_is_subtracted_in_the_corrected_flight(truths: dict[str, Truth]) -> None:
    flight = observe(truths["cone"], 0)
    bias = Perturbation("bias", "q", "rad/s", 1e-3, lambda record, value: replace(record, q=record.q + value))
    found = reconstruct(bias.apply(flight, 2e-3), None, (bias,))
    assert found.effects[0].value == pytest.approx(2e-3, abs=3.0 * found.effects[0].std_error)
    assert found.corrected.q == pytest.approx(found.flight.q - found.effects[0].value, abs=1e-12)
    assert found.moments.noise_sigma == pytest.approx(reconstruct(flight).moments.noise_sigma, rel=0.1)
    assert np.all(found.moments.sigma >= found.moments.noise_sigma)


def test_a_normal_force_of_nothing_is_replaced_by_the_static_moment() -> None:
    truth = fly(replace(CONE, normal_slope=0.0, duration=2.7))
    result = reconstruct(observe(truth, 2))
    assert result.status == "degraded"
    assert any("static moment measures" in text for text in result.warnings)
    assert np.degrees(np.sqrt(np.mean((result.motion.alpha - truth.alpha) ** 2))) < 0.01


@pytest.mark.parametrize("method", ["velocity", "rates"])
@pytest.mark.parametrize(
    "name", ["cone", *(pytest.param(name, marks=pytest.mark.slow) for name in ("capsule", "slender"))]
)
def test_untied_methods_are_near_and_state_their_error(truths: dict[str, Truth], name: str, method: str) -> None:
    found = score(truths[name], range(3), ReconstructionConfig(method=method))
    assert found.alpha_deg < 0.15
    assert 0.3 < found.alpha_ratio < 2.5


def test_kinematic_rates_are_those_of_the_angles(truths: dict[str, Truth], cone: Reconstruction) -> None:
    truth, motion = truths["cone"], cone.motion
    known = truth.alpha > np.radians(0.5)
    for found, angle in ((motion.alpha_rate, truth.alpha), (motion.windward_meridian_rate, truth.meridian)):
        rate = CubicSpline(truth.time, angle).derivative()(truth.time)[known][2:-2]
        error = found[known][2:-2] - rate
        assert np.sqrt(np.mean(error**2)) < 0.01 * np.sqrt(np.mean(rate**2))


def test_motion_knows_its_past_and_its_static_moment(cone: Reconstruction) -> None:
    motion = cone.motion
    past = motion.delayed(20 * cone.flight.step)
    assert past.alpha[20:] == pytest.approx(motion.alpha[:-20], abs=1e-6)
    slope, _ = np.polyfit(motion.alpha, motion.in_plane_moment, 1)
    assert slope == pytest.approx(CONE.static_slope, rel=0.02)


@pytest.mark.thorough
def test_slope_gravity_and_noise_are_found(truths: dict[str, Truth], cone: Reconstruction) -> None:
    assert cone.normal_force_slope == pytest.approx(CONE.normal_slope, rel=1e-3)
    assert cone.gyro_sigma == pytest.approx(CONE.gyro_noise, rel=0.1)
    assert cone.accel_sigma == pytest.approx(CONE.accel_noise, rel=0.1)
    slender = reconstruct(observe(truths["slender"], 0))
    across = truths["slender"].gravity_body[1:]
    assert slender.gravity_body[1:] == pytest.approx(across, abs=0.2)


@pytest.mark.parametrize("lost", [8, 30, 60])
def test_the_attitude_after_a_gap_is_estimated(truths: dict[str, Truth], lost: int) -> None:
    """Of up to half a cycle: as well known outside as without it, and inside as far off as it may be."""
    truth, gap = truths["cone"], slice(400, 400 + lost)
    flight, whole = observe(truth, 1), np.ones(truth.alpha.size, dtype=bool)
    whole[gap] = False
    lacking = {name: np.where(whole, getattr(flight, name), np.nan) for name in ("p", "q", "r", "ax", "ay", "az")}
    filled = {name: crossed(values, lost) for name, values in lacking.items()}
    result = reconstruct_record(replace(flight, segments=((0, gap.start), (gap.stop, flight.samples)), **filled))
    error, sigma = (result.motion.alpha - truth.alpha)[whole], result.alpha_sigma[whole]
    assert np.sqrt(np.mean((error / sigma) ** 2)) < 2.0
    assert np.sqrt(np.mean(sigma**2)) < 1.5 * np.sqrt(np.mean(reconstruct_record(flight).alpha_sigma ** 2))
    assert not result.moments.usable[gap].any()
    assert result.alpha_sigma[gap.start + lost // 2] > 10.0 * result.alpha_sigma[300]


@pytest.mark.slow
def test_a_spike_in_the_accelerometers_is_left_out(truths: dict[str, Truth]) -> None:
    truth = truths["slender"]
    flight = observe(truth, 4)
    channel = flight.ay.copy()
    channel[1000] += 30.0
    result = reconstruct(replace(flight, ay=channel))
    assert np.degrees(np.sqrt(np.mean((result.motion.alpha - truth.alpha) ** 2))) < 0.003


@pytest.mark.thorough
@pytest.mark.parametrize(
    "samples", [50, pytest.param(200, marks=pytest.mark.slow), pytest.param(600, marks=pytest.mark.slow)]
)
def test_a_record_without_noise_has_a_motion(samples: int) -> None:
    flight = sample_flight()
    found = reconstruct(flight.window(None, flight.time[samples - 1]))
    assert found.motion.alpha.shape == (samples,)
    assert np.all(np.isfinite(found.motion.alpha))
    assert 0.0 < found.alpha_rms_sigma < np.sqrt(np.mean(found.motion.alpha**2))


def test_too_short_a_window_is_refused(truths: dict[str, Truth]) -> None:
    flight = observe(truths["cone"], 0)
    with pytest.raises(UnanswerableError, match="10 samples"):
        reconstruct(flight.window(flight.time[0], flight.time[9]))


@pytest.mark.thorough
@pytest.mark.shared
def test_opportunity_oscillates_more_and_more_as_it_slows_down() -> None:
    flight = load_flight(shared_file("data/opportunity/opportunity_entry.h5"), instruments="opportunity")
    result = reconstruct_record(flight)
    alpha = np.degrees(result.motion.alpha)
    size = [float(np.sqrt(np.mean(alpha[flight.mach < top][:400] ** 2))) for top in (30.0, 12.0)]
    assert 1.0 < size[0] < size[1] < 6.0
    assert np.degrees(result.alpha_rms_sigma) < 0.2
    assert np.linalg.norm(result.gravity_body) == pytest.approx(3.7, rel=0.1)
    assert result.status == "degraded"
    assert any("samples at 8 Hz; that of the strongest" in text for text in result.warnings)


@pytest.mark.parametrize("angle", [0.4, 2.0, -3.0])
def test_instruments_turned_about_the_axis_give_the_same_motion(cone: Reconstruction, angle: float) -> None:
    flight = cone.flight
    turn = np.exp(1j * angle)
    rate, force = (flight.q + 1j * flight.r) * turn, (flight.ay + 1j * flight.az) * turn
    x, y, z = flight.vehicle.accelerometer_position
    arm = (y + 1j * z) * turn
    turned = replace(
        flight,
        q=rate.real,
        r=rate.imag,
        ay=force.real,
        az=force.imag,
        vehicle=replace(flight.vehicle, accelerometer_position=(x, arm.real, arm.imag)),
    )
    # The noise levels are medians of each axis, which do change with the axes: they are given.
    config = ReconstructionConfig(gyro_sigma=CONE.gyro_noise, accel_sigma=CONE.accel_noise)
    result, expected = reconstruct(turned, config), reconstruct(flight, config)
    assert result.motion.alpha == pytest.approx(expected.motion.alpha, abs=1e-7)
    shift = result.motion.windward_meridian - expected.motion.windward_meridian + angle
    known = expected.motion.alpha > np.radians(0.2)
    assert np.max(np.abs(np.angle(np.exp(1j * shift[known])))) < 3e-5
    usable = expected.moments.usable
    assert result.moments.body[usable] == pytest.approx(expected.moments.body[usable] * turn, abs=1e-9)
