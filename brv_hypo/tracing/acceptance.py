"""Which effect joins a model: a candidate as it is fitted, the blocks held out, all processes, repetitions.

A `Candidate` is one effect as fitted beside a model, with its F-ratio and what its search costs. `Tried` is a candidate
with what it does to the held-out error: `accepted` is the one test by which it joins the model. `choose` tries the
candidates of a step, best first, and says how many repetitions name the one that is accepted.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy import stats
from statsmodels.stats.multitest import multipletests

from brv_hypo.arrays import ComplexArray, FloatArray
from brv_hypo.comparison.intervals import intervals, within_bounds
from brv_hypo.constants import (
    CONFOUNDED_COSINE,
    CONFOUNDED_GAIN,
    CONFOUNDED_NEAR,
    FINDING_REPEATED,
    FINDING_SIGMAS,
    HELD_OUT_CLUSTER,
    HELD_OUT_SIGMAS,
    HELD_OUT_WORSE,
    HINT_REPEATED,
    LOOP_BEYOND_DOUBT,
    LOOP_DETECTED,
    LOOP_IN_ITS_PLACE,
    LOOP_REPEATED_BLOCKS,
    LOOP_REPEATED_KNOTS,
    LOOP_RIVALS,
    LOOP_SCHEDULE,
    LOOP_TRIES,
    LOOP_WITH_EVIDENCE,
    MODEL_TRIFLE,
    REPEATED_ERRORS,
)
from brv_hypo.inference.fit import HypothesisFit, solved, with_errors
from brv_hypo.inference.held_out import jackknife_error
from brv_hypo.inference.problem import Problem
from brv_hypo.inference.reduced import Reduced
from brv_hypo.inference.refinement import nonlinear_parameters
from brv_hypo.inference.rows import rows_of
from brv_hypo.linearisation.channels import Histories, Part, split
from brv_hypo.linearisation.linear import lengths
from brv_hypo.mechanisms.contract import Component, RecordEffect
from brv_hypo.mechanisms.yaml_mechanism import MechanismFile
from brv_hypo.model.model import Applied, Model
from brv_hypo.model.term import Regressor, default_knots
from brv_hypo.thresholds import SPECIFIC
from brv_hypo.tracing.baseline import has_schedule, scheduled
from brv_hypo.tracing.families import Beside, beside_processes
from brv_hypo.tracing.fit import Fit, converged, correct, fitted_about, has_tolerance
from brv_hypo.tracing.result import Kind, Status

_SPENT = 1e-10  # singular values of unit columns below which a direction is rounding

# ---- One effect as fitted ----


class History(NamedTuple):
    """What one typical size of a component of a record effect makes of a flight; `rows` (frame rows,)."""

    flight: int
    component: Component
    effect: RecordEffect
    rows: Histories


Variant = Mapping[str, History]
"""A record effect as it may be set: its histories by the names of their columns."""


@dataclass(frozen=True)
class Candidate:
    """One effect as fitted: `gain` is the fall of the extended BIC, `p_value` is paid for its own search.

    `explains` is the share of the weighed squares that it saves, `fall` their fall in effective samples.
    `contribution` (rows,) is what it adds to the prediction beyond what the model could take over, `in_rates` the fall
    of the whitened rates' squares. `variant` are the histories of a record effect, `file` a description in generic
    terms. `evidence` is the log evidence that it gains beside all processes, nats; None where it is not known.
    """

    name: str
    kind: Kind
    fit: HypothesisFit
    gain: float
    f_ratio: float
    p_value: float
    contribution: FloatArray
    in_rates: float
    fall: float
    explains: float
    variant: Variant = field(default_factory=dict)
    file: MechanismFile | None = None
    evidence: float | None = None

    @property
    def effect(self) -> RecordEffect | None:
        """The record effect with its settings; None for moments."""
        return next((history.effect for history in self.variant.values()), None)

    @property
    def follows(self) -> str | None:
        """The quantity by which its terms are a schedule of the flight's; None where they are none."""
        return next((m.follows for m in self.fit.mechanisms if m.follows is not None), None)


def candidate_of(
    problem: Problem,
    null: HypothesisFit,
    fit: HypothesisFit,
    kind: Kind,
    variant: Variant | None = None,
    file: MechanismFile | None = None,
) -> Candidate:
    """A fit as a candidate: its F-ratio, its p-value with all that was searched, what it saves within its bounds."""
    fit = _within_bounds(problem, fit)
    extra, free = fit.parameters - null.parameters, fit.samples - fit.parameters
    f_ratio = max((null.rss - fit.rss) / extra, 0.0) / (fit.rss / free)
    chance = float(stats.f.sf(f_ratio * fit.efficiency, extra, max(fit.effective - fit.parameters, 1.0)))
    chosen = len({column.choice for column in fit.selected})
    before, after = (each.residual[: problem.rows.rates] for each in (null, fit))
    return Candidate(
        name=fit.name,
        kind=kind,
        fit=fit,
        gain=null.information - fit.information,
        f_ratio=f_ratio,
        p_value=min(chance * math.comb(fit.searched, min(chosen, fit.searched)), 1.0),
        contribution=null.residual - fit.residual,
        in_rates=float((before @ before - after @ after) / (fit.rss / fit.samples)),
        fall=f_ratio * extra * fit.efficiency,
        explains=1.0 - fit.rss / null.rss,
        variant=variant or {},
        file=file,
    )


def _within_bounds(problem: Problem, fit: HypothesisFit) -> HypothesisFit:
    """The fit with what it would lose by values that a body may have, all where they are absurd: outside the bounds by
    more than these are wide, however large their errors. Of several flights, whose values differ, as it is.
    """
    bounds = {mechanism.name: mechanism.bounds for mechanism in fit.mechanisms}
    if len(problem.records) > 1 or not any(bounds.values()):
        return fit
    fit = with_errors(problem, replace(fit, bound_cost=0.0))
    values = [(net.value, bounds[net.mechanism].get(net.name)) for each in intervals(fit) for net in each.values]
    absurd = any(max(at[0] - value, value - at[1]) > at[1] - at[0] for value, at in values if at)
    return replace(fit, bound_cost=math.inf) if absurd else within_bounds(fit)


def solved_again(problem: Problem, fit: HypothesisFit) -> HypothesisFit:
    """A fit on the problem's rows, under its noise."""
    every = (*problem.baseline, *fit.selected)
    found = solved(Reduced(problem, fit.frame), fit.name, fit.mechanisms, every, fit.searched)
    return replace(found, nonlinear=fit.nonlinear)


# ---- Which are alike, which leads ----


def confounded(leader: Candidate, others: Sequence[Candidate]) -> tuple[str, ...]:
    """Those that this flight cannot tell from the leader: nearly as good a fit, and as likely beside processes."""
    return tuple(o.name for o in others if o.name != leader.name and o.gain > 0.0 and _is_equal(leader, o))


def _is_equal(leader: Candidate, other: Candidate) -> bool:
    explains = other.gain > CONFOUNDED_GAIN * leader.gain
    if leader.evidence is not None and other.evidence is not None:
        return explains and abs(leader.evidence - other.evidence) < SPECIFIC
    return abs(leader.gain - other.gain) < CONFOUNDED_NEAR or (explains and nearly_equal(leader, other))


def nearly_equal(one: Candidate, other: Candidate) -> bool:
    """Whether two candidates predict nearly the same."""
    a, b = one.contribution, other.contribution
    return float(a @ b) > CONFOUNDED_COSINE * float(np.linalg.norm(a) * np.linalg.norm(b))


def best_first(
    offered: Sequence[Candidate], evidences: Mapping[str, float]
) -> Callable[[Candidate], tuple[float, float]]:
    """The order of candidates, the leader least: of those that the evidence cannot tell apart, what explains most.

    Beside processes, which describe any smooth course, evidences of several may differ by less than `SPECIFIC`.
    """
    most = max((evidences[each.name] for each in offered if each.name in evidences), default=-np.inf)
    equal = {name for name, own in evidences.items() if own > most - SPECIFIC}
    return lambda each: (-np.inf if each.name in equal else -evidences.get(each.name, -np.inf), -each.gain)


def schedules_first(ranked: Sequence[Candidate]) -> tuple[Candidate, ...]:
    """The schedules that explain not much less than the best candidate, in their order."""
    most = max((candidate.gain for candidate in ranked), default=0.0)
    return tuple(c for c in ranked if c.follows is not None and c.gain >= LOOP_SCHEDULE * most)


def ranked(candidates: Sequence[Candidate], known: Collection[str], scheduled: bool) -> tuple[Candidate, ...]:
    """The candidates, the leader first; `known`: mechanisms that the model has.

    The rest of an effect that the model has is that effect, described better: another has to beat it clearly. So has a
    description in generic terms a name. Where the model is not `scheduled`, schedules that explain as much come first.
    """
    named = [each for each in candidates if each.kind != "discovered"]
    evidences = {each.name: each.evidence for each in named if each.evidence is not None}
    order = best_first(named, evidences)
    better = dict.fromkeys(known, CONFOUNDED_NEAR)
    found = sorted(named, key=lambda each: (order(each)[0], order(each)[1] - better.get(each.name, 0.0)))

    def is_beaten(candidate: Candidate, by: Candidate) -> bool:
        if candidate.evidence is not None and by.evidence is not None:
            return by.evidence - candidate.evidence >= SPECIFIC
        return by.gain - candidate.gain >= CONFOUNDED_NEAR

    for described in (each for each in candidates if each.kind == "discovered"):
        place = next((k for k, each in enumerate(found) if is_beaten(each, described)), len(found))
        found.insert(place, described)
    first = () if scheduled else schedules_first(found)
    return (*first, *(candidate for candidate in found if candidate not in first))


# ---- With it: the model, and the blocks held out ----


def with_candidate(fit: Fit, candidate: Candidate) -> Fit:
    """The model with a candidate added, fitted to the fitted part of the flights.

    Without an error of the record that it lacked, other errors had taken up some of it: with it they are estimated
    anew, where that fits better. So they are beside a first schedule by Mach number, which the model then has smooth.
    """
    found = candidate.fit
    if candidate.effect is None:
        known = {mechanism.name: mechanism for mechanism in found.mechanisms}
        model = fit.model + Model(mechanisms=known, columns=found.selected, added=(candidate.name,))
        data = replace(fit.data, frame=found.frame)
        if candidate.follows == "mach" and not has_schedule(fit.model):
            return converged(data.source, scheduled(model, data))
        return Fit(model, data, replace(fit.problem, frame=found.frame, baseline=model.columns), fit.linear)
    applied = []
    for column, value in zip(found.selected, found.values[found.baseline_size :].tolist(), strict=True):
        number, (name, units, size), effect, _ = candidate.variant[column.term]
        applied.append(Applied(effect=effect, component=name, units=units, size=size, value=value, flight=number))
    model = fit.model + Model(applied=tuple(applied), added=(candidate.name,))
    freed = {(each.flight, each.effect.name, each.component) for each in applied}
    corrections = [
        {name: value for name, value in known.items() if (number, *name) not in freed}
        for number, known in enumerate(fit.data.corrections)
    ]
    data = correct(fit.data.source, model, corrections)
    own, anew = fitted_about(data, model, fit.values, fit.problem.rows.noise), converged(data.source, model)
    return anew if anew.errors.mean_square * MODEL_TRIFLE < own.errors.mean_square else own


def with_columns(fit: Fit, candidate: Candidate) -> Fit:
    """The same regression with a candidate's columns."""
    own = candidate.fit
    return replace(fit, model=fit.model.but(columns=own.columns), data=replace(fit.data, frame=own.frame))


class Agreement(NamedTuple):
    """What the held-out part says of an effect, in both channels, in standard errors.

    `fall` of the squared error, by the effect with the coefficients that the fitted part gives; `shown`, how surely
    the effect is there at all, of whatever size: 1.645 has one chance in twenty where it is not.
    """

    fall: float
    shown: float


def agreement(problem: Problem, held_out: Part, before: Histories, after: Histories) -> Agreement:
    """Of the residuals (frame rows,) without an effect and with it, as a fit of `problem` leaves them.

    The difference of two predictions d and the later residual e give the fall: sum of d^2 + 2 e d, whose noise is
    that of the second part alone; it is summed over clusters of neighbours (White, Econometrica 48:817,
    1980). What the fitted part leaves uncertain of the held-out one, constants of integration among it, weighs the
    rows: it would drown what changes within a stretch.
    """
    directions, share = _uncertain(problem.untied(), held_out)
    first, second = (_whitened(problem, held_out, left) for left in (before, after))
    first, second = (rows + directions @ (share * (directions.T @ rows)) for rows in (first, second))
    difference = first - second
    products = difference * second
    clusters = np.add.reduceat(products, np.arange(0, products.size, HELD_OUT_CLUSTER))
    noise = max(float(np.sqrt(np.sum(clusters**2))), 1e-300)
    fall = float(first @ first - second @ second) / (2.0 * noise)
    return Agreement(fall, float(difference @ first) / noise)


def _whitened(problem: Problem, held_out: Part, left: Histories) -> FloatArray:
    """The held-out residuals at unit noise (rows,), the rates from the constant that the fitted part has."""
    part, noise, levels = problem.rows.part, problem.rows.noise, _levels(problem, held_out)
    fitted = part.white_rates(part.constants(), noise), part.white_rates(left.rates[part.rows], noise)[:, 0]
    there = left.at(held_out.rows)
    rates = there.rates - levels @ np.linalg.lstsq(*fitted, rcond=None)[0]
    for own in (slice(a, b) for a, b in held_out.pieces):
        if not levels[own].any():
            rates[own] -= rates[own].mean()
    return held_out.whitened(Histories(rates, there.force), noise)[:, 0]


def _levels(problem: Problem, held_out: Part) -> ComplexArray:
    """The fitted part's constants of integration as histories of the held-out rates (rows, 2 levels)."""
    first, ends = [a for a, _ in problem.rows.part.levels], np.cumsum([b - a for a, b in problem.frame.pieces])
    segments = [np.searchsorted(ends, rows, side="right") for rows in (held_out.rows, problem.rows.part.rows[first])]
    same = segments[0][:, np.newaxis] == segments[1]
    return np.asarray(np.repeat(same, 2, axis=1) * np.tile([1.0, 1.0j], len(first)))


def _uncertain(problem: Problem, held_out: Part) -> tuple[FloatArray, FloatArray]:
    """Directions (rows, rank) of the held-out rows in which a prediction from the fitted part errs.

    With them the share (rank,) by which rows change along each where all come to unit variance.
    """
    design = problem.whole_design(problem.frame, problem.baseline)
    scale = lengths(design)
    _, sizes, turn = np.linalg.svd(design / scale, full_matrices=False)
    determined = sizes > _SPENT * sizes[0]
    root = (turn[determined].T / sizes[determined]) / scale[:, np.newaxis]
    # Baseline, constants of the fitted part and nuisances on the held-out rows.
    there = problem.on(held_out).rows
    levels = np.zeros((problem.frame.observed.size, 2 * len(problem.rows.part.levels)), dtype=complex)
    levels[held_out.rows] = _levels(problem, held_out)
    of_moments = there.of_moments(np.column_stack([problem.frame.columns(problem.baseline), levels]))
    of_moments, unknowns = of_moments[: 2 * there.rates], there.nuisance_design[: 2 * there.rates]
    unknowns = unknowns[:, 2 * len(held_out.levels) :]
    directions, errors, _ = np.linalg.svd(np.column_stack([of_moments, unknowns]) @ root, full_matrices=False)
    return directions, 1.0 / np.sqrt(1.0 + errors**2) - 1.0


@dataclass(frozen=True)
class Tried:
    """A candidate with the model that it makes (`fit`), and what it did to the held-out part: `agreement` in both
    channels, `ratio` of the moments' mean squares.

    `before` is the regression without the effect, `after` with its columns: an effect with a tolerance is fixed at zero
    before, though every other fit has it within its tolerance.
    """

    candidate: Candidate
    fit: Fit
    agreement: Agreement
    ratio: float
    ratio_error: float
    before: Fit
    after: Fit
    certain: bool
    """Whether the fitted part leaves no doubt of it."""
    has_tolerance: bool
    """Whether every fit has it within its tolerance."""
    gain: float | None = None
    """Of the log evidence beside all processes or, up to none, in the place of its family's; None if not known."""
    may_be_named: bool = True
    """Whether the evidence clearly wants it, or no other family of processes explains most of the residual."""

    @property
    def accepted(self) -> bool:
        """Whether the held-out part agrees, and processes do not explain the record far better, or better at all.

        What the evidence does not want beside them is refused where another family explains most of the residual.
        """
        if not self.agrees or self.gain is None:
            return self.agrees
        least = 0.0 if self.has_tolerance else -SPECIFIC
        return self.gain > least and (self.may_be_named or self.candidate.kind == "discovered")

    @property
    def agrees(self) -> bool:
        """Whether the held-out part agrees.

        The moments' error has to fall, by how much matters little where the fitted part leaves no doubt. An error of
        the record may show in the specific force alone: it must not make the moments significantly worse. What every
        fit has within its tolerance has nothing to predict that others within theirs could not: that it must be larger
        is judged by the fitted part alone. Worse by less than noise scatters such an error is not worse: the record is
        read anew with the effect taken out, which the stretches' own scatter does not know of.
        """
        no_worse = self.ratio < 1.0 + max(HELD_OUT_WORSE * self.ratio_error, self.before.held_out.scatter)
        if self.has_tolerance:
            return no_worse
        falls = self.ratio < 1.0 or (self.candidate.effect is not None and no_worse)
        if self.certain:
            return falls and self.agreement.fall > 0.0 and self.agreement.shown >= HELD_OUT_SIGMAS
        return falls and self.agreement.fall >= HELD_OUT_SIGMAS

    @property
    def is_established(self) -> bool:
        """Whether it has a name that the evidence clearly wants beside all processes."""
        return self.candidate.kind != "discovered" and (self.gain or 0.0) >= SPECIFIC

    def status(self, named_in: float, choices: int, elsewhere: float | None) -> Status:
        """A finding or a hint, one of so many choices; `elsewhere`: the ratio of errors on flights left out."""
        lowers = self.ratio + FINDING_SIGMAS * self.ratio_error < 1.0 and (elsewhere is None or elsewhere < 1.0)
        wanted = self.gain is None or self.gain - np.log(choices) >= SPECIFIC
        return "finding" if lowers and wanted and named_in >= FINDING_REPEATED else "hint"


# ---- Which is added ----


@dataclass(frozen=True)
class Choice:
    """The candidates, best first, and those that were tried on the held-out part, in order.

    `named_in`: the share of the repetitions that name the last of these, where the held-out part agrees with it.
    """

    ranked: tuple[Candidate, ...]
    tried: tuple[Tried, ...]
    named_in: float | None = None

    @cached_property
    def chances(self) -> dict[str, float]:
        """p-values, adjusted for the number of candidates (Holm, Scand. J. Statist. 6:65, 1979)."""
        known = {each.name: each.p_value for each in self.ranked}
        return dict(zip(known, multipletests([*known.values()], method="holm")[1].tolist(), strict=True))

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
    def refuted(self) -> tuple[str, ...]:
        """Those with which the held-out part does not agree."""
        return tuple(each.candidate.name for each in self.tried if not each.agrees)

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


def choose(fit: Fit, candidates: Sequence[Candidate]) -> Choice:
    """What is chosen of the candidates beside a fit, and how many repetitions name it."""
    beside = beside_processes(fit, fit.model, fit.data.fitted, fit.problem.given)
    choice = first_accepted(fit, with_evidence(fit, candidates, beside), beside)
    if choice.accepted is None:
        return choice
    chosen = choice.accepted.candidate
    offered = [each for each in choice.ranked if each.name not in choice.unwanted]
    if chosen.follows is not None and not has_schedule(fit.model):
        offered = list(schedules_first(offered))
    if choice.refuted:
        leaders = most_explaining(fit, [each for each in offered if each.name not in choice.refuted], chosen)
    else:
        leaders = likeliest_beside(beside, offered, chosen, fit)
    return replace(choice, named_in=float(np.mean([each is chosen for each in leaders])))


def with_evidence(fit: Fit, candidates: Sequence[Candidate], beside: Beside) -> list[Candidate]:
    """The candidates that lead, as they are likeliest beside all processes, with the evidence that they gain there.

    So are all that change in time: on a coarse grid any of them may look like nothing.
    """
    found = []
    for place, candidate in enumerate(candidates):
        changes = any(m.time_variation != ("constant",) for m in candidate.fit.mechanisms)
        leads = place < LOOP_WITH_EVIDENCE and candidate.gain > 0.0
        if changes or leads or candidate.kind == "discovered":
            gain, columns = beside.likeliest(candidate.fit)
            if set(columns) != set(candidate.fit.selected):
                candidate = _with_other(columns, candidate, fit)
            candidate = replace(candidate, evidence=gain)
        found.append(candidate)
    return found


def _with_other(columns: tuple[Regressor, ...], candidate: Candidate, fit: Fit) -> Candidate:
    """A candidate with these columns."""
    own, problem, every = candidate.fit, fit.problem, (*fit.problem.baseline, *columns)
    found = solved(Reduced(problem, own.frame), own.name, own.mechanisms, every, own.searched)
    found = replace(found, nonlinear=nonlinear_parameters(columns, own.frame, problem.knots))
    return candidate_of(problem, fit.null, found, candidate.kind, candidate.variant, candidate.file)


def first_accepted(fit: Fit, candidates: Sequence[Candidate], beside: Beside) -> Choice:
    """Try the candidates that count on the held-out part, the best first, until one is accepted.

    Those that predict what a refused one did are passed over: they cannot do better; nor can those that explain far
    less. Where the residual is white, what is not beyond doubt does not count: but an effect may still exceed the
    tolerance that every fit allows it.
    """
    significance, problem = fit.data.source.config.significance, fit.problem
    order = ranked(candidates, {column.mechanism for column in problem.baseline}, has_schedule(fit.model))
    choice, tried, waiting = Choice(order, ()), list[Tried](), list(order)
    while waiting and len(tried) < LOOP_TRIES:
        candidate = waiting.pop(0)
        if candidate.gain <= 0.0 or candidate.fall < LOOP_DETECTED or choice.chances[candidate.name] > significance:
            continue
        certain = choice.chances[candidate.name] <= LOOP_BEYOND_DOUBT * significance
        if fit.residual.white and not certain and not has_tolerance(problem, candidate.name):
            continue
        if any(nearly_equal(candidate, other.candidate) for other in tried if not other.agrees):
            continue
        if tried and candidate.gain < LOOP_IN_ITS_PLACE * tried[0].candidate.gain:
            continue
        tried.append(_try(fit, candidate, certain, beside))
        if tried[-1].accepted:
            break
        if not tried[-1].agrees:
            waiting.sort(key=lambda each: (each.kind == "discovered", -each.gain))
    return replace(choice, tried=tuple(tried))


def _try(fit: Fit, candidate: Candidate, certain: bool, beside: Beside) -> Tried:
    """A candidate added to the model; weighed beside processes where the held-out part agrees with it."""
    added, before, after = with_candidate(fit, candidate), fit, with_columns(fit, candidate)
    if tolerance := has_tolerance(fit.problem, candidate.name):  # without it: fixed at zero
        others = [item.present if item.name == candidate.name else np.nan for item in fit.nuisances]
        before = replace(fit, others=np.array(others))
    agrees = agreement(fit.problem, fit.data.held_out, before.rest, after.rest)
    new, old = added.held_out, before.held_out
    ratio, error = new.mean_square / old.mean_square, jackknife_error(new.left_out / old.left_out)
    tried = Tried(candidate, added, agrees, ratio, error, before, after, certain, tolerance)
    if not tried.agrees:
        return tried
    there, own = beside_processes(added, fit.model, added.data.fitted), added.model.added[-1]
    gain = there.gain(own)
    gain = gain if gain >= 0.0 else max(gain, min(there.gain(own, in_place=True), 0.0))
    named = gain >= SPECIFIC or beside.majority in (None, there.families[own])
    return replace(tried, gain=gain, may_be_named=named)


# ---- Repetitions ----


def likeliest_beside(beside: Beside, offered: Sequence[Candidate], own: Candidate, fit: Fit) -> Iterator[Candidate]:
    """Of each repetition what gains most beside all processes, a generic description far more than its rivals."""
    rivals = [own, *[each for each in offered if each is not own and each.evidence is not None][:LOOP_RIVALS]]
    for problem in _repetitions(beside.rows.problem, fit):
        again = replace(beside, rows=rows_of(problem, beside.point))
        gains = {each.name: again.gain_of(each.fit) for each in rivals}
        for each in rivals[1:]:
            gains[each.name] -= SPECIFIC if each.kind == "discovered" else 0.0
        yield min(rivals, key=best_first(rivals, gains))


def most_explaining(fit: Fit, offered: Sequence[Candidate], own: Candidate) -> Iterator[Candidate]:
    """Of each repetition what explains more than every other name, processes apart."""
    named = sorted((each for each in offered if each.kind != "discovered"), key=lambda each: -each.gain)
    rivals = [each for each in offered if each is own or each in named[: LOOP_RIVALS + 1]]
    for problem in _repetitions(fit.problem, fit):
        criteria = [solved_again(problem, each.fit).information for each in rivals]
        yield rivals[int(np.argmin(criteria))]


def _repetitions(problem: Problem, fit: Fit) -> Iterator[Problem]:
    """The problem with other blocks, other knots, and another inertia and dynamic pressure."""
    data, config = fit.data, fit.data.source.config
    for share in LOOP_REPEATED_BLOCKS:
        fitted, _ = split(data.frame, data.whole.valid, round(share * config.blocks))
        yield problem.on(fitted)
    start, stop = float(data.frame.time.min()), float(data.frame.time.max())
    for more in LOOP_REPEATED_KNOTS:
        yield replace(problem, knots=default_knots(start, stop, max(config.knot_count + more, 1)))
    nuisances = problem.rows.nuisances
    for effect in REPEATED_ERRORS:
        for side in (-1.0, 1.0):
            items = tuple(
                replace(item, present=item.present + side) if item.name == effect else item for item in nuisances.items
            )
            if items != nuisances.items:
                yield replace(problem, rows=replace(problem.rows, nuisances=replace(nuisances, items=items)))
