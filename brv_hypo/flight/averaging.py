"""A record that is sampled far more finely than its motion needs, as means of neighbouring samples.

Means lose nothing of what white noise lets the data say. All channels are damped alike, by (pi / n)^2 / 6 where n
samples are left to a cycle: 2e-4 of the fastest motion at `AVERAGED_PER_CYCLE`, the same in rates as in accelerations.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.constants import AVERAGED_BEYOND, AVERAGED_LEFT, AVERAGED_PER_CYCLE
from brv_hypo.flight.record import CHANNELS, OPTIONAL_CHANNELS, Flight
from brv_hypo.flight.resample import dominant_frequency


def averaged(flight: Flight) -> Flight:
    """The flight with means of as many samples as its motion can spare; itself where it is short or has few to spare.

    Samples that a segment's ends leave over belong to no mean.
    """
    every = min(_to_spare(flight), flight.samples // AVERAGED_LEFT)
    if flight.samples <= AVERAGED_BEYOND or every < 2:
        return flight
    segments = tuple(
        (first, last) for a, b in flight.segments if (first := -(-a // every)) < (last := b // every)
    )
    if not segments:
        return flight
    arrays: dict[str, Any] = {
        name: None if (value := getattr(flight, name)) is None else _means(value, every)
        for name in ("time", *CHANNELS, *OPTIONAL_CHANNELS, "wind")
    }
    rate = flight.sample_rate / every
    note = f"analysed as means of {every} samples each, at {rate:.6g} Hz: the motion needs no more"
    return replace(flight, segments=segments, notes=(*flight.notes, note), **arrays)


def _to_spare(flight: Flight) -> int:
    """Samples that may be averaged: of the fastest motion in body axes, coning or spin, a cycle keeps enough."""
    coning = max(dominant_frequency(rate, flight.step) for rate in (flight.q, flight.r))
    spin = float(np.max(np.abs(flight.p))) / (2.0 * np.pi)
    fastest = max(coning, spin)
    return int(flight.sample_rate / (AVERAGED_PER_CYCLE * fastest)) if fastest > 0.0 else 1


def _means(values: FloatArray, every: int) -> FloatArray:
    """Means (n // every, ...) of every so many of `values` (n, ...)."""
    whole = values[: values.shape[0] // every * every]
    return np.asarray(whole.reshape(-1, every, *values.shape[1:]).mean(axis=1), dtype=float)
