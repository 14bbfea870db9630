"""Columns of several flights by blocks do what the whole matrix does."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from brv_hypo.inference.bordered import Bordered, joined


def drawn(seed: int, flights: int, shared: int) -> Bordered:
    """Two channels after one another, the flights one after another in each, and rows of none at the end."""
    rng = np.random.default_rng(seed)
    sizes = rng.integers(0, 6, flights)
    ends = np.cumsum(sizes)
    count = int(ends[-1])
    ranges = tuple(
        joined([slice(int(e - s) + channel * count, int(e) + channel * count) for channel in range(2)])
        for s, e in zip(sizes, ends, strict=True)
    )
    own = tuple(rng.standard_normal((2 * int(size), min(2 * int(size), 3))) for size in sizes)
    return Bordered(2 * count + 2, ranges, own, rng.standard_normal((2 * count + 2, shared)))


BORDERED = st.builds(drawn, st.integers(0, 10_000), st.integers(1, 4), st.integers(0, 2))


@given(BORDERED)
def test_products_are_those_of_the_whole_matrix(columns: Bordered) -> None:
    whole, rng = columns.times(np.eye(columns.size)), np.random.default_rng(1)
    rows, values = rng.standard_normal((columns.count, 2)), rng.standard_normal((columns.size, 2))
    assert whole.shape == (columns.count, columns.size)
    np.testing.assert_allclose(columns.coordinates(rows), whole.T @ rows, atol=1e-12)
    np.testing.assert_allclose(columns.times(values), whole @ values, atol=1e-12)
    first = rows[: columns.count // 2]
    np.testing.assert_allclose(columns.coordinates(first), whole[: first.shape[0]].T @ first, atol=1e-12)


@given(BORDERED)
def test_what_is_projected_out_and_solved_for_is_least_squares(columns: Bordered) -> None:
    whole, factors = columns.times(np.eye(columns.size)), columns.factors
    y = np.random.default_rng(2).standard_normal((columns.count, 1))
    expected = y - whole @ np.linalg.lstsq(whole, y, rcond=None)[0]
    np.testing.assert_allclose(factors.basis.less(y), expected, atol=1e-8)
    found = factors.coefficients(factors.basis.coordinates(y))
    np.testing.assert_allclose(y - whole @ found, expected, atol=1e-7)


def test_ranges_that_follow_each_other_are_one() -> None:
    assert joined([slice(0, 2), slice(2, 5), slice(7, 8)]) == (slice(0, 5), slice(7, 8))


@pytest.mark.parametrize("flights", [1, 3])
def test_every_row_is_of_one_stretch(flights: int) -> None:
    columns = drawn(5, flights, 1)
    rows = np.concatenate([np.arange(each.rows.start, each.rows.stop) for each in columns.stretches])
    assert sorted(rows) == list(range(columns.count))
