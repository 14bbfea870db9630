"""What a function takes for a flight: a path, a `Flight`, a simulated flight, or a sequence of these."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Protocol, runtime_checkable

from brv_hypo.errors import UsageError
from brv_hypo.flight.instruments import instruments_from
from brv_hypo.flight.record import Flight
from brv_hypo.flight.store import load_flight


@runtime_checkable
class HoldsFlight(Protocol):
    """Something that has a flight, as a simulated flight has."""

    @property
    def flight(self) -> Flight:
        """The flight."""


FlightSource = str | Path | Flight | HoldsFlight


def one_flight(source: FlightSource) -> Flight:
    """The flight of a path, a `Flight` or a simulated flight. Raises UsageError for anything else."""
    if isinstance(source, Flight):
        return source
    if isinstance(source, str | Path):
        return load_flight(source)
    if isinstance(source, HoldsFlight) and isinstance(source.flight, Flight):
        return source.flight
    raise UsageError(
        f"got {type(source).__name__} for a flight, expected the path of a record, a Flight or a simulated flight."
    )


def flight_as_asked(path: str | Path, start: float | None, stop: float | None, instruments: str | None) -> Flight:
    """The record at `path` from `start` to `stop` (s), known to the tolerances that `--instruments` names.

    Without them it is known to those that the record states itself.
    """
    flight = load_flight(path).window(start, stop)
    if instruments is None:
        return flight
    return replace(flight, instruments=instruments_from(instruments, flight.instruments))


def flights_of(source: FlightSource | Sequence[FlightSource]) -> tuple[Flight, ...]:
    """The flights of one source or of a sequence of them. Raises UsageError where there is none."""
    several = isinstance(source, Sequence) and not isinstance(source, str)
    flights = tuple(one_flight(each) for each in source) if several else (one_flight(source),)  # type: ignore[union-attr, arg-type]
    if not flights:
        raise UsageError("got no flight, expected one at least: a path, a Flight, or a sequence of these.")
    return flights
