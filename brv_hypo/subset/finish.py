"""From candidate positions on the board to fitted subsets with their criteria."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from brv_hypo.arrays import FloatArray
from brv_hypo.errors import UsageError
from brv_hypo.subset.board import Board
from brv_hypo.subset.criteria import Reference, contiguous_blocks, evaluate, point_values
from brv_hypo.subset.fit import LeastSquares, least_squares
from brv_hypo.subset.frame import Frame, dependencies
from brv_hypo.subset.result import Certificate, Subset, SubsetResult


class Finisher:
    """Fits subsets of one frame in extended precision and evaluates their criteria."""

    def __init__(self, frame: Frame, held_out_blocks: int | ArrayLike, point: ArrayLike | None) -> None:
        self._frame = frame
        n, p = frame.X.shape
        self._point = None if point is None else np.asarray(point, dtype=np.float64)
        if self._point is not None and self._point.shape != (p,):
            raise UsageError(f"point has shape {self._point.shape}; expected ({p},): a value for every column of X")
        self._blocks = (
            contiguous_blocks(n, held_out_blocks)
            if isinstance(held_out_blocks, int)
            else np.unique(np.asarray(held_out_blocks), return_inverse=True)[1]
        )
        if self._blocks.shape != (n,):
            raise UsageError(
                f"held_out_blocks has shape {self._blocks.shape}; expected {n} labels or a number"
            )

    def subset(self, columns: tuple[int, ...]) -> Subset:
        """Fit the forced columns and these columns of X."""
        terms = self._frame.forced + tuple(sorted(columns))
        fit = self._fit(terms)
        at_point = None if self._point is None else point_values(terms, fit, self._frame.X, self._point)
        criteria = evaluate(fit, self._reference, at_point)
        return Subset(
            columns=tuple(sorted(columns)), rss=fit.rss, terms=terms, coefficients=fit.coefficients,
            std_errors=np.sqrt(criteria.adjusted_rss * fit.inverse_diagonal), criteria=criteria,
        )  # fmt: skip

    def press(self, columns: tuple[int, ...]) -> float:
        """PRESS of the forced columns and these, in double precision."""
        Q = np.linalg.qr(self._doubles[:, list(self._frame.forced + columns)])[0]
        e = self._target - Q @ (Q.T @ self._target)
        left = 1.0 - np.einsum("ij,ij->i", Q, Q)
        return float(np.sum((e / left) ** 2)) if left.min() > 1e-12 else float("nan")

    @cached_property
    def least_forced_leverage(self) -> float:
        """Least leverage of the forced columns alone, rounded down; no row has less in any subset."""
        Q = np.linalg.qr(self._doubles[:, list(self._frame.forced)])[0]
        return max(0.0, float(np.einsum("ij,ij->i", Q, Q).min()) - 1e-9)

    @cached_property
    def _doubles(self) -> FloatArray:
        return self._frame.X.astype(np.float64)

    @cached_property
    def _target(self) -> FloatArray:
        return self._frame.y.astype(np.float64)

    def result(self, board: Board, certificate: Certificate) -> SubsetResult:
        """All subsets on the board, fitted."""
        subsets = tuple(self.subset(columns) for _, columns in board.chosen())
        frame = self._frame
        return SubsetResult(subsets, certificate, frame.aliases, self.subset(()), refused=frame.refused)

    def _fit(self, terms: tuple[int, ...], *, variances: bool = True) -> LeastSquares:
        return least_squares(self._frame.X[:, list(terms)], self._frame.y, variances=variances)

    @cached_property
    def _reference(self) -> Reference:
        frame = self._frame
        every = frame.forced + tuple(int(c) for c in frame.candidates[dependencies(frame.R, frame.noise)[0]])
        complete = self._fit(every, variances=False)
        at_point = (
            (None, None) if self._point is None else point_values(every, complete, frame.X, self._point)
        )
        return Reference(
            self._fit(frame.forced).rss, len(frame.forced), complete, len(every), self._blocks, *at_point
        )
