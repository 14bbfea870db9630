"""The air moves across the track: slowly, or from one instant on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.flight.record import Flight
from brv_hypo.mechanisms import Component, RecordEffect, hookimpl

# Half waves that a slow wind makes over the record, the k-th 1/k as large as the first: so many, or one for so many
# metres of height, as waves in the atmosphere have vertical wavelengths of some kilometres, but no more than are worth
# their columns. Judgement; Opportunity's entry passes 43 km: its held-out error before any step is 3.7e-8 with 5, 2.2,
# 1.9, 1.6 and 1.7e-8 with 16, 20, 24 and 32.
WIND_HALF_WAVES = 5  # at least
WIND_HALF_WAVE_HEIGHT = 2000.0  # m
WIND_MOST_HALF_WAVES = 24  # at most
# Instants at which a step of the wind is tried first: the attitude's own errors follow all of it but what happens
# within a part of a second, so that one a grid's step away looks like nothing (with 16, `tests.independent.loop_study`
# had 3 of 4 misnamed).
WIND_STEP_INSTANTS = 48
WIND_STEP_CLOSER = 7  # instants tried next, over 3/4 of the spacing to either side


_AXES = {"y": 1, "z": 2}
_SHAPES = {"": np.cos, "s": np.sin}


def _with_wind(flight: Flight, axis: str, speed: FloatArray) -> Flight:
    """The record with that wind (n,) m/s, along a body axis of the first sample, left unaccounted for."""
    wind = np.zeros((flight.samples, 3)) if flight.wind is None else flight.wind.copy()
    wind[:, _AXES[axis]] -= speed
    return replace(flight, wind=wind)


def _half_waves(flight: Flight) -> int:
    """How many of them a wind makes over the record: more where it passes through more of the atmosphere."""
    passed = 0.0 if flight.altitude is None else float(np.nanmax(flight.altitude) - np.nanmin(flight.altitude))
    return min(max(WIND_HALF_WAVES, int(passed / WIND_HALF_WAVE_HEIGHT)), WIND_MOST_HALF_WAVES)


class Wind(RecordEffect):
    """A wind across the track that changes slowly: half waves over the record, the k-th 1/k as large as the first.

    Cosines and sines alike: cosines alone would hold the wind still at both ends. A constant wind is in the direction
    of the velocity at the start; wind along the track is in the record's `velocity` already.
    """

    name, family = "wind", "air"
    title = "slowly changing wind"
    claims = "the air moves across the track, slowly changing along the record"
    source = "kinematics of the velocity relative to the air"
    kind = "environment"

    def components(self, flight: Flight) -> tuple[Component, ...]:
        """Cosines and sines of 1, 2, ... half waves along body axes y and z of the first sample, rms the tolerance."""
        shares = 1.0 / np.arange(1.0, _half_waves(flight) + 1.0)
        shares /= np.sqrt(np.sum(shares**2))
        return tuple(
            Component(f"{axis} {shape}{wave}", "m/s", float(share * flight.instruments.wind[place]))
            for axis, place in _AXES.items()
            for shape in _SHAPES
            for wave, share in enumerate(shares, start=1)
        )

    def perturb(self, flight: Flight, component: str, value: float) -> Flight:
        """The record with that much of one half wave left unaccounted for."""
        axis, wave = component.split()
        place = (flight.time - flight.time[0]) / (flight.time[-1] - flight.time[0])
        count = wave.removeprefix("s")
        return _with_wind(flight, axis, value * _SHAPES[wave[: -len(count)]](np.pi * int(count) * place))


class WindStep(RecordEffect):
    """A step of the wind across the track at `time` s (None: the middle of the record).

    No channel senses it: the velocity relative to the air turns while the inertial velocity does not.
    A step along the track is in the record's `velocity` already. `spread` s is how well `time` is known.
    """

    name, family = "wind_step", "air"
    title = "step of the wind"
    claims = "from one instant on, the air moves across the track"
    source = "kinematics of the velocity relative to the air"
    kind = "environment"
    carried = False

    time: float | None = None
    spread: float | None = None

    def components(self, flight: Flight) -> tuple[Component, ...]:
        """Wind along the body axes y and z of the first sample."""
        return tuple(Component(axis, "m/s", flight.instruments.wind[place]) for axis, place in _AXES.items())

    def variants(self, flight: Flight) -> tuple[RecordEffect, ...]:
        """Instants over the record; once `time` and `spread` are set, 7 instants near it."""
        if self.time is None or self.spread is None:
            instants = np.linspace(flight.time[0], flight.time[-1], WIND_STEP_INSTANTS + 2)[1:-1]
            spread = float(instants[1] - instants[0])
        else:
            instants = self.time + self.spread * np.linspace(-0.75, 0.75, WIND_STEP_CLOSER)
            spread = 0.25 * self.spread
        found = ({"time": float(instant), "spread": spread} for instant in instants)
        return tuple(self.model_copy(update=settings) for settings in found)

    def perturb(self, flight: Flight, component: str, value: float) -> Flight:
        """The record with that much wind left unaccounted for."""
        at = 0.5 * (flight.time[0] + flight.time[-1]) if self.time is None else self.time
        return _with_wind(flight, component, np.where(flight.time >= at, value, 0.0))


@hookimpl
def brv_hypo_record_effects() -> Sequence[RecordEffect]:
    """The effects of this module."""
    return [Wind(), WindStep()]
