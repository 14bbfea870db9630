"""What may be added to a model, every candidate fitted beside it."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy import stats

from brv_hypo.arrays import FloatArray
from brv_hypo.constants import CONFOUNDED_COSINE, CONFOUNDED_GAIN, CONFOUNDED_NEAR, RECORD_EFFECT_LARGEST
from brv_hypo.mechanisms.contract import Component, Mechanism, RecordEffect
from brv_hypo.model.term import Regressor, Theta, candidates, default_knots, theta_grid
from brv_hypo.ranking.intervals import intervals, within_bounds
from brv_hypo.regression.fit import HypothesisFit, fit_hypothesis, likeliest
from brv_hypo.regression.frame import RateFrame
from brv_hypo.regression.linear import lengths, solve_scaled
from brv_hypo.regression.problem import Problem, given_column
from brv_hypo.regression.refinement import nonlinear_parameters
from brv_hypo.regression.uncertainty import with_errors
from brv_hypo.thresholds import SPECIFIC

Kind = Literal["mechanism", "instrument", "environment", "discovered"]


@dataclass(frozen=True)
class Candidate:
    """One effect as fitted: `gain` is the fall of the extended BIC, `p_value` is paid for its own search.

    `explains` is the share of the weighed squares that it saves, `fall` their fall in effective samples.
    `contribution` (rows,) is what it adds to the prediction beyond what the model could take over, `in_rates` the fall
    of the whitened rates' squares. `evidence` is the log evidence that it gains beside all processes, nats; None where
    that was not asked.
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
    effect: RecordEffect | None = None
    evidence: float | None = None


def try_mechanism(problem: Problem, sharp: Problem, null: HypothesisFit, mechanism: Mechanism) -> Candidate | None:
    """A mechanism's columns beside the model; None if it adds none.

    On one flight as `compare` searches them, under the record's own noise (`sharp`): where much of the residual is the
    effect, a noise raised to it hides delays and knots. On several flights the best ones on the grids.
    """
    if len(problem.records) == 1:
        found = fit_hypothesis(sharp, mechanism.name, (mechanism,))
        fits = [_solved_again(problem, found)] if found.selected else []
    else:
        fits = _on_grid(problem, mechanism)
    return candidate_of(problem, null, likeliest(fits), mechanism.name, "mechanism") if fits else None


def bounded(problem: Problem, fit: HypothesisFit) -> HypothesisFit:
    """The fit with what it would lose by values that a body may have, all where they are absurd.

    Of several flights, whose values differ, as it is.
    """
    if len(problem.records) > 1 or not any(mechanism.bounds for mechanism in fit.mechanisms):
        return fit
    fit = with_errors(problem, replace(fit, bound_cost=0.0))
    return replace(fit, bound_cost=math.inf) if _absurd(fit) else within_bounds(fit)


def _absurd(fit: HypothesisFit) -> bool:
    """Whether a value lies outside its bounds by more than these are wide, however little the data tell of it."""
    bounds = {m.name: m.bounds for m in fit.mechanisms}
    values = [(net.value, bounds[net.mechanism].get(net.term)) for each in intervals(fit) for net in each.values]
    return any(max(limits[0] - value, value - limits[1]) > limits[1] - limits[0] for value, limits in values if limits)


def _on_grid(problem: Problem, mechanism: Mechanism) -> list[HypothesisFit]:
    frame = problem.frame.with_mechanisms([mechanism])
    offered = _offers(problem, frame, mechanism)
    searched = len({column for offer in offered for column in offer})
    own = mechanism.name, (mechanism,), frame
    return [fit for offer in offered for fit in forward(problem, *own, groups_of(offer), searched)]


@dataclass(frozen=True)
class Variant:
    """A record effect as it may be set; `histories` map the name of each to its flight and its component."""

    effect: RecordEffect
    histories: Mapping[str, tuple[int, Component]]


def try_record_effect(problem: Problem, null: HypothesisFit, variants: Sequence[Variant]) -> Candidate | None:
    """A record effect's best components, at its best variant; None where only absurd sizes fit."""
    searched = sum(len(variant.histories) for variant in variants)
    found: list[tuple[HypothesisFit, RecordEffect]] = []
    for variant in variants:
        bounds = {name: RECORD_EFFECT_LARGEST * component.size for name, (_, component) in variant.histories.items()}
        groups = [(given_column(name, c.units),) for name, (_, c) in variant.histories.items()]
        fits = forward(problem, variant.effect.name, (), problem.frame, groups, searched)
        found.extend((fit, variant.effect) for fit in fits if _plausible(fit, bounds))
    if not found:
        return None
    fit, effect = min(found, key=lambda pair: pair[0].information)
    return replace(candidate_of(problem, null, fit, effect.name, effect.kind), effect=effect)


def fitted_again(problem: Problem, null: HypothesisFit, candidate: Candidate) -> Candidate:
    """A candidate with its columns as they are, under the problem's noise."""
    again = candidate_of(problem, null, _solved_again(problem, candidate.fit), candidate.name, candidate.kind)
    return replace(again, effect=candidate.effect)


def _solved_again(problem: Problem, fit: HypothesisFit) -> HypothesisFit:
    found = solved(problem, fit.name, fit.mechanisms, fit.frame, fit.selected, fit.searched)
    return replace(found, nonlinear=fit.nonlinear)


def with_columns(
    problem: Problem, null: HypothesisFit, candidate: Candidate, columns: tuple[Regressor, ...]
) -> Candidate:
    """A candidate with other columns."""
    every = (*problem.baseline, *columns)
    nonlinear = nonlinear_parameters(every, len(problem.baseline), candidate.fit.frame, problem.knots)
    return fitted_again(
        problem, null, replace(candidate, fit=replace(candidate.fit, columns=every, nonlinear=nonlinear))
    )


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
    left = problem.response - basis @ (basis.T @ problem.response)
    free = design - basis @ (basis.T @ design)
    least = 1e-6 * lengths(design)
    chosen: list[int] = []
    found: list[HypothesisFit] = []
    while len(chosen) < len(groups) and sum(len(groups[i]) for i in chosen) < problem.max_terms:
        gains = [
            _gain(free[:, a:b], left, least[a:b]) if i not in chosen else -1.0
            for i, (a, b) in enumerate(itertools.pairwise(ends))
        ]
        best = int(np.argmax(gains))
        if gains[best] <= 0.0:
            break
        chosen.append(best)
        own = np.linalg.qr(free[:, ends[best] : ends[best + 1]])[0]
        left = left - own @ (own.T @ left)
        free = free - own @ (own.T @ free)
        columns = tuple(column for i in chosen for column in groups[i])
        own_columns = [design[:, ends[i] : ends[i + 1]] for i in chosen]
        whole = np.column_stack([baseline, *own_columns])
        found.append(solved(problem, name, mechanisms, frame, columns, searched, whole))
    return found


def _gain(columns: FloatArray, left: FloatArray, least: FloatArray) -> float:
    """Fall of the residual sum of squares by a group of columns; none where they are spent."""
    if np.any(np.linalg.norm(columns, axis=0) <= least):
        return 0.0
    return float(np.sum((np.linalg.qr(columns)[0].T @ left) ** 2))


def _offers(problem: Problem, frame: RateFrame, mechanism: Mechanism) -> list[tuple[Regressor, ...]]:
    """The mechanism's columns: one set, or one for each theta where one theta at a time is allowed."""
    grid = theta_grid(mechanism)
    together = [grid] if mechanism.several_parameters_at_once else [(theta,) for theta in grid]
    return [_offered(problem, frame, mechanism, thetas) for thetas in together]


def _offered(
    problem: Problem, frame: RateFrame, mechanism: Mechanism, thetas: Sequence[Theta]
) -> tuple[Regressor, ...]:
    """The columns at these thetas: those that follow the motion are shared by all flights, those that follow time or
    belong to the vehicle are of each flight that has none yet.
    """
    own = mechanism.of_each_flight(frame.reconstructions[0].flight)
    shared = () if own else candidates(mechanism, frame.motions[0], np.zeros(0), thetas)
    with_own = {column.flight for column in problem.baseline if column.mechanism == mechanism.name}
    return shared + tuple(
        replace(column, flight=number)
        for number, motion in enumerate(frame.motions)
        if number not in with_own
        for column in candidates(mechanism, motion, _knots(problem, frame, mechanism, number), thetas)
        if own or column.time_basis.kind != "constant"
    )


def _knots(problem: Problem, frame: RateFrame, mechanism: Mechanism, number: int) -> FloatArray:
    """Times (s) at which coefficients may change on one flight."""
    own = mechanism.knots(frame.motions[number])
    if own is not None:
        return own
    time = frame.motions[number].time
    return default_knots(float(time[0]), float(time[-1]), problem.knots.size)


def groups_of(columns: Sequence[Regressor]) -> list[tuple[Regressor, ...]]:
    """Columns that enter together."""
    found: dict[object, list[Regressor]] = {}
    for column in columns:
        found.setdefault(column.choice, []).append(column)
    return [tuple(group) for group in found.values()]


def _plausible(fit: HypothesisFit, bounds: Mapping[str, float]) -> bool:
    """Whether no component is larger than what it is of can be: the record would explain itself away."""
    values = fit.values[fit.baseline_size :]
    return all(abs(value) <= bounds[column.term] for column, value in zip(fit.selected, values, strict=True))


def solved(
    problem: Problem,
    name: str,
    mechanisms: tuple[Mechanism, ...],
    frame: RateFrame,
    chosen: tuple[Regressor, ...],
    searched: int,
    design: FloatArray | None = None,
) -> HypothesisFit:
    """The model with these columns beside it; `design` (rows, columns) where all of them are at hand."""
    columns = (*problem.baseline, *chosen)
    design = problem.design(frame, columns) if design is None else design
    values = solve_scaled(design, problem.response)
    return HypothesisFit(
        name,
        mechanisms,
        frame,
        columns,
        len(problem.baseline),
        values,
        problem.response - design @ values,
        problem.samples,
        problem.efficiency,
        searched,
    )


def candidate_of(problem: Problem, null: HypothesisFit, fit: HypothesisFit, name: str, kind: Kind) -> Candidate:
    """A fit as a candidate: its F-ratio, its p-value with all that was searched, what it saves within its bounds."""
    fit = bounded(problem, fit)
    extra = fit.parameters - null.parameters
    left = fit.samples - fit.parameters
    f_ratio = max((null.rss - fit.rss) / extra, 0.0) / (fit.rss / left)
    chance = float(stats.f.sf(f_ratio * fit.efficiency, extra, max(fit.effective - fit.parameters, 1.0)))
    chosen = len({column.choice for column in fit.selected})
    choices = math.comb(fit.searched, min(chosen, fit.searched))
    return Candidate(
        name=name,
        kind=kind,
        fit=fit,
        gain=null.information - fit.information,
        f_ratio=f_ratio,
        p_value=min(chance * choices, 1.0),
        contribution=null.residual - fit.residual,
        in_rates=_fall(problem, null, fit),
        fall=f_ratio * extra * fit.efficiency,
        explains=1.0 - fit.rss / null.rss,
    )


def _fall(problem: Problem, null: HypothesisFit, fit: HypothesisFit) -> float:
    """Fall of the squared residual of the rates, at the noise that the fit leaves."""
    rates = slice(0, problem.rows.rates)
    before, after = null.residual[rates], fit.residual[rates]
    return float((before @ before - after @ after) / (fit.rss / fit.samples))


def adjusted(tried: Sequence[Candidate]) -> dict[str, float]:
    """p-values adjusted for the number of candidates (Holm, Scand. J. Statist. 6:65, 1979)."""
    order = sorted(tried, key=lambda candidate: candidate.p_value)
    found: dict[str, float] = {}
    running = 0.0
    for rank, candidate in enumerate(order):
        running = max(running, min((len(order) - rank) * candidate.p_value, 1.0))
        found[candidate.name] = running
    return found


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
