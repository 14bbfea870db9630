"""Format 1 on disk: `load_flight`, `save_flight`, and `load_truth` for studies and tests."""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from brv_hypo.arrays import FloatArray
from brv_hypo.errors import UsageError
from brv_hypo.files.printed import one_line
from brv_hypo.flight.assemble import assemble, unassemble
from brv_hypo.flight.hdf5 import Dataset, Tree, read_tree, write_tree
from brv_hypo.flight.instruments import (
    DEFAULT_GRADE,
    GRADES,
    INSTRUMENT_DIMENSIONS,
    Instruments,
    of_grade,
    with_stated,
)
from brv_hypo.flight.record import Flight
from brv_hypo.flight.refusal import naming, refusal
from brv_hypo.flight.schema import (
    CHANNEL_DIMENSIONS,
    FORMAT,
    FORMAT_VERSION,
    MINIMUM_SAMPLES,
    VEHICLE_DIMENSIONS,
    Header,
    Record,
    VehicleRecord,
    check_present,
    validated,
)
from brv_hypo.flight.tables import RawTable
from brv_hypo.flight.units import SI, Dimension, to_si

# All that is read of a record; the rest of the file is never opened.
READ = {
    "": tuple(CHANNEL_DIMENSIONS),
    "vehicle": tuple(VEHICLE_DIMENSIONS),
    "instruments": tuple(INSTRUMENT_DIMENSIONS),
}
MOST_NOTES = 100  # lines kept of a record's history, and names given of datasets that are ignored


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
        "vehicle": Tree(datasets=_with_units(record.vehicle.model_dump(), VEHICLE_DIMENSIONS)),
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


def _vehicle(group: Tree | None) -> VehicleRecord:
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
    return validated(VehicleRecord, values, group="vehicle")


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
