"""Parquet and MATLAB files, read in the sandbox."""

from __future__ import annotations

from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from brv_hypo.errors import UsageError
from brv_hypo.importing.formats import Layout, TableFormat, check_columns
from brv_hypo.io.binary import ColumnTable, mat_table, parquet_table
from brv_hypo.io.sandbox import read_in_sandbox


def _read_parquet(path: Path, names: tuple[str, ...], layout: Layout) -> ColumnTable:
    if find_spec("pyarrow") is None:
        raise UsageError(f"{path}: reading parquet needs pyarrow. Install the extra: pip install 'brv-hypo[tables]'.")
    return _selected(read_in_sandbox("Parquet", parquet_table, path, (*names, *layout.where)), layout, path)


def _read_mat(path: Path, names: tuple[str, ...], layout: Layout) -> ColumnTable:
    """A matrix of as many columns as the map has `names` gets these."""
    given: dict[str, str] = {}
    if layout.names:
        known = set(read_in_sandbox("MATLAB", mat_table, path, ()).names)
        count = len(layout.names)
        matrices = [name[:-2] for name in known if name.endswith(".1")]
        whole = [each for each in matrices if f"{each}.{count}" in known and f"{each}.{count + 1}" not in known]
        check_columns((f"a matrix of {count} columns",) if not whole else (), sorted(matrices), path)
        given = {name: f"{min(whole)}.{k}" for k, name in enumerate(layout.names, 1)}
    stored = {name: given.get(name, name) for name in (*names, *layout.where)}
    table = read_in_sandbox("MATLAB", mat_table, path, tuple(stored.values()))
    columns = {name: table.columns[each] for name, each in stored.items() if each in table.columns}
    return _selected(replace(table, columns=columns, names=(*given, *table.names)), layout, path)


def _selected(table: ColumnTable, layout: Layout, path: Path) -> ColumnTable:
    """The rows that the map's `where` keeps."""
    check_columns(layout.where, table.names, path)
    if not layout.where:
        return table
    kept = np.all([table.columns[name] == value for name, value in layout.where.items()], axis=0)
    return replace(table, columns={name: values[kept] for name, values in table.columns.items()})


FORMATS = (TableFormat("parquet", _read_parquet, (".parquet",)), TableFormat("mat", _read_mat, (".mat",)))
