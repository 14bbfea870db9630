"""The independent equations of motion: closed forms, conserved quantities, another simulation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from tests.motion import truth as other
from tests.studies.independent import dynamics
from tests.studies.independent.air import GRAVITY, WIND_TERMS, Wind, atmosphere, viscosity
from tests.studies.independent.dynamics import PAD, Body, flown
from tests.studies.independent.flights import make_flight
from tests.studies.independent.instruments import draw_errors, no_errors, rotation
from tests.studies.independent.mechanisms import Planted
from tests.studies.independent.vehicles import CAPSULE, CONE, CRAFTS, SLENDER, Craft, draw_start


# U.S. Standard Atmosphere 1976, Table I: altitude m, density kg/m^3, temperature K.
@pytest.mark.parametrize(
    ("altitude", "density", "temperature"),
    [(0.0, 1.2250, 288.15), (20000.0, 8.8910e-2, 216.65), (40000.0, 3.9957e-3, 250.35), (70000.0, 8.2829e-5, 219.59)],
)
def test_air_is_the_standard_atmosphere(altitude: float, density: float, temperature: float) -> None:
    found = atmosphere(altitude)
    assert found == pytest.approx((density, temperature), rel=2e-4)
    assert viscosity(288.15) == pytest.approx(1.7894e-5, rel=1e-4)


def test_wind_has_its_size_and_its_rate() -> None:
    rng = np.random.default_rng(3)
    times = np.linspace(0.0, 6.0, 61)
    squares = []
    for _ in range(300):
        wind = Wind(3.0 * rng.standard_normal((3, WIND_TERMS)), 6.0)
        squares.append(np.mean([wind.at(t)[0] ** 2 for t in times]))
    assert np.sqrt(np.mean(squares)) == pytest.approx(3.0, rel=0.1)
    ahead, behind = wind.at(2.0 + 1e-4)[0], wind.at(2.0 - 1e-4)[0]
    np.testing.assert_allclose((ahead - behind) / 2e-4, wind.at(2.0)[1], rtol=1e-6)


def _without_air(craft: Craft) -> Craft:
    return replace(craft, vehicle=replace(craft.vehicle, reference_area=1e-12), duration=3.0)


@pytest.mark.parametrize("craft", [CONE, CAPSULE], ids=lambda craft: craft.name)
def test_free_body_precesses_in_closed_form(craft: Craft) -> None:
    start = replace(draw_start(craft, np.random.default_rng(1)), roll_acceleration=0.0, coning=1e4)
    body = flown(_without_air(craft), start, no_errors(), Planted())
    times = np.linspace(0.0, 3.0, 31)
    rates = body.history.many(times)[:, 10:13]
    turning = rates[:, 1] + 1j * rates[:, 2]
    rest = 1.0 - craft.vehicle.inertia_ratio
    assert abs(turning[0]) > 1e-3
    np.testing.assert_allclose(turning, turning[0] * np.exp(-1j * rest * start.roll_rate * times), rtol=1e-6)


@pytest.mark.parametrize("craft", [CONE, CAPSULE], ids=lambda craft: craft.name)
def test_free_body_keeps_energy_and_angular_momentum(craft: Craft) -> None:
    errors = draw_errors("industrial", 3.0, np.random.default_rng(2), {"wind": 0.0})
    start = replace(draw_start(craft, np.random.default_rng(1)), roll_acceleration=0.0, coning=1e5)
    craft = _without_air(craft)
    body = flown(craft, start, errors, Planted())
    states = body.history.many(np.linspace(0.0, 3.0, 31))
    rates = states[:, 10:13]
    spin = rates @ np.array(body.tensor)
    energy = np.sum(spin * rates, axis=1)
    np.testing.assert_allclose(energy, energy[0], rtol=1e-7)
    matrices = np.array([dynamics._matrix(state[6:10].tolist()) for state in states])
    momentum = np.einsum("nij,nj->ni", matrices, spin)
    np.testing.assert_allclose(momentum, momentum[:1].repeat(31, axis=0), atol=1e-6 * np.linalg.norm(momentum[0]))
    fall = 0.5 * np.sum(states[:, 3:6] ** 2, axis=1) - GRAVITY * states[:, 2]
    np.testing.assert_allclose(fall, fall[0], rtol=1e-9)


@pytest.mark.parametrize("scenario", other.SCENARIOS, ids=lambda scenario: scenario.name)
def test_derivative_is_that_of_another_simulation(scenario: other.Scenario, monkeypatch: pytest.MonkeyPatch) -> None:
    def exponential(altitude: float) -> tuple[float, float]:
        return scenario.density * np.exp(-altitude / scenario.scale_height), 250.0

    monkeypatch.setattr(dynamics, "atmosphere", exponential)
    craft = replace(
        CONE,
        vehicle=scenario.vehicle,
        axial=scenario.axial,
        normal_slope=scenario.normal_slope,
        static_slope=scenario.static_slope,
        damping=scenario.damping,
        roll_damping=0.0,
        speed=scenario.speed,
        altitude=scenario.altitude,
        stiffness_drift=0.0,
    )
    start = replace(draw_start(craft, np.random.default_rng(5)), roll_acceleration=0.0)
    body = Body(craft, start, no_errors(), Planted(), PAD)
    state = body.first_state(0.0)
    matrix = np.array(dynamics._matrix(state[6:10].tolist()))
    theirs = np.concatenate([state[3:6], state[0:3], matrix.ravel(), state[10:13]])
    rate, (_, _, pressure, xi, moment, *_) = other._derivative(scenario, 0.0, theirs)
    mine, snapshot = body.derivative(0.0, state), body.snapshot(0.0, state)
    np.testing.assert_allclose(mine[3:6], rate[:3], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(mine[10:13], rate[15:18], rtol=1e-9, atol=1e-12)
    assert snapshot.dynamic_pressure == pytest.approx(pressure)
    assert snapshot.moment == pytest.approx(moment, rel=1e-9)
    assert snapshot.alpha == pytest.approx(np.arcsin(abs(xi)))
    assert snapshot.meridian == pytest.approx(np.arctan2(xi.real, xi.imag))


def test_flight_begins_as_drawn() -> None:
    for craft in CRAFTS.values():
        start = draw_start(craft, np.random.default_rng(9))
        errors = draw_errors("industrial", 1.0, np.random.default_rng(9))
        body = Body(craft, start, errors, Planted(), PAD)
        snapshot = body.snapshot(0.0, body.first_state(0.0))
        assert snapshot.alpha == pytest.approx(start.alpha, rel=1e-6)
        assert snapshot.meridian == pytest.approx(start.meridian, rel=1e-6)
        assert snapshot.speed == pytest.approx(craft.speed)
        assert snapshot.rates[0] == pytest.approx(start.roll_rate)


@pytest.mark.parametrize(
    "vehicle", ["cone", *(pytest.param(name, marks=pytest.mark.thorough) for name in sorted(set(CRAFTS) - {"cone"}))]
)
def test_rates_of_the_angles_are_their_derivatives(vehicle: str) -> None:
    true = make_flight(vehicle, "none", seed=4, grade="industrial").true
    turn = np.exp(1j * true.meridian)
    crossflow = CubicSpline(true.time, true.alpha * turn).derivative()(true.time)
    stated = (true.alpha_rate + 1j * true.alpha * true.meridian_rate) * turn
    inner = slice(10, -10)
    np.testing.assert_allclose(crossflow[inner], stated[inner], atol=1e-4 * np.max(np.abs(stated)))


def test_offset_centre_of_gravity_turns_the_body_by_the_axial_force() -> None:
    start = draw_start(CONE, np.random.default_rng(1))
    offset = replace(no_errors(), cg_offset=np.array([2e-3, -1e-3]))
    bodies = [Body(CONE, start, errors, Planted(), PAD) for errors in (no_errors(), offset)]
    snapshots = [body.snapshot(0.0, body.first_state(0.0)) for body in bodies]
    change = snapshots[1].rates_change - snapshots[0].rates_change
    axial = CONE.vehicle.mass * snapshots[0].force[0]
    np.testing.assert_allclose(change[1:], np.array([1e-3, 2e-3]) * axial / CONE.vehicle.iyy, rtol=1e-9)


def test_tilted_axis_of_inertia_couples_roll_into_the_transverse_rates() -> None:
    tilt = np.array([1e-3, -2e-3])
    start = replace(draw_start(CONE, np.random.default_rng(1)), coning=0.0, nutation=0.0)
    bodies = [Body(CONE, start, replace(no_errors(), principal_axis=axis), Planted(), PAD) for axis in (0 * tilt, tilt)]
    snapshots = [body.snapshot(0.0, body.first_state(0.0)) for body in bodies]
    change = snapshots[1].rates_change - snapshots[0].rates_change
    # J = I + (Ix - I) a a', a the axis of inertia: -(omega x J omega) / I for a spin about x.
    axis = rotation(np.array([0.0, *tilt]))[:, 0]
    expected = (1.0 - CONE.vehicle.inertia_ratio) * start.roll_rate**2 * np.array([-axis[2], axis[1]])
    np.testing.assert_allclose(change[1:], expected, rtol=0.02)


@pytest.mark.thorough
def test_a_short_delay_is_interpolated_within_the_step(monkeypatch: pytest.MonkeyPatch) -> None:
    start = draw_start(SLENDER, np.random.default_rng(6))
    craft = replace(SLENDER, duration=1.6)
    planted = Planted("sticking", 0.4, 0.6, 1.4, {"delay": 2.5e-3})
    coarse = flown(craft, start, no_errors(), planted).history.at(1.5)
    monkeypatch.setattr(dynamics, "LEAST_STEP_FOR_DELAY", 2e-3)
    fine = flown(craft, start, no_errors(), planted).history.at(1.5)
    plain = flown(craft, start, no_errors(), Planted()).history.at(1.5)
    effect = np.linalg.norm(plain[10:13] - fine[10:13])
    assert effect > 1e-4
    assert np.linalg.norm(coarse[10:13] - fine[10:13]) < 1e-4 * effect
