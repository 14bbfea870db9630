"""Errors drawn from the tolerances; the wind that an effect does not account for; what the record says of both."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from brv_hypo.errors import UsageError
from brv_hypo.flight import load_flight
from brv_hypo.flight.tolerances import of_grade
from brv_hypo.mechanisms import RecordEffect, installed, record_effects
from brv_hypo.mechanisms.registry import record_processes
from brv_hypo.motion import reconstruct
from brv_hypo.motion.interpolation import time_splines
from brv_hypo.simulation import SimulatedFlight, load_config, simulate
from brv_hypo.simulation.instruments import drawn, start_of, with_errors
from brv_hypo.simulation.vehicle import planted
from tests.flights import SAMPLE_RATE_HZ, STEP_S
from tests.truth import load_truth

SHORT = {"duration": 0.5, "sample_rate": SAMPLE_RATE_HZ, "step": STEP_S}
CONE = load_config("research_cone").model_dump(exclude={"plantable"}) | SHORT
NUISANCES = {effect.name: effect for effect in record_effects() if effect.carried}
SEEDS = range(150)


def fly(instruments: dict[str, Any], seed: int = 1, **changes: Any) -> SimulatedFlight:
    return simulate(load_config({**CONE, "instruments": instruments, **changes}), seed=seed)


def test_every_nuisance_effect_and_tolerance_is_drawn_from_its_size() -> None:
    """150 draws: mean within 4 standard errors of zero, standard deviation within 4 of the tolerance."""
    config = load_config({**CONE, "instruments": {"grade": "industrial", "draw": 2.0}})
    flights = [drawn(config, seed) for seed in SEEDS]
    assert flights[0].instruments.draw == 0.0
    record, _, _ = start_of(config)
    assert set(flights[0].instruments.errors) == {n for n, effect in NUISANCES.items() if effect.components(record)}
    assert "gap_turn" not in flights[0].instruments.errors
    for name, effect in NUISANCES.items():
        for component in effect.components(record):
            values = [f.instruments.errors[name][component.name] for f in flights]
            _check_spread(values, 2.0 * component.size)
    entries = flights[0].asymmetries
    assert {entry.mechanism for entry in entries} == {"trim", "dynamic_imbalance"}
    for i, entry in enumerate(entries):
        sizes = installed()[entry.mechanism].item.tolerance(record)  # type: ignore[union-attr]
        for name, size in zip(entry.terms, sizes, strict=True):
            _check_spread([f.asymmetries[i].terms[name] for f in flights], 2.0 * size)


def _check_spread(values: list[float], size: float) -> None:
    normal = np.array(values) / size
    assert abs(np.mean(normal)) < 4.0 / np.sqrt(len(values))
    assert np.std(normal) == pytest.approx(1.0, abs=4.0 / np.sqrt(2.0 * len(values)))


def test_draws_add_to_what_is_stated_and_follow_the_seed() -> None:
    stated: dict[str, dict[str, float]] = {"gyro_bias": {"q": 1.0}, "wind_step": {"y": 3.0}}
    config = load_config({**CONE, "instruments": {"draw": 1.0, "errors": stated}})
    plain = load_config({**CONE, "instruments": {"draw": 1.0}})
    found, again, other = (drawn(config, seed).instruments.errors for seed in (5, 5, 6))
    assert found == again
    assert found["accel_bias"] != other["accel_bias"]
    assert found["wind_step"] == {"y": 3.0}
    assert found["gyro_bias"]["q"] == pytest.approx(1.0 + drawn(plain, 5).instruments.errors["gyro_bias"]["q"])


def test_draws_do_not_change_the_noise_and_no_draw_is_perfect() -> None:
    quiet = fly({"gyro": {"noise": 1e-3}}).record
    perfect = fly({}).record
    errors = {"gyro_bias": {"q": 0.01}}
    erring = fly({"gyro": {"noise": 1e-3}, "errors": errors}).record
    np.testing.assert_allclose(
        erring.channels["q"] - 0.01 - perfect.channels["q"], quiet.channels["q"] - perfect.channels["q"], atol=1e-12
    )
    assert perfect.instruments == of_grade()


def test_the_truth_has_what_was_drawn_and_names_only_what_was_planted(tmp_path: Path) -> None:
    entry = {"mechanism": "bodyfixed", "terms": {"C_b cos(phi_b)": 8e-4}, "start": 0.3}
    flight = fly({"draw": 1.0, "grade": "industrial"}, mechanisms=[entry])
    flight.save(tmp_path / "flight.h5")
    truth = load_truth(tmp_path / "flight.h5")
    assert truth["planted"] == "bodyfixed"
    errors = flight.config.instruments.errors
    assert truth["parameters"]["instruments.errors.accel_bias.y"] == errors["accel_bias"]["y"] != 0.0
    (trim,) = (e for e in flight.config.asymmetries if e.mechanism == "trim")
    place = flight.config.asymmetries.index(trim)
    assert truth["parameters"][f"asymmetries.{place}.terms.C_m0"] == trim.terms["C_m0"]
    with h5py.File(tmp_path / "flight.h5") as file:
        units = {name: file[f"truth/{name}"].attrs["units"] for name in ("alpha", "C_m", "parameters/vehicle.mass")}
    assert units == {"alpha": "rad", "C_m": "dimensionless", "parameters/vehicle.mass": "as in the configuration"}
    before = flight.truth.time < 0.29
    np.testing.assert_allclose(flight.truth.planted_in_plane[before], 0.0, atol=1e-12)


def test_asymmetries_act_on_the_moment() -> None:
    plain = fly({}).truth
    trim = {"mechanism": "trim", "terms": {"C_m0": 1e-4, "C_n0": 0.0}, "kind": "constant"}
    found = fly({}, asymmetries=[trim]).truth
    np.testing.assert_allclose(found.C_m[0] - plain.C_m[0], 1e-4, rtol=1e-6)
    assert found.planted == ()


def test_the_record_states_its_tolerances_and_its_declared_vehicle_errs(tmp_path: Path) -> None:
    flight = fly(
        {
            "grade": "laboratory",
            "tolerances": {"gyro_bias": 0.5, "accel_bias": ["3 mm/s^2", 0.02, 0.02]},
            "errors": {"inertia_ratio": {"ratio": 0.01}},
        }
    )
    flight.save(tmp_path / "flight.h5")
    loaded = load_flight(tmp_path / "flight.h5")
    assert loaded.instruments.grade == "laboratory"
    assert loaded.instruments.gyro_bias == pytest.approx(np.radians([0.5] * 3))
    assert loaded.instruments.accel_bias == pytest.approx((0.003, 0.02, 0.02))
    assert loaded.instruments.wind == of_grade("laboratory").wind
    assert loaded.vehicle.ixx == pytest.approx(1.01 * CONE["vehicle"]["ixx"])


@pytest.mark.parametrize(
    ("instruments", "message"),
    [
        ({"grade": "tactica"}, "is 'tactical' meant"),
        ({"tolerances": {"gyro_bais": 1.0}}, "is 'gyro_bias' meant"),
        ({"tolerances": {"gyro_bias": -1.0}}, "none below zero"),
        ({"draw": -1.0}, "greater than or equal to 0"),
    ],
)
def test_what_cannot_be_a_tolerance_is_refused(instruments: dict[str, Any], message: str) -> None:
    with pytest.raises(UsageError, match=message):
        load_config({**CONE, "instruments": instruments})


@pytest.mark.parametrize("component", ["y 1", pytest.param("z 2", marks=pytest.mark.thorough)])
def test_the_air_moves_as_the_wind_effect_says(component: str) -> None:
    """With the wind corrected by the effect with the opposite sign, the reconstruction finds the true alpha again."""
    noise = load_config("research_cone").model_dump()["instruments"]
    flown = fly(noise | {"errors": {"wind": {component: 60.0}}}, duration=2.0)
    wind: RecordEffect = NUISANCES["wind"]
    corrected = wind.perturb(flown.flight, component, -60.0)
    off = [
        float(np.sqrt(np.mean((reconstruct(record).motion.alpha - flown.truth.alpha) ** 2)))
        for record in (flown.flight, corrected)
    ]
    assert off[1] < 0.2 * off[0]


def test_an_effect_of_the_record_is_planted_as_the_effect_itself_says() -> None:
    clean = fly({}).flight
    errors = {"accel_scale": {"y": 1e-3}, "time_skew": {"air data": 1e-3}, "inertia": {"scale": 0.01}}
    expected, found = with_errors(clean, errors), fly({"errors": errors}).flight
    for name in ("ay", "q", "velocity", "dynamic_pressure"):
        np.testing.assert_allclose(getattr(found, name), getattr(expected, name), rtol=1e-12)
    assert found.vehicle == expected.vehicle


ADDED = {"gyro_drift": "q 3", "accel_drift": "ay 7", "density_change": "dynamic_pressure 4"}


@pytest.mark.parametrize("name", ADDED)
def test_a_process_of_the_record_moves_its_channel_by_its_spline(name: str) -> None:
    (process,) = (process for process in record_processes() if process.name == name)
    (channel, number), clean = ADDED[name].split(), fly({}).record
    found = fly({"errors": {name: {ADDED[name]: 3.0 * process.size}}}).record
    spline = (
        3.0 * process.size * time_splines(clean.time, clean.time[0], clean.time[-1], process.splines)[:, int(number)]
    )
    for each, before in clean.channels.items():
        share = before if name == "density_change" else 1.0
        expected = before + spline * share if each == channel else before
        np.testing.assert_allclose(found.channels[each], expected, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("entry", [{}, {"start": 1.0, "stop": 2.0}, {"options": {"start": 1.0, "stop": 2.0}}])
def test_a_process_of_the_moment_is_planted_as_the_manual_says(entry: dict[str, Any]) -> None:
    """Spline k of n peaks (k - 1) h after the start; the entry's ends cut it, those of its options squeeze it."""
    planting = {"mechanism": "two_lobes", "terms": {"two_lobes 0 2": 0.001}, **entry}
    config = load_config({"base": "research_cone", "duration": 3.0, "mechanisms": [planting]})
    _, motion, _ = start_of(config)
    time = np.linspace(0.0, 3.0, 601)
    (made,) = planted(config, config.mechanisms)
    still = replace(motion, time=time, alpha=np.full(601, 0.1), windward_meridian=np.zeros(601))
    history = made.contribution(still)[0] / 1e-4
    cut, (start, stop) = "start" in entry, (1.0, 2.0) if "options" in entry else (0.0, 3.0)
    expected = time_splines(time, start, stop, 5)[:, 2] * (((time >= 1.0) & (time < 2.0)) if cut else 1.0)
    np.testing.assert_allclose(history, expected, atol=1e-12)
    peak = start + (2 - 1) * (stop - start) / (5 - 3)
    assert time[np.argmax(history)] == pytest.approx(peak)
    assert np.max(history) == pytest.approx(2.0 / 3.0)


def test_the_air_moves_as_the_process_of_the_wind_says() -> None:
    """Given the wind that was flown in, the reconstruction finds the true alpha again."""
    noise = load_config("research_cone").model_dump()["instruments"]
    flown = fly(noise | {"errors": {"turbulence": {f"y {k}": 60.0 for k in (10, 11, 12, 13)}}}, duration=2.0)
    (process,) = (process for process in record_processes() if process.name == "turbulence")
    given = flown.flight
    for k in (10, 11, 12, 13):
        given = process.perturb(given, f"y {k}", -60.0)
    off = [
        float(np.sqrt(np.mean((reconstruct(record).motion.alpha - flown.truth.alpha) ** 2)))
        for record in (flown.flight, given)
    ]
    assert off[1] < 0.2 * off[0]


def test_processes_are_not_drawn_with_the_tolerances() -> None:
    errors = drawn(load_config({**CONE, "instruments": {"draw": 1.0}}), 1).instruments.errors
    assert not set(errors) & {process.name for process in record_processes()}
