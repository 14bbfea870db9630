"""From a rocket's raw log to a record: clocks, pad, speed, phases, rate, masses from a table, raw values kept."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from brv_hypo.errors import UsageError
from brv_hypo.flight import find_phases, inspect_flight, save_flight
from brv_hypo.flight.record import Record
from brv_hypo.importing import bring_in
from brv_hypo.importing.rocket_log import (
    DECIMATED_PASS_END,
    DECIMATED_STOP_BEGIN,
    Rest,
    ascent,
    clock_offset,
    decimated,
    low_pass,
    needed_rate,
    take_out_biases,
)
from tests.flight.records import UNITS, VEHICLE
from tests.importing import rockets
from tests.importing.test_foreign import write_csv, write_map

VEHICLE_MAP = {
    name: {"value": np.asarray(getattr(VEHICLE, name)).tolist(), "units": UNITS[name]}
    for name in VEHICLE.__dataclass_fields__
}


@pytest.fixture(scope="module")
def unit() -> dict[str, Any]:
    return rockets.inertial_unit()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, unit: dict[str, Any]) -> Path:
    """The rocket's files."""
    path = tmp_path_factory.mktemp("rocket")
    write_csv(path / "unit.csv", unit)
    write_csv(path / "altimeter.csv", rockets.altimeter())
    table = np.linspace(0.0, 20.0, 41)
    masses = {"t": table, "m": np.where(table < 4.0, 150.0 - 7.0 * table, 122.0), "i": 30.0 + 0.1 * table}
    write_csv(path / "masses.csv", masses)
    return path


def rocket_map(**changes: Any) -> dict[str, Any]:
    mass = {"file": "masses.csv", "time": {"column": "t", "units": "s"}}
    return {
        "channels": {
            **{name: {"column": name, "units": UNITS[name]} for name in ("time", "p", "q", "r", "ax", "ay", "az")},
            "altitude": {"recorder": "altimeter", "column": "altitude", "units": "m"},
        },
        "recorders": {
            "altimeter": {
                "file": "altimeter.csv",
                "time": {"column": "time", "units": "s"},
                "align": {"column": "acceleration", "units": "m/s^2", "to": "ax"},
            }
        },
        "vehicle": {
            **VEHICLE_MAP,
            "mass": {**mass, "column": "m", "units": "kg"},
            "iyy": {**mass, "column": "i", "units": "kg*m^2"},
        },
        "instruments": {"grade": "industrial"},
        "pad": [-4.5, -0.5],
        "derive": {"velocity": "ascent"},
        "window": "coast",
        "rate": "auto",
        **changes,
    }


def test_the_whole_log_becomes_a_record_of_its_coast(folder: Path) -> None:
    found = bring_in(folder / "unit.csv", write_map(folder, rocket_map()))
    flight = found.flight
    assert [phase.name for phase in found.phases] == ["pad", "burn", "coast", "parachute"]
    assert flight.time[0] == pytest.approx(rockets.BURNOUT, abs=0.4)
    assert flight.time[-1] == pytest.approx(rockets.PARACHUTE, abs=0.4)
    assert len(flight.segments) == 1  # the gap is bridged by the filter
    assert 30.0 < flight.sample_rate < 45.0
    _, speed, altitude = rockets.climb(flight.time)
    inside = (flight.time > 4.5) & (flight.time < 14.0)
    np.testing.assert_allclose(flight.velocity[inside], speed[inside], atol=4.0)
    np.testing.assert_allclose(flight.altitude[inside], altitude[inside], atol=15.0)
    middle = inside & (np.abs(flight.time - 8.0) > 0.5)
    np.testing.assert_allclose(flight.q[middle], 0.06 * np.cos(2.4 * np.pi * flight.time[middle]), atol=2e-3)
    assert flight.vehicle.mass == pytest.approx(122.0)
    assert flight.instruments.inertia[0] > 0.02  # iyy changes over the window
    assert flight.instruments.dynamic_pressure_scale[0] > 0.02


def test_a_record_with_thrust_is_offered_its_coast(folder: Path, tmp_path: Path) -> None:
    found = bring_in(folder / "unit.csv", write_map(folder, rocket_map(window=None)))
    save_flight(found.flight, tmp_path / "f.h5")
    inspection = inspect_flight(tmp_path / "f.h5")
    assert [phase.name for phase in inspection.phases] == ["burn", "coast"]
    assert any("analyse the coast, --start 4." in warning for warning in inspection.warnings)


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"pad": [1.0, 3.0]}, "expected gravity along the nose and rest"),
        ({"pad": [-40.0, -30.0]}, "holds 0 samples"),
        ({"window": [30.0, 20.0]}, "a start before its stop"),
        ({"window": "landing"}, "window"),
        ({"recorders": {}}, "the recorder 'altimeter'"),
        ({"rate": -3.0}, "rate"),
        ({"derive": {"velocity": "magic"}}, "derive/velocity"),
    ],
)
def test_a_wrong_entry_is_refused_by_name(folder: Path, changes: dict[str, Any], says: str) -> None:
    with pytest.raises(UsageError, match=says):
        bring_in(folder / "unit.csv", write_map(folder, rocket_map(**changes)))


def test_masses_of_another_zero_of_time_are_refused(folder: Path) -> None:
    mapping = rocket_map()
    mapping["vehicle"]["mass"]["time"]["offset"] = 1000.0
    with pytest.raises(UsageError, match=r"vehicle/.*another zero of time"):
        bring_in(folder / "unit.csv", write_map(folder, mapping))


def test_an_entry_has_no_phases() -> None:
    time = np.arange(0.0, 20.0, 0.01)
    assert find_phases(time, -5.0 - time, np.sin(time), np.cos(time)) == ()


def test_a_parachute_ends_an_entry() -> None:
    time = np.arange(0.0, 20.0, 0.01)
    ax = np.where(time < 15.0, -4.0, -60.0)
    phases = find_phases(time, ax, np.sin(time), np.cos(time))
    assert [(phase.name, round(phase.start_s)) for phase in phases] == [("coast", 0), ("parachute", 15)]


@given(lag=st.floats(-3.0, 3.0), factor=st.floats(0.1, 30.0), constant=st.floats(-50.0, 50.0))
def test_a_clock_is_found_whatever_scale_and_constant(lag: float, factor: float, constant: float) -> None:
    time = np.arange(0.0, 20.0, 0.01)

    def profile(t: Any) -> Any:
        return np.exp(-((t - 8.0) ** 2)) + 0.6 * np.exp(-((t - 11.0) ** 2) / 4.0)

    other = np.arange(2.0, 18.0, 0.025)
    moved, likeness = clock_offset(time, profile(time), other - lag, factor * profile(other) + constant)
    assert moved == pytest.approx(lag, abs=5e-3)
    assert likeness > 0.99


def test_clocks_of_unlike_records_are_refused() -> None:
    rng, time = np.random.default_rng(0), np.arange(0.0, 20.0, 0.01)
    with pytest.raises(UsageError, match="clock cannot be found"):
        clock_offset(time, rng.standard_normal(time.size), time, rng.standard_normal(time.size))


@pytest.mark.parametrize(("before", "after"), [(800.0, 40.0), (819.2, 33.0), (100.0, 30.0)])
def test_the_low_pass_passes_and_stops(before: float, after: float) -> None:
    taps = low_pass(before, after)
    frequency = np.linspace(0.0, 0.5 * before, 2000)
    turned = np.exp(-2j * np.pi * np.outer(frequency / before, np.arange(taps.size)))
    gain = np.abs(turned @ taps)
    np.testing.assert_allclose(gain[frequency < DECIMATED_PASS_END * after], 1.0, atol=2e-3)
    assert np.all(gain[frequency > DECIMATED_STOP_BEGIN * after] < 2e-3)
    assert np.sum(taps) == pytest.approx(1.0)


def test_nothing_is_aliased_and_the_motion_stays() -> None:
    time = np.arange(0.0, 10.0, 1.0 / 800.0)
    motion, shaking = np.sin(2.0 * np.pi * 1.3 * time), 5.0 * np.sin(2.0 * np.pi * 79.0 * time)
    channels = dict.fromkeys(("p", "q", "r", "ax", "ay", "az"), motion + shaking)
    channels |= {"velocity": 100.0 + time, "altitude": 1000.0 - time}
    found, _ = decimated(Record(time=time, channels=channels, vehicle=VEHICLE), 40.0)
    assert found.time.size == pytest.approx(400, abs=1)
    full = np.isfinite(found.channels["q"])  # but for the ends, where the filter is not full
    assert np.count_nonzero(full) > 370
    motion = np.sin(2.0 * np.pi * 1.3 * found.time)
    np.testing.assert_allclose(found.channels["q"][full], motion[full], atol=0.01)
    np.testing.assert_allclose(found.channels["velocity"][full], 100.0 + found.time[full], atol=1e-3)


def test_a_record_of_hardly_more_samples_than_needed_stays() -> None:
    time = np.arange(0.0, 10.0, 0.02)
    swing = np.sin(2.0 * np.pi * time)
    assert needed_rate(time, {"q": swing, "r": swing}) is None


def test_biases_come_from_the_pad(unit: dict[str, Any]) -> None:
    channels = {name: values for name, values in unit.items() if name != "time"}
    rested, rest, tolerances, _ = take_out_biases(unit["time"], channels, (-4.5, -0.5), 0.01)
    for name, bias in rockets.BIAS.items():
        np.testing.assert_allclose(unit[name] - rested[name], bias, atol=2e-4)
    assert rest.lean < 0.01
    assert tolerances["accel_bias"][0] < 0.1


def test_speed_of_a_climb_is_within_its_sigma() -> None:
    time = np.arange(0.0, 15.0, 0.005)
    acceleration, speed, altitude = rockets.climb(time)
    rng = np.random.default_rng(3)
    heights = altitude + 6.0 * rng.standard_normal(time.size)
    heights[(time > 2.0) & (time < 2.6)] += 300.0  # near Mach 1
    rest = Rest(0.0, 0.0, 0.01, np.zeros(time.size))
    velocity, _, sigma, _ = ascent(time, acceleration + rockets.GRAVITY + 0.1, heights, rest)
    inside = (time > 1.0) & (time < 14.0)
    error = (velocity - speed)[inside] / sigma[inside]
    assert np.sqrt(np.mean(error**2)) < 1.5
    assert np.median(sigma[inside]) < 5.0


def test_recorders_that_never_overlap_are_refused() -> None:
    time = np.arange(0.0, 10.0, 0.01)
    with pytest.raises(UsageError, match="clocks do not overlap"):
        ascent(time, np.ones(time.size), np.full(time.size, np.nan))


def test_the_map_that_comes_along_is_valid() -> None:
    path = Path(__file__).parents[2] / "configs" / "maps" / "launch12.yaml"
    assert yaml.safe_load(path.read_text())["derive"] == {"velocity": "ascent"}
