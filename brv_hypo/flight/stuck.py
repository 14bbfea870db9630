"""Channels that stand still where they cannot: runs of constants, flat tops, dead channels.

A channel that is quantised, slow, or sampled and held repeats its values by nature. So a run counts only where the
channel hardly ever repeats itself, or where it ends in a jump that no other step of the channel comes near; a flat
top only where the extreme value is held far more often than the values next to it.
"""

from __future__ import annotations

import numpy as np

from brv_hypo.arrays import BoolArray, FloatArray, IntArray
from brv_hypo.constants import (
    FLAT_LEVELS,
    FLAT_RUN,
    FLAT_SAMPLES,
    FLAT_TIMES,
    STUCK_BLOCKS,
    STUCK_CHANCE,
    STUCK_COMMON_STEP,
    STUCK_FEWEST_SAMPLES,
    STUCK_LEAST_SHARE,
    STUCK_LIVELY,
    STUCK_QUIET,
    STUCK_RELEASE,
    STUCK_REPEATS_SELDOM,
)
from brv_hypo.flight.resample import runs


def constant_runs(values: FloatArray) -> tuple[tuple[int, int], ...]:
    """The runs [start, stop) of `values` (n,), NaN where missing, over which the channel is stuck."""
    equal = np.concatenate([np.diff(values) == 0.0, [False]])
    if values.size < STUCK_FEWEST_SAMPLES or not np.any(equal):
        return ()
    shares = _shares(equal)
    quiet, lively = float(np.quantile(shares, STUCK_QUIET)), float(np.quantile(shares, STUCK_LIVELY))
    repeats = quiet > STUCK_REPEATS_SELDOM
    share = max(lively if repeats else quiet, STUCK_LEAST_SHARE)
    if share > 1.0 - 1.0 / STUCK_FEWEST_SAMPLES:
        return ()
    shortest = np.log(STUCK_CHANCE / values.size) / np.log(share)
    stretches = runs(equal)
    lengths = np.array([stop - start for start, stop in stretches])
    found = [(start, stop + 1) for start, stop in stretches if stop - start >= shortest]
    if not repeats:
        found = [run for run in found if _expected(lengths, run[1] - run[0] - 1, share, values.size) < STUCK_CHANCE]
    else:
        steps = np.abs(np.diff(values))
        common = float(np.quantile(steps[steps > 0.0], STUCK_COMMON_STEP)) if np.any(steps > 0.0) else np.inf
        found = [run for run in found if _release(values, run) > STUCK_RELEASE * common]
    return tuple(run for run in found if run[0] > 0 or values[0] != 0.0)


def flat_tops(values: FloatArray) -> BoolArray:
    """Which samples of `values` (n,) lie at a limit of the instrument, at either end of its range."""
    found = np.zeros(values.size, dtype=np.bool_)
    known = values[np.isfinite(values)]
    if known.size < STUCK_FEWEST_SAMPLES:
        return found
    equal = np.diff(values) == 0.0
    repeats = float(np.quantile(_shares(equal), STUCK_QUIET)) > STUCK_REPEATS_SELDOM
    levels, counts = np.unique(known, return_counts=True)
    near = slice(1, 1 + FLAT_LEVELS)
    for level, own, others in ((levels[-1], counts[-1], counts[::-1][near]), (levels[0], counts[0], counts[near])):
        at = values == level
        lengths = [stop - start for start, stop in runs(at)]
        # A single stretch at one value is a channel that is stuck, at whatever height.
        if own < FLAT_SAMPLES or len(lengths) < 2 or not others.size:
            continue
        often, flat = own > FLAT_TIMES * int(np.max(others)), max(lengths) >= FLAT_RUN
        if (often and flat) if repeats else (often or max(lengths) > FLAT_RUN):
            found |= at
    return found


def is_constant(values: FloatArray) -> bool:
    """Whether a channel (n,) has one value throughout."""
    known = values[np.isfinite(values)]
    return bool(known.size and known.min() == known.max())


def _shares(equal: BoolArray) -> FloatArray:
    """Share of repeated samples in each of some blocks."""
    return np.array([float(np.mean(block)) for block in np.array_split(equal, STUCK_BLOCKS)])


def _expected(lengths: IntArray, length: int, share: float, size: int) -> float:
    """Runs of `length` repetitions that `size` samples hold by nature, from the channel's other runs up to that length.

    Where a wave turns, a quantised channel goes on repeating itself far more often than it begins to.
    """
    others = lengths[lengths <= length]
    repeated = int(others.sum()) - length
    begins = max(share, repeated / size)
    goes_on = max(begins, (repeated - (others.size - 1) + begins) / (repeated + 1))
    return float(size * begins * goes_on ** (length - 1))


def _release(values: FloatArray, run: tuple[int, int]) -> float:
    """How far the channel jumps where the run ends; 0 where the record ends with it."""
    if run[1] >= values.size or not np.isfinite(values[run[1]]):
        return 0.0
    return float(abs(values[run[1]] - values[run[1] - 1]))
