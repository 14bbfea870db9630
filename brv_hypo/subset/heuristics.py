"""Searches that are quick and not always right: incumbents for the exact search, and stepwise regression.

`seed_board` fills the incumbents by forward selection, best swaps, and passing subsets on between neighbouring sizes.
`stepwise_columns` is Efroymson's method, for comparison with the exact search.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import ArrayLike

from brv_hypo.arrays import FloatArray, IntArray
from brv_hypo.subset.frame import Frame, Groups, build_frame
from brv_hypo.subset.incumbents import TIE, Board, Chosen, residual
from brv_hypo.subset.tree import propagate

# ---- Good subsets found quickly: forward, best swap, and passing on between neighbouring sizes ----


MOST_SWAPS = 30


def seed_board(board: Board) -> None:
    """Fill the board with good subsets of every size; exactness never depends on them."""
    frame = board.frame
    if frame.constraints.active:
        _constrained_forward(board)
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


def _constrained_forward(board: Board) -> None:
    """Forward selection by whole closures: each step takes the first allowed, best gain first."""
    frame = board.frame
    work = _Workspace(frame)
    included: tuple[int, ...] = ()
    undecided = tuple(range(frame.n_candidates))
    while undecided:
        for candidate in work.additions(list(included)).tolist():
            if candidate not in undecided:
                continue
            allowed = propagate(
                frame.constraints, (*included, candidate), [u for u in undecided if u != candidate]
            )
            if allowed is not None and len(allowed[0]) <= board.max_size:
                included, undecided = allowed
                board.offer(included)
                break
        else:
            return


# ---- Efroymson's stepwise regression: quick, and not always right. For comparison with the exact search ----


def stepwise_columns(
    X: ArrayLike,
    y: ArrayLike,
    max_terms: int = 10,
    forced: Sequence[int] = (0,),
    n_best: int = 1,
    groups: Groups | None = None,
    *,
    samples: int,
    f_enter: float = 4.0,
    f_remove: float = 3.9,
) -> tuple[Chosen, ...]:
    """Stepwise subset regression with the interface of ``best_columns`` (report 3.3.3).

    At every step the columns of largest partial F enter where it exceeds ``f_enter``, then columns whose partial F is
    below ``f_remove``, which is no more than that, leave. Groups move together. The best subset met of every size is
    returned, one a size whatever ``n_best``; nothing is proved. X and y may be a triangular factor of so many
    ``samples``, which give F its freedom.

    Source: Efroymson, in Ralston and Wilf, Mathematical Methods for Digital Computers, Wiley 1960.
    """
    frame = build_frame(X, y, forced, None, groups, None)
    board = Board(frame, max_terms, 1)
    board.offer_all(_path(frame, board.max_size, f_enter, f_remove, samples))
    return board.chosen()


def _path(
    frame: Frame, max_size: int, f_enter: float, f_remove: float, samples: int
) -> Iterator[tuple[int, ...]]:
    """The subsets that stepwise passes through."""
    chosen: tuple[int, ...] = ()
    rss = frame.rss_forced
    visited = {chosen}
    while True:
        entered = _best_entry(frame, chosen, rss, max_size, samples)
        if entered is None or entered[0] < f_enter or entered[1] in visited:
            return
        chosen, rss = entered[1], entered[2]
        visited.add(chosen)
        yield chosen
        while (left := _least_exit(frame, chosen, rss, samples)) is not None and left[0] < f_remove:
            if left[1] in visited:
                break
            chosen, rss = left[1], left[2]
            visited.add(chosen)
            yield chosen


def _best_entry(
    frame: Frame, chosen: tuple[int, ...], rss: float, max_size: int, samples: int
) -> tuple[float, tuple[int, ...], float] | None:
    moves = []
    outside = [j for j in range(frame.n_candidates) if j not in chosen]
    for j in outside:
        allowed = propagate(frame.constraints, (*chosen, j), [i for i in outside if i != j])
        if allowed is None or len(allowed[0]) > max_size:
            continue
        larger = tuple(sorted(allowed[0]))
        new = residual(frame, larger)
        if new is not None:
            moves.append((_partial_f(samples - len(frame.forced), chosen, rss, larger, new), larger, new))
    return max(moves, default=None)


def _least_exit(
    frame: Frame, chosen: tuple[int, ...], rss: float, samples: int
) -> tuple[float, tuple[int, ...], float] | None:
    moves = []
    for j in chosen:
        bound = frame.constraints.requires[:, j]
        smaller = tuple(i for i in chosen if i != j and not bound[i])
        new = residual(frame, smaller)
        if new is not None:
            moves.append((_partial_f(samples - len(frame.forced), smaller, new, chosen, rss), smaller, new))
    return min(moves, default=None)


def _partial_f(
    rows: int, small: tuple[int, ...], rss_small: float, large: tuple[int, ...], rss_large: float
) -> float:
    free = rows - len(large)
    if free <= 0 or rss_large <= 0.0:
        return float("inf") if rss_small > rss_large else 0.0
    return ((rss_small - rss_large) / (len(large) - len(small))) / (rss_large / free)
