"""Best subsets of the textbook data sets, against R leaps 3.1, complete enumeration and the literature."""

from __future__ import annotations

import csv
import json
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from brv_hypo.subset import best_subsets
from tests.shared_data import shared_file
from tests.studies.subset.stepwise import stepwise_columns
from tests.subset.kernels import best_subsets_by

# Hald's cement data: Draper and Smith, Applied Regression Analysis (x1..x4, y).
HALD = np.array([
    [7, 26, 6, 60, 78.5], [1, 29, 15, 52, 74.3], [11, 56, 8, 20, 104.3], [11, 31, 8, 47, 87.6],
    [7, 52, 6, 33, 95.9], [11, 55, 9, 22, 109.2], [3, 71, 17, 6, 102.7], [1, 31, 22, 44, 72.5],
    [2, 54, 18, 22, 93.1], [21, 47, 4, 26, 115.9], [1, 40, 23, 34, 83.8], [11, 66, 9, 12, 113.3],
    [10, 68, 8, 12, 109.4],
])  # fmt: skip


@dataclass
class Data:
    names: list[str]
    X: NDArray[np.float64]
    y: NDArray[np.float64]

    def named(self, columns: tuple[int, ...]) -> list[str]:
        return [self.names[j - 1] for j in columns]


def _table(relative: str) -> tuple[list[str], list[list[str]]]:
    with shared_file(relative).open() as stream:
        rows = list(csv.reader(stream))
    return rows[0], rows[1:]


def load(name: str) -> Data:
    """A data set as the reference answers used it: the constant in column 0."""
    stem, _, variant = name.partition(":")
    header, rows = _table(f"data/best_subset/{stem}.csv")
    if stem == "prostate_standardised":
        rows = [r for r in rows if r[header.index("train")] == "TRUE"]
        header, rows = header[:-1], [r[:-1] for r in rows]
    values = np.array(rows, dtype=float)
    response = header[-1]
    inputs = header[:11] if stem == "detroit" else header[:-1]
    X = values[:, [header.index(h) for h in inputs]]
    if variant == "log":
        log = [inputs.index(h) for h in ("hydrocarbon", "nox", "so2")]
        X[:, log] = np.log(X[:, log])
    y = values[:, header.index(response)]
    return Data(inputs, np.column_stack([np.ones(len(y)), X]), y)


LEAPS = {
    "hald_cement": "R_leaps_3.1_hald.csv",
    "detroit": "R_leaps_3.1_detroit.csv",
    "prostate_standardised": "R_leaps_3.1_prostate_train.csv",
    "airpollution": "R_leaps_3.1_airpollution_raw.csv",
    "airpollution:log": "R_leaps_3.1_airpollution_log.csv",
}
KERNELS = ("auto", "numpy", "numba-schur")


@pytest.mark.shared
@pytest.mark.parametrize("kernel", KERNELS)
@pytest.mark.parametrize("name", LEAPS)
def test_every_size_agrees_with_r_leaps(name: str, kernel: str) -> None:
    data = load(name)
    _, rows = _table(f"data/best_subset/{LEAPS[name]}")
    result = best_subsets_by(kernel, data.X, data.y, max_terms=len(rows))
    for size, rss, names in rows:
        best = result.best(int(size))
        assert data.named(best.columns) == names.split("+")
        assert best.rss == pytest.approx(float(rss), rel=1e-12)


@pytest.mark.shared
@pytest.mark.parametrize(
    ("key", "name"), [("hald_cement", "hald_cement"), ("detroit", "detroit"), ("prostate", "prostate_standardised")]
)
def test_five_best_agree_with_complete_enumeration(key: str, name: str) -> None:
    reference: dict[str, Any] = json.loads(shared_file("data/best_subset/exhaustive_results.json").read_text())
    entry = next(v for k, v in reference.items() if k.startswith(key))
    data = load(name)
    result = best_subsets(data.X, data.y, max_terms=len(data.names), n_best=4)
    for size, rows in entry["best_by_size"].items():
        for subset, row in zip((s for s in result.subsets if s.size == int(size)), rows[:4], strict=False):
            assert sorted(data.named(subset.columns)) == sorted(row["vars"])
            criteria = subset.criteria
            assert criteria.rss == pytest.approx(row["rss"], rel=1e-9)
            assert criteria.r2 == pytest.approx(row["r2"], rel=1e-9)
            assert criteria.adjusted_r2 == pytest.approx(row["adjr2"], rel=1e-9)
            assert criteria.f_ratio == pytest.approx(row["F_model"], rel=1e-7)
            assert criteria.bic == pytest.approx(row["bic_n_log"], rel=1e-9)
            assert criteria.cp == pytest.approx(row["cp"], rel=1e-7)


@pytest.mark.shared
def test_detroit_best_three_where_forward_selection_is_trapped() -> None:
    """Miller (2002): RSS 6.77 against 21.19 of forward selection."""
    data = load("detroit")
    exact = best_subsets(data.X, data.y, max_terms=3)
    quick = stepwise_columns(data.X, data.y, 3, samples=data.y.size, f_enter=0.0, f_remove=0.0)
    assert data.named(exact.best(3).columns) == ["UEMP.2", "LIC.4", "WE.11"]
    assert round(exact.best(3).rss, 2) == 6.77
    assert [round(rss, 2) for rss, columns in quick if len(columns) == 3] == [21.19]


@pytest.mark.parametrize(
    ("columns", "rss"), [((4,), 883.87), ((1, 2), 57.90), ((1, 2, 4), 47.97), ((1, 2, 3, 4), 47.86)]
)
def test_hald_as_printed_by_draper_and_smith(columns: tuple[int, ...], rss: float) -> None:
    X, y = np.column_stack([np.ones(13), HALD[:, :4]]), HALD[:, 4]
    best = best_subsets(X, y, max_terms=4).best(len(columns))
    assert best.columns == columns
    assert round(best.rss, 2) == rss


def test_hald_mallows_cp_as_printed() -> None:
    X, y = np.column_stack([np.ones(13), HALD[:, :4]]), HALD[:, 4]
    result = best_subsets(X, y, max_terms=3)
    assert [round(result.best(k).criteria.cp, 2) for k in (2, 3)] == [2.68, 3.02]
