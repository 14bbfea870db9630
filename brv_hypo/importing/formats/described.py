"""Text tables whose description is known beforehand: csv of rocket loggers.

A logger is known by words of the header of its csv; its columns that are channels get their names and units, by "own
name: channel units". The other columns keep their names, and a map may use the logger's own. Axes are the logger's, x
along the rocket. Layouts:

altos        AltosCSV.java of AltOS (https://git.gag.com/fw/altos, folder altoslib), which states the units: TeleMega,
             EasyMega, TeleMetrum and others of Altus Metrum, as AltosUI exports them, the header behind a #
blue-raven   Featherweight Blue Raven user's manual (https://www.featherweightaltimeters.com): csv of high and low rate
cats-csv     imu.csv that CATS Configurator exports (see sandboxed.py); `where: {id: IMU0}` keeps one unit
eggtimer     Eggtimer TRS User's Guide, "Flight Summary" (https://eggtimerrocketry.com): altitude above the pad
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from brv_hypo.importing.formats import Layout, TableFormat
from brv_hypo.importing.formats.delimited import detect, read_text
from brv_hypo.io.binary import ColumnTable

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


FORMATS = tuple(_logger(name, *each) for name, each in LOGGERS.items())
