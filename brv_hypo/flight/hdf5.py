"""HDF5 in and out, as a plain tree of datasets with units; the only module that imports h5py.

A file is written whole or not at all: to a temporary file beside it, then renamed.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from brv_hypo.errors import FlightRecordError, UsageError

if TYPE_CHECKING:
    import h5py


@dataclass(frozen=True)
class Dataset:
    """Values of any shape and their unit string; `units` is None where the file states none."""

    values: NDArray[Any]
    units: str | None


@dataclass(frozen=True)
class Tree:
    """One HDF5 group: attributes (numbers and text), datasets, and groups below it."""

    attributes: Mapping[str, Any] = field(default_factory=dict)
    datasets: Mapping[str, Dataset] = field(default_factory=dict)
    groups: Mapping[str, Tree] = field(default_factory=dict)


def read_tree(path: str | Path, *, without: tuple[str, ...] = ()) -> Tree:
    """The content of an HDF5 file, leaving the top-level groups `without` unread.

    Raises FlightRecordError where the file is missing, unreadable or not HDF5.
    """
    import h5py

    file = Path(path)
    if not file.is_file():
        raise FlightRecordError(
            f"{file}: found {'a directory' if file.is_dir() else 'no such file'}, expected a flight record. "
            "Likely cause: a misspelt path, or a relative path from another directory. "
            "Remedy: give the path of an existing file."
        )
    if not h5py.is_hdf5(file):
        raise FlightRecordError(
            f"{file}: found a file that is not HDF5, expected a flight record (format 1). "
            "Likely cause: a text table or MATLAB file, a truncated copy, or no permission to read. "
            "Remedy: bring a foreign record in with `brv-hypo import`, or copy the file again."
        )
    try:
        with h5py.File(file, "r") as handle:
            return _read_group(handle, without)
    except OSError as error:
        raise FlightRecordError(
            f"{file}: found HDF5 that cannot be read ({error}), expected an intact file. "
            "Likely cause: a truncated or damaged copy. Remedy: copy the file again from its source."
        ) from error


def write_tree(
    path: str | Path, tree: Tree, *, dimension: str | None = "time", overwrite: bool = False
) -> None:
    """Write `tree`; the root dataset `dimension` becomes the scale of all root datasets of its length.

    Raises UsageError where the file exists and `overwrite` is false, or where it cannot be written.
    """
    import h5py

    file = Path(path)
    if file.exists() and not overwrite:
        raise UsageError(
            f"{file} exists already and is left as it is. Choose another name, or force the overwrite."
        )
    partial = file.with_name(f".{file.name}.{os.getpid()}.partial")
    try:
        with h5py.File(partial, "w") as handle:
            _write_group(handle, tree)
            if dimension is not None:
                _attach_scale(handle, dimension)
        os.replace(partial, file)
    except OSError as error:
        raise UsageError(
            f"{file} cannot be written: {error}. Choose a directory that exists, is writable and has room."
        ) from error
    finally:
        partial.unlink(missing_ok=True)


def _read_group(group: h5py.Group, without: tuple[str, ...] = ()) -> Tree:
    import h5py

    datasets: dict[str, Dataset] = {}
    groups: dict[str, Tree] = {}
    for name in group:
        if name in without:
            continue
        item = group.get(name)
        if isinstance(item, h5py.Dataset):
            units = _text(item.attrs["units"]) if "units" in item.attrs else None
            datasets[name] = Dataset(_values(item), units)
        elif isinstance(item, h5py.Group):
            groups[name] = _read_group(item)
    return Tree({name: _plain(value) for name, value in group.attrs.items()}, datasets, groups)


def _values(dataset: h5py.Dataset) -> NDArray[Any]:
    import h5py

    if h5py.check_string_dtype(dataset.dtype) is not None:
        return np.asarray(dataset.asstr()[()])
    return np.asarray(dataset[()])


def _plain(value: Any) -> Any:
    """An attribute as Python text or number, or an array where it holds several."""
    if isinstance(value, bytes | np.bytes_):
        return value.decode("utf-8", errors="replace")
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray) and value.size == 1:
        return _plain(value.reshape(-1)[0])
    return value


def _text(value: Any) -> str:
    return str(_plain(value))


def _write_group(group: h5py.Group, tree: Tree) -> None:
    for name, value in tree.attributes.items():
        group.attrs[name] = value
    for name, dataset in tree.datasets.items():
        written = group.create_dataset(name, data=dataset.values)
        if dataset.units is not None:
            written.attrs["units"] = dataset.units
    for name, below in tree.groups.items():
        _write_group(group.create_group(name), below)


def _attach_scale(handle: h5py.File, dimension: str) -> None:
    """Make `dimension` the scale of the first axis of every root dataset of its length."""
    import h5py

    scale = handle[dimension]
    scale.make_scale(dimension)
    for name, item in handle.items():
        if name != dimension and isinstance(item, h5py.Dataset) and item.shape[:1] == scale.shape:
            item.dims[0].attach_scale(scale)
