"""A map guessed from names and physics: odd names, wrong and missing units, rotated axes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from brv_hypo.errors import UnanswerableError, UsageError
from brv_hypo.flight.plausibility import gyro_fault
from brv_hypo.flight.record import CHANNEL_DIMENSIONS
from brv_hypo.importing import bring_in
from brv_hypo.importing.guess import guess_map
from brv_hypo.importing.guess_rules import by_name, sense, units_in
from brv_hypo.motion import reconstruct, try_record
from brv_hypo.simulation import simulate
from tests.flight.records import UNITS, VEHICLE
from tests.importing import rockets
from tests.importing.test_foreign import write_csv, write_mat, write_parquet
from tests.shared_data import shared_file

pytestmark = pytest.mark.thorough

DEGREE, FOOT = np.pi / 180.0, 0.3048
WRITERS = [("csv", write_csv), ("parquet", write_parquet), ("mat", write_mat)]


def logged() -> dict[str, Any]:
    """A rocket's inertial unit, with the altitude on its own clock, every fourth sample."""
    unit = {name: values[::4] for name, values in rockets.inertial_unit().items()}
    keep = unit["time"] < rockets.PARACHUTE
    unit = {name: values[keep] for name, values in unit.items()}
    _, speed, altitude = rockets.climb(unit["time"])
    return {**unit, "altitude": altitude, "velocity": speed}


def channels_of(text: str) -> dict[str, Any]:
    found: dict[str, Any] = yaml.safe_load(text)["channels"]
    return found


@pytest.mark.parametrize(("suffix", "write"), WRITERS, ids=[suffix for suffix, _ in WRITERS])
def test_a_guess_filled_in_brings_the_record_in(tmp_path: Path, suffix: str, write: Callable[..., Path]) -> None:
    log = logged()
    columns = {
        "T_ms": 1000.0 * log["time"],
        **{f"gyro_{axis}": log[name] / DEGREE for axis, name in zip("xyz", "pqr", strict=True)},
        **{f"Accel{axis.upper()}": log[f"a{axis}"] / 9.80665 for axis in "xyz"},
        "baro_alt_ft": log["altitude"] / FOOT,
        "battery": 12.0 - 0.01 * log["time"],
    }
    guess = guess_map(write(tmp_path / f"log.{suffix}", columns))
    mapping = yaml.safe_load(guess.text) | {"rate": "auto"}  # which a longer log is offered
    for name in mapping["vehicle"]:
        mapping["vehicle"][name]["value"] = np.asarray(getattr(VEHICLE, name)).tolist()
    (tmp_path / "map.yaml").write_text(yaml.safe_dump(mapping))
    flight = bring_in(tmp_path / f"log.{suffix}", tmp_path / "map.yaml").flight
    inside = (flight.time > 5.0) & (flight.time < 14.0)
    _, speed, altitude = rockets.climb(flight.time[inside])
    np.testing.assert_allclose(flight.velocity[inside], speed, atol=4.0)
    np.testing.assert_allclose(flight.altitude[inside], altitude, atol=10.0)
    swing = 0.06 * np.cos(2.4 * np.pi * flight.time[inside])
    np.testing.assert_allclose(flight.q[inside], swing, atol=1e-2)
    assert "# not used: battery" in guess.text
    assert any("units of AccelX" in doubt or "gyro_x" in doubt for doubt in guess.unsure)


def test_units_in_a_name_are_checked_against_gravity_and_thrust(tmp_path: Path) -> None:
    """The table says m/s^2 and m; its numbers are gravities and feet."""
    log = logged()
    columns = {"met_s": log["time"], "alt_m": log["altitude"] / FOOT}
    columns |= {f"acc_{axis}_mps2": log[f"a{axis}"] / 9.80665 for axis in "xyz"}
    guess = guess_map(write_csv(tmp_path / "a.csv", columns))
    assert {channels_of(guess.text)[f"a{axis}"]["units"] for axis in "xyz"} == {"g"}
    assert any("its name says m/s^2," in doubt for doubt in guess.unsure)
    assert channels_of(guess.text)["altitude"]["units"] == "ft"
    assert any("its name says m, in ft" in doubt for doubt in guess.unsure)


@pytest.mark.parametrize(("axis", "sign"), [(0, 1.0), (0, -1.0), (1, 1.0), (1, -1.0), (2, 1.0), (2, -1.0)])
def test_a_unit_with_other_axes_is_rotated(tmp_path: Path, axis: int, sign: float) -> None:
    log = logged()
    flips = np.array([sign, 1.0, sign])
    columns = {"time_s": log["time"]}
    for place in range(3):
        to = "xyz"[(axis + place) % 3]
        columns[f"acc_{to}_mps2"] = flips[place] * log[("ax", "ay", "az")[place]]
        columns[f"gyr_{to}_radps"] = flips[place] * log["pqr"[place]]
    guess = guess_map(write_csv(tmp_path / "a.csv", columns))
    assert yaml.safe_load(guess.text).get("rotation") == (None if (axis, sign) == (0, 1.0) else "auto")


def test_plain_aviation_names_and_signs_are_read(tmp_path: Path) -> None:
    """Telemetry with NZ positive up and the yaw rate to port: the names and the forces say so."""
    flown = simulate("research_cone", seed=5, duration=3.0).flight
    columns = {
        "GMT_sec": flown.time + 45296.0,
        "VTAS_mph": flown.velocity / 0.44704,
        "QBAR_mbar": flown.dynamic_pressure / 100.0,
    }
    rates = zip(("ROLLRATE", "PITCHRATE", "YAWRATE"), (flown.p, flown.q, -flown.r), strict=True)
    columns |= {f"{name}_dps": rate / DEGREE for name, rate in rates}
    columns |= {"NX_fps2": flown.ax / FOOT, "NY_fps2": flown.ay / FOOT, "NZUP_fps2": -flown.az / FOOT}
    guess = guess_map(write_csv(tmp_path / "tm.csv", columns))
    channels = channels_of(guess.text)
    assert channels["az"] == {"column": "NZUP_fps2", "units": "ft/s^2", "scale": -1}
    assert channels["velocity"] == {"column": "VTAS_mph", "units": "mph"}
    assert any("as if p, q, r were p, q, -r" in each for each in guess.unsure)
    assert any(each.startswith("az: its name says up") for each in guess.unsure)


@pytest.mark.parametrize(
    ("column", "scale", "doubtful"),
    [("NZ", 1, True), ("NZ_UP", -1, True), ("NzDown", 1, False), ("az_g", 1, False), ("normal_accel", 1, True)],
)
def test_a_normal_acceleration_may_be_positive_up(column: str, scale: int, doubtful: bool) -> None:
    assert by_name([column])[0] == {"az": column}
    assert (sense("az", column)[0], bool(sense("az", column)[1])) == (scale, doubtful)
    assert units_in("KTAS", "speed") == "knot"


def test_other_delimiters_and_text_columns_are_no_obstacle(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    rows = [f"{0.01 * i:.2f};{np.sin(i):.4f};ok" for i in range(50)]
    path.write_text("\n".join(["Time [s];Roll Rate [deg/s];state", *rows]))
    guess = guess_map(path)
    assert channels_of(guess.text)["p"] == {"column": "Roll Rate [deg/s]", "units": "deg/s"}
    assert yaml.safe_load(guess.text)["delimiter"] == ";"
    assert "no column was found for velocity, and none for altitude" in " ".join(guess.unsure)


@pytest.mark.parametrize("named", ["ft", pytest.param("m", marks=pytest.mark.thorough)])
def test_files_of_other_recorders_and_of_the_vehicle_go_with_the_log(tmp_path: Path, named: str) -> None:
    """A clock that starts elsewhere, an altimeter in feet, masses counted from ignition: one map for all three."""
    unit = rockets.inertial_unit()
    keep = unit["time"] < rockets.PARACHUTE
    unit = {name: values[keep] for name, values in unit.items()}
    met = np.arange(0.0, 20.0, 0.05)
    push, _, altitude = rockets.climb(met)
    log = write_csv(
        tmp_path / "log.csv",
        {
            "clock_s": unit["time"] + 5000.0,
            **{f"gyro_{axis}_radps": unit[name] for axis, name in zip("xyz", "pqr", strict=True)},
            **{f"acc_{axis}_mps2": unit[f"a{axis}"] for axis in "xyz"},
        },
    )
    second = write_csv(
        tmp_path / "altimeter.csv",
        {"met_s": met, "accel_mps2": push, f"baro_alt_{named}": (altitude - rockets.SITE) / FOOT},
    )
    masses = write_csv(
        tmp_path / "masses.csv",
        {
            "time_s": np.arange(0.0, 21.0),
            "mass_kg": np.full(21, VEHICLE.mass),
            "ixx_kgm2": np.full(21, VEHICLE.ixx),
            "pitch_inertia_kgm2": np.full(21, VEHICLE.iyy),
        },
    )
    guess = guess_map(log, second, masses)
    mapping = yaml.safe_load(guess.text)
    assert mapping["channels"]["altitude"]["recorder"] == "altimeter"
    assert mapping["channels"]["altitude"]["units"] == "ft"
    assert any(doubt.startswith("altitude: its name says m, in ft") for doubt in guess.unsure) == (named == "m")
    assert mapping["recorders"]["altimeter"]["align"]["column"] == "accel_mps2"
    assert mapping["channels"]["time"]["offset"] == pytest.approx(-5000.0, abs=0.1)
    assert {name for name, entry in mapping["vehicle"].items() if "file" in entry} == {"mass", "ixx", "iyy"}
    assert any("site's height above the sea" in doubt for doubt in guess.unsure)
    unknown = "reference_length, reference_area, accelerometer_position"
    assert f"no table gives these properties of the vehicle: {unknown}" in guess.unsure
    for name in ("reference_length", "reference_area"):
        mapping["vehicle"][name]["value"] = float(getattr(VEHICLE, name))
    (tmp_path / "map.yaml").write_text(yaml.safe_dump(mapping))
    flight = bring_in(log, tmp_path / "map.yaml").flight
    inside = (flight.time > 6.0) & (flight.time < 14.0)
    _, speed, _ = rockets.climb(flight.time[inside])
    np.testing.assert_allclose(flight.velocity[inside], speed, atol=5.0)
    assert flight.vehicle.iyy == pytest.approx(VEHICLE.iyy)


def test_a_density_that_is_not_the_earths_puts_the_planet_in_doubt(tmp_path: Path) -> None:
    altitude = np.linspace(40e3, 10e3, 200)
    columns = {"time_s": np.linspace(0, 50, 200), "alt_m": altitude, "rho_kgm3": 0.02 * np.exp(-altitude / 11e3)}
    guess = guess_map(write_csv(tmp_path / "a.csv", columns))
    assert any(doubt.startswith("the planet: the density is") for doubt in guess.unsure)
    assert "# UNSURE: the planet" in guess.text


def test_a_map_that_is_not_filled_in_is_refused_in_one_sentence(tmp_path: Path) -> None:
    log = write_csv(tmp_path / "log.csv", logged())
    (tmp_path / "map.yaml").write_text(guess_map(log).text)
    with pytest.raises(UsageError, match="no value yet for vehicle/mass, vehicle/ixx") as refused:
        bring_in(log, tmp_path / "map.yaml")
    assert len(str(refused.value)) < 400 + len(str(tmp_path))


def test_a_table_without_time_is_refused(tmp_path: Path) -> None:
    path = write_csv(tmp_path / "a.csv", {"p": np.zeros(20), "q": np.ones(20)})
    with pytest.raises(UsageError, match="no column rises strictly"):
        guess_map(path)


@pytest.mark.parametrize(
    ("column", "channel", "units"),
    [
        ("Gyro_X(deg/s)", "p", "deg/s"),
        ("wy_radps", "q", "rad/s"),
        ("angvel z [rpm]", "r", "rpm"),
        ("accX_g", "ax", "g"),
        ("Acceleration Y (m/s^2)", "ay", "m/s^2"),
        ("pitchRate_dps", "q", "deg/s"),
        ("qbar_psf", "dynamic_pressure", "psf"),
        ("GPS alt [ft]", "altitude", "ft"),
        ("v_rel_mps", "velocity", "m/s"),
        ("rho_kgm3", "density", "kg/m^3"),
        ("TimeStamp_us", "time", "us"),
        ("Stamp_days", "time", "day"),
        ("time_hours", "time", "hour"),
        ("t_min", "time", "min"),
        ("time [milliseconds]", "time", "ms"),
        ("PDYN_psf", "dynamic_pressure", "psf"),
        ("q_psf", "dynamic_pressure", "psf"),
        ("Mach", "mach", "dimensionless"),
        ("v_mach", "mach", "dimensionless"),
        ("v_inf_fps", "velocity", "ft/s"),
        ("q_dyn_kPa", "dynamic_pressure", "kPa"),
    ],
)
def test_names_as_they_are_found_in_the_field(column: str, channel: str, units: str) -> None:
    found = by_name([column])[0]
    assert found == {channel: column}
    assert units_in(column, CHANNEL_DIMENSIONS[channel]) == units


@pytest.mark.shared
def test_measured_logs_are_guessed_right() -> None:
    unit = channels_of(guess_map(shared_file("data/launch12/imu.csv")).text)
    assert {name: entry["units"] for name, entry in unit.items()} == {
        "time": "s",
        **dict.fromkeys("pqr", "deg/s"),
        **dict.fromkeys(("ax", "ay", "az"), "m/s^2"),
    }
    folder = shared_file("data/launch12/imu.csv").parent
    whole = yaml.safe_load(guess_map(*(folder / f"{n}.csv" for n in ("imu", "altimeter", "vehicle_history"))).text)
    assert whole["channels"]["altitude"]["units"] == "ft"
    assert whole["recorders"]["altimeter"]["align"]["units"] == "g"
    assert whole["channels"]["time"]["offset"] == pytest.approx(-117853.52, abs=0.01)
    entry = channels_of(guess_map(shared_file("data/opportunity/opportunity_entry.csv")).text)
    assert set(UNITS) & set(entry) == set(entry)
    assert entry["velocity"]["units"] == "m/s"


@pytest.mark.parametrize(
    ("column", "channel", "units"),
    [
        ("qbar_kPa", "dynamic_pressure", "kPa"),
        ("dyn_press_hPa", "dynamic_pressure", "hPa"),
        ("qbar_Pa", "dynamic_pressure", "Pa"),
        ("qbar [mbar]", "dynamic_pressure", "mbar"),
        ("VelocityKmh", "velocity", "km/hour"),
        ("AltFt", "altitude", "ft"),
        ("gyroX_degS", "p", "deg/s"),
        ("roll_dps", "p", "deg/s"),
        ("Pitch [deg/s]", "q", "deg/s"),
        ("yaw_rad_s", "r", "rad/s"),
    ],
)
def test_units_at_the_end_of_a_name_are_read_with_their_capitals(column: str, channel: str, units: str) -> None:
    assert by_name([column])[0] == {channel: column}
    assert units_in(column, CHANNEL_DIMENSIONS[channel]) == units


@pytest.mark.parametrize(("name", "size", "units"), [("Stamp_days", 86400.0, "day"), ("t_min", 60.0, "min")])
def test_units_of_time_in_a_name_are_kept(tmp_path: Path, name: str, size: float, units: str) -> None:
    """Days were taken for seconds, of 17 MHz; minutes as seconds have a rate that recorders have."""
    log = logged()
    columns = {name: log["time"] / size, **{channel: values for channel, values in log.items() if channel != "time"}}
    guess = guess_map(write_csv(tmp_path / "log.csv", columns))
    assert channels_of(guess.text)["time"]["units"] == units
    assert not any(each.startswith("time:") for each in guess.unsure)


@pytest.mark.parametrize("struct", ["", "log"])
def test_units_that_nothing_states_are_doubted(tmp_path: Path, struct: str) -> None:
    """In flight throughout: no rest shows gravity, and no name states units; of a MATLAB file in a struct or not."""
    log = logged()
    flown = log["time"] > 3.0
    names = {"time": "t_ms", "p": "gyro_x", "q": "gyro_y", "r": "gyro_z", "ax": "acc_x", "ay": "acc_y", "az": "acc_z"}
    sizes = {"time": 1e-3, "p": DEGREE, "q": DEGREE, "r": DEGREE, "ax": 9.80665, "ay": 9.80665, "az": 9.80665}
    columns = {name: log[channel][flown] / sizes[channel] for channel, name in names.items()}
    guess = guess_map(write_mat(tmp_path / "log.mat", {struct: columns} if struct else columns))
    found = channels_of(guess.text)
    assert found["p"]["units"] == "deg/s"
    assert found["q"]["column"] == (f"{struct}." if struct else "") + "gyro_y"
    assert any("units of" in doubt and "acc_x" in doubt for doubt in guess.unsure)
    assert next(doubt for doubt in guess.unsure if "gyro_x" in doubt).endswith("deg/s is a guess")
    assert any("no rest" in doubt for doubt in guess.unsure)
    stated = {f"{name}_G" if name.startswith("acc") else name: values for name, values in columns.items()}
    assert not any("no rest" in doubt for doubt in guess_map(write_csv(tmp_path / "log.csv", stated)).unsure)


@pytest.mark.parametrize(
    ("mistaken", "said"),
    [((), None), (("az",), "as if p, q, r were -p, -q, r"), (("q",), "as if p, q, r were p, -q, r")],
)
def test_a_reversed_sign_on_an_entry_is_noticed(tmp_path: Path, mistaken: tuple[str, ...], said: str | None) -> None:
    """Speed and dynamic pressure give the signs where no thrust does."""
    flight = simulate("blunt_capsule", seed=1, duration=4.0).flight
    units = {"time": "s", **dict.fromkeys("pqr", "radps"), **dict.fromkeys(("ax", "ay", "az"), "mps2")}
    units |= {"velocity": "mps", "dynamic_pressure": "Pa"}
    columns = {f"{n}_{u}": (-1.0 if n in mistaken else 1.0) * getattr(flight, n) for n, u in units.items()}
    guess = guess_map(write_csv(tmp_path / "a.csv", columns))
    doubts = [doubt for doubt in guess.unsure if " as if " in doubt]
    assert [said in doubt for doubt in doubts] == ([True] if said else [])
    assert not any("not checked" in doubt for doubt in guess.unsure)
    assert all(f"# UNSURE: {doubt}" in guess.text for doubt in doubts)


def test_gyros_in_units_of_their_own_keep_them(tmp_path: Path) -> None:
    flight = simulate("research_cone", seed=1, duration=4.0).flight
    units = {"time": "s", **dict.fromkeys(("ax", "ay", "az"), "mps2"), "velocity": "mps", "dynamic_pressure": "Pa"}
    columns = {f"{name}_{unit}": getattr(flight, name) for name, unit in units.items()}
    columns |= {"p_rps": flight.p / (2.0 * np.pi), "q_dps": flight.q / DEGREE, "r_dps": flight.r / DEGREE}
    guess = guess_map(write_csv(tmp_path / "a.csv", columns))
    found = channels_of(guess.text)
    assert [found[name]["units"] for name in "pqr"] == ["revolution/s", "deg/s", "deg/s"]
    assert "the forces across the axis follow from the rates in deg/s" in guess.text
    assert not any("gyro" in doubt or "dps" in doubt for doubt in guess.unsure)


def test_no_unit_makes_a_rate_that_no_vehicle_has(tmp_path: Path) -> None:
    """Two gyros in deg/min beside one in revolutions per second: the roll decides in which units the forces follow."""
    flight = simulate("research_cone", seed=1, duration=4.0).flight
    units = {"time": "s", **dict.fromkeys(("ax", "ay", "az"), "mps2"), "velocity": "mps", "q_inf": "kPa"}
    columns = {f"{name}_{unit}": getattr(flight, name) for name, unit in units.items() if name != "q_inf"}
    columns |= {"q_inf_kPa": 1e-3 * flight.dynamic_pressure, "gyro_x": flight.p / (2.0 * np.pi), "v_mach": flight.mach}
    columns |= {"gyro_y": 60.0 * flight.q / DEGREE, "gyro_z": 60.0 * flight.r / DEGREE}
    guess = guess_map(write_csv(tmp_path / "a.csv", columns))
    found = channels_of(guess.text)
    assert [found[name]["column"] for name in ("q", "dynamic_pressure", "mach")] == ["gyro_y", "q_inf_kPa", "v_mach"]
    assert all(f"{name}: units of gyro_{axis} are not stated: deg/s is a guess" in guess.unsure
               for name, axis in zip("pqr", "xyz", strict=True))  # fmt: skip


def test_gyros_that_no_vehicle_reaches_are_a_fault_and_a_refusal() -> None:
    flight = simulate("research_cone", seed=1, duration=4.0).flight
    misread = replace(flight, q=1e5 * flight.q, r=1e5 * flight.r)
    fault = try_record(misread)[1].faults[0]
    assert (fault.channel, fault.decisive) == ("q, r", True)
    assert "correct those of q, r in the map" in fault.action
    with pytest.raises(UnanswerableError, match=r"the gyros, q, r: up to .* expected less than 1000"):
        reconstruct(misread)


def test_signs_that_nothing_shows_are_said_to_be_unchecked(tmp_path: Path) -> None:
    flight = simulate("blunt_capsule", seed=1, duration=4.0).flight
    columns = {name: getattr(flight, name) for name in ("time", "p", "q", "r", "ax", "ay", "az", "velocity")}
    guess = guess_map(write_csv(tmp_path / "a.csv", columns))
    assert any("signs and axes of gyros and accelerometers were not checked" in doubt for doubt in guess.unsure)


def test_a_position_that_no_table_gives_is_marked(tmp_path: Path) -> None:
    guess = guess_map(write_csv(tmp_path / "a.csv", logged()))
    lines = guess.text.splitlines()
    place = next(k for k, line in enumerate(lines) if line.startswith("  accelerometer_position"))
    assert lines[place - 1].startswith("  # MISSING: accelerometer_position: unknown while zeros")
    assert any(doubt.startswith("accelerometer_position: unknown while zeros") for doubt in guess.unsure)


@pytest.mark.parametrize(("seconds", "offered"), [(10.0, False), (40.0, True)])
def test_a_long_and_fast_log_alone_is_offered_another_rate(tmp_path: Path, seconds: float, offered: bool) -> None:
    """As it is, its noise is known better, and nothing is filtered."""
    time = np.arange(0.0, seconds, 0.005)
    columns = {"VTRUE_FPS": 4000.0 - time, "HBARO_FT": 9e4 - 100.0 * time, "TIME_S": time, "P_DPS": 300.0 + time}
    text = guess_map(write_csv(tmp_path / "log.csv", columns)).text
    assert ("rate: auto" in text) is offered
    assert {name: channels_of(text)[name]["units"] for name in ("velocity", "altitude")} == {
        "velocity": "ft/s",
        "altitude": "ft",
    }


@pytest.mark.parametrize("falls", [False, True])
def test_speed_is_derived_from_a_climb_alone(tmp_path: Path, falls: bool) -> None:
    """On an entry the altitude gives none: its column is named, or said to be missing."""
    time = np.arange(0.0, 5.0, 0.01)
    altitude = 1e3 * (60.0 - time) if falls else 1e3 * time
    columns = {"GMT_s": time, "P_dps": 70.0 + np.sin(time), "Q_dps": np.sin(3.0 * time), "R_dps": np.cos(3.0 * time)}
    columns |= {"NX_g": -1.0 - 0.1 * time, "NY_g": 0.01 * np.sin(time), "NZ_g": 0.01 * np.cos(time), "ALT_m": altitude}
    bare = guess_map(write_csv(tmp_path / "bare.csv", columns))
    assert ("derive" in yaml.safe_load(bare.text)) is not falls
    assert ("no column was found for velocity, and the altitude of no climb" in " ".join(bare.unsure)) is falls
    whole = guess_map(write_csv(tmp_path / "whole.csv", columns | {"VT_mps": 8000.0 - time}))
    assert channels_of(whole.text)["velocity"] == {"column": "VT_mps", "units": "m/s"}


@pytest.mark.parametrize(("wrong", "named"), [("", []), ("p", ["p"]), ("q", ["q"]), ("r", ["r"]), ("pqr", ["p, q, r"])])
@pytest.mark.parametrize("misread", [DEGREE, 1.0 / DEGREE])
def test_units_of_one_gyro_are_not_blamed_on_all(wrong: str, named: list[str], misread: float) -> None:
    """One in rad/s that was taken for deg/s, or the reverse, was silent, or all three were named."""
    for seed in (1, 3, 5):
        log = rockets.fly(seed)
        size = np.array([[misread if name in wrong else 1.0] for name in "pqr"])
        assert [fault.channel for fault in gyro_fault(log.time, size * log.rates, log.forces)] == named
