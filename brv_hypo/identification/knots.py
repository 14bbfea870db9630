"""Courses in time on a collocation grid: a knot between two nodes is integrated as if it stood on a node.

Hermite-Simpson weighs the ends of an interval by 1/6 and its middle by 4/6, and takes all to be smooth. Where
a moment g(t) jumps in within the interval, the middle is given what makes the rule exact for a quadratic g.
With a and b of `kink`, the rate of the angular rate there is (`on_grid`) g - a g' + b g'', and the angular
rate itself gains a g - 2 b g'. The states at the nodes are then those of the sharp course, and smooth in the
time of the knot.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from brv_hypo.arrays import BoolArray, FloatArray
from brv_hypo.model.common_time import OwnTime
from brv_hypo.model.time_variation import TimeFunction

_ROUNDING = 1e-9


def placed(
    course: TimeFunction, time: FloatArray, half: FloatArray, own: OwnTime | None
) -> tuple[TimeFunction, FloatArray, FloatArray]:
    """A course, times and intervals that go together, where courses are told in a time that flights share.

    What jumps does so at the flight's own time; what ramps does so with the common one, whose pace about a knot is
    taken as constant.
    """
    if own is None:
        return course, time, half
    if course.kind == "ramp":
        return course, own.common_at(time), half * own.pace_at(time)
    return replace(course, start=own.own_at(course.start), stop=own.own_at(course.stop)), time, half


def on_grid(course: TimeFunction, time: FloatArray, half: FloatArray) -> FloatArray:
    """The course at `time` (n,) s; `half` (n,) s is half the interval at its midpoints, 0 at nodes."""
    edge = _ramp if course.kind == "ramp" else _step
    value = np.ones_like(time) if np.isneginf(course.start) else edge(time - course.start, half)
    return value if np.isposinf(course.stop) else value - edge(time - course.stop, half)


def averaged(course: TimeFunction, time: FloatArray, width: FloatArray | float) -> FloatArray:
    """Mean of the course over `width` s about `time` (n,) s: what a block of samples sees of it."""
    if course.kind == "ramp":
        return course(time)
    share = np.ones_like(time)
    if np.isfinite(course.start):
        share = np.clip((time - course.start) / width + 0.5, 0.0, 1.0)
    if np.isfinite(course.stop):
        share = share - np.clip((time - course.stop) / width + 0.5, 0.0, 1.0)
    return np.asarray(share)


def kink(course: TimeFunction, time: FloatArray, half: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The weights a (n,) s and b (n,) s^2 in the middle of the interval of a jump; 0 elsewhere."""
    first, second = np.zeros_like(time), np.zeros_like(time)
    if course.kind == "ramp":
        return first, second
    for knot, sign in ((course.start, 1.0), (course.stop, -1.0)):
        if np.isfinite(knot):
            inside = _holds_knot(time - knot, half)
            step = 2.0 * half[inside]
            off = (time[inside] - knot) / step
            first[inside] += sign * step / 4.0 * (3.0 * off**2 - 0.25)
            second[inside] += sign * step**2 / 4.0 * off**3
    return first, second


def _step(since: FloatArray, half: FloatArray) -> FloatArray:
    sharp = (since >= -_ROUNDING).astype(float)
    inside = _holds_knot(since, half)
    share = (since[inside] + half[inside]) / (2.0 * half[inside])
    sharp[inside] = (6.0 * share - 1.0) / 4.0
    return sharp


def _ramp(since: FloatArray, half: FloatArray) -> FloatArray:
    sharp = np.maximum(since, 0.0)
    inside = _holds_knot(since, half)
    end = since[inside] + half[inside]
    sharp[inside] = (3.0 * end**2 / (2.0 * half[inside]) - end) / 4.0
    return sharp


def _holds_knot(since: FloatArray, half: FloatArray) -> BoolArray:
    """Midpoints whose interval holds the knot; a knot on a node belongs to the interval that it ends."""
    return np.asarray((half > 0.0) & (since >= -half - _ROUNDING) & (since < half - _ROUNDING))
