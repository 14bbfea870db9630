"""Text tables whose description is known beforehand: csv of rocket loggers, and tables of the Planetary Data System.

A logger is known by words of the header of its csv; its columns that are channels get their names and units, by "own
name: channel units". The other columns keep their names, and a map may use the logger's own. Axes are the logger's, x
along the rocket. Layouts:

altos        AltosCSV.java of AltOS (https://git.gag.com/fw/altos, folder altoslib), which states the units: TeleMega,
             EasyMega, TeleMetrum and others of Altus Metrum, as AltosUI exports them, the header behind a #
blue-raven   Featherweight Blue Raven user's manual (https://www.featherweightaltimeters.com): csv of high and low rate
cats-csv     imu.csv that CATS Configurator exports (see sandboxed.py); `where: {id: IMU0}` keeps one unit
eggtimer     Eggtimer TRS User's Guide, "Flight Summary" (https://eggtimerrocketry.com): altitude above the pad
pds3         Planetary Data System, version 3: fixed columns of characters, described by a label (.lbl) beside the table
             or at its beginning: Standards Reference 3.8, appendix A.29 (TABLE) and A.8 (COLUMN), chapter 12 (labels),
             https://pds.nasa.gov/datastandards/pds3/standards/
"""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np

from brv_hypo.errors import FlightRecordError
from brv_hypo.importing.formats import Layout, TableFormat
from brv_hypo.importing.formats.delimited import Dialect, detect, read_text
from brv_hypo.io.binary import ColumnTable
from brv_hypo.io.files import check_regular
from brv_hypo.io.text import refused

GYROS = "gyro_x: p deg/s; gyro_y: q deg/s; gyro_z: r deg/s"
LOGGERS = {
    "altos": (
        ("version,serial,flight", "state_name"),
        f"time: time s; accel_x: ax m/s^2; accel_y: ay m/s^2; accel_z: az m/s^2; {GYROS}; gyro_roll: p deg/s; "
        "gyro_pitch: q deg/s; gyro_yaw: r deg/s; altitude: altitude m; accel_speed: velocity m/s; "
        "speed: velocity m/s; tilt: lean deg",
    ),
    "blue-raven": (
        ("Flight_Time_(s)",),
        f"Flight_Time_(s): time s; Accel_X: ax g; Accel_Y: ay g; Accel_Z: az g; {GYROS.title()}; "
        "Baro_Altitude_ASL_(feet): altitude ft; Velocity_Up: velocity ft/s; "
        "Tilt_Angle_(deg): lean deg",
    ),
    "cats-csv": (
        ("ts,id,Ax,Ay,Az,Gx,Gy,Gz",),
        "ts: time s; Ax: ax m/s^2; Ay: ay m/s^2; Az: az m/s^2; Gx: p deg/s; Gy: q deg/s; Gz: r deg/s",
    ),
    "eggtimer": (
        ("Veloc", "FVeloc", "LDA"),
        "T: time ms; FAlt: altitude ft; Filt_Alt: altitude ft; FVeloc: velocity ft/s",
    ),
}
LONGEST_LABEL = 1 << 20  # bytes
STATEMENT = re.compile(r'^[ \t]*(\^?\w+)[ \t]*=[ \t]*("[^"]*"|\([^)]*\)|[^\r\n]*)', re.MULTILINE)
UNITS = {"SECOND": "s", "SECONDS": "s", "GRAVITY": "g", "METER": "m", "METERS": "m", "KILOMETER": "km"}
MISSING = ("MISSING_CONSTANT", "INVALID_CONSTANT", "NOT_APPLICABLE_CONSTANT")


def _logger(name: str, words: tuple[str, ...], described: str) -> TableFormat:
    columns = {own: tuple(text.split()) for own, _, text in (each.partition(": ") for each in described.split("; "))}

    def recognises(path: Path, head: str) -> bool:
        return any(all(word in line for word in words) for line in head.splitlines())

    def read(path: Path, names: tuple[str, ...] | None, layout: Layout) -> ColumnTable:
        found = detect(path, layout)
        own = {columns[each][0]: each for each in reversed(found.names) if each in columns}
        channels = {each: channel for channel, each in own.items()}
        renamed = tuple(channels.get(each, each) for each in found.names)
        wanted = renamed if names is None else names
        sources = names and tuple(own.get(each, each) for each in names)
        table = read_text(path, sources, layout, found)
        values = {each: table.columns[at] for each in wanted if (at := own.get(each, each)) in table.columns}
        units = {each: columns[own.get(each, each)][1] for each in (*own, *channels)}
        return replace(table, columns=values, names=(*renamed, *channels) if names else renamed, units=units)

    return TableFormat(name, read, (), recognises, True)


# ---- Tables of the Planetary Data System ----


def _read_pds3(path: Path, names: tuple[str, ...], layout: Layout) -> ColumnTable:
    label = _label_of(path)
    with label.open("rb") as stream:
        text = stream.read(LONGEST_LABEL).decode("latin-1")
    blocks = map(STATEMENT.findall, re.findall(r"OBJECT\s*=\s*COLUMN\b(.*?)END_OBJECT", text, re.DOTALL))
    columns = [{key: value.strip().strip('"').strip() for key, value in block} for block in blocks]
    place = re.search(r"^[ \t]*\^\w*TABLE[ \t]*=[ \t]*\(?(?:\"([^\"]+)\")?[ ,]*(\d+)?", text, re.MULTILINE)
    table = _beside(label, place[1]) if place and place[1] else label
    try:
        starts = [int(each["START_BYTE"]) - 1 for each in columns]
        spans = tuple((start, start + int(each["BYTES"])) for start, each in zip(starts, columns, strict=True))
        own_names = tuple(each["NAME"] for each in columns)
        lost = {each["NAME"]: [float(each[key].split()[0]) for key in MISSING if key in each] for each in columns}
        if table is None or not columns or re.search(r'INTERCHANGE_FORMAT\s*=\s*"?BINARY', text):
            raise ValueError("no table of characters" if columns else "no columns")
    except (KeyError, ValueError, IndexError) as error:
        cause = "a binary table, columns in a file of their own (^STRUCTURE), or a table that is not beside its label"
        found = f"a label with an error: {error}"
        raise refused(str(label), found, "a table of characters", cause, "convert it to csv") from error
    check_regular(table, "the table of a label", FlightRecordError)
    kinds = tuple("date" if "TIME" in each.get("DATA_TYPE", "") else "number" for each in columns)
    units = {each["NAME"]: UNITS.get(each["UNIT"].upper(), each["UNIT"]) for each in columns if "UNIT" in each}
    end = re.search(r"^\s*END\s*$", text, re.MULTILINE)
    first = text[: end.end()].count("\n") + 1 if table == label and end else int(place[2] or 1) - 1 if place else 0
    read = read_text(table, names, layout, Dialect("latin-1", "", ".", own_names, kinds, first, units, spans))
    known = {n: np.where(np.isin(each, lost[n]), np.nan, each) for n, each in read.columns.items() if lost[n]}
    return replace(read, columns={**read.columns, **known})


def _label_of(path: Path) -> Path:
    """The label beside a table; else the file itself."""
    return (_beside(path, f"{path.stem}.lbl") if path.suffix.lower() == ".tab" else None) or path


def _is_pds3(path: Path, head: str) -> bool:
    return "PDS_VERSION_ID" in head[:2000] or _label_of(path) != path


def _beside(path: Path, name: str) -> Path | None:
    """A file of that name, in whatever capitals, in the folder of another."""
    return next((each for each in path.parent.iterdir() if each.name.lower() == name.lower()), None)


FORMATS = (*(_logger(name, *each) for name, each in LOGGERS.items()), TableFormat("pds3", _read_pds3, (), _is_pds3))
