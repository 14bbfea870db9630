"""`Analysis`: at one step of a trace, the fitted model and every candidate tried beside it."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from brv_hypo.constants import RECORD_EFFECT_CLOSER
from brv_hypo.mechanisms.contract import Component, Mechanism, RecordEffect
from brv_hypo.regression.channels import Noise, Rows
from brv_hypo.regression.fit import HypothesisFit, fit_hypothesis, likeliest
from brv_hypo.regression.frame import RateFrame
from brv_hypo.regression.noise import estimated_noise, first_noise, raised_noise
from brv_hypo.regression.nuisance import on_frame
from brv_hypo.regression.problem import Problem
from brv_hypo.regression.response import LinearisedFlight
from brv_hypo.residuals.candidates import Candidate, Variant, fitted_again, try_mechanism, try_record_effect
from brv_hypo.residuals.config import TraceConfig
from brv_hypo.residuals.discover import Discovery, discover
from brv_hypo.residuals.linearisation import Corrected, Model
from brv_hypo.residuals.problem import problem_of, with_efficiency

# What is described in generic terms is called this, with the number of its step.
GENERIC = "discovered"

Catalogue = Mapping[str, list[Variant]]
"""By effect: its variants."""


@dataclass(frozen=True)
class Analysis:
    """A fitted model and what every candidate would do beside it, on the fitted part.

    `components` maps the histories of record effects to their flights and components; `discovery` is None where no
    description in generic terms was asked for.
    """

    data: Corrected
    problem: Problem
    null: HypothesisFit
    candidates: tuple[Candidate, ...]
    flights: tuple[LinearisedFlight, ...]
    components: Mapping[str, tuple[int, Component]]
    discovery: Discovery | None = None


def baseline_analysis(
    data: Corrected, model: Model, flights: tuple[LinearisedFlight, ...], config: TraceConfig, noise: Noise
) -> Analysis:
    """The regression of a model alone on the fitted part of linearised flights."""
    problem = problem_of(data, model, flights, config, noise=noise)
    return Analysis(data, problem, fit_hypothesis(problem, "none", ()), (), flights, {})


def analyse_step(
    data: Corrected,
    model: Model,
    flights: tuple[LinearisedFlight, ...],
    mechanisms: Sequence[Mechanism],
    effects: Sequence[RecordEffect],
    config: TraceConfig,
) -> Analysis:
    """Fit the model and every candidate on the fitted part of linearised flights, under the noise that they say.

    Where the dictionary is searched too, `discovery` is the one entry of it that describes best what is left.
    """
    catalogue, histories = _histories(data.frame, flights, effects, model)
    plain = problem_of(data, model, flights, config, histories, first_noise(flights))
    sharp = plain.under(estimated_noise(plain))
    problem = sharp.under(raised_noise(sharp))
    null = fit_hypothesis(problem, "none", ())
    tried = [try_mechanism(problem, sharp, null, mechanism) for mechanism in mechanisms]
    tried += [try_record_effect(problem, null, variants) for variants in catalogue.values()]
    found = [candidate for candidate in tried if candidate is not None]
    if found:
        problem = with_efficiency(problem, likeliest([candidate.fit for candidate in found]))
        null = fit_hypothesis(problem, "none", ())
        found = [fitted_again(problem, null, candidate) for candidate in found]
        problem, found, catalogue = _closer(problem, null, found, flights, catalogue)
    found = sorted(found, key=lambda candidate: candidate.fit.information)
    discovery = discover(problem, null, generic_name(model)) if config.discover else None
    components = _placed([variant for variants in catalogue.values() for variant in variants])
    return Analysis(data, problem, null, tuple(found), flights, components, discovery)


def generic_name(model: Model) -> str:
    """The name of what is described in generic terms beside the model."""
    numbers = itertools.count(len(model.added) + 1)
    return next(name for number in numbers if (name := f"{GENERIC}_{number}") not in model.mechanisms)


def _closer(
    problem: Problem,
    null: HypothesisFit,
    found: Sequence[Candidate],
    flights: Sequence[LinearisedFlight],
    catalogue: Catalogue,
) -> tuple[Problem, list[Candidate], Catalogue]:
    """The candidates, record effects that come in variants brought closer to their best one.

    However little they gain: a quarter of a second off its time, a step of the wind may look like nothing.
    """
    closer = []
    for candidate in found:
        effect = candidate.effect
        if effect is not None and len(catalogue[candidate.name]) > 1:
            for turn in range(RECORD_EFFECT_CLOSER):
                number, _ = _placed(catalogue[candidate.name])[candidate.fit.selected[0].term]
                variants, histories = _variants_of(problem.frame, {number: flights[number]}, effect, f"{turn}.")
                problem = replace(problem, given={**problem.given, **histories})
                catalogue = {**catalogue, effect.name: [*catalogue[effect.name], *variants]}
                nearer = try_record_effect(problem, null, variants)
                if nearer is not None and nearer.effect is not None and nearer.gain > candidate.gain:
                    candidate = replace(nearer, fit=replace(nearer.fit, searched=candidate.fit.searched))
                    effect = nearer.effect
        closer.append(candidate)
    return problem, closer, catalogue


def _histories(
    frame: RateFrame, flights: Sequence[LinearisedFlight], effects: Sequence[RecordEffect], model: Model
) -> tuple[Catalogue, dict[str, Rows]]:
    """Every variant of every record effect, and the histories of its components by name.

    An effect that the model holds on some of the flights is tried on the others.
    """
    catalogue: Catalogue = {}
    histories: dict[str, Rows] = {}
    for effect in effects:
        held = {applied.flight for applied in model.applied if applied.effect.name == effect.name}
        others = {number: flight for number, flight in enumerate(flights) if number not in held}
        variants, own = _variants_of(frame, others, effect, "")
        catalogue = {**catalogue, effect.name: variants}
        histories.update(own)
    return catalogue, histories


def _variants_of(
    frame: RateFrame, flights: Mapping[int, LinearisedFlight], effect: RecordEffect, label: str
) -> tuple[list[Variant], dict[str, Rows]]:
    """The effect on these flights: as one variant where it has no settings to try, else one flight at a time."""
    settings = {number: effect.variants(flight.record.flight) for number, flight in flights.items()}
    plain = all(own == (effect,) for own in settings.values())
    found: list[Variant] = []
    histories: dict[str, Rows] = {}
    together: dict[str, tuple[int, Component]] = {}
    for number, flight in flights.items():
        for place, variant in enumerate(settings[number]):
            names: dict[str, tuple[int, Component]] = {}
            for component in variant.components(flight.record.flight):
                name = f"{variant.name} {component.name} {label}{place} [flight {number}]"
                histories[name] = on_frame(frame, number, flight.effect(variant, component.name, component.size))
                names[name] = (number, component)
            together |= names
            if not plain:
                found.append(Variant(variant, names))
    return [Variant(effect, together)] if plain else found, histories


def _placed(variants: Sequence[Variant]) -> dict[str, tuple[int, Component]]:
    """The flight and component of each history."""
    return {name: place for variant in variants for name, place in variant.histories.items()}
