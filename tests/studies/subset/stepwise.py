"""Efroymson's stepwise regression: quick, and not always right. For comparison with the exact search."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from numpy.typing import ArrayLike

from brv_hypo.subset import Chosen
from brv_hypo.subset.frame import Frame, Groups, build_frame
from brv_hypo.subset.search import Board, residual


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
    """Stepwise subset regression with the interface of ``best_columns`` (report 3.3.3).

    At every step the columns of largest partial F enter where it exceeds ``f_enter``, then columns whose partial F is
    below ``f_remove``, which is no more than that, leave. Groups move together. The best subset met of every size is
    returned, one a size whatever ``n_best``; nothing is proved. X and y may be a triangular factor of so many
    ``samples``, which give F its freedom.

    Source: Efroymson, in Ralston and Wilf, Mathematical Methods for Digital Computers, Wiley 1960.
    """
    frame = build_frame(X, y, forced, None, groups, None)
    board = Board(frame, max_terms, 1)
    board.offer_all(_path(frame, board.max_size, f_enter, f_remove, samples))
    return board.chosen()


def _path(frame: Frame, max_size: int, f_enter: float, f_remove: float, samples: int) -> Iterator[tuple[int, ...]]:
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
        while (leaving := _least_exit(frame, chosen, rss, samples)) is not None and leaving[0] < f_remove:
            if leaving[1] in visited:
                break
            chosen, rss = leaving[1], leaving[2]
            visited.add(chosen)
            yield chosen


def _best_entry(
    frame: Frame, chosen: tuple[int, ...], rss: float, max_size: int, samples: int
) -> tuple[float, tuple[int, ...], float] | None:
    moves = []
    outside = [j for j in range(frame.candidates.size) if j not in chosen]
    for j in outside:
        allowed = frame.constraints.propagated((*chosen, j), [i for i in outside if i != j])
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


def _partial_f(rows: int, small: tuple[int, ...], rss_small: float, large: tuple[int, ...], rss_large: float) -> float:
    free = rows - len(large)
    if free <= 0 or rss_large <= 0.0:
        return float("inf") if rss_small > rss_large else 0.0
    return ((rss_small - rss_large) / (len(large) - len(small))) / (rss_large / free)
