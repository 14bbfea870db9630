"""What is part of every hypothesis: the record effects and the vehicle's tolerances that this distribution brings.

What another package installs is carried by nobody unless it is asked for, so that it changes no result.
"""

from __future__ import annotations

from functools import lru_cache

from brv_hypo.flight.record import Flight
from brv_hypo.mechanisms.contract import Mechanism, RecordEffect
from brv_hypo.mechanisms.registry import installed

_OWN = "brv-hypo"


@lru_cache(maxsize=1)
def carried_effects() -> tuple[RecordEffect, ...]:
    """The record effects that every hypothesis holds, by name."""
    return tuple(
        entry.item
        for entry in installed().values()
        if isinstance(entry.item, RecordEffect) and entry.item.carried and entry.package == _OWN
    )


def carried_mechanisms(flight: Flight) -> tuple[Mechanism, ...]:
    """The mechanisms whose coefficients the record's tolerances of the vehicle bound, by name."""
    own = (entry.item for entry in installed().values() if entry.package == _OWN)
    return tuple(item for item in own if isinstance(item, Mechanism) and item.tolerance(flight) is not None)
