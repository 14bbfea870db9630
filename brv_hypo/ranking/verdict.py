"""The verdict: a winner where the data name one, otherwise all that stand."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from brv_hypo.ranking.result import Verdict

WINNING_PROBABILITY = 0.9
STANDING_PROBABILITY = 0.02
# Set by the calibration study (see the README): widens the posterior for errors of the reconstruction.
TEMPERATURE = 1.5


@dataclass(frozen=True)
class Score:
    """What the verdict rests on: the information criterion and the held-out errors.

    `prediction_error` is in moment coefficients, `by_block` in whitened rates, where it is sharper.
    """

    name: str
    information: float
    prediction_error: float
    by_block: Sequence[float]


def probabilities(information: Mapping[str, float], temperature: float = TEMPERATURE) -> dict[str, float]:
    """Posterior probabilities under equal priors, exp(-criterion / 2 temperature) normalised.

    Kass and Raftery (1995). The temperature widens them for what the criterion does not know, such as errors
    of the reconstruction; the calibration study set it.
    """
    least = min(information.values())
    weights = {
        name: float(np.exp(-0.5 * (value - least) / temperature)) for name, value in information.items()
    }
    total = sum(weights.values())
    return {name: weight / total for name, weight in weights.items()}


def judge(scores: Sequence[Score], temperature: float = TEMPERATURE) -> Verdict:
    """A winner leads on the information criterion and is not beaten on held-out error; else nobody wins."""
    chances = probabilities({score.name: score.information for score in scores}, temperature)
    leader = max(scores, key=lambda score: chances[score.name])
    rivals = [score for score in scores if score is not leader]
    standing = [score.name for score in rivals if chances[score.name] >= STANDING_PROBABILITY]
    beaten_by = [score.name for score in rivals if _predicts_better(score, leader)]
    chance = chances[leader.name]
    if chance >= WINNING_PROBABILITY and not beaten_by:
        return Verdict(
            winner=leader.name,
            equivalent=(leader.name,),
            probability=chances,
            reason=_won(leader, rivals, chance),
        )
    equivalent = tuple(dict.fromkeys([leader.name, *standing, *beaten_by]))
    if beaten_by:
        reason = (
            f"The data do not name one mechanism: {leader.name} leads on the information criterion, but "
            f"{' and '.join(beaten_by)} predicts the held-out blocks better."
        )
    else:
        shares = ", ".join(f"{name} {_share(chances[name])}" for name in equivalent)
        reason = f"The data do not tell these apart: {shares}."
    return Verdict(winner=None, equivalent=equivalent, probability=chances, reason=reason)


def _won(leader: Score, rivals: Sequence[Score], chance: float) -> str:
    if leader.name == "none":
        return (
            f"No mechanism is needed: the baseline alone explains the moments (probability {_share(chance)})."
        )
    null = next((score for score in rivals if score.name == "none"), None)
    ratio = (
        ""
        if null is None
        else (
            f"; its held-out error is {leader.prediction_error / null.prediction_error:.2f} of that without "
            "a mechanism"
        )
    )
    return f"{leader.name} explains the moments best (probability {_share(chance)}){ratio}."


def _share(chance: float) -> str:
    return "above 0.99" if chance > 0.99 else f"{chance:.2f}"


def _predicts_better(rival: Score, leader: Score, sigmas: float = 2.0) -> bool:
    """The rival's error is lower, and over the blocks, in pairs, by more than `sigmas` standard errors."""
    if rival.prediction_error >= leader.prediction_error:
        return False
    gain = np.asarray(leader.by_block) - np.asarray(rival.by_block)
    if gain.size < 3:
        return False
    return bool(gain.mean() > sigmas * gain.std(ddof=1) / np.sqrt(gain.size))
