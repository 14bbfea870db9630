"""The search for the motion: its derivatives, and records on which whole steps fail."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from brv_hypo import compare
from brv_hypo.flight.format import load_flight
from brv_hypo.importing import bring_in
from brv_hypo.model.reconstruction import reconstruct
from brv_hypo.motion.inertial import gravity_size
from brv_hypo.motion.interpolation import DecimatedGrid
from brv_hypo.motion.signals import rms
from brv_hypo.motion.smoother import MeasurementModel, slope_basis
from brv_hypo.simulation import load_config, simulate
from tests.shared_data import shared_file
from tests.studies.independent.imperfect_study import drawn_flight


@given(
    seed=st.integers(0, 2**31), size=st.floats(1e-6, 0.9), bends=st.booleans(), shift=st.sampled_from([1, 1j, 1 + 1j])
)
def test_gain_is_the_derivative_of_the_model(seed: int, size: float, bends: bool, shift: complex) -> None:
    rng, n = np.random.default_rng(seed), 6
    scale, angles = rng.standard_normal((n, 2)) @ [1.0, 1j], np.exp(1j * rng.uniform(0.0, 6.0, (2, n)))
    empty = np.zeros((n, 0), dtype=complex)
    model = MeasurementModel(
        observed=scale,
        scale=scale,
        slope_basis=slope_basis(np.arange(n) * 0.1, 3),
        nuisance=empty,
        kept=DecimatedGrid(np.arange(n)),
        effects=empty,
        factors=None,
        sigma=np.ones(n),
        complex_slope=not bends,
        bends=bends,
    )
    xi, step, coefficients = size * angles[0], 1e-6 * size, rng.standard_normal(model.unknowns)
    more, less = (model.modelled(xi + sign * step * shift * angles[1], coefficients) for sign in (1.0, -1.0))
    gain = model.gain(xi, coefficients, angles[1]) @ [shift.real, shift.imag]
    np.testing.assert_allclose((more - less) / (2.0 * step), gain, rtol=1e-4, atol=1e-4)


@pytest.mark.thorough
def test_a_motion_of_large_angles_is_found() -> None:
    found = reconstruct(simulate(load_config("demo"), seed=150006, plant=("sticking",)).flight)
    assert found.converged
    assert np.degrees(np.max(found.motion.alpha)) > 30.0


@pytest.mark.slow
def test_a_measured_rocket_has_one_motion_however_its_rates_are_rounded() -> None:
    """Weak forces and gravity that hardly shows: whole steps overshoot on this record, and found other motions."""
    flight = bring_in(shared_file("data/jackpot4/log.csv"), shared_file("data/jackpot4/map.yaml")).flight
    found = [reconstruct(replace(flight, q=flight.q * turned)) for turned in (1.0, 1.0 + 1e-13, 1.0 - 1e-12)]
    assert all(each.converged for each in found)
    for each in found[1:]:
        assert rms(each.motion.alpha - found[0].motion.alpha) < 0.2 * rms(found[0].alpha_sigma)


@pytest.mark.thorough
@pytest.mark.parametrize("vehicle", [pytest.param("blunt_capsule", marks=pytest.mark.slow), "research_cone"])
def test_gravity_is_that_of_the_planet_and_turns_the_path_as_the_altitude_says(vehicle: str) -> None:
    """Forces hardly show gravity along the path: it was estimated at zero, and sideways at any size."""
    flown = simulate(load_config(vehicle), seed=70001).flight
    found = reconstruct(flown)
    assert flown.altitude is not None
    fall = -np.polyfit(flown.time - flown.time[0], flown.altitude, 2)[-2] / flown.velocity[0]
    assert np.linalg.norm(found.gravity_body) == pytest.approx(gravity_size(flown), rel=0.04)
    along = float(found.start.direction @ found.gravity_body) / gravity_size(flown)
    assert along == pytest.approx(fall, abs=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("start", [990.0, 1010.0])
def test_errors_of_a_measured_entry_do_not_change_its_gravity(start: float) -> None:
    """What the model lacks made gravity of 1.3 g there, and alpha of 22 deg at the end of the record."""
    whole = load_flight(shared_file("data/opportunity/opportunity_entry.h5"), instruments="opportunity")
    flight = whole.window(start, None)
    (series,) = compare([flight], mechanisms=["inplane"], maximum_likelihood="none").series
    assert rms(np.array(series.alpha_rad) - reconstruct(flight).motion.alpha) < np.radians(1.5)


@pytest.mark.slow
def test_alpha_errs_as_stated_where_the_air_moves_as_no_tolerance_says() -> None:
    """Gusts, shear and all other imperfections at half of their ordinary size: errors were 4 to 8 of their sigmas."""
    ratios = []
    for number in (6, 8, 11, 12):
        made, _, _ = drawn_flight(1062000 + number, number, "tactical", "all")
        found = reconstruct(made.flight)
        ratios.append(rms(found.motion.alpha - made.true.alpha) / rms(found.alpha_sigma))
    assert 0.3 < rms(np.array(ratios)) < 1.5
