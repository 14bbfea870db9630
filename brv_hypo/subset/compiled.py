"""The compiled tree search, called: serially at first, on several threads once a search has proved long.

`CompiledSearch` builds the working arrays of one subproblem, runs the kernel on and reads out what is left;
`search_compiled` is the entrance. Imported only when the compiled kernel is wanted: importing numba costs more than
most searches.
"""

from __future__ import annotations

import heapq
import threading
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from math import prod
from typing import Any

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.subset.frame import Constraints
from brv_hypo.subset.incumbents import Board
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
from brv_hypo.subset.tree import Node, NumpyTree, OpenSubtree, make_node

HIT_ROOM = 512
# Bytes of a cache line.
LINE = 64
# Nodes with no more columns to go are scored, not ruled out by sets of columns first; and fours from no more beginnings
# of three columns, above which it is quicker to branch (``python -m tests.studies.subset.study``).
SCORED, MOST_PREFIXES = 4, 3000


class CompiledSearch:
    """Depth-first search of one piece that stops and goes on."""

    def __init__(self, board: Board, piece: Node, *, orthogonal: bool) -> None:
        self._orthogonal = True if orthogonal else None
        self._work = _working_arrays(board, piece, orthogonal)

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


def _working_arrays(board: Board, piece: Node, orthogonal: bool) -> Work:
    base, m, n = len(piece.included), piece.undecided.size, board.frame.n_candidates
    levels = board.max_size - base + 2
    width = whole_vectors(m)
    A = _aligned(levels, m, width)
    B = _aligned(2 if orthogonal else levels, m, width)
    x, beta = _aligned(levels, width), _aligned(levels, width)
    if orthogonal:
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
    status[piece.undecided] = UNDECIDED
    requires, excludes = _rules(board.frame.constraints)
    return Work(
        A=A, B=B, x=x, beta=beta, ids=ids, count=count, phase=np.zeros(levels, dtype=np.int64),
        at=np.zeros(levels, dtype=np.int64), owns=owns, rss=rss, bound=bound, chosen=chosen, status=status,
        trail=np.zeros((n + 1, 2), dtype=np.int64), requires=requires, excludes=excludes,
        hits=np.empty((HIT_ROOM + m * m, board.max_size + 4), dtype=np.int64), scratch=_aligned(5, width),
        most=np.full(levels, board.max_size, dtype=np.int64), packing=_aligned(5, width), factor=_aligned(m, width),
        sets=np.empty((4, m), dtype=np.int64), place=np.arange(float(width)),
        state=np.zeros(4, dtype=np.int64), base=base, slack=board.margin,
        scored=SCORED, prefixes=MOST_PREFIXES,
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


# ---- Runs compiled searches: serially at first, on several threads once a search has proved long ----


# Nodes between looks at the clock, the board and the other workers: some tens of milliseconds.
TURN = 10_000
SERIAL_S = 0.1


def search_compiled(
    board: Board, subtrees: Sequence[OpenSubtree], orthogonal: bool, deadline: float, threads: int
) -> tuple[int, list[OpenSubtree]]:
    """Search all subtrees: nodes visited, and what is left at the deadline."""
    pool = _Pool(board, subtrees, orthogonal, threads)
    pool.until = min(deadline, time.perf_counter() + SERIAL_S) if threads > 1 else deadline
    pool.work()
    pool.until = deadline
    if pool.waiting and time.perf_counter() < deadline:
        with ThreadPoolExecutor(threads) as crew:
            try:
                for worker in as_completed([crew.submit(pool.work) for _ in range(threads)]):
                    worker.result()
            except BaseException:
                pool.until = -np.inf  # the others end too
                raise
    return pool.nodes, pool.waiting


class _Pool:
    """Subtrees waiting, lowest bound first; workers take them, and give parts back when others are idle."""

    def __init__(self, board: Board, subtrees: Sequence[OpenSubtree], orthogonal: bool, threads: int) -> None:
        self._board = board
        self._orthogonal = orthogonal
        self._threads = threads
        self._change = threading.Condition()
        self._heap: list[tuple[float, int, OpenSubtree]] = []
        self._serial = 0
        self._busy = 0
        self.until = np.inf
        self.nodes = 0
        for subtree in subtrees:
            self._push(subtree)

    @property
    def waiting(self) -> list[OpenSubtree]:
        """Subtrees that nobody has searched."""
        return [subtree for _, _, subtree in self._heap]

    def work(self) -> None:
        """Search subtrees until none is left or the time is up."""
        while (subtree := self._take()) is not None:
            try:
                self._search(subtree)
            finally:
                with self._change:
                    self._busy -= 1
                    self._change.notify_all()

    def _take(self) -> OpenSubtree | None:
        with self._change:
            while not self._heap and self._busy:
                self._change.wait()
            if not self._heap or time.perf_counter() >= self.until:
                return None
            self._busy += 1
            return heapq.heappop(self._heap)[2]

    def _push(self, subtree: OpenSubtree) -> None:
        self._serial += 1
        heapq.heappush(self._heap, (subtree.bound, self._serial, subtree))

    def _search(self, subtree: OpenSubtree) -> None:
        piece = make_node(self._board.frame, subtree.included, subtree.undecided)
        if piece is None:
            return
        if piece.dependency:
            with self._change:
                NumpyTree(self._board, spend=lambda: None).score(subtree)
            return
        with self._change:
            self._board.offer(piece.included)
        if not piece.undecided.size or len(piece.included) >= self._board.max_size:
            return
        search = CompiledSearch(self._board, piece, orthogonal=self._orthogonal)
        counted = 0
        while not search.done:
            hits = search.run(self._board.limits.copy(), TURN)
            with self._change:
                self._board.offer_all(hits)
                self.nodes += search.nodes - counted
                counted = search.nodes
                # The first turn may have waited for the compiler; that is no reason to split.
                idle = self._threads - self._busy - len(self._heap)
                if time.perf_counter() >= self.until or (self._busy > 1 and idle > 0 and not search.done):
                    for part in search.open_subtrees():
                        self._push(part)
                    self._change.notify_all()
                    return
