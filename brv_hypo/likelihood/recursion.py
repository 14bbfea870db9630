"""Forward substitution in the exact dynamics of one segment, span by span.

    D dx = -(c, C) dp,    dx of a span's first sample given where the span is a reset

D in order of time is lower triangular but for interpolation near by, so that its factors stay as sparse as it is:
time and memory are linear in the samples however far a delay looks back. A span needs the states before it only
as far as a row looks back.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from brv_hypo.arrays import FloatArray, IntArray
from brv_hypo.likelihood.quadratic import Quadratic

if TYPE_CHECKING:
    from scipy.sparse import csr_array
    from scipy.sparse.linalg import SuperLU

LENGTH = 4096
"""Samples of a span at most, where spans can be cut: what is worked on at a time."""
_GROWTH = 1e4
"""Growth of the motion from a span's start at which the next begins: multipliers lose digits by its square."""
_MOST_RESETS = 80
"""Resets of a motion with memory: each stays an unknown of all that follows."""


class Span(NamedTuple):
    """Samples first to last - 1; `reset`: its first state is an unknown, tied to what came before afterwards."""

    first: int
    last: int
    reset: bool


class Piece(NamedTuple):
    """A span's rows of D: what acts on its own states, factored, and on the samples from `low` before them.

    `tie` (n_states, samples from low to the span's last) is the row that a reset replaced; None elsewhere.
    `outputs` acts on the same samples, for the output rows `seen`.
    """

    low: int
    factor: SuperLU
    before: csr_array[np.float64]
    tie: csr_array[np.float64] | None
    outputs: csr_array[np.float64]
    seen: slice

    def solved_backward(self, right: FloatArray) -> FloatArray:
        """The solution of the transposed rows of the span's own states."""
        solved = self.factor.solve(right, trans="T")  # type: ignore[call-overload]  # the stubs lack it
        return np.asarray(solved, dtype=float)


class Recursion:
    """The dynamics of a problem, cut into spans."""

    def __init__(self, problem: Quadratic) -> None:
        self.problem = problem
        self.n, self.n_states = problem.defect.shape
        lowest, highest = problem.defect_by_state.extent(self.n)
        stage = np.arange(1, self.n)
        reached = np.maximum.accumulate(np.concatenate([[0], np.maximum(highest, stage)]))
        self._cuts = 1 + np.flatnonzero(reached[:-1] < np.arange(1, self.n))
        sample = np.arange(self.n)
        first, last = problem.by_state.extent(self.n)
        self._seen_by = np.maximum.accumulate(np.maximum(last, sample))
        spread = int(np.max(self._seen_by - np.minimum(first, sample)))
        self.back = max(int(np.max(stage - np.minimum(lowest, stage), initial=1)), spread)
        self.memoryless = self.back == 1 and spread == 0
        self._pieces: dict[Span, Piece] = {}

    def spans(self) -> tuple[Span, ...] | None:
        """Spans within which the motion does not outgrow its digits; None where there is no way to cut them."""
        waiting = self._equal_spans()[::-1]
        done: list[Span] = []
        units = np.zeros((0, self.n_states, 0))
        while waiting:
            span = waiting.pop()
            before = np.zeros((units.shape[0], self.n_states, 0)) if self.memoryless else units
            own = self._unit_paths(span, before)
            if own is not None and np.abs(own[-(span.last - span.first) :]).max(initial=0.0) <= _GROWTH:
                done.append(span)
                units = own[-self.back :]
                continue
            halves = (span._replace(reset=True),) if not span.reset else self._halves(span)
            waiting += halves[::-1]
            resets = sum(each.reset for each in done)
            if not halves or (resets > _MOST_RESETS and not self.memoryless):
                return None
        return tuple(done)

    def run(
        self, spans: Sequence[Span], right: Callable[[slice], FloatArray], starts: Sequence[FloatArray]
    ) -> Iterator[tuple[Piece, FloatArray]]:
        """Each span's piece and the states (samples from piece.low, n_states, columns) from there to its end.

        `right` are right-hand sides by part (samples, n_states, columns), `starts` (n_states, columns) the first
        state of each reset.
        """
        kept: FloatArray | None = None
        remaining = iter(starts)
        for span in spans:
            piece = self.piece(span)
            own = right(slice(span.first, span.last))
            if span.reset:
                own[0] = next(remaining)
            before = own[:0] if kept is None else kept
            paths = np.concatenate([before, self._solved(piece, own, before)])
            yield piece, paths
            kept = paths[-self.back :]

    def piece(self, span: Span) -> Piece:
        """The span's rows, remembered where the segment is short."""
        if span not in self._pieces:
            if self.n > LENGTH:
                self._pieces.clear()
            self._pieces[span] = self._piece(span)
        return self._pieces[span]

    def _piece(self, span: Span) -> Piece:
        from scipy.sparse import csr_array, eye_array, vstack  # here, for a cheap import of the package
        from scipy.sparse.linalg import splu

        m, (first, last, reset) = self.n_states, span
        low = max(0, first - self.back)
        rows = self.problem.defect_by_state.matrix(self.n, slice(max(first, 1) - 1, last - 1))
        rows = rows[:, low * m : last * m]
        tie = None
        if reset:
            if first > 0:
                tie, rows = rows[:m], rows[m:]
            given = eye_array(m, (last - low) * m, k=(first - low) * m)
            rows = csr_array(vstack([given, rows], format="csr"))
        split = (first - low) * m
        factor = splu(rows[:, split:].tocsc(), permc_spec="NATURAL", diag_pivot_thresh=0.0)
        seen = slice(*np.searchsorted(self._seen_by, [first, last] if first > 0 else [0, last]).tolist())
        outputs = self.problem.by_state.matrix(self.n, seen)[:, low * m : last * m]
        return Piece(low, factor, rows[:, :split], tie, outputs, seen)

    def _solved(self, piece: Piece, right: FloatArray, before: FloatArray) -> FloatArray:
        flat = right.reshape(-1, right.shape[2])
        if before.size:
            flat = flat - piece.before @ before.reshape(-1, before.shape[2])
        return np.asarray(piece.factor.solve(np.ascontiguousarray(flat))).reshape(right.shape)

    def _unit_paths(self, span: Span, before: FloatArray) -> FloatArray | None:
        """States after unit starts of this reset and those before, (samples, n_states, units); None if singular."""
        fresh = self.n_states if span.reset else 0
        before = np.concatenate([before, np.zeros((*before.shape[:2], fresh))], axis=2)
        right = np.zeros((span.last - span.first, self.n_states, before.shape[2]))
        if fresh:
            right[0, :, -fresh:] = np.eye(fresh)
        try:
            own = self._solved(self.piece(span), right, before)
        except RuntimeError:  # exactly singular
            return None
        return np.concatenate([before, own]) if np.all(np.isfinite(own)) else None

    def _equal_spans(self) -> list[Span]:
        edges = [0]
        for wanted in range(LENGTH, self.n - LENGTH // 2, LENGTH):
            cut = self._nearest_cut(wanted, edges[-1], self.n)
            edges += [] if cut is None else [cut]
        return [
            Span(a, b, self.memoryless or a == 0) for a, b in zip(edges, [*edges[1:], self.n], strict=True)
        ]

    def _halves(self, span: Span) -> tuple[Span, ...]:
        cut = self._nearest_cut((span.first + span.last) // 2, span.first, span.last)
        return () if cut is None else (Span(span.first, cut, True), Span(cut, span.last, True))

    def _nearest_cut(self, wanted: int, above: int, below: int) -> int | None:
        """The sample nearest to the wanted one before which no row looks past it."""
        cuts: IntArray = self._cuts[(self._cuts > above) & (self._cuts < below)]
        return int(cuts[np.argmin(np.abs(cuts - wanted))]) if cuts.size else None
