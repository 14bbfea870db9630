"""The lagged aftbody moment: what a delay changes, and the limit cycle that it makes beside a stable C_mq."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq

from brv_hypo import trace
from brv_hypo.mechanisms import find
from brv_hypo.mechanisms.conformance import sample_motion, uniform_time
from brv_hypo.simulation import SimulatedFlight, load_config, simulate

TERM = "C_malpha aftbody lag"
ANGLE, SLOPE, C_MQ = 3.0, -20.0, -5.0  # deg; both large, so that a cycle is reached in seconds
PLANTED = {"mechanism": "aftbody_lag", "theta": {"angle": ANGLE}, "terms": {TERM: SLOPE}, "kind": "constant"}


def test_it_is_a_moment_that_follows_the_angle_of_attack_late() -> None:
    """Delayed by k d / V in axes that do not roll, less the present one, over k; both over the square of Mach."""
    time, k, angle = uniform_time(200)[20:], 0.1, np.radians(ANGLE)
    motion = sample_motion(time)
    late = sample_motion(time - k * motion.reference_length / motion.velocity)
    roll = [12.0 * each + 0.05 * each**2 for each in (time, late.time)]
    plane = [angle_of_roll - m.windward_meridian for angle_of_roll, m in zip(roll, (motion, late), strict=True)]
    moment, before = (angle * np.tanh(m.alpha / angle) for m in (motion, late))
    expected = (before * np.exp(1j * (plane[1] - plane[0])) - moment) / k / motion.mach**2
    (term,) = find("aftbody_lag").terms(motion, {"angle": ANGLE})
    found = term.in_plane + 1j * term.out_of_plane
    assert np.max(np.abs(found - expected)) < 1e-3 * np.max(np.abs(expected))


def circular(alpha: float) -> SimulatedFlight:
    """A circular motion (rad) at a constant Mach number and dynamic pressure."""
    config = load_config("slowing_capsule").model_dump() | {"duration": 7.0, "sample_rate": 25.0, "step": 0.04}
    config["environment"] = {"gravity": 0.0, "constant_density": 0.03}
    config["aerodynamics"] = {"C_malpha": -0.12, "C_mq": C_MQ}
    config["vehicle"] |= {"ixx": 50.0, "iyy": 45.0}
    frequency = np.sqrt(0.12 * 0.5 * 0.03 * 600.0**2 * 1.767 * 1.5 / 45.0)
    start = {"altitude": 3e4, "velocity": 600.0, "flight_path_angle": 0.0, "coning_rate": frequency, "alpha": alpha}
    return simulate(config | {"start": start, "mechanisms": [PLANTED]}, seed=1)


@pytest.mark.parametrize("alpha", [1.0, 12.0])
def test_small_amplitudes_grow_and_large_ones_shrink_to_the_limit_cycle(alpha: float) -> None:
    """Circular: C_mq = 2 c / Mach^2 tanh(x) / x at x, the amplitude over the angle of saturation."""
    flown = circular(np.radians(alpha))
    mach = flown.flight.mach[0]
    cycle = ANGLE * brentq(lambda x: np.tanh(x) / x - C_MQ * mach**2 / (2.0 * SLOPE), 1e-3, 50.0)
    reached = np.degrees(np.mean(flown.truth.alpha[-25:]))
    assert 1.0 < cycle < 12.0
    assert reached == pytest.approx(cycle, rel=0.05)


@pytest.mark.slow
def test_trace_finds_it_on_a_capsule_that_slows_through_mach_3_to_1() -> None:
    found = trace(simulate("slowing_capsule", seed=1, plant=["aftbody_lag"]).flight)
    assert found.findings == ("aftbody_lag",)
    (term,) = (term for term in found.model.terms if term.name == TERM)
    assert term.value == pytest.approx(-1.5, rel=0.05)
