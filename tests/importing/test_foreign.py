"""Foreign records: the same flight from csv, parquet and mat, and maps that are wrong."""

from __future__ import annotations

import csv
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import scipy.io
import yaml

from brv_hypo.errors import FlightRecordError, UsageError
from brv_hypo.flight import CHANNELS, Flight, load_flight, save_flight
from brv_hypo.importing import import_record
from brv_hypo.importing.formats import sandboxed
from brv_hypo.importing.guess import guess_map
from tests.flight.records import UNITS, VEHICLE, motion, write_raw
from tests.importing.dialects import mat

DEGREE = np.pi / 180.0


def foreign_columns() -> dict[str, Any]:
    """`motion()` under foreign names: p in deg/s with its sign reversed, velocity in km/s and off by one."""
    columns = {f"col_{name}": values for name, values in motion().items()}
    columns["col_p"] = -columns["col_p"] / DEGREE
    columns["col_velocity"] = columns["col_velocity"] / 1000.0 + 1.0
    return columns


def foreign_map(prefix: str = "col_") -> dict[str, Any]:
    channels: dict[str, Any] = {
        name: {"column": f"{prefix}{name}", "units": UNITS[name]} for name in ("time", *CHANNELS)
    }
    channels["p"] |= {"units": "deg/s", "scale": -1.0}
    channels["velocity"] |= {"units": "km/s", "offset": -1.0}
    vehicle = {
        name: {"value": np.asarray(getattr(VEHICLE, name)).tolist(), "units": UNITS[name]}
        for name in VEHICLE.__dataclass_fields__
    }
    return {"title": "A foreign flight", "planet": "Mars", "channels": channels, "vehicle": vehicle}


def write_map(folder: Path, content: Any) -> Path:
    path = folder / "map.yaml"
    path.write_text(yaml.safe_dump(content))
    return path


def write_csv(path: Path, columns: dict[str, Any], delimiter: str = ",") -> Path:
    with path.open("w", newline="") as stream:
        stream.write("# written by a logger\n")
        writer = csv.writer(stream, delimiter=delimiter)
        writer.writerow(columns)
        for row in zip(*columns.values(), strict=True):
            writer.writerow(["" if value != value else repr(float(value)) for value in row])
    return path


def write_parquet(path: Path, columns: dict[str, Any]) -> Path:
    pd.DataFrame(columns).to_parquet(path)
    return path


def write_mat(path: Path, columns: dict[str, Any]) -> Path:
    scipy.io.savemat(path, columns)
    return path


def write_mat73(path: Path, columns: dict[str, Any]) -> Path:
    """A v7.3 file as MATLAB writes it: row vectors as columns."""
    mat(lambda file: file.update({name: np.asarray(each)[:, None] for name, each in columns.items()})).write(path)
    return path


def reference(folder: Path) -> Flight:
    header = {"format": "brv-flight", "format_version": 1, "planet": "mars"}
    return load_flight(write_raw(folder / "reference.h5", motion(), attributes=header))


@pytest.mark.parametrize(
    ("suffix", "write"),
    [("csv", write_csv), ("parquet", write_parquet), ("mat", write_mat), ("mat", write_mat73)],
    ids=["csv", "parquet", "mat-v5", "mat-v7.3"],
)
def test_every_kind_of_file_gives_the_same_flight(
    tmp_path: Path, suffix: str, write: Callable[[Path, dict[str, Any]], Path]
) -> None:
    data = write(tmp_path / f"data.{suffix}", foreign_columns())
    found, expected = import_record(data, write_map(tmp_path, foreign_map())), reference(tmp_path)
    for name in ("time", *CHANNELS):
        np.testing.assert_allclose(getattr(found, name), getattr(expected, name), rtol=1e-12, err_msg=name)
    assert found.vehicle == expected.vehicle
    assert (found.planet, found.title, found.source) == ("mars", "A foreign flight", f"data.{suffix}")
    assert found.notes == expected.notes


def test_columns_in_a_matlab_struct_are_found(tmp_path: Path) -> None:
    columns = foreign_columns()
    scipy.io.savemat(tmp_path / "data.mat", {"log": columns})
    found = import_record(tmp_path / "data.mat", write_map(tmp_path, foreign_map("log.col_")))
    np.testing.assert_allclose(found.q, motion()["q"], rtol=1e-12)


def test_delimiter_missing_cells_and_fill_values(tmp_path: Path) -> None:
    columns, mapping = foreign_columns(), foreign_map()
    columns["col_q"][100:103] = np.nan
    columns["col_r"][200:203] = -999.0
    mapping["delimiter"] = ";"
    mapping["channels"]["r"]["missing"] = -999.0
    found = import_record(write_csv(tmp_path / "d.csv", columns, ";"), write_map(tmp_path, mapping))
    np.testing.assert_allclose(found.q, motion()["q"], atol=8e-3)
    np.testing.assert_allclose(found.r, motion()["r"], atol=8e-3)
    assert [note.split(":")[0] for note in found.notes if "bridged" in note] == ["q", "r"]


def test_an_imported_flight_is_saved_and_read_back(tmp_path: Path) -> None:
    found = import_record(write_csv(tmp_path / "d.csv", foreign_columns()), write_map(tmp_path, foreign_map()))
    save_flight(found, tmp_path / "flight.h5")
    np.testing.assert_array_equal(load_flight(tmp_path / "flight.h5").q, found.q)


def changed(*keys: str, value: Any = None) -> dict[str, Any]:
    """The map with one entry replaced, or removed where `value` is None."""
    mapping = foreign_map()
    inner = mapping
    for key in keys[:-1]:
        inner = inner[key]
    inner.pop(keys[-1], None)
    if value is not None:
        inner[keys[-1]] = value
    return mapping


@pytest.mark.parametrize(
    ("mapping", "says"),
    [
        (changed("channels", "q", "units"), "channels/q/units"),
        (changed("channels", "q", "scale", value="twice"), "channels/q/scale"),
        (changed("channels", "q", "colum", value="x"), "channels/q/colum"),
        (changed("channels", "velocty", value={"column": "a", "units": "m"}), "is 'velocity' meant"),
        (changed("vehicle", "weight", value={"value": 1.0, "units": "kg"}), "vehicle/weight"),
        (changed("vehicle"), "vehicle"),
        (changed("channels", "time"), "channels/time"),
        (changed("channels", "q", "column", value="col_Q"), "no column 'col_Q'.*'col_q'"),
        (["a", "list"], "holds list"),
    ],
)
def test_a_wrong_map_is_a_usage_error_that_names_the_entry(tmp_path: Path, mapping: Any, says: str) -> None:
    data = write_csv(tmp_path / "d.csv", foreign_columns())
    with pytest.raises(UsageError, match=says):
        import_record(data, write_map(tmp_path, mapping))


@pytest.mark.parametrize("text", ["channels: [", "\tx", None])
def test_an_unreadable_map_is_a_usage_error(tmp_path: Path, text: str | None) -> None:
    path = tmp_path / "map.yaml"
    if text is not None:
        path.write_text(text)
    with pytest.raises(UsageError, match=r"map\.yaml: cannot be read"):
        import_record(write_csv(tmp_path / "d.csv", foreign_columns()), path)


@pytest.mark.parametrize(
    ("mapping", "says"),
    [
        (changed("channels", "q", "units", value="volt"), "'q'.*volt"),
        (changed("channels", "q"), "'q'.*no such dataset"),
        (changed("vehicle", "mass"), "'vehicle/mass'"),
        (changed("vehicle", "mass", value={"value": -1.0, "units": "kg"}), "'vehicle/mass'.*greater than"),
    ],
)
def test_a_map_that_makes_no_record_is_refused_by_name(tmp_path: Path, mapping: Any, says: str) -> None:
    data = write_csv(tmp_path / "d.csv", foreign_columns())
    with pytest.raises(FlightRecordError, match=says) as caught:
        import_record(data, write_map(tmp_path, mapping))
    assert str(data) in str(caught.value)


@pytest.mark.parametrize(
    ("name", "content", "says"),
    [
        ("data.csv", b"col_time,col_p\n1,2,abc\n", "no column"),
        ("data.csv", b"\xff\xfe\x00\x01", "cannot be read"),
        ("data.csv", b"", "no column"),
        ("data.mat", b"not matlab", "cannot be read"),
        ("data.parquet", b"not parquet", "cannot be read"),
        ("data.xlsx", b"", "expected .csv, .cfl, .ulg, .parquet, .mat"),
        ("absent/data.csv", None, "no such file"),
    ],
)
def test_unreadable_data_are_refused(tmp_path: Path, name: str, content: bytes | None, says: str) -> None:
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises((FlightRecordError, UsageError), match=says):
        import_record(tmp_path / name, write_map(tmp_path, foreign_map()))


def test_text_in_a_column_is_refused_by_name(tmp_path: Path) -> None:
    data = write_csv(tmp_path / "d.csv", foreign_columns())
    lines = data.read_text().splitlines()
    lines[2] = lines[2].replace(lines[2].split(",")[2], "deg/s", 1)
    data.write_text("\n".join(lines))
    with pytest.raises(FlightRecordError, match=r"'col_q'.*'deg/s'"):
        import_record(data, write_map(tmp_path, foreign_map()))


def test_parquet_without_its_extra_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    data = write_parquet(tmp_path / "d.parquet", foreign_columns())
    monkeypatch.setattr(sandboxed, "find_spec", lambda name: None)
    with pytest.raises(UsageError, match=r"pip install -e '.\[tables\]'"):
        import_record(data, write_map(tmp_path, foreign_map()))


FIXED_WIDTH = """
import numpy as np
from brv_hypo.io.binary import ColumnTable

def read(path, names, delimiter):
    header, *rows = [line.split() for line in path.read_text().splitlines()]
    columns = {name: np.array([float(row[header.index(name)]) for row in rows]) for name in names}
    return ColumnTable(columns, tuple(header))
"""


def test_a_package_adds_a_format_in_one_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "fixed_width.py").write_text(FIXED_WIDTH)
    installed = tmp_path / "fixed_width-1.0.dist-info"
    installed.mkdir()
    (installed / "METADATA").write_text("Metadata-Version: 2.1\nName: fixed-width\nVersion: 1.0\n")
    (installed / "entry_points.txt").write_text("[brv_hypo.table_formats]\ndat = fixed_width:read\n")
    monkeypatch.syspath_prepend(tmp_path)
    columns = foreign_columns()
    rows = [" ".join(columns), *(" ".join(map(repr, map(float, row))) for row in zip(*columns.values(), strict=True))]
    (tmp_path / "data.dat").write_text("\n".join(rows))
    found = import_record(tmp_path / "data.dat", write_map(tmp_path, foreign_map()))
    np.testing.assert_allclose(found.q, motion()["q"], rtol=1e-12)
    assert "not used: col_q" in guess_map(tmp_path / "data.dat").text
    with pytest.raises(UsageError, match=r"expected \.csv, \.cfl, \.ulg, \.parquet, \.mat, \.dat"):
        import_record(write_csv(tmp_path / "d.xls", columns), write_map(tmp_path, foreign_map()))
