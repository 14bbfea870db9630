"""The verdict: probabilities of the hypotheses, the credible set, and the sentence that says so. Entrance: `judge`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np
from scipy.special import logsumexp

from brv_hypo.constants import CREDIBLE_PROBABILITY, IMPROBABLE_ERRORS, OTHER_PRIOR, TEMPERATURE, WINNING_PROBABILITY
from brv_hypo.io.text import hypothesis
from brv_hypo.ranking.adequacy import Alternative, Misfit
from brv_hypo.ranking.limits import Limit
from brv_hypo.ranking.result import Adequacy, MechanismLimit, Verdict

OTHER = "other"
NONE = "none"


@dataclass(frozen=True)
class Score:
    """What the verdict rests on: the information criterion and the held-out errors of one hypothesis.

    `prediction_error` is in moment coefficients, `by_block` the score of the whitened rates (`HeldOut`).
    `impossible` says which value no body can have, if any.
    """

    name: str
    information: float
    prediction_error: float
    by_block: Sequence[float]
    impossible: str | None = None


def probabilities(
    information: Mapping[str, float], others: Sequence[float] = (), other_prior: float = OTHER_PRIOR
) -> dict[str, float]:
    """Posterior probabilities, exp(-criterion / 2 temperature) normalised (Kass and Raftery 1995).

    Equal priors; `others` are the criteria of what something outside the list may be: they share `other_prior`.
    """
    scores = {name: -0.5 * value / TEMPERATURE for name, value in information.items()}
    if others:
        share = other_prior / (1.0 - other_prior) * len(information) / len(others)
        scores[OTHER] = float(logsumexp(-0.5 * np.asarray(others) / TEMPERATURE) + np.log(share))
    most = max(scores.values())
    weights = {name: float(np.exp(value - most)) for name, value in scores.items()}
    total = sum(weights.values())
    return {name: weight / total for name, weight in weights.items()}


class Stability(NamedTuple):
    """Shares of the repetitions of a comparison that give the same outcome and name, and the same leader."""

    outcome: float
    leader: float


@dataclass(frozen=True)
class Ruling:
    """What the rules make of criteria: who leads, how probable all are, whether it is adequate and beats none."""

    leader: Score
    chances: Mapping[str, float]
    adequate: bool
    beaten: bool

    @property
    def outcome(self) -> Literal["named", "undecided", "none adequate"]:
        """That nothing listed is adequate has to be as probable as a name."""
        if not self.adequate:
            return "none adequate"
        return "named" if self.chances[self.leader.name] >= WINNING_PROBABILITY and self.beaten else "undecided"

    @property
    def winner(self) -> str | None:
        """What is named."""
        return self.leader.name if self.outcome == "named" else None


@dataclass(frozen=True)
class Contest:
    """What is judged, on a record and in its repetitions.

    `left` is what the leader leaves; `alternatives` what may be there in its place; `other_prior` the prior of
    something outside the list.
    """

    scores: Sequence[Score]
    left: Misfit
    alternatives: Sequence[Alternative] = ()
    other_prior: float = OTHER_PRIOR

    @cached_property
    def leader(self) -> Score:
        """The hypothesis of the least criterion."""
        return min(self.scores, key=lambda score: score.information)

    @cached_property
    def null(self) -> Score | None:
        """The baseline alone, where it is among them."""
        return next((score for score in self.scores if score.name == NONE), None)

    @cached_property
    def beside(self) -> float:
        """The criterion of the leader with something beside it."""
        return self.leader.information - self.left.gain

    def ruling(self, confirmed: float = 1.0) -> Ruling:
        """That of the record; `confirmed` is the share of repetitions that have its leader."""
        others = [self.beside, *(each.information for each in self.alternatives)]
        return self._ruled({score.name: score.information for score in self.scores}, others, confirmed)

    def repeated(self, information: Mapping[str, float]) -> Ruling:
        """That of a repetition, by the criteria of hypotheses and of the fits of alternatives.

        What the record's leader leaves, which values are impossible and what held-out blocks say stay as they are.
        """
        others = [information[self.leader.name] - self.left.gain]
        others += [each.repeated(information) for each in self.alternatives]
        return self._ruled({score.name: information[score.name] for score in self.scores}, others, 1.0)

    def _ruled(self, information: Mapping[str, float], others: Sequence[float], confirmed: float) -> Ruling:
        """What a leader that cannot be explains, something outside the list does."""
        leader = min(self.scores, key=lambda score: information[score.name])
        chances = _shaken(probabilities(information, others, self.other_prior), leader.name, confirmed)
        possible = leader.impossible is None and not (leader is self.leader and self._improbable)
        if not possible:
            chances = {**chances, leader.name: 0.0, OTHER: chances[OTHER] + chances[leader.name]}
        adequate = chances[OTHER] < WINNING_PROBABILITY and possible
        null = self.null
        beaten = null is None or leader is null or bool(np.sum(leader.by_block) < np.sum(null.by_block))
        return Ruling(leader, chances, adequate, beaten)

    @property
    def _improbable(self) -> bool:
        """Whether the leader asks for errors of the record that tolerances hardly allow."""
        return self.left.errors_p_value < IMPROBABLE_ERRORS


def judge(contest: Contest, stability: Stability, limits: Sequence[Limit] = ()) -> Verdict:
    """Name a hypothesis that leads, predicts held-out blocks, leaves only noise and has possible values."""
    ruling, left = contest.ruling(stability.leader), contest.left
    leader, chances, beaten = ruling.leader, ruling.chances, ruling.beaten
    rivals = [score for score in contest.scores if score is not leader]
    standing = [s.name for s in rivals if chances[s.name] >= CREDIBLE_PROBABILITY]
    verdict = Verdict(
        winner=ruling.winner,
        outcome=ruling.outcome,
        equivalent=tuple(dict.fromkeys([leader.name, *standing, *([] if beaten else [NONE])])),
        probability=dict(chances),
        adequacy=Adequacy(ratio=left.ratio, p_value=left.p_value, adequate=ruling.adequate),
        limits=tuple(MechanismLimit(mechanism=x.mechanism, share_of_moment_95=x.share_of_moment) for x in limits),
        stability=stability.outcome,
        reason="",
    )
    instead = _instead(contest.alternatives, contest.beside)
    if ruling.outcome == "none adequate":
        return verdict.model_copy(update={"equivalent": (), "reason": _inadequate(leader, left, chances, instead)})
    if ruling.outcome == "named":
        reason = _won(leader, contest.null, chances, stability.outcome, verdict.limits)
        return verdict.model_copy(update={"equivalent": (leader.name,), "reason": reason})
    return verdict.model_copy(update={"reason": _undecided(verdict, leader, beaten, instead)})


def _instead(alternatives: Sequence[Alternative], beside: float) -> Alternative | None:
    """The best of what may be there instead of the leader, where that is likelier than something beside it."""
    best = min(alternatives, key=lambda each: each.information, default=None)
    return None if best is None or best.information > beside else best


def _shaken(chances: Mapping[str, float], leader: str, stability: float) -> dict[str, float]:
    """Probabilities with the leader's lowered to the share of the repetitions that confirm it.

    The rest lead its rivals on the list, to whom that goes by their probabilities; it says nothing of `other`.
    """
    lost = chances[leader] - max(stability, CREDIBLE_PROBABILITY)
    rivals = {name: chance for name, chance in chances.items() if name not in (leader, OTHER)}
    if lost <= 0.0 or not rivals:
        return dict(chances)
    total = sum(rivals.values())
    gains = {name: lost * (chance / total if total > 0.0 else 1.0 / len(rivals)) for name, chance in rivals.items()}
    return {**chances, leader: chances[leader] - lost, **{name: rivals[name] + gains[name] for name in rivals}}


def _inadequate(leader: Score, left: Misfit, chances: Mapping[str, float], instead: Alternative | None) -> str:
    name, other = hypothesis(leader.name), _share(chances[OTHER])
    unlikely = left.errors_p_value < IMPROBABLE_ERRORS
    wrongs = [] if leader.impossible is None else [f"with {leader.impossible}"]
    if unlikely:
        wrongs.append("only with errors of instruments or vehicle that their tolerances hardly allow")
    if wrongs:
        remedy = (
            "Check the tolerances (--instruments), or look with `brv-hypo trace`."
            if unlikely
            else "`brv-hypo trace` looks for what else is at work."
        )
        return (
            f"None of the hypotheses is adequate: {name} fits best, with a residual of {left.ratio:.2f} times the "
            f"noise, but {' and '.join(wrongs)}. {remedy}"
        )
    if instead is not None:
        return (
            f"None of the hypotheses is adequate: {name} fits best of them, but {instead.words} fits better "
            f"(probability of something else {other}). `brv-hypo trace` looks for what it is."
        )
    return (
        f"None of the hypotheses is adequate: {name} fits best, but its residual is {left.ratio:.2f} times the noise, "
        f"and partly smooth in time (probability of something else {other}). `brv-hypo trace` looks for what it is."
    )


def _won(
    leader: Score, null: Score | None, chances: Mapping[str, float], stability: float, limits: Sequence[MechanismLimit]
) -> str:
    chance = f"{_share(chances[leader.name])}; {100.0 * stability:.0f} % of the repetitions give the same outcome"
    if leader.name == NONE:
        most = max(limits, key=lambda limit: limit.share_of_moment_95, default=None)
        room = (
            ""
            if most is None or not np.isfinite(most.share_of_moment_95)
            else f"; at 95 % no mechanism has more than {100.0 * most.share_of_moment_95:.2g} % of the moment"
        )
        return f"No mechanism is needed: the baseline explains the moments (probability {chance}){room}."
    gain = ""
    if null is not None and leader.prediction_error < null.prediction_error:
        ratio = leader.prediction_error / null.prediction_error
        gain = f"; its prediction error is {ratio:.2g} of that of the baseline only"
    return f"{leader.name} explains the moments best (probability {chance}){gain}."


def _undecided(verdict: Verdict, leader: Score, beaten: bool, instead: Alternative | None) -> str:
    if not beaten:
        return (
            f"The data do not name one hypothesis: {leader.name} leads on the information criterion, but the baseline "
            "alone predicts the held-out blocks as well or better."
        )
    names = (*verdict.equivalent, *([OTHER] if verdict.probability[OTHER] >= CREDIBLE_PROBABILITY else []))
    other = "something else" if instead is None else f"something else, such as {instead.words},"
    shares = ", ".join(
        f"{other if name == OTHER else hypothesis(name)} {_share(verdict.probability[name])}" for name in names
    )
    return f"The data do not distinguish these: {shares}."


def _share(chance: float) -> str:
    return "above 0.99" if chance > 0.99 else f"{chance:.2f}"
