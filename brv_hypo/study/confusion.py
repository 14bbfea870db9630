"""Planted against ranked first, and false alarms."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from brv_hypo.study.config import NONE
from brv_hypo.study.outcome import Outcome
from brv_hypo.study.shares import Share, Statistic, share


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
    return tuple(_row(name, found) for name, found in flights.items() if found)


def _row(planted: str, flights: Sequence[Outcome]) -> ConfusionRow:
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
