"""Every hypothesis beside processes: fits with the errors of one evidence, and what the leader explains.

The search knows no processes. About its leader the record is linearised once more with all of them, and every
hypothesis, and what may be there instead, gets its evidence there (`inference`). Entrances: `searched`, `outside`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from operator import attrgetter

import numpy as np

from brv_hypo.arrays import BoolArray, FloatArray
from brv_hypo.comparison import with_processes
from brv_hypo.comparison.config import CompareConfig
from brv_hypo.comparison.intervals import channel_of, within_bounds
from brv_hypo.comparison.limits import regions
from brv_hypo.comparison.preparation import Reading, aligned, linearised_about, shared_problem
from brv_hypo.comparison.result import AT_ITS_ENDS, LEAST_PROCESS, Explained, ProcessEstimate
from brv_hypo.comparison.with_processes import Pair, acting, fitted, likelier, moved, price, squares_of_regions
from brv_hypo.inference.build import LinearisationPoint, point_of, within_reach
from brv_hypo.inference.derivatives import as_planted, beside_its_processes, moment_of_process, scale_variance
from brv_hypo.inference.evidence import Evidence, maximised, rows_under_own_noise
from brv_hypo.inference.fit import HypothesisFit, all_renewed, fit_hypothesis, likeliest, self_consistent
from brv_hypo.inference.held_out import jackknife_error
from brv_hypo.inference.problem import Problem
from brv_hypo.inference.refinement import shift_sigma
from brv_hypo.inference.rows import Rows
from brv_hypo.inference.unmodelled import PLAIN, RATE, plain_columns, plain_instead, turning_moment, unmodelled_moments
from brv_hypo.io.text import hypothesis
from brv_hypo.linearisation.frame import RateFrame
from brv_hypo.mechanisms.contract import Mechanism, MomentProcess
from brv_hypo.mechanisms.registry import processes_by_name, record_processes
from brv_hypo.model.baseline import StaticBend, StaticMoment
from brv_hypo.model.common_time import CommonTime, at
from brv_hypo.motion.reconstruction import Reconstruction
from brv_hypo.thresholds import FAR_PROCESS, MECHANISM_ACTS, MOST_REGIONS, NOISE_LEVEL, NORMAL_95, SPECIFIC

# Worked out on the seeds of `tests.studies.independent.study` that validation.md lists, and held by its fresh ones.
NOT_WORKED_ON = 30.0  # nats behind the best as they count, from which no other forms of a hypothesis are tried
LINEARISATIONS = 4  # about one hypothesis after the first, at most
LIKELIER = 3.0  # nats by which each of these has to be likelier
_SHAPES_TRIED = 3  # outside the list, beside each evidence: gains at its amplitudes alone may mislead
_LEAST_SHARE = 1e-6  # of squares that terms make: keeps errors finite where they make nothing

Say = Callable[[str], None]
Hypotheses = Mapping[str, tuple[Mechanism, ...]]


@dataclass(frozen=True)
class Judged:
    """Fits whose criterion, coefficients and errors are those of the evidence, and the evidence of each."""

    problem: Problem  # linear about the leader, without processes
    rows: Rows  # linear about the same point, with processes
    fits: tuple[HypothesisFit, ...]
    evidences: tuple[Evidence, ...]
    weight: float
    """What a nat counts: the share of the likeliest mechanism in the squares that it and processes make of the record,
    times that of its rows that are independent. A likelihood that knows noise as white and processes as smooth alone is
    sharper than these are, and may describe them by a mechanism (Gruenwald and van Ommen, Bayesian Analysis 12, 2017;
    Miller and Dunson, J. Am. Stat. Assoc. 114, 2019).
    """
    elsewhere: Explained | None = None  # what the same leader explains about another motion, which is less likely

    @cached_property
    def leader(self) -> int:
        """The place of the most probable hypothesis."""
        best = likeliest(self.fits)
        return next(k for k, fit in enumerate(self.fits) if fit is best)

    @cached_property
    def pairs(self) -> tuple[Pair, ...]:
        """Every hypothesis."""
        return tuple(map(Pair, self.fits, self.evidences))

    @property
    def leading(self) -> Pair:
        """The most probable hypothesis."""
        return self.pairs[self.leader]

    def weight_of(self, pair: Pair) -> float:
        """What a nat of a hypothesis counts: as those of the leader, or by its own share where no mechanism leads."""
        return self.weight * (1.0 if self.leading.fit.selected else share_of(pair))

    def likelier_than(self, other: Judged) -> float:
        """By how many nats the leader is; where another motion keeps other rows, by those of a row."""
        return (self._per_row - other._per_row) * min(self.rows.size, other.rows.size)

    @property
    def _per_row(self) -> float:
        """Log evidence of the leader, but for a constant of the record: rows of either channel are over their noise."""
        noise, size = self.rows.problem.rows.noise, self.rows.size
        return self.leading.possible_level / size - 0.5 * math.log(noise.rates.sigma * noise.force.sigma)

    @property
    def misfit(self) -> float:
        """What the leader and processes leave of the record, rms over the stated noise's."""
        return self.leading.evidence.noise * self.rows.noise_ratio

    @property
    def regions(self) -> int:
        """Regions of the leader with more than a trifle of the squares of the moment that its terms make."""
        return int(np.sum(squares_of_regions(self.leading) > MOST_REGIONS[1])) if self.leading.fit.selected else 0

    @property
    def of_static(self) -> float:
        """What a leader in the plane of alpha adds to the static moment while it acts; NaN unless most is along it."""
        fit, static = self.leading.fit, (StaticMoment.name, StaticBend.name)
        frame = self.rows.frame_of(fit)
        moments = frame.moments(fit.columns) * fit.values
        made = moments[:, fit.baseline_size :].sum(axis=1)
        acts, known = made != 0.0, [k for k, column in enumerate(fit.columns) if column.mechanism in static]
        made, base = made[acts], moments[np.ix_(acts, known)].sum(axis=1)
        along, square = float(np.vdot(base, made).real), float(np.sum(np.abs(base) ** 2))
        most = along**2 > 0.5 * square * float(np.sum(np.abs(made) ** 2))
        return along / square if most and {channel_of(c, frame) for c in fit.selected} == {"in-plane"} else math.nan

    @cached_property
    def squares(self) -> float:
        """The sum of squares of the baseline's residual without processes."""
        return float(np.sum(self.baseline_residual**2))

    @cached_property
    def baseline_residual(self) -> FloatArray:
        """What the baseline without processes does not explain (rows,)."""
        return self.rows.beside_baseline(self.rows.y)

    @cached_property
    def null(self) -> int:
        """The place of the baseline only."""
        return next(k for k, fit in enumerate(self.fits) if not fit.mechanisms)

    @property
    def baseline(self) -> Evidence:
        """The evidence of the baseline only."""
        return self.evidences[self.null]


@dataclass(frozen=True)
class Searched:
    """Hypotheses searched about the baseline's fit, `fits` in `problem`, and the likeliest, `point`."""

    problem: Problem
    reading: Reading
    config: CompareConfig
    fits: Sequence[HypothesisFit]
    point: HypothesisFit
    say: Say

    def judged(self) -> Judged:
        """Every hypothesis linear about the leader of the search, beside processes."""
        return self._linearised(self.point, self.fits)

    def about_another(self, known: Judged) -> Judged | None:
        """The same about a mechanism that is likelier about itself than the leader is; None without one: where the
        motion that one makes is far from that of another, what is linear about it says little of the other.
        """
        tried_already = (self.point.name, known.leading.fit.name)
        others = (e for e in self.fits if len(e.mechanisms) == 1 and e.selected and e.name not in tried_already)
        null, tried = [fit for fit in self.fits if not fit.mechanisms], list[tuple[float, HypothesisFit]]()
        for fit in (self_consistent(self.problem, each) for each in others):
            point = point_of(self.problem, fit)
            found = _beside_processes(self._linear(self.problem, fit, point), fit, [*null, fit])
            if found.leading.fit.selected:
                tried.append((found.likelier_than(known), fit))
        best = max(tried, key=lambda each: each[0], default=(-math.inf, None))[1]
        if best is None or self._linearised(best, [*null, best]).likelier_than(known) <= 0.0:
            return None
        found = self._linearised(best, [best if fit.name == best.name else fit for fit in self.fits])
        return found if found.likelier_than(known) > 0.0 else None

    def _linearised(self, point: HypothesisFit, fits: Sequence[HypothesisFit]) -> Judged:
        """Hypotheses linear about one, and about another that leads there: the likelier of both."""
        first = self._about_itself(self.problem, point, fits)
        leader = likeliest(first.fits)
        if leader.name == point.name:
            return first
        second = self._about_itself(first.problem, leader, first.fits, _point_beside(first))
        if second.likelier_than(first) > 0.0:
            return second
        return replace(first, elsewhere=explained(second)) if likeliest(second.fits).name == point.name else first

    def _about_itself(
        self, problem: Problem, fit: HypothesisFit, fits: Sequence[HypothesisFit], at: LinearisationPoint | None = None
    ) -> Judged:
        """Hypotheses linear about one. Where its residual is more than noise, processes are far beyond their ordinary
        size, or it acts in several regions (of which one may be what is not linear of another), it alone is linearised
        about itself beside processes, step by step, while it becomes likelier: the method of Gauss and Newton.
        """
        few = [each for each in fits if not each.mechanisms or each.name == fit.name]
        point = at or point_of(problem, fit)
        here = self._linear(problem, fit, point)
        known, elsewhere = _beside_processes(here, fit, few), None
        near = known.misfit < 1.0 + NOISE_LEVEL[1] and not known.leading.evidence.has_processes_above(FAR_PROCESS)
        enough = at is None and near and len(known.leading.fit.regions) < 2
        for _ in range(0 if enough else LINEARISATIONS):
            leader = known.leading.fit
            if leader.name != fit.name:
                break
            there = self._linear(known.problem, leader, _point_beside(known))
            found = _beside_processes(there, leader, known.fits)
            if found.likelier_than(known) < LIKELIER:
                elsewhere = explained(found) if found.leading.fit.name == fit.name else None
                break
            known, here = found, there
        every = known if len(few) == len(fits) else _beside_processes(here, fit, fits, known)
        return replace(every, elsewhere=elsewhere)

    def _linear(self, problem: Problem, fit: HypothesisFit, at: LinearisationPoint) -> tuple[Problem, Problem]:
        self.say(f"linearising about {hypothesis(fit.name)}")
        return linearised_about(problem, at, self.reading, self.config)


def searched(
    reconstructions: Sequence[Reconstruction], config: CompareConfig, hypotheses: Hypotheses, say: Say
) -> Searched:
    """The hypotheses, of several flights in a time that these share where that fits better."""

    def among(common: CommonTime | None) -> Searched:
        problem, reading = shared_problem(reconstructions, config, common)
        fits: list[HypothesisFit] = []
        for name, mechanisms in hypotheses.items():
            say(f"fitting {hypothesis(name)}")
            rival = min((fit.information for fit in fits), default=math.inf)
            fits.append(fit_hypothesis(problem, name, mechanisms, rival))
        return Searched(problem, reading, config, fits, self_consistent(problem, likeliest(fits)), say)

    first = among(None)
    if first.reading.common is not None and first.point.nonlinear:
        say("aligning the flights")
        common = aligned(reconstructions, config, first.reading.common, first.point)
        found = None if common is None else among(common)
        cost = 2.0 * (len(reconstructions) - 1) * math.log(first.point.effective)  # of two numbers a flight
        before = _under_noise(first.problem, first.point)
        if found is not None and _under_noise(found.problem, found.point) + cost < before:
            return found
    return first


def _point_beside(found: Judged) -> LinearisationPoint:
    """The leader with its processes of the moment, and errors of the record beside all processes."""
    fit, own = found.leading
    problem, drifts = own.rows.problem, {each.name for each in record_processes()}
    frame, columns, values = beside_its_processes(own, fit)
    found_errors = within_reach(problem, problem.others_beside(frame, columns, values))
    errors = tuple({key: value for key, value in each.items() if key[0] not in drifts} for each in found_errors)
    mechanisms = tuple(frame.mechanisms[name] for name in dict.fromkeys(c.mechanism for c in columns))
    return LinearisationPoint(mechanisms, tuple(columns), values, errors)


def _under_noise(problem: Problem, fit: HypothesisFit) -> float:
    """The criterion of a fit with that of the noise under which it was found, as problems have their own."""
    noise = problem.rows.noise
    levels = math.log(noise.rates.sigma**2) + math.log(noise.force.sigma**2)
    return fit.information + problem.efficiency * problem.rows.rates * levels


def _beside_processes(
    linear: tuple[Problem, Problem], about: HypothesisFit, fits: Sequence[HypothesisFit], known: Judged | None = None
) -> Judged:
    """Every hypothesis with its evidence beside processes; `linear`: the problem about a fit with and without these.
    Those `known` there are not tried again.
    """
    (whole, problem), done = linear, {} if known is None else {pair.fit.name: pair for pair in known.pairs}
    rest = {each.name: each for each in all_renewed(problem, [fit for fit in fits if fit.name not in done])}
    if known is None:
        rows, start = rows_under_own_noise(whole, rest[about.name])
        null = maximised(rows, rows.terms(None), start)
    else:
        rows, start, null = known.rows, known.leading.evidence.at, known.baseline
    first = dict(done)
    for name, fit in rest.items():
        first[name] = Pair(fit, null)
        if fit.selected:
            first[name] = with_processes.with_its_evidence(rows, fit, start, null.at, rounds=1)
    pairs = _likeliest_forms(problem, [first[fit.name] for fit in fits], null, rows.frame_of(about), done)
    prices = [len(acting_in(fit)) * MECHANISM_ACTS for fit, _ in pairs]
    # What explains little beside processes leads only where its gain, as that counts, is worth its price.
    worth = [k for k, pair in enumerate(pairs) if weighed(pair, null, share_of(pair)) >= 0.0]
    place = max(worth, key=lambda k: pairs[k].possible_level - prices[k])
    if pairs[place].fit.name not in done:
        pairs[place] = with_processes.scanned(problem, moved(problem, pairs[place], closely=True))
    for k, (fit, _) in enumerate(pairs):  # one of which a part does not act has the fit of the one without that part
        same = [pair for pair in pairs if acting_in(pair.fit) == acting_in(fit)]
        like, own = min(same, key=lambda pair: len(pair.fit.mechanisms))
        pairs[k] = Pair(replace(like, name=fit.name, mechanisms=fit.mechanisms), own)
    scale, independent = scale_variance(whole), problem.efficiency_of(pairs[place].evidence.residual)
    shares = [share_of(pair) for pair in pairs]
    weight = independent * shares[place]
    weights = [weight * (1.0 if pairs[place].fit.selected else share) for share in shares]
    stated = [
        _estimated(pair, weighed(pair, null, each), independent * share, scale)
        for pair, share, each in zip(pairs, shares, weights, strict=True)
    ]
    if np.any(more := with_processes.beyond_linear(problem, pairs[place], weight)):  # of coefficients, knots and delays
        covariance = stated[place].joint_covariance + more
        stated[place] = within_bounds(replace(stated[place], joint_covariance=covariance))
    return Judged(problem, rows, tuple(stated), tuple(own for _, own in pairs), weight)


def _likeliest_forms(
    problem: Problem, pairs: Sequence[Pair], null: Evidence, frame: RateFrame, done: Collection[str]
) -> list[Pair]:
    """Every hypothesis acting when and as it is likeliest, as those `done` are; less is tried of those that are far
    behind the best.
    """
    offered, best = [[each] for each in pairs], max(each.level for each in pairs)
    for place in sorted(range(len(pairs)), key=lambda k: -pairs[k].level):
        if pairs[place].fit.selected and pairs[place].fit.name not in done:
            offered[place] = with_processes.in_one_region(problem, pairs[place], null, frame, best)
            best = max(best, *(each.level for each in offered[place]))
    found, alone = [likelier(some) for some in offered], dict[str, Pair]()
    leading = max(found, key=attrgetter("level"))
    least = leading.level - min(with_processes.OUT_OF_REACH, NOT_WORKED_ON / share_of(leading))
    for place in sorted(range(len(pairs)), key=lambda k: len(pairs[k].fit.mechanisms)):
        some, best_of = offered[place], found[place]
        if len(pairs[place].fit.mechanisms) > 1:
            some = with_processes.together(problem, pairs[place], alone)
            found[place] = best_of = likelier(some)
        elif best_of.fit.selected:
            alone[best_of.fit.name] = best_of
        if best_of.fit.selected and best_of.level > least and best_of.fit.name not in done:
            found[place] = with_processes.plainest(problem, some, null)
    high = max(each.level for each in found) - with_processes.WIDENED
    return [with_processes.widened(problem, e) if e.level > high and e.fit.name not in done else e for e in found]


def share_of(pair: Pair) -> float:
    """Of the squares that a hypothesis's terms and processes make, those of its terms: what a nat counts by that."""
    return max(pair.evidence.share_of_terms, _LEAST_SHARE) if pair.fit.selected else 1.0


def weighed(pair: Pair, null: Evidence, weight: float) -> float:
    """The log evidence over the baseline's as it counts: every mechanism that acts, and its form, has its price."""
    return weight * (pair.level - null.level - price(pair.fit)) - len(acting_in(pair.fit)) * MECHANISM_ACTS


def acting_in(fit: HypothesisFit) -> set[str]:
    """The mechanisms of a hypothesis that act."""
    return {column.mechanism for column in fit.selected}


def _estimated(pair: Pair, level: float, weight: float, scale: float) -> HypothesisFit:
    """The fit as its evidence has it: a nat counts as `weight` in errors, by its own share; `level` is weighed, by the
    leader's. What pressure and inertia are known to (`scale_variance`) cancels in its fractions.
    """
    fit, own = pair
    count, covariance = len(fit.columns), own.covariance / weight
    # With knots and delays where they are: one at its bound would be moved beyond it.
    values = own.values_without(range(len(fit.selected), len(fit.selected) + len(fit.nonlinear)))[:count]
    terms = [k for k in range(fit.baseline_size, count) if fit.columns[k].mechanism not in fit.following]
    covariance[np.ix_(terms, terms)] += scale * np.outer(values[terms], values[terms])
    flights = [each.flight for each in fit.frame.reconstructions]
    for k, parameter in enumerate(fit.nonlinear, start=count):
        if parameter.kind == "knot":
            apart = [each.step if fit.frame.common else each.within(parameter.value) for each in flights]
            covariance[k, k] += shift_sigma(min(apart)) ** 2
    found = replace(fit, log_evidence=level, values=values, joint_covariance=covariance, bound_cost=0.0)
    return within_bounds(replace(found, left_out=own.left_out(weight)))


def explained(judged: Judged) -> Explained:
    """What the leader's terms explain of the mean square that the baseline's fit without processes has as residual:
    alone or, if that is more, as they are beside processes (their scalar product with it, for one may hide the other).
    The rest is of processes and noise. The interval is that of the jackknife over stretches of time (Efron and Stein,
    Ann. Statist. 9, 1981), which knows of what a model lacks, as errors of coefficients do not; and of two motions.
    """
    leader, residual, stretches = judged.leading.evidence, judged.baseline_residual, judged.rows.time_blocks
    noise = float(min(leader.noise**2 * judged.rows.size / judged.squares, 1.0))  # beside all processes
    if not np.any(of_terms := leader.terms.acting):
        return Explained(share=0.0, unexplained=1.0, interval_95=(0.0, 0.0), processes=1.0 - noise, noise=noise)
    made, beside = judged.rows.beside_baseline(leader.terms.x[:, of_terms]), leader.made_of_terms

    def explains(use: BoolArray) -> FloatArray:
        alone = made[use] @ np.linalg.lstsq(made[use], residual[use], rcond=None)[0]
        return np.array([alone, beside[use]]) @ residual[use] / np.sum(residual[use] ** 2)

    shares = np.array([explains(stretches != k) for k in (-1, *np.unique(stretches))])
    whole, *without = shares[:, np.argmax(shares[0])].tolist()
    error, share = NORMAL_95 * jackknife_error(np.array(without)), min(max(whole, 0.0), 1.0 - noise)
    ends = [share - error, share + error, *(() if judged.elsewhere is None else judged.elsewhere.interval_95)]
    low, high = np.clip([min(ends), max(ends)], 0.0, 1.0).tolist()
    rest = {"unexplained": 1.0 - share, "processes": 1.0 - share - noise, "noise": noise}
    return Explained(share=share, interval_95=(low, high), **rest)


def processes(own: Evidence) -> tuple[ProcessEstimate, ...]:
    """Every process beside a hypothesis, largest share of the moment first; of record and air by the rates made."""
    rows, found, known = own.rows, list[ProcessEstimate](), processes_by_name()
    for k, group in enumerate(rows.groups):
        process = known[group.name]
        if isinstance(process, MomentProcess):
            size, error = moment_of_process(own, k, process)
            share = size / rows.measured_moment
        else:
            size, error = (float(np.sqrt(np.mean(part**2))) for part in own.spline_coefficients(k))
            share = float(np.linalg.norm(own.made_by(k))) / rows.static
        planted = as_planted(own, process, 0) if share > LEAST_PROCESS else {}
        found.append(
            ProcessEstimate(
                name=group.name,
                family=group.family,
                size=size,
                std_error=error,
                units=group.units,
                share_of_moment=share,
                tolerance=float(np.exp(group.prior[0])) * group.size,
                planted=planted,
            )
        )
    return tuple(sorted(found, key=lambda each: -each.share_of_moment))


# ---- What outside the list would explain a flight instead of the leader, rather than beside it ----


Alternative = tuple[str, Pair]  # what something outside the list is in words, and as a hypothesis of its own


def outside(judged: Judged, hypotheses: Mapping[str, Sequence[Mechanism]]) -> list[Alternative]:
    """What may be there instead of the leader: a change that many things bring, the best moment of a shape that nothing
    on the list has, and the best that turns in the body while the leader, or one nearly as likely, acts, each between
    two times: what leads by little may be another where a record is rounded otherwise. The leader, or one nearly as
    likely, is such a change where its characteristic terms are not wanted, or its law is not tested.
    """
    problem, leader, null = judged.problem, judged.leading.fit, judged.baseline
    listed = tuple({each.name: each for group in hypotheses.values() for each in group}.values())
    frame = null.rows.frame_of(leader)
    like = replace(leader, frame=frame)
    # Gradual changes of such moments are described by processes.
    shapes = unmodelled_moments(problem, listed)
    tried = acting(problem, like, shapes, null.of_both_sizes, onsets=(0.0,), most=_SHAPES_TRIED)
    best = {pair.fit.mechanisms: pair for pair in sorted(tried, key=attrgetter("level"))}  # of each shape
    found = list(best.values())
    most = leader.information + 2.0 * MECHANISM_ACTS
    near = [pair for pair in judged.pairs if leader.selected and pair.fit.information < most]
    selected = [pair.fit.selected for pair in near]
    changes = [sorted({c.time_basis.start for c in some if c.time_basis.kind != "constant"}) for some in selected]
    last, turned = float(frame.coefficient_time.max()), list[Pair]()
    for stretch in {(starts[0], starts[-1] if len(starts) > 1 else last) for starts in changes if starts}:
        turning = turning_moment(problem, listed, *stretch)
        (turns,) = regions([null], frame, turning, np.array(stretch), most=1) if turning is not None else ([],)
        if turning is not None and turns:
            rate = dict(max(turns, key=lambda each: each.peak).theta)[RATE]
            turned += acting(problem, like, [turning.at(rate)], [null], np.array(stretch))
    found += [max(turned, key=attrgetter("level"))] if turned else []
    moments = [(_described(pair.fit), pair) for pair in found]
    plain = (_plain_instead(problem, pair) for pair in near)
    return [*filter(None, (*(_unspecific(pair, pair.fit is leader) for pair in near), *plain)), *moments]


def _plain_instead(problem: Problem, pair: Pair) -> Alternative | None:
    """The plain moment that a hypothesis makes on this record while it acts, where the evidence does not want its own
    law in place of that; no likelier than itself.
    """
    (fit, own), (columns, words) = pair, plain_instead(pair.fit)
    if not columns:
        return None
    like = replace(fit, mechanisms=(PLAIN,), frame=problem.frame.with_mechanisms([PLAIN]))
    plain = moved(problem, fitted(problem, like, columns, own))
    if own.level - plain.level > SPECIFIC:
        return None
    level = min(own.level, plain.level)
    return f"{words}, which is not specific to {fit.name}", Pair(plain.fit, replace(plain.evidence, level=level))


def _unspecific(pair: Pair, leads: bool) -> Alternative | None:
    """What a hypothesis is without what is characteristic of its mechanisms, where the evidence does not want that; of
    the leader no likelier than itself.
    """
    (fit, own), plain = pair, plain_columns(pair.fit)
    specific = [k for k, column in enumerate(fit.selected) if column not in plain]
    if not plain or not any(mechanism.characteristic for mechanism in fit.mechanisms):
        return None
    level = own.level_without(specific) if specific else own.level
    if own.level - level > SPECIFIC:
        return None
    terms = ", ".join(dict.fromkeys(column.term for column in plain))
    words = f"a change of {terms} alone, which is not specific to {fit.name}"
    return words, (pair if leads else Pair(fit, replace(own, level=level)))


def _described(fit: HypothesisFit) -> str:
    rates = {f"turning in the body at {value:.3g} rad/s" for c in fit.selected for key, value in c.theta if key == RATE}
    shapes = " and ".join(rates or dict.fromkeys(column.term for column in fit.selected))
    starts = [column.time_basis.start for column in fit.selected if column.time_basis.kind != "constant"]
    return f"a moment that no mechanism on the list has ({shapes}{acts_since(fit, starts)})"


def acts_since(fit: HypothesisFit, starts: Sequence[float]) -> str:
    """From or until when a moment acts whose time bases have such `starts`; empty where that is throughout."""
    if not starts:
        return ""
    when, edge = "until" if len(starts) < len(fit.selected) else "from", min(starts)
    known = fit.frame.coefficient_time
    first, last = float(known.min()), float(known.max())
    left_out = last - edge if when == "until" else edge - first
    return "" if left_out < AT_ITS_ENDS * (last - first) else f" {when} {at(fit.frame.common, edge)}"
