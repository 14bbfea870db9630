"""HDF5 in and out, as a plain tree of datasets with units; reading is done by `io.sandbox`.

A file is written whole or not at all, by `io.atomic`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from numpy.typing import NDArray

from brv_hypo.io.atomic import check_target, write_whole
from brv_hypo.io.sandbox import read_hdf5
from brv_hypo.io.text import one_line

if TYPE_CHECKING:
    import h5py


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


def read_tree(path: str | Path, *, only: Mapping[str, Iterable[str] | None] | None = None) -> Tree:
    """The content of an HDF5 file; None leaves nothing out.

    `only` gives, for each group to read ("" is the root), its datasets to read; None stands for all that is in the
    group and below it. What is not requested is never opened: its names are in `Tree.unread`.
    Raises FlightRecordError where the file is missing, unreadable, damaged or too large.
    """
    selection = None if only is None else {g: None if names is None else [*names] for g, names in only.items()}
    content = read_hdf5(path, selection)
    datasets: dict[str, dict[str, Dataset]] = {}
    for held in content.held:
        group, _, name = held.place.rpartition("/")
        units = None if held.units is None else one_line(str(held.units))
        datasets.setdefault(group, {})[name] = Dataset(held.values, units)
    return _tree_at("", content.groups, datasets)


def _tree_at(
    place: str, groups: Mapping[str, dict[str, Any]], datasets: Mapping[str, dict[str, Dataset]]
) -> Tree:
    below = {name.rpartition("/")[2]: name for name in groups if name and name.rpartition("/")[0] == place}
    return Tree(
        {name: _plain(value) for name, value in groups[place]["attributes"].items()},
        datasets.get(place, {}),
        {name: _tree_at(inner, groups, datasets) for name, inner in below.items()},
        tuple(groups[place]["unread"]),
    )


def _plain(value: Any) -> Any:
    """An attribute of several values as a tuple, which compares and prints like any value."""
    return tuple(value) if isinstance(value, list) else value


def write_tree(
    path: str | Path, tree: Tree, *, dimension: str | None = "time", overwrite: bool = False
) -> None:
    """Write `tree`; the root dataset `dimension` becomes the scale of all root datasets of its length.

    Raises UsageError where the file exists and `overwrite` is false, or where it cannot be written.
    """
    check_target(path, overwrite=overwrite)
    write_whole(path, _image(tree, dimension), overwrite=overwrite)


def _image(tree: Tree, dimension: str | None) -> bytes:
    """The bytes of the HDF5 file, made in memory: a medium that fails must not fail inside the library."""
    import h5py

    with h5py.File("image", "w", driver="core", backing_store=False) as handle:
        _write_group(handle, tree)
        if dimension is not None:
            _attach_scale(handle, dimension)
        handle.flush()
        return bytes(handle.id.get_file_image())


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
