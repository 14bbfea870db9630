"""A flight as a model reads it: what the model takes out of the record taken out, and reconstructed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from brv_hypo.arrays import BoolArray, FloatArray
from brv_hypo.flight.record import Flight
from brv_hypo.mechanisms.carried import without
from brv_hypo.mechanisms.contract import Mechanism, RecordEffect
from brv_hypo.model.baseline import PitchDamping, StaticMoment
from brv_hypo.model.columns import Column
from brv_hypo.model.reconstruction import reconstruct
from brv_hypo.motion import ReconstructionConfig
from brv_hypo.motion.inertial import InertialRecord
from brv_hypo.motion.reconstruction import Reconstruction
from brv_hypo.regression.build import linearised, on_rows
from brv_hypo.regression.channels import Noise, Part, split, whole
from brv_hypo.regression.frame import RateFrame, build_frame
from brv_hypo.regression.linear import solve_scaled
from brv_hypo.regression.response import linearisation_point
from brv_hypo.regression.whitening import difference
from brv_hypo.residuals.config import Baseline, TraceConfig

# Degree of the scheduled stiffness in Mach number, and the relative span of the quantity that can tell it.
_SLOPE_DEGREE = 2
_SMALLEST_SPAN = 0.01


Taken = Mapping[tuple[str, str], float]
"""Values (SI) of record effects by effect and component."""


@dataclass(frozen=True)
class Applied:
    """A component of a record effect that the model holds, with the value that was taken out of the record."""

    effect: RecordEffect
    component: str
    units: str
    size: float
    value: float

    @property
    def name(self) -> str:
        """The name of its history."""
        return f"{self.effect.name} {self.component}"


@dataclass(frozen=True)
class Model:
    """What explains the flight: moment columns of these mechanisms, and components of record effects."""

    mechanisms: Mapping[str, Mechanism]
    columns: tuple[Column, ...]
    applied: tuple[Applied, ...] = ()
    added: tuple[str, ...] = ()


@dataclass(frozen=True)
class Seen:
    """A flight, with what the model takes out of the record taken out, reconstructed.

    `taken` (SI, by effect and component) is what was found of the errors that the tolerances allow. The regression
    knows them by their priors still, but is linearised where those of the record are taken out and those of the vehicle
    act.
    """

    flight: Flight
    record: InertialRecord
    reconstruction: Reconstruction
    frame: RateFrame
    fitted: Part
    held_out: Part
    whole: Part
    taken: Taken

    def values(self, part: Part, columns: tuple[Column, ...]) -> FloatArray:
        """Coefficients (columns,) of the moments on a part, by plain least squares of the rates' differences."""
        noise = Noise(difference(), difference())
        design = part.white_rates(self.frame.columns(columns)[part.rows], noise)
        constants = part.white_rates(part.constants(), noise)
        response = part.white_rates(self.frame.observed[part.rows], noise)[:, 0]
        return solve_scaled(np.column_stack([design, constants]), response)[: len(columns)]


def see(flight: Flight, model: Model, config: TraceConfig, taken: Taken | None = None) -> Seen:
    """Reconstruct the flight as the model reads its record, `taken` out of it besides.

    What the reconstruction finds of the remaining errors within their tolerances is taken out too.
    """
    taken = taken or {}
    flight = without(flight, taken)
    for applied in model.applied:
        flight = applied.effect.perturb(flight, applied.component, -applied.value)
    settings = ReconstructionConfig(method=config.method)
    record, reconstruction = linearisation_point(reconstruct(flight, settings), settings)
    frame = build_frame([reconstruction], list(model.mechanisms.values()))
    seen = _force_seen(frame, record, reconstruction)
    fitted, held_out = split(frame, seen, config.blocks)
    return Seen(reconstruction.flight, record, reconstruction, frame, fitted, held_out, whole(frame, seen), taken)


def start_model(flight: Flight, mechanisms: Sequence[Mechanism], baseline: Baseline = "constant") -> Model:
    """The baseline alone: with constant coefficients, or with a stiffness that follows Mach and Reynolds number."""
    known = {m.name: m for m in (static_moment(flight, baseline), PitchDamping(), *mechanisms)}
    return Model(known, ())


def static_moment(flight: Flight, baseline: Baseline) -> StaticMoment:
    """The static moment of a baseline; constant where the record's Mach number is missing or stands still."""
    start, stop = float(flight.time[0]), float(flight.time[-1])
    mach = _span(flight.mach) if baseline == "scheduled" else None
    if mach is None:
        return StaticMoment(start=start, stop=stop, offset_degree=0, slope_degree=0)
    decades = None if flight.reynolds is None else _span(np.log10(flight.reynolds))
    return StaticMoment(
        start=mach[0], stop=mach[1], offset_degree=0, slope_degree=_SLOPE_DEGREE, by="mach", reynolds=decades
    )


def _span(values: FloatArray | None) -> tuple[float, float] | None:
    """The ends of what a quantity runs through; None where it is missing or stands still."""
    if values is None or not np.all(np.isfinite(values)):
        return None
    low, high = np.percentile(values, [0.5, 99.5])
    return (float(low), float(high)) if high - low > _SMALLEST_SPAN * abs(high) else None


def with_in_plane_moment(seen: Seen, columns: tuple[Column, ...]) -> Seen:
    """The flight with C_mw of Eq. 5.1 where columns look into its past."""
    if not any(column.theta for column in columns):
        return seen
    for _ in range(2):
        values = seen.values(seen.fitted, columns)
        seen = replace(seen, frame=seen.frame.with_in_plane_moment(columns, values))
    return seen


def _force_seen(frame: RateFrame, record: InertialRecord, reconstruction: Reconstruction) -> BoolArray:
    """Where the transverse force was measured and is no spike against the normal-force model (frame rows,)."""
    flight = linearised(record, reconstruction, frame, (), np.zeros(0))
    return on_rows(frame, [flight])[1]
