"""A hypothesis beside processes: fitted, acting between two times, without what is not wanted there.

The search, which knows no processes, describes with many knots what they explain. In order: `with_its_evidence` (a fit
as it was searched), `in_one_region` (acting between two times), `plainest` (the likeliest of these, grown and without
what is not wanted), `widened` (onsets that take time); of the leader `moved` closely and `scanned`, with errors
`beyond_linear`. Forms have a `price`.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import chain, pairwise
from operator import attrgetter
from typing import NamedTuple

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.comparison.intervals import within_bounds
from brv_hypo.comparison.limits import SPENT, Shape, even_edges, regions
from brv_hypo.inference.evidence import Evidence, maximised, with_amplitudes
from brv_hypo.inference.fit import HypothesisFit, solved
from brv_hypo.inference.problem import Problem
from brv_hypo.inference.reduced import Reduced
from brv_hypo.inference.refinement import KNOT_MARGIN, has_width, middle, nonlinear_parameters
from brv_hypo.inference.rows import Rows
from brv_hypo.linearisation.frame import RateFrame
from brv_hypo.mechanisms.contract import Mechanism
from brv_hypo.model.term import Regressor, TimeBasis, term_column, theta_grid
from brv_hypo.thresholds import FURTHER_REGION, ONSET_TAKES_TIME

_LINEAR = 3.0  # nats by which the evidence without a change may be wrong before knots and delays move
_INFORMED = 1.0  # nats by which the data have to narrow what remains: that which explains nothing is no description
KNOT_STEPS, CLOSE_STEPS = 4, 12  # of knots and delays beside processes, at most: of a rival, of the leader
CLOSE_ROUNDS = 3  # of such steps and the amplitudes after them, of the leader
STAYS = (0.03, 0.01)  # standard errors by which they move no more: of a rival, of the leader
_NEAR = 10.0  # nats behind the best region, up to which one of another onset is offered too
OUT_OF_REACH = 300.0  # nats behind the best, from which a hypothesis is not worked on
WIDENED = 50.0  # nats behind the best, up to which the onsets of a hypothesis may take time
_GAIN, _ROUNDING = 0.3, 1e-3  # nats by which such a step has to raise the evidence of a rival; of the leader, may lower
EDGE_ROUNDS = 3  # of ends and delays by turns, at most
FINER_EDGES = 9  # times about each of the best two of them: jumps have several optima
COARSE_EDGES, FINE_EDGES = 41, 81  # times between which all delays are tried, and the likeliest of them
SHORT_PART = 0.05  # of the record, within whose margin no two ends are
WITH_ONSETS = 3  # of those that come on over a time too, at most
# Standard errors of a delay at which the evidence is found; of a knot, the last of them is one standard error.
AFTER_ERRORS = (1.0, 2.0, 4.0, 8.0, 16.0, 32.0)
UNSURE_STEPS = 4.0  # samples, from which on the standard error of a knot is that of its interval
FURTHER_SQUARES = 0.01  # of those that all regions make: one with less describes what is not linear of the others
FURTHER = 2  # regions beside the first in which one mechanism acts, at most: one more than a name may have
CONSISTENT_ROUNDS = 4  # at most, of values and the static moment that lags follow
CONSISTENT = 0.1  # standard errors by which values may differ from those that regressors follow
INCONSISTENT = 20.0  # nats by which the level falls with that static moment: another round
ONSETS = (0.0, 0.1, 0.2)  # of the record's length, over which it may come on there
WIDTHS = (0.01, 0.03, 0.1, 0.2)  # of the record's length, that an onset is tried to take


class Pair(NamedTuple):
    """A hypothesis beside processes: its fit, and the evidence of that."""

    fit: HypothesisFit
    evidence: Evidence

    @property
    def level(self) -> float:
        """The log evidence."""
        return self.evidence.level

    @property
    def possible_level(self) -> float:
        """The log evidence with possible values, less the price of the form."""
        fit, own = self
        errors = replace(_with_values_of(fit, own), joint_covariance=own.covariance)
        return own.level - price(fit) - 0.5 * within_bounds(errors).bound_cost


def in_one_region(
    problem: Problem, pair: Pair, null: Evidence, frame: RateFrame, best: float = -math.inf
) -> list[Pair]:
    """The hypothesis as it is and, of one mechanism, acting between two times of a grid alone. Beside processes as
    large as without it, and beside small ones where those are larger than usual: the evidence has a maximum at each,
    and large processes make up for a mechanism, so that beside them other times and delays explain more. `best`: the
    log evidence of the likeliest hypothesis so far.
    """
    fit = pair.fit
    if len(fit.mechanisms) != 1:
        return [pair]
    like = replace(fit, frame=frame.with_mechanisms(fit.mechanisms))
    beside = null.of_both_sizes
    least = best - max(OUT_OF_REACH, 0.5 * (best - null.level))
    return [pair, *acting(problem, like, fit.mechanisms, beside, starts=[pair.evidence], least=(least, best))]


def plainest(problem: Problem, offered: Sequence[Pair], null: Evidence) -> Pair:
    """The likeliest beside processes of a hypothesis as it is, in one region, between its own knots and grown from
    there; then without the changes that are not wanted, its knots and delays where they are likeliest.
    """
    (fit, _), pairs = offered[0], list(offered)
    if len(fit.mechanisms) == 1:
        time = fit.frame.coefficient_time
        starts = [-np.inf, *(column.time_basis.start for column in fit.selected), np.inf]
        edges = np.unique(np.clip(starts, time.min(), time.max()))
        begun = [each.evidence for each in offered]
        pairs += acting(problem, offered[-1].fit, fit.mechanisms, [null], edges, starts=begun)
        pairs.append(_grown(problem, likelier(pairs[1:] or pairs)))
    fit, own = pair = moved(problem, _without_unwanted(problem, likelier(pairs)))
    if not _may_end(fit):
        return pair
    # Nothing remains of a mechanism after its last change, unless the evidence clearly wants that.
    return likelier([pair, moved(problem, fitted(problem, replace(fit, ends=not fit.ends), fit.selected, own))])


def _fine(frame: RateFrame, onsets: Sequence[float] = ONSETS) -> tuple[FloatArray, tuple[int, ...]]:
    """Times between which a mechanism is tried acting, and over how many parts between them it may come on."""
    return even_edges(frame, FINE_EDGES), tuple(round(share * (FINE_EDGES - 1)) for share in onsets)


def price(fit: HypothesisFit) -> float:
    """What the form of a hypothesis costs beforehand, nats: onsets that take time, further regions, or changes beside
    the two of one, and that something remains of a mechanism after its last change.
    """
    if fit.ends:
        further = float(len(fit.regions) - 1)
    else:
        changes = Counter(mechanism for mechanism, _ in {(c.mechanism, c.time_basis) for c in fit.selected})
        further = _may_end(fit) + sum(0.5 * max(count - 2, 0) for count in changes.values())
    return ONSET_TAKES_TIME * len(_onsets(fit)) + FURTHER_REGION * further


def likelier(pairs: Sequence[Pair]) -> Pair:
    """The likeliest with possible values, less its price."""
    return max(pairs, key=attrgetter("possible_level"))


def _onsets(fit: HypothesisFit) -> set[TimeBasis]:
    return {column.time_basis for column in fit.selected if has_width(column.time_basis)}


def _grown(problem: Problem, pair: Pair) -> Pair:
    """With onsets that take time, and further times of acting, not the shape of an onset, where clearly wanted."""
    for _ in range(FURTHER if len(pair.fit.mechanisms) == 1 else 0):
        fit, own = pair = widened(problem, pair)
        (mechanism,), frame = fit.mechanisms, own.rows.frame_of(fit)
        (found,) = regions([own], frame, mechanism, *_fine(frame), [fit.selected[0].theta], most=1)
        if not found or 0.5 * found[0].peak < FURTHER_REGION:
            break
        at = float(np.mean(found[0].region))
        if any(onset.start < at < onset.stop for onset in _onsets(fit)):
            break
        further = _acting_between(mechanism, found[0], frame)
        there = moved(problem, fitted(problem, fit, (*fit.selected, *further), own))
        if there.level < own.level + FURTHER_REGION or np.min(squares_of_regions(there)) < FURTHER_SQUARES:
            break
        pair = there
    return pair


def squares_of_regions(pair: Pair) -> FloatArray:
    """What the terms of each region make of the moment's squares (regions,), over those of all."""
    return squares_of(pair, [list(chain(*each)) for each in pair.fit.regions])


def squares_of(pair: Pair, parts: Sequence[Sequence[int]]) -> FloatArray:
    """Of parts of the terms, by their places, the squares of the moment that each makes, over those of all (parts,)."""
    fit = pair.fit
    made = pair.evidence.rows.frame_of(fit).moments(fit.selected) * fit.values[fit.baseline_size :]
    squares = np.array([np.sum(np.abs(made[:, list(each)].sum(axis=1)) ** 2) for each in parts])
    return np.asarray(squares / np.sum(squares))


def _acting_between(mechanism: Mechanism, shape: Shape, frame: RateFrame) -> list[Regressor]:
    """The changes with which a mechanism acts in a region alone."""
    always, time = "constant" in mechanism.time_variation, frame.coefficient_time
    first, last = shape.region
    half, bases = 0.5 * shape.width, [TimeBasis("jump", last)] if last < time.max() else []
    if half > 0.0:
        bases.insert(0, TimeBasis("ramp", first - half, first + half))
    elif first > time.min() or always:
        bases.insert(0, TimeBasis("jump", first) if first > time.min() else TimeBasis("constant"))
    terms = mechanism.terms(frame.motions[0], dict(shape.theta))
    return [term_column(mechanism, term, shape.theta, basis) for basis in bases for term in terms]


def widened(problem: Problem, pair: Pair) -> Pair:
    """With changes coming on over a time instead of at once, where the evidence clearly wants that."""
    sharp = pair
    while True:
        fit, own = pair
        jumps = {column.time_basis for column in fit.selected if column.time_basis.kind == "jump"}
        found = [(*_best_width(fit, own, jump), jump) for jump in sorted(jumps, key=middle)]
        wide, gain, jump = max(found, key=lambda each: each[1], default=(None, 0.0, None))
        if wide is None or gain < ONSET_TAKES_TIME:
            break
        over = [replace(c, time_basis=wide, units=wide.units(c.units)) for c in fit.selected]
        columns = [new if old.time_basis == jump else old for old, new in zip(fit.selected, over, strict=True)]
        there = moved(problem, fitted(problem, fit, columns, own))
        if there.level < own.level + ONSET_TAKES_TIME:
            break
        pair = there
    return pair if pair is sharp else _without_unwanted(problem, pair)


def _best_width(fit: HypothesisFit, own: Evidence, jump: TimeBasis) -> tuple[TimeBasis, float]:
    """The ramp in the place of a jump that gains most with the coefficients as they are, and by how many nats."""
    frame = own.rows.frame_of(fit)
    mine = [k for k, column in enumerate(fit.selected) if column.time_basis == jump]
    values = own.values[fit.baseline_size :][mine]
    time, shifts = frame.coefficient_time, np.linspace(-1.0, 1.0, 5)
    halves = np.repeat(0.5 * np.ptp(time) * np.array(WIDTHS), shifts.size)
    middles = jump.start + halves * np.tile(shifts, len(WIDTHS))
    inside = (middles - halves > time.min()) & (middles + halves < time.max())
    halves, middles = halves[inside], middles[inside]
    pairs = zip(middles.tolist(), halves.tolist(), strict=True)
    ramps = [TimeBasis("ramp", at - half, at + half) for at, half in pairs]
    if not ramps:
        return jump, 0.0
    tried = [fit.selected[k].at(fit.selected[k].theta, ramp) for ramp in ramps for k in mine]
    rates = own.rows.rates_of_moments(frame, tried).reshape(-1, len(ramps), len(mine)) @ values / (2.0 * halves)
    sharp = own.rows.rates_of_moments(frame, [fit.selected[k] for k in mine]) @ values
    products = own.with_moments(rates - sharp[:, np.newaxis])
    information, right = own.projected(products)
    known, before = np.diag(information), np.diag(products.across)[-len(ramps) :]
    gains = 0.5 * np.divide(right**2, known, out=np.zeros_like(known), where=known > SPENT * before)
    best = int(np.argmax(gains))
    return ramps[best], float(gains[best])


def acting(
    problem: Problem,
    like: HypothesisFit,
    mechanisms: Sequence[Mechanism],
    nulls: Sequence[Evidence],
    edges: FloatArray | None = None,
    onsets: Sequence[float] = ONSETS,
    starts: Sequence[Evidence] = (),
    least: tuple[float, float] = (-math.inf, -math.inf),
    most: int = 1,
) -> list[Pair]:
    """Beside each of some evidences one of several mechanisms, that which explains most between two times, as a
    hypothesis like another; without those beside which none is determined. The times are those given, or of a fine
    grid: between others the ends of a mechanism are too far off to find its delay. The likeliest that begins at once,
    and the likeliest that comes on over these shares of the record: beside processes a short region about one end may
    explain as much as the whole one with its onset. `most`: so many of either, however far apart, as gains are those of
    the amplitudes before. `least`: see `_between`.
    """
    times, likely = _likely_regions(like.frame, mechanisms, nulls, edges, onsets, most)
    beside = [(*one, null) for each, null in zip(likely, nulls, strict=True) for one in each]
    where = [(mechanism, shape.theta, shape.region, shape.width) for mechanism, shape, _ in beside]
    pairs: list[Pair] = []
    for k, (mechanism, shape, null) in enumerate(beside):
        if where[k] not in where[:k]:
            own = replace(like, name=mechanism.name, mechanisms=(mechanism,))
            near = max((each.level for each in pairs), default=-math.inf) - _NEAR
            wide = max(least[0], least[1] - WIDENED, null.level, near)
            pairs.append(_between(problem, own, shape, times, (null, *nulls, *starts), (*least, wide)))
    return pairs


def _likely_regions(
    frame: RateFrame,
    mechanisms: Sequence[Mechanism],
    nulls: Sequence[Evidence],
    edges: FloatArray | None = None,
    onsets: Sequence[float] = ONSETS,
    most: int = 1,
) -> tuple[FloatArray, list[list[tuple[Mechanism, Shape]]]]:
    """The times that regions are between, and beside each evidence the regions that `acting` takes."""
    offered = {mechanism: theta_grid(mechanism, dense=True) for mechanism in mechanisms}
    several = sum(map(len, offered.values())) > WITH_ONSETS
    grids: list[tuple[FloatArray, Sequence[int], int]] = [(even_edges(frame, COARSE_EDGES), (0,), WITH_ONSETS)]
    grids = [*grids[: int(several)], (*_fine(frame, onsets), most)]
    for times, parts, count in grids if edges is None else [(edges, (0,), 1)]:
        tried = [(m, regions(nulls, frame, m, times, parts, thetas, most=1)) for m, thetas in offered.items()]
        found = [[(m, shape) for m, of_each in tried for shape in of_each[k]] for k in range(len(nulls))]
        ordered = [sorted(each, key=lambda one: -one[1].peak) for each in found]
        likely = [_offered(each, count, _NEAR if most == 1 else math.inf) for each in ordered]
        best = dict.fromkeys((m, shape.theta) for each in likely for m, shape in each)
        offered = {m: tuple(theta for own, theta in best if own == m) for m, _ in best}
    return times, likely


def together(problem: Problem, pair: Pair, alone: Mapping[str, Pair]) -> list[Pair]:
    """A hypothesis of several mechanisms as it is, and of each mechanism, as it is likeliest `alone`, with the others
    one after another where they explain most beside it: beside its processes, and beside small ones.
    """
    like, found = pair.fit, [pair]
    for first in like.mechanisms:
        here = alone.get(first.name)
        for other in like.mechanisms:
            if here is None or other is first:
                continue
            fit, own = here
            beside = own.of_both_sizes
            _, likely = _likely_regions(own.rows.frame_of(like), [other], beside)
            acts = (_acting_between(other, best[0][1], like.frame) for best in likely if best)
            tried = [moved(problem, fitted(problem, like, (*fit.selected, *more), *beside)) for more in acts]
            here = likelier(tried) if tried else None
        found += [here] if here is not None else []
    return found


def beside_leader(problem: Problem, pair: Pair, other: Mechanism) -> Pair:
    """The leader, one mechanism, and another that may act beside it, together; without that if likelier."""
    (fit, own), mechanisms = pair, (*pair.fit.mechanisms, other)
    like = replace(fit, mechanisms=mechanisms, frame=problem.frame.with_mechanisms(mechanisms))
    return likelier(together(problem, Pair(like, own), {fit.name: pair}))


def _offered(ordered: Sequence[tuple[Mechanism, Shape]], count: int, near: float) -> list[tuple[Mechanism, Shape]]:
    """So many regions, the best first, that begin at once, and as many that come on over a time, so near the best."""
    found = [one for one in ordered if ordered[0][1].peak - one[1].peak < 2.0 * near]
    kinds = [[one for one in found if (one[1].width > 0.0) is gradual][:count] for gradual in (False, True)]
    return [*kinds[0], *kinds[1]]


def _between(
    problem: Problem,
    like: HypothesisFit,
    best: Shape,
    times: FloatArray,
    starts: Sequence[Evidence],
    least: tuple[float, float, float],
) -> Pair:
    """A mechanism in a region, its ends placed beside the first of `starts`, moved unless far below `least`."""
    (mechanism,), frame = like.mechanisms, like.frame.with_mechanisms(like.mechanisms)
    time, reach = frame.coefficient_time, float(np.min(np.diff(times)))
    shortest = KNOT_MARGIN * SHORT_PART * np.ptp(time)
    # Between ends that are off another delay explains more, and with another delay other ends do.
    for _ in range(EDGE_ROUNDS if times.size > 2 and best.width == 0.0 else 0):
        near = [np.linspace(edge - reach, edge + reach, FINER_EDGES) for edge in best.region]
        closer = np.unique(np.clip([*np.concatenate(near), *best.region], time.min(), time.max()))
        (nearer,) = regions(starts[:1], like.frame, mechanism, closer, (0,), [best.theta])
        best = max([best, *(each for each in nearer if np.ptp(each.region) > shortest)], key=attrgetter("peak"))
        (delayed,) = regions(starts[:1], like.frame, mechanism, np.array(best.region), most=1)
        theta, best = best.theta, max([best, *delayed], key=attrgetter("peak"))
        if best.theta == theta:
            break
    own = replace(like, frame=frame, ends=True)

    def placed(shape: Shape) -> Pair:
        return fitted(problem, own, _acting_between(mechanism, shape, frame), *starts[1:])

    pair = placed(best)
    if pair.level < least[0] and pair.level + 0.5 * best.peak < least[1]:
        return pair
    pair = moved(problem, pair)
    if best.width == 0.0 or pair.level < least[2]:
        return pair
    # Onsets of other widths, of which the grid has few: in an oscillating moment there are several optima.
    other = widened(problem, moved(problem, placed(replace(best, width=0.0))))
    return likelier([pair, other])


def fitted(problem: Problem, like: HypothesisFit, selected: Sequence[Regressor], *starts: Evidence) -> Pair:
    """The hypothesis of a fit with other columns, beside processes, from the amplitudes of other evidences."""
    return with_its_evidence(starts[0].rows, _with_columns(problem, like, selected), *(each.at for each in starts))


def with_its_evidence(rows: Rows, fit: HypothesisFit, *starts: FloatArray, rounds: int = CONSISTENT_ROUNDS) -> Pair:
    """A fit with its evidence from some amplitudes: knots and delays move what it is beside processes, not without."""
    own = maximised(rows, rows.terms(fit), *starts)
    if not fit.nonlinear:
        return Pair(fit, own)
    for last in range(1 - rounds, 1):
        pair = _consistent(rows, fit, own)
        if last == 0 or pair.level > own.level - INCONSISTENT:
            break
        fit, own = pair.fit, maximised(rows, rows.terms(pair.fit), own.at, *starts)
    return pair


def _consistent(rows: Rows, fit: HypothesisFit, own: Evidence) -> Pair:
    """A fit at the amplitudes of an evidence, where the static moment that lags follow is that of its coefficients."""
    first, count = fit.baseline_size, fit.values.size
    for _ in range(CONSISTENT_ROUNDS if fit.following else 1):
        fit = _with_values_of(fit, own)
        own = with_amplitudes(rows, rows.terms(fit), own.at)
        off = np.abs(own.values[first:count] - fit.values[first:])
        if np.all(off <= CONSISTENT * np.sqrt(np.diag(own.covariance)[first:count])):
            break
    return Pair(fit, own)


def _with_values_of(fit: HypothesisFit, own: Evidence) -> HypothesisFit:
    """The fit with the coefficients of its evidence, and what follows the static moment after them."""
    terms = int(np.sum(own.terms.scaled))
    if terms != len(fit.selected):
        return fit
    return replace(fit, values=own.values_without(range(terms, own.terms.known))[: fit.values.size])


def _with_columns(problem: Problem, like: HypothesisFit, selected: Sequence[Regressor]) -> HypothesisFit:
    """The hypothesis of a fit with other columns, without processes; two changes at one time are one."""
    columns = (*problem.baseline, *dict.fromkeys(selected))
    fit = solved(Reduced(problem, like.frame), like.name, like.mechanisms, columns, like.searched)
    ends = like.ends and _may_end(fit)
    return replace(fit, nonlinear=nonlinear_parameters(fit.selected, like.frame, problem.knots), ends=ends)


def _may_end(fit: HypothesisFit) -> bool:
    """Whether every coefficient of one mechanism changes again after it began."""
    changes = [(c.term, c.flight) for c in fit.selected if math.isfinite(c.time_basis.final)]
    often = len(changes) == len(fit.selected) and all(changes.count(each) > 1 for each in changes)
    return often and len(fit.mechanisms) == len({column.theta for column in fit.selected}) == 1


def moved(problem: Problem, pair: Pair, closely: bool = False) -> Pair:
    """With knots and delays moved to where they are likeliest, while that gains; `closely`: until they stay. A step is
    judged by the evidence with them fixed there: that of the linear model extrapolates to where they are not.
    Amplitudes follow when the steps are done.
    """
    for _ in range(CLOSE_ROUNDS if closely else 1):
        there = _stepped(problem, pair, closely)
        if there is pair:
            break
        pair = Pair(there.fit, maximised(there.evidence.rows, there.evidence.terms, there.evidence.at))
    return pair


def _stepped(problem: Problem, pair: Pair, closely: bool) -> Pair:
    """Where steps of knots and delays lead at the amplitudes of a pair."""
    share, steps = 1.0, CLOSE_STEPS if closely else KNOT_STEPS
    for _ in range(steps if pair.fit.nonlinear else 0):
        fit, own = pair
        columns, count = fit.selected, len(fit.columns)
        shifts, errors = own.values[count:], np.sqrt(np.diag(own.covariance)[count:])
        if np.all(np.abs(shifts) <= STAYS[closely] * errors):
            break
        for parameter, shift in zip(fit.nonlinear, (share * shifts).tolist(), strict=True):
            columns = parameter.moved(columns, float(np.clip(parameter.value + shift, *parameter.bounds)))
        found = _at_amplitudes_of(problem, pair, columns)
        if _level_fixed(found) - _level_fixed(pair) > (-_ROUNDING if closely else _GAIN):
            pair = found
        elif closely:
            share *= 0.5
        else:
            break
    return pair


def _at_amplitudes_of(problem: Problem, pair: Pair, columns: Sequence[Regressor]) -> Pair:
    """The hypothesis of a pair with other columns at the amplitudes of the pair."""
    return _consistent(pair.evidence.rows, _with_columns(problem, pair.fit, columns), pair.evidence)


def _level_fixed(pair: Pair) -> float:
    """The log evidence with knots and delays where they are."""
    terms = len(pair.fit.selected)
    return pair.evidence.level_without(range(terms, terms + len(pair.fit.nonlinear)))


def scanned(problem: Problem, pair: Pair) -> Pair:
    """With delays, and what goes with them, where they are likeliest of a scan about where steps of them ended: what is
    multiplied by a delay makes up for it along a curve, which steps on a straight line leave.
    """
    for k in range(len(pair.fit.nonlinear)):
        fit, own = pair
        parameter, place = fit.nonlinear[k], len(fit.selected) + k
        values = parameter.others() if parameter.kind == "theta" else ()
        tried = (_at_amplitudes_of(problem, pair, parameter.moved(fit.selected, value)) for value in values)
        found = [pair, *(each for each in tried if len(each.fit.nonlinear) == len(fit.nonlinear))]
        best = max(found, key=lambda each: each.evidence.level_without([place]))
        if best.evidence.level_without([place]) > own.level_without([place]) + _GAIN:
            found = [pair, Pair(best.fit, maximised(own.rows, best.evidence.terms, own.at))]
            pair = max(*found, moved(problem, found[1], closely=True), key=attrgetter("level"))
    return pair


def beyond_linear(problem: Problem, pair: Pair, weight: float) -> FloatArray:
    """What is to be added to the covariance of coefficients, knots and delays for how delays and knots that are not
    surely placed differ from linear. A delay and what is multiplied by it make up for one another along a curve, on
    which the delay may be shorter than any that is searched; a knot in a gap, or where its moment passes through zero,
    moves nothing at first. Each errs by what it does at the ends of the interval where the evidence, a nat of which
    counts as `weight`, has fallen by a half (a likelihood interval: Meeker and Escobar, Am. Stat. 49, 1995), with a
    delay no less than linearly; a coefficient by no more than its bounds are wide.
    """
    (fit, own), count = pair, len(pair.fit.columns)
    bounds = {mechanism.name: mechanism.bounds for mechanism in fit.mechanisms}
    widths = np.full(count + len(fit.nonlinear), np.inf)
    for j, column in enumerate(fit.selected, start=fit.baseline_size):
        low, high = bounds[column.mechanism].get(column.term, (-np.inf, np.inf))
        widths[j] = high - low
    covariance, step = own.covariance / weight, max(record.flight.step for record in problem.records)
    for k, parameter in enumerate(fit.nonlinear):
        linear = covariance[:, count + k] / np.sqrt(covariance[count + k, count + k])
        sigma, delays = abs(linear[count + k]), parameter.kind == "theta"
        if not delays and (parameter.kind != "knot" or sigma < UNSURE_STEPS * step):
            continue
        first = sigma if delays else sigma / AFTER_ERRORS[-1]
        ends = [_end_of_interval(problem, pair, k, sign * first, weight) for sign in (1.0, -1.0)]
        sizes = np.minimum(np.max(np.abs(ends), axis=0), widths)
        along = np.copysign(np.maximum(np.abs(linear), sizes) if delays else sizes, linear)
        covariance = covariance + np.outer(along, along) - np.outer(linear, linear)
    return np.asarray(covariance - own.covariance / weight)


def _end_of_interval(problem: Problem, pair: Pair, number: int, sigma: float, weight: float) -> FloatArray:
    """How coefficients, knots and delays change to where the evidence falls by half, one of them more or less."""
    (fit, own), count = pair, len(pair.fit.columns)
    parameter, free = fit.nonlinear[number], [len(fit.selected) + number]
    at_mode = np.append(own.values_without(free)[:count], [each.value for each in fit.nonlinear])
    level = own.level_without(free)
    before, change = 0.0, np.zeros(at_mode.size)
    for doublings, times in enumerate(AFTER_ERRORS, start=1):
        least = parameter.value * 0.5**doublings if parameter.kind == "theta" else parameter.bounds[0]
        value = min(max(parameter.value + times * sigma, least), parameter.bounds[1])
        there, other = _at_amplitudes_of(problem, pair, parameter.moved(fit.selected, value))
        if len(there.nonlinear) < len(fit.nonlinear):  # it has met another, and the two are one from there on
            break
        after = math.sqrt(max(2.0 * weight * (level - other.level_without(free)), 0.0))
        at = other.values_without(free)[:count]
        further = np.append(at, [each.value for each in there.nonlinear]) - at_mode
        if after > 1.0:
            return np.asarray(change + (1.0 - before) / (after - before) * (further - change))
        before, change = after, further
        if value in parameter.bounds:
            break
    return change


def _without_unwanted(problem: Problem, pair: Pair) -> Pair:
    """Without changes, or regions of what ends, that are not wanted, worst first; knots within a sample are one."""
    step = max(record.flight.step for record in problem.records)
    while True:
        fit, own = pair
        bases = sorted({(column.time_basis, column.theta) for column in fit.selected}, key=lambda each: each[0].start)
        close = [
            (a, b[0].start)
            for a, b in pairwise(bases)
            if b[1] == a[1] and a[0].kind == b[0].kind == "jump" and 0.0 < b[0].start - a[0].start < step
        ]
        if close and not fit.ends:
            (early, theta), start = close[0]
            joined = replace(early, start=start)
            there = [c.at(theta, joined) if (c.time_basis, c.theta) == (early, theta) else c for c in fit.selected]
            pair = moved(problem, fitted(problem, fit, there, own))
            continue
        of_bases = [[k for k, c in enumerate(fit.selected) if (c.time_basis, c.theta) == basis] for basis in bases]
        parts = [list(chain(*region)) for region in fit.regions] if fit.ends else of_bases
        if len(parts) < 2:
            return pair
        nonlinear = list(enumerate(fit.nonlinear, start=len(fit.selected)))
        alone = ([k for k, each in nonlinear if set(each.columns) <= set(part)] for part in parts)  # move nothing else
        levels = [own.level_without([*part, *moving]) for part, moving in zip(parts, alone, strict=True)]
        least = int(np.argmax(levels))
        fewer = _with_columns(problem, fit, [c for k, c in enumerate(fit.selected) if k not in parts[least]])
        needed = own.level - price(fit) + price(fewer)
        if levels[least] < needed - _LINEAR:
            return pair
        found = moved(problem, with_its_evidence(own.rows, fewer, own.at))
        if found.evidence.informed < _INFORMED or found.level < needed:
            return pair
        pair = found
