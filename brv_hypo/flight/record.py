"""The flight record in memory: SI units, checked, immutable; and format 1, which says what it must hold.

`Flight` is a record ready to be analysed: every channel on one uniform time, without missing samples, with the
tolerances of its instruments, what was changed on reading (`notes`) and what is wrong with it (`faults`).
`Record` is a flight as it was recorded: missing samples are NaN and time need not be uniform. It is a pydantic
model, checked once, in SI, whatever it came from; `brv_hypo.flight.format` makes a `Flight` of it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, TypeVar

import numpy as np
import pydantic
from pydantic import BaseModel, ConfigDict, Field, SkipValidation, ValidationError, model_validator

from brv_hypo.arrays import BoolArray, FloatArray
from brv_hypo.errors import FlightRecordError, UsageError
from brv_hypo.flight.tolerances import Instruments, of_grade
from brv_hypo.flight.units import SI, Dimension
from brv_hypo.io.text import interval, nearest, one_line, refusal
from brv_hypo.results import HasCharts, Histories
from brv_hypo.thresholds import LARGEST_PROPERTY, MINIMUM_SAMPLES, SHORTEST_STEP, SLOWEST

GYROS, ACCELEROMETERS = ("p", "q", "r"), ("ax", "ay", "az")
INERTIAL_CHANNELS = (*GYROS, *ACCELEROMETERS)
CHANNELS = (*INERTIAL_CHANNELS, "velocity", "dynamic_pressure")
OPTIONAL_CHANNELS = ("altitude", "density", "mach", "reynolds", "roll_rate_mag")

Channels = dict[str, FloatArray]

Line = Annotated[str, pydantic.AfterValidator(one_line)]
Positive = Annotated[float, Field(ge=1.0 / LARGEST_PROPERTY, le=LARGEST_PROPERTY, allow_inf_nan=False)]
Finite = Annotated[float, Field(ge=-LARGEST_PROPERTY, le=LARGEST_PROPERTY, allow_inf_nan=False)]
write_with: list[Callable[..., None]] = []
"""What `Flight.save` writes with: the format, which is made of flights, enters itself."""


@dataclass(frozen=True)
class Vehicle:
    """Mass properties and reference quantities, SI."""

    mass: Positive  # kg
    ixx: Positive  # kg m^2, about the spin axis
    iyy: Positive  # kg m^2, about a transverse axis through the centre of gravity
    reference_length: Positive  # m, one for all three moments
    reference_area: Positive  # m^2
    accelerometer_position: tuple[Finite, Finite, Finite] = (0.0, 0.0, 0.0)  # m from the c.g., in body axes

    @property
    def inertia_ratio(self) -> float:
        """Ix / I, of Eq. 2.3."""
        return self.ixx / self.iyy

    @property
    def moment_scale(self) -> float:
        """S d / I in 1/kg: angular acceleration per unit coefficient and dynamic pressure (Eq. 2.3)."""
        return self.reference_area * self.reference_length / self.iyy


@dataclass(frozen=True)
class RecordFault:
    """One fault of a record."""

    channel: Annotated[str, Field(description="or several, joined by commas")]
    fault: Annotated[str, Field(description="its kind")]
    start_s: Annotated[float, Field(description="first sample, s")]
    stop_s: Annotated[float, Field(description="last, s")]
    action: Annotated[str, Field(description="what was done, or what the user should do")]
    decisive: Annotated[bool, Field(description="the record contradicts itself: no fit to it is to be trusted")] = False

    @classmethod
    def over(cls, time: FloatArray, channel: str, fault: str, action: str, *, decisive: bool = False) -> RecordFault:
        """A fault from the first to the last of `time` (n,) s."""
        return cls(channel, fault, float(time[0]), float(time[-1]), action, decisive)

    @property
    def of_single_samples(self) -> bool:
        """Whether it is of samples here and there, each replaced, of which it has the first and the last time."""
        return self.fault == "spikes" and "masked" not in self.action

    @property
    def when(self) -> str:
        """When it was, in words."""
        if self.start_s == self.stop_s:
            return f"at {self.start_s:.2f} s"
        if self.of_single_samples:
            words = "at {:.2f} and {:.2f} s" if self.action.startswith("2 ") else "first at {:.2f} s, last at {:.2f} s"
            return words.format(self.start_s, self.stop_s)
        return f"{interval((self.start_s, self.stop_s))} s"


@dataclass(frozen=True)
class RecordTrial:
    """The verdict on a record: `sound` unless one of its `faults` is decisive."""

    sound: Annotated[bool, Field(description="no fault is decisive")] = True
    faults: Annotated[tuple[RecordFault, ...], Field(description="of all channels")] = ()


@dataclass(frozen=True, eq=False, repr=False)
class Flight(Histories, HasCharts):
    """One flight, format 1, in SI units; every channel is (n,) over a uniform `time` (n,), without NaN.

    Samples that the record lacked are bridged where the gap is short; a longer gap ends a segment. The `truth` of a
    simulated flight is not here: nothing that analyses a flight may see it.
    """

    time: FloatArray  # s
    p: FloatArray  # roll rate, rad/s; `q` and `r` are the rates of pitch and yaw
    q: FloatArray
    r: FloatArray
    ax: FloatArray  # specific force along the body axes at the accelerometer, m/s^2
    ay: FloatArray
    az: FloatArray
    velocity: FloatArray  # speed through the air, m/s
    dynamic_pressure: FloatArray  # Pa
    vehicle: Vehicle
    altitude: FloatArray | None = None  # m
    density: FloatArray | None = None  # kg/m^3
    mach: FloatArray | None = None
    reynolds: FloatArray | None = None
    roll_rate_mag: FloatArray | None = None  # roll rate as a magnetometer has it, rad/s
    wind: FloatArray | None = None  # (n, 3) m/s, what is known of the wind, in body axes of the first sample
    instruments: Instruments = field(default_factory=of_grade)  # to which record, vehicle and air are known
    segments: tuple[tuple[int, int], ...] = ()  # index ranges [start, stop) that are contiguous and usable
    planet: str = "earth"
    title: str = ""
    source: str = ""
    path: str = ""
    notes: tuple[str, ...] = ()  # what was derived, resampled, bridged or cut
    faults: tuple[RecordFault, ...] = ()  # what was masked, or should stop an analysis (`brv_hypo.motion.try_record`)

    def __post_init__(self) -> None:
        """A record without gaps is one segment."""
        if not self.segments:
            object.__setattr__(self, "segments", ((0, self.time.size),))

    def headline(self) -> str:
        """Title or path, length and rate."""
        span = f"{self.time[0]:.2f} to {self.time[-1]:.2f} s, {self.sample_rate:.4g} Hz"
        return f"{self.title or self.path or 'flight'}: {self.samples} samples, {span}"

    def columns(self) -> Mapping[str, Any]:
        """Time (s) and every channel that the record has, SI."""
        return {name: values for name, values in self.arrays().items() if name != "wind"}

    def arrays(self) -> dict[str, Any]:
        """The columns, and what is known of the wind: all that is over the samples."""
        known = {name: getattr(self, name) for name in ("time", *CHANNELS, *OPTIONAL_CHANNELS, "wind")}
        return {name: values for name, values in known.items() if values is not None}

    def units(self) -> Mapping[str, str]:
        """SI units of the columns."""
        return {name: SI[CHANNEL_DIMENSIONS[name]] for name in self.columns()}

    def save(self, path: str | Path, *, overwrite: bool = False) -> None:
        """Write the flight as a record of format 1; samples outside its segments become NaN.

        Parameters
        ----------
        path : str or Path
            Ends with .h5 or .hdf5.
        overwrite : bool
            Whether a file that exists is replaced.

        Raises
        ------
        UsageError
            The file exists (ExistingOutputError, a FileExistsError), has another ending, or cannot be written.

        Examples
        --------
        >>> import brv_hypo
        >>> brv_hypo.simulate("research_cone", seed=1, duration=1.0).flight.save("flight.h5", overwrite=True)
        """
        write_with[0](self, path, overwrite=overwrite)

    @property
    def samples(self) -> int:
        """Number of samples."""
        return int(self.time.size)

    @property
    def step(self) -> float:
        """Sample interval in s."""
        return float((self.time[-1] - self.time[0]) / (self.time.size - 1))

    @property
    def sample_rate(self) -> float:
        """Samples per second, Hz."""
        return 1.0 / self.step

    @property
    def gaps(self) -> list[slice]:
        """The samples of each gap between segments."""
        return [slice(b, a) for (_, b), (a, _) in pairwise(self.segments) if a > b]

    @property
    def gaps_s(self) -> tuple[tuple[float, float], ...]:
        """Begin and end of each, s."""
        return tuple((float(self.time[gap.start]), float(self.time[gap.stop])) for gap in self.gaps)

    def within(self, at: float) -> float:
        """s within which a change at that time was: a sample, or to the far end of a gap that it is in, or near."""
        return max([self.step, *(max(at - a, b - at) for a, b in self.gaps_s if a - (b - a) < at < b + (b - a))])

    def measured(self, ends: int = 0) -> BoolArray:
        """Where the instruments were read (n,), not bridged, less so many samples at the ends of each segment."""
        inside = np.zeros(self.time.size, dtype=np.bool_)
        for start, stop in self.segments:
            inside[start + ends : stop - ends] = True
        return inside

    def window(self, start: float | None, stop: float | None) -> Flight:
        """The part of the flight with start <= time <= stop (s); None leaves that end open."""
        lower = -np.inf if start is None else start
        upper = np.inf if stop is None else stop
        a, b = int(np.searchsorted(self.time, lower)), int(np.searchsorted(self.time, upper, side="right"))
        segments = tuple((max(s, a) - a, min(e, b) - a) for s, e in self.segments if max(s, a) < min(e, b))
        if not segments:
            usable = ", ".join(f"{self.time[s]:.3f} to {self.time[e - 1]:.3f} s" for s, e in self.segments)
            raise UsageError(
                f"the window from {'the start' if start is None else f'{start:g} s'} to "
                f"{'the end' if stop is None else f'{stop:g} s'} lies in a gap of the record, or outside: it is usable "
                f"over {usable}. "
                "Give --start and --stop inside it."
            )
        arrays = {name: values[a:b] for name, values in self.arrays().items()}
        faults = tuple(fault for fault in self.faults if fault.start_s <= upper and fault.stop_s >= lower)
        return replace(self, segments=segments, faults=faults, **arrays)


FORMAT = "brv-flight"
FORMAT_VERSION = 1

CHANNEL_DIMENSIONS: dict[str, Dimension] = {
    "time": "time",
    **dict.fromkeys(GYROS, "angular rate"),
    **dict.fromkeys(ACCELEROMETERS, "acceleration"),
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

LEAST = {"velocity": SLOWEST, **dict.fromkeys(("dynamic_pressure", "density", "mach", "reynolds"), 0.0)}  # SI
# Sizes, SI, that no entry vehicle reaches: beyond them are fill values, wrong units and damage. Double precision
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

Model = TypeVar("Model")


def checked_vehicle(values: Mapping[str, Any]) -> Vehicle:
    """The vehicle of the group `vehicle`, SI. Raises FlightRecordError for what no vehicle has."""
    vehicle = validated(Vehicle, values, group="vehicle")
    # Ixx <= Iyy + Izz holds for any mass distribution, and Izz = Iyy here.
    if vehicle.ixx > 2.0 * vehicle.iyy * (1.0 + 1e-9):
        found = f"{vehicle.ixx:g} kg m^2 with iyy = {vehicle.iyy:g} kg m^2"
        expected = "ixx <= 2 iyy, which every rigid body obeys"
        cause = "ixx and iyy exchanged or in different units, or iyy about another point"
        remedy = "give both about the centre of gravity and check their 'units'"
        raise refusal("vehicle/ixx", found, expected, cause, remedy)
    return vehicle


class Record(BaseModel):
    """A flight as recorded, SI."""

    model_config = ConfigDict(frozen=True, extra="forbid", arbitrary_types_allowed=True)

    time: SkipValidation[FloatArray]  # (n,) s, strictly increasing
    channels: SkipValidation[Mapping[str, FloatArray]]  # (n,) each, NaN where a sample is missing
    vehicle: SkipValidation[Vehicle]
    instruments: Instruments = Field(default_factory=of_grade)
    planet: Annotated[str, pydantic.StringConstraints(strip_whitespace=True, to_lower=True, min_length=1)] = "earth"
    title: Line = ""
    source: Line = ""
    path: str = ""
    recorded_units: dict[str, str] = Field(default_factory=dict)  # of the channels in the file
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
        if name in present or name == "dynamic_pressure":
            continue
        guess = nearest(name, sorted(present - set(CHANNEL_DIMENSIONS)), 0.5)
        found = f"no such dataset (there are: {', '.join(sorted(present)) or 'none'})"
        expected = f"one, as format 1 needs {', '.join(('time', *CHANNELS))}"
        cause = f"it is called '{guess[0]}' here" if guess else "it was not recorded, or has another name"
        remedy = "add or rename it; `brv-hypo import` maps foreign names"
        raise refusal(name, found, expected, cause, remedy)
    if not present & {"dynamic_pressure", "density", "altitude"}:
        found, expected = "nothing, and neither 'density' nor 'altitude'", "one of the three"
        cause = "the air data are kept in another file"
        remedy = "add the measured or reconstructed dynamic pressure, density or (on Earth) altitude"
        raise refusal("dynamic_pressure", found, expected, cause, remedy)


def check_time(time: FloatArray) -> None:
    """Raise FlightRecordError unless `time` is (n,), finite, strictly increasing and long enough."""
    if time.ndim != 1 or time.size < MINIMUM_SAMPLES:
        found, expected = f"shape {time.shape}", f"one axis with at least {MINIMUM_SAMPLES} samples"
        cause, remedy = "a scalar, a table, or a record cut too short", "give one value per sample and a longer record"
        raise refusal("time", found, expected, cause, remedy)
    if not np.all(np.isfinite(time)):
        found = f"{_count(~np.isfinite(time))} without a finite value"
        expected = "a finite time for every sample (a missing sample is NaN in its channel, not in time)"
        cause, remedy = "rows that the recorder dropped", "remove the rows without a time"
        raise refusal("time", found, expected, cause, remedy)
    _check_size("time", time)
    backward = np.flatnonzero(np.diff(time) <= 0.0)
    if backward.size:
        i = int(backward[0])
        found = f"{time[i]:.9g} s followed by {time[i + 1]:.9g} s at sample {i + 1} ({backward.size} such steps)"
        expected = "strictly increasing times"
        cause = "repeated rows, two records joined, or stamps with too few digits"
        remedy = "sort the rows by time and keep one of each"
        raise refusal("time", found, expected, cause, remedy)
    step = float(time[-1] - time[0]) / (time.size - 1)
    if step < SHORTEST_STEP:
        found, expected = f"samples {step:.3g} s apart", f"at least {SHORTEST_STEP:g} s"
        cause, remedy = "times in a larger unit than 'units' says", "correct the units of 'time'"
        raise refusal("time", found, expected, cause, remedy)


def check_channel(name: str, values: FloatArray, shape: tuple[int, ...]) -> None:
    """Raise FlightRecordError unless the channel is known, of `shape`, never infinite, of possible sign."""
    if name not in CHANNEL_DIMENSIONS:
        guess = nearest(name, CHANNEL_DIMENSIONS, 0.4)
        cause = f"'{guess[0]}' is meant" if guess else "a channel that format 1 does not have"
        raise refusal(name, "an unknown channel", f"one of {', '.join(CHANNEL_DIMENSIONS)}", cause, "rename or drop it")
    check_shape(name, values, shape)
    _check_size(name, values)
    if name in CHANNELS and not np.any(np.isfinite(values)):
        cause, remedy = "the channel was not recorded, or its column was not read", "check the source of this channel"
        raise refusal(name, "NaN at every sample", "measured values", cause, remedy)
    least = LEAST.get(name, -np.inf)
    if np.any(values < least):
        found = f"{_count(values < least)} below {least:g}, down to {np.nanmin(values):.6g}"
        expected = f"values of {least:g} or more, of a vehicle in flight"
        cause = "a component along an axis instead of a magnitude, a fill value, or samples before or after the flight"
        raise refusal(name, found, expected, cause, "give the magnitude, and NaN where a sample is missing")


def check_shape(name: str, values: FloatArray, shape: tuple[int, ...]) -> None:
    """Raise FlightRecordError unless the channel is of `shape`."""
    if values.shape != shape:
        found, expected = f"shape {values.shape}", f"shape {shape}, like 'time'"
        cause = "another sample rate, or a table where a column was meant"
        remedy = "bring every channel to the samples of 'time', with NaN where it has none"
        raise refusal(name, found, expected, cause, remedy)


def _check_size(name: str, values: FloatArray) -> None:
    """Raise FlightRecordError where a value is larger than any that can be measured."""
    largest = LARGEST[CHANNEL_DIMENSIONS[name]]
    beyond = np.abs(values) > largest
    if np.any(beyond):
        found = f"{_count(beyond)} beyond {largest:g} in SI, up to {np.nanmax(np.abs(values)):.3g}"
        expected = "values that a flight can have"
        cause = "a fill value, wrong units, an overflow, or damage"
        remedy = "write NaN where a sample is missing, and check 'units'"
        raise refusal(name, found, expected, cause, remedy)


def validated(model: type[Model], data: Mapping[str, Any], *, group: str = "") -> Model:
    """`model` built from `data`; pydantic's complaints become one FlightRecordError naming each dataset."""
    try:
        return pydantic.TypeAdapter(model).validate_python(dict(data))
    except ValidationError as error:
        for own in (problem.get("ctx", {}).get("error") for problem in error.errors()):
            if isinstance(own, FlightRecordError):
                raise own from None
        raise FlightRecordError(complaints(error, group, "the format 1 description")) from error


def complaints(error: ValidationError, group: str, guide: str) -> str:
    """All that pydantic found wrong, each in the wording of `refusal`; `guide` names what to write it by."""
    found = []
    for problem in error.errors():
        name = "/".join(str(part) for part in (group, *problem["loc"]) if part != "")
        missing = problem["type"] == "missing"
        value = "nothing" if missing else one_line(repr(problem["input"]))
        expected = "a value" if missing else problem["msg"].removeprefix("Input should be ")
        cause = "a misspelt or forgotten name" if missing else "a wrong sign, a fill value, or another format"
        found.append(str(refusal(name, value, expected, cause, f"correct '{name}' by {guide}")))
    return " ".join(found)


def _count(chosen: Any) -> str:
    """How many samples, and the first: enough to find them."""
    indices = np.flatnonzero(chosen)
    return f"{indices.size} samples (first at index {indices[0]})"
