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
from brv_hypo.subset.frame import RANK_TOLERANCE, Frame
from brv_hypo.subset.result import Certificate, Subset, SubsetResult


class Finisher:
    """Fits subsets of one frame in extended precision and evaluates their criteria."""

    def __init__(self, frame: Frame, held_out_blocks: int | ArrayLike, point: FloatArray | None) -> None:
        self._frame = frame
        n, p = frame.X.shape
        if point is not None and point.shape != (p,):
            raise UsageError(f"point has shape {point.shape}; expected ({p},): a value for every column of X")
        self._point = point
        self._blocks = (
            contiguous_blocks(n, held_out_blocks)
            if isinstance(held_out_blocks, int)
            else np.asarray(held_out_blocks)
        )
        if self._blocks.shape != (n,):
            raise UsageError(f"held_out_blocks has shape {self._blocks.shape}; expected {n} labels or a number")

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

    def result(self, board: Board, certificate: Certificate) -> SubsetResult:
        """All subsets on the board, fitted."""
        candidates = self._frame.candidates
        subsets = tuple(
            self.subset(tuple(int(c) for c in candidates[list(positions)]))
            for size in range(1, board.max_size + 1)
            for _, positions in board.rows(size)
        )
        return SubsetResult(subsets, certificate, self._frame.aliases, self.subset(()))

    def _fit(self, terms: tuple[int, ...]) -> LeastSquares:
        return least_squares(self._frame.X[:, list(terms)], self._frame.y)

    @cached_property
    def _reference(self) -> Reference:
        frame = self._frame
        every = frame.forced + tuple(int(c) for c in frame.candidates[_independent(frame)])
        complete = self._fit(every)
        at_point = (None, None) if self._point is None else point_values(every, complete, frame.X, self._point)
        return Reference(
            self._fit(frame.forced).rss, len(frame.forced), complete, len(every), self._blocks, *at_point
        )


def _independent(frame: Frame) -> list[int]:
    """Candidates that span all of them, the first of each dependency kept."""
    if frame.rank == frame.n_candidates:
        return list(range(frame.n_candidates))
    kept: list[int] = []
    basis = np.empty((frame.R.shape[0], 0))
    for j in range(frame.n_candidates):
        rest = frame.R[:, j] - basis @ (basis.T @ frame.R[:, j])
        rest -= basis @ (basis.T @ rest)
        norm = np.linalg.norm(rest)
        if norm > 10.0 * RANK_TOLERANCE:
            kept.append(j)
            basis = np.column_stack([basis, rest / norm])
    return kept
