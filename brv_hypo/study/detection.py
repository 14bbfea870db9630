"""From which effect on is a mechanism found? A logistic curve of won over the logarithm of the effect."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
from scipy.optimize import minimize
from scipy.special import expit, logit

from brv_hypo.arrays import FloatArray
from brv_hypo.study.config import NONE
from brv_hypo.study.outcome import Outcome
from brv_hypo.study.shares import Statistic

FEWEST = 5

Status = Literal["estimated", "extrapolated", "all won", "none won", "no trend", "too few"]


class DetectionLimit(Statistic):
    """Effects (part of the moment's rms) that are won in 50 % and 90 % of flights.

    `extrapolated`: a limit lies outside the effects that were flown, [`least`, `greatest`]. `all won`: the
    limits lie below `least`; `none won`: above `greatest`; `no trend`: winning does not grow with the effect.
    """

    planted: str
    vehicle: str | None
    flights: int
    won: int
    least: float
    greatest: float
    status: Status
    half: float | None = None
    nine_tenths: float | None = None


def detection_limits(outcomes: Sequence[Outcome]) -> tuple[DetectionLimit, ...]:
    """For each planted mechanism in all vehicles together (`vehicle` None), then in each."""
    planted = [o for o in outcomes if o.planted != NONE and o.effect > 0.0]
    found = []
    for name in dict.fromkeys(o.planted for o in planted):
        of_name = [o for o in planted if o.planted == name]
        found.append(_limit(name, None, of_name))
        found.extend(
            _limit(name, vehicle, [o for o in of_name if o.draw.vehicle == vehicle])
            for vehicle in dict.fromkeys(o.draw.vehicle for o in of_name)
        )
    return tuple(found)


def _limit(planted: str, vehicle: str | None, outcomes: Sequence[Outcome]) -> DetectionLimit:
    effect = np.array([outcome.effect for outcome in outcomes])
    won = np.array([outcome.won for outcome in outcomes])
    status, limits = _fitted(effect, won)
    return DetectionLimit(
        planted=planted,
        vehicle=vehicle,
        flights=len(outcomes),
        won=int(won.sum()),
        least=float(effect.min()),
        greatest=float(effect.max()),
        status=status,
        half=limits[0],
        nine_tenths=limits[1],
    )


def _fitted(effect: FloatArray, won: FloatArray) -> tuple[Status, tuple[float | None, float | None]]:
    nothing = (None, None)
    if won.all() or not won.any():
        return ("all won" if won.all() else "none won"), nothing
    if effect.size < FEWEST:
        return "too few", nothing
    level, slope = logistic(np.log(effect), won.astype(float))
    if slope <= 0.0:
        return "no trend", nothing
    half, nine_tenths = (float(np.exp((logit(share) - level) / slope)) for share in (0.5, 0.9))
    outside = half < effect.min() or nine_tenths > effect.max()
    return ("extrapolated" if outside else "estimated"), (half, nine_tenths)


def logistic(x: FloatArray, won: FloatArray) -> tuple[float, float]:
    """Level and slope of P(won) = 1 / (1 + exp(-(level + slope x))); x, won (n,).

    Firth's (1993) penalised likelihood: the estimates stay finite where some x parts won from lost.
    """
    centre, spread = float(x.mean()), float(x.std()) or 1.0
    design = np.column_stack([np.ones_like(x), (x - centre) / spread])

    def loss(beta: FloatArray) -> float:
        linear = design @ beta
        weights = expit(linear) * expit(-linear)
        _, penalty = np.linalg.slogdet(design.T @ (weights[:, None] * design) + 1e-12 * np.eye(2))
        return float(np.sum(np.logaddexp(0.0, linear) - won * linear) - 0.5 * penalty)

    level, slope = minimize(loss, np.zeros(2), method="BFGS").x
    return float(level - slope * centre / spread), float(slope / spread)
