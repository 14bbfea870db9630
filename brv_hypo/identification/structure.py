"""The model's parameters: one coefficient a column, and what moves columns: delays, other thetas, knots."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.likelihood import Course
from brv_hypo.mechanisms.contract import Mechanism
from brv_hypo.model.columns import Column
from brv_hypo.motion.smoothing import InputError

Kind = Literal["theta", "start", "stop"]


@dataclass(frozen=True)
class Mover:
    """A nonlinear parameter and the columns that it moves: a theta of a mechanism, or a knot (s).

    `value` and `bounds` are `scale` times those in `units`: delays are estimated in s.
    """

    name: str
    kind: Kind
    theta: str
    mechanism: str
    value: float
    bounds: tuple[float, float]
    units: str
    is_delay: bool
    columns: tuple[int, ...]
    scale: float = 1.0

    @property
    def label(self) -> str:
        """Its name without its start value."""
        return f"{self.mechanism} {self.theta or self.kind}"


@dataclass(frozen=True)
class Structure:
    """The columns of a regression model with names for all that is to be estimated.

    `names` are those of the coefficients, in the order of `columns`.
    """

    columns: tuple[Column, ...]
    names: tuple[str, ...]
    movers: tuple[Mover, ...]

    @cached_property
    def delays(self) -> tuple[str, ...]:
        """Names of the parameters that are delays."""
        return tuple(mover.name for mover in self.movers if mover.is_delay)

    @cached_property
    def knots(self) -> tuple[str, ...]:
        """Names of the parameters that are knots."""
        return tuple(mover.name for mover in self.movers if mover.kind != "theta")

    def at(self, theta: Mapping[str, float]) -> tuple[Column, ...]:
        """The columns with delays and knots at the values in `theta`; those it lacks stay where they were."""
        columns = list(self.columns)
        for mover in self.movers:
            value = theta.get(mover.name, mover.value)
            for j in mover.columns:
                columns[j] = _moved(columns[j], mover, value)
        return tuple(columns)

    def values(self, theta: Mapping[str, float]) -> FloatArray:
        """Coefficients (columns,) in `theta`."""
        return np.array([theta[name] for name in self.names])


def structure_of(
    columns: Sequence[Column], mechanisms: Mapping[str, Mechanism], start: float, stop: float, refine: bool
) -> Structure:
    """Name the parameters; knots are free between `start` and `stop` (s), where they lie inside.

    Columns that share a theta or a knot of one mechanism move together.
    """
    movers = _movers(columns, mechanisms, start, stop) if refine else ()
    return Structure(tuple(columns), unique([_name(column) for column in columns]), movers)


def _name(column: Column) -> str:
    name = f"{column.mechanism} {column.term}"
    if column.course.kind != "constant":
        name += f" {column.course.kind} at {column.course.start:.6g} s"
    if column.delay is not None:
        name += f", delay {column.delay:.6g} s"
    return name


def unique(names: Sequence[str]) -> tuple[str, ...]:
    """The names, a number after each that stood before."""
    seen: dict[str, int] = {}
    out = []
    for name in names:
        seen[name] = seen.get(name, 0) + 1
        out.append(name if seen[name] == 1 else f"{name} ({seen[name]})")
    return tuple(out)


def of_flight(name: str, flight: int) -> str:
    """The parameter's name for one flight: each flight has its own instruments."""
    return f"{name} [flight {flight}]"


def input_course(error: InputError, flight: int) -> Course:
    """What smoothing left of an input's noise, as the course by whose name the equations of motion know it."""
    name = of_flight(error.name, flight)
    return Course(name, tuple(f"{name} {k}" for k in range(error.count)), error.shapes)


def _movers(
    columns: Sequence[Column], mechanisms: Mapping[str, Mechanism], start: float, stop: float
) -> tuple[Mover, ...]:
    groups: dict[tuple[Kind, str, str, float], list[int]] = {}
    for j, column in enumerate(columns):
        for name, value in column.theta:
            groups.setdefault(("theta", column.mechanism, name, value), []).append(j)
        knots: tuple[tuple[Kind, float], ...] = (("start", column.course.start), ("stop", column.course.stop))
        for kind, knot in knots:
            if start < knot < stop:
                groups.setdefault((kind, column.mechanism, "", knot), []).append(j)
    found = [
        _mover(kind, mechanisms[mechanism], theta, value, (start, stop), tuple(members))
        for (kind, mechanism, theta, value), members in groups.items()
    ]
    names = unique([mover.name for mover in found])
    return tuple(replace(mover, name=name) for mover, name in zip(found, names, strict=True))


def _mover(
    kind: Kind,
    mechanism: Mechanism,
    theta: str,
    value: float,
    span: tuple[float, float],
    columns: tuple[int, ...],
) -> Mover:
    if kind != "theta":
        name = f"{mechanism.name} {kind} {value:.6g} s"
        return Mover(name, kind, "", mechanism.name, value, span, "s", False, columns)
    parameter = next(p for p in mechanism.parameters() if p.name == theta)
    scale = parameter.seconds if parameter.is_delay else 1.0
    bounds = (scale * min(parameter.bounds[0], value), scale * max(parameter.bounds[1], value))
    name = f"{mechanism.name} {theta} {value:.6g}"
    return Mover(
        name,
        kind,
        theta,
        mechanism.name,
        scale * value,
        bounds,
        parameter.units,
        parameter.is_delay,
        columns,
        scale,
    )


def _moved(column: Column, mover: Mover, value: float) -> Column:
    if mover.kind == "theta":
        theta = tuple((key, value / mover.scale if key == mover.theta else old) for key, old in column.theta)
        return replace(column, theta=theta)
    if mover.kind == "start":
        return replace(column, course=replace(column.course, start=value))
    return replace(column, course=replace(column.course, stop=value))
