"""One look at a flight: the reconstruction, the model as it stands, and every candidate beside it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from brv_hypo.arrays import BoolArray, FloatArray
from brv_hypo.design.baseline import PitchDamping, StaticMoment
from brv_hypo.design.columns import Column, default_knots
from brv_hypo.design.frame import RateFrame, build_frame, remove_levels
from brv_hypo.design.whitening import NoiseModel, difference, fit_noise
from brv_hypo.flight.record import Flight
from brv_hypo.mechanisms.contract import Mechanism, RecordEffect
from brv_hypo.motion import ReconstructionConfig, reconstruct
from brv_hypo.motion.frames import crossflow
from brv_hypo.motion.inertial import InertialRecord, inertial_record
from brv_hypo.motion.reconstruction import Reconstruction
from brv_hypo.ranking.fit import HypothesisFit, fit_hypothesis
from brv_hypo.ranking.linear import solve_scaled
from brv_hypo.ranking.task import Task
from brv_hypo.trace.candidates import (
    Candidate,
    candidate_of,
    explained,
    refine_again,
    refine_mechanism,
    solved,
    try_mechanism,
    try_record_effect,
)
from brv_hypo.trace.channels import Noise, Part, Rows, part, split
from brv_hypo.trace.config import TraceConfig
from brv_hypo.trace.discover import Discovery, discover
from brv_hypo.trace.response import ForceModel, Situation, start_of, without_wander
from brv_hypo.trace.task import (
    TraceTask,
    build_task,
    plain_task,
    unknowns,
    with_efficiency,
    with_less_noise,
)

_OUTLIER = 6.0
_WORTH_REFINING = 0.4
_REFINED = 3
_TOLD = 8
_CLOSER = 3

Catalogue = Mapping[str, list[tuple[RecordEffect, Mapping[str, str]]]]
"""By effect: its variants, each with the histories of its components and their units."""


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


@dataclass(frozen=True)
class Look:
    """A fitted model and what every candidate would do beside it, on the fitted part.

    `components` maps the histories of record effects to their components.
    """

    seen: Seen
    task: TraceTask
    null: HypothesisFit
    candidates: tuple[Candidate, ...]
    situation: Situation
    components: Mapping[str, str]
    discovery: Discovery | None = None


def see(flight: Flight, model: Model, config: TraceConfig) -> Seen:
    """Reconstruct the flight as the model reads its record.

    The instruments are taken as the record has them: their errors are hypotheses here, not something to be
    averaged over.
    """
    for applied in model.applied:
        flight = applied.effect.perturb(flight, applied.component, -applied.value)
    settings = ReconstructionConfig(method=config.method, gyro_bias_sigma=0.0, accel_bias_sigma=0.0)
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


def bare_task(seen: Seen, model: Model, values: FloatArray, noise: Noise) -> TraceTask:
    """The regression of a model alone, under a noise that is known."""
    situation = _situation(seen, model, values)
    fixed = unknowns(
        situation, {a.name: situation.effect(a.effect, a.component, a.size) for a in model.applied}
    )
    return plain_task(situation, seen.frame, seen.fitted, fixed, {}, noise)


def look(
    seen: Seen,
    model: Model,
    values: FloatArray,
    mechanisms: Sequence[Mechanism],
    effects: Sequence[RecordEffect],
    rich: Sequence[Mechanism],
    config: TraceConfig,
    most_generic: int,
) -> Look:
    """Fit the model and every candidate on the fitted part, under the noise of the leader's residual.

    `most_generic` entries of the dictionary may describe what is left; 0 leaves the dictionary out.
    """
    situation = _situation(seen, model, values)
    fixed = unknowns(
        situation, {a.name: situation.effect(a.effect, a.component, a.size) for a in model.applied}
    )
    catalogue, histories = _histories(situation, effects)
    task = build_task(
        situation, seen.frame, seen.fitted, fixed, histories, rich, config.knot_count, config.max_terms
    )
    null = fit_hypothesis(task, "none", ())
    by_name = {mechanism.name: mechanism for mechanism in mechanisms}
    found = _try_all(task, null, mechanisms, catalogue)
    if found:
        task = _settled(task, _leader(found).fit)
        null = fit_hypothesis(task, "none", ())
        found = _refined(task, null, [_again(task, null, candidate) for candidate in found], by_name)
        task, found, catalogue = _closer(task, null, found, situation, catalogue)
        task = _settled(task, _leader(found).fit)
        null = fit_hypothesis(task, "none", ())
        found = [_again(task, null, candidate) for candidate in found]
        leader = _leader(found)
        if _has_nonlinear(leader):
            closer = refine_again(task, null, leader)
            task = _settled(task, closer.fit)
            null = fit_hypothesis(task, "none", ())
            found = [_again(task, null, closer if c is leader else c) for c in found]
    found = sorted(found, key=lambda candidate: candidate.fit.information)
    discovery = (
        discover(task, null, f"discovered_{len(model.added) + 1}", most_generic) if most_generic else None
    )
    told = [replace(c, explains=explained(task, null, c.fit)) for c in found[:_TOLD]]
    components = {
        name: component
        for variants in catalogue.values()
        for effect, names in variants
        for name, (component, _, _) in zip(names, effect.components(), strict=True)
    }
    return Look(seen, task, null, (*told, *found[_TOLD:]), situation, components, discovery)


def _leader(found: Sequence[Candidate]) -> Candidate:
    return min(found, key=lambda candidate: candidate.fit.information)


def _settled(task: TraceTask, fit: HypothesisFit) -> TraceTask:
    """The task with the effective share of samples that a fit leaves, and its noise where that is less."""
    task = with_less_noise(task, fit.frame, fit.columns)
    again = solved(task, fit.name, fit.mechanisms, fit.frame, fit.selected, fit.searched)
    return with_efficiency(replace(task, efficiency=1.0), again)


def _again(task: TraceTask, null: HypothesisFit, candidate: Candidate) -> Candidate:
    """A candidate with its columns as they are, under the task's noise."""
    fit = candidate.fit
    renewed = replace(
        solved(task, fit.name, fit.mechanisms, fit.frame, fit.selected, fit.searched), nonlinear=fit.nonlinear
    )
    return replace(candidate_of(task, null, renewed, candidate.name, candidate.kind), effect=candidate.effect)


def _refined(
    task: TraceTask, null: HypothesisFit, found: Sequence[Candidate], mechanisms: Mapping[str, Mechanism]
) -> list[Candidate]:
    """The candidates, the best few with their knots and delays refined."""
    ranked = sorted(found, key=lambda candidate: -candidate.gain)
    most = max(ranked[0].gain, 0.0) if ranked else 0.0
    worth = [c.name for c in ranked if c.name in mechanisms and c.gain > _WORTH_REFINING * most]
    worth = [c.name for c in ranked if c.name in worth and _has_nonlinear(c)][:_REFINED]
    return [refine_mechanism(task, null, mechanisms[c.name]) if c.name in worth else c for c in found]


def _closer(
    task: TraceTask,
    null: HypothesisFit,
    found: Sequence[Candidate],
    situation: Situation,
    catalogue: Catalogue,
) -> tuple[TraceTask, list[Candidate], Catalogue]:
    """The candidates, record effects that come in variants brought closer to their best one."""
    most = max(candidate.gain for candidate in found)
    closer = []
    for candidate in found:
        effect = candidate.effect
        if (
            effect is not None
            and len(catalogue[candidate.name]) > 1
            and candidate.gain > _WORTH_REFINING * most
        ):
            for turn in range(_CLOSER):
                variants, histories = _variants_of(situation, effect, f"{turn}.")
                task = replace(task, given={**task.given, **histories})
                catalogue = {**catalogue, effect.name: [*catalogue[effect.name], *variants]}
                nearer = try_record_effect(task, null, variants)
                if nearer is not None and nearer.effect is not None and nearer.gain > candidate.gain:
                    candidate = replace(nearer, fit=replace(nearer.fit, searched=candidate.fit.searched))
                    effect = nearer.effect
        closer.append(candidate)
    return task, closer, catalogue


def _has_nonlinear(candidate: Candidate) -> bool:
    return any(column.theta or column.course.kind != "constant" for column in candidate.fit.selected)


def _try_all(
    task: TraceTask,
    null: HypothesisFit,
    mechanisms: Sequence[Mechanism],
    catalogue: Catalogue,
) -> list[Candidate]:
    tried = [try_mechanism(task, null, mechanism) for mechanism in mechanisms]
    tried += [try_record_effect(task, null, variants) for variants in catalogue.values()]
    return [candidate for candidate in tried if candidate is not None]


def _histories(situation: Situation, effects: Sequence[RecordEffect]) -> tuple[Catalogue, dict[str, Rows]]:
    """Every variant of every record effect with the histories of its components, by name."""
    catalogue: Catalogue = {}
    histories: dict[str, Rows] = {}
    for effect in effects:
        variants, own = _variants_of(situation, effect, "")
        catalogue = {**catalogue, effect.name: variants}
        histories.update(own)
    return catalogue, histories


def _variants_of(
    situation: Situation, effect: RecordEffect, label: str
) -> tuple[list[tuple[RecordEffect, Mapping[str, str]]], dict[str, Rows]]:
    variants: list[tuple[RecordEffect, Mapping[str, str]]] = []
    histories: dict[str, Rows] = {}
    for number, variant in enumerate(effect.variants(situation.record.flight)):
        names = {}
        for component, units, size in variant.components():
            name = f"{variant.name} {component} {label}{number}"
            histories[name] = situation.effect(variant, component, size)
            names[name] = units
        variants.append((variant, names))
    return variants, histories


def _situation(seen: Seen, model: Model, values: FloatArray) -> Situation:
    motion = seen.reconstruction.motion
    force = ForceModel(_slope(seen.reconstruction))
    found = force.columns(seen.record, crossflow(motion.alpha, motion.windward_meridian))
    keep = seen.force_seen
    stacked = np.concatenate([found[keep].real, found[keep].imag])
    observed = seen.record.transverse_force[keep]
    force_values = np.linalg.lstsq(stacked, np.concatenate([observed.real, observed.imag]), rcond=None)[0]
    return Situation(
        seen.record,
        seen.reconstruction,
        start_of(seen.reconstruction),
        seen.frame.mechanisms,
        model.columns,
        values,
        force,
        np.asarray(force_values, dtype=float),
    )


def _slope(reconstruction: Reconstruction) -> FloatArray:
    slope = reconstruction.normal_force_slope
    return np.where(np.isfinite(slope), slope, 1.0)


def _force_seen(record: InertialRecord, reconstruction: Reconstruction) -> BoolArray:
    """Where the transverse force was measured and is no spike against the normal-force model."""
    motion = reconstruction.motion
    columns = ForceModel(_slope(reconstruction)).columns(
        record, crossflow(motion.alpha, motion.windward_meridian)
    )
    force = record.transverse_force
    stacked = np.concatenate([columns.real, columns.imag])
    left = force - columns @ np.linalg.lstsq(stacked, np.concatenate([force.real, force.imag]), rcond=None)[0]
    size = np.abs(left)
    return np.asarray(
        record.measured & (size < _OUTLIER * 1.2 * np.median(size[record.measured]) + 1e-12), dtype=bool
    )
