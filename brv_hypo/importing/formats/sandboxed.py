"""Parquet and MATLAB files, read in the sandbox."""

from __future__ import annotations

from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

from brv_hypo.errors import missing_package
from brv_hypo.importing.formats import Layout, TableFormat, check_columns
from brv_hypo.io.binary import ColumnTable, mat_table, parquet_table
from brv_hypo.io.sandbox import read_in_sandbox


def _read_parquet(path: Path, names: tuple[str, ...], layout: Layout) -> ColumnTable:
    if find_spec("pyarrow") is None:
        raise missing_package(f"{path}: reading parquet", "pyarrow", "tables")
    return read_in_sandbox("Parquet", parquet_table, path, names)


def _read_mat(path: Path, names: tuple[str, ...], layout: Layout) -> ColumnTable:
    """A matrix of as many columns as the map has `names` gets these."""
    given: dict[str, str] = {}
    if layout.names:
        known, count = read_in_sandbox("MATLAB", mat_table, path, ()).names, len(layout.names)
        matrix = next((each[: -len(str(count))] for each in known if each.endswith(f".{count}")), "")
        check_columns((f"{matrix or 'matrix.'}{count}",), known, path)
        given = {name: f"{matrix}{k}" for k, name in enumerate(layout.names, 1)}
    table = read_in_sandbox("MATLAB", mat_table, path, tuple(given.get(name, name) for name in names))
    columns = {name: each for name in names if (each := table.columns.get(given.get(name, name))) is not None}
    return replace(table, columns=columns, names=(*given, *table.names))


FORMATS = (TableFormat("parquet", _read_parquet, (".parquet",)), TableFormat("mat", _read_mat, (".mat",)))
