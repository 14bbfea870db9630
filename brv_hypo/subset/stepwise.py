"""Efroymson's stepwise regression: quick, and not always right. For comparison with the exact search."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence

from numpy.typing import ArrayLike

from brv_hypo.errors import UsageError
from brv_hypo.subset.board import TIE, Board, Chosen, residual
from brv_hypo.subset.constraints import Groups, Parents
from brv_hypo.subset.finish import Finisher
from brv_hypo.subset.frame import Frame, build_frame
from brv_hypo.subset.pieces import propagate
from brv_hypo.subset.result import Certificate, SubsetResult


def stepwise(
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
    f_enter: float = 4.0,
    f_remove: float = 3.9,
    held_out_blocks: int | ArrayLike = 5,
    point: ArrayLike | None = None,
) -> SubsetResult:
    """Stepwise subset regression with the interface of ``best_subsets`` (report 3.3.3).

    At every step the columns of largest partial F enter where it exceeds ``f_enter``, then columns whose
    partial F is below ``f_remove`` leave. Groups and parents move together. The best subset met of every
    size is returned; ``certificate.exact`` is false and ``certificate.gap`` infinite, for nothing is proved.
    ``n_best``, ``time_limit_s`` and ``threads`` are there for the common interface; one subset a size is
    kept.

    Source: Efroymson, in Ralston and Wilf, Mathematical Methods for Digital Computers, Wiley 1960.
    Raises UsageError on input that does not fit, or where f_remove exceeds f_enter, which could go round
    for ever.
    """
    started = time.perf_counter()
    if f_remove > f_enter:
        raise UsageError(
            f"f_remove={f_remove} exceeds f_enter={f_enter}: a column could enter and leave for ever"
        )
    frame = build_frame(X, y, forced, weights, groups, parents)
    finisher = Finisher(frame, held_out_blocks, point)
    board = Board(frame, min(max_terms, frame.rank), 1)
    steps = 0
    for subset in _path(frame, board.max_size, f_enter, f_remove, frame.y.size):
        board.offer(subset)
        steps += 1
    unproved = float("inf")
    certificate = Certificate(
        exact=False,
        nodes=steps,
        margin=0.0,
        gap=unproved,
        gaps=(unproved,) * board.max_size,
        seconds=time.perf_counter() - started,
        kernel="efroymson",
        condition=frame.condition,
        status="stepwise: nothing is proved; compare with best_subsets",
    )
    return finisher.result(board, certificate)


def stepwise_columns(
    X: ArrayLike,
    y: ArrayLike,
    max_terms: int = 10,
    forced: Sequence[int] = (0,),
    n_best: int = 1,
    groups: Groups | None = None,
    *,
    samples: int,
    f_enter: float = 4.0,
    f_remove: float = 3.9,
) -> tuple[Chosen, ...]:
    """The subsets of ``stepwise``, not fitted: residual sums of squares and columns alone.

    X and y may be a triangular factor of so many ``samples``, which give F its freedom.
    """
    frame = build_frame(X, y, forced, None, groups, None)
    board = Board(frame, min(max_terms, frame.rank), 1)
    board.offer_all(_path(frame, board.max_size, f_enter, f_remove, samples))
    return board.chosen()


def differences(exact: SubsetResult, quick: SubsetResult) -> tuple[str, ...]:
    """One sentence for every size where stepwise missed the best subset."""
    sentences = []
    for found in quick.subsets:
        best = next((s for s in exact.subsets if s.size == found.size), None)
        if best is not None and found.rss > best.rss * (1.0 + TIE):
            sentences.append(
                f"size {found.size}: stepwise has {found.columns} with RSS {found.rss:.6g}; the best is "
                f"{best.columns} with {best.rss:.6g}, {100.0 * (1.0 - best.rss / found.rss):.3g} % lower"
            )
    return tuple(sentences)


def _path(
    frame: Frame, max_size: int, f_enter: float, f_remove: float, samples: int
) -> Iterator[tuple[int, ...]]:
    """The subsets that stepwise passes through."""
    chosen: tuple[int, ...] = ()
    rss = frame.rss_forced
    visited = {chosen}
    while True:
        entered = _best_entry(frame, chosen, rss, max_size, samples)
        if entered is None or entered[0] < f_enter or entered[1] in visited:
            return
        chosen, rss = entered[1], entered[2]
        visited.add(chosen)
        yield chosen
        while (left := _least_exit(frame, chosen, rss, samples)) is not None and left[0] < f_remove:
            if left[1] in visited:
                break
            chosen, rss = left[1], left[2]
            visited.add(chosen)
            yield chosen


def _best_entry(
    frame: Frame, chosen: tuple[int, ...], rss: float, max_size: int, samples: int
) -> tuple[float, tuple[int, ...], float] | None:
    moves = []
    outside = [j for j in range(frame.n_candidates) if j not in chosen]
    for j in outside:
        allowed = propagate(frame.constraints, (*chosen, j), [i for i in outside if i != j])
        if allowed is None or len(allowed[0]) > max_size:
            continue
        larger = tuple(sorted(allowed[0]))
        new = residual(frame, larger)
        if new is not None:
            moves.append((_partial_f(samples - len(frame.forced), chosen, rss, larger, new), larger, new))
    return max(moves, default=None)


def _least_exit(
    frame: Frame, chosen: tuple[int, ...], rss: float, samples: int
) -> tuple[float, tuple[int, ...], float] | None:
    moves = []
    for j in chosen:
        bound = frame.constraints.requires[:, j]
        smaller = tuple(i for i in chosen if i != j and not bound[i])
        new = residual(frame, smaller)
        if new is not None:
            moves.append((_partial_f(samples - len(frame.forced), smaller, new, chosen, rss), smaller, new))
    return min(moves, default=None)


def _partial_f(
    rows: int, small: tuple[int, ...], rss_small: float, large: tuple[int, ...], rss_large: float
) -> float:
    free = rows - len(large)
    if free <= 0 or rss_large <= 0.0:
        return float("inf") if rss_small > rss_large else 0.0
    return ((rss_small - rss_large) / (len(large) - len(small))) / (rss_large / free)
