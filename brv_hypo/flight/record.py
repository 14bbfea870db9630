"""The flight record in memory: SI units, checked, immutable."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.errors import UsageError
from brv_hypo.flight.instruments import Instruments, of_grade
from brv_hypo.tabular import Histories

if TYPE_CHECKING:  # faults are found by what reads records
    from brv_hypo.flight.faults import RecordFault

GYROS, ACCELEROMETERS = ("p", "q", "r"), ("ax", "ay", "az")
INERTIAL_CHANNELS = (*GYROS, *ACCELEROMETERS)
CHANNELS = (*INERTIAL_CHANNELS, "velocity", "dynamic_pressure")
OPTIONAL_CHANNELS = ("altitude", "density", "mach", "reynolds", "roll_rate_mag")


@dataclass(frozen=True)
class Vehicle:
    """Mass properties and reference quantities, SI.

    `mass` kg; `ixx`, `iyy` kg m^2 (spin axis; transverse, about the c.g.); `reference_length` m, one for all
    three moments; `reference_area` m^2; `accelerometer_position` (3,) m from the c.g. in body axes.
    """

    mass: float
    ixx: float
    iyy: float
    reference_length: float
    reference_area: float
    accelerometer_position: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @property
    def inertia_ratio(self) -> float:
        """Ix / I, of Eq. 2.3."""
        return self.ixx / self.iyy

    @property
    def moment_scale(self) -> float:
        """S d / I in 1/kg: angular acceleration per unit coefficient and dynamic pressure (Eq. 2.3)."""
        return self.reference_area * self.reference_length / self.iyy


@dataclass(frozen=True)
class Flight(Histories):
    """One flight, format 1, in SI units; every channel is (n,) over a uniform `time` (n,), without NaN.

    Samples that the record lacked are bridged where the gap is short; a longer gap ends a segment.
    `segments` are the index ranges [start, stop) that are contiguous and usable.
    `wind` (n, 3) m/s is what is known of the wind, in body axes of the first sample; None where nothing is.
    `instruments` are the tolerances to which record, vehicle and air are known.
    `notes` say what was derived, resampled, bridged or cut; `faults` what was masked, or should stop an analysis
    (`brv_hypo.motion.try_record`). The `truth` of a simulated flight is not here:
    nothing that analyses a flight may see it.
    """

    time: FloatArray
    p: FloatArray
    q: FloatArray
    r: FloatArray
    ax: FloatArray
    ay: FloatArray
    az: FloatArray
    velocity: FloatArray
    dynamic_pressure: FloatArray
    vehicle: Vehicle
    altitude: FloatArray | None = None
    density: FloatArray | None = None
    mach: FloatArray | None = None
    reynolds: FloatArray | None = None
    roll_rate_mag: FloatArray | None = None
    wind: FloatArray | None = None
    instruments: Instruments = field(default_factory=of_grade)
    segments: tuple[tuple[int, int], ...] = ()
    planet: str = "earth"
    title: str = ""
    source: str = ""
    path: str = ""
    notes: tuple[str, ...] = field(default=())
    faults: tuple[RecordFault, ...] = ()

    def __post_init__(self) -> None:
        """A record without gaps is one segment."""
        if not self.segments:
            object.__setattr__(self, "segments", ((0, self.time.size),))

    __repr__ = Histories.__repr__
    __eq__ = Histories.__eq__

    def headline(self) -> str:
        """Title or path, length and rate."""
        name = self.title or self.path or "flight"
        return (
            f"{name}: {self.samples} samples, {self.time[0]:.2f} to {self.time[-1]:.2f} s, {self.sample_rate:.4g} Hz"
        )

    def columns(self) -> Mapping[str, Any]:
        """Time (s) and every channel that the record has, SI."""
        known = {name: getattr(self, name) for name in ("time", *CHANNELS, *OPTIONAL_CHANNELS)}
        return {name: values for name, values in known.items() if values is not None}

    def units(self) -> Mapping[str, str]:
        """SI units of the columns."""
        from brv_hypo.flight.schema import CHANNEL_DIMENSIONS
        from brv_hypo.flight.units import SI

        return {name: SI[CHANNEL_DIMENSIONS[name]] for name in self.columns()}

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

    def window(self, start: float | None, stop: float | None) -> Flight:
        """The part of the flight with start <= time <= stop (s); None leaves that end open."""
        lower = -np.inf if start is None else start
        upper = np.inf if stop is None else stop
        chosen = np.flatnonzero((self.time >= lower) & (self.time <= upper))
        if chosen.size == 0:
            first, last = self.time[0], self.time[-1]
            raise UsageError(
                f"the window [{start}, {stop}] s holds no sample: the record runs from {first:.3f} to "
                f"{last:.3f} s. Give --start and --stop inside it."
            )
        a, b = int(chosen[0]), int(chosen[-1]) + 1
        arrays: dict[str, Any] = {
            name: None if (value := getattr(self, name)) is None else value[a:b]
            for name in ("time", *CHANNELS, *OPTIONAL_CHANNELS, "wind")
        }
        segments = tuple((max(s, a) - a, min(e, b) - a) for s, e in self.segments if s < b and e > a)
        if not segments:
            raise UsageError(
                f"the window [{start}, {stop}] s lies in a gap of the record; it is usable over "
                f"{', '.join(f'{self.time[s]:.3f} to {self.time[e - 1]:.3f} s' for s, e in self.segments)}."
            )
        faults = tuple(fault for fault in self.faults if fault.start_s <= upper and fault.stop_s >= lower)
        return replace(self, segments=segments, faults=faults, **arrays)
