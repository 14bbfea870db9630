"""Shares of flights, with the interval that so few of them leave open."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict
from statsmodels.stats.proportion import proportion_confint

CONFIDENCE = 0.95


class Statistic(BaseModel):
    """Base of what a study's summary is made of."""

    model_config = ConfigDict(frozen=True)


class Share(Statistic):
    """`count` of `total`; `low` and `high` are the exact interval of Clopper and Pearson (1934) at 95 %.

    `value` is None, and the interval the whole, where nothing was counted.
    """

    count: int
    total: int
    value: float | None
    low: float
    high: float


def share(count: int, total: int) -> Share:
    """The share `count` / `total`."""
    if total == 0:
        return Share(count=0, total=0, value=None, low=0.0, high=1.0)
    low, high = proportion_confint(count, total, alpha=1.0 - CONFIDENCE, method="beta")
    return Share(count=count, total=total, value=count / total, low=float(low), high=float(high))
