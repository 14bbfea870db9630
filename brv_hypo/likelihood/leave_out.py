"""The estimate without some of the samples, or of others, from the linearisation at the estimate.

At the solution the whitened residual is r + A dtheta + G da, a the initial state of each segment, the other
states following both by the dynamics. Without some rows the minimum moves by

    dtheta = -(A' A + P)^-1 (A' r + P (theta - mean)),    A, r with G projected out, rows left out, P of priors

which is one Gauss-Newton step: exact for a linear model, and good where the rows are a small part. Where r gains
something, so does the minimum: by the same of that alone.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from brv_hypo.arrays import BoolArray, FloatArray, IntArray
from brv_hypo.errors import UsageError


@dataclass(frozen=True)
class LinearRows:
    """One segment at the solution: whitened residual r (n, n_outputs), its derivative A by its own parameters
    (n, n_outputs, p) and G by the free part of its initial state (n, n_outputs, free).

    `index` (p,) are the places of the parameters among the fit's; `known` (free,) the inverse of the prior
    standard deviation of the initial state and `strayed` (free,) how many of them it lies from its mean.
    """

    residual: FloatArray
    by_parameter: FloatArray
    by_start: FloatArray
    index: IntArray
    known: FloatArray
    strayed: FloatArray


@dataclass(frozen=True)
class Linearised:
    """The fit's linear model at its solution, for `theta_without` and `change_by`.

    `precision` (p,) is the inverse variance of the priors, `away` (p,) the estimate less their means,
    `estimated` the parameters that are free and not at a bound.
    """

    rows: tuple[LinearRows, ...]
    precision: FloatArray
    away: FloatArray
    estimated: IntArray

    def change_without(self, left_out: Sequence[BoolArray]) -> FloatArray:
        """Change of the parameters (p,) where the marked samples, (n,) a segment, take no part.

        Raises:
            UsageError: masks that do not fit the segments.
        """
        sizes = [rows.residual.shape[0] for rows in self.rows]
        if [mask.size for mask in left_out] != sizes:
            raise UsageError(
                f"the samples left out are marked by arrays of {[m.size for m in left_out]}; expected {sizes}, "
                "one mark a sample of each segment"
            )
        kept = (
            _projected(rows, ~mask, rows.residual[~mask], rows.strayed)
            for rows, mask in zip(self.rows, left_out, strict=True)
        )
        return self._step(kept, self.precision * self.away)

    def change_by(self, gained: Sequence[FloatArray]) -> FloatArray:
        """Change of the parameters (p,) where the whitened residual gains so much, (n, n_outputs) a segment."""
        every = (
            _projected(rows, np.ones(rows.residual.shape[0], dtype=np.bool_), gain, np.zeros_like(rows.strayed))
            for rows, gain in zip(self.rows, gained, strict=True)
        )
        return self._step(every, np.zeros_like(self.away))

    def _step(self, segments: Iterable[tuple[FloatArray, FloatArray]], pull: FloatArray) -> FloatArray:
        """The Gauss-Newton step (p,) of derivatives (rows, p) and residuals (rows,) of each segment, and of priors."""
        normal = np.diag(self.precision)
        for rows, (own, residual) in zip(self.rows, segments, strict=True):
            normal[np.ix_(rows.index, rows.index)] += own.T @ own
            pull[rows.index] += own.T @ residual
        free = np.ix_(self.estimated, self.estimated)
        size = np.sqrt(np.maximum(np.diag(normal)[self.estimated], 1e-300))
        scaled = np.linalg.pinv(normal[free] / np.outer(size, size), rcond=1e-12, hermitian=True)
        change = np.zeros(self.away.size)
        change[self.estimated] = -(scaled @ (pull[self.estimated] / size)) / size
        return change


def _projected(
    rows: LinearRows, kept: BoolArray, residual: FloatArray, strayed: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Derivatives (rows, p) and `residual` (kept, n_outputs) of the samples kept, the initial state projected out."""
    p, free = rows.by_parameter.shape[2], rows.by_start.shape[2]
    count = int(np.count_nonzero(kept)) * rows.residual.shape[1]
    own = np.concatenate([rows.by_parameter[kept].reshape(count, p), np.zeros((free, p))])
    residual = np.concatenate([residual.reshape(-1), strayed])
    start = np.concatenate([rows.by_start[kept].reshape(count, free), np.diag(rows.known)])
    basis = np.linalg.qr(start)[0]
    return own - basis @ (basis.T @ own), residual - basis @ (basis.T @ residual)
