"""Binary logs of flight computers, built by hand from their documented layouts: by name, in their units."""

from __future__ import annotations

import struct
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from brv_hypo.errors import FlightRecordError, MissingPackageError
from brv_hypo.importing import bring_in
from brv_hypo.importing.formats import known_formats, read_all, read_columns, sandboxed
from brv_hypo.importing.guess import guess_map
from tests.flight.records import motion
from tests.importing.test_foreign import foreign_map, write_map

MOTION = motion(200)
TIME = MOTION["time"] - MOTION["time"][0]
INERTIAL = ("ax", "ay", "az", "p", "q", "r")


def cats(path: Path) -> Path:
    """Two inertial units, an altitude at a tenth of their rate; an attitude and a voltage that are passed over."""
    content = [b"v3.0.1\0"]
    for k, time in enumerate(TIME):
        head = round(1000 * time) + 7000
        for unit in (0, 1):
            forces = [round(1024 * (MOTION[name][k] / 9.80665 + unit)) for name in INERTIAL[:3]]
            rates = [round(14.28 * np.degrees(MOTION[name][k])) for name in INERTIAL[3:]]
            content.append(struct.pack("<II6h", head, 0x10 + unit, *forces, *rates))
        if k % 10 == 0:
            content.append(struct.pack("<II3f", head, 0x40, 100.0 + 50.0 * time, 50.0, 0.0))
            content.append(struct.pack("<II4h", head, 0x80, 1000, 0, 0, 0))
            content.append(struct.pack("<IIH", head, 0x2000, 7400))
    path.write_bytes(b"".join(content))
    return path


def px4(path: Path) -> Path:
    """A ULog of rates and forces, and of altitudes at a tenth of their rate."""
    topics = {
        "sensor_combined": "uint64_t timestamp;float[3] gyro_rad;float[3] accelerometer_m_s2;",
        "vehicle_air_data": "uint64_t timestamp;float baro_alt_meter;float rho;",
        "airspeed": "uint64_t timestamp;float true_airspeed_m_s;",
    }

    def message(kind: str, content: bytes) -> bytes:
        return struct.pack("<Hc", len(content), kind.encode()) + content

    parts = [b"ULog\x01\x12\x35\x01", struct.pack("<Q", 0), message("B", bytes(40))]
    parts += [message("F", f"{name}:{fields}".encode()) for name, fields in topics.items()]
    parts += [message("A", struct.pack("<BH", 0, k) + name.encode()) for k, name in enumerate(topics)]
    for k, time in enumerate(TIME):
        stamp = round(1e6 * time) + 10**9
        values = [MOTION[name][k] for name in (*INERTIAL[3:], *INERTIAL[:3])]
        parts.append(message("D", struct.pack("<HQ6f", 0, stamp, *values)))
        if k % 10 == 0:
            parts.append(message("D", struct.pack("<HQ2f", 1, stamp, 100.0 + 50.0 * time, 1.2)))
            parts.append(message("D", struct.pack("<HQf", 2, stamp, 50.0)))
    path.write_bytes(b"".join(parts))
    return path


LOGS: dict[str, tuple[Any, dict[str, str]]] = {
    "log.cfl": (cats, {"p": "deg/s", "ax": "g", "altitude": "m", "velocity": "m/s"}),
    "log.ulg": (px4, {"p": "rad/s", "ax": "m/s^2", "altitude": "m", "velocity": "m/s", "density": "kg/m^3"}),
}


@pytest.mark.parametrize("name", LOGS)
def test_a_log_is_read_by_its_layout_and_guessed_in_its_units(tmp_path: Path, name: str) -> None:
    write, units = LOGS[name]
    path = write(tmp_path / name)
    found = yaml.safe_load(guess_map(path).text)["channels"]
    assert {each: found[each]["units"] for each in units} == units
    channels = {each: {"column": each} for each in ("time", *INERTIAL, *units)}
    flight = bring_in(path, write_map(tmp_path, foreign_map() | {"channels": channels, "planet": "earth"})).flight
    for each in INERTIAL:
        np.testing.assert_allclose(getattr(flight, each)[5:150], MOTION[each][5:150], atol=0.006, err_msg=each)
    np.testing.assert_allclose(flight.altitude[:150], 100.0 + 50.0 * TIME[:150], atol=1e-3)


def test_a_second_unit_has_columns_of_its_own(tmp_path: Path) -> None:
    table = read_columns(cats(tmp_path / "log.cfl"), ("time", "ax", "ax_2"))
    np.testing.assert_allclose(table.columns["ax_2"] - table.columns["ax"], 1.0, atol=1e-6)


@pytest.mark.parametrize("name", LOGS)
def test_a_damaged_log_is_refused_or_read_as_far_as_it_goes(tmp_path: Path, name: str) -> None:
    whole = LOGS[name][0](tmp_path / name).read_bytes()
    for content in (whole[:3], whole[: len(whole) // 2], whole[:9] + whole[40:], whole[:200] + bytes(4) + whole[200:]):
        (tmp_path / name).write_bytes(content)
        with suppress(FlightRecordError):
            assert set(read_all(tmp_path / name).columns) >= set(INERTIAL)
    (tmp_path / name).write_bytes(whole[:3])
    with pytest.raises(FlightRecordError, match="Remedy"):
        read_columns(tmp_path / name, ("ax",))


def test_without_pyulog_the_refusal_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sandboxed, "find_spec", lambda name: None)
    with pytest.raises(MissingPackageError, match=r"pip install -e '\.\[px4\]'"):
        read_all(px4(tmp_path / "log.ulg"))
    assert {"cats", "px4"} <= {each.name for each in known_formats()}
