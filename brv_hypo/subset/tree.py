"""The include/drop tree: subproblems of independent columns, and their search in plain numpy.

A subproblem holds what is in, what is undecided and a factor to start from. The fast kernels need independent
undecided columns; where they are not, the tree is cut along the dependency, as a subset of full rank leaves out at
least one of the columns that take part in it. Two places left or fewer make a leaf, whose pairs are scored without
the inverse.

Dropping column j raises the bound (the residual with all undecided columns in) by beta_j^2 / H_jj, where S is the
Schur complement of the undecided columns given the included ones, H = S^-1 and beta = H c; ill-conditioned columns
take triangular factors instead. Entrances: `independent_pieces`, `NumpyTree`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from scipy.linalg.lapack import dtrtri, dtrtrs

from brv_hypo.arrays import FloatArray, IntArray
from brv_hypo.subset.frame import EPS, Constraints, Frame, dependency, project_out, triangle
from brv_hypo.subset.incumbents import Board

# ---- Pieces of the search tree: what is in, what is undecided, and the factor to start from ----


# Places left that need no inverse to be filled.
CLOSED_FORM = 2


@dataclass(frozen=True)
class Piece:
    """A subtree: all subsets that hold ``included`` and otherwise draw on ``undecided``.

    ``R`` (u, u) and ``z`` (u,) are the triangular problem left after ``included``; ``bound`` is the
    residual sum of squares with every undecided column in.
    """

    included: tuple[int, ...]
    undecided: tuple[int, ...]
    R: FloatArray
    z: FloatArray
    bound: float
    dependency: tuple[int, ...]

    @property
    def singular(self) -> bool:
        """Whether the undecided columns are dependent."""
        return bool(self.dependency)

    @cached_property
    def labels(self) -> IntArray:
        """The undecided columns as an array."""
        return np.array(self.undecided, dtype=np.int64)

    @cached_property
    def position(self) -> dict[int, int]:
        """Where each undecided column stands."""
        return {label: i for i, label in enumerate(self.undecided)}

    @property
    def rss(self) -> float:
        """Residual sum of squares of the included columns alone."""
        return self.bound + float(self.z @ self.z)

    @property
    def inverse(self) -> FloatArray:
        """R^-1, found anew each time: a tree may have tens of thousands of pieces."""
        return np.asarray(np.linalg.solve(self.R, np.eye(self.z.size)), dtype=np.float64)

    @cached_property
    def condition(self) -> float:
        """Condition number of the undecided columns."""
        return float(np.linalg.cond(self.R)) if self.undecided else 1.0

    def rounding_margin(self, *, triangular: bool) -> float:
        """Relative allowance for rounding in the bounds of this piece.

        A residual r is perturbed by about eps |beta|_1 / |r| where orthogonal steps are taken on R, and by
        the square of that on Schur complements; the complete model has the largest coefficients.
        """
        if not self.undecided or self.bound <= 0.0:
            return 0.0
        growth = float(np.abs(dtrtrs(self.R, self.z)[0]).sum()) / float(np.sqrt(self.bound))
        return 16.0 * EPS * growth if triangular else 64.0 * EPS * max(growth, growth**2)


@dataclass(frozen=True)
class Leaf:
    """A subtree with at most two places left, to be scored in closed form; its undecided columns may be dependent.

    ``columns`` (m, u) and ``z`` (m,) are what ``included`` leave of the undecided columns and of the response.
    """

    included: tuple[int, ...]
    labels: IntArray
    columns: FloatArray
    z: FloatArray
    rss: float

    def singles(self) -> tuple[FloatArray, FloatArray]:
        """The diagonal of S, and c."""
        return np.einsum("ij,ij->j", self.columns, self.columns), self.z @ self.columns

    def products(self) -> FloatArray:
        """S over the undecided columns."""
        return self.columns.T @ self.columns


@dataclass(frozen=True)
class OpenSubtree:
    """A subtree that a search has left undone; no subset in it has a residual below ``bound``."""

    included: tuple[int, ...]
    undecided: tuple[int, ...]
    bound: float


def propagate(
    constraints: Constraints, included: Sequence[int], undecided: Sequence[int]
) -> tuple[tuple[int, ...], tuple[int, ...]] | None:
    """Carry out what the rules imply; None where no allowed subset is left."""
    if not constraints.active:
        return tuple(included), tuple(undecided)
    inside = np.zeros(constraints.possible.size, dtype=np.bool_)
    alive = inside.copy()
    inside[list(included)] = True
    alive[list(undecided)] = True
    brought = constraints.requires[inside].any(axis=0) & ~inside
    barred = constraints.excludes[inside].any(axis=0)
    if (
        (brought & ~alive).any()
        or ((inside | brought) & barred).any()
        or not constraints.possible[inside].all()
    ):
        return None
    alive &= ~brought & ~barred & constraints.possible
    inside |= brought
    alive &= ~(constraints.requires & ~(inside | alive)[None, :]).any(axis=1)
    order = [*included, *np.flatnonzero(brought)]
    return tuple(int(j) for j in order), tuple(j for j in undecided if alive[j])


def make_piece(frame: Frame, included: tuple[int, ...], undecided: tuple[int, ...]) -> Piece | None:
    """Factorise one piece from the root factor; None where the included columns are dependent."""
    s, u = len(included), len(undecided)
    columns = [*included, *undecided]
    factor = triangle(frame.columns(columns))
    padded = np.zeros((s + u + 1, s + u + 1))
    padded[: factor.shape[0]] = factor
    if dependency(padded[:s, :s], frame.noise[list(included)]):
        return None
    R = padded[s : s + u, s : s + u]
    tail = padded[s + u :, s + u]
    dependent = tuple(undecided[i] for i in dependency(R, frame.noise[list(undecided)]))
    return Piece(
        included, undecided, R, padded[s : s + u, s + u], frame.rss_full + float(tail @ tail), dependent
    )


def make_leaf(frame: Frame, part: OpenSubtree, room: int) -> Leaf | None:
    """The part of the tree with `room` places left as a leaf; None where the included columns are dependent."""
    included = list(part.included)
    basis, factor = np.linalg.qr(frame.R[:, included])
    if dependency(factor, frame.noise[included]):
        return None
    labels = np.array(part.undecided if room else (), dtype=np.int64)
    columns, _ = project_out(basis, frame.R[:, labels])
    z = project_out(basis, frame.z[:, None])[0][:, 0]
    return Leaf(part.included, labels, columns, z, frame.rss_full + float(z @ z))


def independent_pieces(frame: Frame, max_size: int) -> Iterator[Piece | OpenSubtree]:
    """Cut the whole tree into pieces whose undecided columns are independent, and parts that are leaves.

    Leaves are left to be made, once, by who scores them: of dependent columns nearly all parts are leaves.
    """
    dependent = frame.rank < frame.n_candidates
    stack = [OpenSubtree((), tuple(range(frame.n_candidates)), frame.rss_full)]
    while stack:
        part = stack.pop()
        allowed = propagate(frame.constraints, part.included, part.undecided)
        if allowed is None or len(allowed[0]) > max_size:
            continue
        if dependent and max_size - len(allowed[0]) <= CLOSED_FORM:
            yield OpenSubtree(*allowed, part.bound)
            continue
        piece = make_piece(frame, *allowed)
        if piece is None:
            continue
        if piece.singular:
            stack += _cut(piece, max_size)
        else:
            yield piece


def _cut(piece: Piece, max_size: int) -> Iterator[OpenSubtree]:
    """Each part of a singular piece: by the first column of its dependency that is left out.

    What comes before that one is in; parts that would hold more than `max_size` are none.
    """
    involved = piece.dependency
    place = np.full(max(piece.undecided) + 1, len(involved))
    place[list(involved)] = np.arange(len(involved))
    places = place[piece.labels]
    for i in range(min(len(involved), max_size - len(piece.included) + 1)):
        undecided = tuple(piece.labels[places > i].tolist())
        yield OpenSubtree(piece.included + involved[:i], undecided, piece.bound)


class Scored(Protocol):
    """What scoring needs of a node; ``labels`` are the undecided candidates, in the order of all arrays."""

    @property
    def included(self) -> tuple[int, ...]:
        """Candidates already in."""
        ...

    @property
    def labels(self) -> IntArray:
        """Undecided candidates."""
        ...

    @property
    def rss(self) -> float:
        """Residual sum of squares of the included candidates."""
        ...

    def singles(self) -> tuple[FloatArray, FloatArray]:
        """The diagonal of S, and c, over the undecided candidates."""
        ...

    def products(self) -> FloatArray:
        """S over the undecided candidates."""
        ...


class Node(Scored, Protocol):
    """What the tree needs of a node."""

    @property
    def bound(self) -> float:
        """Residual sum of squares with every undecided candidate in."""
        ...

    def rises(self) -> FloatArray:
        """Rise of the bound on dropping each undecided candidate."""
        ...

    def include(self, label: int) -> Node:
        """The node with one more candidate in."""
        ...

    def drop(self, label: int) -> Node:
        """The node with one candidate fewer to decide."""
        ...


@dataclass(slots=True)
class SchurNode:
    """Rank-one steps on full-length arrays: including leaves H alone, dropping S; ``at``: the undecided."""

    piece: Piece
    included: tuple[int, ...]
    at: IntArray
    S: FloatArray
    c: FloatArray
    rss: float
    H: FloatArray
    beta: FloatArray
    bound: float

    @classmethod
    def start(cls, piece: Piece) -> SchurNode:
        """S from R'R and H from the inverse of R, never from the inverse of S."""
        inverse = piece.inverse
        return cls(
            piece, piece.included, np.arange(piece.z.size), piece.R.T @ piece.R, piece.R.T @ piece.z,
            piece.rss, inverse @ inverse.T, inverse @ piece.z, piece.bound,
        )  # fmt: skip

    @property
    def labels(self) -> IntArray:
        """Undecided candidates."""
        return np.asarray(self.piece.labels[self.at])

    def rises(self) -> FloatArray:
        """Rise of the bound on dropping each undecided candidate."""
        return np.asarray(self.beta[self.at] ** 2 / self.H.diagonal()[self.at])

    def singles(self) -> tuple[FloatArray, FloatArray]:
        """The diagonal of S, and c, over the undecided candidates."""
        return self.S.diagonal()[self.at], self.c[self.at]

    def products(self) -> FloatArray:
        """S over the undecided candidates."""
        return self.S[self.at[:, None], self.at]

    def include(self, label: int) -> SchurNode:
        """Rank-one step on S."""
        j = self.piece.position[label]
        row, pivot = self.S[j], self.S[j, j]
        scaled = row / pivot
        return SchurNode(
            self.piece, (*self.included, label), self.at[self.at != j],
            self.S - scaled[:, None] * row, self.c - scaled * self.c[j],
            self.rss - float(self.c[j] ** 2 / pivot), self.H, self.beta, self.bound,
        )  # fmt: skip

    def drop(self, label: int) -> SchurNode:
        """Rank-one step on H."""
        j = self.piece.position[label]
        row, pivot = self.H[j], self.H[j, j]
        scaled = row / pivot
        return SchurNode(
            self.piece, self.included, self.at[self.at != j], self.S, self.c, self.rss,
            self.H - scaled[:, None] * row, self.beta - scaled * self.beta[j],
            self.bound + float(self.beta[j] ** 2 / pivot),
        )  # fmt: skip


@dataclass(frozen=True)
class TriangularNode:
    """The same node by orthogonal steps on R: slower, and right where columns are ill-conditioned."""

    included: tuple[int, ...]
    labels: IntArray
    R: FloatArray
    z: FloatArray
    bound: float

    @classmethod
    def start(cls, piece: Piece) -> TriangularNode:
        """The piece as it stands."""
        return cls(piece.included, piece.labels, piece.R, piece.z, piece.bound)

    @property
    def rss(self) -> float:
        """Residual sum of squares of the included candidates."""
        return self.bound + float(self.z @ self.z)

    def rises(self) -> FloatArray:
        """Rise of the bound on dropping each undecided candidate; zero where the factor is singular."""
        inverse, singular = dtrtri(self.R)
        if singular:
            return np.zeros(self.z.size)
        return np.asarray((inverse @ self.z) ** 2 / np.einsum("ij,ij->i", inverse, inverse))

    def singles(self) -> tuple[FloatArray, FloatArray]:
        """The diagonal of S, and c, over the undecided candidates."""
        return np.einsum("ij,ij->j", self.R, self.R), self.R.T @ self.z

    def products(self) -> FloatArray:
        """S over the undecided candidates."""
        return self.R.T @ self.R

    def include(self, label: int) -> TriangularNode:
        """Rotate the column to the front and strike its row."""
        j, others = self._apart(label)
        factor = self._triangle([j, *others])
        return TriangularNode(
            (*self.included, label), self.labels[others], factor[1:, 1:-1], factor[1:, -1], self.bound
        )

    def drop(self, label: int) -> TriangularNode:
        """Strike the column and triangularise again; the last entry of z goes to the bound."""
        _, others = self._apart(label)
        factor = self._triangle(others)
        bound = self.bound + float(factor[-1, -1] ** 2)
        return TriangularNode(self.included, self.labels[others], factor[:-1, :-1], factor[:-1, -1], bound)

    def _apart(self, label: int) -> tuple[int, list[int]]:
        """Where a candidate stands, and where the others do."""
        j = int((self.labels == label).argmax())
        return j, [*range(j), *range(j + 1, self.z.size)]

    def _triangle(self, columns: list[int]) -> FloatArray:
        """Triangular factor of these columns and z after them."""
        both = np.empty((self.z.size, len(columns) + 1))
        both[:, :-1], both[:, -1] = self.R[:, columns], self.z
        return triangle(both)


# ---- The include/drop tree in plain numpy: no compiler to wait for, enough for the problems of every day ----


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
        relaxed = needed - abs(needed) * (self._board.margin + DETERMINANT_SLACK)
        S = node.products()
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

    def _offer(self, node: Scored, extra: IntArray) -> None:
        for labels in node.labels[extra].tolist():
            self._board.offer((*node.included, *labels))


def _drop_all(node: Node, labels: set[int]) -> Node:
    for label in sorted(labels):
        node = node.drop(label)
    return node
