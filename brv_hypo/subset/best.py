"""`best_subsets` and `best_columns`, the entrances to the exact search; what they return, and how they search.

Small searches are done in numpy; the compiled kernel is loaded once numpy has visited about as many nodes as compiling
it costs. Columns that are too ill-conditioned for its Schur complements stay with numpy, as do searches with rules.
"""

from __future__ import annotations

import logging
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from brv_hypo.arrays import FloatArray
from brv_hypo.errors import UsageError
from brv_hypo.results import Row, Tabular
from brv_hypo.subset.criteria import Criteria, Reference, evaluate, least_squares
from brv_hypo.subset.frame import Alias, Frame, Groups, Parents, Refusal, build_frame, dependencies
from brv_hypo.subset.search import (
    CLOSED,
    Board,
    Chosen,
    NumpyTree,
    OpenSubtree,
    StopSearchError,
    independent_pieces,
    make_node,
    seed_board,
)

SCHUR_CONDITION = 2e5  # scaled condition number above which Schur complements lose too many digits
# Nodes that numpy is given before the compiled kernel is sent for: about what compiling it costs.
COMPILING_NODES = 8000
COMPILE_ALLOWANCE_S = 10.0  # seconds that a time limit must leave for the compiled kernel to be worth sending for


@dataclass(frozen=True)
class Subset:
    """One subset and its fit."""

    columns: tuple[int, ...]  # chosen columns of X, ascending, without the forced ones
    rss: float  # residual sum of squares
    terms: tuple[int, ...]  # the forced columns, then the chosen ones
    coefficients: FloatArray  # of `terms`, in their order
    std_errors: FloatArray  # ordinary ones, from RSS / (n - p), in the order of `terms`
    criteria: Criteria  # the selection criteria

    @property
    def size(self) -> int:
        """Number of chosen columns."""
        return len(self.columns)


@dataclass(frozen=True)
class Certificate:
    """What the search has proved."""

    exact: bool  # no allowed subset of a returned size beats the returned ones
    nodes: int  # nodes visited
    margin: float  # relative allowance for rounding with which branches were cut
    gap: float  # the largest of `gaps`
    gaps: tuple[float, ...]  # of the RSS of size 1, 2, ...: how much, relatively, it may still be too high; 0 if proved
    seconds: float  # wall-clock time
    kernel: str  # ``numpy`` or ``numba-schur``: the last that was used
    status: str  # how it ended, in words


@dataclass(frozen=True, eq=False, repr=False)
class SubsetResult(Tabular):
    """Subsets by size, then by residual sum of squares."""

    subsets: tuple[Subset, ...]  # the best of every size
    certificate: Certificate  # what was proved of them
    # Columns that equal a combination of others. Multiples of one column, and of forced ones, are not searched unless a
    # rule names them, and stand-ins of the same span can be read off here; no subset holds all of a longer combination.
    aliases: tuple[Alias, ...]
    baseline: Subset  # the forced model alone
    refused: tuple[Refusal, ...] = ()  # so near to dependence that no subset holds them together, with the reason

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


def fitted_result(board: Board, certificate: Certificate) -> SubsetResult:
    """All subsets on the board, fitted in extended precision, with their criteria."""
    frame = board.frame
    independent = frame.candidates[dependencies(frame.R, frame.noise)[0]]
    reference = Reference(
        rss_forced=least_squares(frame.X[:, list(frame.forced)], frame.y).rss,
        n_forced=len(frame.forced),
        complete=least_squares(frame.X[:, [*frame.forced, *independent]], frame.y, variances=False),
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


# ---- How the search is run: by which kernel, for how long, and what it proved ----


def search(board: Board, threads: int = 1, time_limit_s: float | None = None) -> Certificate:
    """Search until every branch is decided or the time is up; the board then holds the answer."""
    started = time.perf_counter()
    deadline = np.inf if time_limit_s is None else started + time_limit_s
    nodes, left = _search_numpy(board, deadline)
    kernel = "numpy"
    if left and time.perf_counter() < deadline:
        # Imported here: numba takes longer to import than most searches take to finish.
        if not _kernel_in_memory():
            message = "loading the compiled search kernel; the first time ever it has to be compiled"
            logging.getLogger(__name__).info(message)
        from brv_hypo.subset.compiled import search_compiled

        more, left = search_compiled(board, left, deadline, threads)
        kernel, nodes = "numba-schur", nodes + more
    gaps = proved_gaps(board, left)
    return Certificate(
        exact=not left,
        nodes=nodes,
        margin=board.margin,
        gap=max(gaps, default=0.0),
        gaps=gaps,
        seconds=time.perf_counter() - started,
        kernel=kernel,
        status="complete" if not left else f"stopped by the time limit of {time_limit_s} s",
    )


def _search_numpy(board: Board, deadline: float) -> tuple[int, list[OpenSubtree]]:
    """Search in numpy, what is well-conditioned and without rules within its budget: nodes visited, and what is left.
    Pieces are made one after the other and let go again: dependent columns may make tens of thousands.
    """
    allowed = _numpy_budget(deadline)
    nodes, budget = 0, allowed

    def spend() -> None:
        nonlocal nodes
        nodes += 1
        if nodes > budget or (nodes % 64 == 0 and time.perf_counter() > deadline):
            raise StopSearchError

    tree = NumpyTree(board, spend=spend)
    left: list[OpenSubtree] = []
    for piece in independent_pieces(board.frame, board.max_size):
        late = time.perf_counter() > deadline
        if isinstance(piece, OpenSubtree):
            if late:
                left.append(piece)
            else:
                tree.score(piece)
            continue
        condition = board.frame.condition
        if np.isinf(condition):
            condition = float(np.linalg.cond(piece.R)) if piece.undecided.size else 1.0
        orthogonal = condition > SCHUR_CONDITION  # Schur complements lose too many digits on this piece
        board.widen(piece.rounding_margin(orthogonal=orthogonal))
        budget = np.inf if orthogonal or board.frame.constraints.active else allowed
        if late or nodes >= budget:
            left.append(OpenSubtree(piece.included, tuple(piece.undecided.tolist()), piece.bound))
        else:
            with suppress(StopSearchError):
                tree.run(piece)
    return nodes, tree.open_subtrees + left


def _numpy_budget(deadline: float) -> float:
    """Nodes: none where the compiled kernel is in memory already, as it is quicker from the first node."""
    if _kernel_in_memory():
        return 0.0
    return COMPILING_NODES if deadline - time.perf_counter() > COMPILE_ALLOWANCE_S else np.inf


def _kernel_in_memory() -> bool:
    return "brv_hypo.subset.compiled" in sys.modules


def proved_gaps(board: Board, left: Sequence[OpenSubtree]) -> tuple[float, ...]:
    """Relative amount by which the best residual of size 1, 2, ... may still be too high."""
    lowest = np.full(board.max_size + 1, np.inf)
    for subtree in left:
        node = make_node(board.frame, subtree.included, subtree.undecided)
        if node is not None:
            # With t = 1, 2, ... more columns one of the t + 1 costliest is left out.
            least = node.bound + np.append(np.sort(node.rises())[::-1], 0.0)[1:]
            sizes = lowest[len(node.included) + 1 :][: least.size]
            np.minimum(sizes, least[: sizes.size], out=sizes)
    gaps = []
    for size, bound in enumerate(lowest[1:].tolist(), start=1):
        worst, limit = board.worst(size), board.limits[size]
        undecided = np.isfinite(bound) and limit != CLOSED and bound <= limit
        gap = max(0.0, 1.0 - bound / worst) if board.full(size) and worst > 0.0 else 1.0
        gaps.append(gap if undecided else 0.0)
    return tuple(gaps)


def best_subsets(
    X: ArrayLike,
    y: ArrayLike,
    max_terms: int = 10,
    forced: Sequence[int] = (0,),
    n_best: int = 1,
    groups: Groups = None,
    parents: Parents = None,
    weights: ArrayLike | None = None,
    time_limit_s: float | None = None,
    threads: int = 1,
) -> SubsetResult:
    """The ``n_best`` subsets of least residual sum of squares, of every size 1..max_terms, proved best.

    Branch and bound over includes and drops after Furnival and Wilson, Technometrics 16 (1974) 499, branching at every
    drop on the largest rise of the bound. Subsets whose columns are linearly dependent, or so nearly that rounding
    would decide their coefficients, are not returned; ``aliases`` and ``refused`` name them.

    Parameters
    ----------
    X, y : array_like
        (n, p) and (n,) in any units; several channels go in as one frame, stacked and whitened.
    max_terms, n_best : int
        Largest size, which counts columns, those of a group too; subsets of each size.
    forced : sequence of int
        Columns of X in every subset, not counted in its size; ``()`` for none. A combination of these is set aside.
    groups : sequence, optional
        ``together(...)`` and ``at_most_one(...)``; a plain sequence of columns means together.
    parents : mapping, optional
        Column to the column or columns that must be in whenever it is.
    weights : array_like, optional
        (n,), >= 0, of the rows' squares; residuals and criteria are those of the weighted rows.
    time_limit_s, threads : float, int, optional
        Seconds after which the best found so far is returned with the gap proved; threads of the compiled kernel.

    Returns
    -------
    SubsetResult
        Subsets by size, with criteria, and the certificate of the search.

    Raises
    ------
    UsageError
        The input is unfit.

    Examples
    --------
    >>> import numpy as np
    >>> X = np.column_stack([np.ones(50), np.random.default_rng(0).standard_normal((50, 9))])
    >>> best_subsets(X, X[:, 4] - X[:, 7], max_terms=2).best(2).columns
    (4, 7)
    """
    if threads < 1:
        raise UsageError(f"got threads={threads}; expected 1 or more")
    board = _seeded(build_frame(X, y, forced, weights, groups, parents), max_terms, n_best)
    return fitted_result(board, search(board, threads, time_limit_s))


def best_columns(
    X: ArrayLike,
    y: ArrayLike,
    max_terms: int = 10,
    forced: Sequence[int] = (0,),
    n_best: int = 1,
    groups: Groups = None,
) -> tuple[Chosen, ...]:
    """The subsets of ``best_subsets``, proved like them but not fitted: residual sums of squares and columns alone."""
    board = _seeded(build_frame(X, y, forced, None, groups, None), max_terms, n_best)
    search(board)
    return board.chosen()


def _seeded(frame: Frame, max_terms: int, n_best: int) -> Board:
    """The problem with good subsets of every size to start from."""
    if max_terms < 0 or n_best < 1:
        raise UsageError(f"got max_terms={max_terms}, n_best={n_best}; expected max_terms >= 0 and n_best >= 1")
    board = Board(frame, max_terms, n_best)
    seed_board(board)
    return board
