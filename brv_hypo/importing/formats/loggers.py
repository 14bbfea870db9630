"""Rocket loggers whose csv files are known by their headers: their columns get the names and units of channels.

A `Logger` is a text table with the names by which it is recognised and, for each of its columns that is a channel, the
channel's name and units; the other columns keep their names, and a map may use the logger's own names as well. Axes are
the logger's: x along the rocket.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from brv_hypo.importing.formats import Layout, TableFormat
from brv_hypo.importing.formats.delimited import detect, read_text
from brv_hypo.io.binary import ColumnTable


@dataclass(frozen=True)
class Logger:
    """One make of logger: `marks` are texts that its header holds, `columns` the channel and units of a column."""

    name: str
    marks: tuple[str, ...]
    columns: Mapping[str, tuple[str, str]]

    def recognises(self, path: Path, head: str) -> bool:
        """Whether one line of the file's beginning holds all marks."""
        return any(all(mark in line for mark in self.marks) for line in head.splitlines())

    def read(self, path: Path, names: tuple[str, ...], layout: Layout) -> ColumnTable:
        """The columns `names`, by the names of channels or the logger's own."""
        found = detect(path, layout)
        known = {own: channel for own, (channel, _) in self.columns.items() if own in found.names}
        own_names = {channel: own for own, channel in reversed(known.items())}
        table = read_text(path, tuple(own_names.get(name, name) for name in names), layout, found)
        units = {known.get(own, own): text for own, text in found.units.items()}
        units |= {name: text for own, (channel, text) in self.columns.items() for name in (own, channel)}
        return replace(
            table,
            columns={name: table.columns[own_names.get(name, name)] for name in names},
            names=(*(known.get(own, own) for own in found.names), *(name for name in names if name in known)),
            units=units,
        )


ALTOS = Logger(
    "altos",
    ("version,serial,flight", "state_name"),
    {
        "time": ("time", "s"),
        "accel_x": ("ax", "m/s^2"),
        "accel_y": ("ay", "m/s^2"),
        "accel_z": ("az", "m/s^2"),
        "gyro_x": ("p", "deg/s"),
        "gyro_y": ("q", "deg/s"),
        "gyro_z": ("r", "deg/s"),
        "gyro_roll": ("p", "deg/s"),
        "gyro_pitch": ("q", "deg/s"),
        "gyro_yaw": ("r", "deg/s"),
        "altitude": ("altitude", "m"),
        "accel_speed": ("velocity", "m/s"),
        "speed": ("velocity", "m/s"),
    },
)
"""TeleMega, EasyMega, TeleMetrum and others of Altus Metrum: csv exported by AltosUI, whose header is behind a #.

Layout: AltosCSV.java of AltOS (https://git.gag.com/fw/altos, folder altoslib), which states each column's units."""

BLUE_RAVEN = Logger(
    "blue-raven",
    ("Flight_Time_(s)",),
    {
        "Flight_Time_(s)": ("time", "s"),
        "Accel_X": ("ax", "g"),
        "Accel_Y": ("ay", "g"),
        "Accel_Z": ("az", "g"),
        "Gyro_X": ("p", "deg/s"),
        "Gyro_Y": ("q", "deg/s"),
        "Gyro_Z": ("r", "deg/s"),
        "Baro_Altitude_ASL_(feet)": ("altitude", "ft"),
        "Velocity_Up": ("velocity", "ft/s"),
    },
)
"""Featherweight Blue Raven: the two csv files, of high and of low rate, that its phone app exports.

Layout: header of the files and the user's manual at https://www.featherweightaltimeters.com/blue-raven.html."""

EGGTIMER = Logger(
    "eggtimer",
    ("Alt", "Veloc", "FVeloc", "LDA"),
    {"T": ("time", "ms"), "FAlt": ("altitude", "ft"), "Filt_Alt": ("altitude", "ft"), "FVeloc": ("velocity", "ft/s")},
)
"""Eggtimer TRS, Quantum and others: the detail data of one flight; altitude above the pad.

Layout: Eggtimer TRS User's Guide, "Downloading Flight Data" (https://eggtimerrocketry.com)."""

FORMATS = tuple(TableFormat(each.name, each.read, (), each.recognises) for each in (ALTOS, BLUE_RAVEN, EGGTIMER))
