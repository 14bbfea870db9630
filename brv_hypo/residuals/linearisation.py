"""A flight as a model reads it: what the model takes out of the record taken out, and reconstructed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from brv_hypo.arrays import BoolArray, FloatArray
from brv_hypo.flight.record import Flight
from brv_hypo.mechanisms.contract import Mechanism, RecordEffect
from brv_hypo.model.baseline import PitchDamping, StaticMoment
from brv_hypo.model.columns import Column, default_knots
from brv_hypo.motion import ReconstructionConfig, reconstruct
from brv_hypo.motion.frames import crossflow
from brv_hypo.motion.inertial import InertialRecord, inertial_record
from brv_hypo.motion.reconstruction import Reconstruction
from brv_hypo.regression.channels import Noise, Part, part, split
from brv_hypo.regression.fit import fit_hypothesis
from brv_hypo.regression.frame import RateFrame, build_frame, remove_levels
from brv_hypo.regression.linear import solve_scaled
from brv_hypo.regression.problem import Task
from brv_hypo.regression.response import ForceModel, without_wander
from brv_hypo.regression.whitening import NoiseModel, difference, fit_noise
from brv_hypo.residuals.config import TraceConfig

_OUTLIER = 6.0


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
    """A flight, with what the model takes out of the record taken out, reconstructed."""

    flight: Flight
    record: InertialRecord
    reconstruction: Reconstruction
    frame: RateFrame
    fitted: Part
    held_out: Part
    whole: Part
    force_seen: BoolArray

    def values(self, part: Part, columns: tuple[Column, ...], noise: NoiseModel) -> FloatArray:
        """Coefficients (columns,) of the moments on a part."""
        design, response = self.rows(part, columns, noise)
        return solve_scaled(design, response)

    def rows(
        self, part: Part, columns: tuple[Column, ...], noise: NoiseModel
    ) -> tuple[FloatArray, FloatArray]:
        """Whitened columns (rows, columns) and rates (rows,) of a part."""
        both = Noise(noise, noise, (0.0, 0.0))
        design = part.white_rates(self.frame.columns(columns)[part.rows], both)
        return design, part.white_rates(self.frame.observed[part.rows], both)[:, 0]

    def first_noise(self, columns: tuple[Column, ...]) -> NoiseModel:
        """A noise model to begin with: of what the columns leave of the rates."""
        left = self.frame.observed - self.frame.columns(columns) @ self.values(
            self.fitted, columns, difference()
        )
        return fit_noise(remove_levels(left[self.fitted.rows], self.fitted.pieces, difference()))


def see(flight: Flight, model: Model, config: TraceConfig) -> Seen:
    """Reconstruct the flight as the model reads its record.

    The instruments are taken as the record has them: their errors are hypotheses here, none is carried.
    """
    for applied in model.applied:
        flight = applied.effect.perturb(flight, applied.component, -applied.value)
    settings = ReconstructionConfig(method=config.method)
    record = inertial_record(flight, settings)
    reconstruction = without_wander(record, reconstruct(flight, settings))
    frame = build_frame([reconstruction], list(model.mechanisms.values()))
    seen = _force_seen(record, reconstruction)
    fitted, held_out = split(frame, seen, config.blocks)
    whole = part(frame, seen, np.ones(flight.samples, dtype=bool), shared=True)
    return Seen(flight, record, reconstruction, frame, fitted, held_out, whole, seen)


def start_model(flight: Flight, mechanisms: Sequence[Mechanism]) -> Model:
    """The baseline with constant coefficients: what changes along the flight is for the loop to find."""
    static = StaticMoment(
        start=float(flight.time[0]), stop=float(flight.time[-1]), offset_degree=0, slope_degree=0
    )
    known = {mechanism.name: mechanism for mechanism in (static, PitchDamping(), *mechanisms)}
    return Model(known, ())


def start_columns(
    seen: Seen,
    baseline: tuple[Column, ...],
    noise: NoiseModel,
    mechanisms: tuple[Mechanism, ...],
    config: TraceConfig,
) -> tuple[Column, ...]:
    """The baseline's columns and the best of the mechanisms that the model holds from the start."""
    frame = seen.frame
    knots = default_knots(float(frame.time.min()), float(frame.time.max()), config.knot_count)
    task = Task(frame, baseline, knots, noise, 1.0, config.max_terms, config.max_terms, True)
    return fit_hypothesis(task, "start", mechanisms).columns


def with_in_plane_moment(seen: Seen, columns: tuple[Column, ...]) -> Seen:
    """The flight with C_mw of Eq. 5.1 where columns look into its past."""
    if not any(column.theta for column in columns):
        return seen
    for _ in range(2):
        values = seen.values(seen.fitted, columns, difference())
        seen = replace(seen, frame=seen.frame.with_in_plane_moment(columns, values))
    return seen


def normal_force_slope(reconstruction: Reconstruction) -> FloatArray:
    """The reconstruction's normal-force slope (n,), 1/rad; 1 where it has none."""
    slope = reconstruction.normal_force_slope
    return np.where(np.isfinite(slope), slope, 1.0)


def _force_seen(record: InertialRecord, reconstruction: Reconstruction) -> BoolArray:
    """Where the transverse force was measured and is no spike against the normal-force model."""
    motion = reconstruction.motion
    columns = ForceModel(normal_force_slope(reconstruction)).columns(
        record, crossflow(motion.alpha, motion.windward_meridian)
    )
    force = record.transverse_force
    stacked = np.concatenate([columns.real, columns.imag])
    left = force - columns @ np.linalg.lstsq(stacked, np.concatenate([force.real, force.imag]), rcond=None)[0]
    size = np.abs(left)
    return np.asarray(
        record.measured & (size < _OUTLIER * 1.2 * np.median(size[record.measured]) + 1e-12), dtype=bool
    )
