"""From a `Record`, as flown, to a `Flight`, ready to analyse, and back.

The order is fixed: faults are masked; spikes are replaced; time is made uniform; short gaps are bridged; missing
channels are derived; what is still missing cuts the flight into segments.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from brv_hypo.arrays import BoolArray, FloatArray
from brv_hypo.constants import BRIDGED_SECONDS
from brv_hypo.files.printed import counted
from brv_hypo.flight.derive import derive
from brv_hypo.flight.faults import RecordFault, fault_over, mask_faults
from brv_hypo.flight.record import CHANNELS, INERTIAL_CHANNELS, OPTIONAL_CHANNELS, Flight
from brv_hypo.flight.refusal import naming, refusal
from brv_hypo.flight.resample import bridge, crossed, joined, longest_crossed, longest_gap, regularise, runs
from brv_hypo.flight.schema import MINIMUM_SAMPLES, Record, VehicleRecord, validated
from brv_hypo.flight.spikes import find_spikes, spike_note, without_spikes

Channels = dict[str, FloatArray]
Segments = tuple[tuple[int, int], ...]

MOST_CUTS_NAMED = 10


def assemble(record: Record) -> Flight:
    """The flight of a record; its notes say, in order, all that was changed, derived or left out.

    Raises FlightRecordError where no stretch of 16 samples has every channel that is needed.
    """
    stamps, masked, faults = mask_faults(record.time, record.channels)
    spikes = {name: find_spikes(values) for name, values in masked.items()}
    notes = [*record.notes, *(f"{one.channel}: {one.fault}, {one.action}" for one in faults)]
    notes += [spike_note(name, found, stamps) for name, found in spikes.items() if np.any(found)]
    despiked = {name: without_spikes(stamps, values, spikes[name]) for name, values in masked.items()}
    with naming(record.path):
        time, recorded, resampled = regularise(stamps, despiked)
        bridged, gap_notes = _bridged(time, _without_empty(recorded))
        channels, derived = derive(bridged, record.planet, record.vehicle.reference_length)
        segments, cut_notes = _segments(time, channels)
    first, last = segments[0][0], segments[-1][1]
    whole, filled = _filled(float(time[1] - time[0]), channels, segments)
    return Flight(
        time=time[first:last],
        **{name: values[first:last] for name, values in whole.items()},
        vehicle=record.vehicle.vehicle(),
        instruments=record.instruments,
        segments=tuple((start - first, stop - first) for start, stop in segments),
        planet=record.planet,
        title=record.title,
        source=record.source,
        path=record.path,
        notes=(*notes, *resampled, *gap_notes, *derived, *cut_notes, *filled),
        faults=(*faults, *_spike_faults(stamps, spikes)),
    )


def masked_flight(flight: Flight) -> tuple[Flight, tuple[RecordFault, ...]]:
    """The flight with its faulty stretches masked, itself where there are none, and all its faults.

    For flights that did not come through `assemble`, or were changed since. Raises FlightRecordError where the
    flight is no valid record, or the faults leave nothing of it.
    """
    again = assemble(unassemble(flight))
    fresh = tuple(fault for fault in again.faults if fault not in flight.faults)
    if all(fault.decisive for fault in fresh):
        return flight, (*flight.faults, *fresh)
    if flight.wind is not None:
        first = int(np.searchsorted(flight.time, again.time[0] - 0.5 * flight.step))
        again = replace(again, wind=flight.wind[first : first + again.samples])
    return again, (*flight.faults, *fresh)


def _spike_faults(time: FloatArray, spikes: Mapping[str, BoolArray]) -> tuple[RecordFault, ...]:
    """Isolated spikes in the channels that every analysis needs."""
    return tuple(
        fault_over(name, "spikes", time, found, f"{counted(count, 'sample')} replaced by a cubic spline")
        for name, found in spikes.items()
        if name in CHANNELS and (count := int(np.count_nonzero(found)))
    )


def unassemble(flight: Flight) -> Record:
    """The record of a flight: NaN outside its segments, so that a cut outlives a round trip.

    Raises FlightRecordError where the flight, built by hand perhaps, is not a valid record.
    """
    usable = np.zeros(flight.time.size, dtype=np.bool_)
    for start, stop in flight.segments:
        usable[start:stop] = True
    present = {name: getattr(flight, name) for name in (*CHANNELS, *OPTIONAL_CHANNELS)}
    return validated(
        Record,
        {
            "time": flight.time,
            "channels": {
                name: _masked(values, usable) for name, values in present.items() if values is not None
            },
            "vehicle": validated(VehicleRecord, vars(flight.vehicle), group="vehicle"),
            "instruments": flight.instruments,
            "planet": flight.planet,
            "title": flight.title,
            "source": flight.source,
            "path": flight.path,
            "notes": flight.notes,
        },
    )


def _masked(values: FloatArray, usable: BoolArray) -> FloatArray:
    """`values` with NaN where not `usable`; a wrong shape is left for the schema to refuse."""
    return np.where(usable, values, np.nan) if values.shape == usable.shape else values


def _without_empty(channels: Mapping[str, FloatArray]) -> Channels:
    """The channels that hold any sample at all."""
    return {name: values for name, values in channels.items() if np.any(np.isfinite(values))}


def _bridged(time: FloatArray, channels: Mapping[str, FloatArray]) -> tuple[Channels, list[str]]:
    """Short gaps filled, by the rules of `resample`."""
    step = float((time[-1] - time[0]) / (time.size - 1))
    fast, slow = longest_gap(step, channels["q"], channels["r"]), max(1, round(BRIDGED_SECONDS / step))
    filled: Channels = {}
    notes = []
    for name, values in channels.items():
        longest = fast if name in INERTIAL_CHANNELS else slow
        filled[name] = bridge(time, values, longest)
        count = int(np.count_nonzero(np.isnan(values) & np.isfinite(filled[name])))
        if count:
            notes.append(f"{name}: {counted(count, 'missing sample')} bridged by a cubic spline (gaps up to {longest})")
    return filled, notes


def _segments(time: FloatArray, channels: Mapping[str, FloatArray]) -> tuple[Segments, list[str]]:
    """The stretches, long enough to use, with every needed channel known; notes on what is left out."""
    known = {name: np.isfinite(channels[name]) for name in CHANNELS if name in channels}
    for name in CHANNELS:
        if name not in known:
            raise _nothing_usable(name)
    usable = np.logical_and.reduce(list(known.values()))
    segments = tuple((start, stop) for start, stop in runs(usable) if stop - start >= MINIMUM_SAMPLES)
    if not segments:
        raise _nothing_usable(min(known, key=lambda name: int(np.count_nonzero(known[name]))))
    kept = np.zeros_like(usable)
    for start, stop in segments:
        kept[start:stop] = True
    cuts = runs(~kept)
    notes = [_cut_note(time, start, stop, known) for start, stop in cuts[:MOST_CUTS_NAMED]]
    if len(cuts) > MOST_CUTS_NAMED:
        samples = sum(stop - start for start, stop in cuts[MOST_CUTS_NAMED:])
        notes.append(f"{len(cuts) - MOST_CUTS_NAMED} more such stretches ({samples} samples) left out")
    return segments, notes


def _cut_note(time: FloatArray, start: int, stop: int, known: Mapping[str, BoolArray]) -> str:
    lacking = ", ".join(name for name, finite in known.items() if not np.all(finite[start:stop]))
    inside = start > 0 and stop < len(time)
    why = f"a gap too long to bridge in {lacking}" if inside else f"at the record's end, without {lacking}"
    return f"{time[start]:.3f} to {time[stop - 1]:.3f} s ({counted(stop - start, 'sample')}) left out: {why}"


def _filled(step: float, channels: Mapping[str, FloatArray], segments: Segments) -> tuple[Channels, list[str]]:
    """Channels without NaN, by placeholders; a note where an optional one needs them inside a segment."""
    whole: Channels = {}
    notes = []
    longest = longest_crossed(step, channels["q"], channels["r"])
    for name, values in channels.items():
        inside = sum(int(np.count_nonzero(np.isnan(values[start:stop]))) for start, stop in segments)
        if inside:
            notes.append(f"{name}: {inside} samples in long gaps are interpolated")
        whole[name] = crossed(values, longest) if name in INERTIAL_CHANNELS else joined(values)
    return whole, notes


def _nothing_usable(name: str) -> Exception:
    return refusal(
        name,
        "too many missing samples",
        f"a stretch of at least {MINIMUM_SAMPLES} samples in which every needed channel is known",
        "a channel recorded at a much lower rate than the others, or a dropout throughout",
        "interpolate slow channels to the samples of 'time' before import, or give a longer record",
    )
