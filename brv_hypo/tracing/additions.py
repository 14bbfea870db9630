"""What may be added to a model at one step, every effect fitted beside it. Entrance: `analyse_step`."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import replace
from operator import attrgetter

import numpy as np

from brv_hypo.flight.record import Flight
from brv_hypo.inference.fit import HypothesisFit, fit_hypothesis, likeliest, refined_fit, solved
from brv_hypo.inference.problem import Problem, given_column
from brv_hypo.inference.reduced import Reduced
from brv_hypo.inference.search import extended
from brv_hypo.linearisation.frame import RateFrame
from brv_hypo.mechanisms.contract import Mechanism, RecordEffect
from brv_hypo.model.model import Applied, Model
from brv_hypo.model.term import Regressor, Theta, candidates, default_knots, theta_grid
from brv_hypo.tracing.acceptance import Candidate, bounded, solved_again
from brv_hypo.tracing.description import GENERIC, described
from brv_hypo.tracing.families import RECORD_EFFECT_LARGEST, RECORD_SHARE_LARGEST
from brv_hypo.tracing.fit import Fit, history_name

RECORD_EFFECT_CLOSER = 3  # turns about the best variant of the turn before
Variant = tuple[Applied, ...]  # the components of a record effect as it may be set, none with a value yet


def analyse_step(
    fit: Fit, mechanisms: Sequence[Mechanism], effects: Sequence[RecordEffect], describe: bool = False
) -> tuple[Fit, tuple[Candidate, ...]]:
    """Every candidate beside a model, `describe`: the dictionary's best too; the fit under the noise that they show."""
    model = fit.model
    catalogue: dict[str, list[Variant]] = {}
    for effect in effects:  # one that the model has on some of the flights is tried on the others
        known = {applied.flight for applied in model.applied if applied.effect.name == effect.name}
        others = {k: record.flight for k, record in enumerate(fit.data.records) if k not in known}
        catalogue[effect.name] = _variants_of(others, effect)
    given = fit.histories(each for variants in catalogue.values() for variant in variants for each in variant)
    fit = replace(fit, problem=replace(fit.problem, given=given))
    sharp = fit.problem.under(fit.noise)
    tried = [_try_mechanism(fit, sharp, mechanism) for mechanism in mechanisms]
    tried += [_try_record_effect(fit, variants) for variants in catalogue.values()]
    found = [candidate for candidate in tried if candidate is not None]
    if found:
        best = likeliest([each.fit for each in found])
        fit = replace(fit, problem=replace(fit.problem, efficiency=fit.problem.efficiency_of(best.residual)))
        for place, candidate in enumerate(found):
            own = bounded(fit.problem, replace(candidate.fit, efficiency=fit.problem.efficiency))
            found[place] = replace(candidate, null=fit.null, fit=own)
            if len(catalogue.get(candidate.name, ())) > 1:
                fit, found[place] = _closer(fit, found[place])
    found.sort(key=attrgetter("fit.information"))
    if describe and (generic := described(fit.problem, generic_name(model))) is not None:
        found.append(Candidate("discovered", fit.null, generic))
    return fit, tuple(found)


def generic_name(model: Model) -> str:
    """The name of what is described in generic terms beside the model."""
    numbers = itertools.count(len(model.added) + 1)
    return next(name for number in numbers if (name := f"{GENERIC}_{number}") not in model.mechanisms)


# ---- Errors of the record ----


def _variants_of(flights: Mapping[int, Flight], effect: RecordEffect) -> list[Variant]:
    """The effect on these flights, as one variant where it has no settings to try, else one flight at a time."""
    found, together = list[Variant](), True
    for number, flight in flights.items():
        variants = effect.variants(flight)
        together &= variants == (effect,)
        for each in variants:
            parts = each.components(flight)
            found.append(
                tuple(Applied(effect=each, component=c, units=u, size=s, value=0.0, flight=number) for c, u, s in parts)
            )
    return [tuple(itertools.chain(*found))] if together else found


def _try_record_effect(fit: Fit, variants: Sequence[Variant]) -> Candidate | None:
    """A record effect's best components, at its best variant; None where only sizes fit that no record has."""
    problem, searched = fit.problem, sum(map(len, variants))
    found = []
    for variant in filter(None, variants):
        effect, known = variant[0].effect, {history_name(each): each for each in variant}
        columns = tuple(given_column(name) for name in known)
        for own in forward(problem, effect.name, (), problem.frame, columns, searched):
            pairs = zip(own.selected, own.values[own.baseline_size :].tolist(), strict=True)
            applied = tuple(known[column.term].model_copy(update={"value": value}) for column, value in pairs)
            shares = (abs(a.value) for a in applied if a.units == "1")  # of what is measured
            few = all(abs(a.value) <= RECORD_EFFECT_LARGEST * a.size for a in applied)
            if few and max(shares, default=0.0) < RECORD_SHARE_LARGEST:
                found.append(Candidate(effect.kind, fit.null, own, applied))
    return min(found, key=lambda candidate: candidate.fit.information, default=None)


def _closer(fit: Fit, candidate: Candidate) -> tuple[Fit, Candidate]:
    """A record effect closer to its best variant, however little it gains; the fit with those histories."""
    for _ in range(RECORD_EFFECT_CLOSER):
        best = candidate.applied[0]
        variants = _variants_of({best.flight: fit.data.records[best.flight].flight}, best.effect)
        given = {**fit.problem.given, **fit.histories(itertools.chain(*variants))}
        fit = replace(fit, problem=replace(fit.problem, given=given))
        nearer = _try_record_effect(fit, variants)
        if nearer is not None and nearer.gain > candidate.gain:
            candidate = replace(nearer, fit=replace(nearer.fit, searched=candidate.fit.searched))
    return fit, candidate


# ---- Moments ----


def _try_mechanism(fit: Fit, sharp: Problem, mechanism: Mechanism) -> Candidate | None:
    """A mechanism's columns beside the model; None if it adds none. On one flight as `compare` searches them, under the
    record's own noise (`sharp`): where much of the residual is the effect, a noise raised to it hides delays and knots.
    On several flights the best ones on the grids, refined.
    """
    problem = fit.problem
    if len(problem.records) == 1:
        own = fit_hypothesis(sharp, mechanism.name, (mechanism,))
        fits = [solved_again(problem, own)] if own.selected else []
    else:
        frame, grid = problem.frame.with_mechanisms([mechanism]), theta_grid(mechanism)
        offered = [_offered(problem, frame, mechanism, (theta,)) for theta in grid]
        searched = len({column for offer in offered for column in offer})
        named = mechanism.name, (mechanism,), frame
        fits = [each for offer in offered for each in forward(problem, *named, offer, searched)]
        if mechanism.parameters():  # between the points of their grids, further terms may be worth their price
            sizes = sorted({len(each.selected) for each in fits})
            best = (likeliest([each for each in fits if len(each.selected) == size]) for size in sizes)
            fits += [refined_fit(problem, each, each.columns, ()) for each in best]
    return Candidate("mechanism", fit.null, likeliest(fits)) if fits else None


def _offered(
    problem: Problem, frame: RateFrame, mechanism: Mechanism, thetas: Sequence[Theta]
) -> tuple[Regressor, ...]:
    """The columns at these thetas; what follows time or is of the vehicle is of each flight that has none yet."""
    own = mechanism.of_each_flight(frame.reconstructions[0].flight)
    offered = () if own else candidates(mechanism, frame.motions[0], np.zeros(0), thetas)
    with_own = {column.flight for column in problem.baseline if column.mechanism == mechanism.name}
    for number, motion in enumerate(frame.motions):
        if number in with_own:
            continue
        knots = mechanism.knots(motion)
        if knots is None:
            knots = default_knots(float(motion.time[0]), float(motion.time[-1]), problem.knots.size)
        of_flight = [c for c in candidates(mechanism, motion, knots, thetas) if own or c.time_basis.kind != "constant"]
        offered = (*offered, *(replace(column, flight=number) for column in of_flight))
    return offered


def forward(
    problem: Problem,
    name: str,
    mechanisms: tuple[Mechanism, ...],
    frame: RateFrame,
    columns: tuple[Regressor, ...],
    searched: int,
) -> list[HypothesisFit]:
    """Fits of 1, 2, ... choices of columns, each the one before with the choice that lowers the error most."""
    reduced, chosen, found = Reduced(problem, frame), problem.baseline, list[HypothesisFit]()
    while (selected := extended(problem, frame, chosen, mechanisms, [columns])) is not None:
        chosen = (*problem.baseline, *selected)
        found.append(solved(reduced, name, mechanisms, chosen, searched))
    return found
