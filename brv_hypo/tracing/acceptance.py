"""Which effect joins a model: a candidate as it is fitted, the blocks held out, all processes, repetitions.

`Tried.accepted` is the one test by which a candidate joins the model. `choose` tries the candidates of a step, best
first, and says how many repetitions name the one that is accepted.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy import stats
from statsmodels.stats.multitest import multipletests

from brv_hypo.arrays import FloatArray
from brv_hypo.comparison.intervals import Excess, out_of_bounds, within_bounds
from brv_hypo.inference.fit import HypothesisFit, fit_hypothesis, likeliest, solved, with_errors
from brv_hypo.inference.held_out import jackknife_error
from brv_hypo.inference.noise import estimated_noise
from brv_hypo.inference.problem import Problem
from brv_hypo.inference.reduced import Reduced
from brv_hypo.inference.refinement import nonlinear_parameters
from brv_hypo.inference.rows import Rows, rows_of
from brv_hypo.linearisation.channels import HELD_OUT_SHORTEST, split
from brv_hypo.mechanisms.contract import RecordEffect
from brv_hypo.mechanisms.yaml_mechanism import MechanismFile
from brv_hypo.model.model import Applied, Model
from brv_hypo.model.term import Regressor, default_knots
from brv_hypo.thresholds import SPECIFIC
from brv_hypo.tracing.baseline import has_schedule, scheduled
from brv_hypo.tracing.description import Described, described_in_part, file_of
from brv_hypo.tracing.families import Beside, beside_processes
from brv_hypo.tracing.fit import Fit, converged_from, correct, fitted_about, has_tolerance
from brv_hypo.tracing.result import Kind

# Revised on seeds 171100 to 174044 of `tests.studies.independent.loop_study`, and held by its fresh ones; that a
# schedule comes first, by the measured entry (`tests.studies.loop.variants`).
CONFOUNDED_GAIN = 0.8  # of the leader's gain, that such a one has to have
LOOP_DETECTED = 25.0  # fall of the sum of squares at which an effect is detected: F of one coefficient
HELD_OUT_SIGMAS = 1.645  # standard errors by which the held-out error has to fall: 5 %, one-sided
HELD_OUT_WORSE = 1.9  # by which that of the moments may grow where it need not fall: Student's of eight stretches
HELD_OUT_CLUSTER = 8  # rows that are summed before their squares are, so that short correlations count
LOOP_BEYOND_DOUBT = 1e-3  # of the significance, where the residual passes for white, which overlooks single effects
LOOP_TRIES = 3  # effects that may be tried on the held-out part in one step
LOOP_IN_ITS_PLACE = 0.5  # of a refused one's gain in the fitted part: what explains far less does not replace it
LOOP_SCHEDULE = 0.5  # of what the best explains, from which a schedule comes first: jumps describe any smooth change
LOOP_REPEATED_BLOCKS = (0.5, 0.75, 1.25, 1.5)  # of the configured number; pressure and inertia unknown within tolerance
LOOP_REPEATED_KNOTS = (-2, 2)  # added to it: a third of the usual seven, so that regions fall elsewhere
LOOP_RIVALS = 5  # that are fitted again: the best few of those that save anything
IMPOSSIBLE_SIGMAS = 3.0  # standard errors by which a value may lie outside what is possible; convention
FINDING_REPEATED = 0.75  # share of the repetitions that name it: three in four
HINT_REPEATED = 0.5  # below which another effect explains the record as well: no name then


# ---- One effect as fitted ----


@dataclass(frozen=True)
class Candidate:
    """One effect as fitted, beside the fit without it (`null`). `applied` are the components of a record effect that
    its columns are. `evidence` is the log evidence that it gains beside all processes, nats, once that is known.
    """

    kind: Kind
    null: HypothesisFit
    fit: HypothesisFit
    applied: tuple[Applied, ...] = ()
    evidence: float = -math.inf

    @property
    def name(self) -> str:
        """That of the effect."""
        return self.fit.name

    @property
    def effect(self) -> RecordEffect | None:
        """The record effect with its settings; None for moments."""
        return self.applied[0].effect if self.applied else None

    @property
    def file(self) -> MechanismFile | None:
        """A description in generic terms as a file; None for what has a name."""
        found, first = [m for m in self.fit.mechanisms if isinstance(m, Described)], self.fit.baseline_size
        return file_of([(found[0], self.fit.selected, self.fit.values[first:])]) if found else None

    @property
    def follows(self) -> str | None:
        """The quantity by which its terms are a schedule of the flight's; None where they are none."""
        return next((m.follows for m in self.fit.mechanisms if m.follows is not None), None)

    @cached_property
    def gain(self) -> float:
        """Fall of the extended BIC."""
        return self.null.information - self.fit.information

    @cached_property
    def fall(self) -> float:
        """Fall of the weighed squares in effective samples."""
        fit = self.fit
        return max(self.null.rss - fit.rss, 0.0) / (fit.rss / (fit.samples - fit.parameters)) * fit.efficiency

    @property
    def f_ratio(self) -> float:
        """Of all that it adds."""
        return self.fall / (self.fit.parameters - self.null.parameters) / self.fit.efficiency

    @cached_property
    def p_value(self) -> float:
        """Chance of that, paid for all that was searched for it."""
        fit, extra = self.fit, self.fit.parameters - self.null.parameters
        chance = float(stats.f.sf(self.fall / extra, extra, max(fit.effective - fit.parameters, 1.0)))
        chosen = len({column.choice for column in fit.selected})
        return min(chance * math.comb(fit.searched, min(chosen, fit.searched)), 1.0)


def impossible_value(fit: HypothesisFit) -> Excess | None:
    """A value of one flight's fit that is significantly beyond what its mechanism allows; None where there is none."""
    excess = out_of_bounds(fit)
    return excess if excess is not None and excess.sigmas > IMPOSSIBLE_SIGMAS else None


def bounded(problem: Problem, fit: HypothesisFit) -> HypothesisFit:
    """The fit with what it would lose by values that a body may have; of several flights, which differ, as it is."""
    if len(problem.records) > 1 or not any(mechanism.bounds for mechanism in fit.mechanisms):
        return fit
    return within_bounds(with_errors(problem, replace(fit, bound_cost=0.0)))


def solved_again(problem: Problem, fit: HypothesisFit, selected: Sequence[Regressor] | None = None) -> HypothesisFit:
    """A fit, or one with other columns, on the problem's rows, under its noise."""
    selected = fit.selected if selected is None else selected
    every = (*problem.baseline, *selected)
    found = solved(Reduced(problem, fit.frame), fit.name, fit.mechanisms, every, fit.searched)
    return replace(found, nonlinear=nonlinear_parameters(tuple(selected), fit.frame, problem.knots))


# ---- Which are alike, which leads ----


def confounded(leader: Candidate, others: Sequence[Candidate]) -> tuple[str, ...]:
    """Those confounded with the leader on this flight: nearly as good a fit, and as likely beside processes."""
    good = (o for o in others if o.name != leader.name and o.gain > max(CONFOUNDED_GAIN * leader.gain, 0.0))
    return tuple(o.name for o in good if abs(leader.evidence - o.evidence) < SPECIFIC)


def best_first(
    offered: Sequence[Candidate], evidences: Mapping[str, float], chosen: Candidate | None = None
) -> Callable[[Candidate], tuple[float, float]]:
    """The order of candidates, the leader least: of those whose evidences beside processes differ by less than
    `SPECIFIC`, what explains most. A description in generic terms has to beat a name by that, unless it was `chosen`.
    """
    equal = max(evidences.values(), default=0.0) - SPECIFIC  # of what saves nothing there is no evidence
    named = [each for each in offered if each.kind != "discovered" or each is chosen]
    leads = {each.name for each in named if evidences[each.name] > equal}
    return lambda each: (-np.inf if each.name in leads else -evidences[each.name], -each.gain)


def schedules_first(ranked: Sequence[Candidate]) -> tuple[Candidate, ...]:
    """The schedules that explain not much less than the best candidate, in their order."""
    most = max((candidate.gain for candidate in ranked), default=0.0)
    return tuple(c for c in ranked if c.follows is not None and c.gain >= LOOP_SCHEDULE * most)


# ---- With it: the model, and the blocks held out ----


def with_candidate(fit: Fit, candidate: Candidate) -> Fit:
    """The model with a candidate added, fitted to the fitted part of the flights about the same point; beside a first
    schedule by Mach number, which the model then has smooth, with errors of the record found anew.
    """
    found = candidate.fit
    if candidate.effect is None:
        known = {mechanism.name: mechanism for mechanism in found.mechanisms}
        model = fit.model + Model(mechanisms=known, columns=found.selected, added=(candidate.name,))
        data = replace(fit.data, frame=found.frame)
        if candidate.follows == "mach" and not has_schedule(fit.model):
            return converged_from(fitted_about(data, scheduled(model, data)))
        problem = replace(fit.problem, frame=found.frame, baseline=model.columns)
        return replace(fit, model=model, data=data, problem=problem)
    model = fit.model + Model(applied=candidate.applied, added=(candidate.name,))
    freed = {(each.flight, each.effect.name, each.component) for each in candidate.applied}
    corrections = [
        {name: value for name, value in known.items() if (number, *name) not in freed}
        for number, known in enumerate(fit.data.corrections)
    ]
    data = correct(fit.data.source, model, corrections).with_in_plane_moment(model.columns, fit.values)
    return fitted_about(data, model, fit.values, fit.problem.rows.noise)


@dataclass(frozen=True)
class Tried:
    """A candidate with the model that it makes (`fit`) and the one `before`. What `has_tolerance` is fixed at zero
    before, though every other fit has it within that. `gain`, where `agrees`: of the log evidence beside all processes
    or, up to none, in the place of its family's. Beside a `white` residual the evidence has to want it clearly.
    `may_be_named`: so it does, or no other family explains most of the residual.
    """

    candidate: Candidate
    before: Fit
    fit: Fit
    has_tolerance: bool
    gain: float = 0.0
    white: bool = False
    may_be_named: bool = True

    @cached_property
    def ratios(self) -> dict[str, tuple[float, float]]:
        """Of the moments' mean squared errors with it and before, with standard errors over stretches: on the blocks
        that are for "deciding", on those "reported", and on "both": few stretches say little of the ratio's error.
        """
        data, found = self.before.data, {}
        both = (data.deciding, data.reported)
        for name, parts in (("deciding", both[:1]), ("reported", both[1:]), ("both", both)):
            after, before = (each.mean_square_of(parts) for each in (self.fit, self.before))
            without = self.fit.without_stretches(parts) / self.before.without_stretches(parts)
            found[name] = after / before, jackknife_error(without)
        return found

    @cached_property
    def score(self) -> float:
        """Fall of the squared error of moments and force on the blocks that decide, each over its noise, in its errors,
        which are summed over clusters of neighbours (White, Econometrica 48:817, 1980).
        """
        part, sigma = self.before.data.deciding, self.before.problem.rows.noise.force.sigma
        use = part.rows[self.before.left.usable[part.rows] & self.fit.left.usable[part.rows]]

        def error(fit: Fit) -> FloatArray:
            moments, force = fit.left.body[use] / fit.left.noise[use], fit.rest.force[part.rows][part.valid] / sigma
            return np.concatenate([moments.real, moments.imag, force.real, force.imag])

        first, second = error(self.before), error(self.fit)
        products = (first - second) * second
        clusters = np.add.reduceat(products, np.arange(0, products.size, HELD_OUT_CLUSTER))
        spread = max(float(np.sqrt(np.sum(clusters**2))), 1e-300)
        return float(first @ first - second @ second) / (2.0 * spread)

    @property
    def accepted(self) -> bool:
        """Whether the held-out part agrees, and processes do not explain the record far better, or better at all."""
        wanted = self.gain > (SPECIFIC if self.white else 0.0 if self.has_tolerance else -SPECIFIC)
        return self.agrees and wanted and (self.may_be_named or self.candidate.kind == "discovered")

    @property
    def agrees(self) -> bool:
        """Whether the blocks that decide agree. The error of moments and force has to fall significantly, and that of
        the moments alone, but for an error of the record: it may show in the specific force, and must not make the
        moments significantly worse then. What every fit has within its tolerance has nothing to predict that others
        within theirs could not: that it must be larger is judged by the fitted part alone. Worse by less than noise
        scatters such an error is not worse: the record is read anew with the effect taken out, which the stretches' own
        scatter does not know of.
        """
        ratio, error = self.ratios["deciding"]
        no_worse = ratio < 1.0 + max(HELD_OUT_WORSE * error, self._scatter)
        if self.has_tolerance:
            return no_worse
        falls = ratio < 1.0 or (self.candidate.effect is not None and no_worse)
        return falls and self.score >= HELD_OUT_SIGMAS

    @cached_property
    def _scatter(self) -> float:
        """Relative standard deviation of white noise's mean square on the blocks that decide, two axes a sample."""
        return float(np.sum(self.before.left.usable[self.before.data.deciding.rows]) ** -0.5)

    @cached_property
    def elsewhere(self) -> float | None:
        """The ratio on flights that are predicted from the others each; None for one, or where nothing is shared."""
        flights, columns = range(len(self.fit.data.records)), self.candidate.fit.selected
        if len(flights) == 1 or self.candidate.effect is not None or all(c.flight is not None for c in columns):
            return None
        before, after = (sum(error_elsewhere(fit, k) for k in flights) for fit in (self.before, self.fit))
        return after / before

    @cached_property
    def impossible(self) -> Excess | None:
        """A value that is impossible; None where none is, and of several flights, whose values differ."""
        return impossible_value(self.candidate.fit) if len(self.fit.data.records) == 1 else None

    def doubts(self, named_in: float, choices: int) -> tuple[str, ...]:
        """Why it is no finding, one of so many choices; empty for a finding."""
        (ratio, error), found = self.ratios["both"], []
        lowers = ratio + HELD_OUT_SIGMAS * error < 1.0 and self.ratios["reported"][0] < 1.0
        if not lowers:
            found.append("the held-out error of the moments does not fall significantly")
        if (self.elsewhere or 0.0) >= 1.0:
            found.append("flights that are predicted from the others are predicted worse")
        if self.gain - np.log(choices) < SPECIFIC:
            found.append(
                f"processes may explain the flight instead: beside them it gains {self.gain:.1f} in ln evidence, and "
                f"one of {choices} effects that were tried needs {SPECIFIC + np.log(choices):.1f}"
            )
        if self.impossible is not None:
            found.append(f"its value is impossible: {self.impossible.words}")
        if named_in < FINDING_REPEATED:
            found.append(f"fewer than {100.0 * FINDING_REPEATED:.0f} % of the repetitions name it")
        return tuple(found)


def error_elsewhere(fit: Fit, number: int) -> float:
    """Mean square of the moment errors on one flight with the others' shared coefficients, its own fitted to it."""
    data, inside = fit.data, fit.data.frame.flight_of_row == number
    numbers = [*(column.flight for column in fit.model.columns), *(item.flight for item in fit.nuisances)]
    flights = np.array([-1 if each is None else each for each in numbers])
    own, shared, part = flights == number, flights == -1, data.part_where(inside)
    others = replace(fit, problem=fit.problem.on(data.part_where(~inside)), known=np.where(own, 0.0, np.nan))
    known = np.where(shared, np.concatenate(others.solution), np.where(own, np.nan, 0.0))
    return replace(fit, problem=fit.problem.on(part), known=known).left.mean_square(part.rows)


# ---- Which is added ----


@dataclass(frozen=True)
class Choice:
    """The candidates beside a fit, best first, those that were tried on the held-out part, in order, and the share of
    the repetitions that name the last of these (`named_in`), where the held-out part agrees with it.
    """

    fit: Fit
    ranked: tuple[Candidate, ...]
    tried: tuple[Tried, ...] = ()
    named_in: float | None = None

    @cached_property
    def chances(self) -> dict[str, float]:
        """p-values, adjusted for the number of candidates (Holm, Scand. J. Statist. 6:65, 1979)."""
        known = {each.name: each.p_value for each in self.ranked}
        return dict(zip(known, multipletests([*known.values()], method="holm")[1].tolist(), strict=True))

    @cached_property
    def significant(self) -> list[Candidate]:
        """Those that count; where the residual is white, what is beyond doubt or has a tolerance to exceed."""
        level, white, found = self.fit.data.source.config.significance, self.fit.residual.white, []
        for each in self.ranked:
            doubted = white and not has_tolerance(self.fit.problem, each.name)
            sure = self.chances[each.name] <= level * (LOOP_BEYOND_DOUBT if doubted else 1.0)
            found += [each] if sure and each.gain > 0.0 and each.fall >= LOOP_DETECTED else []
        return found

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
        """The candidates with the leading one first and those confounded with it after it."""
        first = [] if self.leading is None else [self.leading.candidate]
        like = [name for each in first for name in (each.name, *confounded(each, self.ranked))]
        return tuple(sorted(self.ranked, key=lambda each: like.index(each.name) if each.name in like else len(like)))


def choose(fit: Fit, candidates: Sequence[Candidate]) -> Choice:
    """What is chosen of the candidates beside a fit, and how many repetitions name it."""
    beside = beside_processes(fit, fit.model, fit.data.fitted, fit.problem.given)
    choice = first_accepted(fit, with_evidence(fit, candidates, beside), beside)
    if choice.accepted is None:
        return choice
    chosen, refused = choice.accepted.candidate, {each.candidate.name for each in choice.tried[:-1]}
    offered = [each for each in choice.significant if each.name not in refused]
    if chosen.follows is not None and not has_schedule(fit.model):
        offered = list(schedules_first(offered))
    return replace(choice, named_in=float(np.mean([*named_again(beside, offered, chosen, fit)])))


def with_evidence(fit: Fit, candidates: Sequence[Candidate], beside: Beside) -> list[Candidate]:
    """The candidates as they are likeliest beside all processes, those that save anything with the evidence that they
    gain there; a description in generic terms throughout the record or in a part of it.
    """
    found = []
    for candidate in candidates:
        if candidate.kind == "discovered" and len(fit.problem.records) == 1:
            part = described_in_part(beside, candidate.fit)
            offered = [candidate.fit, *([] if part is None else [solved_again(fit.problem, part)])]
            candidate = replace(candidate, fit=likeliest(offered))
        if candidate.gain > 0.0:
            own, (gain, columns) = candidate.fit, beside.likeliest(candidate.fit)
            if set(columns) != set(own.selected):
                own = bounded(fit.problem, solved_again(fit.problem, own, columns))
            candidate = replace(candidate, fit=own, evidence=gain)
        found.append(candidate)
    return found


def first_accepted(fit: Fit, candidates: Sequence[Candidate], beside: Beside) -> Choice:
    """Candidates on the held-out part, best first, till one is accepted; a first schedule before all others."""
    ranked = sorted(candidates, key=best_first(candidates, {each.name: each.evidence for each in candidates}))
    first, tried = () if has_schedule(fit.model) else schedules_first(ranked), list[Tried]()
    choice = Choice(fit, (*first, *(candidate for candidate in ranked if candidate not in first)))
    for candidate in choice.significant:
        if tried and candidate.gain < LOOP_IN_ITS_PLACE * tried[0].candidate.gain:
            continue
        tried.append(_try(fit, candidate, beside))
        if tried[-1].accepted or len(tried) == LOOP_TRIES:
            break
    return replace(choice, tried=tuple(tried))


def _try(fit: Fit, candidate: Candidate, beside: Beside) -> Tried:
    """A candidate added to the model; weighed beside processes where the held-out part agrees with it."""
    added, before = with_candidate(fit, candidate), fit
    if tolerance := has_tolerance(fit.problem, candidate.name):  # without it: fixed at zero
        known = [item.present if item.name == candidate.name else np.nan for item in fit.nuisances]
        before = replace(fit, known=np.array([*np.full(len(fit.model.columns), np.nan), *known]))
    tried = Tried(candidate, before, added, tolerance, white=fit.residual.white)
    if not tried.agrees:
        return tried
    there, own = beside_processes(added, fit.model, added.data.fitted), added.model.added[-1]
    gain = there.gain(own)
    gain = gain if gain >= 0.0 else max(gain, min(there.gain(own, in_place=True), 0.0))
    named = gain >= SPECIFIC or beside.majority in (None, there.families[own])
    return replace(tried, gain=gain, may_be_named=named)


# ---- Repetitions ----


def named_again(beside: Beside, offered: Sequence[Candidate], own: Candidate, fit: Fit) -> Iterator[bool]:
    """Of each repetition whether a candidate gains most beside all processes, and they do not explain it far better."""
    rivals = [own, *[each for each in offered if each is not own][:LOOP_RIVALS]]
    repetitions = [({each.name: each.fit for each in rivals}, rows) for rows in _with_other_blocks(beside, fit)]
    for fits, rows in (*repetitions, *((known, beside.rows) for known in _with_other_knots(fit, rivals))):
        again = replace(beside, rows=rows)
        gains = {each.name: again.gain_of(fits[each.name]) for each in rivals}
        yield min(rivals, key=best_first(rivals, gains, own)) is own and gains[own.name] > -SPECIFIC


def _with_other_knots(fit: Fit, rivals: Sequence[Candidate]) -> Iterator[dict[str, HypothesisFit]]:
    """The fits of rivals by name, mechanisms searched anew on other grids of knots; of one flight, where they are."""
    timed = [r for r in rivals if r.kind == "mechanism" and r.fit.mechanisms[0].time_variation != ("constant",)]
    if not timed or len(rivals) == 1 or len(fit.problem.records) > 1:
        return
    problem, time = fit.problem.under(estimated_noise(fit.problem)), fit.problem.frame.coefficient_time
    for more in LOOP_REPEATED_KNOTS:
        knots = default_knots(float(time.min()), float(time.max()), max(fit.problem.knots.size + more, 1))
        other, known = replace(problem, knots=knots), {each.name: each.fit for each in rivals}
        for each in timed:
            own = fit_hypothesis(other, each.name, each.fit.mechanisms)
            known[each.name] = own if own.selected else each.fit
        yield known


def _with_other_blocks(beside: Beside, fit: Fit) -> Iterator[Rows]:
    """The rows of what is fitted where other blocks are held out, of which each flight has enough samples."""
    problem, data = beside.rows.problem, fit.data
    most = int(np.bincount(data.frame.flight_of_row).min()) // (HELD_OUT_SHORTEST + 1)
    numbers = (round(share * data.source.config.blocks) for share in LOOP_REPEATED_BLOCKS)
    for blocks in dict.fromkeys(min(number, most) for number in numbers):
        yield rows_of(problem.on(split(data.frame, data.whole.valid, blocks)[0]), beside.point)
