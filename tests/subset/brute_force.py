"""Complete enumeration of small problems, sharing nothing with the search: the tests' reference."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Row = tuple[float, tuple[int, ...]]


def enumerate_subsets(
    X: Array,
    y: Array,
    forced: Sequence[int],
    candidates: Sequence[int],
    max_terms: int,
    allowed: Callable[[frozenset[int]], bool] = lambda _: True,
) -> dict[int, list[Row]]:
    """(RSS, columns) of all allowed subsets of full rank, by size, best first."""
    lengths = np.linalg.norm(X, axis=0)
    unit = X / np.where(lengths > 0, lengths, 1.0)
    table = {}
    for size in range(1, max_terms + 1):
        subsets = [c for c in combinations(candidates, size) if allowed(frozenset(c))]
        table[size] = sorted(_residuals(unit, y, forced, subsets))
    return table


def representatives(X: Array, forced: Sequence[int], named: set[int]) -> list[int]:
    """Columns to search: not inside the forced span, and one of every class of parallel ones.

    Columns that a rule names are not merged.
    """
    base = X[:, list(forced)]
    kept: list[int] = []
    lefts: list[Array] = []
    for j in range(X.shape[1]):
        if j in forced:
            continue
        rest = X[:, j] - base @ np.linalg.lstsq(base, X[:, j], rcond=None)[0]
        if np.linalg.norm(rest) <= 1e-10 * np.linalg.norm(X[:, j]):
            continue
        unit = rest / np.linalg.norm(rest)
        twin = any(
            abs(abs(unit @ other) - 1.0) < 1e-12 and not ({i, j} & named) for i, other in zip(kept, lefts, strict=True)
        )
        if not twin:
            kept.append(j)
            lefts.append(unit)
    return kept


def _residuals(unit: Array, y: Array, forced: Sequence[int], subsets: list[tuple[int, ...]]) -> list[Row]:
    """RSS by stacked QR of the columns with y appended; dependent subsets are left out."""
    if not subsets:
        return []
    n, width = y.size, len(forced) + len(subsets[0])
    if width > n:
        return []
    columns = np.array([[*forced, *s] for s in subsets])
    stack = np.empty((len(subsets), n, width + 1))
    stack[:, :, :width] = np.moveaxis(unit[:, columns], 0, 1)
    stack[:, :, width] = y
    R = np.linalg.qr(stack, mode="r")
    full_rank = np.abs(np.diagonal(R[:, :width, :width], axis1=1, axis2=2)).min(axis=1) > 1e-11
    rss = R[:, width, width] ** 2 if n > width else np.zeros(len(subsets))
    return [(float(r), s) for r, s, ok in zip(rss, subsets, full_rank, strict=True) if ok]
