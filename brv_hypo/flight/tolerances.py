"""How well the instruments, the vehicle and the air are known: 1-sigma tolerances by grade, and what overrides them.

Every analysis takes a record as known to these tolerances and no better.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from brv_hypo.errors import FlightRecordError, UsageError
from brv_hypo.flight.units import SI, Dimension, to_si
from brv_hypo.io.text import meant, refusal

TOLERANCE_LEAST = 1e-3  # share of the laboratory's that a tolerance stated as zero counts as: nothing is known exactly


Vector = tuple[float, float, float]

DEFAULT_GRADE = "tactical"
GRADES = ("laboratory", "tactical", "industrial")
_DEGREE = float(np.pi / 180.0)
# Key: dimension, and the 1-sigma of each of GRADES in SI (FLIGHT_FORMAT, Instruments).
_TABLE: Mapping[str, tuple[Dimension, Vector]] = {
    "gyro_bias": ("angular rate", (0.002 * _DEGREE, 0.02 * _DEGREE, 0.2 * _DEGREE)),
    "gyro_scale": ("dimensionless", (1e-4, 5e-4, 3e-3)),
    "gyro_misalignment": ("angle", (1e-4, 5e-4, 3e-3)),
    "accel_bias": ("acceleration", (0.001, 0.01, 0.05)),
    "accel_scale": ("dimensionless", (1e-4, 1e-3, 5e-3)),
    "accel_misalignment": ("angle", (1e-4, 5e-4, 3e-3)),
    "accel_position": ("length", (0.0005, 0.002, 0.005)),
    "time_skew": ("time", (5e-5, 5e-4, 2e-3)),
    "cg_offset": ("length", (0.0001, 0.0005, 0.002)),
    "principal_axis": ("angle", (1e-4, 5e-4, 3e-3)),
    "wind": ("speed", (1.0, 3.0, 10.0)),
    "dynamic_pressure_scale": ("dimensionless", (1e-3, 5e-3, 2e-2)),
    "inertia_ratio": ("dimensionless", (1e-3, 5e-3, 2e-2)),
    "inertia": ("dimensionless", (1e-3, 5e-3, 2e-2)),
}
INSTRUMENT_DIMENSIONS: Mapping[str, Dimension] = {key: dimension for key, (dimension, _) in _TABLE.items()}
# Units of a plain number in a file of tolerances, where they are not SI.
_FILE_UNITS = {"gyro_bias": "deg/s"}


@dataclass(frozen=True)
class Instruments:
    """1-sigma tolerances by body axis (x, y, z), SI: rad/s, rad, m/s^2, m, s, m/s, or relative.

    What has no axis (`time_skew`, the relative ones) holds one value three times; of `cg_offset` and
    `principal_axis` y and z count. `grade` is what the values that nobody stated come from.
    """

    grade: str
    gyro_bias: Vector
    gyro_scale: Vector
    gyro_misalignment: Vector
    accel_bias: Vector
    accel_scale: Vector
    accel_misalignment: Vector
    accel_position: Vector
    time_skew: Vector
    cg_offset: Vector
    principal_axis: Vector
    wind: Vector
    dynamic_pressure_scale: Vector
    inertia_ratio: Vector
    inertia: Vector

    def values(self) -> dict[str, Vector]:
        """Every tolerance by its key."""
        return {field.name: getattr(self, field.name) for field in fields(self) if field.name != "grade"}


@cache
def of_grade(grade: str = DEFAULT_GRADE) -> Instruments:
    """The tolerances of a grade; UsageError with the known ones where there is no such grade."""
    if grade not in GRADES:
        hint = meant(grade, GRADES, "see `brv-hypo docs reference`")
        raise UsageError(f"got the instrument grade '{grade}', expected one of {', '.join(GRADES)} ({hint}).")
    place = GRADES.index(grade)
    return Instruments(grade, **{key: (sizes[place],) * 3 for key, (_, sizes) in _TABLE.items()})


def with_stated(base: Instruments, stated: Mapping[str, Any]) -> Instruments:
    """`base` with stated tolerances, SI, each a number or three; FlightRecordError where one cannot be a tolerance."""
    return Instruments(
        base.grade, **{**base.values(), **{key: _vector(key, value) for key, value in stated.items()}}
    )


def instruments_from(source: str, record: Instruments) -> Instruments:
    """The tolerances that a grade's name or a YAML file gives in place of those of a record.

    In a file, keys and units are those of the flight format: `gyro_bias` in deg/s, all else in SI, or text with units
    ("0.3 deg/s"); `grade` sets what the file does not name. Raises UsageError for an unknown grade, file or key.
    """
    if source in GRADES:
        return of_grade(source)
    path = Path(source)
    if not path.suffix and not path.exists():
        hint = meant(source, GRADES, "or a YAML file of tolerances")
        raise UsageError(f"got the instruments '{source}', expected one of {', '.join(GRADES)}{hint and f' ({hint})'}.")
    from brv_hypo.io.mappings import read_yaml

    return tolerances_of(read_yaml(path, "tolerances"), record, str(path))


def tolerances_of(content: Mapping[str, Any], base: Instruments, origin: str) -> Instruments:
    """The tolerances that a mapping gives over those of `base`: keys and units as `instruments_from` reads them.

    `origin` names the mapping in a refusal. Raises UsageError.
    """
    if "grade" in content:
        base = of_grade(str(content["grade"]))
    stated = {key: value for key, value in content.items() if key != "grade"}
    unknown = [key for key in stated if key not in _TABLE]
    if unknown:
        hint = meant(str(unknown[0]), _TABLE, f"known are grade, {', '.join(_TABLE)}")
        raise UsageError(f"{origin} names the tolerance '{unknown[0]}', which is unknown ({hint}).")
    try:
        return with_stated(base, {key: _read(key, value) for key, value in stated.items()})
    except FlightRecordError as error:
        # What is wrong was written by the user, not found in a record.
        raise UsageError(f"{origin}: {error}") from None


def _read(key: str, value: Any) -> Any:
    """A tolerance of a file in SI."""
    items = value if isinstance(value, list | tuple) else [value]
    found = []
    for item in items:
        number, _, units = str(item).strip().partition(" ")
        try:
            size = float(number)
        except ValueError:
            raise UsageError(
                f"the tolerance '{key}' is {item!r}, expected a number, or one with units."
            ) from None
        dimension = INSTRUMENT_DIMENSIONS[key]
        found.append(
            float(to_si(size, units or _FILE_UNITS.get(key, SI[dimension]), dimension, f"instruments/{key}"))
        )
    return found


def _vector(key: str, value: Any) -> Vector:
    array = np.ravel(np.asarray(value, dtype=float))
    if array.size not in (1, 3) or not np.all(np.isfinite(array)) or np.any(array < 0.0):
        raise refusal(
            f"instruments/{key}",
            f"{array.tolist()}",
            "one 1-sigma tolerance, or three by body axis, none below zero",
            "a fill value, or a sigma and its sign",
            "give a standard deviation",
        )
    least = TOLERANCE_LEAST * _TABLE[key][1][0]
    x, y, z = np.broadcast_to(np.maximum(array, least), (3,)).tolist()
    return x, y, z
