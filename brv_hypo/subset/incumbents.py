"""The best subsets found so far, and searches that are quick and not always right.

A `Board` holds the incumbents, size by size, and the thresholds that they set for pruning. `seed_board` fills it by
forward selection, best swaps, and passing subsets on between neighbouring sizes: the exact search starts from there.
"""

from __future__ import annotations

from bisect import insort
from collections.abc import Iterable, Sequence
from functools import cmp_to_key

import numpy as np

from brv_hypo.arrays import FloatArray, IntArray
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
# Exchanges of one column for another that are tried in a row.
MOST_SWAPS = 30


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
        self._rows: list[list[Chosen]] = [[] for _ in range(self.max_size + 1)]
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

    def _compare(self, a: Chosen, b: Chosen) -> int:
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


# ---- Good subsets found quickly: forward, best swap, and passing on between neighbouring sizes ----


def seed_board(board: Board) -> None:
    """Fill the board with good subsets of every size, where no rules restrict them; exactness never depends on it."""
    frame = board.frame
    if frame.constraints.active:
        return
    work = _Workspace(frame)
    best: list[list[int]] = [[]]
    for _ in range(min(board.max_size, frame.rank)):
        ranked = work.additions(best[-1])
        board.offer_all([[*best[-1], int(j)] for j in ranked[: board.capacity]])
        best.append(work.swapped([*best[-1], int(ranked[0])], board))
    down = True
    while _passed_on(down, best, work, board):
        down = not down


def _passed_on(down: bool, best: list[list[int]], work: _Workspace, board: Board) -> bool:
    """Exchange from the next larger subset of every size, or the next smaller one; whether any is better for it."""
    better = False
    for size in range(len(best) - 2, 0, -1) if down else range(2, len(best)):
        smaller = best[size - 1]
        start = work.without_least(best[size + 1]) if down else [*smaller, int(work.additions(smaller)[0])]
        if set(start) != set(best[size]):
            found = work.swapped(start, board)
            if work.explained(found) > (1.0 + TIE) * work.explained(best[size]):
                best[size], better = found, True
    return better


class _Workspace:
    """Gains of adding and of exchanging columns, from the Gram matrix of the candidates."""

    def __init__(self, frame: Frame) -> None:
        self._G = frame.R.T @ frame.R
        self._b = frame.R.T @ frame.z
        self._known: dict[tuple[int, ...], tuple[FloatArray, FloatArray, FloatArray]] = {}

    def explained(self, chosen: list[int]) -> float:
        """By how much a subset lowers the residual."""
        return float(self._b[chosen] @ self._regression(chosen)[1])

    def additions(self, chosen: list[int]) -> IntArray:
        """Candidates, best addition first."""
        W, _, _ = self._regression(chosen)
        gains = _gain(*self._left(chosen, W))
        gains[chosen] = -np.inf
        return np.argsort(-gains, kind="stable")

    def swapped(self, chosen: list[int], board: Board) -> list[int]:
        """Take the best exchange of one column, again and again, until none helps."""
        for _ in range(MOST_SWAPS):
            W, beta, spread = self._regression(chosen)
            d, c = self._left(chosen, W)
            # With column i of the subset out, S_jj and c_j of every column j outside grow by rank one.
            net = _gain(d + W**2 / spread[:, None], c + W * (beta / spread)[:, None])
            net -= (beta**2 / spread)[:, None]
            net[:, chosen] = -np.inf
            i, j = np.unravel_index(int(net.argmax()), net.shape)
            if net[i, j] <= 1e-10 * board.frame.rss_full:
                break
            chosen = [*chosen[:i], *chosen[i + 1 :], int(j)]
        board.offer(chosen)
        return chosen

    def without_least(self, chosen: list[int]) -> list[int]:
        """Leave out the column whose loss costs least."""
        _, beta, spread = self._regression(chosen)
        least = int((beta**2 / spread).argmin())
        return chosen[:least] + chosen[least + 1 :]

    def _regression(self, chosen: list[int]) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Coefficients of all columns and of y on the chosen ones, and the diagonal of the inverse."""
        known = self._known.get(tuple(chosen))
        if known is None:
            inverse = _inverse(self._G[np.ix_(chosen, chosen)])
            known = (
                inverse @ self._G[chosen],
                inverse @ self._b[chosen],
                np.asarray(inverse.diagonal(), dtype=np.float64),
            )
            self._known[tuple(chosen)] = known
        return known

    def _left(self, chosen: list[int], W: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Squared length of what is left of every column, and its product with what is left of y."""
        return self._G.diagonal() - np.sum(self._G[chosen] * W, axis=0), self._b - self._b[chosen] @ W


def _inverse(M: FloatArray) -> FloatArray:
    try:
        return np.asarray(np.linalg.inv(M), dtype=np.float64)
    except np.linalg.LinAlgError:
        return np.asarray(np.linalg.pinv(M, hermitian=True), dtype=np.float64)


def _gain(d: FloatArray, c: FloatArray) -> FloatArray:
    solid = d > 1e-11
    return np.asarray(np.where(solid, c**2 / np.where(solid, d, 1.0), -1.0))
