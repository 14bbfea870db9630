"""Rounding on purpose: values a unit in the last place off, for what must not amplify it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.flight.record import CHANNELS, Flight


def last_digit_off(values: FloatArray, seed: int) -> FloatArray:
    """Each of `values` as it is, or the next number above or below, at random."""
    there = np.random.default_rng(seed).integers(-1, 2, values.shape)
    beyond = np.where(there > 0, np.inf, -np.inf)
    return np.where(there == 0, values, np.nextafter(values, beyond))


def flight_last_digit_off(flight: Flight, seed: int) -> Flight:
    """The flight with all its channels so."""
    return replace(flight, **{name: last_digit_off(getattr(flight, name), seed + k) for k, name in enumerate(CHANNELS)})
