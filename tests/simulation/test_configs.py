"""The configurations that come along: sensible flights, in every plant; and how bad ones are refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from brv_hypo.errors import UsageError
from brv_hypo.flight import load_flight
from brv_hypo.simulation import config_names, config_path, load_config, simulate
from brv_hypo.simulation.config import PlantedConfig
from tests.flights import flown
from tests.truth import load_truth

VEHICLES = ("research_cone", "blunt_capsule", "sounding_rocket")
MECHANISMS = ("sticking", "lag", "bodyfixed", "damping", "inplane")


def test_every_configuration_that_comes_along_loads() -> None:
    assert set(config_names()) >= {*VEHICLES, "demo", "report_table_5"}
    for name in config_names():
        assert load_config(name).samples > 500


@pytest.mark.parametrize("name", [VEHICLES[0], *(pytest.param(name, marks=pytest.mark.slow) for name in VEHICLES[1:])])
def test_nominal_flights_plant_nothing_and_oscillate_off_the_circle(name: str) -> None:
    truth = flown(name).truth
    assert truth.planted == ()
    np.testing.assert_allclose(truth.planted_share, 0.0, atol=1e-9)
    third = truth.alpha.size // 3
    for part in (truth.alpha[:third], truth.alpha[-third:]):
        assert np.radians(0.4) < np.max(part) < np.radians(5.0)
        assert np.max(part) > 1.3 * np.min(part)


@pytest.mark.slow
@pytest.mark.parametrize("mechanism", MECHANISMS)
@pytest.mark.parametrize("name", VEHICLES)
def test_planted_flights_show_the_mechanism_and_stay_flights(name: str, mechanism: str) -> None:
    """At least 5 % of the moment's rms, from which it must be found; alpha between 0.3 and 8 deg."""
    flight = flown(name, mechanism)
    truth = flight.truth
    entry = flight.config.mechanisms[0]
    assert truth.planted == (mechanism,)
    assert max(truth.planted_share) > 0.05
    active = (truth.time >= entry.start) & (truth.time < entry.stop)
    whole = np.sqrt(np.mean((truth.C_N**2 + truth.C_Z**2)[active]))
    planted = np.sqrt(np.mean((truth.planted_in_plane**2 + truth.planted_out_of_plane**2)[active]))
    assert 0.1 < planted / whole < 0.45
    assert np.max(truth.alpha) < np.radians(8.0)
    assert np.max(truth.alpha[-truth.alpha.size // 6 :]) > np.radians(0.3)


@pytest.mark.slow
@pytest.mark.parametrize("effect", sorted(set(load_config("research_cone").plantable) - set(MECHANISMS)))
def test_plantable_effects_of_the_vehicle_are_observable_and_moderate(effect: str) -> None:
    truth = flown("research_cone", effect).truth
    assert 0.02 < np.hypot(*truth.planted_share) < 0.4
    assert np.radians(0.3) < np.max(truth.alpha[-200:])
    assert np.max(truth.alpha) < np.radians(5.0)


@pytest.mark.slow
def test_the_reports_flight_has_its_knots_and_its_size() -> None:
    """Moments of a few 1e-4 (Table 5.4: mean square 1.65e-7), sticking from 320.75 to 322.5 s (Table 5.7)."""
    flight = simulate("report_table_5", seed=1)
    truth = flight.truth
    assert truth.planted == ("inplane", "sticking")
    assert {item.start for item in flight.config.mechanisms} == {318.875, 320.8, 321.0, 322.0, 320.75}
    assert 2e-4 < np.sqrt(np.mean(truth.C_N**2)) < 1e-3
    across = np.flatnonzero(np.abs(truth.planted_out_of_plane) > 1e-12)
    assert truth.time[across[0]] == pytest.approx(320.75, abs=0.006)
    assert truth.time[across[-1]] == pytest.approx(322.495, abs=0.006)
    assert np.radians(0.1) < np.min(truth.alpha) < np.max(truth.alpha) < np.radians(2.0)


def test_saved_flights_load_with_their_truth_apart(tmp_path: Path) -> None:
    config = load_config("demo").model_dump() | {"duration": 1.0}
    config["instruments"]["gaps"] = [{"start": 0.5, "duration": 0.2}]
    flight = simulate(config, seed=4)
    path = tmp_path / "flight.h5"
    flight.save(path)
    loaded, truth = load_flight(path), load_truth(path)
    for name in ("time", "q", "az", "velocity", "dynamic_pressure"):
        np.testing.assert_array_equal(getattr(loaded, name), getattr(flight.flight, name))
    assert loaded.segments == flight.flight.segments == ((0, 100), (140, 201))
    assert loaded.source == "simulated, seed 4"
    assert truth["planted"] == "sticking"
    assert truth["seed"] == 4
    np.testing.assert_array_equal(truth["alpha"], flight.truth.alpha)
    assert truth["parameters"]["mechanisms.0.terms.eps"] == 0.6
    assert {np.ndim(value) for value in truth["parameters"].values()} == {0}
    with pytest.raises(UsageError, match="exists already"):
        flight.save(path)


def test_terms_with_a_slash_in_their_name_are_saved(tmp_path: Path) -> None:
    entry = {"mechanism": "dynamic_imbalance", "terms": {"I_xy/(S d)": 1.0}}
    config = load_config("research_cone").model_dump() | {"duration": 0.2, "mechanisms": [entry]}
    simulate(config, seed=1).save(tmp_path / "flight.h5")
    parameters = load_truth(tmp_path / "flight.h5")["parameters"]
    assert parameters["mechanisms.0.terms.I_xy per (S d)"] == 1.0


def test_a_file_may_build_on_another(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text("base: sounding_rocket\nduration: 2.0\n")
    assert load_config(path).vehicle == load_config("sounding_rocket").vehicle
    assert load_config(path).duration == 2.0


def test_a_section_keeps_what_is_not_named_anew(tmp_path: Path) -> None:
    """Of its base, of a configuration and of keywords alike: a drawn error leaves the noise; an empty section none."""
    cone, path = load_config("research_cone"), tmp_path / "mine.yaml"
    path.write_text("base: research_cone\ninstruments: {draw: 1, gyro: {noise: 0.1}}\nvehicle: {mass: 3}\n")
    own = load_config(path)
    assert (own.instruments.draw, own.instruments.gyro.noise, own.vehicle.mass) == (1.0, 0.1, 3.0)
    assert own.instruments.velocity == cone.instruments.velocity
    assert own.vehicle.ixx == cone.vehicle.ixx
    for source in ("research_cone", cone, {"base": "research_cone"}):
        drawn = load_config(source, keywords={"instruments": {"draw": 1.0}}).instruments
        assert (drawn.draw, drawn.gyro, drawn.silent) == (1.0, cone.instruments.gyro, False)
    path.write_text("base: research_cone\ninstruments: {}\nplantable: {}\n")
    assert load_config(path).instruments.silent
    assert not load_config(path).plantable


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("start: [", "it is not YAML"),
        ("- 1", "expected a mapping"),
        ("base: research_cone\ndurations: 3", "'durations' is not a known key.*is 'duration' meant"),
        ("base: research_cone\nduration: -3", "'duration': expected greater than 0, got -3"),
        ("base: research_cone\nstep: 0.003", "whole number: try step 0.0025"),
        ("vehicle: {mass: 3}", "'vehicle.ixx' is missing"),
        ("base: research_cone\nduration: 0.05", "at least 16"),
        (
            "base: research_cone\nvehicle: {mass: 3, ixx: 9, iyy: 2, reference_length: 1, reference_area: 1}",
            "exchanged",
        ),
        ("base: demo", "one level is allowed"),
        ("base: research_con", "did you mean research_cone"),
        ("base: research_cone\nmechanisms: [{mechanism: lag, terms: {}}]", "mechanisms.0.terms"),
    ],
)
def test_bad_files_are_refused_with_the_remedy(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "bad.yaml"
    path.write_text(text)
    with pytest.raises(UsageError, match=message):
        load_config(path)


def test_names_and_plants_that_do_not_exist_are_refused() -> None:
    with pytest.raises(UsageError, match="did you mean blunt_capsule"):
        config_path("blunt_capsul")
    with pytest.raises(UsageError, match="holds sticking, lag"):
        load_config("research_cone", plant=("magic",))


def test_what_is_planted_begins_before_it_ends() -> None:
    with pytest.raises(ValueError, match="acts from 3 to 1 s, expected stop after start"):
        PlantedConfig(mechanism="lag", terms={"lag fraction": 1.0}, start=3.0, stop=1.0)
