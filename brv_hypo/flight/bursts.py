"""Spikes longer than two samples: a channel leaves its course and comes back to it.

A run of 3 to 60 samples is a burst where all of these hold:
- it begins and ends with an edge: a third difference beyond 8 robust standard deviations, and 3 times any other
  around, which no motion and no kink shows;
- the quintic through 8 samples on either side passes the run at more than 8 standard deviations of the channel's noise
  at its first and last sample and in the middle of its departures;
- the edges are the steps to the departure there and back, to a factor of two: a moment that turns abruptly, as where
  alpha passes by zero once a cycle, makes edges too, and the quintic does not follow the motion from one to the next.
"""

from __future__ import annotations

import numpy as np

from brv_hypo.arrays import BoolArray, FloatArray, IntArray
from brv_hypo.constants import (
    BURST_EDGE_OCTAVES,
    BURST_FLANK,
    BURST_LARGEST_FRACTION,
    BURST_LONGEST,
    BURST_MOST_EDGES,
    BURST_ORDER,
    BURST_SHORTEST,
    BURST_SIGMAS,
    BURST_TIMES_AROUND,
)
from brv_hypo.flight.noise import MAD_TO_SIGMA, sigma_of_differences

EDGE_OF_STEP = 1.5
"""Third difference, as taken here, of a step of one."""


def find_bursts(values: FloatArray) -> BoolArray:
    """Which samples of `values` (n,), NaN where missing, belong to bursts; none if too many would."""
    found = np.zeros(values.size, dtype=np.bool_)
    if values.size < 4 * BURST_FLANK:
        return found
    third = _third_difference(values)
    finite = third[np.isfinite(third)]
    scale = MAD_TO_SIGMA * float(np.median(np.abs(finite))) if finite.size else np.inf
    edges = _edges(third, scale)
    if scale == 0.0 or edges.size > BURST_MOST_EDGES:
        return found
    sigma = sigma_of_differences([values])
    for place, start in enumerate(edges):
        for stop in edges[place + 1 :][::-1]:
            if not BURST_SHORTEST <= stop - start <= BURST_LONGEST or np.any(found[start:stop]):
                continue
            if _is_burst(values, third, int(start), int(stop), sigma):
                found[start:stop] = True
                break
    return found if np.count_nonzero(found) <= BURST_LARGEST_FRACTION * values.size else np.zeros_like(found)


def _third_difference(values: FloatArray) -> FloatArray:
    """At each sample, the jump from the one before less that of its neighbours; NaN at the ends."""
    jumps = np.diff(values, prepend=np.nan)
    around = 0.5 * (np.roll(jumps, 1) + np.roll(jumps, -1))
    around[:2] = around[-1:] = np.nan
    return np.asarray(jumps - around)


def _edges(third: FloatArray, scale: float) -> IntArray:
    """Where the third difference stands out, at the peaks of it."""
    size = np.nan_to_num(np.abs(third))
    peak = (size >= np.roll(size, 1)) & (size > np.roll(size, -1))
    return np.flatnonzero(peak & (size > BURST_SIGMAS * scale)).astype(np.int64)


def _is_burst(values: FloatArray, third: FloatArray, start: int, stop: int, sigma: float) -> bool:
    if start < BURST_FLANK + 2 or stop + BURST_FLANK + 2 > values.size:
        return False
    around = np.abs(np.concatenate([third[start - BURST_FLANK : start - 1], third[stop + 2 : stop + BURST_FLANK]]))
    edge = min(abs(third[start]), abs(third[stop]))
    # Most pairs of edges end here, before the fit, which costs a hundred times as much.
    if not edge > BURST_TIMES_AROUND * float(np.max(np.nan_to_num(around))):
        return False
    if not np.all(np.isfinite(values[start - BURST_FLANK : stop + BURST_FLANK])):
        return False
    before, after = np.arange(start - BURST_FLANK, start), np.arange(stop, stop + BURST_FLANK)
    flanks = np.concatenate([before, after])
    middle, reach = 0.5 * (start + stop), 0.5 * (stop - start) + BURST_FLANK
    course = np.polynomial.Polynomial.fit((flanks - middle) / reach, values[flanks], BURST_ORDER)
    inside = np.arange(start, stop)
    departure = values[inside] - course((inside - middle) / reach)
    ends, steps = departure[[0, -1]], np.array([third[start], -third[stop]]) / EDGE_OF_STEP
    return bool(
        min(float(np.min(np.abs(ends))), float(np.median(np.abs(departure)))) > BURST_SIGMAS * sigma
        and np.all(steps * ends > 0.0)
        and np.all(np.abs(np.log2(steps / ends)) < BURST_EDGE_OCTAVES)
    )
