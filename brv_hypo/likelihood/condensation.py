"""Eliminates the states of a segment whose dynamics are exact: they follow from a few first states.

    dx = s + S dp + E a,    a the first states of the spans of `recursion`

What the outputs see of a span is kept as the triangle of its rows only, so that memory does not grow with the
parameters. Then a follows by least squares, each span tied to the one before:
without memory as a chain of few stages, which is again a `Quadratic`; with it, as one small problem.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from brv_hypo.arrays import BoolArray, FloatArray
from brv_hypo.likelihood.band import eliminate_by_band
from brv_hypo.likelihood.blocks import BlockRows
from brv_hypo.likelihood.quadratic import Quadratic
from brv_hypo.likelihood.recursion import Piece, Recursion, Span
from brv_hypo.likelihood.triangle import residual_last, upper_triangle

_SEEN = 1e-8
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
        return np.concatenate([own[:, :, 0] for own in self._own(weights[:, None])])

    def step(self, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
        """See `Eliminated`. Multipliers backward through the spans, D' l = -J' (r + J dx + J_p dp)."""
        x = self.states(weights)
        problem = self.problem
        residual = (
            problem.residual * weights[0] + problem.by_parameter @ weights[1:] + problem.by_state.dot(x)
        )
        return x, self._multipliers(residual, self.starts.multiplier @ weights)

    def _multipliers(self, residual: FloatArray, ties: FloatArray) -> FloatArray:
        problem, recursion = self.problem, self.recursion
        n, m = problem.defect.shape
        pull = np.zeros(n * m)
        found = np.zeros((n, m))
        tied = iter(ties[::-1])
        for span in reversed(self.spans):
            piece = recursion.piece(span)
            here, own = slice(piece.low * m, span.last * m), slice(span.first * m, span.last * m)
            pull[here] -= piece.outputs.T @ residual[piece.seen].ravel()
            tie = next(tied) if span.reset else np.zeros(m)
            if piece.tie is not None:
                pull[here] -= piece.tie.T @ tie
            multiplier = piece.solved_backward(pull[own])
            pull[piece.low * m : span.first * m] -= piece.before.T @ multiplier
            found[span.first : span.last] = multiplier.reshape(-1, m)
            if piece.tie is not None:
                found[span.first] = tie
        found[0, np.isinf(problem.variance[0])] = 0.0
        return found

    def at_start(self) -> FloatArray:
        """See `Eliminated`."""
        return np.asarray(self.starts.x[0])

    def rows(self) -> tuple[FloatArray, FloatArray | None]:
        """See `Eliminated`."""
        every = np.eye(self.problem.by_parameter.shape[2] + 1)
        found = self.problem.direct()
        for piece, paths in self._run(every):
            seen = np.asarray(piece.outputs @ paths.reshape(-1, paths.shape[2]))
            found[piece.seen] += seen.reshape(-1, *found.shape[1:])
        known = _known_start(self.problem)
        if not known.any():
            return found, None
        strayed = np.zeros((*self.problem.defect.shape, found.shape[2]))
        strayed[0] = _strayed(self.problem, self.starts.x[0])
        return found, strayed

    def triangle(self) -> FloatArray:
        """See `Eliminated`."""
        return self.starts.triangle

    def _own(self, weights: FloatArray) -> list[FloatArray]:
        return [
            paths[span.first - piece.low :]
            for span, (piece, paths) in zip(self.spans, self._run(weights), strict=True)
        ]

    def _run(self, weights: FloatArray) -> Iterator[tuple[Piece, FloatArray]]:
        starts = self.starts.x @ weights
        return self.recursion.run(
            self.spans, lambda part: -self.problem.defects(part) @ weights, list(starts)
        )


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
    rows, ties = [], []
    for piece, paths in _observed(recursion, spans, m, [unit] * len(spans)):
        rows.append(_seen_triangle(problem, piece, paths, columns))
        if piece.tie is not None:
            ties.append(_tie(piece, paths, m))
    triangles = np.array(rows)
    tied = np.array(ties).reshape(-1, m, 2 * m + columns)
    defect = np.concatenate(
        [problem.defects(slice(0, 1)), _tie_defects(problem, spans) + tied[:, :, 2 * m :]]
    )
    chain = Quadratic(
        residual=triangles[:, :, -1],
        by_state=BlockRows(0, triangles[:, None, :, :m]),
        by_parameter=triangles[:, :, m:-1],
        defect=defect[:, :, 0],
        defect_by_state=BlockRows(0, np.stack([tied[:, :, :m], tied[:, :, m : 2 * m]], axis=1)),
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
    ties = []
    for piece, paths in _observed(recursion, spans, free, units):
        triangle = upper_triangle(np.concatenate([triangle, _seen_triangle(problem, piece, paths, columns)]))
        if piece.tie is not None:
            ties.append(np.asarray(piece.tie @ paths.reshape(-1, paths.shape[2])).reshape(m, -1))
    tied = np.array(ties).reshape(-1, m, columns + free)
    tied[:, :, :columns] += _tie_defects(problem, spans)
    first = problem.defects(slice(0, 1))[0]
    held = problem.variance[0] == 0.0
    equal = np.concatenate([np.eye(m, free)[held], tied[:, :, columns:].reshape(-1, free)])
    offset = np.concatenate([first[held], tied[:, :, :columns].reshape(-1, columns)])
    known = _known_start(problem)
    weight = 1.0 / np.sqrt(problem.variance[0, known])[:, None]
    matrix = np.concatenate([triangle[:, :free], weight * np.eye(m, free)[known]])
    rest = np.concatenate([triangle[:, [-1, *range(free, free + columns - 1)]], weight * first[known]])
    found = _constrained(matrix, rest, equal, offset)
    if found is None:
        return None
    x, multiplier = found
    left = matrix @ x + rest
    ties_only = np.concatenate([np.zeros((1, m, columns)), multiplier[held.sum() :].reshape(-1, m, columns)])
    return Starts(x.reshape(-1, m, columns), ties_only, upper_triangle(residual_last(left[:, None])))


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
    if not np.all(diagonal > _SEEN * diagonal.max(initial=0.0)):
        return None
    x = -fixed @ np.linalg.solve(upper.T, offset)
    if null.shape[1]:
        seen = matrix @ null
        norm = np.linalg.norm(seen, axis=0)
        if not np.all(norm > 0.0):
            return None
        left, singular, rotation = np.linalg.svd(seen / norm, full_matrices=False)
        if singular[-1] < _SEEN * singular[0]:
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


def _seen_triangle(problem: Quadratic, piece: Piece, paths: FloatArray, columns: int) -> FloatArray:
    """Triangle of what the outputs see of a span, by [first states, dp, 1]."""
    seen = np.asarray(piece.outputs @ paths.reshape(-1, paths.shape[2]))
    seen[:, :columns] += problem.direct(piece.seen).reshape(-1, columns)
    return upper_triangle(np.concatenate([seen[:, columns:], seen[:, 1:columns], seen[:, :1]], axis=1))


def _tie(piece: Piece, paths: FloatArray, m: int) -> FloatArray:
    """A tie without memory by [state before, first state, 1, dp], (m, 2 m + 1 + p)."""
    before, here = (np.asarray((piece.tie[:, at : at + m]).toarray()) for at in (0, m))  # type: ignore[index]
    led = before @ paths[0]
    return np.concatenate([led[:, -m:], here, led[:, :-m]], axis=1)


def _tie_defects(problem: Quadratic, spans: tuple[Span, ...]) -> FloatArray:
    """[c C] where the ties stand, (ties, n_states, 1 + p)."""
    return np.concatenate([problem.defects(slice(s.first, s.first + 1)) for s in spans if s.reset])[1:]


def _unit(m: int, columns: int, free: int, at: int) -> FloatArray:
    """A reset's first states as unknowns: (m, columns + free)."""
    found = np.zeros((m, columns + free))
    found[:, columns + at : columns + at + m] = np.eye(m)
    return found


def _known_start(problem: Quadratic) -> BoolArray:
    """Which initial states have a Gaussian prior, (n_states,)."""
    return np.asarray(np.isfinite(problem.variance[0]) & (problem.variance[0] > 0.0))


def _strayed(problem: Quadratic, start: FloatArray) -> FloatArray:
    """The initial state's distance from its prior mean in standard deviations, (n_states, 1 + p); 0 without one."""
    known = _known_start(problem)
    found = np.zeros_like(start)
    away = start + problem.defects(slice(0, 1))[0]
    found[known] = away[known] / np.sqrt(problem.variance[0, known])[:, None]
    return found
