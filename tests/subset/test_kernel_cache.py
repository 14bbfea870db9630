"""A compiled kernel on disk is sent for early, one that has to be compiled late; the answer is the same."""

from __future__ import annotations

import os
import sys
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest

from brv_hypo.subset import best, best_columns
from brv_hypo.subset.best import COMPILING_NODES, LOADING_NODES, Effort, kernel_on_disk
from tests.studies.subset.problems import spline_problem

HERE = f"py{sys.version_info.major}{sys.version_info.minor}"


@pytest.mark.parametrize(
    ("name", "told", "age", "there"),
    [
        (f"compiled.search-34.{HERE}.nbi", version("numba"), 0.0, True),
        (f"compiled.search-34.{HERE}.nbi", "0.1.0", 0.0, False),
        (f"compiled.search-34.{HERE}.nbi", version("numba"), 1e9, False),
        ("compiled.search-34.py27.nbi", version("numba"), 0.0, False),
        (f"kernel.record-140.{HERE}.nbi", version("numba"), 0.0, False),
        (f"compiled.search-34.{HERE}.nbi", "", 0.0, False),
    ],
)
def test_an_index_serves_this_python_numba_and_source(
    tmp_path: Path, name: str, told: str, age: float, there: bool
) -> None:
    index = tmp_path / name
    index.write_bytes(b"\x80\x04" + told.encode() + b"the rest")
    written = index.stat().st_mtime - age
    os.utime(index, (written, written))
    assert kernel_on_disk(tmp_path) is there


def test_where_there_is_no_index_there_is_no_kernel(tmp_path: Path) -> None:
    assert not kernel_on_disk(tmp_path / "none")


@pytest.mark.parametrize("on_disk", [True, False])
def test_numpy_is_given_what_sending_for_the_kernel_costs(monkeypatch: pytest.MonkeyPatch, on_disk: bool) -> None:
    monkeypatch.setattr(best, "kernel_on_disk", lambda: on_disk)
    monkeypatch.setattr(best, "_kernel_in_memory", lambda: False)
    expected = LOADING_NODES if on_disk else COMPILING_NODES
    assert best._numpy_budget(Effort(), np.inf) == expected


@pytest.mark.parametrize("nodes", [0, 1, 100])
def test_where_numpy_stops_changes_nothing(monkeypatch: pytest.MonkeyPatch, nodes: int) -> None:
    X, y = spline_problem()
    expected = best_columns(X, y, 6, n_best=2)
    monkeypatch.setattr(best, "_numpy_budget", lambda *_: nodes)
    assert best_columns(X, y, 6, n_best=2) == expected
