"""A candidate: one effect as fitted beside a model, with its F-ratio and what its search costs.

`candidate_of` makes one of a fit. Candidates are ordered by what they explain and by the log evidence that they gain
beside all processes (`ranked`); `confounded` are those that a flight cannot tell apart.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from scipy import stats

from brv_hypo.arrays import FloatArray
from brv_hypo.comparison.intervals import intervals, within_bounds
from brv_hypo.constants import CONFOUNDED_COSINE, CONFOUNDED_GAIN, CONFOUNDED_NEAR, LOOP_SCHEDULE
from brv_hypo.inference.fit import HypothesisFit, solved
from brv_hypo.inference.problem import Problem
from brv_hypo.inference.reduced import Reduced
from brv_hypo.inference.refinement import nonlinear_parameters
from brv_hypo.inference.uncertainty import with_errors
from brv_hypo.linearisation.channels import Rows
from brv_hypo.mechanisms.contract import Component, RecordEffect
from brv_hypo.mechanisms.yaml_mechanism import MechanismFile
from brv_hypo.model.term import Regressor
from brv_hypo.thresholds import SPECIFIC
from brv_hypo.tracing.result import Kind


class History(NamedTuple):
    """What one typical size of a component of a record effect makes of a flight; `rows` (frame rows,)."""

    flight: int
    component: Component
    effect: RecordEffect
    rows: Rows


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


def fitted_again(
    problem: Problem, null: HypothesisFit, candidate: Candidate, columns: tuple[Regressor, ...] | None = None
) -> Candidate:
    """A candidate under the problem's noise, with its own columns or with others."""
    fit = solved_again(problem, candidate.fit, columns)
    return candidate_of(problem, null, fit, candidate.kind, candidate.variant, candidate.file)


def solved_again(problem: Problem, fit: HypothesisFit, columns: tuple[Regressor, ...] | None = None) -> HypothesisFit:
    """A fit under the problem's noise, with its own columns or with others."""
    every = (*problem.baseline, *(fit.selected if columns is None else columns))
    found = solved(Reduced(problem, fit.frame), fit.name, fit.mechanisms, every, fit.searched)
    if columns is None:
        return replace(found, nonlinear=fit.nonlinear)
    return replace(found, nonlinear=nonlinear_parameters(every, found.baseline_size, fit.frame, problem.knots))


def adjusted(tried: Sequence[Candidate]) -> dict[str, float]:
    """p-values adjusted for the number of candidates (Holm, Scand. J. Statist. 6:65, 1979)."""
    found: dict[str, float] = {}
    running = 0.0
    for rank, candidate in enumerate(sorted(tried, key=lambda candidate: candidate.p_value)):
        running = max(running, min((len(tried) - rank) * candidate.p_value, 1.0))
        found[candidate.name] = running
    return found


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
