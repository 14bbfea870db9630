"""``best_subsets``: the entrance to the exact search."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from numpy.typing import ArrayLike

from brv_hypo.errors import UsageError
from brv_hypo.subset.board import Board, Chosen
from brv_hypo.subset.constraints import Groups, Parents
from brv_hypo.subset.enumeration import best_press, near_ties
from brv_hypo.subset.finish import Finisher
from brv_hypo.subset.frame import build_frame
from brv_hypo.subset.heuristics import seed_board
from brv_hypo.subset.result import SubsetResult
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
    *,
    held_out_blocks: int | ArrayLike = 5,
    point: ArrayLike | None = None,
    kernel: str = "auto",
    near_tie_window: float | None = None,
    certify_press: bool = False,
    enumeration_limit: int = 5000,
    progress: Callable[[float, int], None] | None = None,
    inform: Callable[[str], None] | None = None,
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
    held_out_blocks: number of contiguous blocks of rows, or a label per row, for the held-out error.
    point (p,): where Allen's prediction error is wanted; None averages over the rows.
    kernel: ``auto``, or one of ``numpy-schur``, ``numpy-givens``, ``numba-schur``, ``numba-givens``.
    near_tie_window: also list all subsets this close to the best of their size; 0.001 for 0.1 %.
    certify_press: also find the subset of least PRESS of every size, with proof.
    enumeration_limit: most subsets of one size that either of these looks at.
    progress: called with (fraction of the tree done, nodes visited) now and then.
    inform: called with one sentence where the compiled kernel has to be loaded or compiled.

    Subsets whose columns are linearly dependent, or so nearly that rounding would decide their coefficients, are not
    returned; ``aliases`` and ``refused`` name them. Raises UsageError on unfit input.

    Method: branch and bound over includes and drops after Furnival and Wilson, Technometrics 16 (1974) 499,
    on Schur complements, branching at every drop on the largest rise of the bound.
    """
    effort = Effort(kernel, threads, time_limit_s, progress, inform)
    _refuse_nonsense(max_terms, n_best, threads)
    frame = build_frame(X, y, forced, weights, groups, parents)
    finisher = Finisher(frame, held_out_blocks, point)
    board = Board(frame, min(max_terms, frame.rank), n_best)
    seed_board(board)
    result = finisher.result(board, search(board, effort))
    if near_tie_window is not None:
        ties = near_ties(frame, board, near_tie_window, enumeration_limit, effort)
        result = replace(result, near_ties=ties)
    if certify_press:
        result = replace(result, press=best_press(frame, board, finisher, enumeration_limit, effort))
    return result


def best_columns(
    X: ArrayLike,
    y: ArrayLike,
    max_terms: int = 10,
    forced: Sequence[int] = (0,),
    n_best: int = 1,
    groups: Groups | None = None,
) -> tuple[Chosen, ...]:
    """The subsets of ``best_subsets``, proved like them but not fitted: residual sums of squares and columns alone."""
    _refuse_nonsense(max_terms, n_best)
    frame = build_frame(X, y, forced, None, groups, None)
    board = Board(frame, min(max_terms, frame.rank), n_best)
    seed_board(board)
    search(board, Effort())
    return board.chosen()


def _refuse_nonsense(max_terms: int, n_best: int, threads: int = 1) -> None:
    if max_terms < 0 or n_best < 1 or threads < 1:
        raise UsageError(
            f"got max_terms={max_terms}, n_best={n_best}, threads={threads}; expected max_terms >= 0 and the "
            "others >= 1"
        )
