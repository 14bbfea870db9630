"""The verdict: a winner, all that stand, or that nothing on the list explains the flight."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp

from brv_hypo.ranking.adequacy import Misfit
from brv_hypo.ranking.alternative import Alternative
from brv_hypo.ranking.constants import (
    IMPROBABLE_ERRORS,
    OTHER_PRIOR,
    STANDING_PROBABILITY,
    TEMPERATURE,
    WINNING_PROBABILITY,
)
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


def judge(
    scores: Sequence[Score],
    left: Misfit,
    stability: float,
    limits: Sequence[Limit] = (),
    alternatives: Sequence[Alternative] = (),
    other_prior: float = OTHER_PRIOR,
) -> Verdict:
    """Name a hypothesis that leads, predicts held-out blocks, leaves only noise and has possible values.

    `left` is what the leader leaves; `stability` the share of repetitions that give the same leader; `alternatives`
    what may be there in its place; `other_prior` the prior of something outside the list. What a leader that cannot be
    explains, something outside the list does. That nothing listed is adequate has to be as probable as a name.
    """
    leader = min(scores, key=lambda score: score.information)
    beside = leader.information - left.gain
    others = [beside, *(each.information for each in alternatives)]
    chances = probabilities({s.name: s.information for s in scores}, others, other_prior)
    chances = _shaken(chances, leader.name, stability)
    possible = leader.impossible is None and left.errors_p_value >= IMPROBABLE_ERRORS
    if not possible:
        chances = {**chances, leader.name: 0.0, OTHER: chances[OTHER] + chances[leader.name]}
    adequate = chances[OTHER] < WINNING_PROBABILITY and possible
    rivals = [score for score in scores if score is not leader]
    null = next((score for score in scores if score.name == NONE), None)
    beaten = null is None or leader is null or np.sum(leader.by_block) < np.sum(null.by_block)
    standing = [s.name for s in rivals if chances[s.name] >= STANDING_PROBABILITY]
    verdict = Verdict(
        winner=None,
        outcome="undecided",
        equivalent=tuple(dict.fromkeys([leader.name, *standing, *([] if beaten else [NONE])])),
        probability=chances,
        adequacy=Adequacy(ratio=left.ratio, p_value=left.p_value, adequate=adequate),
        limits=tuple(
            MechanismLimit(mechanism=x.mechanism, share_of_moment_95=x.share_of_moment) for x in limits
        ),
        stability=stability,
        reason="",
    )
    if not adequate:
        reason = _inadequate(leader, left, chances, _instead(alternatives, beside))
        return verdict.model_copy(update={"outcome": "none adequate", "equivalent": (), "reason": reason})
    if chances[leader.name] >= WINNING_PROBABILITY and beaten:
        named = {"winner": leader.name, "outcome": "named", "equivalent": (leader.name,)}
        reason = _won(leader, null, chances, verdict.limits)
        return verdict.model_copy(update={**named, "reason": reason})
    return verdict.model_copy(update={"reason": _undecided(verdict, leader, beaten, _instead(alternatives, beside))})


def _instead(alternatives: Sequence[Alternative], beside: float) -> Alternative | None:
    """The best of what may be there instead of the leader, where that is likelier than something beside it."""
    best = min(alternatives, key=lambda each: each.information, default=None)
    return None if best is None or best.information > beside else best


def _shaken(chances: Mapping[str, float], leader: str, stability: float) -> dict[str, float]:
    """Probabilities with the leader's lowered to the share of the repetitions that confirm it.

    The rest lead its rivals on the list, to whom that goes by their probabilities; it says nothing of `other`.
    """
    lost = chances[leader] - max(stability, STANDING_PROBABILITY)
    rivals = {name: chance for name, chance in chances.items() if name not in (leader, OTHER)}
    if lost <= 0.0 or not rivals:
        return dict(chances)
    total = sum(rivals.values())
    gains = {
        name: lost * (chance / total if total > 0.0 else 1.0 / len(rivals)) for name, chance in rivals.items()
    }
    return {
        **chances,
        leader: chances[leader] - lost,
        **{name: rivals[name] + gains[name] for name in rivals},
    }


def _inadequate(
    leader: Score, left: Misfit, chances: Mapping[str, float], instead: Alternative | None
) -> str:
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
        return f"None of the hypotheses is adequate: {leader.name} fits best, but {' and '.join(wrongs)}. {remedy}"
    if instead is not None:
        return (
            f"None of the hypotheses is adequate: {leader.name} fits best of them, and {instead.words} fits better "
            f"(probability {_share(chances[OTHER])}). `brv-hypo trace` looks for what it is."
        )
    return (
        f"None of the hypotheses is adequate: {leader.name} fits best and leaves {left.ratio:.2f} times the noise, in "
        f"which something smooth is left (probability {_share(chances[OTHER])}). `brv-hypo trace` looks for what it is."
    )


def _won(
    leader: Score, null: Score | None, chances: Mapping[str, float], limits: Sequence[MechanismLimit]
) -> str:
    chance = _share(chances[leader.name])
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
        gain = f"; its held-out error is {leader.prediction_error / null.prediction_error:.2g} of that without it"
    return f"{leader.name} explains the moments best (probability {chance}){gain}."


def _undecided(verdict: Verdict, leader: Score, beaten: bool, instead: Alternative | None) -> str:
    if not beaten:
        return (
            f"The data do not name one hypothesis: {leader.name} leads on the information criterion, but the baseline "
            "alone predicts the held-out blocks as well or better."
        )
    names = (*verdict.equivalent, *([OTHER] if verdict.probability[OTHER] >= STANDING_PROBABILITY else []))
    other = "something else" if instead is None else f"something else, such as {instead.words},"
    shares = ", ".join(
        f"{other if name == OTHER else name} {_share(verdict.probability[name])}" for name in names
    )
    return f"The data do not tell these apart: {shares}."


def _share(chance: float) -> str:
    return "above 0.99" if chance > 0.99 else f"{chance:.2f}"
