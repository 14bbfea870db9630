"""One instrument's clock is late against the others'."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from scipy.interpolate import CubicSpline

from brv_hypo.arrays import FloatArray
from brv_hypo.flight.record import Flight
from brv_hypo.mechanisms import RecordEffect, hookimpl

_INSTRUMENTS = {
    "gyros": ("p", "q", "r"),
    "accelerometers": ("ax", "ay", "az"),
    "air data": ("velocity", "dynamic_pressure", "mach", "reynolds"),
}


class TimeSkew(RecordEffect):
    """The channels of one instrument hold what was so a constant time before their stamp."""

    name = "time_skew"
    title = "time skew between instruments"
    claims = "one instrument is late against the others by a constant time"
    source = "Morelli and Klein, Aircraft System Identification, 2016, chapter 10 (data compatibility)"
    kind = "instrument"

    def components(self) -> tuple[tuple[str, str, float], ...]:
        """One delay for each instrument."""
        return tuple((name, "s", 1e-3) for name in _INSTRUMENTS)

    def perturb(self, flight: Flight, component: str, value: float) -> Flight:
        """The record with that instrument late by `value` s more."""
        late: dict[str, FloatArray] = {
            name: CubicSpline(flight.time, channel)(flight.time - value)
            for name in _INSTRUMENTS[component]
            if (channel := getattr(flight, name)) is not None
        }
        return replace(flight, **late)  # type: ignore[arg-type]


@hookimpl
def brv_hypo_record_effects() -> Sequence[RecordEffect]:
    """The effects of this module."""
    return [TimeSkew()]
