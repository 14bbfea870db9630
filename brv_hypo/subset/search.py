"""Runs the tree search: by which kernel, for how long, and what it proved.

Small searches are done in numpy; the compiled kernel is loaded once numpy has visited about as many nodes as loading
or compiling it costs, which depends on whether an earlier process left it on disk. `search` is the entrance;
`Certificate` says what was proved, `proved_gaps` by how much each size may still be off.
"""

from __future__ import annotations

import logging
import sys
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import numpy as np

from brv_hypo.errors import UsageError
from brv_hypo.subset.frame import Frame
from brv_hypo.subset.incumbents import CLOSED, Board
from brv_hypo.subset.result import Certificate
from brv_hypo.subset.tree import Node, NumpyTree, OpenSubtree, StopSearchError, independent_pieces, make_node

# Scaled condition number above which Schur complements lose too many digits and triangular factors take over.
SCHUR_CONDITION = 2e5
# The same where Schur complements are asked for by name: beyond, their H has no digits left.
SCHUR_BREAKDOWN = 1e7
KERNELS = ("auto", "numpy", "numba-schur", "numba-givens")
# Nodes that numpy is given before the compiled kernel is sent for: about what sending for it costs, to the compiler (in
# one search) or to the disk alone (in all searches of a process).
COMPILING_NODES, LOADING_NODES = 8000, 1000
# Seconds that a time limit must leave for the compiled kernel to be worth sending for.
COMPILE_ALLOWANCE_S = 10.0
# First bytes of an index of numba's, in which it names its version.
HEAD = 64


@dataclass(frozen=True)
class Effort:
    """How to search: worker threads, time limit since the start, kernel."""

    threads: int = 1
    time_limit_s: float | None = None
    kernel: str = "auto"
    started: float = field(default_factory=time.perf_counter)

    def __post_init__(self) -> None:
        if self.threads < 1:
            raise UsageError(f"got threads={self.threads}; expected 1 or more")
        if self.kernel not in KERNELS:
            raise UsageError(f"kernel {self.kernel!r} is unknown; expected one of {', '.join(KERNELS)}")


# Nodes that numpy visited in this process, by all its searches.
_visited = Counter(nodes=0)


def search(board: Board, effort: Effort) -> Certificate:
    """Search until every branch is decided or the time is up; the board then holds the answer."""
    deadline = np.inf if effort.time_limit_s is None else effort.started + effort.time_limit_s
    nodes, left, orthogonal = _search_numpy(board, effort, deadline)
    kernel = "numpy"
    if left and time.perf_counter() < deadline:
        # Imported here: numba takes longer to import than most searches take to finish.
        if not _kernel_in_memory():
            message = "loading the compiled search kernel; the first time ever it has to be compiled"
            logging.getLogger(__name__).info(message)
        from brv_hypo.subset.compiled import search_compiled

        kernel = "numba-givens" if orthogonal else "numba-schur"
        more, left = search_compiled(board, left, orthogonal, deadline, effort.threads)
        nodes += more
    gaps = proved_gaps(board, left)
    return Certificate(
        exact=not left,
        nodes=nodes,
        margin=board.margin,
        gap=max(gaps, default=0.0),
        gaps=gaps,
        seconds=time.perf_counter() - effort.started,
        kernel=kernel,
        condition=board.frame.condition,
        status="complete" if not left else f"stopped by the time limit of {effort.time_limit_s} s",
    )


def _search_numpy(board: Board, effort: Effort, deadline: float) -> tuple[int, list[OpenSubtree], bool]:
    """Search in numpy within its budget: nodes visited, what is left, and whether that needs orthogonal steps.

    Pieces are made one after the other and let go again: dependent columns may make tens of thousands.
    """
    budget = _numpy_budget(effort, deadline) - (_visited["nodes"] if kernel_on_disk() else 0)
    nodes = 0

    def spend() -> None:
        nonlocal nodes
        nodes += 1
        if nodes > budget or (nodes % 64 == 0 and time.perf_counter() > deadline):
            raise StopSearchError

    tree = NumpyTree(board, spend=spend)
    left: list[OpenSubtree] = []
    orthogonal, stopped = False, budget <= 0
    for piece in independent_pieces(board.frame, board.max_size):
        if isinstance(piece, OpenSubtree):
            if time.perf_counter() > deadline:
                left.append(piece)
            else:
                tree.score(piece)
            continue
        orthogonal = orthogonal or _ill_conditioned(board.frame, piece, effort.kernel)
        board.widen(piece.rounding_margin(orthogonal=orthogonal))
        if stopped:
            left.append(OpenSubtree(piece.included, tuple(piece.undecided.tolist()), piece.bound))
            continue
        try:
            tree.run(piece)
        except StopSearchError:
            stopped = True
    _visited["nodes"] += nodes
    return nodes, tree.open_subtrees + left, orthogonal


def _ill_conditioned(frame: Frame, piece: Node, kernel: str) -> bool:
    """Whether Schur complements lose too many digits on this piece."""
    if kernel == "numba-givens":
        return True
    limit = SCHUR_BREAKDOWN if kernel == "numba-schur" else SCHUR_CONDITION
    if np.isfinite(frame.condition):
        return frame.condition > limit
    return bool(piece.undecided.size) and float(np.linalg.cond(piece.R)) > limit


def _numpy_budget(effort: Effort, deadline: float) -> float:
    if effort.kernel == "numpy":
        return np.inf
    # A compiled kernel that is in memory already is quicker from the first node.
    if effort.kernel != "auto" or _kernel_in_memory():
        return 0.0
    if kernel_on_disk():
        return LOADING_NODES
    return COMPILING_NODES if deadline - time.perf_counter() > COMPILE_ALLOWANCE_S else np.inf


def _kernel_in_memory() -> bool:
    return "brv_hypo.subset.kernel" in sys.modules


@cache
def kernel_on_disk(folder: Path | None = None) -> bool:
    """Whether an index of this Python and numba, no older than the kernel's source, lies in `folder`.

    Told without importing numba, and once in a process, which may search hundreds of times. A kernel that was compiled
    on another processor passes: then it is compiled anew, once, a few nodes too early. Indices that numba keeps
    elsewhere, by its own settings, are not looked for.
    """
    source = Path(__file__).with_name("kernel.py")
    python = f"py{sys.version_info.major}{sys.version_info.minor}"
    try:
        compiler = version("numba").encode()
        indices = (folder or source.parent / "__pycache__").glob(f"kernel.search-*.{python}.nbi")
        return any(_serves(index, source, compiler) for index in indices)
    except (PackageNotFoundError, OSError):
        return False


def _serves(index: Path, source: Path, compiler: bytes) -> bool:
    with index.open("rb") as stream:
        return compiler in stream.read(HEAD) and index.stat().st_mtime >= source.stat().st_mtime


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
    return tuple(_gap(board, size, float(lowest[size])) for size in range(1, board.max_size + 1))


def _gap(board: Board, size: int, lowest: float) -> float:
    worst = board.worst(size)
    if not np.isfinite(lowest) or board.limits[size] == CLOSED or lowest > board.limits[size]:
        return 0.0
    return max(0.0, 1.0 - lowest / worst) if board.full(size) and worst > 0.0 else 1.0
