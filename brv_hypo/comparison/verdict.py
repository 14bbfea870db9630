"""The verdict: probabilities of the hypotheses, the credible set, and the sentence that says so. Entrance: `judge`."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.special import logsumexp
from scipy.stats import norm

from brv_hypo.arrays import FloatArray
from brv_hypo.comparison import result
from brv_hypo.comparison.result import OTHER, Adequacy, Explained, Outcome, ProcessEstimate, RecordError, Verdict
from brv_hypo.io.text import error_share, hypothesis, percent
from brv_hypo.thresholds import CREDIBLE_PROBABILITY, MOST_REGIONS, NOISE_LEVEL, OTHER_PRIOR, WINNING_PROBABILITY

# Worked out on the seeds of `tests.studies.independent.study` that validation.md lists, and held by its fresh ones.
# Nats as they count beside small processes, from which a second mechanism is fitted: of two that act 200 to 9,000, of
# one up to 132 (`two_mechanisms`, `imperfect_study` of all worlds); wording alone.
SECOND_ACTS = 150.0
PROCESSES_LARGE = 0.5  # of the baseline's residual, from which a verdict says that processes replace something
NONE = "none"
NO_CAUSE = "is no established cause"
ALONE = "Joined flights share coefficients and the Mach numbers of changes: compare each alone to see whether they do."


@dataclass(frozen=True)
class Contender:
    """A hypothesis, or something outside the list, as the verdict knows it."""

    name: str
    level: float  # log evidence, but for a constant
    held_out: FloatArray  # log predictive density of each stretch of the record given the others (stretches,)
    impossible: str | None = None  # which value no body can have, if any
    words: str | None = None  # what it is, of something outside the list


@dataclass(frozen=True)
class Misfit:
    """How the leader fits: `noise`, the rms residual over the noise measured in the record, of so many `rows`; squares
    that it `explains` of the residual of the baseline, and whether it surely has more of that, or of the moment, than
    processes.
    """

    noise: float
    rows: int
    explains: float
    significant: bool = True
    regions: int = 1  # of the leader's terms, separate in time

    @property
    def p_value(self) -> float:
        """Probability of noise so large, or larger, where the record states it well."""
        spread = np.hypot(NOISE_LEVEL[1], 1.0 / np.sqrt(2.0 * self.rows))
        return float(norm.sf(np.log(self.noise) / spread))

    @property
    def adequate(self) -> bool:
        """Whether the residual beyond noise and processes is less than what the leader explains, or than the noise."""
        return max(self.noise**2 - 1.0, 0.0) * self.rows <= max(self.explains, float(self.rows))


def probabilities(
    levels: Mapping[str, float], others: Sequence[float] = (), other_prior: float = OTHER_PRIOR
) -> dict[str, float]:
    """Posterior probabilities of hypotheses with these log evidences (Kass and Raftery 1995). Half of the prior that
    `others`, which share `other_prior`, do not have is the baseline's, whatever the list; mechanisms share the rest.
    """
    rivals = sum(name != NONE for name in levels)
    half = 0.5 if NONE in levels and rivals else 1.0
    scores = {name: level + np.log(half if name == NONE else half / rivals) for name, level in levels.items()}
    if others:
        scores[OTHER] = float(logsumexp(others)) + np.log(other_prior / (1.0 - other_prior) / len(others))
    most = max(scores.values())
    weights = {name: float(np.exp(score - most)) for name, score in scores.items()}
    return {name: weight / sum(weights.values()) for name, weight in weights.items()}


class Decision(NamedTuple):
    """What the rules make of evidences: who leads, how probable all are, whether it is adequate and predicts better."""

    leader: Contender
    chances: Mapping[str, float]
    adequate: bool
    predicts: bool
    outcome: Outcome
    winner: str | None


def judge(
    listed: Sequence[Contender],
    outside: Sequence[Contender],
    fit: Misfit,
    explained: Explained | None = None,
    processes: Sequence[ProcessEstimate] = (),
    other_prior: float = OTHER_PRIOR,
) -> Verdict:
    """Name a hypothesis that leads beside processes, explains and predicts something, and has possible values."""
    whole = decide(listed, outside, fit, other_prior)
    count = whole.leader.held_out.size
    repeated = []  # each without a stretch of the record
    for k in range(count):
        rest = [[replace(c, level=c.level - float(c.held_out[k])) for c in some] for some in (listed, outside)]
        repeated.append(decide(rest[0], rest[1], fit, other_prior))
    confirming = sum(each.leader.name == whole.leader.name for each in repeated)
    confirmed = 1.0 if confirming == count else (confirming + 1.0) / (count + 2.0)  # Laplace's rule of succession
    sure = whole.chances[OTHER] >= WINNING_PROBABILITY and count > 0
    elsewhere = float(np.mean([each.chances[OTHER] for each in repeated])) if sure else 1.0
    decision = decide(listed, outside, fit, other_prior, confirmed, elsewhere)
    final = decision if sure else whole
    same = [(each.outcome, each.winner) == (final.outcome, final.winner) for each in repeated]
    leader, chances = decision.leader, decision.chances
    credible = [c.name for c in listed if c is not leader and chances[c.name] >= CREDIBLE_PROBABILITY]
    verdict = Verdict(
        winner=decision.winner,
        outcome=decision.outcome,
        equivalent=tuple(dict.fromkeys([leader.name, *credible, *([] if decision.predicts else [NONE])])),
        probability=dict(chances),
        adequacy=Adequacy(ratio=fit.noise, p_value=fit.p_value, adequate=decision.adequate),
        explained=explained,
        processes=tuple(processes),
        stability=float(np.mean(same)) if count else 1.0,
        same_leader=confirming / count if count else 1.0,
        reason="",
    )
    if decision.outcome == "none adequate":
        return verdict.model_copy(update={"equivalent": (), "reason": _inadequate(leader, fit, chances, outside)})
    if decision.outcome == "named":
        return verdict.model_copy(update={"equivalent": (leader.name,), "reason": _named(verdict, leader)})
    null = next((candidate for candidate in listed if candidate.name == NONE), leader)
    reason = _undecided(verdict, outside) if decision.predicts else _not_named(verdict, leader, null, fit, outside)
    if confirmed < whole.chances[leader.name]:
        reason += (
            f" Of {count} repetitions, each without a stretch of the record, {confirming} have the same leader: that "
            "bounds its probability."
        )
    return verdict.model_copy(update={"reason": reason})


def decide(
    listed: Sequence[Contender],
    outside: Sequence[Contender],
    fit: Misfit,
    other_prior: float = OTHER_PRIOR,
    confirmed: float = 1.0,
    elsewhere: float = 1.0,
) -> Decision:
    """The rules; `confirmed`: share of repetitions with this leader; `elsewhere`: what these make of something else, at
    most. An impossible leader's chance goes to `other`.
    """
    leader = max(listed, key=lambda candidate: candidate.level)
    levels = {candidate.name: candidate.level for candidate in listed}
    chances = probabilities(levels, [candidate.level for candidate in outside], other_prior)
    chances = _discounted({OTHER: 0.0, **chances}, leader.name, confirmed)
    chances = _discounted(chances, OTHER, elsewhere)
    if leader.impossible is not None:
        chances = {**chances, leader.name: 0.0, OTHER: chances[OTHER] + chances[leader.name]}
    null = next((candidate for candidate in listed if candidate.name == NONE), leader)
    explains = fit.explains > 0.0 and fit.significant and fit.regions <= MOST_REGIONS[0]
    predicts = null is leader or bool(explains and np.sum(leader.held_out) > np.sum(null.held_out))
    adequate = fit.adequate and chances[OTHER] < WINNING_PROBABILITY and leader.impossible is None
    certain = chances[leader.name] >= WINNING_PROBABILITY
    outcome: Outcome = "none adequate" if not adequate else "named" if certain and predicts else "undecided"
    return Decision(leader, chances, adequate, predicts, outcome, leader.name if outcome == "named" else None)


def _discounted(chances: Mapping[str, float], leader: str, confirmed: float) -> dict[str, float]:
    """Probabilities, the leader's no larger than repetitions confirm; the rest goes to its rivals on the list."""
    lost = chances[leader] - max(confirmed, CREDIBLE_PROBABILITY)
    rivals = {name: chance for name, chance in chances.items() if name not in (leader, OTHER)}
    if lost <= 0.0 or not rivals:
        return dict(chances)
    total = sum(rivals.values())
    gains = {name: lost * (chance / total if total > 0.0 else 1.0 / len(rivals)) for name, chance in rivals.items()}
    return {**chances, leader: chances[leader] - lost, **{name: rivals[name] + gains[name] for name in rivals}}


def _inadequate(leader: Contender, fit: Misfit, chances: Mapping[str, float], outside: Sequence[Contender]) -> str:
    name, fits = hypothesis(leader.name), "fits best"
    if leader.impossible is not None:
        but = f"with {leader.impossible}"
    elif not fit.adequate:
        but = (
            f"beside all processes its residual is {fit.noise:.2f} times the noise (rms). Check the tolerances that "
            "are stated (--instruments)"
        )
    else:
        best, fits = max(outside, key=lambda candidate: candidate.level), "fits best of them"
        but = f"{best.words} fits better (probability of something else {_share(chances[OTHER])})"
    return f"None of the hypotheses is adequate: {name} {fits}, but {but}. `brv-hypo trace` looks for what it is."


def _named(verdict: Verdict, leader: Contender) -> str:
    chance = _share(verdict.probability[leader.name])
    if leader.name == NONE:
        needed = f"is needed: baseline and processes explain the moments (probability {chance})."
        made = 0.0 if verdict.explained is None else verdict.explained.processes
        if made < PROCESSES_LARGE:
            return f"No mechanism {needed}"
        largest = next((f", {each.name} most of all," for each in verdict.processes if each.size > each.std_error), "")
        return (
            f"No mechanism on the list {needed} But processes{largest} make {percent(made)} % of what the baseline "
            "does not explain: what they describe, or something that is not on the list. `brv-hypo trace` looks for it."
        )
    return f"{leader.name} explains the moments best (probability {chance})."


def after_checks(
    verdict: Verdict,
    prediction_ratio: float,  # held-out error of the leader over the baseline's
    stated_processes: Collection[str],  # by a user, with sizes of their own
    second: tuple[str, str],  # mechanism that seems to act beside the leader, and about when
    record_errors: Sequence[RecordError],  # beside the leader, the least probable first
    converged: bool,  # the search for the motion
) -> Verdict:
    """The verdict once all of the result is known, after checks that may withdraw a name or add to the reason."""
    verdict = with_prediction_error(verdict, prediction_ratio)
    verdict = with_far_processes(verdict, stated_processes)
    verdict = with_second(verdict, *second)
    verdict = with_far_error(verdict, record_errors)
    verdict = without_power(verdict)
    return verdict if converged else without_converged_motion(verdict)


def _describes(verdict: Verdict, why: str) -> str:
    """The reason of a verdict whose name is withdrawn, and why; where it has none, with that as a sentence more."""
    if verdict.winner is None:
        return f"{verdict.reason} {why[0].upper()}{why[1:]}."
    chance = _share(verdict.probability[verdict.winner])
    _, _, rest = verdict.reason.partition(").")  # after that it explains the moments best
    best = f"{verdict.winner} describes the moments best (probability {chance}), when and in which plane they changed"
    return f"{best}, but {NO_CAUSE}: {why}.{rest}"


def with_prediction_error(verdict: Verdict, ratio: float) -> Verdict:
    """The verdict without the name of a mechanism that does not predict: a held-out `ratio` of errors above 1."""
    if verdict.winner in (None, NONE) or ratio <= 1.0:
        return verdict
    worse = f"no better than the baseline ({error_share(ratio)} of its error)"
    said = _describes(verdict, f"it predicts held-out blocks {worse}")
    return _described(verdict, verdict.winner, said)


def _described(verdict: Verdict, described: str | None, reason: str) -> Verdict:
    """The verdict without a name; with a mechanism that describes the moments best, where the baseline may be right."""
    known = {"equivalent": verdict.equivalent if described is None else (described, NONE), "described": described}
    return verdict.model_copy(update={**known, "winner": None, "outcome": "undecided", "reason": reason})


def with_far_error(verdict: Verdict, errors: Sequence[RecordError]) -> Verdict:
    """The verdict without the name of a mechanism beside which the first error is far beyond its tolerance."""
    best = verdict.winner or verdict.described
    if best in (None, NONE) or not (far := result.far_beyond(errors)):
        return verdict
    return _described(verdict, best, _describes(verdict, f"beside it, {far}: check that first"))


def with_far_processes(verdict: Verdict, stated: Collection[str] = ()) -> Verdict:
    """The verdict without the name of a mechanism beside which a process is far beyond an ordinary size, but for those
    that a user has `stated`: one of the moment, or of the record if it is larger than what is named. What moves the
    vehicle so, or reads as if it did, may be what that describes.
    """
    named = verdict.winner or verdict.described
    best = named or next(iter(verdict.equivalent), None)
    own = max((each.share_of_moment for each in verdict.limits if each.mechanism == best), default=0.0)
    far = [each for each in verdict.processes if each.is_far and each.name not in stated]
    far = [each for each in far if each.is_of_moment or each.share_of_moment > own]
    if best in (None, NONE) or not far:
        return verdict
    sizes = ", ".join(each.sized for each in far)
    sums = [each.mechanism for each in verdict.limits if best in each.mechanism.split("+") and each.mechanism != best]
    two = "" if sums or "+" in str(best) else f", or two mechanisms act (list their sum, as {best}+NAME)"
    lacks = f"something large is not on the list{two}"
    if not any(each.is_of_moment for each in far):
        lacks = "check units, signs and axes of these channels"
    said = _describes(verdict, f"beside it processes are far beyond their ordinary size ({sizes} times): {lacks}")
    return verdict.model_copy(update={"reason": said}) if named is None else _described(verdict, best, said)


def with_second(verdict: Verdict, second: str, where: str) -> Verdict:
    """The verdict, with what seems to act beside its leader and `where`, in words; "" for none, or none adequate."""
    if not second or verdict.outcome == "none adequate":
        return verdict
    leader = verdict.winner or verdict.described or verdict.equivalent[0]
    said = f" {second} seems to act beside {leader}, about {where}: compare {leader}+{second} as well."
    return verdict.model_copy(update={"reason": verdict.reason + said})


def without_converged_motion(verdict: Verdict) -> Verdict:
    """The verdict without a name, where the motion did not converge: on another motion another hypothesis may lead."""
    if verdict.outcome not in ("named", "undecided"):
        return verdict
    return _described(verdict, None, f"{verdict.reason} But the search for the motion did not converge.")


def without_power(verdict: Verdict) -> Verdict:
    """The verdict that no mechanism is needed where half of those listed may have the whole moment: undecided."""
    far = [each.mechanism for each in verdict.limits if not each.share_of_moment_95 < 1.0]
    if verdict.winner != NONE or not far or 2 * len(far) < len(verdict.limits):
        return verdict
    said = f"{verdict.reason} But {', '.join(far)} may have the whole moment: the record excludes too little."
    return _described(verdict, None, said)


def _not_named(verdict: Verdict, leader: Contender, null: Contender, fit: Misfit, outside: Sequence[Contender]) -> str:
    found, lacks = verdict.explained, list[str]()
    if fit.explains <= 0.0 or (found is not None and found.interval_95[0] <= 0.0):
        lacks.append("explains nothing significant of what the baseline does not")
    elif not fit.significant:
        sizes = "" if found is None else f" ({percent(found.share)} %, these {percent(found.processes)} %)"
        lacks.append(f"explains less than processes do{sizes}")
    if fit.regions > MOST_REGIONS[0]:
        lacks.append(f"acts in {fit.regions} separate regions, as a description of something else would")
    if np.sum(leader.held_out) <= np.sum(null.held_out):
        lacks.append("predicts stretches of the record from the others no better than baseline and processes")
    chance, other = verdict.probability[leader.name], verdict.probability[OTHER]
    largest = f"{leader.name} has the largest evidence (probability {_share(chance)})"
    said = f"The data do not name one hypothesis: {largest}, but it {', and '.join(lacks)}."
    return said if other < chance else f"{said} Likelier ({_share(other)}) is {_something_else(outside).rstrip(',')}."


def _undecided(verdict: Verdict, outside: Sequence[Contender]) -> str:
    names = (*verdict.equivalent, *([OTHER] if verdict.probability[OTHER] >= CREDIBLE_PROBABILITY else []))
    other = _something_else(outside)
    shares = ", ".join(
        f"{other if name == OTHER else hypothesis(name)} {_share(verdict.probability[name])}" for name in names
    )
    return f"The data do not distinguish these: {shares}."


def _something_else(outside: Sequence[Contender]) -> str:
    """What is not on the list, by its likeliest."""
    best = max(outside, key=lambda candidate: candidate.level, default=None)
    return "something else" if best is None else f"something else, such as {best.words},"


def _share(chance: float) -> str:
    return "above 0.99" if chance > 0.99 else f"{chance:.2f}"
