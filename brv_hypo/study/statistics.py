"""The statistics of a study, from the outcomes of its flights; `summarise` gathers them.

Shares with exact intervals (Clopper and Pearson 1934); the confusion matrix and false alarms; calibration of
the probabilities (Brier 1950; log loss, and the temperature T of exp(-BIC / 2T) that would make it least);
detection limits, a logistic curve of "won" over the logarithm of the effect by Firth's (1993) penalised
likelihood; coverage of the planted parameters by two standard errors; and verdicts on records with an
injected fault.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from itertools import pairwise
from typing import Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field
from scipy.optimize import minimize, minimize_scalar
from scipy.special import expit, logit, logsumexp
from statsmodels.stats.proportion import proportion_confint

from brv_hypo.arrays import FloatArray
from brv_hypo.constants import TEMPERATURE
from brv_hypo.study.config import NONE, StudyConfig
from brv_hypo.study.trial import Estimate, Outcome

# ---- Shares of flights, with the interval that so few of them leave open ----


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


# ---- Planted against ranked first, and false alarms ----


class ConfusionRow(Statistic):
    """Flights with one mechanism planted.

    `first` counts what ranked first; `winners` what a verdict named, `undecided` the verdicts that named
    nothing.
    """

    planted: str
    flights: int
    first: dict[str, int]
    winners: dict[str, int]
    undecided: int
    ranked_first: Share
    won: Share


def confusion(outcomes: Sequence[Outcome], planted: Sequence[str]) -> tuple[ConfusionRow, ...]:
    """One row for each entry of `planted`, in its order; without those that no flight has."""
    flights = {name: [outcome for outcome in outcomes if outcome.planted == name] for name in planted}
    return tuple(_confusion_row(name, found) for name, found in flights.items() if found)


def _confusion_row(planted: str, flights: Sequence[Outcome]) -> ConfusionRow:
    winners = Counter(outcome.winner for outcome in flights if outcome.winner is not None)
    return ConfusionRow(
        planted=planted,
        flights=len(flights),
        first=Counter(outcome.first for outcome in flights if outcome.first is not None),
        winners=winners,
        undecided=len(flights) - winners.total(),
        ranked_first=share(sum(outcome.right for outcome in flights), len(flights)),
        won=share(sum(outcome.won for outcome in flights), len(flights)),
    )


def false_alarms(outcomes: Sequence[Outcome]) -> Share:
    """Share of flights with nothing planted in which a verdict names a mechanism."""
    empty = [outcome for outcome in outcomes if outcome.planted == NONE]
    return share(sum(outcome.winner not in (None, NONE) for outcome in empty), len(empty))


# ---- Do verdicts given at 0.9 turn out right nine times in ten? ----


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
    """How well the probabilities are calibrated.

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


# ---- From which effect on is a mechanism found? A logistic curve of won over the logarithm of the effect ----


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


# ---- Do two standard errors hold the planted parameters as often as they should? ----


SIGMAS = 2.0


class Coverage(Statistic):
    """One parameter of one planted mechanism, over flights in which that mechanism ranks first.

    `covered`: within two standard errors (95.4 % where errors are Gaussian and right); `missing` flights have
    no such parameter in their fit. `rms_sigmas` is the rms error in standard errors, without the
    farthest tenth; `median_error` is absolute, in `units`.
    """

    planted: str
    parameter: str
    kind: str
    units: str
    covered: Share
    missing: int
    rms_sigmas: float | None
    median_error: float | None


def coverages(outcomes: Sequence[Outcome]) -> tuple[Coverage, ...]:
    """One entry for each planted mechanism and parameter."""
    groups: dict[tuple[str, str, str], list[Estimate]] = {}
    for outcome in outcomes:
        for estimate in outcome.estimates if outcome.right else ():
            groups.setdefault((outcome.planted, estimate.name, estimate.kind), []).append(estimate)
    return tuple(_coverage(*group, estimates) for group, estimates in groups.items())


def _coverage(planted: str, parameter: str, kind: str, estimates: Sequence[Estimate]) -> Coverage:
    sigmas = np.abs([e.sigmas for e in estimates if e.sigmas is not None])
    errors = [abs(e.value - e.truth) for e in estimates if e.value is not None]
    nearest = np.sort(sigmas)[: int(np.ceil(0.9 * sigmas.size))]
    return Coverage(
        planted=planted,
        parameter=parameter,
        kind=kind,
        units=next((e.units for e in estimates if e.units), "1"),
        covered=share(int(np.sum(sigmas < SIGMAS)), sigmas.size),
        missing=len(estimates) - sigmas.size,
        rms_sigmas=float(np.sqrt(np.mean(nearest**2))) if sigmas.size else None,
        median_error=float(np.median(errors)) if errors else None,
    )


# ---- What faults of the record do to verdicts: named, refused, or wrong without a word ----


class FaultRow(Statistic):
    """Flights whose record has one kind of fault.

    `named`: channel and kind are reported. `wrong`: a verdict names a mechanism that was not planted; `unwarned`: it
    does so and the data compatibility check reported nothing.
    """

    fault: str
    flights: int
    named: Share
    wrong: Share
    unwarned: Share


def faulty(outcomes: Sequence[Outcome]) -> tuple[FaultRow, ...]:
    """A row for each fault that was flown."""
    flown = [o for o in outcomes if o.draw.fault and o.status in ("compared", "refused")]
    kinds = dict.fromkeys(outcome.draw.fault for outcome in flown)
    return tuple(_fault_row(kind, [o for o in flown if o.draw.fault == kind]) for kind in kinds)


def _fault_row(kind: str, flights: Sequence[Outcome]) -> FaultRow:
    wrong = [o for o in flights if o.winner not in (None, NONE, o.planted)]
    count = len(flights)
    return FaultRow(
        fault=kind,
        flights=count,
        named=share(sum(bool(o.fault_named) for o in flights), count),
        wrong=share(len(wrong), count),
        unwarned=share(sum(not o.faults for o in wrong), count),
    )


# ---- The statistics of a study, gathered ----


class Failure(Statistic):
    """A flight that could not be simulated or compared."""

    key: str
    status: str
    reason: str


class Mistake(Statistic):
    """A flight whose planted mechanism did not rank first, though its effect is visible.

    `lead`: by how much the first leads the planted one on the information criterion.
    """

    key: str
    seed: int
    size: float
    effect: float
    first: str
    winner: str | None
    probability: float
    lead: float | None


class StudySummary(Statistic):
    """What a study found.

    `visible` statistics are over flights with nothing planted or with an effect of at least
    `visible_effect` (part of the moment's rms while it lasts); the others over all that were compared. Flights whose
    records were corrupted are counted in `faults`, and in nothing else but `flights`.
    """

    schema_: str = Field(default="brv-hypo/study/1", alias="schema")
    title: str
    seed: int
    flights: int
    compared: int
    visible_effect: float
    right: Share
    right_visible: Share
    confusion: tuple[ConfusionRow, ...]
    confusion_visible: tuple[ConfusionRow, ...]
    by_vehicle: dict[str, tuple[ConfusionRow, ...]]
    calibration: Calibration
    calibration_visible: Calibration
    detection: tuple[DetectionLimit, ...]
    coverage: tuple[Coverage, ...]
    false_alarms: Share
    faults: tuple[FaultRow, ...]
    mistakes: tuple[Mistake, ...]
    failures: tuple[Failure, ...]
    seconds_per_flight: float | None


def summarise(study: StudyConfig, outcomes: Sequence[Outcome]) -> StudySummary:
    """Every statistic of the study's outcomes."""
    sound = [outcome for outcome in outcomes if not outcome.draw.fault]
    compared = [outcome for outcome in sound if outcome.status == "compared"]
    visible = [o for o in compared if o.planted == NONE or o.effect >= study.visible_effect]
    vehicles = dict.fromkeys(outcome.draw.vehicle for outcome in visible)
    return StudySummary(
        title=study.title,
        seed=study.seed,
        flights=len(outcomes),
        compared=len(compared),
        visible_effect=study.visible_effect,
        right=share(sum(o.right for o in compared), len(compared)),
        right_visible=share(sum(o.right for o in visible), len(visible)),
        confusion=confusion(compared, study.planted),
        confusion_visible=confusion(visible, study.planted),
        by_vehicle={
            vehicle: confusion([o for o in visible if o.draw.vehicle == vehicle], study.planted)
            for vehicle in vehicles
        },
        calibration=calibration(compared),
        calibration_visible=calibration(visible),
        detection=detection_limits(compared),
        coverage=coverages(visible),
        false_alarms=false_alarms(compared),
        faults=faulty(outcomes),
        mistakes=tuple(_mistake(outcome) for outcome in visible if not outcome.right),
        failures=tuple(
            Failure(key=o.draw.key, status=o.status, reason=o.reason)
            for o in outcomes
            if o.status != "compared" and not (o.draw.fault and o.status == "refused")
        ),
        seconds_per_flight=sum(o.seconds for o in compared) / len(compared) if compared else None,
    )


def _mistake(outcome: Outcome) -> Mistake:
    first = outcome.first or ""
    known = outcome.information
    return Mistake(
        key=outcome.draw.key,
        seed=outcome.draw.seed,
        size=outcome.draw.size,
        effect=outcome.effect,
        first=first,
        winner=outcome.winner,
        probability=outcome.probability[first],
        lead=known[outcome.planted] - known[first] if outcome.planted in known else None,
    )
