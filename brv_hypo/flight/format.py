"""Format 1 on disk, and from a `Record`, as flown, to a `Flight`, ready to analyse.

The order of `assemble` is fixed: faults are masked; spikes are replaced; time is made uniform; short gaps are
bridged; missing channels are derived; what is still missing cuts the flight into segments. `unassemble` goes back.
Entrances: `load_flight`, `save_flight`; `one_flight` and `flights_of` for what a function takes for a flight: a path,
a `Flight`, a simulated flight, or a sequence of these.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.errors import FlightRecordError, UsageError
from brv_hypo.flight import record as format_1
from brv_hypo.flight import tolerances
from brv_hypo.flight.cleaning import despiked, interpolated_holds, mask_faults
from brv_hypo.flight.clock import bridge, crossed, joined, longest_crossed, longest_gap, regularise, runs
from brv_hypo.flight.derived import derive
from brv_hypo.flight.record import CHANNEL_DIMENSIONS, CHANNELS, Channels, Flight, Record, RecordFault, validated
from brv_hypo.flight.tolerances import DEFAULT_GRADE, INSTRUMENT_DIMENSIONS, Instruments, instruments_from, of_grade
from brv_hypo.flight.units import SI, Dimension, to_si
from brv_hypo.io.binary import Dataset, Tree, read_tree, write_tree
from brv_hypo.io.text import counted, meant, naming, one_line, refusal
from brv_hypo.thresholds import BRIDGED_SECONDS, MINIMUM_SAMPLES

# ---- From a `Record`, as flown, to a `Flight`, ready to analyse, and back ----


Segments = tuple[tuple[int, int], ...]

MOST_CUTS_NAMED = 10
_ABOUT = ("instruments", "planet", "title", "source", "path")  # what a record and its flight share as it is


def assemble(record: Record) -> Flight:
    """The flight of a record, notes on what was changed; FlightRecordError without 16 samples in which all is known."""
    stamps, masked, masks = mask_faults(record.time, record.channels)
    masked, holds = interpolated_holds(stamps, masked)
    faults = (*masks, *holds)
    clean, spikes, spike_notes = despiked(stamps, masked)
    notes = [*record.notes, *(f"{one.channel}: {one.fault}, {one.action}" for one in faults), *spike_notes]
    with naming(record.path):
        time, recorded, resampled = regularise(stamps, clean)
        bridged, gap_notes = _bridged(time, recorded)
        channels, derived = derive(bridged, record.planet, record.vehicle.reference_length)
        segments, cut_notes = _segments(time, channels)
    spike_faults = []
    for name in (name for name in spikes if name in CHANNELS):
        at = np.flatnonzero(spikes[name])
        words = f"{counted(at.size, 'sample')} replaced by a cubic spline"
        spike_faults.append(RecordFault.over(stamps[at], name, "spikes", words))
    first, last = segments[0][0], segments[-1][1]
    whole, filled = _filled(float(time[1] - time[0]), channels, segments)
    arrays: dict[str, Any] = {name: values[first:last] for name, values in {"time": time, **whole}.items()}
    return Flight(
        **arrays,
        vehicle=record.vehicle,
        **{name: getattr(record, name) for name in _ABOUT},
        segments=tuple((start - first, stop - first) for start, stop in segments),
        notes=(*notes, *resampled, *gap_notes, *derived, *cut_notes, *filled),
        faults=(*faults, *spike_faults),
    )


def masked_flight(flight: Flight) -> tuple[Flight, tuple[RecordFault, ...]]:
    """The flight with its faulty stretches masked, itself where there are none, and all its faults. For flights that
    did not come through `assemble`, or were changed since. Raises FlightRecordError where the flight is no valid
    record, or the faults leave nothing of it.
    """
    again = assemble(unassemble(flight))
    fresh = tuple(fault for fault in again.faults if fault not in flight.faults)
    if all(fault.decisive for fault in fresh):
        return flight, (*flight.faults, *fresh)
    if flight.wind is not None:
        first = int(np.searchsorted(flight.time, again.time[0] - 0.5 * flight.step))
        again = replace(again, wind=flight.wind[first : first + again.samples])
    return again, (*flight.faults, *fresh)


def unassemble(flight: Flight) -> Record:
    """The record of a flight, NaN outside its segments, so that cuts stay; FlightRecordError where it is not valid."""
    usable, channels = flight.measured(), dict(flight.columns())
    time = channels.pop("time")
    for name, values in channels.items():
        if values.shape == usable.shape:  # a wrong one is left for `Record` to refuse
            channels[name] = np.where(usable, values, np.nan)
    return validated(
        Record,
        {
            "time": time,
            "channels": channels,
            "vehicle": format_1.checked_vehicle(vars(flight.vehicle)),
            **{name: getattr(flight, name) for name in _ABOUT},
            "notes": flight.notes,
        },
    )


def _bridged(time: FloatArray, channels: Mapping[str, FloatArray]) -> tuple[Channels, list[str]]:
    """The channels that hold any sample at all, short gaps filled by the rules of `clock`; notes."""
    step = float((time[-1] - time[0]) / (time.size - 1))
    fast, slow = longest_gap(step, channels["q"], channels["r"]), max(1, round(BRIDGED_SECONDS / step))
    filled: Channels = {}
    notes = []
    for name, values in channels.items():
        if not np.any(np.isfinite(values)):
            continue
        longest = fast if name in format_1.INERTIAL_CHANNELS else slow
        filled[name] = bridge(time, values, longest)
        count = int(np.count_nonzero(np.isnan(values) & np.isfinite(filled[name])))
        if count:
            notes.append(f"{name}: {counted(count, 'missing sample')} bridged by a cubic spline (gaps up to {longest})")
    return filled, notes


def _segments(time: FloatArray, channels: Mapping[str, FloatArray]) -> tuple[Segments, list[str]]:
    """The stretches, long enough to use, with every needed channel known; notes on what is left out."""
    nothing = np.full(time.size, np.nan)
    known = {name: np.isfinite(channels.get(name, nothing)) for name in CHANNELS}
    usable = np.logical_and.reduce(list(known.values()))
    segments = tuple((start, stop) for start, stop in runs(usable) if stop - start >= MINIMUM_SAMPLES)
    if not segments:
        found = "too many missing samples"
        expected = f"a stretch of at least {MINIMUM_SAMPLES} samples in which every needed channel is known"
        cause = "a channel recorded at a much lower rate than the others, or a dropout throughout"
        remedy = "interpolate slow channels to the samples of 'time' before import, or give a longer record"
        raise refusal(min(known, key=lambda name: int(np.count_nonzero(known[name]))), found, expected, cause, remedy)
    bounds = (0, *(edge for segment in segments for edge in segment), time.size)
    cuts = [(a, b) for a, b in zip(bounds[::2], bounds[1::2], strict=True) if a < b]
    notes = []
    for start, stop in cuts[:MOST_CUTS_NAMED]:
        lacking = ", ".join(name for name, finite in known.items() if not np.all(finite[start:stop]))
        inside = start > 0 and stop < time.size
        why = f"a gap too long to bridge in {lacking}" if inside else f"at an end of the record, without {lacking}"
        span = f"{time[start]:.3f} to {time[stop - 1]:.3f} s ({counted(stop - start, 'sample')})"
        notes.append(f"{span} left out: {why}")
    if len(cuts) > MOST_CUTS_NAMED:
        samples = sum(stop - start for start, stop in cuts[MOST_CUTS_NAMED:])
        notes.append(f"{len(cuts) - MOST_CUTS_NAMED} more such stretches ({samples} samples) left out")
    return segments, notes


def _filled(step: float, channels: Mapping[str, FloatArray], segments: Segments) -> tuple[Channels, list[str]]:
    """Channels without NaN, by placeholders; a note where an optional one needs them inside a segment."""
    whole: Channels = {}
    notes = []
    longest = longest_crossed(step, channels["q"], channels["r"])
    for name, values in channels.items():
        inside = sum(int(np.count_nonzero(np.isnan(values[start:stop]))) for start, stop in segments)
        if inside:
            notes.append(f"{name}: {inside} samples in long gaps are interpolated")
        whole[name] = crossed(values, longest) if name in format_1.INERTIAL_CHANNELS else joined(values)
    return whole, notes


# ---- Format 1 on disk: `load_flight`, `save_flight` ----


# All that is read of a record; the rest of the file is never opened.
READ = {
    "": tuple(CHANNEL_DIMENSIONS),
    "vehicle": tuple(format_1.VEHICLE_DIMENSIONS),
    "instruments": tuple(INSTRUMENT_DIMENSIONS),
}
NOT_READ = ("truth", "raw")  # groups of what was planted, and of the tables that a record was made from
MOST_NOTES = 100  # lines kept of a record's history, and names given of datasets that are ignored

Quantity = Dataset  # a planted value of any shape with its units, for the group `truth`


def load_flight(
    path: str | Path, *, start: float | None = None, stop: float | None = None, instruments: str | Path | None = None
) -> Flight:
    """The flight in a format 1 file: SI, uniform in time, gaps bridged or cut.

    `Flight.notes` says what was despiked, resampled, bridged, cut and derived. The group `truth` is not read.

    Parameters
    ----------
    path : str or Path
    start, stop : float, optional
        Part of the record to use, s.
    instruments : str or Path, optional
        Tolerances in place of the record's: a grade (laboratory, tactical, industrial) or a YAML file.

    Returns
    -------
    Flight
        Channels (n,), SI, angles in rad.

    Raises
    ------
    FlightRecordError
        The record cannot be read or is invalid; MissingRecordError, a FileNotFoundError, where there is none.
    UsageError
        The window holds too few samples.

    Examples
    --------
    >>> import brv_hypo
    >>> brv_hypo.simulate("research_cone", seed=4).save("cone.h5")
    >>> brv_hypo.load_flight("cone.h5", start=1.0, stop=3.0).samples
    401
    """
    flight = windowed(assemble(read_record(path)), start, stop)
    if instruments is None:
        return flight
    return replace(flight, instruments=instruments_from(instruments, flight.instruments))


def windowed(flight: Flight, start: float | None, stop: float | None) -> Flight:
    """The part of the flight from `start` to `stop` (s; None leaves an end open); UsageError where it is too short."""
    if start is None and stop is None:
        return flight
    window = flight.window(start, stop)
    if window.samples < MINIMUM_SAMPLES:
        raise UsageError(
            f"the window [{start}, {stop}] s holds {window.samples} samples, expected at least "
            f"{MINIMUM_SAMPLES}. Widen --start and --stop: the record runs from "
            f"{flight.time[0]:.3f} to {flight.time[-1]:.3f} s at {flight.sample_rate:.4g} Hz."
        )
    return window


def save_flight(
    flight: Flight | Record, path: str | Path, *, truth: Mapping[str, Any] | None = None, overwrite: bool = False
) -> None:
    """Write a flight, or a record as flown, as a format 1 file in SI; samples outside a flight's segments become NaN.

    `truth` holds what was planted: numbers, arrays, `Quantity`, text, or mappings of these (subgroups).
    The file is written whole or not at all. Raises UsageError where it exists and `overwrite` is false.
    """
    record = flight if isinstance(flight, Record) else unassemble(flight)
    header = {"format": format_1.FORMAT, "format_version": format_1.FORMAT_VERSION, "planet": record.planet}
    optional = {"title": record.title, "source": record.source, "history": "\n".join(record.notes)}
    stated = {key: getattr(record.instruments, key) for key in record.instruments.stated}
    groups = {
        "vehicle": Tree(datasets=_with_units(vars(record.vehicle), format_1.VEHICLE_DIMENSIONS)),
        "instruments": Tree({"grade": record.instruments.grade}, _with_units(stated, INSTRUMENT_DIMENSIONS)),
    }
    if truth is not None:
        groups["truth"] = _truth_tree(truth)
    tree = Tree(
        attributes={**header, **{name: text for name, text in optional.items() if text}},
        datasets=_with_units({"time": record.time, **record.channels}, CHANNEL_DIMENSIONS),
        groups=groups,
    )
    write_tree(path, tree, overwrite=overwrite)


format_1.write_with.append(save_flight)


def read_record(path: str | Path) -> Record:
    """The flight as the file holds it, in SI, before any repair; FlightRecordError where it is invalid."""
    tree = read_tree(path, only=READ)
    with naming(path):
        for name, value in (("format", format_1.FORMAT), ("format_version", format_1.FORMAT_VERSION)):
            if tree.attributes.get(name) != value:
                found, expected = repr(tree.attributes.get(name, "nothing")), repr(value)
                cause = "another kind of HDF5 file, or a record of a newer program"
                remedy = "bring it in with `brv-hypo import`, which maps names and units, or update the program"
                raise refusal(f"/ (root attribute '{name}')", found, expected, cause, remedy)
        unread = [name for name in tree.unread if name not in NOT_READ]
        format_1.check_present((*tree.datasets, *unread))
        if "time" not in tree.datasets:
            raise refusal("time", "no such dataset", "sample times", "another name", "rename it to 'time'")
        vehicle = tree.groups.get("vehicle")
        if vehicle is None:
            found, expected = "no such group", f"a group with {', '.join(format_1.VEHICLE_DIMENSIONS)}"
            cause, remedy = "mass properties kept in another file", "add them, each a scalar dataset with 'units'"
            raise refusal("vehicle", found, expected, cause, remedy)
        properties = _in_si(vehicle.datasets, format_1.VEHICLE_DIMENSIONS, "vehicle/")
        scalars = {name: array.item() if array.size == 1 else array.tolist() for name, array in properties.items()}
        arrays, history = _in_si(tree.datasets, CHANNEL_DIMENSIONS, ""), str(tree.attributes.get("history", ""))
        content = {
            "time": arrays.pop("time"),
            "channels": arrays,
            "vehicle": format_1.checked_vehicle(scalars),
            "instruments": _instruments(tree.groups.get("instruments")),
            **{name: tree.attributes[name] for name in ("planet", "title", "source") if name in tree.attributes},
            "path": str(path),
            "recorded_units": {name: dataset.units or "" for name, dataset in tree.datasets.items()},
            "notes": (*map(one_line, history.splitlines()[:MOST_NOTES]), *_ignored(unread)),
        }
        return validated(Record, content)


def _instruments(group: Tree | None) -> Instruments:
    """The tolerances that the record states, over those of its grade."""
    if group is None:
        return of_grade()
    tolerances.check_known(sorted(group.unread))
    try:
        base = of_grade(str(group.attributes.get("grade", DEFAULT_GRADE)))
    except UsageError as unknown:
        raise FlightRecordError(f"group 'instruments', attribute 'grade': {unknown}") from None
    return tolerances.with_stated(base, _in_si(group.datasets, INSTRUMENT_DIMENSIONS, "instruments/"))


def _in_si(datasets: Mapping[str, Dataset], dimensions: Mapping[str, Dimension], group: str) -> Channels:
    """The datasets of a group as numbers in SI."""
    arrays = {}
    for key, dataset in datasets.items():
        name, dimension = f"{group}{key}", dimensions[key]
        if dataset.units is None:
            found, expected = "no 'units' attribute", f"one, such as '{SI[dimension]}'"
            cause, remedy = "a writer that keeps units elsewhere", f"set the attribute 'units' of '{name}'"
            raise refusal(name, found, expected, cause, remedy)
        arrays[key] = to_si(dataset.values, dataset.units, dimension, name)
    return arrays


def _ignored(names: Sequence[str]) -> Iterator[str]:
    """A note for each dataset that format 1 does not know, with the channel that may have been meant."""
    for name in map(one_line, sorted(names)[:MOST_NOTES]):
        hint = meant(name.lower(), CHANNEL_DIMENSIONS, "", 0.7)
        yield f"dataset '{name}' is not part of format 1 and was ignored{hint and f' ({hint})'}"
    if len(names) > MOST_NOTES:
        yield f"{len(names) - MOST_NOTES} more datasets are not part of format 1 and were ignored"


def _with_units(values: Mapping[str, Any], dimensions: Mapping[str, Dimension]) -> dict[str, Dataset]:
    return {name: Dataset(np.asarray(value, dtype=float), SI[dimensions[name]]) for name, value in values.items()}


def _truth_tree(truth: Mapping[str, Any]) -> Tree:
    attributes, datasets, groups = dict[str, Any](), dict[str, Dataset](), dict[str, Tree]()
    for name, value in truth.items():
        if isinstance(value, Mapping):
            groups[name] = _truth_tree(value)
        elif isinstance(value, str):
            attributes[name] = value
        else:
            quantity = value if isinstance(value, Dataset) else Dataset(value, SI["dimensionless"])
            datasets[name] = replace(quantity, values=np.asarray(quantity.values))
    return Tree(attributes, datasets, groups)


class HoldsFlight(Protocol):
    """Something that has a flight, as a simulated flight has."""

    @property
    def flight(self) -> Flight:
        """The flight."""


FlightSource = str | Path | Flight | HoldsFlight


def one_flight(source: FlightSource) -> Flight:
    """The flight of a path, a `Flight` or a simulated one; UsageError for others, FlightRecordError if not finite."""
    if isinstance(source, str | Path):
        return load_flight(source)
    flight = getattr(source, "flight", source)
    if isinstance(flight, Flight):
        used = np.concatenate([np.arange(*segment) for segment in flight.segments])
        for name, values in flight.arrays().items():
            if not np.all(np.isfinite(values[used])):
                raise refusal(
                    name, "values that are not finite", "finite ones", "a Flight changed in memory", "save and load it"
                )
        return flight
    raise UsageError(
        f"got {type(source).__name__} for a flight, expected the path of a record, a Flight or a simulated flight."
    )


def flights_of(source: FlightSource | Sequence[FlightSource]) -> tuple[Flight, ...]:
    """The flights of one source or of a sequence of them. Raises UsageError where there is none."""
    several = isinstance(source, Sequence) and not isinstance(source, str)
    flights = tuple(one_flight(each) for each in source) if several else (one_flight(source),)  # type: ignore[union-attr, arg-type]
    if not flights:
        raise UsageError("got no flight, expected one at least: a path, a Flight, or a sequence of these.")
    return flights
