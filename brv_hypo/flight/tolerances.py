"""How well the instruments, the vehicle and the air are known: 1-sigma tolerances by grade, and what overrides them.

Every analysis takes a record as known to these tolerances and no better.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields, replace
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
_ALONG = "instruments"  # folder of the tolerances that come along
_DEGREE = float(np.pi / 180.0)


def _of(dimension: Dimension, *sigmas: float) -> dict[str, Any]:
    """The dimension of a tolerance and the 1-sigma of each of `GRADES`, SI (FLIGHT_FORMAT, Instruments)."""
    return {"dimension": dimension, "sigmas": sigmas}


@dataclass(frozen=True)
class Instruments:
    """1-sigma tolerances by body axis (x, y, z), SI; what has no axis holds one value three times."""

    grade: str  # what the values that were not stated come from
    gyro_bias: Vector = field(metadata=_of("angular rate", 0.002 * _DEGREE, 0.02 * _DEGREE, 0.2 * _DEGREE))  # rad/s
    gyro_scale: Vector = field(metadata=_of("dimensionless", 1e-4, 5e-4, 3e-3))  # relative error of the scale factor
    gyro_misalignment: Vector = field(metadata=_of("angle", 1e-4, 5e-4, 3e-3))  # rad
    accel_bias: Vector = field(metadata=_of("acceleration", 0.001, 0.01, 0.05))  # m/s^2
    accel_scale: Vector = field(metadata=_of("dimensionless", 1e-4, 1e-3, 5e-3))  # relative error of the scale factor
    accel_misalignment: Vector = field(metadata=_of("angle", 1e-4, 5e-4, 3e-3))  # rad
    accel_position: Vector = field(metadata=_of("length", 0.0005, 0.002, 0.005))  # m
    time_skew: Vector = field(metadata=_of("time", 5e-5, 5e-4, 2e-3))  # s, accelerometers off gyros; no axis
    cg_offset: Vector = field(metadata=_of("length", 0.0001, 0.0005, 0.002))  # m off the axis; y and z count
    principal_axis: Vector = field(metadata=_of("angle", 1e-4, 5e-4, 3e-3))  # rad off the body axis; y and z count
    wind: Vector = field(metadata=_of("speed", 1.0, 3.0, 10.0))  # m/s
    dynamic_pressure_scale: Vector = field(metadata=_of("dimensionless", 1e-3, 5e-3, 2e-2))  # relative; no axis
    inertia_ratio: Vector = field(metadata=_of("dimensionless", 1e-3, 5e-3, 2e-2))  # of Ix / I, relative; no axis
    inertia: Vector = field(metadata=_of("dimensionless", 1e-3, 5e-3, 2e-2))  # of I, relative; no axis

    def values(self) -> dict[str, Vector]:
        """Every tolerance by its key."""
        return {key: getattr(self, key) for key in INSTRUMENT_DIMENSIONS}

    @property
    def stated(self) -> tuple[str, ...]:
        """Keys of the tolerances that differ from the grade's own."""
        own = of_grade(self.grade)
        return tuple(key for key, value in self.values().items() if value != getattr(own, key))

    @property
    def described(self) -> str:
        """The grade, and how many of the tolerances differ from its own."""
        return self.grade + (f" but for {len(self.stated)} of {len(_SIGMAS)} tolerances" if self.stated else "")


INSTRUMENT_DIMENSIONS: Mapping[str, Dimension] = {
    each.name: each.metadata["dimension"] for each in fields(Instruments) if each.metadata
}
_SIGMAS = {each.name: each.metadata["sigmas"] for each in fields(Instruments) if each.metadata}


@cache
def of_grade(grade: str = DEFAULT_GRADE) -> Instruments:
    """The tolerances of a grade; UsageError with the known ones where there is no such grade."""
    if grade not in GRADES:
        hint = meant(grade, GRADES, "or, by --instruments, a YAML file of tolerances")
        raise UsageError(f"got the instrument grade '{grade}', expected one of {', '.join(GRADES)} ({hint}).")
    place = GRADES.index(grade)
    return Instruments(grade, **{key: (sigmas[place],) * 3 for key, sigmas in _SIGMAS.items()})


def check_known(keys: Iterable[str]) -> None:
    """Raise FlightRecordError for the first key that is no tolerance's."""
    for key in keys:
        if key not in _SIGMAS:
            known = ", ".join(_SIGMAS)
            cause = meant(key, _SIGMAS, "another vocabulary")
            raise refusal(f"instruments/{key}", "an unknown tolerance", f"one of {known}", cause, "rename or drop it")


def with_stated(base: Instruments, stated: Mapping[str, Any]) -> Instruments:
    """`base` with stated tolerances, SI, each a number or three; FlightRecordError where one cannot be a tolerance."""
    changes: dict[str, Any] = {key: _vector(key, value) for key, value in stated.items()}
    return replace(base, **changes)


def instruments_from(source: str | Path, record: Instruments) -> Instruments:
    """The tolerances that a grade's name, a YAML file, or the name of one that comes along gives in place of a
    record's. In a file, keys and units are those of the flight format: `gyro_bias` in deg/s, all else in SI, or text
    with units ("0.3 deg/s"); `grade` sets what the file does not name. Raises UsageError for what is unknown.
    """
    from brv_hypo.io.files import config_names, config_path
    from brv_hypo.io.mappings import read_yaml

    path = config_path(source, _ALONG) if str(source) in config_names(_ALONG) else Path(source)
    if str(source) in GRADES or not (path.suffix or path.exists()):
        return of_grade(str(source))
    return tolerances_of(read_yaml(path, "tolerances"), record, str(path))


def tolerances_of(content: Mapping[str, Any], base: Instruments, origin: str) -> Instruments:
    """The tolerances that a mapping gives over `base`, as of `instruments_from`; UsageError, naming `origin`."""
    if "grade" in content:
        base = of_grade(str(content["grade"]))
    stated = {key: value for key, value in content.items() if key != "grade"}
    try:
        check_known(stated)
        return with_stated(base, {key: _read(key, value) for key, value in stated.items()})
    except FlightRecordError as error:
        # What is wrong was written by the user, not found in a record.
        raise UsageError(f"{origin}: {error}") from None


def _read(key: str, value: Any) -> Any:
    dimension = INSTRUMENT_DIMENSIONS[key]
    plain = "deg/s" if key == "gyro_bias" else SI[dimension]
    found = []
    for item in value if isinstance(value, list | tuple) else [value]:
        number, _, units = str(item).strip().partition(" ")
        try:
            size = float(number)
        except ValueError:
            raise UsageError(f"the tolerance '{key}' is {item!r}, expected a number, or one with units.") from None
        found.append(float(to_si(size, units or plain, dimension, f"instruments/{key}")))
    return found


def _vector(key: str, value: Any) -> Vector:
    array = np.ravel(np.asarray(value, dtype=float))
    if array.size not in (1, 3) or not np.all(np.isfinite(array)) or np.any(array < 0.0):
        found, expected = f"{array.tolist()}", "one 1-sigma tolerance, or three by body axis, none below zero"
        cause, remedy = "a fill value, or a sigma and its sign", "give a standard deviation"
        raise refusal(f"instruments/{key}", found, expected, cause, remedy)
    least = TOLERANCE_LEAST * _SIGMAS[key][0]
    x, y, z = np.broadcast_to(np.maximum(array, least), (3,)).tolist()
    return x, y, z
