"""Moments and forces that bend with the angle of attack are aerodynamics, and no mechanism."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from brv_hypo import compare, reconstruct
from brv_hypo.comparison import CompareConfig
from brv_hypo.comparison.preparation import shared_problem
from brv_hypo.linearisation.response import linearisation_point, walk_modes
from brv_hypo.model.baseline import PitchDamping, StaticBend, StaticMoment
from brv_hypo.model.reconstruction import reconstruct as reconstruction_of
from brv_hypo.motion import ReconstructionConfig
from brv_hypo.motion.motion import body_from_plane
from tests.studies.independent.drawn_vehicles import FEWEST_CYCLES, LONGEST, draw_craft
from tests.studies.independent.flights import make_flight
from tests.studies.independent.mechanisms import LISTED
from tests.studies.independent.study import drawn_flight
from tests.studies.independent.vehicles import CAPSULE, CRAFTS, Craft

BENT = replace(CAPSULE, alpha=np.radians(8.0), static_bend=0.3, normal_bend=0.4, axial_bend=-0.05)


@pytest.mark.slow
@pytest.mark.parametrize(("truth", "named"), [("none", None), ("bodyfixed", "bodyfixed"), ("damping", "damping")])
def test_a_bent_vehicle_is_judged_as_a_straight_one(truth: str, named: str | None) -> None:
    """Without the bends every one of these was "none adequate"."""
    made = make_flight(BENT, truth, amplitude=0.5, seed=3)
    verdict = compare(made.flight, CompareConfig(mechanisms=LISTED, maximum_likelihood="none")).verdict
    assert verdict.outcome != "none adequate"
    if named is None:
        assert "none" in verdict.equivalent
    else:
        assert verdict.winner == named


@pytest.mark.thorough
def test_a_bend_drifts_with_the_speed_where_the_slope_does() -> None:
    """At 30 deg a drift in time had a residual of 4e-4 of the moment: it was named `inplane`."""
    made = drawn_flight(134000, 0, "mixed", 1.0, 5, True, True)
    true = made.true
    problem = shared_problem(
        [reconstruction_of(made.flight, ReconstructionConfig())], CompareConfig(mechanisms=LISTED)
    )[0]
    motion = replace(
        problem.frame.motions[0], alpha=true.alpha, windward_meridian=true.meridian, velocity=true.velocity,
        p=true.rates[:, 0], q=true.rates[:, 1], r=true.rates[:, 2],
    )  # fmt: skip
    baseline = (problem.frame.mechanisms[name] for name in (StaticMoment.name, PitchDamping.name, StaticBend.name))
    columns = np.column_stack(
        [
            body_from_plane(term.in_plane, term.out_of_plane, true.meridian)
            for mechanism in baseline
            for term in mechanism.terms(motion, {})
        ]
    )
    both, moment = np.vstack([columns.real, columns.imag]), np.concatenate([true.moment.real, true.moment.imag])
    residual = moment - both @ np.linalg.lstsq(both, moment, rcond=None)[0]
    assert np.linalg.norm(residual) < 2e-5 * np.linalg.norm(moment)


@pytest.mark.thorough
@pytest.mark.parametrize("seed", [3, pytest.param(4, marks=pytest.mark.slow)])
@pytest.mark.parametrize("truth", ["lag", pytest.param("sticking", marks=pytest.mark.slow)])
def test_what_is_late_of_a_bent_moment_is_bent_too(truth: str, seed: int) -> None:
    """As the lag of a straight moment its residual was larger than the noise."""
    made = make_flight(BENT, truth, amplitude=0.5, seed=seed)
    verdict = compare(made.flight, CompareConfig(mechanisms=LISTED, maximum_likelihood="none")).verdict
    assert verdict.winner == truth


@pytest.mark.parametrize("seed", [4, pytest.param(5, marks=pytest.mark.thorough)])
def test_the_normal_force_is_found_to_bend(seed: int) -> None:
    made = make_flight(BENT, seed=seed)
    found = reconstruct(made.flight)
    assert found.normal_force_bend == pytest.approx(BENT.normal_slope * 0.4 / BENT.alpha**2, rel=0.03)
    error = np.sqrt(np.mean((found.motion.alpha - made.true.alpha) ** 2))
    assert error < 3.0 * np.sqrt(np.mean(found.alpha_sigma**2))


@pytest.mark.thorough
def test_a_normal_force_in_proportion_has_no_bend() -> None:
    assert reconstruct(make_flight("cone", seed=5).flight).normal_force_bend == 0.0


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["cone", "biconic"])
def test_the_walk_of_the_attitude_has_sines_as_fast_as_the_motion(name: str) -> None:
    """A walk at the frequency of the oscillation turns the vehicle as much as the noise that it is made of shows."""
    made, usual = make_flight(name, seed=6), ReconstructionConfig()
    record, smooth = linearisation_point(reconstruction_of(made.flight, usual), usual)
    craft, pressure = CRAFTS[name], float(np.median(made.true.dynamic_pressure))
    stiffness = -craft.static_slope * pressure * craft.vehicle.moment_scale
    cycles = np.sqrt(stiffness) * craft.duration / (2.0 * np.pi)
    assert walk_modes(record, smooth) > 2.0 * cycles


@pytest.mark.parametrize("seed", range(8))
def test_a_drawn_vehicle_is_fit_to_be_analysed(seed: int) -> None:
    craft: Craft = draw_craft(np.random.default_rng(seed))
    vehicle = craft.vehicle
    assert 0.0 < vehicle.ixx < 2.0 * vehicle.iyy
    assert craft.static_slope < 0.0
    assert craft.duration <= LONGEST
    assert craft.duration * craft.sample_rate > 20.0 * FEWEST_CYCLES


@pytest.mark.thorough
def test_an_axial_force_that_does_not_change_is_constant() -> None:
    """Errors of the accelerometers go with alpha too."""
    assert reconstruct(make_flight("biconic", seed=7, grade="industrial").flight).motion.axial_share is None


@pytest.mark.thorough
def test_the_axial_force_is_found_to_go_with_alpha() -> None:
    """It turns the vehicle about a c.g. off the axis: a moment as large as those that are to be found."""
    bend = -0.05
    craft = replace(CAPSULE, alpha=np.radians(8.0), axial_bend=bend)
    made = make_flight(craft, seed=7)
    share = reconstruct(made.flight).motion.axial_share
    expected = craft.bent(bend, made.true.alpha)
    assert share is not None
    np.testing.assert_allclose(share, expected / np.median(expected), atol=2e-3)
