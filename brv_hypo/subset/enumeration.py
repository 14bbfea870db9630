"""All subsets below a residual: near-ties of the best, and the certified minimum of PRESS."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.subset.board import CLOSED, Board
from brv_hypo.subset.finish import Finisher
from brv_hypo.subset.frame import Frame
from brv_hypo.subset.result import NearTies, PressBest
from brv_hypo.subset.search import Effort, search


@dataclass(frozen=True)
class _Below:
    """Subsets of each size below a ceiling; ``complete[size]`` where all of them are there."""

    board: Board
    complete: tuple[bool, ...]
    finished: bool


def near_ties(frame: Frame, best: Board, window: float, limit: int, effort: Effort) -> tuple[NearTies, ...]:
    """All subsets whose RSS is within ``window`` (relative) of the best of their size, ``limit`` at most."""
    ceiling = np.full(best.max_size + 1, CLOSED)
    for size in range(1, best.max_size + 1):
        if best.rows(size):
            ceiling[size] = best.rows(size)[0][0] * (1.0 + window)
    below = _enumerate(frame, best, ceiling, limit, effort)
    return tuple(
        NearTies(
            size,
            tuple(_columns(frame, key) for _, key in below.board.rows(size)),
            tuple(rss for rss, _ in below.board.rows(size)),
            below.complete[size],
        )
        for size in range(1, best.max_size + 1)
        if below.board.rows(size)
    )


def best_press(
    frame: Frame, best: Board, finisher: Finisher, limit: int, effort: Effort
) -> tuple[PressBest, ...]:
    """The subset of least PRESS of every size, with proof.

    PRESS sums e^2 / (1 - h)^2, and no leverage is below that of the forced columns: PRESS >= RSS / (1 -
    h_0)^2 with h_0 the least of these. So only subsets with RSS <= (1 - h_0)^2 times the best PRESS known can
    beat it.
    """
    factor = (1.0 - finisher.least_forced_leverage) ** 2
    known = {
        size: float(
            np.nanmin([*(finisher.press(_columns(frame, key)) for _, key in best.rows(size)), np.inf])
        )
        for size in range(1, best.max_size + 1)
        if best.rows(size)
    }
    ceiling = np.full(best.max_size + 1, CLOSED)
    for size, value in known.items():
        ceiling[size] = min(value * factor, 1.01 * frame.rss_forced) if np.isfinite(value) else CLOSED
    below = _enumerate(frame, best, ceiling, limit, effort)
    answers = []
    for size in known:
        rows = below.board.rows(size) or best.rows(size)
        values = [finisher.press(_columns(frame, key)) for _, key in rows]
        least = int(np.nanargmin(values)) if np.isfinite(values).any() else 0
        # Subsets not looked at have no less than the last RSS listed, or nothing is known if time ran out.
        others = rows[-1][0] / factor if below.finished else 0.0
        exact = bool(np.isfinite(values[least]) and (below.complete[size] or others >= values[least]))
        gap = 0.0 if exact else 1.0 - others / values[least]
        answers.append(PressBest(size, _columns(frame, rows[least][1]), values[least], exact, gap, len(rows)))
    return tuple(answers)


def _enumerate(
    frame: Frame,
    best: Board,
    ceiling: FloatArray,
    limit: int,
    effort: Effort,
) -> _Below:
    board = Board(frame, best.max_size, limit, ceiling)
    for size in range(1, best.max_size + 1):
        board.offer_all(key for _, key in best.rows(size))
    certificate = search(board, effort)
    complete = tuple(certificate.exact and not board.full(size) for size in range(best.max_size + 1))
    return _Below(board, complete, certificate.exact)


def _columns(frame: Frame, key: tuple[int, ...]) -> tuple[int, ...]:
    return tuple(int(c) for c in frame.candidates[list(key)])
