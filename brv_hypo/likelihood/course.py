"""Quantities that vary along a record as known shapes, whose weights are parameters.

A drift, or the error that smoothing leaves in an input, has several parameters that act through one quantity
at each instant. Its derivative is had once; those of the weights are the shapes times it. A weight of several
courses acts through all of them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from brv_hypo.arrays import FloatArray, IntArray
from brv_hypo.errors import UsageError


@dataclass(frozen=True)
class Course:
    """theta[name] (n,) = sum over j of theta[weights[j]] shapes(t)[j], as the user's functions see it.

    Attributes:
        name: under which dynamics and outputs find the values, at their own samples; no parameter has it.
        weights: names of parameters that act through courses only: this one and others.
        shapes: t (n,), s -> (len(weights), n).
    """

    name: str
    weights: tuple[str, ...]
    shapes: Callable[[FloatArray], FloatArray]

    def at(self, t: FloatArray, theta: Mapping[str, float]) -> FloatArray:
        """Its value (n,) at times t (n,), s."""
        return np.array([theta[weight] for weight in self.weights]) @ self.shapes(t)


@dataclass(frozen=True)
class SampledCourse:
    """A course at some instants: `shapes` is (len(weights), n)."""

    name: str
    weights: tuple[str, ...]
    shapes: FloatArray

    def at(self, theta: Mapping[str, Any]) -> Any:
        """Its value (n,)."""
        return np.array([theta[weight] for weight in self.weights]) @ self.shapes

    def part(self, where: slice | IntArray) -> SampledCourse:
        """Some of the instants."""
        return SampledCourse(self.name, self.weights, self.shapes[:, where])


def sampled(courses: tuple[Course, ...], t: FloatArray, number: int) -> tuple[SampledCourse, ...]:
    """The courses at times t (n,), s.

    Raises:
        UsageError: shapes of the wrong size.
    """
    found = []
    for course in courses:
        shapes = np.asarray(course.shapes(t), dtype=float)
        expected = (len(course.weights), t.size)
        if shapes.shape != expected:
            raise UsageError(
                f"segment {number}: the shapes of course {course.name!r} are {shapes.shape}; expected {expected}, "
                "one row for each weight and one column for each time"
            )
        found.append(SampledCourse(course.name, course.weights, shapes))
    return tuple(found)
