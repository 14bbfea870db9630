"""The compiled kernel is sent for late, as it may have to be compiled; the answer is the same."""

from __future__ import annotations

import numpy as np
import pytest

from brv_hypo.subset import best, best_columns
from brv_hypo.subset.best import COMPILING_NODES
from tests.studies.subset.problems import spline_problem


def test_numpy_is_given_what_compiling_the_kernel_costs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(best, "_kernel_in_memory", lambda: False)
    assert best._numpy_budget(np.inf) == COMPILING_NODES


@pytest.mark.parametrize("nodes", [0, 1, 100])
def test_where_numpy_stops_changes_nothing(monkeypatch: pytest.MonkeyPatch, nodes: int) -> None:
    X, y = spline_problem()
    expected = best_columns(X, y, 6, n_best=2)
    monkeypatch.setattr(best, "_numpy_budget", lambda *_: nodes)
    assert best_columns(X, y, 6, n_best=2) == expected
