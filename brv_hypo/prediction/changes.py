"""Whether a flight contradicts a frozen model, and where its static moment or damping differs between two times of it.

The coefficients that this flight has, errors of record and vehicle within their tolerances, are compared with the
frozen ones, both with their covariances: an error of pressure or inertia changes all of them alike, one of a
coefficient that one alone (`find_differences`).

Moments show little of a change of a few percent, sample by sample. Fitted to the rates as a jump that ends, beside
the frozen coefficients within their covariance, it is significant where it is (`find_local_change`). Slope and damping
as such are free beside it: one that is off throughout is no change between two times.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy import stats
from scipy.linalg import orth

from brv_hypo.arrays import FloatArray
from brv_hypo.comparison.judgement import processes
from brv_hypo.comparison.limits import Shape, regions
from brv_hypo.comparison.result import TermEstimate
from brv_hypo.inference.evidence import Evidence, maximised
from brv_hypo.mechanisms.contract import Mechanism, Term
from brv_hypo.model.baseline import pitch_damping_term, static_terms
from brv_hypo.model.term import Regressor, term_column
from brv_hypo.motion.motion import Motion
from brv_hypo.prediction.frozen import FrozenModel
from brv_hypo.prediction.result import Difference, LocalChange
from brv_hypo.thresholds import REFUSED, SPECIFIC
from brv_hypo.tracing.families import beside_processes
from brv_hypo.tracing.fit import fitted_about

# Where slope or damping differ from a frozen model's: a study of its own, `tests.studies.independent.sisters
# --changed`.
CHANGE_EDGES = 25  # times, evenly over the record, between any two of which they may: 300 regions
CHANGE_FINER = 4  # times by which each turn narrows the spacing about the best two, as many to either side
CHANGE_ROUNDS = 2  # turns: 1/16 of the spacing, which is less than the error of an edge
CHANGE_CHANCE = 0.01  # p-value, paid for all that is tried, below which a change is reported; convention
CHANGED_TOGETHER = 3  # coefficients at most that are named as different at once
# Eigenvalues of a covariance, its diagonal 1, that count: less is rounding.
_KNOWN = 1e-9


class ChangedSchedule(Mechanism):
    """The slope of the static moment and pitch damping, or the one of these `of` which it is, from a time on."""

    name = "changed schedule"
    title = "slope or damping from a time on"
    claims = "a slope or a damping that differs from a schedule"
    source = "the regression"
    time_variation = ("constant", "jump")

    of: str | None = None

    def terms(self, motion: Motion, theta: Mapping[str, float]) -> tuple[Term, ...]:
        """C_malpha and C_mq."""
        both = (static_terms(motion)[1], pitch_damping_term(motion))
        return tuple(term for term in both if self.of in (None, term.name))


class Tested(NamedTuple):
    """What a flight says of a frozen model."""

    differences: tuple[Difference, ...]  # coefficients that differ throughout, surest first
    change: LocalChange | None  # between two times
    misfit: float  # rms residual over the noise, with what differs fitted
    far: tuple[str, ...]  # processes far beyond their ordinary size, in words
    refused: bool  # whether it contradicts the model


def tested_against(model: FrozenModel, terms: Sequence[TermEstimate]) -> Tested:
    """What a flight says of a frozen model, whose `terms` are those of all columns."""
    fixed, known, columns = model.fixed, model.known, model.fit.model.columns
    stated, bare, of_scale = model.covariances

    def differ(own: Evidence) -> FloatArray:
        """What fixed coefficients may differ by on two flights that both have processes, or have none."""
        return (stated if own.rows.groups else bare) + of_scale

    about = model.fit
    for again in (False, True):  # about this flight's own, where one that is far off moves the vehicle elsewhere
        every = beside_processes(about, about.model, about.problem.rows.part)
        every = replace(every, rows=every.rows.allowing(model.moved_by_times))
        alone = every.evidence([], ())
        better = max(alone, every.null, key=lambda each: each.level)
        differences = find_differences(better, terms, fixed, differ(better))
        differing = {(each.mechanism, each.term) for each in differences}
        differs = any(each.p_value < REFUSED for each in differences)
        if again or not differs:
            break
        here_is = {(each.mechanism, each.term): each.frozen + each.value for each in differences}
        pairs = zip(terms, about.values.tolist(), strict=True)
        moved_to = np.array([here_is.get((each.mechanism, each.name), value) for each, value in pairs])
        moving = fitted_about(about.data, about.model, moved_to)
        about = replace(moving, problem=moving.problem.on(about.problem.rows.part), known=about.known)

    def changed(places: Sequence[int]) -> tuple[LocalChange | None, Evidence]:
        """A change between two times beside some of the fixed coefficients within their covariance."""
        agreed = np.where(np.isin(np.arange(len(columns)), known[places]), fixed, np.nan)
        pair = ((each, differ(each)[np.ix_(places, places)]) for each in (alone, every.null))
        own, beside_all = (fixed_within(each, columns, agreed, there) for each, there in pair)
        return find_local_change(own, beside_all), own

    change, within_both = changed(range(known.size))
    misfit = min(_misfit(better), _misfit(within_both, 0.0 if change is None else change.f_ratio))
    far = tuple(each.sized for each in processes(better) if each.is_far and each.is_of_moment)
    if change is not None and differs:
        # Nothing changes between two times where nothing does beside the coefficients that differ throughout.
        same = [k for k, j in enumerate(known) if (terms[j].mechanism, terms[j].name) not in differing]
        change = change if changed(same)[0] is not None else None
    return Tested(differences, change, misfit, far, change is not None or differs)


def _misfit(own: Evidence, gain: float = 0.0) -> float:
    """The rms residual over the record's noise, whose level has a narrow prior; a term of this F-ratio taken out."""
    squares = float(np.sum(own.residual[own.rows.counted] ** 2)) - gain * own.noise**2
    return own.rows.noise_ratio * math.sqrt(max(squares, 0.0) / own.rows.size)


def fixed_within(own: Evidence, columns: tuple[Regressor, ...], fixed: FloatArray, covariance: FloatArray) -> Evidence:
    """The same with coefficients `fixed` (columns,), NaN: free, within their covariance but for slope and damping."""
    rows, known = own.rows, np.flatnonzero(~np.isnan(fixed))
    x = rows.of_moments(rows.frame, columns)
    changed = ChangedSchedule()
    throughout = [term_column(changed, term) for term in changed.terms(rows.frame.motions[0], {})]
    x_changed = rows.of_moments(rows.frame.with_mechanisms([changed]), throughout)
    free = orth(np.column_stack([np.delete(x, known, axis=1), x_changed]))
    variances, directions = np.linalg.eigh(covariance)
    erring = x[:, known] @ (directions * np.sqrt(np.maximum(variances, 0.0)))
    within = np.isfinite(rows.spread)
    rows = replace(
        rows,
        y=rows.y - x[:, known] @ fixed[known],
        shared=np.column_stack([free, rows.shared[:, within], erring]),
        spread=np.concatenate([np.full(free.shape[1], np.inf), rows.spread[within], np.ones(known.size)]),
        coefficients=np.zeros((0, free.shape[1])),
    )
    return maximised(rows, rows.terms(None), own.at)


def find_local_change(own: Evidence, beside: Evidence) -> LocalChange | None:
    """The change of slope or damping, against before and after, that explains most; None where chance gives as much.
    Where it is, is found without processes, which take up a change that is not short; that it is, has to be significant
    `beside` them too, and errs by as much as there: what is smooth throughout is no change between two times.
    """
    frame, motion = own.rows.frame, own.rows.frame.reconstructions[0].motion
    times = frame.time[own.rows.problem.rows.part.rows]
    edges = np.linspace(float(times.min()), float(times.max()), CHANGE_EDGES)
    terms = ChangedSchedule().terms(frame.motions[0], {})

    def best(tried: Sequence[Term], between: FloatArray) -> tuple[Term, Shape]:
        """Of the changes of some terms between two of some times."""
        each = [(t, regions([own], frame, ChangedSchedule(of=t.name), between, most=1)[0]) for t in tried]
        return max(((t, shape) for t, shapes in each for shape in shapes), key=lambda pair: pair[1].peak)

    term, change = best(terms, edges)
    spacing = float(edges[1] - edges[0])
    for _ in range(CHANGE_ROUNDS):
        near = spacing * np.linspace(-1.0, 1.0, 2 * CHANGE_FINER + 1)
        around = np.clip(np.concatenate([at + near for at in change.region]), edges[0], edges[-1])
        term, change = best([term], np.unique(around))
        spacing /= CHANGE_FINER
    p_value = float(stats.chi2.sf(change.peak, 1)) * len(terms) * math.comb(CHANGE_EDGES, 2)
    (there,) = regions([beside], frame, ChangedSchedule(of=term.name), np.array(change.region), most=1)
    if p_value > CHANGE_CHANCE or not there or stats.chi2.sf(there[0].peak, 1) > CHANGE_CHANCE:
        return None
    (value,), mach = change.estimate.tolist(), np.interp(change.region, motion.time, motion.mach)
    return LocalChange(
        term=term.name,
        units=term.units,
        start_s=change.region[0],
        stop_s=change.region[1],
        mach=(float(mach.min()), float(mach.max())) if np.all(np.isfinite(mach)) else None,
        value=value,
        std_error=float(abs(there[0].estimate[0])) / math.sqrt(there[0].peak),
        f_ratio=change.peak,
        p_value=min(p_value, 1.0),
    )


def find_differences(
    own: Evidence, terms: Sequence[TermEstimate], fixed: FloatArray, covariance: FloatArray
) -> tuple[Difference, ...]:
    """The fewest frozen coefficients whose release improves the agreement as much as any, one at least, surest first.
    `terms` are those of all columns, `fixed` (columns,) frozen values, NaN where there is none, `covariance` theirs.
    """
    known = np.flatnonzero(~np.isnan(fixed))
    # A drift is by one flight's time or speed.
    lasting = [k for k, j in enumerate(known.tolist()) if " drift " not in terms[j].name]
    known, covariance = known[lasting], covariance[np.ix_(lasting, lasting)]
    whole = own.covariance[np.ix_(known, known)] + covariance
    sigmas = np.sqrt(np.diag(whole))
    inverse = np.linalg.pinv(whole / np.outer(sigmas, sigmas), rcond=_KNOWN, hermitian=True)
    weighed = inverse @ ((own.values[known] - fixed[known]) / sigmas)

    def improvement(released: Sequence[int]) -> float:
        """Fall of chi squared by the release of some, the others within their errors."""
        some = list(released)
        return float(weighed[some] @ np.linalg.pinv(inverse[np.ix_(some, some)], rcond=_KNOWN) @ weighed[some])

    sizes = range(1, min(CHANGED_TOGETHER, known.size) + 1)
    best = [max(itertools.combinations(range(known.size), size), key=improvement) for size in sizes]
    falls = np.diff([0.0, *map(improvement, best)])
    # A second one has to be as sure as what is told apart elsewhere: where one is far off, others err to second order.
    more = falls[1:] > 2.0 * SPECIFIC
    surely = int(np.argmin([*(known.size * stats.chi2.sf(falls[:1], 1) < REFUSED), *more, False]))
    chosen = [] if not best else list(best[max(surely - 1, 0)])
    errors = np.linalg.pinv(inverse[np.ix_(chosen, chosen)], rcond=_KNOWN)
    values, scales, found = errors @ weighed[chosen], np.sqrt(np.diag(errors)), []
    for place, k in enumerate(chosen):
        others, term = [j for j in chosen if j != k], terms[known[k]]
        equal = improvement(chosen) - 2.0 * SPECIFIC
        like = [j for j in range(known.size) if j not in chosen and improvement([*others, j]) > equal]
        chance = 2.0 * known.size * float(stats.norm.sf(abs(values[place]) / scales[place]))
        found.append(
            Difference(
                term=term.name,
                mechanism=term.mechanism,
                units=term.units,
                frozen=float(fixed[known[k]]),
                value=float(values[place] * sigmas[k]),
                std_error=float(scales[place] * sigmas[k]),
                p_value=min(1.0, chance),
                beside_processes=bool(own.rows.groups),
                alternatives=tuple(terms[known[j]].name for j in like) if chance < REFUSED else (),
            )
        )
    return tuple(sorted(found, key=lambda each: -abs(each.value / each.std_error)))
