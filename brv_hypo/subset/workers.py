"""Runs compiled searches: serially at first, on several threads once a search has proved long."""

from __future__ import annotations

import heapq
import threading
import time
from collections.abc import Sequence

from brv_hypo.subset.board import Board
from brv_hypo.subset.compiled import CompiledSearch
from brv_hypo.subset.pieces import OpenSubtree, make_piece
from brv_hypo.subset.search import Effort
from brv_hypo.subset.tree_numpy import NumpyTree

# Nodes between looks at the clock, the board and the other workers: some tens of milliseconds.
TURN = 10_000
SERIAL_S = 0.1


def search_compiled(
    board: Board, subtrees: Sequence[OpenSubtree], triangular: bool, effort: Effort, deadline: float
) -> tuple[int, list[OpenSubtree]]:
    """Search all subtrees: nodes visited, and what is left at the deadline."""
    pool = _Pool(board, subtrees, triangular, effort, deadline)
    pool.work(serial_until=time.perf_counter() + SERIAL_S if effort.threads > 1 else float("inf"))
    if pool.waiting and time.perf_counter() < deadline:
        crew = [threading.Thread(target=pool.work) for _ in range(effort.threads)]
        for thread in crew:
            thread.start()
        for thread in crew:
            thread.join()
        pool.raise_failure()
    return pool.nodes, pool.waiting


class _Pool:
    """Subtrees waiting, lowest bound first; workers take them, and give parts back when others are idle."""

    def __init__(
        self, board: Board, subtrees: Sequence[OpenSubtree], triangular: bool, effort: Effort, deadline: float
    ) -> None:
        self._board = board
        self._triangular = triangular
        self._effort = effort
        self._deadline = deadline
        self._change = threading.Condition()
        self._heap: list[tuple[float, int, OpenSubtree]] = []
        self._serial = 0
        self._busy = 0
        self._failure: BaseException | None = None
        self.nodes = 0
        for subtree in subtrees:
            self._push(subtree)

    @property
    def waiting(self) -> list[OpenSubtree]:
        """Subtrees that nobody has searched."""
        return [subtree for _, _, subtree in self._heap]

    def raise_failure(self) -> None:
        """Pass on what went wrong in a worker."""
        if self._failure is not None:
            raise self._failure

    def work(self, serial_until: float = float("inf")) -> None:
        """Search subtrees until none is left, the deadline or, when serial, its time."""
        until = min(self._deadline, serial_until)
        while (subtree := self._take(until)) is not None:
            try:
                self._search(subtree, until)
            except BaseException as failure:
                self._failure = failure
                raise
            finally:
                with self._change:
                    self._busy -= 1
                    self._change.notify_all()

    def _take(self, until: float) -> OpenSubtree | None:
        with self._change:
            while not self._heap and self._busy:
                self._change.wait()
            if not self._heap or self._failure is not None or time.perf_counter() >= until:
                return None
            self._busy += 1
            return heapq.heappop(self._heap)[2]

    def _push(self, subtree: OpenSubtree) -> None:
        self._serial += 1
        heapq.heappush(self._heap, (subtree.bound, self._serial, subtree))

    def _search(self, subtree: OpenSubtree, until: float) -> None:
        piece = make_piece(self._board.frame, subtree.included, subtree.undecided)
        if piece is None:
            return
        if piece.singular:
            with self._change:
                NumpyTree(self._board, spend=lambda: None).score(subtree)
            return
        with self._change:
            self._board.offer(piece.included)
        if not piece.undecided or len(piece.included) >= self._board.max_size:
            return
        search = CompiledSearch(self._board, piece, triangular=self._triangular)
        seen = 0
        while not search.done:
            hits = search.run(self._board.limits.copy(), TURN)
            with self._change:
                self._board.offer_all(hits)
                self.nodes += search.nodes - seen
                seen = search.nodes
                # The first turn may have waited for the compiler; that is no reason to split.
                idle = self._effort.threads - self._busy - len(self._heap)
                if time.perf_counter() >= until or (self._busy > 1 and idle > 0 and not search.done):
                    for part in search.open_subtrees():
                        self._push(part)
                    self._report(())
                    self._change.notify_all()
                    return
                self._report(search.open_subtrees())

    def _report(self, current: Sequence[OpenSubtree]) -> None:
        if self._effort.progress is not None:
            n = self._board.frame.n_candidates
            left = sum(0.5 ** (n - len(s.undecided)) for s in (*self.waiting, *current))
            self._effort.progress(max(0.0, 1.0 - left), self.nodes)
