"""The statistics of a study, gathered."""

from __future__ import annotations

from collections.abc import Sequence

from pydantic import Field

from brv_hypo.study.calibration import Calibration, calibration
from brv_hypo.study.config import NONE, StudyConfig
from brv_hypo.study.confusion import ConfusionRow, confusion, false_alarms
from brv_hypo.study.coverage import Coverage, coverages
from brv_hypo.study.detection import DetectionLimit, detection_limits
from brv_hypo.study.faulty import FaultRow, faulty
from brv_hypo.study.outcome import Outcome
from brv_hypo.study.shares import Share, Statistic, share


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
    records were spoilt are counted in `faults`, and in nothing else but `flights`.
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
