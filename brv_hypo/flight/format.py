"""Format 1 on disk, and from a `Record`, as flown, to a `Flight`, ready to analyse.

The order of `assemble` is fixed: faults are masked; spikes are replaced; time is made uniform; short gaps are
bridged; missing channels are derived; what is still missing cuts the flight into segments. `unassemble` goes back.
Entrances: `load_flight`, `save_flight`, and `load_truth` for studies and tests; `one_flight` and `flights_of` for
what a function takes for a flight: a path, a `Flight`, a simulated flight, or a sequence of these.
"""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from brv_hypo.arrays import BoolArray, FloatArray
from brv_hypo.errors import UsageError
from brv_hypo.flight.cleaning import fault_over, find_spikes, mask_faults, spike_note, without_spikes
from brv_hypo.flight.clock import bridge, crossed, joined, longest_crossed, longest_gap, regularise, runs
from brv_hypo.flight.derived import derive
from brv_hypo.flight.record import (
    CHANNEL_DIMENSIONS,
    CHANNELS,
    FORMAT,
    FORMAT_VERSION,
    INERTIAL_CHANNELS,
    OPTIONAL_CHANNELS,
    VEHICLE_DIMENSIONS,
    Channels,
    Flight,
    Header,
    Record,
    RecordFault,
    Vehicle,
    check_present,
    checked_vehicle,
    validated,
)
from brv_hypo.flight.tolerances import (
    DEFAULT_GRADE,
    GRADES,
    INSTRUMENT_DIMENSIONS,
    Instruments,
    instruments_from,
    of_grade,
    with_stated,
)
from brv_hypo.flight.units import SI, Dimension, to_si
from brv_hypo.io.hdf5 import Dataset, Tree, read_tree, write_tree
from brv_hypo.io.text import counted, naming, one_line, refusal
from brv_hypo.thresholds import BRIDGED_SECONDS, MINIMUM_SAMPLES

# ---- From a `Record`, as flown, to a `Flight`, ready to analyse, and back ----


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
        vehicle=record.vehicle,
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
            "vehicle": checked_vehicle(vars(flight.vehicle)),
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


# ---- Format 1 on disk: `load_flight`, `save_flight`, and `load_truth` for studies and tests ----


# All that is read of a record; the rest of the file is never opened.
READ = {
    "": tuple(CHANNEL_DIMENSIONS),
    "vehicle": tuple(VEHICLE_DIMENSIONS),
    "instruments": tuple(INSTRUMENT_DIMENSIONS),
}
MOST_NOTES = 100  # lines kept of a record's history, and names given of datasets that are ignored


@dataclass(frozen=True)
class RawTable:
    """One table as it was read: columns (n,) in the units that the map says, by recorder."""

    recorder: str
    columns: Mapping[str, FloatArray]
    units: Mapping[str, str]


@dataclass(frozen=True)
class Quantity:
    """A planted value of any shape with its units, for the group `truth`."""

    values: ArrayLike
    units: str


def load_flight(path: str | Path, *, start: float | None = None, stop: float | None = None) -> Flight:
    """The flight in a format 1 file: SI, uniform in time, gaps bridged or cut; `start` and `stop` in s.

    `Flight.notes` says what was despiked, resampled, bridged, cut and derived. The group `truth` is not read.
    Raises FlightRecordError (unreadable or invalid) and UsageError (a window without samples).
    """
    return windowed(assemble(read_record(path)), start, stop)


def windowed(flight: Flight, start: float | None, stop: float | None) -> Flight:
    """The part of the flight from `start` to `stop` (s; None leaves an end open), if long enough to use.

    Raises UsageError where it is not.
    """
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
    flight: Flight,
    path: str | Path,
    *,
    truth: Mapping[str, Any] | None = None,
    raw: Sequence[RawTable] = (),
    overwrite: bool = False,
) -> None:
    """Write `flight` as a format 1 file in SI; samples outside its segments become NaN.

    `truth` holds what was planted: numbers, arrays, `Quantity`, text, or mappings of these (subgroups). `raw` are the
    tables that the flight was made from, kept as they were read; no analysis reads them.
    The file is written whole or not at all. Raises UsageError where it exists and `overwrite` is false.
    """
    record = unassemble(flight)
    header = {"format": FORMAT, "format_version": FORMAT_VERSION, "planet": record.planet}
    optional = {"title": record.title, "source": record.source, "history": "\n".join(record.notes)}
    channels = {"time": record.time, **record.channels}
    groups = {
        "vehicle": Tree(datasets=_with_units(vars(record.vehicle), VEHICLE_DIMENSIONS)),
        "instruments": _instruments_tree(record.instruments),
    }
    if truth is not None:
        groups["truth"] = _truth_tree(truth)
    if raw:
        groups["raw"] = Tree(groups={_plain_name(table.recorder): _raw_tree(table) for table in raw})
    tree = Tree(
        attributes={**header, **{name: text for name, text in optional.items() if text}},
        datasets=_with_units(channels, CHANNEL_DIMENSIONS),
        groups=groups,
    )
    write_tree(path, tree, overwrite=overwrite)


def load_truth(path: str | Path) -> dict[str, Any]:
    """What was planted in a simulated flight, as nested dicts of arrays, numbers and text; {} without any.

    For studies and tests alone: nothing that analyses a flight may call this.
    """
    truth = read_tree(path, only={"truth": None}).groups.get("truth")
    return {} if truth is None else _plain_tree(truth)


def read_record(path: str | Path) -> Record:
    """The flight as the file holds it, in SI and validated, before anything is repaired or derived.

    Raises FlightRecordError with the file, the dataset, what was found and expected, and the remedy.
    """
    tree = read_tree(path, only=READ)
    with naming(path):
        return _record_from(tree, str(path))


def _record_from(tree: Tree, path: str) -> Record:
    header = _header(tree.attributes)
    present = (*tree.datasets, *tree.unread)
    if "time" not in tree.datasets:
        check_present(present)
        raise refusal("time", "no such dataset", "sample times", "another name", "rename it to 'time'")
    check_present(present)
    known = tree.datasets
    arrays = {name: _in_si(dataset, CHANNEL_DIMENSIONS[name], name) for name, dataset in known.items()}
    return validated(
        Record,
        {
            "time": arrays.pop("time"),
            "channels": arrays,
            "vehicle": _vehicle(tree.groups.get("vehicle")),
            "instruments": _instruments(tree.groups.get("instruments")),
            "planet": header.planet.strip().lower(),
            "title": one_line(header.title),
            "source": one_line(header.source),
            "path": path,
            "recorded_units": {name: dataset.units or "" for name, dataset in known.items()},
            "notes": (*map(one_line, header.history.splitlines()[:MOST_NOTES]), *_ignored(tree.unread)),
        },
    )


def _header(attributes: Mapping[str, Any]) -> Header:
    if attributes.get("format") != FORMAT:
        raise refusal(
            "/ (root attribute 'format')",
            repr(attributes.get("format", "nothing")),
            f"'{FORMAT}'",
            "another kind of HDF5 file",
            "bring it in with `brv-hypo import`, which maps names and units",
        )
    if attributes.get("format_version") != FORMAT_VERSION:
        raise refusal(
            "/ (root attribute 'format_version')",
            repr(attributes.get("format_version", "nothing")),
            str(FORMAT_VERSION),
            "a record written by a newer program, or by hand",
            "update the program, or write the record in format 1",
        )
    return validated(Header, attributes, group="/ (root attributes)")


def _vehicle(group: Tree | None) -> Vehicle:
    if group is None:
        raise refusal(
            "vehicle",
            "no such group",
            f"a group with {', '.join(VEHICLE_DIMENSIONS)}",
            "mass properties kept in another file",
            "add them, each a scalar dataset with 'units'",
        )
    values: dict[str, Any] = {}
    for name, dimension in VEHICLE_DIMENSIONS.items():
        if name in group.datasets:
            shape = (3,) if name == "accelerometer_position" else ()
            values[name] = _vehicle_value(group.datasets[name], dimension, f"vehicle/{name}", shape)
    return checked_vehicle(values)


def _vehicle_value(dataset: Dataset, dimension: Dimension, name: str, shape: tuple[int, ...]) -> Any:
    array = _in_si(dataset, dimension, name)
    if array.size != int(np.prod(shape)):
        raise refusal(
            name,
            f"shape {array.shape}",
            f"shape {shape}",
            "a history or a list where one value was meant, or too few components",
            "give one value (three, in body axes, for the accelerometer position)",
        )
    return array.reshape(shape).tolist()


def _instruments(group: Tree | None) -> Instruments:
    """The tolerances that the record states, over those of its grade."""
    if group is None:
        return of_grade()
    grade = str(group.attributes.get("grade", DEFAULT_GRADE))
    if grade not in GRADES:
        raise refusal(
            "instruments (attribute 'grade')",
            repr(grade),
            f"one of {', '.join(GRADES)}",
            "another vocabulary",
            "name the nearest grade, and state what is known better as datasets",
        )
    unknown = sorted({*group.datasets, *group.unread} - set(INSTRUMENT_DIMENSIONS))
    if unknown:
        near = difflib.get_close_matches(unknown[0], INSTRUMENT_DIMENSIONS, n=1, cutoff=0.5)
        raise refusal(
            f"instruments/{unknown[0]}",
            "an unknown tolerance",
            f"one of {', '.join(INSTRUMENT_DIMENSIONS)}",
            f"'{near[0]}' is meant" if near else "a tolerance that format 1 does not have",
            "rename or drop it",
        )
    stated = {
        name: _in_si(dataset, INSTRUMENT_DIMENSIONS[name], f"instruments/{name}")
        for name, dataset in group.datasets.items()
    }
    return with_stated(of_grade(grade), stated)


def _instruments_tree(instruments: Instruments) -> Tree:
    """The grade, and the tolerances that differ from it."""
    plain = of_grade(instruments.grade).values()
    stated = {key: value for key, value in instruments.values().items() if value != plain[key]}
    return Tree(attributes={"grade": instruments.grade}, datasets=_with_units(stated, INSTRUMENT_DIMENSIONS))


def _in_si(dataset: Dataset, dimension: Dimension, name: str) -> FloatArray:
    if dataset.units is None:
        raise refusal(
            name,
            "no 'units' attribute",
            f"one, such as '{SI[dimension]}'",
            "a writer that keeps units elsewhere",
            f"set the attribute 'units' of '{name}'",
        )
    if dataset.values.dtype.kind not in "fiu":
        raise refusal(
            name,
            f"values of type {dataset.values.dtype}",
            "numbers",
            "text, or a compound or complex type",
            f"write '{name}' as floating-point numbers",
        )
    return to_si(dataset.values, dataset.units, dimension, name)


def _ignored(names: Sequence[str]) -> tuple[str, ...]:
    """A note for each dataset that format 1 does not know, with the channel that may have been meant."""
    notes = []
    for name in map(one_line, sorted(names)[:MOST_NOTES]):
        guess = difflib.get_close_matches(name.lower(), CHANNEL_DIMENSIONS, n=1, cutoff=0.7)
        meant = f" (is '{guess[0]}' meant?)" if guess else ""
        notes.append(f"dataset '{name}' is not part of format 1 and was ignored{meant}")
    if len(names) > MOST_NOTES:
        notes.append(f"{len(names) - MOST_NOTES} more datasets are not part of format 1 and were ignored")
    return tuple(notes)


def _with_units(values: Mapping[str, Any], dimensions: Mapping[str, Dimension]) -> dict[str, Dataset]:
    return {
        name: Dataset(np.asarray(value, dtype=np.float64), SI[dimensions[name]])
        for name, value in values.items()
    }


def _raw_tree(table: RawTable) -> Tree:
    """The columns as they were read, each with the units that the map gave it."""
    return Tree(
        datasets={
            _plain_name(name): Dataset(values, one_line(table.units[name]))
            for name, values in table.columns.items()
        }
    )


def _plain_name(name: str) -> str:
    """A name that HDF5 takes for one place, not for a path."""
    return one_line(name).replace("/", "_").replace(".", "_") or "_"


def _truth_tree(truth: Mapping[str, Any]) -> Tree:
    attributes: dict[str, Any] = {}
    datasets: dict[str, Dataset] = {}
    groups: dict[str, Tree] = {}
    for name, value in truth.items():
        if isinstance(value, Mapping):
            groups[name] = _truth_tree(value)
        elif isinstance(value, str):
            attributes[name] = value
        elif isinstance(value, Quantity):
            datasets[name] = Dataset(np.asarray(value.values), value.units)
        else:
            datasets[name] = Dataset(np.asarray(value), SI["dimensionless"])
    return Tree(attributes, datasets, groups)


def _plain_tree(tree: Tree) -> dict[str, Any]:
    values = {name: dataset.values[()] for name, dataset in tree.datasets.items()}
    return {**tree.attributes, **values, **{name: _plain_tree(below) for name, below in tree.groups.items()}}


# ---- What a function takes for a flight: a path, a `Flight`, a simulated flight, or a sequence of these ----


@runtime_checkable
class HoldsFlight(Protocol):
    """Something that has a flight, as a simulated flight has."""

    @property
    def flight(self) -> Flight:
        """The flight."""


FlightSource = str | Path | Flight | HoldsFlight


def one_flight(source: FlightSource) -> Flight:
    """The flight of a path, a `Flight` or a simulated flight. Raises UsageError for anything else."""
    if isinstance(source, Flight):
        return source
    if isinstance(source, str | Path):
        return load_flight(source)
    if isinstance(source, HoldsFlight) and isinstance(source.flight, Flight):
        return source.flight
    raise UsageError(
        f"got {type(source).__name__} for a flight, expected the path of a record, a Flight or a simulated flight."
    )


def load_for_analysis(path: str | Path, start: float | None, stop: float | None, instruments: str | None) -> Flight:
    """The record at `path` from `start` to `stop` (s), known to the tolerances that `--instruments` names.

    Without them it is known to those that the record states itself.
    """
    flight = load_flight(path).window(start, stop)
    if instruments is None:
        return flight
    return replace(flight, instruments=instruments_from(instruments, flight.instruments))


def flights_of(source: FlightSource | Sequence[FlightSource]) -> tuple[Flight, ...]:
    """The flights of one source or of a sequence of them. Raises UsageError where there is none."""
    several = isinstance(source, Sequence) and not isinstance(source, str)
    flights = tuple(one_flight(each) for each in source) if several else (one_flight(source),)  # type: ignore[union-attr, arg-type]
    if not flights:
        raise UsageError("got no flight, expected one at least: a path, a Flight, or a sequence of these.")
    return flights
