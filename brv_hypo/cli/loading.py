"""The flight that a command analyses, as its options ask for it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from brv_hypo.flight import Flight


def load(path: Path, start: float | None, stop: float | None, instruments: str | None) -> Flight:
    """The record at `path` from `start` to `stop` (s), known to the tolerances that `--instruments` names.

    Without them it is known to those that the record states itself.
    """
    from brv_hypo.flight import load_flight
    from brv_hypo.flight.instruments import instruments_from

    flight = load_flight(path).window(start, stop)
    if instruments is None:
        return flight
    return replace(flight, instruments=instruments_from(instruments, flight.instruments))
