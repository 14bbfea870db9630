"""Fewer samples, none of them aliased: a record at the rate that the motion needs.

Every channel passes the same linear-phase low-pass (Kaiser window, 60 dB), so that what holds between channels holds
after it: it ends at half the new rate. In a gap the weights of the samples that are there are made to add up to one.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.constants import (
    DECIMATED_KNOWN,
    DECIMATED_LEAST_GAIN,
    DECIMATED_PASS_END,
    DECIMATED_PER_CYCLE,
    DECIMATED_STOP_BEGIN,
    DECIMATED_STOP_DECIBEL,
    VIBRATION,
)
from brv_hypo.flight.faults import RecordFault, mask_faults
from brv_hypo.flight.resample import dominant_frequency, regularise
from brv_hypo.flight.schema import Record
from brv_hypo.flight.spikes import find_spikes, spike_note, without_spikes

Channels = dict[str, FloatArray]


@dataclass(frozen=True)
class Decimated:
    """A record at a lower rate, and the faults that were masked at the rate that it had."""

    record: Record
    faults: tuple[RecordFault, ...]


def needed_rate(time: FloatArray, channels: Mapping[str, FloatArray]) -> float | None:
    """Samples per second, Hz, that the motion in q and r needs; None where the record has little more."""
    grid, uniform, _ = regularise(time, {name: channels[name] for name in ("q", "r")})
    before = (grid.size - 1) / float(grid[-1] - grid[0])
    thinned, every = list(uniform.values()), 1
    # Vibration is faster than any oscillation, and may be stronger.
    if before > DECIMATED_LEAST_GAIN * VIBRATION / DECIMATED_PASS_END:
        every = int(before * DECIMATED_PASS_END / VIBRATION)
        thinned = [_filtered(values, low_pass(before, before / every))[::every] for values in thinned]
    frequency = max(dominant_frequency(values, every / before) for values in thinned)
    rate = DECIMATED_PER_CYCLE * frequency
    return float(np.ceil(rate)) if 0.0 < DECIMATED_LEAST_GAIN * rate <= before else None


def decimated(record: Record, rate: float) -> Decimated:
    """The record at `rate` Hz; itself where it has no more samples than that.

    Faults are masked and spikes replaced before the filter, which would spread them.
    """
    stamps, masked, faults = mask_faults(record.time, record.channels)
    notes = [f"{one.channel}: {one.fault}, {one.action}" for one in faults]
    clean = {}
    for name, values in masked.items():
        spikes = find_spikes(values)
        clean[name] = without_spikes(stamps, values, spikes) if np.any(spikes) else values
        notes += [spike_note(name, spikes, stamps)] if np.any(spikes) else []
    time, uniform, resampled = regularise(stamps, clean)
    before = (time.size - 1) / float(time[-1] - time[0])
    if rate >= before:
        return Decimated(record, ())
    taps = low_pass(before, rate)
    grid = np.arange(time[0], time[-1], 1.0 / rate)
    # Between the dense stamps of what is band-limited straight lines do.
    channels = {name: np.interp(grid, time, _filtered(values, taps)) for name, values in uniform.items()}
    notes += [
        *resampled,
        f"decimated from {before:.6g} to {rate:.6g} Hz, behind a linear-phase low-pass that passes "
        f"{DECIMATED_PASS_END * rate:.3g} and stops {DECIMATED_STOP_BEGIN * rate:.3g} Hz",
    ]
    update = {"time": grid, "channels": channels, "notes": (*record.notes, *notes)}
    return Decimated(record.model_copy(update=update), faults)


def low_pass(before: float, after: float) -> FloatArray:
    """Taps (odd,) of the low-pass for decimation from `before` to `after` Hz; they add up to one."""
    from scipy.signal import firwin, kaiserord

    width = (DECIMATED_STOP_BEGIN - DECIMATED_PASS_END) * after
    count, beta = kaiserord(DECIMATED_STOP_DECIBEL, width / (0.5 * before))
    middle = 0.5 * (DECIMATED_PASS_END + DECIMATED_STOP_BEGIN) * after
    return np.asarray(firwin(count | 1, middle, window=("kaiser", beta), fs=before))


def _filtered(values: FloatArray, taps: FloatArray) -> FloatArray:
    """`values` (n,) filtered; NaN where too little is known, and at the ends, where the filter is not full."""
    from scipy.signal import fftconvolve

    half = taps.size // 2
    if values.size <= 2 * half:
        return np.full(values.size, np.nan)
    known = np.isfinite(values)
    total = fftconvolve(known.astype(float), taps, "valid")
    with np.errstate(divide="ignore", invalid="ignore"):
        smooth = fftconvolve(np.where(known, values, 0.0), taps, "valid") / total
    result = np.full(values.size, np.nan)
    result[half : values.size - half] = np.where(total > DECIMATED_KNOWN, smooth, np.nan)
    return result
