"""Do verdicts given at 0.9 turn out right nine times in ten?"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.special import logsumexp

from brv_hypo.arrays import FloatArray
from brv_hypo.constants import TEMPERATURE
from brv_hypo.study.outcome import Outcome
from brv_hypo.study.shares import Share, Statistic, share

EDGES = (0.0, 0.5, 0.7, 0.9, 0.99, 1.0)
TEMPERATURES = (0.05, 500.0)


class CalibrationBin(Statistic):
    """Flights whose largest probability lies in [low, high); the last bin holds its upper end.

    `right`: what has it, something outside the list included, is what was planted.
    """

    low: float
    high: float
    mean_probability: float | None
    right: Share


class Calibration(Statistic):
    """How far the probabilities can be believed.

    `brier`: mean over flights of sum over hypotheses of (probability - truth)^2 (Brier 1950); `log_loss`:
    mean of -ln of the true hypothesis's probability at `temperature`. `best_temperature` would make that
    least, `best_log_loss`; None where the flights cannot tell.
    """

    flights: int
    bins: tuple[CalibrationBin, ...]
    brier: float | None
    temperature: float
    log_loss: float | None
    best_temperature: float | None
    best_log_loss: float | None


def calibration(outcomes: Sequence[Outcome]) -> Calibration:
    """Calibration over the flights whose planted hypothesis was among those compared."""
    judged = [outcome for outcome in outcomes if outcome.planted in outcome.probability]
    best = best_temperature(judged)
    return Calibration(
        flights=len(judged),
        bins=tuple(_bin(judged, low, high) for low, high in pairwise(EDGES)),
        brier=float(np.mean([_brier(outcome) for outcome in judged])) if judged else None,
        temperature=TEMPERATURE,
        log_loss=log_loss(judged, TEMPERATURE) if judged else None,
        best_temperature=best,
        best_log_loss=None if best is None else log_loss(judged, best),
    )


def log_loss(outcomes: Sequence[Outcome], temperature: float) -> float:
    """Mean of -ln p(planted), the probabilities taken anew from the information criteria."""
    return _log_loss(_behind(outcomes), temperature)


def best_temperature(outcomes: Sequence[Outcome]) -> float | None:
    """The temperature of least log loss; None where it lies at an end of TEMPERATURES, or without flights.

    Where every flight is right, colder is always better: such flights cannot set a temperature.
    """
    if not outcomes:
        return None
    behind = _behind(outcomes)
    found = minimize_scalar(
        lambda logarithm: _log_loss(behind, float(np.exp(logarithm))),
        bounds=tuple(np.log(TEMPERATURES)),
        method="bounded",
    )
    temperature = float(np.exp(found.x))
    low, high = TEMPERATURES
    return temperature if 1.01 * low < temperature < 0.99 * high else None


def _behind(outcomes: Sequence[Outcome]) -> FloatArray:
    """How far each hypothesis is behind the planted one (flights, hypotheses); inf where not compared."""
    names = list(dict.fromkeys(name for outcome in outcomes for name in outcome.information))
    return np.array(
        [[o.information.get(name, np.inf) - o.information[o.planted] for name in names] for o in outcomes]
    )


def _log_loss(behind: FloatArray, temperature: float) -> float:
    return float(np.mean(logsumexp(-0.5 * behind / temperature, axis=1)))


def _brier(outcome: Outcome) -> float:
    return sum((p - (name == outcome.planted)) ** 2 for name, p in outcome.probability.items())


def _bin(outcomes: Sequence[Outcome], low: float, high: float) -> CalibrationBin:
    named = [max(outcome.probability.items(), key=lambda item: item[1]) for outcome in outcomes]
    leaders = [(p, name == outcome.planted) for (name, p), outcome in zip(named, outcomes, strict=True)]
    inside = [(p, right) for p, right in leaders if low <= p < high or p == high == EDGES[-1]]
    return CalibrationBin(
        low=low,
        high=high,
        mean_probability=float(np.mean([p for p, _ in inside])) if inside else None,
        right=share(sum(right for _, right in inside), len(inside)),
    )
