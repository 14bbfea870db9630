"""The least-squares problem of one hypothesis with nuisances and baseline projected out.

A column is kept as its own rows and its coordinates in what is projected out; Gram matrices of many columns come
from both without a row of the projection itself. The baseline's coefficients follow in the end.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from brv_hypo.arrays import FloatArray, IntArray
from brv_hypo.inference.bordered import Stretch
from brv_hypo.inference.problem import Problem, ProjectedBaseline
from brv_hypo.linearisation.frame import RateFrame
from brv_hypo.linearisation.linear import solve_normal
from brv_hypo.model.term import Regressor

_SPENT = 1e-10  # share of its length below which what is left of a column is rounding


@dataclass(frozen=True)
class Batch:
    """Whitened columns: the rows that they have (m, columns), and coordinates in what is projected out. `inside`
    (unknowns + rank of the baseline, columns): the nuisances first.
    """

    rows: FloatArray
    inside: FloatArray

    def of(self, chosen: Sequence[int] | IntArray | slice) -> Batch:
        """Some of the columns."""
        return Batch(self.rows[:, chosen], self.inside[:, chosen])

    def with_columns(self, places: Sequence[int], others: Batch) -> Batch:
        """The batch with other columns in these places."""
        own = (self.rows.copy(), self.inside.copy())
        for mine, theirs in zip(own, (others.rows, others.inside), strict=True):
            mine[: theirs.shape[0], places] = theirs
        return Batch(*own)

    def products(self, others: Batch) -> FloatArray:
        """Scalar products with the columns of another batch, both projected (columns, columns)."""
        m = min(self.rows.shape[0], others.rows.shape[0])
        return np.asarray(self.rows[:m].T @ others.rows[:m] - self.inside.T @ others.inside, dtype=float)

    @cached_property
    def squares(self) -> FloatArray:
        """Squared length of each column before the projection (columns,)."""
        return np.asarray(np.einsum("ij,ij->j", self.rows, self.rows), dtype=float)


@dataclass(frozen=True)
class Fitted:
    """Normal equations of a batch, its coefficients (columns,) and the residual sum of squares."""

    products: FloatArray
    right: FloatArray
    values: FloatArray
    rss: float


@dataclass(frozen=True)
class Reduced:
    """A problem as the columns of one frame see it."""

    problem: Problem
    frame: RateFrame

    @cached_property
    def left(self) -> FloatArray:
        """What the baseline leaves of the response (rows,)."""
        return self._baseline.left

    @cached_property
    def rss(self) -> float:
        """Residual sum of squares of the baseline alone."""
        return float(self.left @ self.left)

    @cached_property
    def _baseline(self) -> ProjectedBaseline:
        return self.problem.projected_baseline(self.frame)

    def batch(self, columns: Sequence[Regressor]) -> Batch:
        """Columns, whitened."""
        return self.batch_of(self.problem.own_rows(self.frame, columns))

    def batch_of(self, rows: FloatArray) -> Batch:
        """Whitened rows (m, columns)."""
        inside = self._baseline.basis[: rows.shape[0]].T @ rows
        return Batch(rows, np.concatenate([self.problem.rows.basis.coordinates(rows), inside]))

    def right(self, batch: Batch) -> FloatArray:
        """Scalar products of the columns with the response (columns,)."""
        return np.asarray(batch.rows.T @ self.left[: batch.rows.shape[0]], dtype=float)

    def fit(self, batch: Batch) -> Fitted:
        """Least squares."""
        products, right = batch.products(batch), self.right(batch)
        values = solve_normal(products, right, batch.squares)
        return Fitted(products, right, values, self.rss - float(right @ values))

    def _projected(self, batch: Batch, stretch: Stretch) -> FloatArray:
        """Rows of a stretch of the columns with nuisances and baseline projected out (rows, columns)."""
        basis, inside = self.problem.rows.basis, stretch.rows
        out = basis.at(stretch, -batch.inside[: basis.size])
        out -= self._baseline.basis[inside] @ batch.inside[basis.size :]
        own = batch.rows[inside]
        out[: own.shape[0]] += own
        return out

    def triangle(self, batch: Batch) -> FloatArray:
        """Triangular factor of the projected columns and the response after them, a stretch of rows at a time."""
        factor: FloatArray = np.zeros((0, batch.rows.shape[1] + 1))
        for stretch in self.problem.rows.basis.stretches:
            block = np.column_stack([self._projected(batch, stretch), self.left[stretch.rows]])
            factor = np.asarray(np.linalg.qr(np.concatenate([factor, block]), mode="r"), dtype=float)
        return factor

    def spent(self, batch: Batch, triangle: FloatArray) -> IntArray:
        """Columns that baseline and nuisances leave nothing of, by their lengths in the triangular factor."""
        return np.flatnonzero(np.linalg.norm(triangle[:, :-1], axis=0) <= _SPENT * np.sqrt(batch.squares))

    def residual(self, batch: Batch, values: FloatArray) -> FloatArray:
        """Whitened residual (rows,)."""
        weights, out = values[:, np.newaxis], self.left.copy()
        made = Batch(batch.rows @ weights, batch.inside @ weights)
        for stretch in self.problem.rows.basis.stretches:
            out[stretch.rows] -= self._projected(made, stretch)[:, 0]
        return out

    def with_baseline(self, batch: Batch, values: FloatArray) -> FloatArray:
        """The baseline's coefficients that go with those of the columns, and these after them."""
        found = self._baseline
        inside = batch.inside[self.problem.rows.basis.size :]
        own = found.coefficients @ (found.basis.T @ self.problem.response - inside @ values)
        return np.concatenate([own, values])
