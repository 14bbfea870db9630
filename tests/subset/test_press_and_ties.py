"""Enumerations with proof: near-ties and the least PRESS, against complete enumeration."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from brv_hypo.subset import best_subsets
from tests.subset.brute_force import enumerate_subsets


def _problem(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Few rows, one of high leverage: the least RSS and the least PRESS are often different subsets."""
    rng = np.random.default_rng(seed)
    X = np.column_stack([np.ones(18), rng.standard_normal((18, 8))])
    X[0, 1:] *= 5.0
    return X, X[:, 1] + 0.5 * X[:, 2] + rng.standard_normal(18)


def _press(X: np.ndarray, y: np.ndarray, columns: tuple[int, ...]) -> float:
    total = 0.0
    for i in range(y.size):
        rest = np.arange(y.size) != i
        Z = X[:, [0, *columns]]
        beta = np.linalg.lstsq(Z[rest], y[rest], rcond=None)[0]
        total += float((y[i] - Z[i] @ beta) ** 2)
    return total


@pytest.mark.parametrize("seed", range(4))
def test_least_press_is_certified(seed: int) -> None:
    X, y = _problem(seed)
    for answer in best_subsets(X, y, 4, certify_press=True).press:
        table = {c: _press(X, y, c) for c in combinations(range(1, 9), answer.size)}
        assert answer.exact
        assert answer.press == pytest.approx(min(table.values()), rel=1e-9)
        assert table[answer.columns] == pytest.approx(answer.press, rel=1e-9)


def test_least_press_differs_from_least_rss_somewhere() -> None:
    differing = 0
    for seed in range(4):
        X, y = _problem(seed)
        result = best_subsets(X, y, 4, certify_press=True)
        differing += sum(answer.columns != result.best(answer.size).columns for answer in result.press)
    assert differing > 0


def test_press_cut_short_says_how_far_it_may_be_off() -> None:
    X, y = _problem(0)
    answers = best_subsets(X, y, 4, certify_press=True, enumeration_limit=2).press
    assert any(not a.exact and 0.0 < a.gap < 1.0 for a in answers)
    for answer in answers:
        least = min(_press(X, y, c) for c in combinations(range(1, 9), answer.size))
        assert answer.press * (1.0 - answer.gap) <= least * (1.0 + 1e-9)


@pytest.mark.parametrize("kernel", ["numpy-schur", "numba-schur"])
@pytest.mark.parametrize("window", [1e-3, 0.05, 0.3])
def test_near_ties_are_all_there(window: float, kernel: str) -> None:
    X, y = _problem(1)
    table = enumerate_subsets(X, y, (0,), range(1, 9), 5)
    result = best_subsets(X, y, 5, near_optimal_window=window, kernel=kernel)
    for ties in result.near_optimal:
        rows = table[ties.size]
        expected = {columns for rss, columns in rows if rss <= rows[0][0] * (1.0 + window)}
        assert ties.complete
        assert set(ties.columns) == expected
        assert list(ties.rss) == sorted(ties.rss)


def test_near_ties_beyond_the_limit_are_declared_incomplete() -> None:
    X, y = _problem(1)
    ties = best_subsets(X, y, 3, near_optimal_window=5.0, enumeration_limit=3).near_optimal
    assert [(t.complete, len(t.columns)) for t in ties] == [(False, 3)] * 3
