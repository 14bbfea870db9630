"""Format 1 as pydantic models: what a flight record must hold, checked once, in SI, whatever it came from.

`Record` is a flight as it was recorded: missing samples are NaN and time need not be uniform.
`brv_hypo.flight.assemble` makes a `Flight` of it.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping
from typing import Annotated, Any, Literal, TypeVar

import numpy as np
from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    SkipValidation,
    ValidationError,
    model_validator,
)

from brv_hypo.arrays import FloatArray
from brv_hypo.errors import FlightRecordError
from brv_hypo.files.printed import one_line
from brv_hypo.flight.instruments import Instruments, of_grade
from brv_hypo.flight.record import CHANNELS, Vehicle
from brv_hypo.flight.refusal import refusal
from brv_hypo.flight.units import Dimension

FORMAT = "brv-flight"
FORMAT_VERSION = 1
MINIMUM_SAMPLES = 16

CHANNEL_DIMENSIONS: dict[str, Dimension] = {
    "time": "time",
    "p": "angular rate",
    "q": "angular rate",
    "r": "angular rate",
    "ax": "acceleration",
    "ay": "acceleration",
    "az": "acceleration",
    "velocity": "speed",
    "dynamic_pressure": "pressure",
    "altitude": "length",
    "density": "density",
    "mach": "dimensionless",
    "reynolds": "dimensionless",
    "roll_rate_mag": "angular rate",
}

VEHICLE_DIMENSIONS: dict[str, Dimension] = {
    "mass": "mass",
    "ixx": "moment of inertia",
    "iyy": "moment of inertia",
    "reference_length": "length",
    "reference_area": "area",
    "accelerometer_position": "length",
}

NEVER_NEGATIVE = ("velocity", "dynamic_pressure", "density", "mach", "reynolds")
# Sizes, SI, that no entry vehicle reaches: beyond them stand fill values, wrong units and damage. Double precision
# does the arithmetic of squares and ratios inside them.
LARGEST: dict[Dimension, float] = {
    "time": 1e12,
    "angular rate": 1e5,
    "acceleration": 1e7,
    "speed": 1e6,
    "pressure": 1e10,
    "density": 1e5,
    "length": 1e9,
    "dimensionless": 1e13,
}
SLOWEST = 0.1  # m/s: coefficients are per speed and dynamic pressure, which a vehicle at rest does not have
SHORTEST_STEP = 1e-7  # s
LARGEST_PROPERTY = 1e9  # of the vehicle, SI

Model = TypeVar("Model", bound=BaseModel)


def _of_a_vehicle(value: float) -> float:
    if value < 1.0 / LARGEST_PROPERTY:
        raise ValueError(f"a value of at least {1.0 / LARGEST_PROPERTY:g}")
    return value


Positive = Annotated[
    float, Field(gt=0.0, le=LARGEST_PROPERTY, allow_inf_nan=False), AfterValidator(_of_a_vehicle)
]
Finite = Annotated[float, Field(ge=-LARGEST_PROPERTY, le=LARGEST_PROPERTY, allow_inf_nan=False)]


class Header(BaseModel):
    """The root attributes."""

    model_config = ConfigDict(frozen=True)

    format: Literal["brv-flight"]
    format_version: Literal[1]
    planet: Annotated[str, Field(min_length=1)] = "earth"
    title: str = ""
    source: str = ""
    history: str = ""


class VehicleRecord(BaseModel):
    """The group `vehicle`, SI; see `Vehicle` for the fields."""

    model_config = ConfigDict(frozen=True, extra="ignore")

    mass: Positive
    ixx: Positive
    iyy: Positive
    reference_length: Positive
    reference_area: Positive
    accelerometer_position: tuple[Finite, Finite, Finite] = (0.0, 0.0, 0.0)

    @model_validator(mode="after")
    def _inertia_of_a_real_body(self) -> VehicleRecord:
        """Ixx <= Iyy + Izz holds for any mass distribution, and Izz = Iyy here."""
        if self.ixx > 2.0 * self.iyy * (1.0 + 1e-9):
            raise refusal(
                "vehicle/ixx",
                f"{self.ixx:g} kg m^2 with iyy = {self.iyy:g} kg m^2",
                "ixx <= 2 iyy, which every rigid body obeys",
                "ixx and iyy in different units, or iyy about another point",
                "give both about the centre of gravity and check their 'units'",
            )
        return self

    def vehicle(self) -> Vehicle:
        """The plain dataclass that the rest of the library uses."""
        return Vehicle(**self.model_dump())


class Record(BaseModel):
    """A flight as recorded, SI: `time` (n,) in s strictly increasing, `channels` (n,), NaN where missing."""

    model_config = ConfigDict(frozen=True, extra="forbid", arbitrary_types_allowed=True)

    time: SkipValidation[FloatArray]
    channels: SkipValidation[Mapping[str, FloatArray]]
    vehicle: VehicleRecord
    instruments: Instruments = Field(default_factory=of_grade)
    planet: str = "earth"
    title: str = ""
    source: str = ""
    path: str = ""
    recorded_units: dict[str, str] = Field(default_factory=dict)
    notes: tuple[str, ...] = ()

    @model_validator(mode="after")
    def _arrays(self) -> Record:
        check_time(self.time)
        check_present(self.channels)
        for name, values in self.channels.items():
            check_channel(name, values, self.time.shape)
        return self


def check_present(names: Iterable[str]) -> None:
    """Raise FlightRecordError for the first dataset that format 1 needs and `names` lack."""
    present = set(names)
    for name in CHANNELS:
        if name not in present and name != "dynamic_pressure":
            raise _absent(name, present)
    if not present & {"dynamic_pressure", "density", "altitude"}:
        raise refusal(
            "dynamic_pressure",
            "nothing, and neither 'density' nor 'altitude'",
            "one of the three",
            "the air data are kept in another file",
            "add the measured or reconstructed dynamic pressure, density or (on Earth) altitude",
        )


def check_time(time: FloatArray) -> None:
    """Raise FlightRecordError unless `time` is (n,), finite, strictly increasing and long enough."""
    if time.ndim != 1 or time.size < MINIMUM_SAMPLES:
        raise refusal(
            "time",
            f"shape {time.shape}",
            f"one axis with at least {MINIMUM_SAMPLES} samples",
            "a scalar, a table, or a record cut too short",
            "give one value per sample and a longer record",
        )
    if not np.all(np.isfinite(time)):
        raise refusal(
            "time",
            f"{_count(~np.isfinite(time))} without a finite value",
            "a finite time for every sample (a missing sample is NaN in its channel, not in time)",
            "rows that the recorder dropped",
            "remove the rows without a time",
        )
    _check_size("time", time)
    backward = np.flatnonzero(np.diff(time) <= 0.0)
    if backward.size:
        i = int(backward[0])
        raise refusal(
            "time",
            f"{time[i]:.9g} s followed by {time[i + 1]:.9g} s at sample {i + 1} ({backward.size} such steps)",
            "strictly increasing times",
            "repeated rows, two records joined, or stamps with too few digits",
            "sort the rows by time and keep one of each",
        )
    step = float(time[-1] - time[0]) / (time.size - 1)
    if step < SHORTEST_STEP:
        raise refusal(
            "time",
            f"samples {step:.3g} s apart",
            f"at least {SHORTEST_STEP:g} s",
            "times in a larger unit than 'units' says",
            "correct the units of 'time'",
        )


def check_channel(name: str, values: FloatArray, shape: tuple[int, ...]) -> None:
    """Raise FlightRecordError unless the channel is known, of `shape`, never infinite, of possible sign."""
    if name not in CHANNEL_DIMENSIONS:
        raise refusal(
            name,
            "an unknown channel",
            f"one of {', '.join(CHANNEL_DIMENSIONS)}",
            _nearest(name),
            "rename or drop it",
        )
    check_shape(name, values, shape)
    if np.any(np.isinf(values)):
        raise refusal(
            name,
            f"{_count(np.isinf(values))} that are infinite",
            "finite numbers, or NaN where a sample is missing",
            "a division by zero or an overflow before the record was written",
            "write NaN for the samples that are missing",
        )
    _check_size(name, values)
    if name in CHANNELS and not np.any(np.isfinite(values)):
        raise refusal(
            name,
            "NaN at every sample",
            "measured values",
            "the channel was not recorded, or its column was not read",
            "check the source of this channel",
        )
    if name in NEVER_NEGATIVE and np.any(values < 0.0):
        raise refusal(
            name,
            f"{_count(values < 0.0)} below zero, down to {np.nanmin(values):g}",
            "values of zero or more",
            "a component along an axis instead of a magnitude, or a fill value such as -999",
            "give the magnitude, and NaN where a sample is missing",
        )
    if name == "velocity" and np.any(values < SLOWEST):
        raise refusal(
            name,
            f"{_count(values < SLOWEST)} below {SLOWEST} m/s",
            "a vehicle that moves through the air",
            "samples from before release or after landing, or a fill value of zero",
            "leave such samples out, or write NaN",
        )


def check_shape(name: str, values: FloatArray, shape: tuple[int, ...]) -> None:
    """Raise FlightRecordError unless the channel is of `shape`."""
    if values.shape != shape:
        raise refusal(
            name,
            f"shape {values.shape}",
            f"shape {shape}, like 'time'",
            "another sample rate, or a table where a column was meant",
            "bring every channel to the samples of 'time', with NaN where it has none",
        )


def _check_size(name: str, values: FloatArray) -> None:
    """Raise FlightRecordError where a value is larger than any that can be measured."""
    largest = LARGEST[CHANNEL_DIMENSIONS[name]]
    beyond = np.abs(values) > largest
    if np.any(beyond):
        raise refusal(
            name,
            f"{_count(beyond)} beyond {largest:g} in SI, up to {np.nanmax(np.abs(values)):.3g}",
            "values that a flight can have",
            "a fill value, wrong units, or damage",
            "write NaN where a sample is missing, and check 'units'",
        )


def validated(model: type[Model], data: Mapping[str, Any], *, group: str = "") -> Model:
    """`model` built from `data`; pydantic's complaints become one FlightRecordError naming each dataset."""
    try:
        return model.model_validate(dict(data))
    except ValidationError as error:
        raise FlightRecordError(complaints(error, group, "the format 1 description")) from error


def complaints(error: ValidationError, group: str, guide: str) -> str:
    """All that pydantic found wrong, each in the wording of `refusal`; `guide` names what to write it by."""
    return " ".join(_complaint(problem, group, guide) for problem in error.errors())


def _complaint(problem: Any, group: str, guide: str) -> str:
    name = "/".join(str(part) for part in (group, *problem["loc"]) if part != "")
    missing = problem["type"] == "missing"
    found = "nothing" if missing else one_line(repr(problem["input"]))
    expected = "a value" if missing else problem["msg"].removeprefix("Input should be ")
    cause = "a misspelt or forgotten name" if missing else "a wrong sign, a fill value, or another format"
    return str(refusal(name, found, expected, cause, f"correct '{name}' by {guide}"))


def _absent(name: str, present: set[str]) -> FlightRecordError:
    others = sorted(present - set(CHANNEL_DIMENSIONS))
    guess = difflib.get_close_matches(name, others, n=1, cutoff=0.5)
    cause = f"it is called '{guess[0]}' here" if guess else "it was not recorded, or has another name"
    return refusal(
        name,
        f"no such dataset (there are: {', '.join(sorted(present)) or 'none'})",
        f"one, as format 1 needs {', '.join(('time', *CHANNELS))}",
        cause,
        "add or rename it; `brv-hypo import` maps foreign names",
    )


def _nearest(name: str) -> str:
    guess = difflib.get_close_matches(name, CHANNEL_DIMENSIONS, n=1, cutoff=0.4)
    return f"'{guess[0]}' is meant" if guess else "a channel that format 1 does not have"


def _count(chosen: Any) -> str:
    """How many samples, and the first: enough to find them."""
    indices = np.flatnonzero(chosen)
    return f"{indices.size} samples (first at index {indices[0]})"
