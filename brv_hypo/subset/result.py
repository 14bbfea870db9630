"""What a search returns: fitted subsets, their certificate, what was set aside.

`Finisher` turns incumbents, positions among the searched columns, into fitted subsets with coefficients and criteria.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from brv_hypo.arrays import FloatArray
from brv_hypo.errors import UsageError
from brv_hypo.results import Row, Tabular
from brv_hypo.subset.criteria import (
    Criteria,
    LeastSquares,
    Reference,
    contiguous_blocks,
    evaluate,
    least_squares,
    point_values,
)
from brv_hypo.subset.frame import Alias, Frame, Refusal, dependencies
from brv_hypo.subset.incumbents import Board

# ---- What a search returns: subsets, their certificate, what was set aside ----


@dataclass(frozen=True)
class Subset:
    """One subset and its fit.

    ``columns``: chosen columns of X, ascending, without the forced ones. ``terms``: the forced columns,
    then the chosen ones; ``coefficients`` and ``std_errors`` (ordinary, from RSS / (n - p)) follow its order.
    """

    columns: tuple[int, ...]
    rss: float
    terms: tuple[int, ...]
    coefficients: FloatArray
    std_errors: FloatArray
    criteria: Criteria

    @property
    def size(self) -> int:
        """Number of chosen columns."""
        return len(self.columns)


@dataclass(frozen=True)
class Certificate:
    """What the search has proved.

    ``exact``: no allowed subset of a returned size beats the returned ones. ``gaps``: where the time limit
    struck, by how much, relatively, the RSS of size 1, 2, ... may still be too high (0.0 where that size is
    proved); ``gap`` is the largest. ``margin``: relative allowance for rounding with which branches were
    cut. ``nodes``: nodes visited. ``kernel``: ``numpy`` or ``numba``, ``schur`` or ``givens``. ``condition``:
    of the scaled candidates. ``status`` says in words how it ended.
    """

    exact: bool
    nodes: int
    margin: float
    gap: float
    gaps: tuple[float, ...]
    seconds: float
    kernel: str
    condition: float
    status: str


@dataclass(frozen=True)
class NearOptimal:
    """All subsets of one size within the window of the best, best first; ``complete``: no more of them."""

    size: int
    columns: tuple[tuple[int, ...], ...]
    rss: tuple[float, ...]
    complete: bool


@dataclass(frozen=True)
class PressBest:
    """The subset of least PRESS of one size, out of ``compared`` subsets.

    ``exact``: no other subset of the size has a lower one; else none is lower by more than ``gap``,
    relatively.
    """

    size: int
    columns: tuple[int, ...]
    press: float
    exact: bool
    gap: float
    compared: int


@dataclass(frozen=True)
class SubsetResult(Tabular):
    """Subsets by size, then by residual sum of squares.

    ``baseline`` is the forced model alone. ``aliases`` lists columns that equal a combination of others;
    multiples of one column, and of forced ones, are not searched unless a rule names them, and stand-ins of the
    same span can be read off here; of the columns of a longer combination no subset holds all. ``refused`` lists
    columns so near to dependence that no subset holds them together either, with the reason.
    ``near_optimal`` and ``press`` are filled where they were asked for.
    """

    subsets: tuple[Subset, ...]
    certificate: Certificate
    aliases: tuple[Alias, ...]
    baseline: Subset
    near_optimal: tuple[NearOptimal, ...] = ()
    press: tuple[PressBest, ...] = ()
    refused: tuple[Refusal, ...] = ()

    __repr__ = Tabular.__repr__
    __eq__ = Tabular.__eq__

    def headline(self) -> str:
        """How many subsets, and whether they are certainly the best."""
        proof = "exact" if self.certificate.exact else f"gap {self.certificate.gap:.3g}"
        return f"{len(self.subsets)} subsets, {proof}, {self.certificate.nodes} nodes"

    def rows(self) -> Sequence[Row]:
        """One row for each subset."""
        return [{"size": s.size, "columns": s.columns, "rss": s.rss} for s in self.subsets]

    def best(self, size: int) -> Subset:
        """The best subset of a size; KeyError where the search has none."""
        for subset in self.subsets:
            if subset.size == size:
                return subset
        sizes = sorted({s.size for s in self.subsets})
        raise KeyError(f"no subset of {size} columns: the search returned sizes {sizes}")

    def of_size(self, size: int) -> tuple[Subset, ...]:
        """All subsets returned of a size, best first."""
        return tuple(s for s in self.subsets if s.size == size)


# ---- From candidate positions on the board to fitted subsets with their criteria ----


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
