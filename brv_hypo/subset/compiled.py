"""The compiled tree search on Schur complements, for well-conditioned columns, and its calls.

The column to branch on is moved to the last place; including it is a rank-one step on S into the next level, dropping
it one on H in place. Both are stored in full; a level copies H from its parent when it first branches. Nodes that take
two more columns are scored in closed form. `search_compiled` is the entrance: it builds the working arrays of each
subproblem, runs the compiled loops on and reads out what is left. Imported when the compiled search is wanted:
importing numba costs more than most searches.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numba import njit
from scipy.linalg.lapack import dtrtri

from brv_hypo.subset.search import Board, Node, NumpyTree, OpenSubtree, make_node

LEVEL, NODES, HITS = 0, 1, 2  # scalars of the search, by position in ``Work.state``
NONE: Any = np.int64(-1)  # an argument as numpy scalar: numba would compile a function anew for every literal

Function = TypeVar("Function", bound=Callable[..., Any])

# Without references counted (nothing is made here): counting those of arrays handed on took a fifth of the time.
_jit: Any = njit
_OPTIONS = {"cache": True, "nogil": True, "fastmath": True, "error_model": "numpy", "_nrt": False}
compiled: Callable[[Function], Function] = _jit(**_OPTIONS)
"""Compile on first call, keep on disk, run without the interpreter lock."""
compiled_part: Callable[[Function], Function] = _jit(no_cpython_wrapper=True, no_cfunc_wrapper=True, **_OPTIONS)
"""The same for what compiled functions alone call: a wrapper for Python would take as long again to compile."""
# Nodes visited after a hit before the kernel hands it over.
PATIENCE = 32
HIT_ROOM = 512
TURN = 10_000  # nodes between checks of the clock and the board, and of a thread's turn: some tens of milliseconds


class Work(NamedTuple):
    """The state of one search, which stops and goes on at any node. A level is a number of included columns."""

    S: Any  # (levels, m, m): normal matrix of the undecided columns, the included ones projected out
    H: Any  # (levels, m, m): its inverse
    c: Any  # (levels, m): its right-hand side
    beta: Any  # (levels, m): coefficients with all undecided columns in
    ids: Any  # (levels, m): the undecided columns
    count: Any  # (levels,): how many they are
    branched: Any  # (levels,): whether the include branch of the last column is taken
    owns: Any  # (levels,): whether H is the level's own
    rss: Any  # (levels,): residual without the undecided columns
    bound: Any  # (levels,): residual with all of them
    most: Any  # (levels,): no larger subset below the level can get under its limit
    chosen: Any  # the included columns
    hits: Any  # rows of (size, columns...)
    rise: Any  # (m,): rises of the bound
    diagonal: Any  # (m,): that of S
    state: Any  # LEVEL, NODES, HITS
    base: int  # columns included before the search
    slack: float  # allowance for rounding in a determinant


# ---- Nodes ruled out, and scored ----


@compiled_part
def quota_of(rise: Any, m: int, bound: float, limits: Any, size: int, most: int) -> int:
    """Largest number t of further columns, to no more than ``most`` in all, that may still get under the limit. Such a
    subset leaves out at least one of the t + 1 columns of the largest rise, so no more than t may break it.
    """
    t: int = min(most - size, m)
    while t > 0:
        allowance = limits[size + t] - bound
        if allowance >= 0.0:
            above = 0
            for i in range(m):
                above += 1 if rise[i] > allowance else 0
            if above <= t:
                return t
        t -= 1
    return 0


@compiled_part
def record(w: Work, size: int, a: Any, b: Any) -> None:
    """Note the chosen columns, with up to two more, as a subset to be looked at."""
    row = w.hits[w.state[HITS]]
    for i in range(size):
        row[i + 1] = w.chosen[i]
    if a >= 0:
        size += 1
        row[size] = a
    if b >= 0:
        size += 1
        row[size] = b
    row[0] = size
    w.state[HITS] += 1


@compiled_part
def score(w: Work, level: int, m: int, pairs: bool, limits: Any) -> None:
    """Record every column of a node, and every pair, whose gain reaches what its size needs, without a division. S is
    the normal matrix (its lower triangle is read), d its diagonal, c its right-hand side. A pair gains enough where d_k
    (c_i^2 - D d_i) + c_k^2 d_i + v (D v - 2 c_i c_k) >= 0, with v its entry and D what is needed.
    """
    S, d, c, ids, size, rss = w.S[level], w.diagonal, w.c[level], w.ids[level], w.base + level, w.rss[level]
    needed = rss - limits[size + 1]
    for i in range(m):
        d[i] = S[i, i]
        if c[i] * c[i] >= needed * d[i]:
            record(w, size, ids[i], NONE)
    if not pairs:
        return
    needed = rss - limits[size + 2]
    relaxed = needed - abs(needed) * w.slack
    for i in range(1, m):
        di, ci = d[i], c[i]
        a = ci * ci - relaxed * di
        b = 2.0 * ci
        row = S[i]
        # Counting vectorises better than taking the maximum; the row is gone over again only on a hit.
        enough = 0
        for k in range(i):
            v = row[k]
            enough += 1 if d[k] * a + c[k] * c[k] * di + v * (needed * v - b * c[k]) >= 0.0 else 0
        if enough > 0:
            for k in range(i):
                v = row[k]
                if d[k] * a + c[k] * c[k] * di + v * (needed * v - b * c[k]) >= 0.0:
                    record(w, size, ids[i], ids[k])


# ---- Steps on Schur complements ----


@compiled_part
def rises(w: Work, level: int, m: int, out: Any) -> None:
    """Rise of the bound on dropping each undecided column: beta^2 / H_jj."""
    H = w.H[level] if w.owns[level] else w.H[level - 1]
    beta = w.beta[level]
    for i in range(m):
        out[i] = beta[i] * beta[i] / H[i, i]


@compiled_part
def place(w: Work, level: int, j: int, m: int) -> None:
    """Move the column to branch on to the last place."""
    S, H, c, beta, ids = w.S[level], w.H[level], w.c[level], w.beta[level], w.ids[level]
    if not w.owns[level]:
        source = w.H[level - 1]
        for i in range(m):
            for k in range(m):
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
    """Drop the last column: a rank-one step on H, S unchanged."""
    H, beta = w.H[level], w.beta[level]
    w.bound[level] += beta[last] * beta[last] / H[last, last]
    _downdate(H, beta, H, beta, last)


@compiled_part
def include(w: Work, level: int, last: int) -> None:
    """Include the last column: a rank-one step on S into the next level, H unchanged."""
    S, c = w.S[level], w.c[level]
    _downdate(S, c, w.S[level + 1], w.c[level + 1], last)
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
    for i in range(last):
        factor = M[last, i] * scale
        for k in range(last + 1):
            out[i, k] = M[i, k] - factor * M[last, k]
    for i in range(last):
        out_v[i] = v[i] - M[last, i] * shift


@compiled
def search(w: Work, limits: Any, loosest: Any, budget: int) -> None:
    """Go on until the tree or the budget is done, hits have waited long enough, or their room is short. ``limits[k]``:
    a subset of size k is of interest below it; ``loosest[k]``: the largest limit from size k on.
    """
    rise = w.rise
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
        w.most[level] = size + quota
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
    S, H, c, beta = (np.zeros((levels, *shape)) for shape in ((m, m), (m, m), (m,), (m,)))
    # H from the inverse of R, never from the inverse of S, which would square the condition number.
    inverse = np.asarray(dtrtri(piece.R)[0], dtype=np.float64)
    S[0], c[0] = piece.R.T @ piece.R, piece.R.T @ piece.z
    H[0], beta[0] = inverse @ inverse.T, inverse @ piece.z
    ids, count, rss, bound = np.empty((levels, m), dtype=np.int64), np.zeros(levels, int), *np.empty((2, levels))
    ids[0], count[0], rss[0], bound[0] = piece.undecided, m, piece.rss, piece.bound
    chosen = np.full(board.max_size + 1, -1, dtype=np.int64)
    chosen[:base] = piece.included
    return Work(
        S=S, H=H, c=c, beta=beta, ids=ids, count=count, branched=np.zeros(levels, dtype=np.bool_),
        owns=np.arange(levels) == 0, rss=rss, bound=bound, most=np.full(levels, board.max_size, dtype=np.int64),
        chosen=chosen, hits=np.empty((HIT_ROOM + m * m, board.max_size + 4), dtype=np.int64), rise=np.empty(m),
        diagonal=np.empty(m), state=np.zeros(3, dtype=np.int64), base=base, slack=board.margin,
    )  # fmt: skip


def search_compiled(
    board: Board, subtrees: Sequence[OpenSubtree], deadline: float, threads: int
) -> tuple[int, list[OpenSubtree]]:
    """Search all subtrees, lowest bound first, in turns on threads: nodes visited, what is left at the deadline."""
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
            limits = board.limits.copy()
            search(w, limits, np.maximum.accumulate(limits[::-1])[::-1].copy(), TURN)
            hits = [tuple(row[1 : row[0] + 1]) for row in w.hits[: w.state[HITS]].tolist()]
            w.state[HITS] = 0
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
