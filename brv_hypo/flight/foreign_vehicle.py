"""The vehicle of a foreign record, from its map or a table over time, and how well all of it is known."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.constants import DENSITY_OF_THE_DAY, STEADY_PROPERTY
from brv_hypo.errors import UsageError
from brv_hypo.flight.instruments import DEFAULT_GRADE, Instruments, of_grade, tolerances_of, with_stated
from brv_hypo.flight.record_map import RecordMap, VehicleColumn
from brv_hypo.flight.schema import VEHICLE_DIMENSIONS, VehicleRecord, validated
from brv_hypo.flight.tables import found_file, read_columns
from brv_hypo.flight.units import to_si


@dataclass(frozen=True)
class ForeignVehicle:
    """The properties; half the relative range of the inertias over the window (0: constant); notes in words."""

    record: VehicleRecord
    inertia: float
    notes: tuple[str, ...]


def vehicle_of(mapping: RecordMap, folders: tuple[Path, ...], window: tuple[float, float]) -> ForeignVehicle:
    """The map's vehicle; a property that a table gives is its mean over `window` s.

    Raises UsageError where a table holds nothing in the window, FlightRecordError for what no vehicle has.
    """
    values: dict[str, Any] = {}
    changes, notes = 0.0, []
    for name, entry in mapping.vehicle.items():
        if isinstance(entry, VehicleColumn):
            values[name], change = _from_table(name, entry, mapping.delimiter, folders, window)
            changes = max(changes, 0.0 if name == "mass" else change)
            told = f", which changes by ±{100.0 * change:.2g} % in the window" if change > STEADY_PROPERTY else ""
            notes.append(f"vehicle/{name} {values[name]:.5g} from {entry.file}{told}")
        else:
            label = f"vehicle/{name}"
            values[name] = to_si(
                np.asarray(entry.value), entry.units, VEHICLE_DIMENSIONS[name], label
            ).tolist()
    return ForeignVehicle(validated(VehicleRecord, values, group="vehicle"), changes, tuple(notes))


def instruments_of(
    mapping: RecordMap,
    from_pad: Mapping[str, Any],
    inertia: float,
    channels: Mapping[str, FloatArray],
    speed_sigma: FloatArray | None,
) -> Instruments:
    """Tolerances: of the map's grade, then what pad, table and derived speed show, then what the map states.

    `inertia` is relative, of `ForeignVehicle`; `speed_sigma` (n,) m/s of a derived speed, None for a measured one.
    """
    grade = of_grade(str(mapping.instruments.get("grade", DEFAULT_GRADE)))
    shown: dict[str, Any] = dict(from_pad)
    if inertia > STEADY_PROPERTY:
        shown |= {"inertia": float(np.hypot(inertia, grade.inertia[0]))}
    pressure = _pressure_tolerance(channels, speed_sigma)
    if pressure > grade.dynamic_pressure_scale[0]:
        shown |= {"dynamic_pressure_scale": pressure}
    stated = {key: value for key, value in mapping.instruments.items() if key != "grade"}
    return tolerances_of(stated, with_stated(grade, shown), "the map's instruments")


def _pressure_tolerance(channels: Mapping[str, FloatArray], speed_sigma: FloatArray | None) -> float:
    """Relative 1-sigma of a dynamic pressure that is made of speed and a standard atmosphere; 0 of a measured one."""
    if "dynamic_pressure" in channels:
        return 0.0
    density = 0.0 if "density" in channels else DENSITY_OF_THE_DAY
    if speed_sigma is None:
        return density
    return float(np.hypot(density, 2.0 * np.nanmedian(speed_sigma / channels["velocity"])))


def _from_table(
    name: str, entry: VehicleColumn, delimiter: str, folders: tuple[Path, ...], window: tuple[float, float]
) -> tuple[float, float]:
    """Mean of a property over the window, SI, and half its relative range."""
    path = found_file(entry.file, folders)
    columns = read_columns(path, (entry.time.column, entry.column), delimiter)
    stamps = entry.time.scale * columns[entry.time.column] + entry.time.offset
    time = to_si(stamps, entry.time.units, "time", f"vehicle/{name}/time")
    values = to_si(columns[entry.column], entry.units, VEHICLE_DIMENSIONS[name], f"vehicle/{name}")
    known = np.isfinite(time) & np.isfinite(values)
    time, values = time[known], values[known]
    inside = values[(time >= window[0]) & (time <= window[1])]
    if not inside.size:
        raise UsageError(
            f"vehicle/{name}: {path} has no value of {entry.column} from {window[0]:.3g} to {window[1]:.3g} s. "
            "Likely cause: another zero of time. Remedy: correct the offset of its time, or give a value."
        )
    mean = float(np.mean(inside))
    return mean, 0.5 * float(np.ptp(inside)) / abs(mean) if mean else 0.0
