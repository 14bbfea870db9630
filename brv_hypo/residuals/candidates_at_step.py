"""One look at a flight: the reconstruction, the model as it stands, and every candidate beside it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from brv_hypo.arrays import FloatArray
from brv_hypo.mechanisms.contract import Mechanism, RecordEffect
from brv_hypo.regression.channels import Noise, Rows
from brv_hypo.regression.fit import HypothesisFit, fit_hypothesis
from brv_hypo.regression.frame import RateFrame
from brv_hypo.regression.nuisance import on_frame
from brv_hypo.regression.problem import Problem
from brv_hypo.regression.response import LinearisedFlight
from brv_hypo.residuals.candidates import (
    Candidate,
    fitted_again,
    refine_again,
    refine_mechanism,
    try_mechanism,
    try_record_effect,
)
from brv_hypo.residuals.config import TraceConfig
from brv_hypo.residuals.discover import Dictionary, Discovery, dictionary_of, discover
from brv_hypo.residuals.left_out import LeftOut
from brv_hypo.residuals.linearisation import Model, Seen
from brv_hypo.residuals.problem import linearised_at, problem_of, with_efficiency

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
    problem: Problem
    null: HypothesisFit
    candidates: tuple[Candidate, ...]
    flight: LinearisedFlight
    components: Mapping[str, str]
    dictionary: Dictionary | None = None
    discovery: Discovery | None = None


def bare_look(
    seen: Seen, model: Model, values: FloatArray, config: TraceConfig, noise: Noise | None = None
) -> Look:
    """The regression of a model alone on the fitted part."""
    flight = linearised_at(seen, model, values)
    problem = problem_of(seen, model, flight, config, noise=noise)
    return Look(seen, problem, fit_hypothesis(problem, "none", ()), (), flight, {})


def look(
    seen: Seen,
    model: Model,
    values: FloatArray,
    mechanisms: Sequence[Mechanism],
    effects: Sequence[RecordEffect],
    config: TraceConfig,
) -> Look:
    """Fit the model and every candidate on the fitted part, under the noise that the record itself says.

    Where the dictionary is searched too, `discovery` is the one entry of it that describes best what is left.
    """
    flight = linearised_at(seen, model, values)
    catalogue, histories = _histories(seen.frame, flight, effects)
    problem = problem_of(seen, model, flight, config, histories)
    null = fit_hypothesis(problem, "none", ())
    by_name = {mechanism.name: mechanism for mechanism in mechanisms}
    found = _try_all(problem, null, mechanisms, catalogue)
    if found:
        problem = with_efficiency(problem, _leader(found).fit)
        null = fit_hypothesis(problem, "none", ())
        found = _refined(problem, null, [fitted_again(problem, null, candidate) for candidate in found], by_name)
        problem, found, catalogue = _closer(problem, null, found, flight, catalogue)
        leader = _leader(found)
        if _has_nonlinear(leader):
            closer = refine_again(LeftOut(problem), null, leader)
            found = [closer if c is leader else c for c in found]
        problem = with_efficiency(problem, _leader(found).fit)
        null = fit_hypothesis(problem, "none", ())
        found = [fitted_again(problem, null, candidate) for candidate in found]
    found = sorted(found, key=lambda candidate: candidate.fit.information)
    dictionary = dictionary_of(problem) if config.discover else None
    discovery = discover(problem, null, dictionary, generic_name(model), 1) if dictionary else None
    left_out = LeftOut(problem)
    told = [replace(c, explains=left_out.explained(null, c.fit)) for c in found[:_TOLD]]
    components = {
        name: component
        for variants in catalogue.values()
        for effect, names in variants
        for name, (component, _, _) in zip(names, effect.components(seen.flight), strict=True)
    }
    return Look(seen, problem, null, (*told, *found[_TOLD:]), flight, components, dictionary, discovery)


def generic_name(model: Model) -> str:
    """The name of what is described in generic terms beside the model."""
    return f"discovered_{len(model.added) + 1}"


def _leader(found: Sequence[Candidate]) -> Candidate:
    return min(found, key=lambda candidate: candidate.fit.information)


def _refined(
    problem: Problem, null: HypothesisFit, found: Sequence[Candidate], mechanisms: Mapping[str, Mechanism]
) -> list[Candidate]:
    """The candidates, the best few with their knots and delays refined."""
    ranked = sorted(found, key=lambda candidate: -candidate.gain)
    most = max(ranked[0].gain, 0.0) if ranked else 0.0
    worth = [c.name for c in ranked if c.name in mechanisms and c.gain > _WORTH_REFINING * most]
    worth = [c.name for c in ranked if c.name in worth and _has_nonlinear(c)][:_REFINED]
    left_out = LeftOut(problem)
    return [refine_mechanism(left_out, null, mechanisms[c.name]) if c.name in worth else c for c in found]


def _closer(
    problem: Problem,
    null: HypothesisFit,
    found: Sequence[Candidate],
    flight: LinearisedFlight,
    catalogue: Catalogue,
) -> tuple[Problem, list[Candidate], Catalogue]:
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
                variants, histories = _variants_of(problem.frame, flight, effect, f"{turn}.")
                problem = replace(problem, given={**problem.given, **histories})
                catalogue = {**catalogue, effect.name: [*catalogue[effect.name], *variants]}
                nearer = try_record_effect(problem, null, variants)
                if nearer is not None and nearer.effect is not None and nearer.gain > candidate.gain:
                    candidate = replace(nearer, fit=replace(nearer.fit, searched=candidate.fit.searched))
                    effect = nearer.effect
        closer.append(candidate)
    return problem, closer, catalogue


def _has_nonlinear(candidate: Candidate) -> bool:
    return any(column.theta or column.course.kind != "constant" for column in candidate.fit.selected)


def _try_all(
    problem: Problem,
    null: HypothesisFit,
    mechanisms: Sequence[Mechanism],
    catalogue: Catalogue,
) -> list[Candidate]:
    tried = [try_mechanism(problem, null, mechanism) for mechanism in mechanisms]
    tried += [try_record_effect(problem, null, variants) for variants in catalogue.values()]
    return [candidate for candidate in tried if candidate is not None]


def _histories(
    frame: RateFrame, flight: LinearisedFlight, effects: Sequence[RecordEffect]
) -> tuple[Catalogue, dict[str, Rows]]:
    """Every variant of every record effect with the histories of its components, by name."""
    catalogue: Catalogue = {}
    histories: dict[str, Rows] = {}
    for effect in effects:
        variants, own = _variants_of(frame, flight, effect, "")
        catalogue = {**catalogue, effect.name: variants}
        histories.update(own)
    return catalogue, histories


def _variants_of(
    frame: RateFrame, flight: LinearisedFlight, effect: RecordEffect, label: str
) -> tuple[list[tuple[RecordEffect, Mapping[str, str]]], dict[str, Rows]]:
    variants: list[tuple[RecordEffect, Mapping[str, str]]] = []
    histories: dict[str, Rows] = {}
    for number, variant in enumerate(effect.variants(flight.record.flight)):
        names = {}
        for component, units, size in variant.components(flight.record.flight):
            name = f"{variant.name} {component} {label}{number}"
            histories[name] = on_frame(frame, 0, flight.effect(variant, component, size))
            names[name] = units
        variants.append((variant, names))
    return variants, histories
