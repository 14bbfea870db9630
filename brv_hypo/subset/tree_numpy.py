"""The include/drop tree in plain numpy: no compiler to wait for, enough for the problems of every day."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from brv_hypo.arrays import FloatArray, IntArray
from brv_hypo.subset.board import Board
from brv_hypo.subset.nodes import Node, SchurNode, Scored, TriangularNode
from brv_hypo.subset.pieces import CLOSED_FORM, OpenSubtree, Piece, make_leaf, propagate

# Relative allowance for rounding in the 2x2 determinant of a pair.
DETERMINANT_SLACK = 1e-12


class StopSearchError(Exception):
    """Raised by the caller's ``spend`` to stop the search; what is left is then in ``open_subtrees``."""


class NumpyTree:
    """Depth-first search of pieces; ``spend`` is called at every node and may stop it."""

    def __init__(self, board: Board, *, spend: Callable[[], None]) -> None:
        self._board = board
        self._spend = spend
        self._constraints = board.frame.constraints
        self.open_subtrees: list[OpenSubtree] = []

    def run(self, piece: Piece, *, triangular: bool) -> None:
        """Search the piece to the end, by orthogonal steps if `triangular`; better subsets go to the board."""
        self._board.offer(piece.included)
        if len(piece.included) < self._board.max_size and piece.undecided:
            self._visit((TriangularNode if triangular else SchurNode).start(piece))

    def score(self, part: OpenSubtree) -> None:
        """Score a part with at most two places left."""
        size = len(part.included)
        room = min(self._board.max_size - size, CLOSED_FORM)
        leaf = make_leaf(self._board.frame, part, room)
        if leaf is None:
            return
        if leaf.rss <= self._board.limits[size]:
            self._board.offer(leaf.included)
        if leaf.labels.size:
            self._score(leaf, room)

    def _visit(self, node: Node | None) -> None:
        limits = self._board.limits
        while node is not None and node.labels.size:
            try:
                self._spend()
            except StopSearchError:
                self._leave_open(node, None)
                raise
            rises = node.rises()
            quota = self._quota(node, rises)
            if quota <= 2:
                self._score(node, quota)
                return
            branch = int(rises.argmax())
            label = int(node.labels[branch])
            child = self._include(node, label)
            if child is not None:
                if child.rss <= limits[len(child.included)]:
                    self._board.offer(child.included)
                try:
                    self._descend(child, quota - 1)
                except StopSearchError:
                    self._leave_open(node, label)
                    raise
            if node.bound + rises[branch] > limits[len(node.included) + 1 :].max():
                return
            node = self._drop(node, label)

    def _descend(self, child: Node, quota: int) -> None:
        """Search below an inclusion: bound and rises are the parent's, so the quota is known."""
        if quota == 2 and not self._constraints.active:
            self._score(child, quota)
        else:
            self._visit(child)

    def _leave_open(self, node: Node, searched: int | None) -> None:
        undecided = tuple(u for u in node.labels.tolist() if u != searched)
        self.open_subtrees.append(OpenSubtree(node.included, undecided, node.bound))

    def _quota(self, node: Node, rises: FloatArray) -> int:
        """Largest number of further columns with which a subset may still beat the board.

        A subset with t of them leaves out at least one of the t + 1 columns of the largest rise.
        """
        size = len(node.included)
        for t in range(min(self._board.max_size - size, rises.size), 0, -1):
            allowance = self._board.limits[size + t] - node.bound
            if allowance >= 0.0 and np.count_nonzero(rises > allowance) <= t:
                return t
        return 0

    def _include(self, node: Node, label: int) -> Node | None:
        if not self._constraints.active:
            return node.include(label)
        undecided = [u for u in node.labels.tolist() if u != label]
        allowed = propagate(self._constraints, (*node.included, label), undecided)
        if allowed is None or len(allowed[0]) > self._board.max_size:
            return None
        child = node
        for new in allowed[0][len(node.included) :]:
            child = child.include(new)
        return _drop_all(child, set(undecided) - set(allowed[0]) - set(allowed[1]))

    def _drop(self, node: Node, label: int) -> Node | None:
        dropped = node.drop(label)
        if not self._constraints.active:
            return dropped
        undecided = dropped.labels.tolist()
        allowed = propagate(self._constraints, dropped.included, undecided)
        return None if allowed is None else _drop_all(dropped, set(undecided) - set(allowed[1]))

    def _score(self, node: Scored, quota: int) -> None:
        """Score all singles, and all pairs where the quota is two, in closed form without division.

        A pair gains what is needed, D, where d_k (c_i^2 - D d_i) + c_k^2 d_i + S_ik (D S_ik - 2 c_i c_k)
        is not negative.
        """
        if quota <= 0:
            return
        size = len(node.included)
        limits = self._board.limits
        d, c = node.singles()
        squares = c * c
        single = squares >= (node.rss - limits[size + 1]) * d
        if single.any():
            self._offer(node, np.flatnonzero(single)[:, None])
        if quota < 2 or d.size < 2:
            return
        needed = node.rss - limits[size + 2]
        eased = needed - abs(needed) * (self._board.margin + DETERMINANT_SLACK)
        S = node.products()
        surplus = needed * S
        surplus -= (2.0 * c)[:, None] * c
        surplus *= S
        left, right = np.empty((d.size, 2)), np.empty((2, d.size))
        left[:, 0], left[:, 1], right[0], right[1] = squares - eased * d, d, d, squares
        surplus += left @ right
        surplus.flat[:: d.size + 1] = -1.0
        if surplus.max() >= 0.0:
            pairs = np.argwhere(surplus >= 0.0)
            self._offer(node, pairs[pairs[:, 0] < pairs[:, 1]])

    def _offer(self, node: Scored, extra: IntArray) -> None:
        for labels in node.labels[extra].tolist():
            self._board.offer((*node.included, *labels))


def _drop_all(node: Node, labels: set[int]) -> Node:
    for label in sorted(labels):
        node = node.drop(label)
    return node
