"""What may be added to a model at one step, every effect fitted beside it, and which of them is.

Entrances: `analyse_step` fits them, `choose` tries the best on the blocks held out until one is accepted.
"""

from __future__ import annotations

import itertools
from collections import ChainMap
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.constants import (
    CONFOUNDED_NEAR,
    HINT_REPEATED,
    LOOP_BEYOND_DOUBT,
    LOOP_DETECTED,
    LOOP_IN_ITS_PLACE,
    LOOP_SCHEDULE,
    LOOP_TRIES,
    MODEL_TRIFLE,
    RECORD_EFFECT_CLOSER,
    RECORD_EFFECT_LARGEST,
)
from brv_hypo.inference.fit import HypothesisFit, fit_hypothesis, likeliest
from brv_hypo.inference.noise import estimated_noise, first_noise, raised_noise
from brv_hypo.inference.problem import Problem, given_column
from brv_hypo.linearisation.channels import Rows
from brv_hypo.linearisation.frame import RateFrame
from brv_hypo.linearisation.linear import lengths
from brv_hypo.linearisation.nuisance import on_frame
from brv_hypo.linearisation.response import LinearisedFlight
from brv_hypo.mechanisms.contract import Component, Mechanism, RecordEffect
from brv_hypo.model.model import Applied, Model
from brv_hypo.model.term import Regressor, Theta, candidates, default_knots, theta_grid
from brv_hypo.thresholds import SPECIFIC
from brv_hypo.tracing.acceptance import (
    Candidate,
    Tried,
    adjusted,
    agreement,
    candidate_of,
    confounded,
    fitted_again,
    nearly_equal,
    ratio,
    solved,
    solved_again,
)
from brv_hypo.tracing.baseline import has_schedule
from brv_hypo.tracing.description import Discovery, discover
from brv_hypo.tracing.fit import Fit, MomentErrors, constrained, converged, fitted_about, has_tolerance, with_efficiency

# What is described in generic terms is called this, with the number of its step.
GENERIC = "discovered"


@dataclass(frozen=True)
class Analysis:
    """A model's fit and what every candidate would do beside it, on the fitted part.

    `histories` are those of record effects by name; `discovery` is None where no description in generic terms is
    wanted.
    """

    fit: Fit
    candidates: tuple[Candidate, ...]
    histories: Mapping[str, History]
    discovery: Discovery | None = None

    def with_candidate(self, candidate: Candidate) -> Fit:
        """The model with the candidate added, fitted to the fitted part of the flights.

        Without an error of the record that it lacked, other errors had taken up some of it: with it they are estimated
        anew, where that fits better.
        """
        fit, found = self.fit, candidate.fit
        if candidate.effect is None:
            known = {mechanism.name: mechanism for mechanism in found.mechanisms}
            model = fit.model + Model(mechanisms=known, columns=found.selected, added=(candidate.name,))
            problem = replace(fit.problem, frame=found.frame, baseline=model.columns)
            return Fit(model, replace(fit.data, frame=found.frame), problem, fit.linear)
        values = found.values[found.baseline_size :].tolist()
        applied = tuple(
            Applied(effect=candidate.effect, component=name, units=units, size=size, value=value, flight=number)
            for column, value in zip(found.selected, values, strict=True)
            for number, (name, units, size), _ in [self.histories[column.term]]
        )
        model = fit.model + Model(applied=applied, added=(candidate.name,))
        freed = {(each.flight, each.effect.name, each.component) for each in applied}
        corrections = [
            {name: value for name, value in known.items() if (number, *name) not in freed}
            for number, known in enumerate(fit.data.corrections)
        ]
        own = fitted_about(fit.data.again(model, corrections), model, fit.values, fit.problem.rows.noise)
        anew = converged(fit.data.originals, model, fit.data.config)
        return anew if anew.errors.mean_square * MODEL_TRIFLE < own.errors.mean_square else own


def analyse_step(
    fit: Fit, mechanisms: Sequence[Mechanism], effects: Sequence[RecordEffect], describe: bool = False
) -> Analysis:
    """Fit every candidate beside a model on the fitted part of linearised flights, under the noise that they show.

    To `describe`: the one entry of the dictionary too that describes best what is unexplained.
    """
    model, linear, frame = fit.model, fit.linear, fit.data.frame
    catalogue: dict[str, list[Variant]] = {}
    given: dict[str, Rows] = {}
    for effect in effects:  # one that the model has on some of the flights is tried on the others
        known = {applied.flight for applied in model.applied if applied.effect.name == effect.name}
        others = {number: flight for number, flight in enumerate(linear) if number not in known}
        catalogue[effect.name], own = _variants_of(frame, others, effect)
        given |= own
    plain = fit.data.regression(model, linear, given, first_noise(linear))
    sharp = plain.under(estimated_noise(plain))
    fit = replace(fit, problem=sharp.under(raised_noise(sharp)))
    tried = [_try_mechanism(fit, sharp, mechanism) for mechanism in mechanisms]
    tried += [_try_record_effect(fit, variants) for variants in catalogue.values()]
    found = [candidate for candidate in tried if candidate is not None]
    if found:
        problem = with_efficiency(fit.problem, likeliest([candidate.fit for candidate in found]))
        fit = replace(fit, problem=problem)
        found = [fitted_again(problem, fit.null, candidate) for candidate in found]
        fit, found = _closer(fit, found, catalogue)
    found = sorted(found, key=lambda candidate: candidate.fit.information)
    discovery = discover(fit.problem, fit.null, generic_name(model)) if describe else None
    return Analysis(fit, tuple(found), dict(ChainMap(*itertools.chain(*catalogue.values()))), discovery)


def generic_name(model: Model) -> str:
    """The name of what is described in generic terms beside the model."""
    numbers = itertools.count(len(model.added) + 1)
    return next(name for number in numbers if (name := f"{GENERIC}_{number}") not in model.mechanisms)


# ---- Errors of the record ----


class History(NamedTuple):
    """What a component of a record effect makes of one flight."""

    flight: int
    component: Component
    effect: RecordEffect


Variant = dict[str, History]
"""A record effect as it may be set: its histories by name."""


def _variants_of(
    frame: RateFrame, flights: Mapping[int, LinearisedFlight], effect: RecordEffect, label: str = ""
) -> tuple[list[Variant], dict[str, Rows]]:
    """The effect on these flights, as one variant where it has no settings to try, else one flight at a time; and the
    histories themselves.
    """
    settings = {number: effect.variants(flight.record.flight) for number, flight in flights.items()}
    found: list[Variant] = []
    given: dict[str, Rows] = {}
    for number, flight in flights.items():
        for place, variant in enumerate(settings[number]):
            own: Variant = {}
            for component in variant.components(flight.record.flight):
                name = f"{variant.name} {component.name} {label}{place} [flight {number}]"
                given[name] = on_frame(frame, number, flight.effect(variant, component.name, component.size))
                own[name] = History(number, component, variant)
            found.append(own)
    together = all(each == (effect,) for each in settings.values())
    return [{name: each for own in found for name, each in own.items()}] if together else found, given


def _try_record_effect(fit: Fit, variants: Sequence[Variant]) -> Candidate | None:
    """A record effect's best components, at its best variant; None where only absurd sizes fit: the record would
    explain itself away.
    """
    problem, searched = fit.problem, sum(map(len, variants))
    found: list[tuple[HypothesisFit, RecordEffect]] = []
    for variant in filter(None, variants):
        most = {name: RECORD_EFFECT_LARGEST * each.component.size for name, each in variant.items()}
        groups = [(given_column(name, each.component.units),) for name, each in variant.items()]
        effect = next(iter(variant.values())).effect
        for own in forward(problem, effect.name, (), problem.frame, groups, searched):
            values = zip(own.selected, own.values[own.baseline_size :], strict=True)
            if all(abs(value) <= most[column.term] for column, value in values):
                found.append((own, effect))
    if not found:
        return None
    best, effect = min(found, key=lambda pair: pair[0].information)
    return replace(candidate_of(problem, fit.null, best, effect.name, effect.kind), effect=effect)


def _closer(fit: Fit, found: Sequence[Candidate], catalogue: dict[str, list[Variant]]) -> tuple[Fit, list[Candidate]]:
    """The candidates, record effects that come in variants brought closer to their best one.

    However little they gain: a quarter of a second off its time, a step of the wind may look like nothing.
    """
    closer = []
    for candidate in found:
        for turn in range(RECORD_EFFECT_CLOSER):
            effect = candidate.effect
            if effect is None or len(catalogue[candidate.name]) < 2:
                break
            number = ChainMap(*catalogue[candidate.name])[candidate.fit.selected[0].term].flight
            variants, given = _variants_of(fit.problem.frame, {number: fit.linear[number]}, effect, f"{turn}.")
            fit = replace(fit, problem=replace(fit.problem, given={**fit.problem.given, **given}))
            catalogue[candidate.name] += variants
            nearer = _try_record_effect(fit, variants)
            if nearer is not None and nearer.gain > candidate.gain:
                candidate = replace(nearer, fit=replace(nearer.fit, searched=candidate.fit.searched))
        closer.append(candidate)
    return fit, closer


# ---- Moments ----


def _try_mechanism(fit: Fit, sharp: Problem, mechanism: Mechanism) -> Candidate | None:
    """A mechanism's columns beside the model; None if it adds none.

    On one flight as `compare` searches them, under the record's own noise (`sharp`): where much of the residual is the
    effect, a noise raised to it hides delays and knots. On several flights the best ones on the grids.
    """
    problem = fit.problem
    if len(problem.records) == 1:
        found = fit_hypothesis(sharp, mechanism.name, (mechanism,))
        fits = [solved_again(problem, found)] if found.selected else []
    else:
        frame = problem.frame.with_mechanisms([mechanism])
        grid = theta_grid(mechanism)
        together = [grid] if mechanism.several_parameters_at_once else [(theta,) for theta in grid]
        offered = [_offered(problem, frame, mechanism, thetas) for thetas in together]
        searched = len({column for offer in offered for column in offer})
        own = mechanism.name, (mechanism,), frame
        fits = [each for offer in offered for each in forward(problem, *own, _groups_of(offer), searched)]
    return candidate_of(problem, fit.null, likeliest(fits), mechanism.name, "mechanism") if fits else None


def _offered(
    problem: Problem, frame: RateFrame, mechanism: Mechanism, thetas: Sequence[Theta]
) -> tuple[Regressor, ...]:
    """The columns at these thetas: those that follow the motion are shared by all flights, those that follow time or
    belong to the vehicle are of each flight that has none yet.
    """
    own = mechanism.of_each_flight(frame.reconstructions[0].flight)
    shared = () if own else candidates(mechanism, frame.motions[0], np.zeros(0), thetas)
    with_own = {column.flight for column in problem.baseline if column.mechanism == mechanism.name}
    of_flights = []
    for number, motion in enumerate(frame.motions):
        knots = mechanism.knots(motion)
        if knots is None:
            knots = default_knots(float(motion.time[0]), float(motion.time[-1]), problem.knots.size)
        of_flights += [
            replace(column, flight=number)
            for column in (candidates(mechanism, motion, knots, thetas) if number not in with_own else ())
            if own or column.time_basis.kind != "constant"
        ]
    return (*shared, *of_flights)


def _groups_of(columns: Sequence[Regressor]) -> list[tuple[Regressor, ...]]:
    """Columns that enter together."""
    found: dict[object, list[Regressor]] = {}
    for column in columns:
        found.setdefault(column.choice, []).append(column)
    return [tuple(group) for group in found.values()]


def forward(
    problem: Problem,
    name: str,
    mechanisms: tuple[Mechanism, ...],
    frame: RateFrame,
    groups: Sequence[tuple[Regressor, ...]],
    searched: int,
) -> list[HypothesisFit]:
    """Fits of 1, 2, ... groups of columns, each the one before with the group that lowers the error most."""
    design = problem.design(frame, [column for group in groups for column in group])
    baseline = problem.design(problem.frame, problem.baseline)
    basis = np.linalg.qr(baseline / lengths(baseline))[0]
    ends = np.cumsum([0, *(len(group) for group in groups)])
    places = [slice(a, b) for a, b in itertools.pairwise(ends)]
    left, free = (rows - basis @ (basis.T @ rows) for rows in (problem.response, design))
    least = 1e-6 * lengths(design)
    chosen: list[int] = []
    found: list[HypothesisFit] = []
    while len(chosen) < len(groups) and sum(len(groups[i]) for i in chosen) < problem.max_terms:
        gains = [_gain(free[:, p], left, least[p]) if i not in chosen else -1.0 for i, p in enumerate(places)]
        best = int(np.argmax(gains))
        if gains[best] <= 0.0:
            break
        chosen.append(best)
        own = np.linalg.qr(free[:, places[best]])[0]
        left, free = (rows - own @ (own.T @ rows) for rows in (left, free))
        columns = tuple(column for i in chosen for column in groups[i])
        whole = np.column_stack([baseline, *(design[:, places[i]] for i in chosen)])
        found.append(solved(problem, name, mechanisms, frame, columns, searched, whole))
    return found


def _gain(columns: FloatArray, left: FloatArray, least: FloatArray) -> float:
    """Fall of the residual sum of squares by a group of columns; none where they are spent."""
    if np.any(np.linalg.norm(columns, axis=0) <= least):
        return 0.0
    return float(np.sum((np.linalg.qr(columns)[0].T @ left) ** 2))


# ---- Which is added ----


@dataclass(frozen=True)
class Choice:
    """The candidates, best first, and those that were tried on the held-out part, in order.

    `named_in`: the share of the repetitions that name the last of these, where the held-out part agrees with it.
    """

    ranked: tuple[Candidate, ...]
    tried: tuple[Tried, ...]
    named_in: float | None = None

    @property
    def accepted(self) -> Tried | None:
        """The last that was tried, where the held-out part agrees with it; None where few repetitions name it."""
        often = self.named_in is None or self.named_in >= HINT_REPEATED
        return self.tried[-1] if often and self.tried and self.tried[-1].accepted else None

    @property
    def unwanted(self) -> tuple[str, ...]:
        """Those that the held-out part agrees with, but processes explain far better, or are of another family."""
        return tuple(each.candidate.name for each in self.tried if each.agrees and not each.accepted)

    @property
    def leading(self) -> Tried | None:
        """What is added or, where nothing is, the best that counts."""
        return self.accepted or (self.tried[0] if self.tried else None)

    @property
    def reported(self) -> tuple[Candidate, ...]:
        """The candidates with the leading one first and what this flight cannot tell from it after it."""
        if self.leading is None:
            return self.ranked
        leader = self.leading.candidate
        rank = {leader.name: 0, **dict.fromkeys(confounded(leader, self.ranked), 1)}
        return tuple(sorted(self.ranked, key=lambda candidate: rank.get(candidate.name, 2)))


def choose(
    here: Analysis, add: Callable[[Candidate], Fit], weighed: Callable[[Fit], tuple[float, bool]] | None = None
) -> Choice:
    """Try the candidates that count on the held-out part, the best first, until one is taken.

    Those that predict what a refused one did are passed over: they cannot do better; nor can those that explain far
    less. Where the residual is white, what is not beyond doubt does not count: but an effect may still exceed the
    tolerance that every fit allows it. `weighed`: what the last effect of a model gains beside all processes, and
    whether no other family explains most of the residual.
    """
    significance, white = here.fit.data.config.significance, here.fit.residual.white
    ranked = tuple(_ranked(here, {column.mechanism for column in here.fit.problem.baseline}))
    first = () if has_schedule(here.fit.model) else schedules_first(ranked)
    ranked = (*first, *(candidate for candidate in ranked if candidate not in first))
    chances = adjusted(ranked)
    tried: list[Tried] = []
    for candidate in ranked:
        if candidate.gain <= 0.0 or candidate.fall < LOOP_DETECTED or chances[candidate.name] > significance:
            continue
        certain = chances[candidate.name] <= LOOP_BEYOND_DOUBT * significance
        if white and not certain and not has_tolerance(here.fit.problem, candidate.name):
            continue
        if any(nearly_equal(candidate, other.candidate) for other in tried if not other.agrees):
            continue
        if tried and candidate.gain < LOOP_IN_ITS_PLACE * tried[0].candidate.gain:
            break
        found = _try(here, candidate, certain, add)
        if found.agrees and weighed is not None:
            gain, of_majority = weighed(found.fit)
            found = replace(found, gain=gain, of_majority=of_majority)
        tried.append(found)
        if found.accepted or len(tried) == LOOP_TRIES:
            break
    return Choice(ranked, tuple(tried))


def _try(here: Analysis, candidate: Candidate, certain: bool, add: Callable[[Candidate], Fit]) -> Tried:
    fit, problem, data = here.fit, here.fit.problem, here.fit.data
    added, errors, before = add(candidate), (fit.errors, fit.held_out), fit.rest
    tolerance = has_tolerance(problem, candidate.name)
    if tolerance:  # without it: fixed at zero
        items = problem.rows.nuisances.items
        others = np.array([item.present if item.name == candidate.name else np.nan for item in items])
        free = np.full(len(problem.baseline), np.nan)
        before = constrained(problem, problem.frame, problem.baseline, free, others).left
        moments = data.moments(before.rates)
        errors = MomentErrors.of(data.fitted, moments), MomentErrors.of(data.held_out, moments)
    own = candidate.fit
    after = problem.left(own.frame, own.columns, *problem.solution(own.frame, own.columns))
    agrees, change = agreement(problem, data.held_out, before, after), ratio(errors[1], added.held_out)
    return Tried(candidate, added, agrees, *change, before, after, errors, certain, tolerance)


def schedules_first(ranked: Sequence[Candidate]) -> tuple[Candidate, ...]:
    """The schedules that explain not much less than the best candidate, in their order; see `is_schedule`."""
    most = max((candidate.gain for candidate in ranked), default=0.0)
    return tuple(c for c in ranked if is_schedule(c) and c.gain >= LOOP_SCHEDULE * most)


def is_schedule(candidate: Candidate) -> bool:
    """Whether a candidate's terms are a schedule of the flight's."""
    return any(mechanism.follows is not None for mechanism in candidate.fit.mechanisms)


def follows_mach(candidate: Candidate) -> bool:
    """Whether they are one by Mach number, which a model may have smooth."""
    return any(mechanism.follows == "mach" for mechanism in candidate.fit.mechanisms)


def best_first(
    offered: Sequence[Candidate], evidences: Mapping[str, float]
) -> Callable[[Candidate], tuple[float, float]]:
    """The order of candidates, the leader least: of those that the evidence cannot tell apart, what explains most.

    Beside processes, which describe any smooth course, evidences of several may differ by less than `SPECIFIC`.
    """
    most = max((evidences[each.name] for each in offered if each.name in evidences), default=-np.inf)
    equal = {name for name, own in evidences.items() if own > most - SPECIFIC}
    return lambda each: (-np.inf if each.name in equal else -evidences.get(each.name, -np.inf), -each.gain)


def _ranked(here: Analysis, known: Collection[str]) -> list[Candidate]:
    """The candidates, the leader first.

    The rest of an effect that the model has is that effect, described better: another has to beat it clearly. So has a
    description in generic terms a name.
    """
    evidences = {each.name: each.evidence for each in here.candidates if each.evidence is not None}
    order = best_first(here.candidates, evidences)
    better = dict.fromkeys(known, CONFOUNDED_NEAR)
    ranked = sorted(here.candidates, key=lambda each: (order(each)[0], order(each)[1] - better.get(each.name, 0.0)))
    if here.discovery is None:
        return ranked
    described = here.discovery.candidate

    def comes_later(candidate: Candidate) -> bool:
        if candidate.evidence is not None and described.evidence is not None:
            return described.evidence - candidate.evidence >= SPECIFIC
        return described.gain - candidate.gain >= CONFOUNDED_NEAR

    place = next((k for k, candidate in enumerate(ranked) if comes_later(candidate)), len(ranked))
    return [*ranked[:place], described, *ranked[place:]]
