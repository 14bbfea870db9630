"""A compiled search of one piece: builds its working arrays, runs it on, reads out what is left."""

from __future__ import annotations

from math import prod
from typing import Any

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.subset.board import Board
from brv_hypo.subset.constraints import Constraints
from brv_hypo.subset.kernel import search
from brv_hypo.subset.kernel_parts import (
    BRANCHED,
    DROPPED,
    FORCED,
    HITS,
    INCLUDED,
    LEVEL,
    NODES,
    UNDECIDED,
    Work,
    whole_vectors,
)
from brv_hypo.subset.pieces import OpenSubtree, Piece

HIT_ROOM = 512
# Bytes of a cache line.
LINE = 64
# Nodes with no more columns to go are scored, not ruled out by sets of columns first; and fours from no more beginnings
# of three columns, above which it is quicker to branch (``python -m brv_hypo.subset.study``).
SCORED, MOST_BEGINNINGS = 4, 3000


class CompiledSearch:
    """Depth-first search of one piece that stops and goes on."""

    def __init__(self, board: Board, piece: Piece, *, triangular: bool) -> None:
        self._orthogonal = True if triangular else None
        self._work = _working_arrays(board, piece, triangular)

    @property
    def done(self) -> bool:
        """Whether the piece is decided."""
        return bool(self._work.state[LEVEL] < 0)

    @property
    def nodes(self) -> int:
        """Nodes visited."""
        return int(self._work.state[NODES])

    def run(self, limits: FloatArray, budget: int) -> list[tuple[int, ...]]:
        """Search on under these limits, at most ``budget`` nodes; the subsets that got under them."""
        loosest = np.maximum.accumulate(limits[::-1])[::-1].copy()
        search(self._work, limits, loosest, budget, self._orthogonal)
        state, hits = self._work.state, self._work.hits
        found = [tuple(row[1 : row[0] + 1]) for row in hits[: state[HITS]].tolist()]
        state[HITS] = 0
        return found

    def open_subtrees(self) -> list[OpenSubtree]:
        """What is still undecided, outermost first."""
        w = self._work
        rest = []
        for level in range(int(w.state[LEVEL]) + 1):
            if w.phase[level] == FORCED:
                continue
            undecided = w.ids[level, : w.count[level]].tolist()
            if w.phase[level] == BRANCHED:
                del undecided[int(w.at[level])]
            included = tuple(w.chosen[: w.base + level].tolist())
            rest.append(OpenSubtree(included, tuple(undecided), float(w.bound[level])))
        return rest


def _working_arrays(board: Board, piece: Piece, triangular: bool) -> Work:
    base, m, n = len(piece.included), len(piece.undecided), board.frame.n_candidates
    levels = board.max_size - base + 2
    width = whole_vectors(m)
    A = _aligned(levels, m, width)
    B = _aligned(2 if triangular else levels, m, width)
    x, beta = _aligned(levels, width), _aligned(levels, width)
    if triangular:
        A[0, :, :m], x[0, :m] = piece.R, piece.z
    else:
        # H from the inverse of R, never from the inverse of S, which would square the condition number.
        inverse = piece.inverse
        A[0, :, :m], x[0, :m] = piece.R.T @ piece.R, piece.R.T @ piece.z
        B[0, :, :m], beta[0, :m] = inverse @ inverse.T, inverse @ piece.z
    ids = np.empty((levels, m), dtype=np.int64)
    ids[0] = piece.undecided
    count, rss, bound = np.zeros(levels, dtype=np.int64), np.empty(levels), np.empty(levels)
    count[0], rss[0], bound[0] = m, piece.rss, piece.bound
    owns = np.zeros(levels, dtype=np.bool_)
    owns[0] = True
    chosen = np.full(board.max_size + 1, -1, dtype=np.int64)
    chosen[:base] = piece.included
    status = np.full(n, DROPPED, dtype=np.int8)
    status[list(piece.included)] = INCLUDED
    status[list(piece.undecided)] = UNDECIDED
    requires, excludes = _rules(board.frame.constraints)
    return Work(
        A=A, B=B, x=x, beta=beta, ids=ids, count=count, phase=np.zeros(levels, dtype=np.int64),
        at=np.zeros(levels, dtype=np.int64), owns=owns, rss=rss, bound=bound, chosen=chosen, status=status,
        trail=np.zeros((n + 1, 2), dtype=np.int64), requires=requires, excludes=excludes,
        hits=np.empty((HIT_ROOM + m * m, board.max_size + 4), dtype=np.int64), scratch=_aligned(5, width),
        most=np.full(levels, board.max_size, dtype=np.int64), packing=_aligned(5, width), factor=_aligned(m, width),
        sets=np.empty((4, m), dtype=np.int64), place=np.arange(float(width)),
        state=np.zeros(4, dtype=np.int64), base=base, slack=board.margin,
        scored=SCORED, beginnings=MOST_BEGINNINGS,
    )  # fmt: skip


def _aligned(*shape: int) -> FloatArray:
    """Zeros that begin where a cache line does: a vector across two lines takes as long as two."""
    room = np.zeros(prod(shape) + LINE // 8)
    start = -room.ctypes.data % LINE // 8
    return room[start : start + prod(shape)].reshape(shape)


def _rules(constraints: Constraints) -> tuple[Any, Any]:
    if not constraints.active:
        none = np.empty((0, 0), dtype=np.int8)
        return none, none
    requires = constraints.requires.astype(np.int8)
    np.fill_diagonal(requires, constraints.requires.sum(axis=1))
    return requires, constraints.excludes.astype(np.int8)
