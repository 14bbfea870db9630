"""The best subsets found so far, size by size, and the thresholds that they set for pruning."""

from __future__ import annotations

from bisect import insort
from collections.abc import Iterable, Sequence
from functools import cmp_to_key

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.subset.frame import EPS, Frame, dependency, triangle

# Residual sum of squares, and the columns of X without the forced ones, ascending.
Chosen = tuple[float, tuple[int, ...]]
# Residual sums of squares closer than this, relatively, are a tie and are ordered by column number.
TIE = 1e-11
# Relative allowance for rounding in a bound where the columns are well-conditioned.
LEAST_MARGIN = 1e-10
# A limit that nothing can get under.
CLOSED = -1.0
# Subsets that are factorised at once.
_AT_ONCE = 1000


class Board:
    """The ``capacity`` best subsets of each size 1..max_size, each residual re-evaluated by QR."""

    def __init__(self, frame: Frame, max_terms: int, capacity: int) -> None:
        self.frame = frame
        self.max_size = min(max_terms, frame.rank)
        self.capacity = capacity
        self.margin = LEAST_MARGIN
        # No subset does worse than the forced columns alone: a finite bar keeps the kernels free of infinities.
        self._ceiling = 1.01 * frame.rss_forced
        self.perfect = (100.0 * EPS) ** 2 * frame.rss_forced
        self._rows: list[list[tuple[float, tuple[int, ...]]]] = [[] for _ in range(self.max_size + 1)]
        self._offered: set[tuple[int, ...]] = set()
        self.limits = np.full(self.max_size + 1, self._ceiling * (1.0 + self.margin))
        self.limits[0] = CLOSED

    def chosen(self) -> tuple[Chosen, ...]:
        """All subsets on it, by size, then by residual sum of squares."""
        candidates = self.frame.candidates
        return tuple(
            (rss, tuple(sorted(int(c) for c in candidates[list(positions)])))
            for rows in self._rows
            for rss, positions in rows
        )

    def offer_all(self, subsets: Iterable[Sequence[int]]) -> None:
        """Offer every subset, the best first: one that leaves more than the worst of its size is not looked at."""
        keys = {tuple(sorted(subset)) for subset in subsets} - self._offered
        for size in sorted({len(key) for key in keys} - {0}):
            some = sorted(key for key in keys if len(key) == size <= self.max_size)
            left = _residuals(self.frame, some)
            for place in np.argsort(left, kind="stable").tolist():
                if left[place] > max(self.worst(size) * (1.0 + self.margin), self.perfect):
                    break
                self.offer(some[place])

    def offer(self, subset: Sequence[int]) -> None:
        """Take in a subset of candidate positions where it is allowed, of full rank and good enough."""
        key = tuple(sorted(subset))
        size = len(key)
        if not 0 < size <= self.max_size or key in self._offered:
            return
        self._offered.add(key)
        if self.frame.constraints.active and not self.frame.constraints.allows(key):
            return
        rss = residual(self.frame, key)
        if rss is None or rss > self._ceiling:
            return
        rows = self._rows[size]
        insort(rows, (rss, key), key=cmp_to_key(self._compare))
        del rows[self.capacity :]
        self._lower_limit(size)

    def worst(self, size: int) -> float:
        """The residual that a newcomer must beat."""
        return min(self._rows[size][-1][0], self._ceiling) if self.full(size) else self._ceiling

    def full(self, size: int) -> bool:
        """Whether all places of a size are taken."""
        return len(self._rows[size]) == self.capacity

    def widen(self, margin: float) -> None:
        """Allow for more rounding from here on."""
        if margin > self.margin:
            self.margin = margin
            for size in range(1, self.max_size + 1):
                self._lower_limit(size)

    def _lower_limit(self, size: int) -> None:
        worst = self.worst(size)
        # A perfect fit cannot be beaten; searching for its equals would visit every superset.
        self.limits[size] = worst * (1.0 + self.margin) if worst > self.perfect else CLOSED

    def _compare(self, a: tuple[float, tuple[int, ...]], b: tuple[float, tuple[int, ...]]) -> int:
        low = max(min(a[0], b[0]), self.perfect)
        tie = TIE + 16.0 * EPS * float(np.sqrt(self.frame.rss_forced / low)) if low > 0.0 else TIE
        if abs(a[0] - b[0]) > tie * low:
            return -1 if a[0] < b[0] else 1
        return -1 if a[1] < b[1] else 1


def _residuals(frame: Frame, subsets: Sequence[tuple[int, ...]]) -> FloatArray:
    """Residual sums of squares of subsets of one size (subsets,); of dependent columns it may be too low."""
    found = [np.zeros(0)]
    for first in range(0, len(subsets), _AT_ONCE):
        some = np.array(subsets[first : first + _AT_ONCE])
        size = some.shape[1]
        factors = np.asarray(np.linalg.qr(frame.each_columns(some), mode="r"))
        tails = factors[:, size:, size]
        found.append(frame.rss_full + np.sum(tails**2, axis=1))
    return np.concatenate(found)


def residual(frame: Frame, subset: Sequence[int]) -> float | None:
    """Residual sum of squares by QR of the columns themselves; None where they are dependent."""
    k = len(subset)
    factor = triangle(frame.columns(subset))
    if dependency(factor[:k, :k], frame.noise[list(subset)]):
        return None
    tail = factor[k:, k]
    return frame.rss_full + float(tail @ tail)
