"""Columns of the regression: which coefficient, of which mechanism, with which course in time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.mechanisms.contract import Mechanism
from brv_hypo.model.time_variation import TimeFunction
from brv_hypo.motion.motion import Motion

BASELINE = "baseline"
Theta = tuple[tuple[str, float], ...]


@dataclass(frozen=True)
class Column:
    """One candidate: a term of a mechanism at theta, with a course in time.

    `tied`: the terms of this course are components of one vector and enter together. `delay_name`: which parameter of
    theta the mechanism declares to be a delay. `flight`: the one flight of several that it acts on; None for all.
    """

    mechanism: str
    term: str
    theta: Theta
    course: TimeFunction
    units: str
    tied: bool = False
    delay_name: str | None = field(default=None, compare=False)
    flight: int | None = None

    @property
    def vector(self) -> tuple[str, Theta, TimeFunction]:
        """What the components of one vector share, on one flight."""
        return (self.mechanism, self.theta, self.course)

    @property
    def choice(self) -> tuple[str, str | None, Theta, TimeFunction, int | None]:
        """What is chosen with the column: a vector's components are one choice, on each flight."""
        return (self.mechanism, None if self.tied else self.term, self.theta, self.course, self.flight)

    def acts_on(self, flight: int) -> bool:
        """Whether it is part of the moments of that flight."""
        return self.flight is None or self.flight == flight

    def at(self, theta: Theta, course: TimeFunction) -> Column:
        """The column at another theta, or with another course."""
        return Column(
            self.mechanism, self.term, theta, course, self.units, self.tied, self.delay_name, self.flight
        )

    @property
    def delay(self) -> float | None:
        """The delay of the term in s, None where it has none."""
        return None if self.delay_name is None else dict(self.theta).get(self.delay_name)

    @property
    def label(self) -> str:
        """The name of the coefficient in tables: what changes, and how."""
        if self.course.kind == "constant":
            return self.term
        return f"{self.course.kind} in {self.term}"


def delay_name(mechanism: Mechanism) -> str | None:
    """The parameter of the mechanism that is a delay, the first where there are several; None where none is."""
    return next((parameter.name for parameter in mechanism.parameters() if parameter.is_delay), None)


def default_knots(start: float, stop: float, count: int) -> FloatArray:
    """`count` times between start and stop (s), evenly spaced, the ends left out."""
    return np.linspace(start, stop, count + 2)[1:-1]


def theta_grid(mechanism: Mechanism, *, dense: bool = False) -> tuple[Theta, ...]:
    """Every point of the grid of nonlinear parameters; one empty point where there is none.

    `dense` adds the geometric mean of neighbouring positive values.
    """
    points: list[dict[str, float]] = [{}]
    for parameter in mechanism.parameters():
        grid = np.asarray(parameter.grid, dtype=float)
        if dense and np.all(grid > 0.0):
            grid = np.sort(np.concatenate([grid, np.sqrt(grid[:-1] * grid[1:])]))
        points = [{**point, parameter.name: float(value)} for point in points for value in grid]
    return tuple(tuple(point.items()) for point in points)


def courses(mechanism: Mechanism, knots: FloatArray) -> tuple[TimeFunction, ...]:
    """The courses in time that the mechanism's coefficients may take (Eq. 3.6)."""
    found: list[TimeFunction] = []
    for kind in mechanism.time_variation:
        starts: Sequence[float] = (-np.inf,) if kind == "constant" else [float(knot) for knot in knots]
        found.extend(TimeFunction(kind, start) for start in starts)
    return tuple(found)


def candidates(
    mechanism: Mechanism, motion: Motion, knots: FloatArray, thetas: Sequence[Theta]
) -> tuple[Column, ...]:
    """All columns of a mechanism: theta x course x term; the motion tells only which terms there are."""
    terms = [(term.name, term.units) for term in mechanism.terms(motion, dict(thetas[0]))]
    delay = delay_name(mechanism)
    return tuple(
        Column(
            mechanism.name, name, theta, course, course.units(units), mechanism.terms_enter_together, delay
        )
        for theta in thetas
        for course in courses(mechanism, knots)
        for name, units in terms
    )
