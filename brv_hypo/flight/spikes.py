"""Isolated spikes: found by a rule that clean data, however fast the motion, cannot meet.

A run of one or two samples is a spike where all of these hold:
- it stands out by more than 8 robust standard deviations from the cubic through two samples on either side;
- that is more than twice the largest second difference among its 4 neighbours on either side, with the run
  replaced by the cubic. A sinusoid of any frequency reaches (2 sin(w h / 2))^2 / 6 < 2/3 of it, a step or a
  kink 1. Where motion bends by more than a spike from sample to sample, 2.5 times the largest fourth difference will
  do: a kink reaches 1 of it, a step 0.6, a sinusoid near the sampling rate 2.02 (`tests/flight/test_spikes.py`);
- spikes take up at most 2 % of the channel: more of them are its noise, and it is left as it is.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from brv_hypo.arrays import BoolArray, FloatArray, IntArray
from brv_hypo.constants import (
    SPIKE_LARGEST_FRACTION,
    SPIKE_LONGEST,
    SPIKE_NEIGHBOURS,
    SPIKE_PASSES,
    SPIKE_SIGMAS,
    SPIKE_TIMES_CURVATURE,
    SPIKE_TIMES_FOURTH,
)
from brv_hypo.files.printed import counted
from brv_hypo.flight.noise import MAD_TO_SIGMA
from brv_hypo.flight.record import CHANNELS, OPTIONAL_CHANNELS, Flight
from brv_hypo.flight.resample import bridge


def find_spikes(values: FloatArray) -> BoolArray:
    """Which samples of `values` (n,), NaN where missing, are isolated spikes; none if too many would be."""
    found = np.zeros(values.size, dtype=np.bool_)
    index = np.arange(values.size, dtype=np.float64)
    cleaned = values.copy()
    for _ in range(SPIKE_PASSES):
        fresh = _one_pass(cleaned)
        if not np.any(fresh):
            break
        found |= fresh
        cleaned[fresh] = np.nan
        cleaned = np.where(found, bridge(index, cleaned, SPIKE_LONGEST * SPIKE_NEIGHBOURS), cleaned)
    return found if np.count_nonzero(found) <= SPIKE_LARGEST_FRACTION * values.size else np.zeros_like(found)


def despiked(flight: Flight) -> Flight:
    """The flight with isolated spikes replaced by a cubic spline, and notes with channels and counts."""
    cleaned: dict[str, Any] = {}
    notes = []
    for name in (*CHANNELS, *OPTIONAL_CHANNELS):
        values = getattr(flight, name)
        if values is None:
            continue
        spikes = find_spikes(values)
        if np.any(spikes):
            cleaned[name] = without_spikes(flight.time, values, spikes)
            notes.append(spike_note(name, spikes, flight.time))
    return replace(flight, notes=(*flight.notes, *notes), **cleaned) if cleaned else flight


def without_spikes(time: FloatArray, values: FloatArray, spikes: BoolArray) -> FloatArray:
    """`values` (n,) at `time` (n,) with `spikes` (n,) replaced by a cubic spline through the others."""
    return bridge(time, np.where(spikes, np.nan, values), SPIKE_LONGEST) if np.any(spikes) else values


def spike_note(name: str, spikes: BoolArray, time: FloatArray) -> str:
    """What to say of spikes that were replaced in a channel."""
    at = np.flatnonzero(spikes)
    return f"{name}: {counted(at.size, 'spike sample')} replaced by a cubic spline, the first at {time[at[0]]:.3f} s"


def _one_pass(values: FloatArray) -> BoolArray:
    """The spikes that stand out now, longest-standing first where candidates overlap."""
    spikes = np.zeros(values.size, dtype=np.bool_)
    for length in range(1, SPIKE_LONGEST + 1):
        for start in _candidates(values, length):
            if not np.any(spikes[max(0, start - 2) : start + length + 2]):
                spikes[start : start + length] = True
    return spikes


def _candidates(values: FloatArray, length: int) -> IntArray:
    """Starts of runs of `length` that meet the rule, the largest first."""
    reach = SPIKE_NEIGHBOURS
    padded = np.concatenate((np.full(reach, np.nan), values, np.full(reach, np.nan)))
    if values.size < length + 4:
        return np.zeros(0, dtype=np.int64)
    windows = np.lib.stride_tricks.sliding_window_view(padded, length + 2 * reach)
    flanks = windows[:, [reach - 2, reach - 1, reach + length, reach + length + 1]]
    cubic = flanks @ _cubic_weights(length).T
    departure = windows[:, reach : reach + length] - cubic
    one_sided = np.all(departure > 0.0, axis=1) | np.all(departure < 0.0, axis=1)
    outlying = np.where(one_sided, np.abs(departure).min(axis=1), 0.0)
    suspect = np.flatnonzero(outlying > SPIKE_SIGMAS * _scale(departure[:, 0], values))
    replaced = windows[suspect].copy()
    replaced[:, reach : reach + length] = cubic[suspect]
    curvature = np.max(np.nan_to_num(np.abs(np.diff(replaced, n=2, axis=1))), axis=1, initial=0.0)
    fourth = np.max(np.nan_to_num(np.abs(np.diff(replaced, n=4, axis=1)), nan=np.inf), axis=1, initial=0.0)
    chosen = suspect[outlying[suspect] > np.minimum(SPIKE_TIMES_CURVATURE * curvature, SPIKE_TIMES_FOURTH * fourth)]
    return np.asarray(chosen[np.argsort(-outlying[chosen], kind="stable")], dtype=np.int64)


def _scale(departure: FloatArray, values: FloatArray) -> float:
    """Robust sigma of the departures, not below half a quantum: a channel at rest may still tick."""
    finite = departure[np.isfinite(departure)]
    steps = np.abs(np.diff(values))
    steps = steps[steps > 0.0]
    if finite.size == 0 or steps.size == 0:
        return float(np.inf)
    return max(MAD_TO_SIGMA * float(np.median(np.abs(finite))), 0.5 * float(steps.min()))


@cache
def _cubic_weights(length: int) -> FloatArray:
    """Lagrange weights (length, 4): two samples on either side of a run to the samples of the run."""
    nodes = np.array([-2.0, -1.0, length, length + 1.0])
    inside = np.arange(length, dtype=np.float64)
    return np.vander(inside, 4) @ np.linalg.inv(np.vander(nodes, 4))
