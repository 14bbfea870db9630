"""Elimination of the states of one segment at a cost linear in the samples; `eliminate` chooses the way.

Exact dynamics are condensed: the states follow from a few first states by forward substitution, span by span,

    D dx = -(c, C) dp,    dx = s + S dp + E a,    a the first states of the spans.

D in order of time is lower triangular but for interpolation near by, so that its factors stay sparse however far a
delay looks back. Of each span only the triangle of its output rows is kept; a follows by least squares under
continuity from span to span. Everything else (process noise, short segments without delays) takes the banded solve of
`kkt`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from brv_hypo.arrays import FloatArray, IntArray
from brv_hypo.likelihood.kkt import (
    BlockRows,
    Eliminated,
    Quadratic,
    band_size,
    eliminate_by_band,
    residual_last,
    upper_triangle,
)

if TYPE_CHECKING:
    from scipy.sparse import csr_array
    from scipy.sparse.linalg import SuperLU


# ---- Forward substitution in the exact dynamics of one segment, span by span ----


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
    """A span's rows of D and of the outputs, which act on the samples from `low` to the span's last."""

    low: int
    """The first sample that they act on."""
    factor: SuperLU
    """What acts on the span's own states, factored."""
    before: csr_array[np.float64]
    """What acts on the samples before them."""
    tie: csr_array[np.float64] | None
    """The row that a reset replaced; None elsewhere."""
    outputs: csr_array[np.float64]
    """The outputs' rows."""
    observed: slice
    """Which of the outputs' rows these are."""


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
        self._observed_by = np.maximum.accumulate(np.maximum(last, sample))
        spread = int(np.max(self._observed_by - np.minimum(first, sample)))
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
        observed = slice(*np.searchsorted(self._observed_by, [first, last] if first > 0 else [0, last]).tolist())
        outputs = self.problem.by_state.matrix(self.n, observed)[:, low * m : last * m]
        return Piece(low=low, factor=factor, before=rows[:, :split], tie=tie, outputs=outputs, observed=observed)

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
        return [Span(a, b, self.memoryless or a == 0) for a, b in zip(edges, [*edges[1:], self.n], strict=True)]

    def _halves(self, span: Span) -> tuple[Span, ...]:
        cut = self._nearest_cut((span.first + span.last) // 2, span.first, span.last)
        return () if cut is None else (Span(span.first, cut, True), Span(cut, span.last, True))

    def _nearest_cut(self, wanted: int, above: int, below: int) -> int | None:
        """The sample nearest to the wanted one before which no row looks past it."""
        cuts: IntArray = self._cuts[(self._cuts > above) & (self._cuts < below)]
        return int(cuts[np.argmin(np.abs(cuts - wanted))]) if cuts.size else None


# ---- The states of exact dynamics: they follow from a few first states ----


_OBSERVABLE = 1e-8
"""Singular value of what the outputs see of the first states, against the largest, below which one is unseen."""


@dataclass(frozen=True)
class Starts:
    """First states of the resets (resets, n_states, 1 + p), the multipliers of their ties (row 0 without meaning),
    and the triangle of what is left of the residuals (1 + p, 1 + p).
    """

    x: FloatArray
    multiplier: FloatArray
    triangle: FloatArray


@dataclass(frozen=True)
class Condensed:
    """The recursion with its first states known; see `Eliminated`."""

    problem: Quadratic
    recursion: Recursion
    spans: tuple[Span, ...]
    starts: Starts

    def states(self, weights: FloatArray) -> FloatArray:
        """See `Eliminated`."""
        paths = zip(self.spans, self._run(weights[:, None]), strict=True)
        return np.concatenate([states[span.first - piece.low :, :, 0] for span, (piece, states) in paths])

    def step(self, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
        """See `Eliminated`. Multipliers backward through the spans, D' l = -J' (r + J dx + J_p dp)."""
        x = self.states(weights)
        problem = self.problem
        residual = problem.residual * weights[0] + problem.by_parameter @ weights[1:] + problem.by_state.dot(x)
        return x, self._multipliers(residual, self.starts.multiplier @ weights)

    def _multipliers(self, residual: FloatArray, continuity: FloatArray) -> FloatArray:
        problem, recursion = self.problem, self.recursion
        n, m = problem.defect.shape
        pull = np.zeros(n * m)
        found = np.zeros((n, m))
        stacked = iter(continuity[::-1])
        for span in reversed(self.spans):
            piece = recursion.piece(span)
            here, own = slice(piece.low * m, span.last * m), slice(span.first * m, span.last * m)
            pull[here] -= piece.outputs.T @ residual[piece.observed].ravel()
            tie = next(stacked) if span.reset else np.zeros(m)
            if piece.tie is not None:
                pull[here] -= piece.tie.T @ tie
            solved = piece.factor.solve(pull[own], trans="T")  # type: ignore[call-overload]  # the stubs lack it
            multiplier = np.asarray(solved, dtype=float)
            pull[piece.low * m : span.first * m] -= piece.before.T @ multiplier
            found[span.first : span.last] = multiplier.reshape(-1, m)
            if piece.tie is not None:
                found[span.first] = tie
        found[0, np.isinf(problem.variance[0])] = 0.0
        return found

    def residuals(self) -> FloatArray:
        """See `Eliminated`."""
        every = np.eye(self.problem.by_parameter.shape[2] + 1)
        found = self.problem.direct()
        for piece, paths in self._run(every):
            observed = np.asarray(piece.outputs @ paths.reshape(-1, paths.shape[2]))
            found[piece.observed] += observed.reshape(-1, *found.shape[1:])
        return found

    def triangle(self) -> FloatArray:
        """See `Eliminated`."""
        return self.starts.triangle

    def _run(self, weights: FloatArray) -> Iterator[tuple[Piece, FloatArray]]:
        starts = self.starts.x @ weights
        return self.recursion.run(self.spans, lambda part: -self.problem.defects(part) @ weights, list(starts))


def condense(problem: Quadratic) -> Condensed | None:
    """The states as they follow from dp; None where the outputs leave one undetermined, or no recursion is stable."""
    recursion = Recursion(problem)
    spans = recursion.spans()
    if spans is None:
        return None
    starts = _chained(recursion, spans) if recursion.memoryless else _together(recursion, spans)
    return None if starts is None else Condensed(problem, recursion, spans, starts)


def _chained(recursion: Recursion, spans: tuple[Span, ...]) -> Starts | None:
    """Without memory: each span sees its own first state, which the one before leads to."""
    problem, m = recursion.problem, recursion.n_states
    columns = 1 + problem.by_parameter.shape[2]
    unit = _unit(m, columns, m, 0)
    rows, continuity = [], []
    for piece, paths in _observed(recursion, spans, m, [unit] * len(spans)):
        rows.append(_observed_triangle(problem, piece, paths, columns))
        if piece.tie is not None:
            continuity.append(_continuity(piece, paths, m))
    triangles = np.array(rows)
    stacked = np.array(continuity).reshape(-1, m, 2 * m + columns)
    defect = np.concatenate(
        [problem.defects(slice(0, 1)), _continuity_defects(problem, spans) + stacked[:, :, 2 * m :]]
    )
    chain = Quadratic(
        residual=triangles[:, :, -1],
        by_state=BlockRows(0, triangles[:, None, :, :m]),
        by_parameter=triangles[:, :, m:-1],
        defect=defect[:, :, 0],
        defect_by_state=BlockRows(0, np.stack([stacked[:, :, :m], stacked[:, :, m : 2 * m]], axis=1)),
        defect_by_parameter=defect[:, :, 1:],
        variance=np.concatenate([problem.variance[:1], np.zeros((len(spans) - 1, m))]),
    )
    solution = eliminate_by_band(chain)
    return None if solution is None else Starts(solution.x, solution.multiplier, solution.triangle())


def _together(recursion: Recursion, spans: tuple[Span, ...]) -> Starts | None:
    """With memory: every first state acts on all that follows; one least-squares problem with constraints."""
    problem, m = recursion.problem, recursion.n_states
    columns = 1 + problem.by_parameter.shape[2]
    free = m * sum(span.reset for span in spans)
    units = [_unit(m, columns, free, at) for at in range(0, free, m)]
    triangle = np.zeros((0, free + columns))
    continuity = []
    for piece, paths in _observed(recursion, spans, free, units):
        triangle = upper_triangle(np.concatenate([triangle, _observed_triangle(problem, piece, paths, columns)]))
        if piece.tie is not None:
            continuity.append(np.asarray(piece.tie @ paths.reshape(-1, paths.shape[2])).reshape(m, -1))
    stacked = np.array(continuity).reshape(-1, m, columns + free)
    stacked[:, :, :columns] += _continuity_defects(problem, spans)
    first = problem.defects(slice(0, 1))[0]
    held = problem.variance[0] == 0.0
    equal = np.concatenate([np.eye(m, free)[held], stacked[:, :, columns:].reshape(-1, free)])
    offset = np.concatenate([first[held], stacked[:, :, :columns].reshape(-1, columns)])
    known = np.isfinite(problem.variance[0]) & (problem.variance[0] > 0.0)  # by a Gaussian prior
    weight = 1.0 / np.sqrt(problem.variance[0, known])[:, None]
    matrix = np.concatenate([triangle[:, :free], weight * np.eye(m, free)[known]])
    rest = np.concatenate([triangle[:, [-1, *range(free, free + columns - 1)]], weight * first[known]])
    found = _constrained(matrix, rest, equal, offset)
    if found is None:
        return None
    x, multiplier = found
    left = matrix @ x + rest
    continuity_multipliers = np.concatenate(
        [np.zeros((1, m, columns)), multiplier[held.sum() :].reshape(-1, m, columns)]
    )
    return Starts(x.reshape(-1, m, columns), continuity_multipliers, upper_triangle(residual_last(left[:, None])))


def _constrained(
    matrix: FloatArray, rest: FloatArray, equal: FloatArray, offset: FloatArray
) -> tuple[FloatArray, FloatArray] | None:
    """a that minimises |matrix a + rest| subject to equal a + offset = 0, column by column, and its multipliers.

    None where a is not determined.
    """
    count = equal.shape[0]
    basis, upper = np.linalg.qr(equal.T, mode="complete")
    upper, fixed, null = upper[:count], basis[:, :count], basis[:, count:]
    diagonal = np.abs(np.diag(upper))
    if not np.all(diagonal > _OBSERVABLE * diagonal.max(initial=0.0)):
        return None
    x = -fixed @ np.linalg.solve(upper.T, offset)
    if null.shape[1]:
        observed = matrix @ null
        norm = np.linalg.norm(observed, axis=0)
        if not np.all(norm > 0.0):
            return None
        left, singular, rotation = np.linalg.svd(observed / norm, full_matrices=False)
        if singular[-1] < _OBSERVABLE * singular[0]:
            return None
        move = rotation.T @ ((left.T @ (matrix @ x + rest)) / singular[:, None])
        x = x - null @ (move / norm[:, None])
    return x, -np.linalg.solve(upper, fixed.T @ (matrix.T @ (matrix @ x + rest)))


def _observed(
    recursion: Recursion, spans: tuple[Span, ...], free: int, starts: list[FloatArray]
) -> Iterator[tuple[Piece, FloatArray]]:
    """The recursion by [1 dp] and the free first states."""
    problem = recursion.problem

    def right(part: slice) -> FloatArray:
        given = -problem.defects(part)
        return np.concatenate([given, np.zeros((*given.shape[:2], free))], axis=2)

    return recursion.run(spans, right, starts)


def _observed_triangle(problem: Quadratic, piece: Piece, paths: FloatArray, columns: int) -> FloatArray:
    """Triangle of what the outputs see of a span, by [first states, dp, 1]."""
    observed = np.asarray(piece.outputs @ paths.reshape(-1, paths.shape[2]))
    observed[:, :columns] += problem.direct(piece.observed).reshape(-1, columns)
    return upper_triangle(np.concatenate([observed[:, columns:], observed[:, 1:columns], observed[:, :1]], axis=1))


def _continuity(piece: Piece, paths: FloatArray, m: int) -> FloatArray:
    """A tie without memory by [state before, first state, 1, dp], (m, 2 m + 1 + p)."""
    before, here = (np.asarray((piece.tie[:, at : at + m]).toarray()) for at in (0, m))  # type: ignore[index]
    led = before @ paths[0]
    return np.concatenate([led[:, -m:], here, led[:, :-m]], axis=1)


def _continuity_defects(problem: Quadratic, spans: tuple[Span, ...]) -> FloatArray:
    """[c C] where the ties stand, (ties, n_states, 1 + p)."""
    return np.concatenate([problem.defects(slice(s.first, s.first + 1)) for s in spans if s.reset])[1:]


def _unit(m: int, columns: int, free: int, at: int) -> FloatArray:
    """A reset's first states as unknowns: (m, columns + free)."""
    found = np.zeros((m, columns + free))
    found[:, columns + at : columns + at + m] = np.eye(m)
    return found


# ---- The choice between condensation and the band ----


_FAR = 3
"""Samples that exact dynamics look back from which condensation is cheaper than the band."""
_LONG = 2 * LENGTH
"""Samples from which a segment without delays is condensed."""
_LARGEST_BAND = 1 << 27
"""Numbers that a band may hold (1 GB) where condensation finds no way."""


def eliminate(problem: Quadratic) -> Eliminated | None:
    """The states as affine functions of the parameter step; None where the outputs leave one undetermined."""
    n = problem.defect.shape[0]
    reach = max(-problem.defect_by_state.span(n)[0], *map(abs, problem.by_state.span(n)))
    if problem.exact and (reach > _FAR or n > _LONG):
        condensed = condense(problem)
        if condensed is not None or band_size(problem) > _LARGEST_BAND:
            return condensed
    return eliminate_by_band(problem)
