"""The statistics of a study, from the outcomes of its flights; `summarise` gathers them.

Shares with exact intervals (Clopper and Pearson 1934); the confusion matrix and false alarms; calibration of the
probabilities (Brier 1950; log loss); detection limits, a logistic curve of "won" over the logarithm of the effect
(Firth 1993); verdicts on records with an injected fault.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from itertools import pairwise
from typing import Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field
from scipy.optimize import minimize
from scipy.special import expit, logit
from statsmodels.stats.proportion import proportion_confint

from brv_hypo.arrays import FloatArray
from brv_hypo.study.config import NONE, StudyConfig
from brv_hypo.study.run import Outcome

CONFIDENCE = 0.95
EDGES = (0.0, 0.5, 0.7, 0.9, 0.99, 1.0)  # of the bins of probability
LEAST = 1e-6  # probability that a log loss counts
FEWEST = 5  # flights that a detection limit needs
Status = Literal["estimated", "extrapolated", "all won", "none won", "no trend", "too few"]


class Statistic(BaseModel):
    """Base of what a study's summary is made of."""

    model_config = ConfigDict(frozen=True, use_attribute_docstrings=True)


class Share(Statistic):
    """`count` of `total`, with an exact interval."""

    count: int = Field(description="that are so")
    total: int = Field(description="of so many")
    value: float | None = Field(description="`count` / `total`; None where nothing was counted")
    low: float = Field(description="lower end of the 95 % interval of Clopper and Pearson")
    high: float = Field(description="upper end; 1 where nothing was counted")


def share(count: int, total: int) -> Share:
    """The share `count` / `total`."""
    if total == 0:
        return Share(count=0, total=0, value=None, low=0.0, high=1.0)
    low, high = proportion_confint(count, total, alpha=1.0 - CONFIDENCE, method="beta")
    return Share(count=count, total=total, value=count / total, low=float(low), high=float(high))


def _share_of(outcomes: Sequence[Outcome], counted: Callable[[Outcome], bool | None]) -> Share:
    return share(sum(bool(counted(outcome)) for outcome in outcomes), len(outcomes))


class ConfusionRow(Statistic):
    """Flights with one mechanism planted."""

    planted: str = Field(description="mechanism; `none`: none")
    flights: int = Field(description="so many")
    first: dict[str, int] = Field(description="how often each hypothesis ranked first")
    winners: dict[str, int] = Field(description="how often a verdict named each hypothesis")
    undecided: int = Field(description="verdicts that named nothing")
    ranked_first: Share = Field(description="the planted mechanism ranked first")
    won: Share = Field(description="the verdict named the planted mechanism")


def confusion(outcomes: Sequence[Outcome], planted: Sequence[str]) -> tuple[ConfusionRow, ...]:
    """One row for each entry of `planted`, in its order; without those that no flight has."""
    known = {name: [outcome for outcome in outcomes if outcome.planted == name] for name in planted}
    return tuple(
        ConfusionRow(
            planted=name,
            flights=len(flights),
            first=Counter(outcome.first for outcome in flights if outcome.first is not None),
            winners=Counter(outcome.winner for outcome in flights if outcome.winner is not None),
            undecided=sum(outcome.winner is None for outcome in flights),
            ranked_first=_share_of(flights, lambda outcome: outcome.right),
            won=_share_of(flights, lambda outcome: outcome.won),
        )
        for name, flights in known.items()
        if flights
    )


def false_alarms(outcomes: Sequence[Outcome]) -> Share:
    """Share of flights with nothing planted in which a verdict names a mechanism."""
    return _share_of([o for o in outcomes if o.planted == NONE], lambda outcome: outcome.wrong)


class CalibrationBin(Statistic):
    """Flights whose largest probability lies in [low, high), at last its end too; `right`: what has it was planted."""

    low: float = Field(description="least probability")
    high: float = Field(description="greatest")
    mean_probability: float | None = Field(description="of the leaders in it")
    right: Share = Field(description="what leads was planted")


class Calibration(Statistic):
    """How well the probabilities are calibrated; a score is None where no flight, or none alone, determines it."""

    flights: int = Field(description="so many")
    bins: tuple[CalibrationBin, ...] = Field(description="of the largest probability")
    brier: float | None = Field(description="mean over flights of the sum of (probability - truth)²")
    log_loss: float | None = Field(description="mean of -ln of the true hypothesis's probability")


def calibration(outcomes: Sequence[Outcome]) -> Calibration:
    """Calibration over the flights whose planted hypothesis was among those compared."""
    judged = [outcome for outcome in outcomes if outcome.planted in outcome.probability]
    scores = [sum((p - (name == each.planted)) ** 2 for name, p in each.probability.items()) for each in judged]
    leaders = (max(outcome.probability.items(), key=lambda item: item[1]) for outcome in judged)
    leading = [(p, name == outcome.planted) for outcome, (name, p) in zip(judged, leaders, strict=True)]
    bins = []
    for low, high in pairwise(EDGES):
        inside = [(p, right) for p, right in leading if low <= p < high or p == high == EDGES[-1]]
        mean = float(np.mean([p for p, _ in inside])) if inside else None
        right = share(sum(right for _, right in inside), len(inside))
        bins.append(CalibrationBin(low=low, high=high, mean_probability=mean, right=right))
    return Calibration(
        flights=len(judged),
        bins=tuple(bins),
        brier=float(np.mean(scores)) if judged else None,
        log_loss=float(np.mean([-np.log(max(o.probability[o.planted], LEAST)) for o in judged])) if judged else None,
    )


class DetectionLimit(Statistic):
    """Effects (part of the moment's rms) that are won in 50 % and 90 % of flights."""

    planted: str = Field(description="mechanism")
    vehicle: str | None = Field(description="None: all vehicles together")
    flights: int = Field(description="so many")
    won: int = Field(description="named")
    least: float = Field(description="the least effect that was flown")
    greatest: float = Field(description="the greatest")
    status: Status
    """`extrapolated`: a limit lies outside [`least`, `greatest`]. `all won`: the limits lie below `least`; `none
    won`: above `greatest`; `no trend`: winning does not grow with the effect."""
    half: float | None = Field(default=None, description="the effect that is won in half of the flights")
    nine_tenths: float | None = Field(default=None, description="the effect that is won in nine of ten")


def detection_limits(outcomes: Sequence[Outcome]) -> tuple[DetectionLimit, ...]:
    """For each planted mechanism in all vehicles together, then in each."""
    planted = [o for o in outcomes if o.planted != NONE and o.effect > 0.0]
    found = []
    for name in dict.fromkeys(o.planted for o in planted):
        of_name = [o for o in planted if o.planted == name]
        for vehicle in (None, *dict.fromkeys(o.draw.vehicle for o in of_name)):
            flights = [o for o in of_name if vehicle in (None, o.draw.vehicle)]
            found.append(_limit(name, vehicle, flights))
    return tuple(found)


def _limit(planted: str, vehicle: str | None, outcomes: Sequence[Outcome]) -> DetectionLimit:
    effect = np.array([outcome.effect for outcome in outcomes])
    won = np.array([outcome.won for outcome in outcomes])
    status: Status = "all won" if won.all() else "none won" if not won.any() else "too few"
    half = nine_tenths = None
    if status == "too few" and effect.size >= FEWEST:
        level, slope = logistic(np.log(effect), won.astype(float))
        status = "no trend"
        if slope > 0.0:
            half, nine_tenths = (float(np.exp((logit(part) - level) / slope)) for part in (0.5, 0.9))
            status = "extrapolated" if half < effect.min() or nine_tenths > effect.max() else "estimated"
    return DetectionLimit(
        planted=planted,
        vehicle=vehicle,
        flights=len(outcomes),
        won=int(won.sum()),
        least=float(effect.min()),
        greatest=float(effect.max()),
        status=status,
        half=half,
        nine_tenths=nine_tenths,
    )


def logistic(x: FloatArray, won: FloatArray) -> tuple[float, float]:
    """Level and slope of P(won) = 1 / (1 + exp(-(level + slope x))); x, won (n,). Firth's (1993) penalised likelihood:
    the estimates stay finite where some x parts won from lost.
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


class FaultRow(Statistic):
    """Flights whose record has one kind of fault."""

    fault: str = Field(description="its kind")
    flights: int = Field(description="so many")
    named: Share = Field(description="channel and kind are reported")
    wrong: Share = Field(description="a verdict names a mechanism that was not planted")
    unwarned: Share = Field(description="it does so and the data compatibility check reported nothing")


def faulty(outcomes: Iterable[Outcome]) -> tuple[FaultRow, ...]:
    """A row for each fault that was flown."""
    kinds: dict[str, list[Outcome]] = {}
    for outcome in outcomes:
        if outcome.draw.fault and outcome.status in ("compared", "refused"):
            kinds.setdefault(outcome.draw.fault, []).append(outcome)
    return tuple(
        FaultRow(
            fault=kind,
            flights=len(flights),
            named=_share_of(flights, lambda outcome: outcome.fault_named),
            wrong=_share_of(flights, lambda outcome: outcome.wrong),
            unwarned=_share_of(flights, lambda outcome: outcome.wrong and not outcome.faults),
        )
        for kind, flights in kinds.items()
    )


class StudySummary(Statistic):
    """What a study found.

    `visible` statistics are over flights with nothing planted or with an effect of at least `visible_effect`;
    the others over all that were compared. Flights whose records were corrupted count in `flights` and `faults` alone.
    """

    schema_: str = Field(default="brv-hypo/study/1", alias="schema", description="`brv-hypo/study/1`")
    title: str = Field(description="of the study")
    seed: int = Field(description="of all draws")
    flights: int = Field(description="simulated")
    compared: int = Field(description="those with a sound record")
    named: Share = Field(description="of flights with something planted, the verdict names it")
    wrong: Share = Field(description="of these, it names something else")
    visible_effect: float = Field(description="part of the moment's rms while the effect lasts")
    right_visible: Share = Field(description="what was planted ranks first")
    confusion: tuple[ConfusionRow, ...] = Field(description="planted against ranked first and named")
    confusion_visible: tuple[ConfusionRow, ...] = Field(description="the same, visible effects")
    by_vehicle: dict[str, tuple[ConfusionRow, ...]] = Field(description="visible effects, each vehicle by itself")
    calibration_visible: Calibration = Field(description="of probabilities, visible effects")
    detection: tuple[DetectionLimit, ...] = Field(description="limits by mechanism and vehicle")
    false_alarms: Share = Field(description="a mechanism is named, none is planted")
    faults: tuple[FaultRow, ...] = Field(description="records that were corrupted")
    mistakes: tuple[Outcome, ...] = Field(description="visible effects that something else than the truth leads")
    failures: tuple[Outcome, ...] = Field(description="not simulated or compared, refusals of faults excepted")
    seconds_per_flight: float | None = Field(description="mean of those compared")


def summarise(study: StudyConfig, outcomes: Sequence[Outcome]) -> StudySummary:
    """Every statistic of the study's outcomes."""
    compared = [o for o in outcomes if o.status == "compared" and not o.draw.fault]
    planted = [o for o in compared if o.planted != NONE]
    visible = [o for o in compared if o.planted == NONE or o.effect >= study.visible_effect]
    return StudySummary(
        title=study.title,
        seed=study.seed,
        flights=len(outcomes),
        compared=len(compared),
        named=_share_of(planted, lambda outcome: outcome.won),
        wrong=_share_of(planted, lambda outcome: outcome.wrong),
        visible_effect=study.visible_effect,
        right_visible=_share_of(visible, lambda outcome: outcome.right),
        confusion=confusion(compared, study.planted),
        confusion_visible=confusion(visible, study.planted),
        by_vehicle={
            vehicle: confusion([o for o in visible if o.draw.vehicle == vehicle], study.planted)
            for vehicle in dict.fromkeys(outcome.draw.vehicle for outcome in visible)
        },
        calibration_visible=calibration(visible),
        detection=detection_limits(compared),
        false_alarms=false_alarms(compared),
        faults=faulty(outcomes),
        mistakes=tuple(o for o in visible if not o.right),
        failures=tuple(o for o in outcomes if o.status != "compared" and not (o.draw.fault and o.status == "refused")),
        seconds_per_flight=sum(o.seconds for o in compared) / len(compared) if compared else None,
    )
