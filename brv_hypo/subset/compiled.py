"""The compiled tree search on Schur complements, for well-conditioned columns, and its calls.

The column to branch on is moved to the last place; including it is a rank-one step on S into the next level, dropping
it one on H in place. Both are stored in full, as `kernel` reads rows; a level copies H from its parent when it first
branches. `search_compiled` is the entrance: it builds the working arrays of each subproblem, runs the kernel on and
reads out what is left. Imported when the compiled kernel is wanted: numba takes longer than most searches.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from math import prod
from typing import Any

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.subset.kernel import (
    HITS,
    LEVEL,
    NODES,
    NONE,
    Work,
    compiled,
    compiled_part,
    packed_quota,
    padded,
    quota_of,
    record,
    score,
    score_triples,
    whole_vectors,
)
from brv_hypo.subset.search import Board, Node, NumpyTree, OpenSubtree, make_node

# ---- Steps on Schur complements ----


@compiled_part
def rises(w: Work, level: int, m: int, out: Any) -> None:
    """Rise of the bound on dropping each undecided column: beta^2 / H_jj."""
    H = w.B[level] if w.owns[level] else w.B[level - 1]
    beta = w.beta[level]
    for i in range(m):
        out[i] = beta[i] * beta[i] / H[i, i]
    out[m : padded(m)] = 0.0


@compiled_part
def place(w: Work, level: int, j: int, m: int) -> None:
    """Move the column to branch on to the last place."""
    S, H, c, beta, ids = w.A[level], w.B[level], w.x[level], w.beta[level], w.ids[level]
    if not w.owns[level]:
        source = w.B[level - 1]
        for i in range(m):
            for k in range(padded(m)):
                H[i, k] = source[i, k]
        w.owns[level] = True
    last = m - 1
    if j != last:
        _swap(S, j, last)
        _swap(H, j, last)
        c[j], c[last] = c[last], c[j]
        beta[j], beta[last] = beta[last], beta[j]
        ids[j], ids[last] = ids[last], ids[j]


@compiled_part
def drop(w: Work, level: int, last: int) -> None:
    """Drop the last column: a rank-one step on H, S as it stands."""
    H, beta = w.B[level], w.beta[level]
    w.bound[level] += beta[last] * beta[last] / H[last, last]
    _downdate(H, beta, H, beta, last)


@compiled_part
def include(w: Work, level: int, last: int) -> None:
    """Include the last column: a rank-one step on S into the next level, H as it stands."""
    S, c = w.A[level], w.x[level]
    _downdate(S, c, w.A[level + 1], w.x[level + 1], last)
    w.rss[level + 1] = w.rss[level] - c[last] * c[last] / S[last, last]
    for i in range(last):
        w.beta[level + 1, i] = w.beta[level, i]
        w.ids[level + 1, i] = w.ids[level, i]


@compiled_part
def _swap(M: Any, j: int, last: int) -> None:
    """Exchange rows and columns j and last of a symmetric matrix."""
    for k in range(last + 1):
        M[j, k], M[last, k] = M[last, k], M[j, k]
    for k in range(last + 1):
        M[k, j], M[k, last] = M[k, last], M[k, j]


@compiled_part
def _downdate(M: Any, v: Any, out: Any, out_v: Any, last: int) -> None:
    """Schur complement on the last row: out = M - q q' / q_last, out_v = v - q v_last / q_last."""
    scale = 1.0 / M[last, last]
    shift = v[last] * scale
    width = padded(last + 1)
    for i in range(last):
        factor = M[last, i] * scale
        for k in range(width):
            out[i, k] = M[i, k] - factor * M[last, k]
    for i in range(last):
        out_v[i] = v[i] - M[last, i] * shift


# Nodes visited after a hit before the kernel hands it over.
PATIENCE = 32


@compiled
def search(w: Work, limits: Any, loosest: Any, budget: int) -> None:
    """Go on until the tree or the budget is done, hits have waited long enough, or their room is short.

    ``limits[k]``: a subset of size k is of interest below it; ``loosest[k]``: the largest limit from size k
    on. The level in ``w.state`` is -1 when the tree is done.
    """
    rise = w.scratch[0]
    stop = w.state[NODES] + budget
    while w.state[LEVEL] >= 0 and w.state[NODES] < stop:
        level = w.state[LEVEL]
        size = w.base + level
        m = w.count[level]
        if w.state[HITS] > 0:
            stop = min(stop, w.state[NODES] + PATIENCE)
            if w.state[HITS] + m * m > w.hits.shape[0]:
                return
        if w.branched[level]:
            drop(w, level, m - 1)
            m = w.count[level] = m - 1
            w.branched[level] = False
            if w.bound[level] > loosest[size + 1]:
                w.state[LEVEL] = level - 1
                continue
        w.state[NODES] += 1
        rises(w, level, m, rise)
        quota = quota_of(rise, m, w.bound[level], limits, size, w.most[level])
        quota = packed_quota(w, level, m, rise, quota, limits)
        w.most[level] = size + quota
        if quota == 3:
            hits = w.state[HITS]
            pairs = quota_of(rise, m, w.bound[level], limits, size, size + 2) == 2
            score(w, level, m, pairs, limits)
            if score_triples(w, level, m, limits):
                w.state[LEVEL] = level - 1
                continue
            w.state[HITS] = hits
        if quota <= 2:
            if quota > 0:
                score(w, level, m, quota == 2, limits)
            w.state[LEVEL] = level - 1
            continue
        j = 0
        for i in range(1, m):
            if rise[i] > rise[j]:
                j = i
        w.branched[level] = True
        place(w, level, j, m)
        include(w, level, m - 1)
        w.bound[level + 1] = w.bound[level]
        w.count[level + 1] = m - 1
        w.branched[level + 1] = False
        w.owns[level + 1] = False
        w.most[level + 1] = w.most[level]
        w.chosen[size] = w.ids[level, m - 1]
        if w.rss[level + 1] <= limits[size + 1]:
            record(w, size + 1, NONE, NONE)
        w.state[LEVEL] = level + 1


# ---- The search of one piece, called ----


HIT_ROOM = 512
# Nodes between looks at the clock and the board, and of a thread's turn: some tens of milliseconds.
TURN = 10_000
# Bytes of a cache line.
LINE = 64


def _run(w: Work, limits: FloatArray) -> list[tuple[int, ...]]:
    """Search a piece on under these limits, for a turn at most; the subsets that got under them."""
    loosest = np.maximum.accumulate(limits[::-1])[::-1].copy()
    search(w, limits, loosest, TURN)
    found = [tuple(row[1 : row[0] + 1]) for row in w.hits[: w.state[HITS]].tolist()]
    w.state[HITS] = 0
    return found


def _open_subtrees(w: Work) -> list[OpenSubtree]:
    """What is still undecided of a piece, outermost first."""
    rest = []
    for level in range(int(w.state[LEVEL]) + 1):
        undecided = w.ids[level, : w.count[level]].tolist()
        if w.branched[level]:
            del undecided[-1]
        included = tuple(w.chosen[: w.base + level].tolist())
        rest.append(OpenSubtree(included, tuple(undecided), float(w.bound[level])))
    return rest


def _working_arrays(board: Board, piece: Node) -> Work:
    base, m = len(piece.included), piece.undecided.size
    levels = board.max_size - base + 2
    width = whole_vectors(m)
    A = _aligned(levels, m, width)
    B = _aligned(levels, m, width)
    x, beta = _aligned(levels, width), _aligned(levels, width)
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
    return Work(
        A=A, B=B, x=x, beta=beta, ids=ids, count=count, branched=np.zeros(levels, dtype=np.bool_),
        owns=owns, rss=rss, bound=bound, chosen=chosen,
        hits=np.empty((HIT_ROOM + m * m, board.max_size + 4), dtype=np.int64), scratch=_aligned(5, width),
        most=np.full(levels, board.max_size, dtype=np.int64), packing=_aligned(5, width), factor=_aligned(m, width),
        sets=np.empty((3, m), dtype=np.int64), place=np.arange(float(width)),
        state=np.zeros(3, dtype=np.int64), base=base, slack=board.margin,
    )  # fmt: skip


def _aligned(*shape: int) -> FloatArray:
    """Zeros that begin where a cache line does: a vector across two lines takes as long as two."""
    room = np.zeros(prod(shape) + LINE // 8)
    start = -room.ctypes.data % LINE // 8
    return room[start : start + prod(shape)].reshape(shape)


def search_compiled(
    board: Board, subtrees: Sequence[OpenSubtree], deadline: float, threads: int
) -> tuple[int, list[OpenSubtree]]:
    """Search all subtrees, lowest bound first: nodes visited, and what is left at the deadline.

    Several threads take a turn each on as many subtrees, and give back what is left of these for the next turn.
    """
    nodes, left = 0, list(subtrees)
    lock, until = threading.Lock(), deadline

    def searched(subtree: OpenSubtree) -> tuple[int, list[OpenSubtree]]:
        """Nodes of the subtree visited, and what is left of it at the end of the turn."""
        piece = make_node(board.frame, subtree.included, subtree.undecided)
        if piece is None:
            return 0, []
        with lock:
            if piece.dependency:
                NumpyTree(board, spend=lambda: None).score(subtree)
                return 0, []
            board.offer(piece.included)
        if not piece.undecided.size or len(piece.included) >= board.max_size:
            return 0, []
        w = _working_arrays(board, piece)
        while w.state[LEVEL] >= 0 and time.perf_counter() < until and (threads == 1 or w.state[NODES] < TURN):
            hits = _run(w, board.limits.copy())
            with lock:
                board.offer_all(hits)
        return int(w.state[NODES]), _open_subtrees(w)

    with ThreadPoolExecutor(threads) as crew:
        try:
            while left and time.perf_counter() < deadline:
                left.sort(key=lambda subtree: subtree.bound)
                batch, left = left[:threads], left[threads:]
                for visited, rest in crew.map(searched, batch):
                    nodes += visited
                    left += rest
        except BaseException:
            until = -np.inf  # the others end too
            raise
    return nodes, left
