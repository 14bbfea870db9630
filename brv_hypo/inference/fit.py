"""Fits one hypothesis: the best subset of its columns, then delays and knots as continuous parameters."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from brv_hypo.arrays import ComplexArray, FloatArray
from brv_hypo.inference import refinement
from brv_hypo.inference.problem import Problem
from brv_hypo.inference.reduced import Reduced
from brv_hypo.inference.refinement import ROUGH, Refined, Steps
from brv_hypo.inference.search import choices, extended, on_grid
from brv_hypo.linearisation.frame import RateFrame
from brv_hypo.linearisation.linear import covariance_of
from brv_hypo.linearisation.nuisance import Errors
from brv_hypo.mechanisms.contract import Mechanism
from brv_hypo.model.term import Regressor

# Bound the time; held by `tests.studies.independent.study`.
SEARCH_PATIENCE = 2  # sizes that may go by without a gain before the search over sizes ends
SEARCH_OUT_OF_REACH = 400.0  # of 2 ln L behind another hypothesis, from which a search ends
SEARCH_SIZES_TRIED = 3  # before that
SEARCH_GAIN = ROUGH.gain  # of 2 ln L by which one model has to beat another: more than steps and rounding leave
SEARCH_EQUAL = 1e-3  # of 2 ln L, within which the first that was found is taken
CONSISTENT_ROUNDS = 4  # refits in which C_mw and what follows it come to agree
_NEIGHBOURS = 1.5  # of the knots' spacing, within which two changes may bracket one


@dataclass(frozen=True)
class LeftOut:
    """An estimate without each of some stretches: `changes` (stretches, k), more covariance (stretches, k, k)."""

    changes: FloatArray
    growths: FloatArray

    def scatter(self, rows: FloatArray) -> FloatArray:
        """Of linear functions (functions, k): their rms change over that which their growing errors allow, 1 at least.
        More than 1 is lack of fit: stretches of time differ in what they say. Variances so scaled are those of the
        jackknife (Efron and Stein, Ann. Statist. 9, 1981) where stretches count alike; what one stretch alone
        determines scatters no more than its prior allows.
        """
        actual = np.sum((self.changes @ rows.T) ** 2, axis=0)
        allowed = np.einsum("fi,sij,fj->f", rows, self.growths, rows)
        return np.asarray(np.sqrt(np.maximum(actual / np.maximum(allowed, 1e-300), 1.0)), dtype=float)


@dataclass(frozen=True)
class HypothesisFit:
    """A fitted hypothesis in the whitened frame. `columns` are the baseline's and then the selected ones; `values` and
    `covariance` belong to them. `residual` (rows,) is whitened; `searched` counts the choices. `nonlinear` are the
    delays and knots; `joint_covariance`, of values and then those, is empty until errors are known: of the regression
    by `with_errors`, beside processes by `comparison.judgement`, which replaces values too; `residual` and what follows
    from it stay those of the regression. `bound_cost` is the fall of 2 ln L where coefficients are held within their
    mechanism's bounds; `left_out`, of values and then delays and knots, is known beside processes.
    """

    name: str
    mechanisms: tuple[Mechanism, ...]
    frame: RateFrame
    columns: tuple[Regressor, ...]
    baseline_size: int
    values: FloatArray
    residual: FloatArray
    samples: int
    efficiency: float
    searched: int
    nonlinear: tuple[refinement.Nonlinear, ...] = ()
    joint_covariance: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))
    bound_cost: float = 0.0
    left_out: LeftOut | None = None
    log_evidence: float | None = None
    """Beside processes, over that of the baseline only, as it counts; None before they are known."""
    ends: bool = False  # whether nothing remains of the mechanism after each of its `regions`

    @property
    def covariance(self) -> FloatArray:
        """Covariance of the coefficients, delays and knots free (columns, columns)."""
        return self.covariance_of(np.eye(self.values.size, self.joint_covariance.shape[0]))

    def covariance_of(self, rows: FloatArray) -> FloatArray:
        """That of linear functions (functions, k) of coefficients, delays and knots, no less than they scatter."""
        size = np.ones(rows.shape[0]) if self.left_out is None else self.left_out.scatter(rows)
        return np.asarray(np.outer(size, size) * (rows @ self.joint_covariance @ rows.T), dtype=float)

    @property
    def nonlinear_errors(self) -> tuple[float, ...]:
        """Standard errors of delays and knots, s."""
        rows = np.eye(self.joint_covariance.shape[0])[self.values.size :]
        variances = np.diag(self.covariance_of(rows))
        return tuple(np.sqrt(np.maximum(variances, 0.0)).tolist())

    @property
    def rss(self) -> float:
        """Residual sum of squares of the whitened rows."""
        return float(self.residual @ self.residual)

    @property
    def selected(self) -> tuple[Regressor, ...]:
        """The mechanism's columns."""
        return self.columns[self.baseline_size :]

    @property
    def regions(self) -> tuple[tuple[tuple[int, ...], ...], ...]:
        """Of each region of a mechanism that ends, the places among the selected columns of where each coefficient
        begins and of where it ends: changes of one are, as they were added, the one and the other in turn.
        """
        changes = dict[tuple[str, int | None], list[int]]()
        for place, column in enumerate(self.selected):
            changes.setdefault((column.term, column.flight), []).append(place)
        count = max(((len(places) + 1) // 2 for places in changes.values()), default=0)
        pairs = ((tuple(places[2 * k : 2 * k + 2]) for places in changes.values()) for k in range(count))
        return tuple(tuple(filter(None, each)) for each in pairs)

    @property
    def following(self) -> frozenset[str]:
        """Mechanisms that may be made of C_mw: those with parameters of their own."""
        return frozenset(mechanism.name for mechanism in self.mechanisms if mechanism.parameters())

    @property
    def estimated(self) -> list[int]:
        """Places of the columns that are estimated by themselves: not where regions of a mechanism end."""
        begin = [pair[0] for region in self.regions for pair in region] if self.ends else range(len(self.selected))
        return [*range(self.baseline_size), *(self.baseline_size + k for k in begin)]

    def acts(self, place: int, time: float) -> bool:
        """Whether anything is of a selected coefficient at a time, s."""
        pairs = (pair for region in self.regions for pair in region if place in pair) if self.ends else ()
        starts = [self.selected[k].time_basis.start for pair in pairs for k in pair]
        return len(starts) < 2 or starts[0] <= time < starts[1]

    @property
    def parameters(self) -> int:
        """Linear coefficients and delays that were fitted."""
        return len(self.columns) + sum(parameter.kind == "theta" for parameter in self.nonlinear)

    @property
    def effective(self) -> float:
        """Effective number of samples."""
        return self.samples * self.efficiency

    @property
    def information(self) -> float:
        """What hypotheses are ranked by, the less the better: -2 log evidence where it is known, else the BIC."""
        return self.bic if self.log_evidence is None else self.bound_cost - 2.0 * self.log_evidence

    @property
    def bic(self) -> float:
        """Extended BIC (Chen and Chen 2008): n_e ln(RSS / n) + k ln n_e + 2 ln C(searched, chosen), n_e effective."""
        chosen, n = len({column.choice for column in self.selected}), self.effective
        choices = math.lgamma(self.searched + 1) - math.lgamma(chosen + 1)
        choices -= math.lgamma(max(self.searched - chosen, 0) + 1)
        misfit = n * math.log(max(self.rss, 1e-300) / self.samples)
        return self.bound_cost + misfit + self.parameters * math.log(n) + 2.0 * choices


def fit_hypothesis(
    problem: Problem, name: str, mechanisms: tuple[Mechanism, ...], best_rival: float = math.inf
) -> HypothesisFit:
    """Search, refine and fit one hypothesis; the empty tuple of mechanisms is the null hypothesis. The best subset of
    each size on the grid of knots and delays is refined, and so is the best model so far with the best further term;
    the least extended BIC after refinement decides. Two changes that bracket one are joined where that is likelier. A
    hypothesis keeps at least one term, unless the data determine none. Its search ends early where it stays far behind
    `best_rival`, the least criterion of the others so far.
    """
    if not mechanisms:
        return solved(Reduced(problem, problem.frame), name, (), problem.baseline, 0)
    frame, offered, of_sizes = on_grid(problem, mechanisms)
    start = Reduced(problem, frame)
    empty = solved(start, name, mechanisms, problem.baseline, choices(offered))

    def settle(
        chosen: tuple[Regressor, ...], known: tuple[Regressor, ...] = (), parts: Sequence[float] = (1.0,)
    ) -> HypothesisFit:
        return refined_fit(problem, empty, (*problem.baseline, *chosen), known, reduced=start, parts=parts)

    best: HypothesisFit | None = None
    worse = 0
    for size in range(1, problem.max_terms + 1):
        starts = [settle(of_sizes[size][1])] if size in of_sizes else []
        if best is not None:
            further = extended(problem, best.frame, best.columns, mechanisms, offered)
            starts.extend([settle(further, best.selected)] if further else [])
        if not starts:
            continue
        challenger = likeliest(starts)
        if best is None or challenger.information < best.information - SEARCH_GAIN:
            best, worse = challenger, 0
        else:
            worse += 1
        behind = size >= SEARCH_SIZES_TRIED and best.information > best_rival + SEARCH_OUT_OF_REACH
        if worse == SEARCH_PATIENCE or behind:
            break
    while best is not None:
        present = best
        fewer = joined(present.selected, present.values[present.baseline_size :], problem.knots)
        best = likeliest([present, *(settle(columns, present.selected) for columns in fewer)])
        if not best.information < present.information - SEARCH_GAIN:
            return likeliest([present, settle(present.selected, parts=refinement.CLOSELY)])
    return empty


def joined(selected: Sequence[Regressor], values: FloatArray, knots: FloatArray) -> list[tuple[Regressor, ...]]:
    """The columns with two like changes at neighbouring knots of the grid as one between them, pair by pair."""
    apart = _NEIGHBOURS * float(np.min(np.diff(knots))) if knots.size > 1 else 0.0
    jumps = sorted({c.time_basis for c in selected if c.time_basis.kind == "jump"}, key=lambda basis: basis.start)
    sized = [
        (basis, {(c.term, c.theta): v for c, v in zip(selected, values, strict=False) if c.time_basis == basis})
        for basis in jumps
    ]
    found = []
    for (early, first), (late, second) in pairwise(sized):
        size, other = (float(np.linalg.norm(list(each.values()))) for each in (first, second))
        like = first.keys() == second.keys() and sum(first[key] * second[key] for key in first) > 0.0
        if like and late.start - early.start < apart:
            between = replace(early, start=(size * early.start + other * late.start) / (size + other))
            at = {early: between, late: between}
            columns = (c.at(c.theta, at.get(c.time_basis, c.time_basis)) for c in selected)
            found.append(tuple(dict.fromkeys(columns)))
    return found


def renewed(problem: Problem, fit: HypothesisFit, steps: Steps) -> HypothesisFit:
    """The same columns, in time order (what is scanned first, not what was found first), under the problem's noise."""
    ordered = sorted(fit.selected, key=lambda column: (column.time_basis.start, column.mechanism, column.theta))
    return refined_fit(problem, fit, (*problem.baseline, *ordered), fit.selected, steps)


def all_renewed(problem: Problem, fits: Sequence[HypothesisFit]) -> list[HypothesisFit]:
    """The fits where the problem is linear, knots and delays there; those out of reach keep theirs."""
    here = (replace(fit, frame=problem.frame.with_mechanisms(fit.mechanisms)) for fit in fits)
    there = [renewed(problem, fit, Steps(0, 0.0)) for fit in here]
    first = likeliest(there)
    worst = first.information + SEARCH_OUT_OF_REACH
    return [
        renewed(problem, each, refinement.FINAL if each is first else ROUGH) if each.information <= worst else each
        for each in there
    ]


def self_consistent(problem: Problem, fit: HypothesisFit) -> HypothesisFit:
    """The same refitted until what lags or sticks follows the static moment C_mw that the fit itself finds."""
    for _ in range(CONSISTENT_ROUNDS if fit.following else 1):
        fit = renewed(problem, fit, refinement.FINAL)
    return fit


def refined_fit(
    problem: Problem,
    fit: HypothesisFit,
    columns: tuple[Regressor, ...],
    known: tuple[Regressor, ...],
    steps: Steps = ROUGH,
    reduced: Reduced | None = None,
    parts: Sequence[float] = (1.0,),
) -> HypothesisFit:
    """The hypothesis of a fit with other columns, the baseline's first, refined; those `known` are not scanned, others
    over `parts` of their bounds. C_mw is brought up to date where it is used. `reduced`: of the fit's frame.
    """
    reduced = Reduced(problem, fit.frame) if reduced is None else reduced
    if fit.following:
        values = solved(reduced, fit.name, fit.mechanisms, columns, fit.searched).values
        reduced = Reduced(problem, reduced.frame.with_in_plane_moment(columns, values))
    if not problem.refine:
        return solved(reduced, fit.name, fit.mechanisms, columns, fit.searched)
    selected = columns[len(problem.baseline) :]
    parameters = refinement.nonlinear_parameters(selected, reduced.frame, problem.knots)
    fresh = frozenset(j for j, column in enumerate(selected) if column not in known)
    refined = refinement.refine(selected, parameters, fresh, reduced, steps, parts)
    return _hypothesis(reduced, fit.name, fit.mechanisms, refined, fit.searched)


def likeliest(fits: Sequence[HypothesisFit]) -> HypothesisFit:
    """The fit of the least criterion; of those that are tied that of the fewest mechanisms, the first."""
    found = [fit.information for fit in fits]
    least = min(found)
    equal = [fit for fit, own in zip(fits, found, strict=True) if not own > least + SEARCH_EQUAL]
    return min(equal, key=lambda fit: len(fit.mechanisms))


def solved(
    reduced: Reduced, name: str, mechanisms: tuple[Mechanism, ...], columns: tuple[Regressor, ...], searched: int
) -> HypothesisFit:
    """The hypothesis with just these columns, the baseline's first, least squares alone."""
    selected = columns[len(reduced.problem.baseline) :]
    batch = reduced.batch(selected)
    return _hypothesis(reduced, name, mechanisms, Refined((), selected, batch, reduced.fit(batch)), searched)


def _hypothesis(
    reduced: Reduced, name: str, mechanisms: tuple[Mechanism, ...], found: Refined, searched: int
) -> HypothesisFit:
    """The hypothesis that selected columns with their fit make beside the baseline."""
    problem, batch, values = reduced.problem, found.batch, found.fitted.values
    return HypothesisFit(
        name,
        mechanisms,
        reduced.frame,
        (*problem.baseline, *found.columns),
        len(problem.baseline),
        reduced.with_baseline(batch, values),
        reduced.residual(batch, values),
        problem.samples,
        problem.efficiency,
        searched,
        found.nonlinear,
    )


# ---- What a fit says beside its coefficients ----


def with_errors(problem: Problem, fit: HypothesisFit) -> HypothesisFit:
    """The fit with the uncertainty of coefficients, delays and knots at the problem's effective sample size."""
    design = problem.design(fit.frame, fit.columns)
    if fit.nonlinear:
        slopes = refinement.prediction_slopes(fit.nonlinear, fit.selected, fit.values[fit.baseline_size :], fit.frame)
        design = np.column_stack([design, problem.rows.projected(problem.rows.of_moments(slopes))])
    covariance = covariance_of(design, fit.residual, problem.samples, problem.efficiency)
    return replace(fit, efficiency=problem.efficiency, joint_covariance=covariance)


@dataclass(frozen=True)
class Regressed:
    """Errors of every flight: `applied` as corrections of its record before, `found` in all; one mapping each. `rates`
    (rows,) rad/s are the de-rolled rates as they follow from coefficients and errors.
    """

    applied: tuple[Errors, ...]
    found: tuple[Errors, ...]
    rates: ComplexArray

    @classmethod
    def of(cls, problem: Problem, fit: HypothesisFit) -> Regressed:
        """What a fit says, with the nuisances that go with its coefficients."""
        frame, columns, values = fit.frame, fit.columns, fit.values
        others = problem.others_beside(frame, columns, values)
        nuisances, flights = problem.rows.nuisances, len(problem.records)
        return cls(
            nuisances.values(np.zeros(others.size), flights),
            nuisances.values(others, flights),
            problem.frame.observed - problem.left(frame, columns, values, others).rates,
        )
