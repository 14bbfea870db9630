"""The entrances to the exact search: ``best_subsets``, and ``best_columns`` without the fits.

Near-optimal subsets, and the certified minimum of PRESS, come from a second search for all subsets below a residual.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from brv_hypo.arrays import FloatArray
from brv_hypo.errors import UsageError
from brv_hypo.subset.frame import Frame, Groups, Parents, build_frame
from brv_hypo.subset.heuristics import seed_board
from brv_hypo.subset.incumbents import CLOSED, Board, Chosen
from brv_hypo.subset.result import Finisher, NearOptimal, PressBest, SubsetResult
from brv_hypo.subset.search import Effort, search

# ---- All subsets below a residual: near-ties of the best, and the certified minimum of PRESS ----


@dataclass(frozen=True)
class _Below:
    """Subsets of each size below a ceiling; ``complete[size]`` where all of them are there."""

    board: Board
    complete: tuple[bool, ...]
    finished: bool


def near_optimal(frame: Frame, best: Board, window: float, limit: int, effort: Effort) -> tuple[NearOptimal, ...]:
    """All subsets whose RSS is within ``window`` (relative) of the best of their size, ``limit`` at most."""
    ceiling = np.full(best.max_size + 1, CLOSED)
    for size in range(1, best.max_size + 1):
        if best.rows(size):
            ceiling[size] = best.rows(size)[0][0] * (1.0 + window)
    below = _enumerate(frame, best, ceiling, limit, effort)
    return tuple(
        NearOptimal(
            size,
            tuple(_columns(frame, key) for _, key in below.board.rows(size)),
            tuple(rss for rss, _ in below.board.rows(size)),
            below.complete[size],
        )
        for size in range(1, best.max_size + 1)
        if below.board.rows(size)
    )


def best_press(
    frame: Frame, best: Board, finisher: Finisher, limit: int, effort: Effort
) -> tuple[PressBest, ...]:
    """The subset of least PRESS of every size, with proof.

    PRESS sums e^2 / (1 - h)^2, and no leverage is below that of the forced columns: PRESS >= RSS / (1 -
    h_0)^2 with h_0 the least of these. So only subsets with RSS <= (1 - h_0)^2 times the best PRESS known can
    beat it.
    """
    factor = (1.0 - finisher.least_forced_leverage) ** 2
    known = {
        size: float(
            np.nanmin([*(finisher.press(_columns(frame, key)) for _, key in best.rows(size)), np.inf])
        )
        for size in range(1, best.max_size + 1)
        if best.rows(size)
    }
    ceiling = np.full(best.max_size + 1, CLOSED)
    for size, value in known.items():
        ceiling[size] = min(value * factor, 1.01 * frame.rss_forced) if np.isfinite(value) else CLOSED
    below = _enumerate(frame, best, ceiling, limit, effort)
    answers = []
    for size in known:
        rows = below.board.rows(size) or best.rows(size)
        values = [finisher.press(_columns(frame, key)) for _, key in rows]
        least = int(np.nanargmin(values)) if np.isfinite(values).any() else 0
        # Subsets not looked at have no less than the last RSS listed, or nothing is known if time ran out.
        others = rows[-1][0] / factor if below.finished else 0.0
        exact = bool(np.isfinite(values[least]) and (below.complete[size] or others >= values[least]))
        gap = 0.0 if exact else 1.0 - others / values[least]
        answers.append(PressBest(size, _columns(frame, rows[least][1]), values[least], exact, gap, len(rows)))
    return tuple(answers)


def _enumerate(
    frame: Frame,
    best: Board,
    ceiling: FloatArray,
    limit: int,
    effort: Effort,
) -> _Below:
    board = Board(frame, best.max_size, limit, ceiling)
    for size in range(1, best.max_size + 1):
        board.offer_all(key for _, key in best.rows(size))
    certificate = search(board, effort)
    complete = tuple(certificate.exact and not board.full(size) for size in range(best.max_size + 1))
    return _Below(board, complete, certificate.exact)


def _columns(frame: Frame, key: tuple[int, ...]) -> tuple[int, ...]:
    return tuple(int(c) for c in frame.candidates[list(key)])


# ---- ``best_subsets``: the entrance to the exact search ----


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
    near_optimal_window: float | None = None,
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
    near_optimal_window: also list all subsets this close to the best of their size; 0.001 for 0.1 %.
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
    if near_optimal_window is not None:
        near_optimal_subsets = near_optimal(frame, board, near_optimal_window, enumeration_limit, effort)
        result = replace(result, near_optimal=near_optimal_subsets)
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
