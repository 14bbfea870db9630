"""What faults of the record do to verdicts: named, refused, or wrong without a word."""

from __future__ import annotations

from collections.abc import Sequence

from brv_hypo.study.config import NONE
from brv_hypo.study.outcome import Outcome
from brv_hypo.study.shares import Share, Statistic, share


class FaultRow(Statistic):
    """Flights whose record has one kind of fault.

    `named`: channel and kind are told. `wrong`: a verdict names a mechanism that was not planted; `unwarned`: it does
    so and the trial of the record told nothing.
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
    return tuple(_row(kind, [o for o in flown if o.draw.fault == kind]) for kind in kinds)


def _row(kind: str, flights: Sequence[Outcome]) -> FaultRow:
    wrong = [o for o in flights if o.winner not in (None, NONE, o.planted)]
    count = len(flights)
    return FaultRow(
        fault=kind,
        flights=count,
        named=share(sum(bool(o.fault_named) for o in flights), count),
        wrong=share(len(wrong), count),
        unwarned=share(sum(not o.faults for o in wrong), count),
    )
