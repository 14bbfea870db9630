"""Faults of single channels: stuck, clipped, dead, bursts of spikes, isolated spikes, held values.

Entrances: `mask_faults`, `interpolated_holds`.

Stuck or clipped: a channel that is quantised, slow, or sampled and held repeats its values by nature. A run of
constants counts only where the channel hardly ever repeats itself, or where it ends in a jump that no other step of the
channel comes near; a flat top only where the extreme value is held far more often than the values beside it.
Burst: 3 to 60 samples between two edges (a third difference beyond 8 robust standard deviations and 3 times any other
around, as large as the departure to a factor of two), which the quintic through 8 samples on either side passes at more
than 8 standard deviations of the channel's noise.
Spike: one or two samples more than 8 robust standard deviations off the cubic through two samples on either side, and
more than twice the largest second difference around: a sinusoid of any frequency reaches (2 sin(w h / 2))^2 / 6 < 2/3
of that, a step or a kink 1. Or 2.5 times the largest fourth difference: a kink reaches 1, a step 0.6, a sinusoid near
the sampling rate 2.02 (tests/flight/test_spikes.py). A channel with more than 2 % of spikes is left as it is: they are
its noise. What is masked becomes NaN, and is bridged or cut by the rules of clock.py; a decisive fault is reported.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache

import numpy as np
from numpy.polynomial import Polynomial

import brv_hypo.thresholds as limits
from brv_hypo.arrays import BoolArray, FloatArray, IntArray
from brv_hypo.flight import clock
from brv_hypo.flight.record import INERTIAL_CHANNELS, Channels, RecordFault
from brv_hypo.io.text import counted

STUCK_BLOCKS = 20  # of a channel, in which it is counted how often values repeat
STUCK_QUIET = 0.25  # quantile of the blocks in which a channel repeats itself least
STUCK_LIVELY = 0.9  # quantile of those in which it does most
STUCK_COMMON_STEP = 0.99
FLAT_LEVELS = 3  # levels that are next to it
SPIKE_NEIGHBOURS = 4  # samples on either side
SPIKE_PASSES = 4  # as spikes hide each other
BURST_FLANK = 8  # samples on either side, through which a polynomial goes
BURST_ORDER = 5  # its degree
EDGE_OF_STEP = 1.5  # third difference, as taken here, of a step of one
STOP_AT_ZERO = ("velocity", "dynamic_pressure")
TRIED = (*INERTIAL_CHANNELS, *STOP_AT_ZERO)
MOST_NAMED = 5


def find_holds(values: FloatArray) -> IntArray | None:
    """Where a channel (n,), NaN where missing, that is held between new values has these; None of any other. They come
    as regularly as its clock; one may equal the last. One that is rounded changes by its smallest step.
    """
    known = np.flatnonzero(np.isfinite(values))
    changes = np.diff(values[known])
    moved = np.flatnonzero(changes)
    if moved.size < limits.HELD_FEWEST:
        return None
    lasts, sizes = np.diff(moved), np.abs(changes[moved])
    every = float(np.median(lasts))
    late = min(1.0, every / 4.0)  # samples by which a clock that is not the record's may be off
    count = np.maximum(np.rint(lasts / every), 1.0).astype(int)  # of values between changes, equal ones with them
    off = np.abs(lasts - every * count)
    regular = every >= 2.0 and np.mean(off <= late) > limits.HELD_REGULAR
    rounded = np.mean(sizes < (1.0 + limits.ROUNDED_WITHIN) * np.min(sizes)) > limits.HELD_REGULAR
    if not regular or rounded:
        return None
    begins = [-1] if moved[0] + 1 >= every - late else []  # the first value is new where it lasts as long as others
    equal = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    new = np.concatenate([begins, np.repeat(moved[:-1], count) + every * equal, moved[-1:]])
    return np.asarray(known[new.astype(int) + 1], dtype=np.int64)


def interpolated_holds(time: FloatArray, channels: Channels) -> tuple[Channels, tuple[RecordFault, ...]]:
    """`channels` (n,) of stamps `time` (n,) s, those beside gyros and accelerometers that are held interpolated between
    their new values, which are those of their instants, and what was done.
    """
    from scipy.interpolate import make_interp_spline

    out, faults = dict(channels), []
    for name, values in channels.items():
        new = None if name in INERTIAL_CHANNELS else find_holds(values)
        if new is not None:
            line = make_interp_spline(time[new], values[new], k=1)(time)  # and on along its first and last slopes
            out[name] = np.where(np.isfinite(values), line, np.nan)
            rate = 1.0 / float(np.median(np.diff(time[new])))
            action = f"new values at {rate:.3g} Hz, held between: interpolated"
            faults.append(RecordFault.over(time, name, "held", action))
    return out, tuple(faults)


# ---- Channels that are constant where they cannot be: runs of constants, flat tops, dead channels ----


def constant_runs(values: FloatArray) -> tuple[tuple[int, int], ...]:
    """The runs [start, stop) of `values` (n,), NaN where missing, over which the channel is stuck."""
    equal = np.concatenate([np.diff(values) == 0.0, [False]])
    if values.size < limits.STUCK_FEWEST_SAMPLES or not np.any(equal):
        return ()
    shares = _shares(equal)
    quiet, lively = float(np.quantile(shares, STUCK_QUIET)), float(np.quantile(shares, STUCK_LIVELY))
    repeats = quiet > limits.STUCK_REPEATS_SELDOM
    share = max(lively if repeats else quiet, limits.STUCK_LEAST_SHARE)
    if share > 1.0 - 1.0 / limits.STUCK_FEWEST_SAMPLES:
        return ()
    shortest = np.log(limits.STUCK_CHANCE / values.size) / np.log(share)
    stretches = clock.runs(equal)
    lengths = np.array([stop - start for start, stop in stretches])
    found = [(start, stop + 1) for start, stop in stretches if stop - start >= shortest]
    if not repeats:
        by_nature = [_expected(lengths, stop - start - 1, share, values.size) for start, stop in found]
        found = [run for run, count in zip(found, by_nature, strict=True) if count < limits.STUCK_CHANCE]
    else:
        steps = np.abs(np.diff(values))
        common = float(np.quantile(steps[steps > 0.0], STUCK_COMMON_STEP)) if np.any(steps > 0.0) else np.inf
        # Where the record ends with the run, there is no jump.
        jumps = np.append(np.nan_to_num(steps), 0.0)
        found = [run for run in found if jumps[run[1] - 1] > limits.STUCK_RELEASE * common]
    return tuple(run for run in found if run[0] > 0 or values[0] != 0.0)


def flat_tops(values: FloatArray) -> BoolArray:
    """Which samples of `values` (n,) lie at a limit of the instrument, at either end of its range."""
    found = np.zeros(values.size, dtype=np.bool_)
    known = values[np.isfinite(values)]
    if known.size < limits.STUCK_FEWEST_SAMPLES:
        return found
    equal = np.diff(values) == 0.0
    repeats = float(np.quantile(_shares(equal), STUCK_QUIET)) > limits.STUCK_REPEATS_SELDOM
    levels, counts = np.unique(known, return_counts=True)
    near = slice(1, 1 + FLAT_LEVELS)
    for level, own, others in ((levels[-1], counts[-1], counts[::-1][near]), (levels[0], counts[0], counts[near])):
        at = values == level
        lengths = [stop - start for start, stop in clock.runs(at)]
        # A single stretch at one value is a channel that is stuck, at whatever height.
        if own < limits.FLAT_SAMPLES or len(lengths) < 2 or not others.size:
            continue
        often, flat = own > limits.FLAT_TIMES * int(np.max(others)), max(lengths) >= limits.FLAT_RUN
        if (often and flat) if repeats else (often or max(lengths) > limits.FLAT_RUN):
            found |= at
    return found


def _shares(equal: BoolArray) -> FloatArray:
    """Share of repeated samples in each of some blocks."""
    return np.array([float(np.mean(block)) for block in np.array_split(equal, STUCK_BLOCKS)])


def _expected(lengths: IntArray, length: int, share: float, size: int) -> float:
    """Runs of `length` repetitions that `size` samples hold by nature, by the channel's shorter runs."""
    others = lengths[lengths <= length]
    repeated = int(others.sum()) - length
    begins = max(share, repeated / size)
    goes_on = max(begins, (repeated - (others.size - 1) + begins) / (repeated + 1))
    return float(size * begins * goes_on ** (length - 1))


def find_bursts(values: FloatArray) -> BoolArray:
    """Which samples of `values` (n,), NaN where missing, belong to bursts; none if too many would."""
    found = np.zeros(values.size, dtype=np.bool_)
    if values.size < 4 * BURST_FLANK:
        return found
    # At each sample, the jump from the one before less that of its neighbours; NaN at the ends.
    jumps = np.diff(values, prepend=np.nan)
    around = 0.5 * (np.roll(jumps, 1) + np.roll(jumps, -1))
    around[:2] = around[-1:] = np.nan
    third = jumps - around
    finite, size = third[np.isfinite(third)], np.nan_to_num(np.abs(third))
    scale = clock.MAD_TO_SIGMA * float(np.median(np.abs(finite))) if finite.size else np.inf
    peaks = (size >= np.roll(size, 1)) & (size > np.roll(size, -1))
    edges = np.flatnonzero(peaks & (size > limits.BURST_SIGMAS * scale)).tolist()
    if scale == 0.0 or len(edges) > limits.BURST_MOST_EDGES:
        return found
    sigma = clock.sigma_of_differences([values])
    for place, start in enumerate(edges):
        for stop in edges[place + 1 :][::-1]:
            length = limits.BURST_SHORTEST <= stop - start <= limits.BURST_LONGEST
            if length and not np.any(found[start:stop]) and _is_burst(values, third, start, stop, sigma):
                found[start:stop] = True
                break
    return found if np.count_nonzero(found) <= limits.BURST_LARGEST_FRACTION * values.size else np.zeros_like(found)


def _is_burst(values: FloatArray, third: FloatArray, start: int, stop: int, sigma: float) -> bool:
    if start < BURST_FLANK + 2 or stop + BURST_FLANK + 2 > values.size:
        return False
    around = np.abs(np.concatenate([third[start - BURST_FLANK : start - 1], third[stop + 2 : stop + BURST_FLANK]]))
    edge = min(abs(third[start]), abs(third[stop]))
    # Most pairs of edges end here, before the fit, which costs a hundred times as much.
    if not edge > limits.BURST_TIMES_AROUND * float(np.max(np.nan_to_num(around))):
        return False
    if not np.all(np.isfinite(values[start - BURST_FLANK : stop + BURST_FLANK])):
        return False
    flanks = np.r_[start - BURST_FLANK : start, stop : stop + BURST_FLANK]
    inside = np.arange(start, stop)
    departure = values[inside] - Polynomial.fit(flanks, values[flanks], BURST_ORDER)(inside)
    ends, steps = departure[[0, -1]], np.array([third[start], -third[stop]]) / EDGE_OF_STEP
    return bool(
        min(float(np.min(np.abs(ends))), float(np.median(np.abs(departure)))) > limits.BURST_SIGMAS * sigma
        and np.all(steps * ends > 0.0)
        and np.all(np.abs(np.log2(steps / ends)) < limits.BURST_EDGE_OCTAVES)
    )


# ---- Isolated spikes: found by a rule that clean data, however fast the motion, cannot meet ----


def find_spikes(values: FloatArray) -> BoolArray:
    """Which samples of `values` (n,), NaN where missing, are isolated spikes; none if too many would be."""
    found = np.zeros(values.size, dtype=np.bool_)
    index = np.arange(values.size, dtype=np.float64)
    cleaned = values.copy()
    for _ in range(SPIKE_PASSES):
        # Those that exceed the noise now, the largest first where candidates overlap.
        fresh = np.zeros_like(found)
        for length in range(1, limits.SPIKE_LONGEST + 1):
            for start in _candidates(cleaned, length):
                if not np.any(fresh[max(0, start - 2) : start + length + 2]):
                    fresh[start : start + length] = True
        if not np.any(fresh):
            break
        found |= fresh
        cleaned[fresh] = np.nan
        cleaned = np.where(found, clock.bridge(index, cleaned, limits.SPIKE_LONGEST * SPIKE_NEIGHBOURS), cleaned)
    return found if np.count_nonzero(found) <= limits.SPIKE_LARGEST_FRACTION * values.size else np.zeros_like(found)


def without_spikes(time: FloatArray, values: FloatArray, spikes: BoolArray) -> FloatArray:
    """`values` (n,) at `time` (n,) with `spikes` (n,) replaced by a cubic spline through the others."""
    return clock.bridge(time, np.where(spikes, np.nan, values), limits.SPIKE_LONGEST) if np.any(spikes) else values


def despiked(time: FloatArray, channels: Mapping[str, FloatArray]) -> tuple[Channels, dict[str, BoolArray], list[str]]:
    """`channels` (n,) with their spikes replaced, which samples those are, where there are any, and notes."""
    spikes = {name: found for name, values in channels.items() if np.any(found := find_spikes(values))}
    notes = []
    for name, found in spikes.items():
        at = np.flatnonzero(found)
        words = f"{counted(at.size, 'spike sample')} replaced by a cubic spline, the first at {time[at[0]]:.3f} s"
        notes.append(f"{name}: {words}")
    return dict(channels) | {n: without_spikes(time, channels[n], found) for n, found in spikes.items()}, spikes, notes


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
    suspect = np.flatnonzero(outlying > limits.SPIKE_SIGMAS * _scale(departure[:, 0], values))
    replaced = windows[suspect].copy()
    replaced[:, reach : reach + length] = cubic[suspect]
    curvature = np.max(np.nan_to_num(np.abs(np.diff(replaced, n=2, axis=1))), axis=1, initial=0.0)
    fourth = np.max(np.nan_to_num(np.abs(np.diff(replaced, n=4, axis=1)), nan=np.inf), axis=1, initial=0.0)
    most = np.minimum(limits.SPIKE_TIMES_CURVATURE * curvature, limits.SPIKE_TIMES_FOURTH * fourth)
    chosen = suspect[outlying[suspect] > most]
    return np.asarray(chosen[np.argsort(-outlying[chosen], kind="stable")], dtype=np.int64)


def _scale(departure: FloatArray, values: FloatArray) -> float:
    """Robust sigma of the departures, not below half a quantum: a channel at rest may still tick."""
    finite = departure[np.isfinite(departure)]
    steps = np.abs(np.diff(values))
    steps = steps[steps > 0.0]
    if finite.size == 0 or steps.size == 0:
        return float(np.inf)
    return max(clock.MAD_TO_SIGMA * float(np.median(np.abs(finite))), 0.5 * float(steps.min()))


@cache
def _cubic_weights(length: int) -> FloatArray:
    """Lagrange weights (length, 4): two samples on either side of a run to the samples of the run."""
    nodes = np.array([-2.0, -1.0, length, length + 1.0])
    inside = np.arange(length, dtype=np.float64)
    return np.vander(inside, 4) @ np.linalg.inv(np.vander(nodes, 4))


# ---- What a trial of the record finds, and the faults of single channels that it masks ----


def mask_faults(
    time: FloatArray, channels: Mapping[str, FloatArray]
) -> tuple[FloatArray, Channels, tuple[RecordFault, ...]]:
    """`time` (n,) s with clock steps taken out, `channels` (n,) with NaN where they are at fault, and the faults. Only
    what an analysis needs is tried: rates, specific forces, speed and dynamic pressure.
    """
    tried = {name: values for name, values in channels.items() if name in TRIED}
    steady, faults, masked = time.copy(), [], dict(channels)
    for at, excess in clock.stamped_steps(time, tried):
        steady[at:] -= excess
        action = f"the samples run on: later stamps moved by {-excess:.4g} s"
        faults.append(RecordFault.over(time[at - 1 : at + 1], "time", "clock step", action))
    # Where each sample lies on an axis that has a place for what its gaps miss, a flank at most in each.
    steps = np.diff(steady) / float(np.median(np.diff(steady)))
    missing = np.where(steps > limits.MISSING_BEYOND_STEPS, np.clip(np.rint(steps) - 1.0, 1.0, clock.JUMP_FLANK), 0.0)
    places, dead = np.concatenate(([0], np.cumsum(1 + missing.astype(np.int64)))), _dead(steady, tried)
    for name, values in tried.items():
        masked[name], found = (values, [dead[name]]) if name in dead else _mask_channel(name, steady, values, places)
        faults += found
    # Where gyros and accelerometers jump together; isolated spikes, which are replaced later, do not count. Across a
    # gap that the stamps show, the motion was continuous.
    unspiked = {
        name: _spread(np.where(find_spikes(masked[name]), np.nan, masked[name]), places)
        for name in INERTIAL_CHANNELS
        if name in masked
    }
    action = (
        "rates and forces jump together, as no motion does: the clock stepped, or samples were lost or repeated, "
        "without a trace in the stamps. Give a window that leaves this out (--start, --stop)"
    )
    for at in np.searchsorted(places, clock.joint_jumps(unspiked)):
        faults.append(RecordFault.over(steady[at - 1 : at + 1], "time", "clock step", action, decisive=True))
    return steady, masked, tuple(faults)


def _dead(time: FloatArray, channels: Mapping[str, FloatArray]) -> dict[str, RecordFault]:
    """Channels that never change where others show that they must."""
    constant = [name for name, values in channels.items() if np.nanmin(values) == np.nanmax(values)]
    noisy = [
        name
        for name in INERTIAL_CHANNELS
        if name in channels
        and name not in constant
        and clock.sigma_of_differences([channels[name]]) > limits.DEAD_NOISE * np.nanmax(np.abs(channels[name]))
    ]
    speed = channels["velocity"]
    # What speed, or what is sensed along the axis, says that a constant gauge must have missed.
    missed = {"dynamic_pressure": float(np.nanmax(speed) - np.nanmin(speed))}
    if "velocity" in constant:
        missed["velocity"] = abs(float(np.nanmean(channels["ax"]))) * float(time[-1] - time[0]) / limits.DEAD_PUSH
    found = {}
    for name in constant:
        changes = missed.get(name, 0.0) > limits.DEAD_CHANGE * float(np.nanmax(speed))
        if (name in INERTIAL_CHANNELS and noisy) or changes:
            value = np.nanmax(channels[name])
            action = f"{name} is {value:.4g} throughout: a dead channel. Bring it in from another source"
            found[name] = RecordFault.over(time, name, "dead", action, decisive=True)
    return found


def _spread(values: FloatArray, places: IntArray) -> FloatArray:
    """Values (n,) at their places, NaN where samples are missing."""
    out = np.full(int(places[-1]) + 1, np.nan)
    out[places] = values
    return out


def _mask_channel(
    name: str, time: FloatArray, values: FloatArray, places: IntArray
) -> tuple[FloatArray, list[RecordFault]]:
    """`values` with NaN where the channel is clipped, stuck or in a burst of spikes, and the faults."""
    clipped = flat_tops(values)
    if name in STOP_AT_ZERO:
        clipped &= values > 0.0
    stuck = np.zeros_like(clipped)
    for start, stop in constant_runs(values):
        stuck[start:stop] = not (name in STOP_AT_ZERO and values[start] == 0.0)
    stuck &= ~clipped
    rest = np.where(clipped | stuck, np.nan, values)
    kinds = (
        ("clipped", clipped, limits.MOST_CLIPPED, "lies at a limit of its range"),
        ("stuck", stuck, limits.MOST_STUCK, "is stuck"),
        ("spikes", find_bursts(_spread(rest, places))[places], 1.0, "leaves its course and comes back"),
    )
    masked, faults = values, []
    for kind, found, most, words in kinds:
        share, stretches = float(np.mean(found)), clock.runs(found)
        if share > most:
            action = (
                f"{name} {words} in {100.0 * share:.0f} % of its samples, too many to leave out: give a window in "
                "which it does not (--start, --stop)"
            )
            faults.append(RecordFault.over(time[found], name, kind, action, decisive=True))
            continue
        masked = np.where(found, np.nan, masked)
        if len(stretches) > MOST_NAMED:
            action = f"masked ({int(np.count_nonzero(found))} samples in {len(stretches)} stretches)"
            faults.append(RecordFault.over(time[found], name, kind, action))
        else:
            faults += [RecordFault.over(time[a:b], name, kind, f"masked ({b - a} samples)") for a, b in stretches]
    return masked, faults
