"""What is planted obeys CONVENTIONS, errors have the stated sizes, records are what instruments make of a motion."""

from __future__ import annotations

import ast
import pickle
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from brv_hypo.flight.format import load_flight
from brv_hypo.flight.tolerances import of_grade
from tests.studies.independent.flights import Made, draw_flight, main, make_flight
from tests.studies.independent.instruments import (
    GRADES,
    TOLERANCES,
    Noise,
    draw_errors,
    gyro_matrix,
    inertia_tensor,
    no_errors,
    sensed_force,
)
from tests.studies.independent.mechanisms import (
    LISTED,
    THROUGHOUT,
    TRUTHS,
    UNLISTED,
    WIND_STEP,
    Planted,
    body_components,
)
from tests.studies.independent.vehicles import CONE
from tests.truth import load_truth

AMPLITUDE = 0.5


@cache
def _made(truth: str) -> Made:
    return make_flight("cone", truth, AMPLITUDE, seed=11)


def _inside(made: Made) -> np.ndarray:
    start, stop = made.true.region or (0.0, 0.0)
    return (made.true.time >= start) & (made.true.time < stop)


def _convention(made: Made) -> tuple[np.ndarray, np.ndarray]:
    """(C_N', C_Z') over the record, written out from the table of CONVENTIONS."""
    true, planted = made.true, made.true.planted
    alpha, phi, slope = true.alpha, true.meridian, true.static_slope
    zero = np.zeros_like(alpha)
    if made.truth == "damping":
        return planted.amplitude * true.alpha_rate * CONE.vehicle.reference_length / (2.0 * true.velocity), zero
    if made.truth == "inplane":
        return planted.amplitude * (planted.values["offset"] + planted.values["slope"] * alpha), zero
    if made.truth == "bodyfixed":
        angle = planted.values["angle"]
        return planted.amplitude * np.cos(angle - phi), planted.amplitude * np.sin(phi - angle)
    before = CubicSpline(true.time, alpha * np.exp(1j * phi))(true.time - planted.delay)
    held = slope * np.abs(before)
    if made.truth == "lag":
        angle = planted.delay * true.meridian_rate
        return held * np.cos(angle) - slope * alpha, held * np.sin(angle)
    return zero, planted.amplitude * held * np.sin(phi - np.angle(before))


@pytest.mark.thorough
@pytest.mark.parametrize("truth", LISTED)
def test_planted_contributions_obey_the_conventions(truth: str) -> None:
    made, inside = _made(truth), _inside(_made(truth))
    in_plane, out_of_plane = _convention(made)
    expected = np.where(inside, in_plane + 1j * out_of_plane, 0.0)
    np.testing.assert_allclose(made.true.contribution, expected, atol=1e-4 * np.max(np.abs(expected)))
    assert np.any(inside)
    assert not np.all(inside)


@pytest.mark.thorough
@pytest.mark.parametrize("truth", [*TRUTHS, *THROUGHOUT])
def test_moment_is_the_vehicles_and_what_is_planted(truth: str) -> None:
    true = _made(truth).true
    transverse = true.rates[:, 1] + 1j * true.rates[:, 2]
    damping = CONE.damping * transverse * CONE.vehicle.reference_length / (2.0 * true.velocity)
    static = body_components(true.static(true.alpha), true.meridian)
    planted = body_components(true.contribution, true.meridian)
    np.testing.assert_allclose(true.moment, static + damping + planted, atol=1e-9)


@pytest.mark.thorough
@pytest.mark.parametrize("truth", [*LISTED, *UNLISTED, *THROUGHOUT])
def test_nominal_amplitude_changes_the_moment_by_its_share(truth: str) -> None:
    made = _made(truth)
    assert 0.03 <= made.true.nominal_share <= 0.4
    assert made.true.share == pytest.approx(AMPLITUDE * made.true.nominal_share, rel=0.6)


@pytest.mark.thorough
@pytest.mark.parametrize("truth", THROUGHOUT)
def test_what_is_of_the_vehicle_acts_throughout(truth: str) -> None:
    assert np.all(_inside(_made(truth)))


@pytest.mark.thorough
def test_a_step_of_the_wind_turns_the_flow_and_not_the_vehicle() -> None:
    gust = Planted(WIND_STEP, 70.0, 2.5, 10.0, {"across": (0.0, 1.0, 0.0)})
    made, plain = make_flight("cone", planted=gust, seed=11), _made("none")
    before, after = plain.true.time < 2.5, plain.true.time >= 2.5
    np.testing.assert_allclose(made.true.alpha[before], plain.true.alpha[before], atol=1e-9)
    np.testing.assert_allclose(made.true.rates[before], plain.true.rates[before], atol=1e-8)
    flow, other = (m.true.alpha * np.exp(1j * m.true.meridian) for m in (made, plain))
    turned = np.abs(flow - other)[after][0]
    assert turned == pytest.approx(70.0 / made.true.velocity[after][0], rel=0.05)


@pytest.mark.thorough
def test_a_fixed_moment_is_constant_in_the_body_and_a_rotating_one_turns() -> None:
    fixed, turning = _made("bodyfixed"), _made("rotating")
    inside = _inside(fixed)
    moment = body_components(fixed.true.contribution, fixed.true.meridian)[inside]
    np.testing.assert_allclose(moment, moment[0], rtol=1e-9)
    inside = _inside(turning)
    phase = np.unwrap(np.angle(body_components(turning.true.contribution, turning.true.meridian)[inside]))
    np.testing.assert_allclose(np.abs(np.gradient(phase, turning.true.time[inside])), 3.0, rtol=1e-6)


@pytest.mark.thorough
@pytest.mark.parametrize("truth", ["lag", "sticking", "bodyfixed"])
def test_flight_is_the_same_until_the_mechanism_acts(truth: str) -> None:
    plain, made = _made("none"), _made(truth)
    before = made.true.time < (made.true.region or (0.0, 0.0))[0]
    np.testing.assert_allclose(made.flight.q[before], plain.flight.q[before], atol=1e-8)
    assert np.max(np.abs(made.flight.q - plain.flight.q)) > 1e-3


@pytest.mark.parametrize("grade", GRADES)
def test_tolerances_are_those_that_the_record_states(grade: str) -> None:
    place = GRADES.index(grade)
    assert {key: sizes[place] for key, sizes in TOLERANCES.items()} == pytest.approx(
        {key: value[0] for key, value in of_grade(grade).values().items()}
    )


@pytest.mark.parametrize("key", sorted(TOLERANCES))
def test_errors_have_the_stated_sizes(key: str) -> None:
    drawn = [
        np.ravel(getattr(draw_errors("tactical", {key: 2.0}, np.random.default_rng(seed)), key)) for seed in range(600)
    ]
    found = np.sqrt(np.mean(np.concatenate(drawn) ** 2))
    assert found == pytest.approx(2.0 * TOLERANCES[key][1], rel=0.12)


def test_errors_can_be_set() -> None:
    errors = draw_errors("tactical", 0.0, np.random.default_rng(0), {"time_skew": 2e-3, "gyro_scale": [0, 1e-3, 0]})
    assert errors.time_skew == 2e-3
    np.testing.assert_array_equal(errors.gyro_scale, [0.0, 1e-3, 0.0])
    assert not np.any(errors.wind)


def test_perfect_instruments_write_down_the_truth() -> None:
    made = make_flight("capsule", "none", seed=2, factor=0.0, noise_factor=0.0)
    flight, true = made.flight, made.true
    np.testing.assert_allclose(np.stack([flight.p, flight.q, flight.r], axis=1), true.rates, atol=1e-12)
    np.testing.assert_allclose(np.stack([flight.ax, flight.ay, flight.az], axis=1), true.force, atol=1e-12)
    np.testing.assert_allclose(flight.velocity, true.velocity)
    np.testing.assert_allclose(flight.mach, true.mach, rtol=1e-9)
    assert flight.samples == 1081


@pytest.mark.thorough
def test_accelerometers_feel_their_lever_arm() -> None:
    made = make_flight("slender", "none", seed=2, factor=0.0, noise_factor=0.0)
    true, (x, y, z) = made.true, made.true.craft.vehicle.accelerometer_position
    p, q, r = true.rates.T
    pd, qd, rd = (CubicSpline(true.time, rate).derivative()(true.time) for rate in (p, q, r))
    vehicle, craft = true.craft.vehicle, true.craft
    push = true.dynamic_pressure * vehicle.reference_area / vehicle.mass
    expected = [
        -push * craft.axial - (q**2 + r**2) * x + (p * q - rd) * y + (p * r + qd) * z,
        -push * craft.normal_slope * true.alpha * np.sin(true.meridian)
        + (p * q + rd) * x
        - (p**2 + r**2) * y
        + (q * r - pd) * z,
        -push * craft.normal_slope * true.alpha * np.cos(true.meridian)
        + (p * r - qd) * x
        + (q * r + pd) * y
        - (p**2 + q**2) * z,
    ]
    np.testing.assert_allclose(true.force[5:-5].T, np.array(expected)[:, 5:-5], atol=1e-4)


def test_gyros_are_late_turned_and_biased_as_specified() -> None:
    errors = {"time_skew": 1e-3, "gyro_bias": 2e-3, "gyro_misalignment": [1e-3, 0, 0, 0, -2e-3, 0]}
    made = make_flight("cone", "none", seed=2, factor=0.0, noise_factor=0.0, errors=errors)
    inner = slice(10, -10)
    p, q, r = CubicSpline(made.true.time, made.true.rates)(made.true.time - 1e-3)[inner].T
    np.testing.assert_allclose(made.flight.p[inner], p + 1e-3 * q + 2e-3, atol=1e-7)
    np.testing.assert_allclose(made.flight.q[inner], q + 2e-3, atol=1e-7)
    np.testing.assert_allclose(made.flight.r[inner], r - 2e-3 * p + 2e-3, atol=1e-7)
    np.testing.assert_allclose(gyro_matrix(no_errors()), np.eye(3))


def test_accelerometer_block_is_turned_as_one() -> None:
    force = np.array([[-100.0, 2.0, -1.0]])
    errors = replace(no_errors(), accel_misalignment=np.array([0.0, 0.0, 1e-3]))
    found = sensed_force(force, errors)
    assert np.linalg.norm(found) == pytest.approx(np.linalg.norm(force))
    np.testing.assert_allclose(found - force, [[2e-3, 0.1, 0.0]], atol=1e-4)


def test_inertia_errors_keep_their_meaning() -> None:
    errors = replace(no_errors(), inertia=0.01, inertia_ratio=-0.02)
    tensor = inertia_tensor(14.0, 140.0, errors)
    assert tensor[1, 1] == pytest.approx(141.4)
    assert tensor[0, 0] / tensor[1, 1] == pytest.approx(0.098)


def test_noise_has_its_size() -> None:
    made = make_flight("cone", "none", seed=5, factor=0.0, noise_factor=2.0)
    noise = Noise()
    flight, true = made.flight, made.true
    assert np.std(flight.q - true.rates[:, 1]) == pytest.approx(2.0 * noise.gyro, rel=0.1)
    assert np.std(flight.ay - true.force[:, 1]) == pytest.approx(2.0 * noise.accel, rel=0.1)
    assert np.std(flight.velocity - true.velocity) == pytest.approx(2.0 * noise.velocity, rel=0.1)
    ratio = flight.dynamic_pressure / true.dynamic_pressure
    assert np.std(ratio) == pytest.approx(2.0 * noise.dynamic_pressure, rel=0.1)


@pytest.mark.thorough
def test_seed_repeats_a_flight() -> None:
    first, second = draw_flight(21), draw_flight(21)
    assert (first.vehicle, first.truth, first.amplitude) == (second.vehicle, second.truth, second.amplitude)
    np.testing.assert_array_equal(first.flight.q, second.flight.q)


@pytest.mark.thorough
def test_made_flight_travels_between_processes() -> None:
    made = pickle.loads(pickle.dumps(_made("lag")))
    np.testing.assert_array_equal(made.true.claim, _made("lag").true.claim)


STUDIES = (
    "study.py",
    "faulty_records.py",
    "loop_study.py",
    "record_oracle.py",
    "effects.py",
    "undeclared_study.py",
    "two_flights.py",
    "sisters.py",
    "descriptions.py",
    "near_zero.py",
    "integrals.py",
    "instrument_errors.py",
    "imperfect_study.py",
    "test_near_zero.py",
    "test_verdicts.py",
    "two_mechanisms.py",
    "units_study.py",
    "test_bent_aerodynamics.py",
    "test_coloured_noise.py",
    "test_air_data.py",
    "test_clocks.py",
    "joint.py",
    "misread.py",
    "test_joint.py",
)


def test_nothing_is_modelled_by_the_program() -> None:
    """Only the record, its tolerances and its file are the program's; the studies alone call what they judge."""
    lent = {f"brv_hypo.flight.{name}" for name in ("record", "tolerances", "format")}
    makers = [path for path in Path(__file__).parent.glob("[a-z]*.py") if path.name not in STUDIES]
    for path in makers:
        found = {
            node.module
            for node in ast.walk(ast.parse(path.read_text()))
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("brv_hypo")
        }
        assert found <= lent, path.name


def test_unknown_truth_is_refused() -> None:
    with pytest.raises(ValueError, match="'slag', expected one of"):
        make_flight("cone", "slag")


@pytest.mark.thorough
def test_command_writes_flights_that_load(tmp_path: Path) -> None:
    main(["--seed", "4", "--flights", "2", "-o", str(tmp_path), "--truth", "rotating", "--grade", "industrial"])
    paths = sorted(tmp_path.glob("*.h5"))
    assert len(paths) == 2
    for path in paths:
        flight, truth = load_flight(path), load_truth(path)
        assert flight.instruments.grade == "industrial"
        assert truth["mechanism"] == "rotating"
        assert truth["planted_in_plane"].shape == (flight.samples,)
