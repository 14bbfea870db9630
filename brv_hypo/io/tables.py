"""Tables of Parquet and MATLAB files by the names of their columns, for `io.sandbox`; headers are checked first."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from brv_hypo.errors import FlightRecordError
from brv_hypo.io.hdf5 import DEEPEST, Tree, tree_of
from brv_hypo.io.sandbox import Budget, refused

MOST_COLUMNS = 10_000  # whose names are kept


@dataclass(frozen=True)
class ColumnTable:
    """The columns that were requested, as far as the file has them, and the `names` of all that it has."""

    columns: Mapping[str, NDArray[Any]]
    names: tuple[str, ...]


def parquet_table(path: str, budget: Budget, names: tuple[str, ...]) -> ColumnTable:
    """The columns `names` of a Parquet file."""
    import pyarrow as pa
    from pyarrow import parquet, types

    file = parquet.ParquetFile(path)
    available = tuple(str(name) for name in file.schema_arrow.names)
    columns = {}
    for name in names:
        if name not in available:
            continue
        budget.take(8 * max(file.metadata.num_rows, 0), f"dataset '{name}'")
        column = file.read(columns=[name], use_threads=False).column(0)
        kind = column.type.value_type if types.is_dictionary(column.type) else column.type
        numeric = (types.is_integer, types.is_floating, types.is_decimal, types.is_boolean)
        if not any(is_kind(kind) for is_kind in numeric):
            raise _not_numbers(name, str(column.type))
        values = column.cast(kind).cast(pa.float64(), safe=False).to_numpy(zero_copy_only=False)
        columns[name] = np.asarray(values, dtype=np.float64)
    return ColumnTable(columns, available[:MOST_COLUMNS])


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
    for name in names:
        if name in flat:
            try:
                columns[name] = np.asarray(flat[name], dtype=np.float64)
            except (TypeError, ValueError):
                raise _not_numbers(name, type(flat[name]).__name__) from None
            budget.take(columns[name].nbytes, f"dataset '{name}'")
    return ColumnTable(columns, (*flat, *(name for name in kinds if name not in variables))[:MOST_COLUMNS])


def _mat_of_hdf5(path: str, budget: Budget, names: tuple[str, ...]) -> ColumnTable:
    selection: dict[str, list[str] | None] = {} if names else {"": None}
    for name in names:
        group, _, last = name.rpartition(".")
        selection.setdefault(group.replace(".", "/"), []).append(last)  # type: ignore[union-attr]
    tree = tree_of(path, budget, selection)
    held = dict(_flat(_nested(tree), "", 0))
    available = held if names else [name for name, values in held.items() if values.dtype.kind in "fiu"]
    return ColumnTable({name: held[name] for name in names if name in held}, (*available, *tree.unread))


def _flat(content: Mapping[str, Any], prefix: str, depth: int) -> Iterator[tuple[str, Any]]:
    """Nested structs as one list, with dotted names."""
    for name, value in content.items():
        if isinstance(value, dict) and depth < DEEPEST:
            yield from _flat(value, f"{prefix}{name}.", depth + 1)
        else:
            yield prefix + name, value


def _nested(tree: Tree) -> dict[str, Any]:
    """A tree as a struct."""
    values = {name: dataset.values for name, dataset in tree.datasets.items()}
    return {**values, **{name: _nested(below) for name, below in tree.groups.items()}}


def _not_numbers(name: str, kind: str) -> FlightRecordError:
    remedy = "map a numeric column (struct.field in a mat file)"
    return refused(f"dataset '{name}'", f"what is not numeric ({kind})", "numbers", "text, dates or a struct", remedy)
