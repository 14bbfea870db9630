"""Columns that depend on others: named, searched around, refused where only rounding distinguishes them."""

from __future__ import annotations

import tracemalloc
from itertools import combinations

import numpy as np
import pytest

from brv_hypo.subset import best_columns, best_subsets, frame
from brv_hypo.subset.search import NumpyTree, OpenSubtree
from tests.subset.brute_force import enumerate_subsets
from tests.subset.kernels import best_subsets_by

pytestmark = pytest.mark.thorough

RNG = np.random.default_rng(11)
ROWS = 80


def columns() -> np.ndarray:
    X = RNG.standard_normal((ROWS, 8))
    X[:, 0] = 1.0
    return X


def test_the_sum_of_two_columns_is_named_and_the_search_stays_exact() -> None:
    X = columns()
    X[:, 5] = 2.0 * X[:, 2] - 3.0 * X[:, 4] + 0.5
    X[:, 7] = X[:, 1] + 1e3 * X[:, 3] - X[:, 6]
    y = X[:, 2] + X[:, 5] + RNG.standard_normal(ROWS)
    result = best_subsets(X, y, 5)
    named = {alias.column: dict(alias.combination) for alias in result.aliases}
    assert named[5] == pytest.approx({0: 0.5, 2: 2.0, 4: -3.0})
    assert named[7] == pytest.approx({1: 1.0, 3: 1e3, 6: -1.0})
    assert result.refused == ()
    expected = enumerate_subsets(X, y, (0,), range(1, 8), 5)
    for subset in result.subsets:
        assert subset.rss == pytest.approx(expected[subset.size][0][0], rel=1e-9)


@pytest.mark.parametrize("kernel", ["numpy", "numba-schur"])
@pytest.mark.parametrize("distance", [1e-13, 1e-12])
def test_a_winner_next_to_dependence_is_refused_with_the_reason(distance: float, kernel: str) -> None:
    X = columns()
    hidden = RNG.standard_normal(ROWS)
    X[:, 6] = X[:, 2] + X[:, 3] + distance * hidden
    y = hidden + 0.01 * RNG.standard_normal(ROWS)
    result = best_subsets_by(kernel, X, y, 4)
    assert result.certificate.exact
    (refusal,) = result.refused
    assert set(refusal.columns) == {2, 3, 6}
    assert distance / 10 < refusal.remainder < distance * 10
    assert "refused together" in refusal.reason
    assert all(np.abs(subset.coefficients).max() < 1e3 for subset in result.subsets)
    allowed = [
        subset for size in range(1, 5) for subset in combinations(range(1, 8), size) if not {2, 3, 6} <= set(subset)
    ]
    expected = enumerate_subsets(X, y, (0,), range(1, 8), 4, lambda s: tuple(sorted(s)) in allowed)
    for subset in result.subsets:
        assert subset.rss == pytest.approx(expected[subset.size][0][0], rel=1e-9)


def test_more_columns_than_rows_names_nothing() -> None:
    X = np.random.default_rng(0).standard_normal((6, 12))
    result = best_subsets(X, X[:, 3] + 1.0, 2, forced=())
    assert result.aliases == ()
    assert result.refused == ()


def test_a_tree_of_many_pieces_has_one_of_them_in_memory_at_a_time() -> None:
    """Eight sums make 379 pieces of 5 to 17 kB; kept, they were gigabytes where hundreds of columns depend."""
    one, other = RNG.standard_normal((2, ROWS, 8))
    X = np.column_stack([one, other, one + other, RNG.standard_normal((ROWS, 20))])
    y = X[:, :6].sum(axis=1) + RNG.standard_normal(ROWS)
    tracemalloc.start()
    result = best_subsets_by("numpy", X, y, 6)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert result.certificate.exact
    assert peak < 1e6


def sums(others: int) -> tuple[np.ndarray, np.ndarray]:
    """Six columns, their sums two by two with three more, and `others`; a response that no few of them explain."""
    rng = np.random.default_rng(others)
    one, other = rng.standard_normal((2, ROWS, 3))
    X = np.column_stack([one, other, one + other, rng.standard_normal((ROWS, others))])
    return X, X.sum(axis=1) + rng.standard_normal(ROWS)


@pytest.mark.parametrize("kernel", ["auto", "numpy", "numba-schur"])
@pytest.mark.parametrize("most", range(1, 6))
def test_leaves_of_any_size_have_the_best_of_all_subsets(most: int, kernel: str) -> None:
    X, y = sums(3)
    result = best_subsets_by(kernel, X, y, most, forced=(), n_best=3)
    expected = enumerate_subsets(X, y, (), range(X.shape[1]), most)
    for size in range(1, most + 1):
        found = [subset for subset in result.subsets if subset.size == size]
        assert [s.columns for s in found] == [columns for _, columns in expected[size][:3]]


@pytest.mark.parametrize("kernel", ["numpy", "numba-schur"])
def test_a_leaf_is_made_once(monkeypatch: pytest.MonkeyPatch, kernel: str) -> None:
    made: list[tuple[tuple[int, ...], tuple[int, ...]]] = []

    def counted(tree: NumpyTree, part: OpenSubtree) -> None:
        made.append((part.included, part.undecided))
        score(tree, part)

    score = NumpyTree.score
    monkeypatch.setattr(NumpyTree, "score", counted)
    best_subsets_by(kernel, *sums(6), 5, forced=())
    assert len(made) == len(set(made)) > 3


def test_a_search_for_columns_alone_names_no_dependency(monkeypatch: pytest.MonkeyPatch) -> None:
    X, y = sums(3)
    named = best_subsets(X, y, 3, forced=())

    def refuse(*_: object) -> None:
        raise AssertionError("names that are never read")

    monkeypatch.setattr(frame, "_named", refuse)
    assert len(named.aliases) == 3
    assert [columns for _, columns in best_columns(X, y, 3, forced=())] == [s.columns for s in named.subsets]
