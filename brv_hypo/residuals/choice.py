"""Which effect is added: the best that counts in the fitted part and that the held-out part agrees with."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from brv_hypo.constants import (
    CONFOUNDED_NEAR,
    HELD_OUT_SIGMAS,
    HELD_OUT_WORSE,
    HINT_REPEATED,
    LOOP_BEYOND_DOUBT,
    LOOP_DETECTED,
    LOOP_IN_ITS_PLACE,
    LOOP_SCHEDULE,
    LOOP_TRIES,
)
from brv_hypo.regression.channels import Rows
from brv_hypo.regression.uncertainty import residual_moments
from brv_hypo.residuals.candidates import Candidate, adjusted, confounded, nearly_equal
from brv_hypo.residuals.candidates_at_step import Analysis
from brv_hypo.residuals.discover import Discovery
from brv_hypo.residuals.fitted_model import State
from brv_hypo.residuals.judge import Agreement, Prediction, agreement, force_errors, moment_errors, ratio, residuals_of
from brv_hypo.residuals.problem import is_carried, left_by, left_without
from brv_hypo.thresholds import SPECIFIC


@dataclass(frozen=True)
class Tried:
    """What an effect did to the held-out part: `agreement` in both channels, `ratio` of the moments' mean
    squares, `force` the mean squares (m/s^2)^2 of the specific force's errors, fitted and held out. `certain` says that
    the fitted part leaves no doubt of it, `carried` that every fit has it within its tolerance.

    `before` (frame rows,) is what the model leaves without the effect, and `errors_before` its moment errors, fitted
    and held out: an effect with a tolerance is then held at zero, though every other fit has it within its tolerance.
    """

    candidate: Candidate
    state: State
    agreement: Agreement
    ratio: float
    ratio_error: float
    force: tuple[float, float]
    before: Rows
    errors_before: tuple[Prediction, Prediction]
    certain: bool
    carried: bool
    gain: float | None = None
    """Of the log evidence beside all processes or, up to none, in the place of its family's; None if not known."""
    of_majority: bool = True
    """Whether it is of the family of processes that explains most of the residual, if one does."""

    @property
    def accepted(self) -> bool:
        """Whether the held-out part agrees, and processes do not explain the record far better, or better at all.

        What the evidence does not want beside them is refused where another family explains most of the residual.
        """
        least = 0.0 if self.carried else -SPECIFIC
        if self.gain is None:
            return self.agrees
        may_be_named = self.of_majority or self.gain >= SPECIFIC or self.candidate.kind == "discovered"
        return self.agrees and self.gain > least and may_be_named

    @property
    def agrees(self) -> bool:
        """Whether the held-out part agrees.

        The moments' error has to fall, unless the fitted part leaves no doubt; an error of the record may show in the
        specific force alone. Then it must not make the moments significantly worse. What every fit holds within its
        tolerance has nothing to predict that others within theirs could not: that it must be larger is asked of the
        fitted part alone. Worse by less than noise scatters such an error is not worse: the record is read anew with
        the effect taken out, which the stretches' own scatter does not know of.
        """
        no_worse = self.ratio < 1.0 + max(HELD_OUT_WORSE * self.ratio_error, self.errors_before[1].scatter)
        if self.carried:
            return no_worse
        if self.certain:
            return self.agreement.fall > 0.0 and self.agreement.shown >= HELD_OUT_SIGMAS and no_worse
        falls = self.ratio < 1.0 or (self.candidate.effect is not None and no_worse)
        return self.agreement.fall >= HELD_OUT_SIGMAS and falls


@dataclass(frozen=True)
class Choice:
    """The candidates, best first, and those that were tried on the held-out part, in order.

    `named_in`: the share of the repetitions that name the last of these, where the held-out part agrees with it.
    """

    ranked: tuple[Candidate, ...]
    discovery: Discovery | None
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
        """The candidates with the leading one first and its look-alikes after it."""
        if self.leading is None:
            return self.ranked
        leader = self.leading.candidate
        similar = confounded(leader, self.ranked)
        rank = {leader.name: 0, **dict.fromkeys(similar, 1)}
        return tuple(sorted(self.ranked, key=lambda candidate: rank.get(candidate.name, 2)))


def choose(
    here: Analysis,
    state: State,
    discovery: Discovery | None,
    significance: float,
    add: Callable[[Candidate], State],
    residual_is_white: bool = False,
    scheduled: bool = True,
    weighed: Callable[[State], tuple[float, bool]] | None = None,
) -> Choice:
    """Try the candidates that count on the held-out part, the best first, until one is taken.

    Those that predict what a refused one did are passed over: they cannot do better; nor can those that explain far
    less. Where the residual is white, what is not beyond doubt does not count: but an effect may still exceed the
    tolerance that every fit allows it. `scheduled` says that the model has a schedule by Mach number; `weighed`: what
    the last effect of a model gains beside all processes, and whether no other family explains most of the residual.
    """
    held = {column.mechanism for column in here.problem.baseline}
    ranked = tuple(_ranked(here, discovery, held))
    first = () if scheduled else schedules_first(ranked)
    ranked = (*first, *(candidate for candidate in ranked if candidate not in first))
    chances = adjusted(ranked)
    tried: list[Tried] = []
    for candidate in ranked:
        if candidate.gain <= 0.0 or candidate.fall < LOOP_DETECTED or chances[candidate.name] > significance:
            continue
        certain = chances[candidate.name] <= LOOP_BEYOND_DOUBT * significance
        if residual_is_white and not certain and not is_carried(here.problem, candidate.name):
            continue
        if any(nearly_equal(candidate, other.candidate) for other in tried if not other.agrees):
            continue
        if tried and candidate.gain < LOOP_IN_ITS_PLACE * tried[0].candidate.gain:
            break
        found = _try(here, state, candidate, certain, add)
        if found.agrees and weighed is not None:
            gain, of_majority = weighed(found.state)
            found = replace(found, gain=gain, of_majority=of_majority)
        tried.append(found)
        if tried[-1].accepted or len(tried) == LOOP_TRIES:
            break
    return Choice(ranked, discovery, tuple(tried))


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


def _try(here: Analysis, state: State, candidate: Candidate, certain: bool, add: Callable[[Candidate], State]) -> Tried:
    problem, data = here.problem, state.data
    after, errors, left = add(candidate), (state.errors, state.held_out), left_by(problem, here.null)
    carried = is_carried(problem, candidate.name)
    if carried:
        left = left_without(problem, here.null, candidate.name)
        moments = residual_moments(data.frame, problem.records, left.rates)
        errors = moment_errors(data.fitted, moments), moment_errors(data.held_out, moments)
    first = residuals_of(problem, data.held_out, left)
    second = residuals_of(problem, data.held_out, left_by(problem, candidate.fit))
    return Tried(
        candidate,
        after,
        agreement(problem, data.held_out, first, second),
        *ratio(errors[1], after.held_out),
        force_errors(problem, data.held_out, second),
        left,
        errors,
        certain,
        carried,
    )


def best_first(
    offered: Sequence[Candidate], evidences: Mapping[str, float]
) -> Callable[[Candidate], tuple[float, float]]:
    """The order of candidates, the leader least: of those that the evidence cannot tell apart, what explains most.

    Beside processes, which describe any smooth course, evidences of several may differ by less than `SPECIFIC`.
    """
    most = max((evidences[each.name] for each in offered if each.name in evidences), default=-np.inf)
    equal = {name for name, own in evidences.items() if own > most - SPECIFIC}
    return lambda each: (-np.inf if each.name in equal else -evidences.get(each.name, -np.inf), -each.gain)


def _ranked(here: Analysis, discovery: Discovery | None, held: Collection[str] = ()) -> list[Candidate]:
    """The candidates, the leader first.

    The rest of an effect that the model has is that effect, described better: another has to beat it clearly. So has a
    description in generic terms a name.
    """
    evidences = {each.name: each.evidence for each in here.candidates if each.evidence is not None}
    order = best_first(here.candidates, evidences)
    better = dict.fromkeys(held, CONFOUNDED_NEAR)
    ranked = sorted(here.candidates, key=lambda each: (order(each)[0], order(each)[1] - better.get(each.name, 0.0)))
    if discovery is None:
        return ranked
    described = discovery.candidate
    place = next((k for k, candidate in enumerate(ranked) if _gives_way(candidate, described)), len(ranked))
    return [*ranked[:place], described, *ranked[place:]]


def _gives_way(candidate: Candidate, described: Candidate) -> bool:
    """Whether a description in generic terms comes before the candidate."""
    if candidate.evidence is not None and described.evidence is not None:
        return described.evidence - candidate.evidence >= SPECIFIC
    return described.gain - candidate.gain >= CONFOUNDED_NEAR
