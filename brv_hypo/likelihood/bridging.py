"""Long gaps, in which nothing was measured: fitted around first, then bridged by the model.

Across a gap the outputs give no states to start from, and a straight line through a motion that turns many times
leads the search astray. The stretches between gaps, each with an initial state of its own, tell theta; with it the
motion is carried on from the last state before the gap.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.likelihood.collocation import Model
from brv_hypo.likelihood.derivatives import Points, evaluate
from brv_hypo.likelihood.interpolation import WIDTH
from brv_hypo.likelihood.segment import Grid, Segment, build_grid, inputs_of, with_history

_LONG = 8
"""Times the usual distance of measured samples from which a gap is bridged."""
_LEAST = 2 * WIDTH
"""Samples of a stretch at least."""
_TOO_FAR = 10.0
"""Times the largest measured state at which the motion across a gap is not believed."""


@dataclass(frozen=True)
class Stretch:
    """Samples first to last of a segment, both measured."""

    number: int
    first: int
    last: int


def stretches(segments: Sequence[Segment]) -> tuple[Stretch, ...]:
    """What lies between long gaps; empty where no segment has one."""
    found = []
    gaps = 0
    for number, segment in enumerate(segments):
        seen = np.flatnonzero(np.isfinite(np.atleast_2d(segment.y)).any(axis=0))
        apart = np.diff(seen)
        wide = np.flatnonzero(apart > _LONG * np.median(apart)) if apart.size else apart
        gaps += wide.size
        edges = [0, *(wide + 1).tolist(), seen.size]
        spans = [(int(seen[a]), int(seen[b - 1])) for a, b in pairwise(edges)]
        found += [Stretch(number, a, b) for a, b in spans if b - a + 1 >= _LEAST]
    return tuple(found) if gaps else ()


def pieces_of(segments: Sequence[Segment], between: Sequence[Stretch]) -> list[Segment]:
    """The stretches as segments, their initial states free but where a segment's own is known."""
    found = []
    for stretch in between:
        segment = segments[stretch.number]
        where = slice(stretch.first, stretch.last + 1)
        x0 = np.asarray(segment.x0, dtype=float)
        found.append(
            replace(
                segment,
                t=np.asarray(segment.t)[where],
                u=inputs_of(segment)[:, where],
                y=np.atleast_2d(segment.y)[:, where],
                x0=x0[:, where] if x0.ndim == 2 else x0,
                x0_std=segment.x0_std if stretch.first == 0 else np.inf,
                u_mid=None if segment.u_mid is None else segment.u_mid[:, stretch.first : stretch.last],
            )
        )
    return found


def bridged(
    segments: Sequence[Segment],
    between: Sequence[Stretch],
    times: Sequence[FloatArray],
    states: Sequence[FloatArray],
    model: Model,
    theta: Mapping[str, float],
) -> list[Segment]:
    """The segments with histories: the states of each stretch, (n_states, n) at `times`, and the motion between."""
    found = []
    for number, segment in enumerate(segments):
        grid = build_grid(segment, number)
        t = grid.t[: grid.n]
        own = [i for i, stretch in enumerate(between) if stretch.number == number]
        if not own:
            found.append(segment)
            continue
        known = np.concatenate([states[i] for i in own], axis=1)
        at = np.concatenate([times[i] for i in own])
        x = np.stack([np.interp(t, at, row) for row in known])
        for i, following in zip(own, [*own[1:], None], strict=True):
            stop = grid.n if following is None else between[following].first
            carried = _carried(model, grid, x, between[i].last, stop, theta)
            if np.all(np.abs(carried) < _TOO_FAR * np.abs(known).max(axis=1, keepdims=True)):
                x[:, between[i].last : stop] = carried
        found.append(with_history(segment, x))
    return found


def _carried(
    model: Model, grid: Grid, x: FloatArray, first: int, stop: int, theta: Mapping[str, float]
) -> FloatArray:
    """States from sample `first` to before `stop` by Runge-Kutta steps from the first, (n_states, stop - first)."""
    found = x[:, first:stop].copy()

    def slope(state: FloatArray, at: int) -> FloatArray:
        where = slice(at, at + 1)
        courses = tuple(course.part(where) for course in grid.courses)
        points = Points(state[:, None], grid.u[:, where], grid.t[where], courses=courses)
        return evaluate(model.dynamics, points, theta)[:, 0]

    with np.errstate(all="ignore"):
        for k in range(found.shape[1] - 1):
            at, now, h = first + k, found[:, k], grid.step[first + k]
            end = 2 * grid.n - 1 + at if grid.jumps else at + 1
            k1 = slope(now, at)
            k2 = slope(now + h / 2 * k1, grid.n + at)
            k3 = slope(now + h / 2 * k2, grid.n + at)
            k4 = slope(now + h * k3, end)
            found[:, k + 1] = now + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return found
