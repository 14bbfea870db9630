"""Pieces of the search tree: what is in, what is undecided, and the factor to start from.

The fast kernels need the undecided columns to be independent. Where they are not, the tree is cut along the
dependency: a subset of full rank leaves out at least one of the columns that take part in it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg.lapack import dtrtrs

from brv_hypo.arrays import FloatArray, IntArray
from brv_hypo.subset.constraints import Constraints
from brv_hypo.subset.frame import EPS, Frame, dependency, triangle


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
    factor = triangle(np.column_stack([frame.R[:, columns], frame.z]))
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


def independent_pieces(frame: Frame, max_size: int) -> Iterator[Piece]:
    """Cut the whole tree into pieces whose undecided columns are independent.

    A piece with two places left or fewer is passed on as it is: pairs are scored without the inverse.
    """
    stack: list[tuple[tuple[int, ...], tuple[int, ...]]] = [((), tuple(range(frame.n_candidates)))]
    while stack:
        allowed = propagate(frame.constraints, *stack.pop())
        if allowed is None or len(allowed[0]) > max_size:
            continue
        piece = make_piece(frame, *allowed)
        if piece is None:
            continue
        if not piece.singular or max_size - len(piece.included) <= 2:
            yield piece
            continue
        stack += _cut(piece, max_size)


def _cut(piece: Piece, max_size: int) -> Iterator[tuple[tuple[int, ...], tuple[int, ...]]]:
    """Included and undecided of each part of a singular piece: the first column of its dependency that is left out.

    What comes before that one is in; parts that would hold more than `max_size` are none.
    """
    involved = piece.dependency
    place = np.full(max(piece.undecided) + 1, len(involved))
    place[list(involved)] = np.arange(len(involved))
    places = place[piece.labels]
    for i in range(min(len(involved), max_size - len(piece.included) + 1)):
        yield piece.included + involved[:i], tuple(piece.labels[places > i].tolist())
