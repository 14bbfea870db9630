"""The entrances to the exact search: `best_subsets`, and `best_columns` without the fits."""

from __future__ import annotations

from collections.abc import Sequence

from numpy.typing import ArrayLike

from brv_hypo.errors import UsageError
from brv_hypo.subset.frame import Groups, Parents, build_frame
from brv_hypo.subset.incumbents import Board, Chosen, seed_board
from brv_hypo.subset.result import SubsetResult, fitted_result
from brv_hypo.subset.search import Effort, search


def best_subsets(
    X: ArrayLike,
    y: ArrayLike,
    max_terms: int = 10,
    forced: Sequence[int] = (0,),
    n_best: int = 1,
    groups: Groups | None = None,
    parents: Parents | None = None,
    weights: ArrayLike | None = None,
    time_limit_s: float | None = None,
    threads: int = 1,
) -> SubsetResult:
    """The ``n_best`` subsets of least residual sum of squares, of every size 1..max_terms, proved best.

    X (n, p) and y (n,) in any units; several channels go in as one frame, stacked and whitened. Column
    indices everywhere are those of X.

    forced: columns in every subset (column 0, the constant, by default; ``()`` for none), not counted in
        the size. A column that is a combination of forced ones is set aside and listed in ``aliases``.
    groups: ``together(...)`` and ``at_most_one(...)``; a plain sequence of columns means together. The size
        of a subset counts columns, so a group of two enters from size 2 on.
    parents: column to the column or columns that must be in whenever it is.
    weights (n,): row weights >= 0 of the squares; residuals and criteria are those of the weighted rows.
    time_limit_s: seconds after which the best found so far is returned with the gap proved; None: no limit.
    threads: worker threads of the compiled kernel; small searches stay serial.

    Subsets whose columns are linearly dependent, or so nearly that rounding would decide their coefficients, are not
    returned; ``aliases`` and ``refused`` name them. Raises UsageError on unfit input.

    Method: branch and bound over includes and drops after Furnival and Wilson, Technometrics 16 (1974) 499,
    branching at every drop on the largest rise of the bound.
    """
    effort = Effort(threads=threads, time_limit_s=time_limit_s)
    board = _seeded(X, y, max_terms, forced, n_best, groups, parents, weights)
    return fitted_result(board, search(board, effort))


def best_columns(
    X: ArrayLike,
    y: ArrayLike,
    max_terms: int = 10,
    forced: Sequence[int] = (0,),
    n_best: int = 1,
    groups: Groups | None = None,
) -> tuple[Chosen, ...]:
    """The subsets of ``best_subsets``, proved like them but not fitted: residual sums of squares and columns alone."""
    board = _seeded(X, y, max_terms, forced, n_best, groups)
    search(board, Effort())
    return board.chosen()


def _seeded(
    X: ArrayLike,
    y: ArrayLike,
    max_terms: int,
    forced: Sequence[int],
    n_best: int,
    groups: Groups | None,
    parents: Parents | None = None,
    weights: ArrayLike | None = None,
) -> Board:
    """The problem with good subsets of every size to start from."""
    if max_terms < 0 or n_best < 1:
        raise UsageError(f"got max_terms={max_terms}, n_best={n_best}; expected max_terms >= 0 and n_best >= 1")
    board = Board(build_frame(X, y, forced, weights, groups, parents), max_terms, n_best)
    seed_board(board)
    return board
