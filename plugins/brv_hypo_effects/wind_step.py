"""The air starts to move at one instant."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from brv_hypo.flight.record import Flight
from brv_hypo.mechanisms import RecordEffect, hookimpl

_AXES = {"y": 1, "z": 2}


class WindStep(RecordEffect):
    """A step of the wind across the track at `time` s (None: the middle of the record).

    No channel senses it: the velocity relative to the air turns while the inertial velocity does not.
    A step along the track is in the record's `velocity` already. `spread` s is how well `time` is known.
    """

    name = "wind_step"
    title = "step of the wind"
    claims = "from one instant on, the air moves across the track"
    source = "kinematics of the velocity relative to the air"
    kind = "environment"

    time: float | None = None
    spread: float | None = None

    def components(self) -> tuple[tuple[str, str, float], ...]:
        """Wind along the body axes y and z of the first sample."""
        return tuple((axis, "m/s", 5.0) for axis in _AXES)

    def variants(self, flight: Flight) -> tuple[RecordEffect, ...]:
        """16 instants over the record; once `time` and `spread` are set, 7 instants near it."""
        if self.time is None or self.spread is None:
            instants = np.linspace(flight.time[0], flight.time[-1], 18)[1:-1]
            spread = float(instants[1] - instants[0])
        else:
            instants = self.time + self.spread * np.linspace(-0.75, 0.75, 7)
            spread = 0.25 * self.spread
        found = ({"time": float(instant), "spread": spread} for instant in instants)
        return tuple(self.model_copy(update=settings) for settings in found)

    def perturb(self, flight: Flight, component: str, value: float) -> Flight:
        """The record with that much wind left unaccounted for."""
        wind = np.zeros((flight.samples, 3)) if flight.wind is None else flight.wind.copy()
        at = 0.5 * (flight.time[0] + flight.time[-1]) if self.time is None else self.time
        wind[:, _AXES[component]] -= value * (flight.time >= at)
        return replace(flight, wind=wind)


@hookimpl
def brv_hypo_record_effects() -> Sequence[RecordEffect]:
    """The effects of this module."""
    return [WindStep()]
