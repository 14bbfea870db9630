"""Nodes of the include/drop tree in numpy: one through Schur complements, one through triangular factors.

Dropping column j raises the bound (the residual with all undecided columns in) by beta_j^2 / H_jj, where
S is the Schur complement of the undecided columns given the included ones, H = S^-1 and beta = H c.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.linalg.lapack import dtrtri

from brv_hypo.arrays import FloatArray, IntArray
from brv_hypo.subset.frame import triangle
from brv_hypo.subset.pieces import Piece


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
