"""Binary files, read in the sandbox: Parquet and MATLAB, and logs of flight computers.

cats   CATS Vega, .cfl: text to the first zero, then records of a stamp in ms, a kind and its values, little-endian, as
       CATS Configurator reads them (https://github.com/catsystems/cats-configurator, src-tauri/src/flight_log.rs)
px4    PX4, .ulg, by pyulog (https://docs.px4.io/main/en/dev_log/ulog_file_format.html): the topics of TOPICS

A log's messages of several sensors, each with stamps of its own, make one table: it has the stamps of the first
inertial unit; other values lie on straight lines between theirs. Columns of a further unit end in `_2`.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.errors import missing_package
from brv_hypo.flight.record import ACCELEROMETERS, GYROS
from brv_hypo.importing.formats import Layout, TableFormat
from brv_hypo.io.binary import ColumnTable, mat_table, parquet_table
from brv_hypo.io.sandbox import Budget, read_in_sandbox
from brv_hypo.io.text import refused

UNITS = {"time": "s", "altitude": "m", "velocity": "m/s", "density": "kg/m^3", "pressure": "Pa"}
# Of a CATS record by kind (its lowest four bits are the sensor's number): columns, their sizes, and the type.
RECORDS: Mapping[int, tuple[tuple[str, ...], FloatArray, str]] = {
    0x10: ((*ACCELEROMETERS, *GYROS), np.array([1 / 1024] * 3 + [1 / 14.28] * 3), "<i2"),
    0x20: (("pressure", "temperature"), np.array([1.0, 0.01]), "<u4"),
    0x40: (("altitude", "velocity", "acceleration"), np.ones(3), "<f4"),
}
SIZES = {0x10: 12, 0x20: 8, 0x40: 12, 0x80: 8, 0x100: 8, 0x200: 4, 0x400: 8, 0x800: 4, 0x1000: 9, 0x2000: 2}  # bytes
OF_CATS = UNITS | dict.fromkeys(ACCELEROMETERS, "g") | dict.fromkeys(GYROS, "deg/s")
OF_PX4 = UNITS | dict.fromkeys(ACCELEROMETERS, "m/s^2") | dict.fromkeys(GYROS, "rad/s")
TOPICS = {
    "sensor_combined": {f"gyro_rad[{k}]": name for k, name in enumerate(GYROS)}
    | {f"accelerometer_m_s2[{k}]": name for k, name in enumerate(ACCELEROMETERS)},
    "vehicle_air_data": {"baro_alt_meter": "altitude", "baro_pressure_pa": "pressure", "rho": "density"},
    "airspeed": {"true_airspeed_m_s": "velocity"},
    "airspeed_validated": {"true_airspeed_m_s": "velocity"},
}

ULOG = "ULog\x01\x12\x35"  # with which a PX4 log begins
Section = tuple[int, FloatArray, dict[str, FloatArray]]
"""The number of a sensor, its stamps (n,) s, and its values (n,) by column."""


def cats_table(path: str, budget: Budget, names: tuple[str, ...]) -> ColumnTable:
    """The columns `names` of a CATS log."""
    raw = np.fromfile(path, dtype=np.uint8)
    budget.take(8 * raw.size, "")
    content, places = raw.tobytes(), defaultdict[int, list[int]](list)
    at = content.find(b"\0") + 1
    while at + 8 <= len(content):
        kind = int.from_bytes(content[at + 4 : at + 8], "little")
        size = SIZES.get(kind & ~15, len(content))
        if at + 8 + size > len(content):
            break
        places[kind].append(at)
        at += 8 + size
    sections = list[Section]()
    for kind, starts in sorted(places.items()):
        columns, sizes, form = RECORDS.get(kind & ~15, ((), np.ones(0), ""))
        if columns:
            rows = raw[np.array(starts)[:, None] + np.arange(8 + SIZES[kind & ~15])]
            time = rows[:, :4].copy().view("<u4")[:, 0] / 1e3
            values = rows[:, 8:].copy().view(form) * sizes
            sections.append((kind & 15, time, dict(zip(columns, values.T, strict=True))))
    return _table(sections, names, OF_CATS)


def px4_table(path: str, budget: Budget, names: tuple[str, ...]) -> ColumnTable:
    """The columns `names` of a PX4 log."""
    from pyulog import ULog

    sections = list[Section]()
    for topic in ULog(path, [*TOPICS]).data_list:
        columns = {name: topic.data[own] for own, name in TOPICS[topic.name].items() if own in topic.data}
        budget.take(8 * sum(each.size for each in columns.values()), topic.name)
        known = {k: v.astype(float) for k, v in columns.items()}
        sections.append((topic.multi_id, topic.data["timestamp"] / 1e6, known))
    return _table(sections, names, OF_PX4)


def _table(sections: Iterable[Section], names: tuple[str, ...], known: Mapping[str, str]) -> ColumnTable:
    """All sections on the stamps of the first inertial unit; `known` has the units of channels."""
    named: dict[str, tuple[FloatArray, FloatArray]] = {}
    units = {"time": "s"}
    for number, time, values in sorted(sections, key=lambda each: each[0]):
        for channel, each in values.items():
            name = channel if channel not in named else f"{channel}_{number + 1}"
            named[name] = (time, each)
            units |= {name: known[channel]} if channel in known else {}
    if "ax" not in named:
        raise refused("", "no record of an inertial unit", "rates and accelerations", "a damaged log", "copy it again")
    clock = named["ax"][0]
    columns: dict[str, Any] = {"time": clock} if "time" in names else {}
    for name in (name for name in names if name in named):
        time, first = np.unique(named[name][0], return_index=True)
        columns[name] = np.interp(clock, time, named[name][1][first], left=np.nan, right=np.nan)
    return ColumnTable(columns, ("time", *named), units)


def _read(library: str, table: Callable[..., ColumnTable], package: str = "", extra: str = "") -> Callable[..., Any]:
    """A reader in the sandbox, which may need a package."""

    def read(path: Path, names: tuple[str, ...], layout: Layout) -> ColumnTable:
        if package and find_spec(package) is None:
            raise missing_package(f"{path}: reading {library}", package, extra)
        return read_in_sandbox(library, table, path, names)

    return read


FORMATS = (
    TableFormat("cats", _read("CATS log", cats_table), (".cfl",)),
    TableFormat("px4", _read("PX4 log", px4_table, "pyulog", "px4"), (".ulg",), lambda _, head: head.startswith(ULOG)),
    TableFormat("parquet", _read("Parquet", parquet_table, "pyarrow", "tables"), (".parquet",)),
    TableFormat("mat", _read("MATLAB", mat_table), (".mat",)),
)
