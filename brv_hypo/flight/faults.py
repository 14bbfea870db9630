"""What a trial of the record finds, and the faults of single channels that it masks.

`mask_faults` looks for, in this order: steps of the clock, dead channels, flat tops, runs of constants, bursts of
spikes (of any length beyond the one or two samples of `spikes`). All that is masked becomes NaN: bridged or cut
by the rules of `resample`, like any other missing sample.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from brv_hypo.arrays import BoolArray, FloatArray, IntArray
from brv_hypo.constants import DEAD_CHANGE, DEAD_NOISE, DEAD_PUSH, JUMP_FLANK, MOST_CLIPPED, MOST_STUCK
from brv_hypo.flight.bursts import find_bursts
from brv_hypo.flight.clock import joint_jumps, stamped_steps
from brv_hypo.flight.noise import sigma_of_differences
from brv_hypo.flight.record import INERTIAL_CHANNELS
from brv_hypo.flight.resample import places_with_gaps, runs
from brv_hypo.flight.spikes import find_spikes
from brv_hypo.flight.stuck import constant_runs, flat_tops, is_constant

STOP_AT_ZERO = ("velocity", "dynamic_pressure")
TRIED = (*INERTIAL_CHANNELS, *STOP_AT_ZERO)
MOST_NAMED = 5

Channels = dict[str, FloatArray]


@dataclass(frozen=True)
class RecordFault:
    """One fault: `channel` (several joined by commas), the kind of `fault`, from `start_s` to `stop_s`.

    `action` says in words what was done, or what the user should do. `decisive`: the record contradicts itself,
    and nothing that is fitted to it can be believed.
    """

    channel: str
    fault: str
    start_s: float
    stop_s: float
    action: str
    decisive: bool


@dataclass(frozen=True)
class RecordTrial:
    """The verdict on a record: `sound` unless one of its `faults` is decisive."""

    sound: bool
    faults: tuple[RecordFault, ...]


def mask_faults(
    time: FloatArray, channels: Mapping[str, FloatArray]
) -> tuple[FloatArray, Channels, tuple[RecordFault, ...]]:
    """`time` (n,) s with clock steps taken out, `channels` (n,) with NaN where they are at fault, and the faults.

    Only what an analysis needs is tried: rates, specific forces, speed and dynamic pressure.
    """
    tried = {name: values for name, values in channels.items() if name in TRIED}
    steady, faults = _without_steps(time, tried)
    places = places_with_gaps(steady, JUMP_FLANK)
    masked = dict(channels)
    dead = _dead(steady, tried)
    for name, values in tried.items():
        if name in dead:
            faults.append(dead[name])
            continue
        masked[name], found = _mask_channel(name, steady, values, places)
        faults += found
    faults += _jumps(steady, masked, places)
    return steady, masked, tuple(faults)


def _without_steps(
    time: FloatArray, channels: Mapping[str, FloatArray]
) -> tuple[FloatArray, list[RecordFault]]:
    steady, faults = time.copy(), []
    for at, excess in stamped_steps(time, channels):
        steady[at:] -= excess
        action = f"the samples run on: later stamps moved by {-excess:.4g} s"
        faults.append(RecordFault("time", "clock step", float(time[at - 1]), float(time[at]), action, False))
    return (steady, faults) if faults else (time, faults)


def _jumps(time: FloatArray, channels: Mapping[str, FloatArray], places: IntArray) -> list[RecordFault]:
    """Places where gyros and accelerometers jump together; isolated spikes, which are replaced later, do not count.

    Across a gap that the stamps tell of, the motion ran on.
    """
    despiked = {
        name: _spread(np.where(find_spikes(channels[name]), np.nan, channels[name]), places)
        for name in INERTIAL_CHANNELS
        if name in channels
    }
    action = (
        "rates and forces jump together, as no motion does: the clock stepped, or samples were lost or repeated, "
        "without a trace in the stamps. Give a window that leaves this out (--start, --stop)"
    )
    return [
        RecordFault("time", "clock step", float(time[at - 1]), float(time[at]), action, True)
        for at in np.searchsorted(places, joint_jumps(despiked))
    ]


def _dead(time: FloatArray, channels: Mapping[str, FloatArray]) -> dict[str, RecordFault]:
    """Channels that never change where others show that they must."""
    constant = [name for name, values in channels.items() if is_constant(values)]
    noisy = [
        name
        for name in INERTIAL_CHANNELS
        if name in channels
        and name not in constant
        and sigma_of_differences([channels[name]]) > DEAD_NOISE * np.nanmax(np.abs(channels[name]))
    ]
    found = {}
    for name in constant:
        if (name in INERTIAL_CHANNELS and noisy) or (name in STOP_AT_ZERO and _speed_changes(name, time, channels)):
            value = float(channels[name][np.isfinite(channels[name])][0])
            action = f"{name} is {value:.4g} throughout: a dead channel. Bring it in from another source"
            found[name] = RecordFault(name, "dead", float(time[0]), float(time[-1]), action, True)
    return found


def _speed_changes(gauge: str, time: FloatArray, channels: Mapping[str, FloatArray]) -> bool:
    """Whether speed, or what is sensed along the axis, says that a constant gauge must have changed."""
    speed = channels["velocity"]
    if gauge != "velocity":
        return float(np.nanmax(speed) - np.nanmin(speed)) > DEAD_CHANGE * float(np.nanmax(speed))
    gained = abs(float(np.nanmean(channels["ax"]))) * float(time[-1] - time[0])
    return gained > DEAD_PUSH * DEAD_CHANGE * float(np.nanmax(speed))


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
        ("clipped", clipped, MOST_CLIPPED, "lies at a limit of its range"),
        ("stuck", stuck, MOST_STUCK, "is stuck"),
        ("spikes", find_bursts(_spread(rest, places))[places], 1.0, "leaves its course and comes back"),
    )
    masked, faults = values, []
    for kind, found, most, words in kinds:
        if not np.any(found):
            continue
        share = float(np.mean(found))
        if share > most:
            action = (
                f"{name} {words} in {100.0 * share:.0f} % of its samples, too many to leave out: give a window in "
                "which it does not (--start, --stop)"
            )
            faults.append(fault_over(name, kind, time, found, action, decisive=True))
        else:
            masked = np.where(found, np.nan, masked)
            faults += _masked(name, kind, time, found)
    return masked, faults


def _masked(name: str, kind: str, time: FloatArray, found: BoolArray) -> list[RecordFault]:
    """A fault for each stretch; one for all where they are many."""
    stretches = runs(found)
    if len(stretches) > MOST_NAMED:
        action = f"masked ({int(np.count_nonzero(found))} samples in {len(stretches)} stretches)"
        return [fault_over(name, kind, time, found, action)]
    return [
        RecordFault(name, kind, float(time[a]), float(time[b - 1]), f"masked ({b - a} samples)", False)
        for a, b in stretches
    ]


def fault_over(
    name: str, kind: str, time: FloatArray, found: BoolArray, action: str, *, decisive: bool = False
) -> RecordFault:
    """One fault from the first to the last of the samples (n,) that are `found`."""
    at = np.flatnonzero(found)
    return RecordFault(name, kind, float(time[at[0]]), float(time[at[-1]]), action, decisive)
