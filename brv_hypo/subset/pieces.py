"""Pieces of the search tree: what is in, what is undecided, and the factor to start from.

The fast kernels need the undecided columns to be independent. Where they are not, the tree is cut along the
dependency: a subset of full rank leaves out at least one of the columns that take part in it. Parts with two places
left or fewer are leaves: pairs are scored without the inverse, whatever depends on what.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg.lapack import dtrtrs

from brv_hypo.arrays import FloatArray, IntArray
from brv_hypo.subset.constraints import Constraints
from brv_hypo.subset.frame import EPS, Frame, dependency, project_out, triangle

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
