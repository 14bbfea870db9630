"""Good subsets found quickly: forward, best swap, and passing on between neighbouring sizes."""

from __future__ import annotations

import numpy as np

from brv_hypo.arrays import FloatArray, IntArray
from brv_hypo.subset.board import TIE, Board
from brv_hypo.subset.frame import Frame
from brv_hypo.subset.pieces import propagate

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
        start = work.without_least(best[size + 1]) if down else work.with_best(best[size - 1])
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

    def with_best(self, chosen: list[int]) -> list[int]:
        """Add the column that gains most."""
        return [*chosen, int(self.additions(chosen)[0])]

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
