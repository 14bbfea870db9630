"""One look at a flight: the reconstruction, the model as it stands, and every candidate beside it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.mechanisms.contract import Mechanism, RecordEffect
from brv_hypo.motion.frames import crossflow
from brv_hypo.regression.channels import Noise, Rows
from brv_hypo.regression.fit import HypothesisFit, fit_hypothesis
from brv_hypo.regression.response import ForceModel, Situation, start_of
from brv_hypo.residuals.candidates import (
    Candidate,
    candidate_of,
    explained,
    refine_again,
    refine_mechanism,
    solved,
    try_mechanism,
    try_record_effect,
)
from brv_hypo.residuals.config import TraceConfig
from brv_hypo.residuals.discover import Dictionary, Discovery, dictionary_of, discover
from brv_hypo.residuals.linearisation import Model, Seen, normal_force_slope
from brv_hypo.residuals.problem import (
    TraceTask,
    Unknowns,
    build_task,
    plain_task,
    unknowns,
    with_efficiency,
    with_less_noise,
)

_WORTH_REFINING = 0.4
_REFINED = 3
_TOLD = 8
_CLOSER = 3

Catalogue = Mapping[str, list[tuple[RecordEffect, Mapping[str, str]]]]
"""By effect: its variants, each with the histories of its components and their units."""


@dataclass(frozen=True)
class Look:
    """A fitted model and what every candidate would do beside it, on the fitted part.

    `components` maps the histories of record effects to their components; `dictionary` is None where no description in
    generic terms was asked for.
    """

    seen: Seen
    task: TraceTask
    null: HypothesisFit
    candidates: tuple[Candidate, ...]
    situation: Situation
    components: Mapping[str, str]
    dictionary: Dictionary | None = None
    discovery: Discovery | None = None


def bare_look(seen: Seen, model: Model, values: FloatArray, noise: Noise) -> Look:
    """The regression of a model alone on the fitted part, under a noise that is known."""
    situation = _situation(seen, model, values)
    task = plain_task(situation, seen.frame, seen.fitted, _fixed(situation, model), {}, noise)
    return Look(seen, task, fit_hypothesis(task, "none", ()), (), situation, {})


def _fixed(situation: Situation, model: Model) -> Unknowns:
    """What is fitted along always: unknowns of the motion, and the record effects that the model holds."""
    return unknowns(
        situation, {a.name: situation.effect(a.effect, a.component, a.size) for a in model.applied}
    )


def look(
    seen: Seen,
    model: Model,
    values: FloatArray,
    mechanisms: Sequence[Mechanism],
    effects: Sequence[RecordEffect],
    rich: Sequence[Mechanism],
    config: TraceConfig,
) -> Look:
    """Fit the model and every candidate on the fitted part, under the noise of the leader's residual.

    Where the dictionary is searched too, `discovery` is the one entry of it that describes best what is left.
    """
    situation = _situation(seen, model, values)
    fixed = _fixed(situation, model)
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
    dictionary = dictionary_of(task) if config.discover else None
    discovery = discover(task, null, dictionary, generic_name(model), 1) if dictionary else None
    told = [replace(c, explains=explained(task, null, c.fit)) for c in found[:_TOLD]]
    components = {
        name: component
        for variants in catalogue.values()
        for effect, names in variants
        for name, (component, _, _) in zip(names, effect.components(situation.record.flight), strict=True)
    }
    return Look(seen, task, null, (*told, *found[_TOLD:]), situation, components, dictionary, discovery)


def generic_name(model: Model) -> str:
    """The name of what is described in generic terms beside the model."""
    return f"discovered_{len(model.added) + 1}"


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
        for component, units, size in variant.components(situation.record.flight):
            name = f"{variant.name} {component} {label}{number}"
            histories[name] = situation.effect(variant, component, size)
            names[name] = units
        variants.append((variant, names))
    return variants, histories


def _situation(seen: Seen, model: Model, values: FloatArray) -> Situation:
    motion = seen.reconstruction.motion
    force = ForceModel(normal_force_slope(seen.reconstruction))
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
