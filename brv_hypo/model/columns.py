"""Columns of the regression: which coefficient, of which mechanism, with which course in time."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.mechanisms.contract import Mechanism, Parameter, Term
from brv_hypo.model.time_variation import TimeFunction
from brv_hypo.motion.motion import Motion

BASELINE = "baseline"
Theta = tuple[tuple[str, float], ...]
Vector = tuple[str, str | None, Theta, TimeFunction]


@dataclass(frozen=True)
class Column:
    """One candidate: a term of a mechanism at theta, with a course in time.

    `tied`: the terms of this course are components of one vector and enter together, those of the vector `part_of`
    where the mechanism has several. `late_by`: those parameters of theta that the mechanism declares to be delays.
    `flight`: the one flight of several that it acts on; None for all.
    """

    mechanism: str
    term: str
    theta: Theta
    course: TimeFunction
    units: str
    tied: bool = False
    late_by: tuple[Parameter, ...] = field(default=(), compare=False)
    flight: int | None = None
    part_of: str | None = None

    @property
    def vector(self) -> Vector:
        """What the components of one vector share, on one flight."""
        return (self.mechanism, self.part_of, self.theta, self.course)

    @property
    def choice(self) -> tuple[str, str | None, Theta, TimeFunction, int | None]:
        """What is chosen with the column: a vector's components are one choice, on each flight."""
        return (self.mechanism, self.part_of if self.tied else self.term, self.theta, self.course, self.flight)

    def acts_on(self, flight: int) -> bool:
        """Whether it is part of the moments of that flight."""
        return self.flight is None or self.flight == flight

    def at(self, theta: Theta, course: TimeFunction) -> Column:
        """The column at another theta, or with another course."""
        kept = (self.units, self.tied, self.late_by, self.flight, self.part_of)
        return Column(self.mechanism, self.term, theta, course, *kept)  # `replace` takes several times as long

    @property
    def delays(self) -> tuple[float, ...]:
        """The delays of the term, s."""
        theta = dict(self.theta)
        return tuple(theta[late.name] * late.seconds for late in self.late_by if late.name in theta)

    @property
    def delay(self) -> float | None:
        """The delay of the term in s, the first where there are several; None where it has none."""
        return next(iter(self.delays), None)

    @property
    def label(self) -> str:
        """The name of the coefficient in tables: what changes, and how."""
        if self.course.kind == "constant":
            return self.term
        return f"{self.course.kind} in {self.term}"


def delays_among(parameters: Iterable[Parameter]) -> tuple[Parameter, ...]:
    """Those that are delays."""
    return tuple(parameter for parameter in parameters if parameter.is_delay)


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
    terms = mechanism.terms(motion, dict(thetas[0]))
    return tuple(
        term_column(mechanism, term, theta, course)
        for theta in thetas
        for course in courses(mechanism, knots)
        for term in terms
    )


def term_column(
    mechanism: Mechanism, term: Term, theta: Theta, course: TimeFunction, flight: int | None = None
) -> Column:
    """The column of one of a mechanism's terms at a theta, with a course in time."""
    return Column(
        mechanism.name,
        term.name,
        theta,
        course,
        course.units(term.units),
        mechanism.terms_enter_together or term.vector is not None,
        delays_among(mechanism.parameters()),
        flight,
        term.vector,
    )
