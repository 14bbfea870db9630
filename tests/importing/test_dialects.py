"""Tables of any recorder: the same motion from every dialect, or a refusal by line and cause; loggers by name."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from brv_hypo.errors import FlightRecordError, UsageError
from brv_hypo.flight import Flight
from brv_hypo.importing import import_record
from brv_hypo.importing.guess import guess_map
from brv_hypo.importing.guess_rules import by_name, units_in
from tests.flight.records import UNITS
from tests.importing.dialects import DIALECTS, REFUSED, TRUTH, Table, csv, fault_of
from tests.importing.test_foreign import foreign_map, write_map


def brought_in(table: Table, folder: Path) -> Flight:
    """The flight by a map that names the columns."""
    table.write(path := folder / f"log.{table.suffix}")
    channels: dict[str, dict[str, Any]] = {}
    for name in TRUTH:
        entry = {"column": table.columns.get(name, name), "units": UNITS[name], **table.channel.get(name, {})}
        channels[name] = {key: value for key, value in entry.items() if value is not None}
    return import_record(path, write_map(folder, {**foreign_map(), "channels": channels, **table.keys}))


@pytest.mark.parametrize("dialect", DIALECTS)
def test_a_table_of_any_dialect_comes_in_as_the_truth(tmp_path: Path, dialect: str) -> None:
    flight = brought_in(DIALECTS[dialect], tmp_path)
    np.testing.assert_allclose(flight.time - flight.time[0], TRUTH["time"], atol=1e-6)
    for name in [*TRUTH][1:]:
        np.testing.assert_allclose(getattr(flight, name), TRUTH[name], rtol=1e-8, atol=1e-6, err_msg=name)


@pytest.mark.parametrize("says", REFUSED)
def test_a_table_that_cannot_come_in_is_refused_by_line_and_cause(tmp_path: Path, says: str) -> None:
    with pytest.raises((FlightRecordError, UsageError), match=says):
        brought_in(REFUSED[says], tmp_path)


LOGGERS = {
    "#version,serial,flight,call,time,state_name,altitude,accel_speed,accel_x,gyro_roll,latitude,altitude": (
        {"time": "s", "altitude": "m", "velocity": "m/s", "p": "deg/s", "ax": "m/s^2"}
    ),
    "Flight_Time_(s),Baro_Altitude_ASL_(feet),Velocity_Up,Accel_X,Gyro_X,Tilt_Angle_(deg)": (
        {"time": "s", "altitude": "ft", "velocity": "ft/s", "p": "deg/s", "ax": "g"}
    ),
    "T,Alt,Veloc,FAlt,FVeloc,LDA,LowV,Apogee,N-O,Drogue,Main": {"time": "ms", "altitude": "ft", "velocity": "ft/s"},
}
LABEL = 'PDS_VERSION_ID = PDS3\n^TABLE = "LOG.TAB"\nOBJECT = TABLE\n{}END_OBJECT = TABLE\nEND\n'
COLUMN = (
    "OBJECT = COLUMN\n  NAME = {}\n  DATA_TYPE = ASCII_REAL\n  START_BYTE = {}\n  BYTES = 9\n  UNIT = {}\n"
    '  MISSING_CONSTANT = -99.0\n  DESCRIPTION = "One\n    axis = x"\nEND_OBJECT = COLUMN\n'
)


@pytest.mark.parametrize(("header", "units"), LOGGERS.items(), ids=["altos", "blue-raven", "eggtimer"])
def test_a_logger_is_known_by_its_header_and_guessed_in_its_units(
    tmp_path: Path, header: str, units: dict[str, str]
) -> None:
    sizes = [{"T": 50.0}.get(name, 0.02 * k) for k, name in enumerate(header.split(","), 1)]
    rows = [",".join(f"{t * size:.2f}" for size in sizes) for t in range(40)]
    (tmp_path / "log.csv").write_text("\n".join([header, *rows]))
    found = yaml.safe_load(guess_map(tmp_path / "log.csv").text)["channels"]
    assert {name: found[name]["units"] for name in units} == units


def test_a_table_of_the_planetary_data_system_is_read_by_its_label(tmp_path: Path) -> None:
    names = {"time": "SECOND", "p": '"RAD/S"'} | {name: UNITS[name] for name in [*TRUTH][2:]}
    columns = [COLUMN.format(name, 1 + 9 * k, unit) for k, (name, unit) in enumerate(names.items())]
    (tmp_path / "log.lbl").write_text(LABEL.format("".join(columns)))
    csv("", form="9.3f", names=None).write(tmp_path / "LOG.TAB")
    mapping = write_map(tmp_path, foreign_map() | {"channels": {name: {"column": name} for name in TRUTH}})
    for name in ("log.lbl", "LOG.TAB"):
        flight = import_record(tmp_path / name, mapping)
        np.testing.assert_allclose(flight.ax, TRUTH["ax"], atol=6e-4)


def test_names_of_rates_and_of_pressures() -> None:
    assert by_name(["P_BARO1", "gyro_roll", "V_BATT", "gyro_yaw", "t_s"])[0] == {
        "p": "gyro_roll",
        "r": "gyro_yaw",
        "time": "t_s",
    }
    assert units_in("gyro_x_deg_per_s", "angular rate") == "deg/s"
    assert units_in("ax [m/s²]", "acceleration") == "m/s^2"


def test_why_no_column_is_time_is_said_by_line_and_cause(tmp_path: Path) -> None:
    says = next(says for says in REFUSED if "several sensors" in says)
    REFUSED[says].write(tmp_path / "log.csv")
    with pytest.raises(UsageError, match=says):
        guess_map(tmp_path / "log.csv")


@pytest.mark.filterwarnings("ignore")
@pytest.mark.thorough
@pytest.mark.parametrize("batch", [0, *(pytest.param(batch, marks=pytest.mark.slow) for batch in (1, 2))])
def test_a_mutated_table_comes_in_or_is_refused(tmp_path: Path, batch: int) -> None:
    assert not [fault for seed in range(100) if (fault := fault_of(tmp_path, 1000 * batch + seed))]
