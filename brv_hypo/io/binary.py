"""Binary files: HDF5 in and out as a plain tree of datasets with units, columns of Parquet and MATLAB files by name.

All are read in `io.sandbox`: headers are checked against the budget before anything is read, and only what is
requested is opened. `write_tree` writes a file whole or not at all, by `io.files`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from brv_hypo.errors import FlightRecordError
from brv_hypo.io.files import check_hdf5, check_regular, check_target, write_whole
from brv_hypo.io.sandbox import Budget, read_in_sandbox
from brv_hypo.io.text import one_line, refused

if TYPE_CHECKING:
    import h5py

DEEPEST = 8  # groups below groups, structs below structs
MOST_COLUMNS = 10_000  # whose names are kept
MOST_CHANNELS = 1000  # columns of a matrix


@dataclass(frozen=True)
class Dataset:
    """Values of any shape and their unit string; `units` is None where the file states none."""

    values: NDArray[Any]
    units: str | None


@dataclass(frozen=True)
class Tree:
    """One HDF5 group: attributes (numbers and text), datasets, groups below it; names that were not read."""

    attributes: Mapping[str, Any] = field(default_factory=dict)
    datasets: Mapping[str, Dataset] = field(default_factory=dict)
    groups: Mapping[str, Tree] = field(default_factory=dict)
    unread: tuple[str, ...] = ()


Selection = Mapping[str, Iterable[str] | None]
"""For each group to read ("" is the root) its datasets to read; None means all that is in it and below it."""


def read_tree(path: str | Path, *, only: Selection | None = None) -> Tree:
    """The content of an HDF5 file; without `only` all of it.

    What is not selected is never opened: its names are in `Tree.unread`, as are links and what is not numeric where
    all was to be read. Raises FlightRecordError where the file is missing, unreadable, damaged or too large.
    """
    check_regular(path, "a flight record", FlightRecordError)
    return read_in_sandbox("HDF5", tree_of, path, {"": None} if only is None else only)


def tree_of(path: str, budget: Budget, only: Selection) -> Tree:
    """The tree of a file, for a reader in the sandbox; `only` as of `read_tree`."""
    import h5py

    if not h5py.is_hdf5(path):
        cause = "a text table or MATLAB file, a truncated copy, or no permission to read"
        remedy = "bring a foreign record in with `brv-hypo import`, or copy the file again"
        raise refused("", "a file that is not HDF5", "a flight record (format 1)", cause, remedy)
    with h5py.File(path, "r") as file:
        return _read_group(file, "", only, budget, whole=False)


def _read_group(group: Any, place: str, only: Selection, budget: Budget, whole: bool) -> Tree:
    """The group at `place`; `whole` takes all that is below it."""
    import h5py

    if place.count("/") >= DEEPEST:
        found = f"more than {DEEPEST} groups in one another"
        raise refused(f"group '{place}'", found, "a tree of groups", "a forged or damaged file", "write it anew")
    wanted = only.get(place, ())
    whole, names = whole or wanted is None, {*(wanted or ())}
    datasets: dict[str, Dataset] = {}
    groups: dict[str, Tree] = {}
    for name in group:
        inner = f"{place}/{name}".lstrip("/")
        below = whole or any(key == inner or key.startswith(f"{inner}/") for key in only)
        is_link = not isinstance(group.get(name, getlink=True), h5py.HardLink)
        if name in names and is_link:
            raise _elsewhere(f"dataset '{inner}'")
        if is_link or not (name in names or below) or name.startswith("#"):  # where MATLAB keeps what it refers to
            continue
        item = group[name]
        if isinstance(item, h5py.Group) and below:
            groups[name] = _read_group(item, inner, only, budget, whole)
        elif isinstance(item, h5py.Dataset) and (name in names or (whole and _is_numeric(item))):
            datasets[name] = _read_dataset(item, f"dataset '{inner}'", budget)
    unread = tuple(name for name in group if name not in datasets and name not in groups)
    return Tree({name: _plain(value) for name, value in group.attrs.items()}, datasets, groups, unread)


def _elsewhere(place: str) -> FlightRecordError:
    cause, remedy = "a file that collects others", "copy the values into one file (`h5repack` or `h5copy`)"
    return refused(place, "a link, or values in other files", "values in the place itself", cause, remedy)


def _is_numeric(item: Any) -> bool:
    return item.shape is not None and item.dtype.kind in "fiub"


def _read_dataset(item: Any, place: str, budget: Budget) -> Dataset:
    """The header checked, then the values read."""
    if not _is_numeric(item):
        found = f"values of type {item.dtype}" if item.shape is not None else "no values"
        cause = "text, or a complex, compound or reference type"
        raise refused(place, found, "numbers", cause, "write it as floating-point numbers")
    if item.is_virtual or item.external:
        raise _elsewhere(place)
    if item.chunks is not None:
        budget.check(math.prod(item.chunks) * item.dtype.itemsize, place)
    budget.take(item.size * item.dtype.itemsize, place)
    units = item.attrs.get("units")
    return Dataset(np.asarray(item[()]), None if units is None else one_line(str(_plain(units))))


def _plain(value: Any) -> Any:
    """An attribute as text, a number, or a tuple of these; for anything else a text that says what it is."""
    if isinstance(value, bytes):
        return value.decode("utf-8", errors="replace")
    if isinstance(value, np.ndarray):
        items = value.reshape(-1)
        return _plain(items[0]) if items.size == 1 else tuple(_plain(one) for one in items)
    if isinstance(value, np.generic):
        return _plain(value.item())
    return value if isinstance(value, bool | int | float | str) else f"<{type(value).__name__}>"


def write_tree(path: str | Path, tree: Tree, *, overwrite: bool = False) -> None:
    """Write `tree`, with its root dataset `time` as the scale of others as long; UsageError as of `check_target`."""
    import h5py

    check_target(path, overwrite=overwrite)
    check_hdf5(path)
    # Made in memory first: a medium that fails must not fail inside the library.
    with h5py.File("image", "w", driver="core", backing_store=False) as handle:
        _write_group(handle, tree)
        if "time" in tree.datasets:
            scale = handle["time"]
            scale.make_scale("time")
            for name, item in handle.items():
                if name != "time" and isinstance(item, h5py.Dataset) and item.shape[:1] == scale.shape:
                    item.dims[0].attach_scale(scale)
        handle.flush()
        image = bytes(handle.id.get_file_image())
    write_whole(path, image, overwrite=overwrite)


def _write_group(group: h5py.Group, tree: Tree) -> None:
    for name, value in tree.attributes.items():
        group.attrs[name] = value
    for name, dataset in tree.datasets.items():
        written = group.create_dataset(name, data=dataset.values)
        if dataset.units is not None:
            written.attrs["units"] = dataset.units
    for name, below in tree.groups.items():
        _write_group(group.create_group(name), below)


# ---- Columns of Parquet and MATLAB files by name ----


@dataclass(frozen=True)
class ColumnTable:
    """The columns that were requested, as far as the file has them, and the `names` of all that it has."""

    columns: Mapping[str, NDArray[Any]]
    names: tuple[str, ...]
    units: Mapping[str, str] = field(default_factory=dict)  # as far as the table states them
    notes: tuple[str, ...] = ()
    lines: NDArray[Any] | None = None  # number of the line of each row, of a text
    stamps: tuple[str, ...] = ()  # columns of dates or times of day, in s
    delimiter: str = ","
    zero: np.datetime64 | None = None  # from which dates count


def parquet_table(path: str, budget: Budget, names: tuple[str, ...]) -> ColumnTable:
    """The columns `names` of a Parquet file."""
    import pyarrow as pa
    from pyarrow import parquet, types

    file = parquet.ParquetFile(path)
    available = tuple(str(name) for name in file.schema_arrow.names)
    columns: dict[str, NDArray[Any]] = {}
    stamps: list[str] = []
    for name in (name for name in names if name in available):
        budget.take(8 * max(file.metadata.num_rows, 0), f"dataset '{name}'")
        column = file.read(columns=[name], use_threads=False).column(0)
        kind = column.type.value_type if types.is_dictionary(column.type) else column.type
        column = column.cast(kind)
        if types.is_timestamp(kind):  # UTC, whatever the zone
            columns[name] = np.asarray(column.cast(pa.int64()).to_numpy(), "i8").view(f"M8[{kind.unit}]")
        elif types.is_string(kind) or types.is_large_string(kind):
            budget.take(8 * column.nbytes, f"dataset '{name}'")
            columns[name] = np.array(column.to_pylist(), dtype=np.str_)
        elif types.is_duration(kind) or types.is_time(kind):
            stamps.append(name)
            counts = column.cast(pa.int32() if types.is_time32(kind) else pa.int64())
            columns[name] = counts.to_numpy() / (np.timedelta64(1, "s") / np.timedelta64(1, kind.unit))
        else:
            try:
                values = column.cast(pa.float64(), safe=False).to_numpy(zero_copy_only=False)
            except pa.ArrowException:
                raise _not_numbers(name, str(column.type)) from None
            columns[name] = np.asarray(values, dtype=np.float64)
    return ColumnTable(columns, available[:MOST_COLUMNS], stamps=tuple(stamps))


def mat_table(path: str, budget: Budget, names: tuple[str, ...]) -> ColumnTable:
    """The columns `names` of a MATLAB file, those in a struct as struct.field; v7.3 is read as the HDF5 that it is."""
    from scipy.io import loadmat, whosmat

    try:
        kinds = {name: (shape, kind) for name, shape, kind in whosmat(path)}
    except NotImplementedError:
        return _mat_of_hdf5(path, budget, names)
    structs = [name for name, (_, kind) in kinds.items() if kind == "struct"]  # whose fields are to be named
    requested = dict.fromkeys(name.split(".")[0] for name in names) if names else structs
    variables = [name for name in requested if name in kinds]
    for name in variables:
        budget.take(8 * math.prod(int(n) for n in kinds[name][0]), f"dataset '{name}'")
    loaded = loadmat(path, simplify_cells=True, variable_names=variables) if variables else {}
    flat = dict(_flat({name: loaded[name] for name in variables}, "", 0))
    columns = {}
    for name in (name for name in names if name in flat):
        try:
            columns[name] = np.asarray(flat[name], dtype=np.float64)
        except (TypeError, ValueError):
            raise _not_numbers(name, type(flat[name]).__name__) from None
        budget.take(columns[name].nbytes, f"dataset '{name}'")
    others = {name: np.broadcast_to(0.0, shape) for name, (shape, _) in kinds.items() if name not in variables}
    return ColumnTable(columns, tuple(dict([*flat.items(), *_flat(others, "", 0)]))[:MOST_COLUMNS])


def _mat_of_hdf5(path: str, budget: Budget, names: tuple[str, ...]) -> ColumnTable:
    selection: dict[str, list[str] | None] = {} if names else {"": None}
    for name in names:
        # The last part may be the number of a matrix's column.
        for place in {name, name.rpartition(".")[0] if name.rpartition(".")[2].isdigit() else name}:
            group, _, last = place.rpartition(".")
            selection.setdefault(group.replace(".", "/"), []).append(last)  # type: ignore[union-attr]
    tree = tree_of(path, budget, selection)
    held = dict(_flat(_nested(tree), "", 0))
    return ColumnTable({name: held[name] for name in names if name in held}, (*held, *tree.unread))


def _flat(content: Mapping[str, Any], prefix: str, depth: int) -> Iterator[tuple[str, Any]]:
    """Nested structs, arrays of structs and matrices as one list, with dotted names; samples on the longer axis."""
    for name, value in content.items():
        if isinstance(value, list | np.ndarray) and len(np.shape(value)) and isinstance(first := value[0], dict):
            value = {key: np.array([each.get(key) for each in value]) for key in first}
        if isinstance(value, dict) and depth < DEEPEST:
            yield from _flat(value, f"{prefix}{name}.", depth + 1)
        elif isinstance(value, np.ndarray) and value.ndim == 2 and 1 < min(value.shape) <= MOST_CHANNELS:
            samples = value if value.shape[0] >= value.shape[1] else value.T
            yield from ((f"{prefix}{name}.{k + 1}", samples[:, k]) for k in range(samples.shape[1]))
        else:
            yield prefix + name, value


def _nested(tree: Tree) -> dict[str, Any]:
    values = {name: dataset.values for name, dataset in tree.datasets.items()}
    return {**values, **{name: _nested(below) for name, below in tree.groups.items()}}


def _not_numbers(name: str, kind: str) -> FlightRecordError:
    remedy = "map a numeric column (struct.field in a mat file)"
    return refused(f"dataset '{name}'", f"what is not numeric ({kind})", "numbers", "text, dates or a struct", remedy)
