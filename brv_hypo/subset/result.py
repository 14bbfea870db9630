"""What a search returns: fitted subsets, their certificate, what was set aside.

`fitted_result` turns the incumbents, positions among the candidates, into subsets with coefficients and criteria.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.results import Row, Tabular
from brv_hypo.subset.criteria import Criteria, Reference, contiguous_blocks, evaluate, least_squares
from brv_hypo.subset.frame import Alias, Refusal, dependencies
from brv_hypo.subset.incumbents import Board

# Contiguous blocks of rows for the held-out error.
HELD_OUT_BLOCKS = 5


@dataclass(frozen=True)
class Subset:
    """One subset and its fit."""

    columns: tuple[int, ...]
    """Chosen columns of X, ascending, without the forced ones."""
    rss: float
    """Residual sum of squares."""
    terms: tuple[int, ...]
    """The forced columns, then the chosen ones."""
    coefficients: FloatArray
    """Of `terms`, in their order."""
    std_errors: FloatArray
    """Ordinary ones, from RSS / (n - p), in the order of `terms`."""
    criteria: Criteria
    """The selection criteria."""

    @property
    def size(self) -> int:
        """Number of chosen columns."""
        return len(self.columns)


@dataclass(frozen=True)
class Certificate:
    """What the search has proved."""

    exact: bool
    """No allowed subset of a returned size beats the returned ones."""
    nodes: int
    """Nodes visited."""
    margin: float
    """Relative allowance for rounding with which branches were cut."""
    gap: float
    """The largest of `gaps`."""
    gaps: tuple[float, ...]
    """By how much, relatively, the RSS of size 1, 2, ... may still be too high; 0 where that size is proved."""
    seconds: float
    """Wall-clock time."""
    kernel: str
    """``numpy``, ``numba-schur`` or ``numba-givens``: the last that was used."""
    condition: float
    """Condition number of the scaled candidates."""
    status: str
    """How it ended, in words."""


@dataclass(frozen=True)
class SubsetResult(Tabular):
    """Subsets by size, then by residual sum of squares."""

    subsets: tuple[Subset, ...]
    """The best of every size."""
    certificate: Certificate
    """What was proved of them."""
    aliases: tuple[Alias, ...]
    """Columns that equal a combination of others.

    Multiples of one column, and of forced ones, are not searched unless a rule names them, and stand-ins of the same
    span can be read off here; of the columns of a longer combination no subset holds all.
    """
    baseline: Subset
    """The forced model alone."""
    refused: tuple[Refusal, ...] = ()
    """Columns so near to dependence that no subset holds them together either, with the reason."""

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


def fitted_result(board: Board, certificate: Certificate) -> SubsetResult:
    """All subsets on the board, fitted in extended precision, with their criteria."""
    frame = board.frame
    independent = frame.candidates[dependencies(frame.R, frame.noise)[0]]
    reference = Reference(
        rss_forced=least_squares(frame.X[:, list(frame.forced)], frame.y).rss,
        n_forced=len(frame.forced),
        complete=least_squares(frame.X[:, [*frame.forced, *independent]], frame.y, variances=False),
        blocks=contiguous_blocks(frame.y.size, HELD_OUT_BLOCKS),
    )

    def fitted(columns: tuple[int, ...]) -> Subset:
        terms = frame.forced + columns
        fit = least_squares(frame.X[:, list(terms)], frame.y)
        criteria = evaluate(fit, reference)
        return Subset(
            columns=columns, rss=fit.rss, terms=terms, coefficients=fit.coefficients,
            std_errors=np.sqrt(criteria.adjusted_rss * fit.inverse_diagonal), criteria=criteria,
        )  # fmt: skip

    return SubsetResult(
        subsets=tuple(fitted(columns) for _, columns in board.chosen()),
        certificate=certificate,
        aliases=frame.aliases,
        baseline=fitted(()),
        refused=frame.refused,
    )
