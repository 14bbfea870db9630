"""The search in numpy: the best subsets so far, and the include/drop tree over subproblems of independent columns.

A `Board` holds the incumbents, size by size, and the thresholds that they set for pruning. `seed_board` fills it by
forward selection, which is quick and not always right: the exact search starts from there.

A `Node` holds what is in, what is undecided and what the included columns leave of the undecided ones and of the
response, R and z. Dropping column j raises the bound (the residual with all undecided columns in) by beta_j^2 / H_jj,
with H = (R'R)^-1 and beta = H R'z. Steps are orthogonal, and so right however ill-conditioned the columns are; this
tree needs no compiler to wait for, which is enough for the problems of every day.

The compiled search needs independent undecided columns; where they are not, the tree is cut along the dependency, as
a subset of full rank leaves out at least one of the columns that take part in it. Two places left or fewer make a
leaf, whose pairs are scored without the inverse. Entrances: `seed_board`, `independent_pieces`, `NumpyTree`.
"""

from __future__ import annotations

from bisect import insort
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cmp_to_key

import numpy as np
from scipy.linalg.lapack import dtrtri, dtrtrs

from brv_hypo.arrays import FloatArray, IntArray
from brv_hypo.subset.frame import EPS, Frame, dependency, project_out, square_triangle, triangle

# Residual sum of squares, and the columns of X without the forced ones, ascending.
Chosen = tuple[float, tuple[int, ...]]
TIE = 1e-11  # residual sums of squares closer than this, relatively, are a tie and are ordered by column number
LEAST_MARGIN = 1e-10  # relative allowance for rounding in a bound where the columns are well-conditioned
CLOSED = -1.0  # A limit that nothing can get under
LEAST_LENGTH = 3e-6  # what forward selection must find left of a unit column
CLOSED_FORM = 2  # places left that need no inverse to be filled
DETERMINANT_SLACK = 1e-12  # relative allowance for rounding in the 2x2 determinant of a pair


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
        """Offer every subset, in an order that does not depend on theirs."""
        for key in sorted({tuple(sorted(subset)) for subset in subsets}):
            self.offer(key)

    def offer(self, subset: Sequence[int]) -> None:
        """Take in a subset of candidate positions where it is allowed, of full rank and good enough."""
        key = tuple(sorted(subset))
        size = len(key)
        if not 0 < size <= self.max_size or key in self._offered:
            return
        self._offered.add(key)
        if self.frame.constraints.propagated(key, ()) is None:
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


def residual(frame: Frame, subset: Sequence[int]) -> float | None:
    """Residual sum of squares by QR of the columns themselves; None where they are dependent."""
    k = len(subset)
    factor = triangle(frame.columns(subset))
    if dependency(factor[:k, :k], frame.noise[list(subset)]):
        return None
    tail = factor[k:, k]
    return frame.rss_full + float(tail @ tail)


def seed_board(board: Board) -> None:
    """Fill the board with good subsets of every size, where no rules restrict them; exactness never depends on it."""
    frame = board.frame
    if frame.constraints.active:
        return
    chosen: list[int] = []
    for _ in range(board.max_size):
        basis = np.linalg.qr(frame.R[:, chosen])[0]
        columns, lengths = project_out(basis, frame.R)
        solid = lengths > LEAST_LENGTH
        gains = np.where(solid, (frame.z @ columns / np.where(solid, lengths, 1.0)) ** 2, -1.0)
        gains[chosen] = -np.inf
        ranked = np.argsort(-gains, kind="stable").tolist()
        board.offer_all([[*chosen, j] for j in ranked[: board.capacity]])
        chosen.append(ranked[0])


# ---- Nodes: what is in, what is undecided, and the factor of what is left ----


@dataclass(frozen=True)
class OpenSubtree:
    """A subtree that a search has left undone; no subset in it has a residual below ``bound``."""

    included: tuple[int, ...]
    undecided: tuple[int, ...]
    bound: float


@dataclass(frozen=True)
class Node:
    """All subsets that hold ``included`` and otherwise draw on ``undecided``."""

    included: tuple[int, ...]  # candidates already in
    undecided: IntArray  # candidates to decide on (u,)
    R: FloatArray  # what the included leave of the undecided columns (u, u), triangular
    z: FloatArray  # what they leave of the response, on the same rows
    bound: float  # residual sum of squares of nothing but what these rows do not hold: no subset has less
    dependency: tuple[int, ...] = ()  # undecided columns in a linear dependency, where there is one

    @property
    def rss(self) -> float:
        """Residual sum of squares of the included columns alone."""
        return self.bound + float(self.z @ self.z)

    def rises(self) -> FloatArray:
        """Rise of the bound on dropping each undecided column; zero where the factor is singular."""
        inverse, singular = dtrtri(self.R)
        if singular or self.dependency:
            return np.zeros(self.z.size)
        return np.asarray((inverse @ self.z) ** 2 / np.einsum("ij,ij->i", inverse, inverse))

    def rounding_margin(self, *, orthogonal: bool) -> float:
        """Relative allowance for rounding in the bounds below this node. A residual r is perturbed by about eps
        |beta|_1 / |r| where orthogonal steps are taken on R, and by the square of that on Schur complements; the
        complete model has the largest coefficients.
        """
        if not self.undecided.size or self.bound <= 0.0:
            return 0.0
        growth = float(np.abs(dtrtrs(self.R, self.z)[0]).sum()) / float(np.sqrt(self.bound))
        return 16.0 * EPS * growth if orthogonal else 64.0 * EPS * max(growth, growth**2)

    def include(self, column: int) -> Node:
        """The node with one more in: its column is rotated to the front and its row struck."""
        j, others, factor = self._with_columns(column, in_front=True)
        factor[: j + 1] = triangle(factor[: j + 1])
        return Node(
            included=(*self.included, column), undecided=self.undecided[others], R=factor[1:, 1:-1],
            z=factor[1:, -1], bound=self.bound,
        )  # fmt: skip

    def drop(self, column: int) -> Node:
        """The node with one fewer to decide: its column is struck; the last entry of z goes to the bound."""
        j, others, factor = self._with_columns(column, in_front=False)
        factor[j:, j:] = triangle(factor[j:, j:])
        return Node(
            included=self.included, undecided=self.undecided[others], R=factor[:-1, :-1], z=factor[:-1, -1],
            bound=self.bound + float(factor[-1, -1] ** 2),
        )  # fmt: skip

    def _with_columns(self, column: int, *, in_front: bool) -> tuple[int, list[int], FloatArray]:
        """Where a column is, where the others are, and R of these, with it in front or without it, and z."""
        j = int((self.undecided == column).argmax())
        others = [*range(j), *range(j + 1, self.z.size)]
        places = [j, *others] if in_front else others
        both = np.empty((self.z.size, len(places) + 1))
        both[:, :-1], both[:, -1] = self.R[:, places], self.z
        return j, others, both


def make_node(frame: Frame, included: tuple[int, ...], undecided: tuple[int, ...]) -> Node | None:
    """A node from the factor of all candidates; None where the included columns are dependent."""
    s, u = len(included), len(undecided)
    factor = square_triangle(frame.columns([*included, *undecided]))
    if dependency(factor[:s, :s], frame.noise[list(included)]):
        return None
    R = factor[s : s + u, s : s + u]
    return Node(
        included=included,
        undecided=np.array(undecided, dtype=np.int64),
        R=R,
        z=factor[s : s + u, s + u],
        bound=frame.rss_full + float(factor[-1, -1] ** 2),
        dependency=tuple(undecided[i] for i in dependency(R, frame.noise[list(undecided)])),
    )


def independent_pieces(frame: Frame, max_size: int) -> Iterator[Node | OpenSubtree]:
    """Cut the whole tree into nodes whose undecided columns are independent, and parts that are leaves. Leaves are left
    to be made, once, by who scores them: of dependent columns nearly all parts are leaves.
    """
    dependent = frame.rank < frame.candidates.size
    stack = [OpenSubtree((), tuple(range(frame.candidates.size)), frame.rss_full)]
    while stack:
        part = stack.pop()
        allowed = frame.constraints.propagated(part.included, part.undecided)
        if allowed is None or len(allowed[0]) > max_size:
            continue
        if dependent and max_size - len(allowed[0]) <= CLOSED_FORM:
            yield OpenSubtree(*allowed, part.bound)
            continue
        node = make_node(frame, *allowed)
        if node is None:
            continue
        if node.dependency:
            stack += _cut(node, max_size)
        else:
            yield node


def _cut(node: Node, max_size: int) -> Iterator[OpenSubtree]:
    """Parts of a node with a dependency, by the first of its columns that is left out; those before are in."""
    involved = node.dependency
    place = np.full(node.undecided.max() + 1, len(involved))
    place[list(involved)] = np.arange(len(involved))
    places = place[node.undecided]
    for i in range(min(len(involved), max_size - len(node.included) + 1)):
        undecided = tuple(node.undecided[places > i].tolist())
        yield OpenSubtree(node.included + involved[:i], undecided, node.bound)


class StopSearchError(Exception):
    """Raised by the caller's ``spend`` to stop the search; what is left is then in ``open_subtrees``."""


class NumpyTree:
    """Depth-first search of pieces; ``spend`` is called at every node and may stop it."""

    def __init__(self, board: Board, *, spend: Callable[[], None]) -> None:
        self._board = board
        self._spend = spend
        self._constraints = board.frame.constraints
        self.open_subtrees: list[OpenSubtree] = []

    def run(self, piece: Node) -> None:
        """Search the piece to the end; better subsets go to the board."""
        self._board.offer(piece.included)
        if len(piece.included) < self._board.max_size:
            self._visit(piece)

    def score(self, part: OpenSubtree) -> None:
        """Score a part with at most two places left."""
        size = len(part.included)
        room = min(self._board.max_size - size, CLOSED_FORM)
        leaf = make_node(self._board.frame, part.included, part.undecided if room else ())
        if leaf is None:
            return
        if leaf.rss <= self._board.limits[size]:
            self._board.offer(leaf.included)
        if leaf.undecided.size:
            self._score(leaf, room)

    def _visit(self, node: Node | None) -> None:
        limits = self._board.limits
        while node is not None and node.undecided.size:
            try:
                self._spend()
            except StopSearchError:
                self._leave_open(node, None)
                raise
            rises = node.rises()
            quota = self._quota(node, rises)
            if quota <= CLOSED_FORM:
                self._score(node, quota)
                return
            branch = int(rises.argmax())
            column = int(node.undecided[branch])
            child = self._include(node, column)
            if child is not None:
                if child.rss <= limits[len(child.included)]:
                    self._board.offer(child.included)
                # The bound and the rises of the child are those of this node, so its quota is known.
                if quota - 1 == CLOSED_FORM and not self._constraints.active:
                    self._score(child, CLOSED_FORM)
                else:
                    try:
                        self._visit(child)
                    except StopSearchError:
                        self._leave_open(node, column)
                        raise
            if node.bound + rises[branch] > limits[len(node.included) + 1 :].max():
                return
            node = self._drop(node, column)

    def _leave_open(self, node: Node, searched: int | None) -> None:
        undecided = tuple(u for u in node.undecided.tolist() if u != searched)
        self.open_subtrees.append(OpenSubtree(node.included, undecided, node.bound))

    def _quota(self, node: Node, rises: FloatArray) -> int:
        """Largest number of further columns with which a subset may still beat the board, by the largest rises."""
        size = len(node.included)
        for t in range(min(self._board.max_size - size, rises.size), 0, -1):
            allowance = self._board.limits[size + t] - node.bound
            if allowance >= 0.0 and np.count_nonzero(rises > allowance) <= t:
                return t
        return 0

    def _include(self, node: Node, column: int) -> Node | None:
        if not self._constraints.active:
            return node.include(column)
        undecided = [u for u in node.undecided.tolist() if u != column]
        allowed = self._constraints.propagated((*node.included, column), undecided)
        if allowed is None or len(allowed[0]) > self._board.max_size:
            return None
        child = node
        for new in allowed[0][len(node.included) :]:
            child = child.include(new)
        return _drop_all(child, set(undecided) - set(allowed[0]) - set(allowed[1]))

    def _drop(self, node: Node, column: int) -> Node | None:
        dropped = node.drop(column)
        if not self._constraints.active:
            return dropped
        undecided = dropped.undecided.tolist()
        allowed = self._constraints.propagated(dropped.included, undecided)
        return None if allowed is None else _drop_all(dropped, set(undecided) - set(allowed[1]))

    def _score(self, node: Node, quota: int) -> None:
        """Score singles, and pairs where the quota is two, without division. With S = R'R, d its diagonal and c = R'z,
        a pair gains D, as needed, where d_k (c_i^2 - D d_i) + c_k^2 d_i + S_ik (D S_ik - 2 c_i c_k) is >= 0.
        """
        if quota <= 0:
            return
        size = len(node.included)
        limits, rss = self._board.limits, node.rss
        d, c = np.einsum("ij,ij->j", node.R, node.R), node.z @ node.R
        squares = c * c
        single = squares >= (rss - limits[size + 1]) * d
        if single.any():
            self._offer(node, np.flatnonzero(single)[:, None])
        if quota < CLOSED_FORM or d.size < 2:
            return
        needed = rss - limits[size + 2]
        relaxed = needed - abs(needed) * (self._board.margin + DETERMINANT_SLACK)
        S = node.R.T @ node.R
        surplus = needed * S
        surplus -= (2.0 * c)[:, None] * c
        surplus *= S
        left, right = np.empty((d.size, 2)), np.empty((2, d.size))
        left[:, 0], left[:, 1], right[0], right[1] = squares - relaxed * d, d, d, squares
        surplus += left @ right
        surplus.flat[:: d.size + 1] = -1.0
        if surplus.max() >= 0.0:
            pairs = np.argwhere(surplus >= 0.0)
            self._offer(node, pairs[pairs[:, 0] < pairs[:, 1]])

    def _offer(self, node: Node, extra: IntArray) -> None:
        for columns in node.undecided[extra].tolist():
            self._board.offer((*node.included, *columns))


def _drop_all(node: Node, columns: set[int]) -> Node:
    for column in sorted(columns):
        node = node.drop(column)
    return node
