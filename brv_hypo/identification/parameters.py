"""What the likelihood estimates of a regression model: a coefficient for each regressor, and what moves regressors.

Nonlinear parameters are the delays and other thetas of mechanisms and the knots (s) at which coefficients
change. `structure_of` names all of them; `Structure.at` has the regressors at given values.

A knot between two nodes is integrated as if it were on one. Hermite-Simpson weighs the ends of an interval by
1/6 and its middle by 4/6, and assumes that all is smooth. Where a moment g(t) jumps in within the interval, the
middle is given the value that makes the rule exact for a quadratic g: with a and b of `kink`, the rate of the
angular rate there is (`on_grid`) g - a g' + b g'', and the angular rate itself gains a g - 2 b g'. The states at
the nodes are then those of the sharp jump, and smooth in the time of the knot.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np

from brv_hypo.arrays import BoolArray, FloatArray
from brv_hypo.likelihood import TimeVaryingParameter
from brv_hypo.mechanisms.contract import Mechanism
from brv_hypo.model.common_time import OwnTime
from brv_hypo.model.term import Regressor, TimeBasis
from brv_hypo.motion.signals import InputError

Kind = Literal["theta", "start", "stop"]


@dataclass(frozen=True)
class NonlinearParameter:
    """A nonlinear parameter and the columns that it moves: a theta of a mechanism, or a knot (s)."""

    name: str
    kind: Kind
    theta: str
    """Its name in theta; empty for a knot."""
    mechanism: str
    value: float
    """`scale` times that in `units`, as are the bounds: delays are estimated in s."""
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

    columns: tuple[Regressor, ...]
    names: tuple[str, ...]
    nonlinear_parameters: tuple[NonlinearParameter, ...]

    @cached_property
    def delays(self) -> tuple[str, ...]:
        """Names of the parameters that are delays."""
        return tuple(parameter.name for parameter in self.nonlinear_parameters if parameter.is_delay)

    @cached_property
    def knots(self) -> tuple[str, ...]:
        """Names of the parameters that are knots."""
        return tuple(parameter.name for parameter in self.nonlinear_parameters if parameter.kind != "theta")

    def at(self, theta: Mapping[str, float]) -> tuple[Regressor, ...]:
        """The columns with delays and knots at the values in `theta`; those it lacks stay where they were."""
        columns = list(self.columns)
        for parameter in self.nonlinear_parameters:
            value = theta.get(parameter.name, parameter.value)
            for j in parameter.columns:
                columns[j] = _moved(columns[j], parameter, value)
        return tuple(columns)

    def values(self, theta: Mapping[str, float]) -> FloatArray:
        """Coefficients (columns,) in `theta`."""
        return np.array([theta[name] for name in self.names])


def structure_of(
    columns: Sequence[Regressor], mechanisms: Mapping[str, Mechanism], start: float, stop: float
) -> Structure:
    """Name the parameters; knots are free between `start` and `stop` (s), where they lie inside.

    Columns that share a theta or a knot of one mechanism move together.
    """
    names = unique([_name(column) for column in columns])
    return Structure(tuple(columns), names, _nonlinear_parameters(columns, mechanisms, start, stop))


def _name(column: Regressor) -> str:
    """Mechanism and term, and where it begins and looks back to."""
    name = f"{column.mechanism} {column.term}"
    if column.time_basis.kind != "constant":
        name += f" {column.time_basis.kind} at {column.time_basis.start:.6g} s"
    if column.delay is not None:
        name += f", delay {column.delay:.6g} s"
    return name


def unique(names: Sequence[str]) -> tuple[str, ...]:
    """The names, a number after each that stood before."""
    counts: dict[str, int] = {}
    out = []
    for name in names:
        counts[name] = counts.get(name, 0) + 1
        out.append(name if counts[name] == 1 else f"{name} ({counts[name]})")
    return tuple(out)


def of_flight(name: str, flight: int) -> str:
    """The parameter's name for one flight: each flight has its own instruments."""
    return f"{name} [flight {flight}]"


def input_error(error: InputError, flight: int) -> TimeVaryingParameter:
    """What smoothing left of an input's noise, under the name by which the equations of motion have it."""
    name = of_flight(error.name, flight)
    return TimeVaryingParameter(name, tuple(f"{name} {k}" for k in range(error.count)), error.shapes)


def _nonlinear_parameters(
    columns: Sequence[Regressor], mechanisms: Mapping[str, Mechanism], start: float, stop: float
) -> tuple[NonlinearParameter, ...]:
    groups: dict[tuple[Kind, str, str, float], list[int]] = {}
    for j, column in enumerate(columns):
        for name, value in column.theta:
            groups.setdefault(("theta", column.mechanism, name, value), []).append(j)
        knots: tuple[tuple[Kind, float], ...] = (("start", column.time_basis.start), ("stop", column.time_basis.stop))
        for kind, knot in knots:
            if start < knot < stop:
                groups.setdefault((kind, column.mechanism, "", knot), []).append(j)
    found = []
    for (kind, mechanism, theta, value), members in groups.items():
        units, scale, bounds, is_delay = "s", 1.0, (start, stop), False
        if kind == "theta":
            own = next(p for p in mechanisms[mechanism].parameters() if p.name == theta)
            units, is_delay = own.units, own.is_delay
            scale = own.seconds if is_delay else 1.0
            bounds = (scale * min(own.bounds[0], value), scale * max(own.bounds[1], value))
        found.append(
            NonlinearParameter(
                name=f"{mechanism} {theta} {value:.6g}" if theta else f"{mechanism} {kind} {value:.6g} s",
                kind=kind,
                theta=theta,
                mechanism=mechanism,
                value=scale * value,
                bounds=bounds,
                units=units,
                is_delay=is_delay,
                columns=tuple(members),
                scale=scale,
            )
        )
    names = unique([parameter.name for parameter in found])
    return tuple(replace(parameter, name=name) for parameter, name in zip(found, names, strict=True))


def _moved(column: Regressor, parameter: NonlinearParameter, value: float) -> Regressor:
    if parameter.kind == "theta":
        theta = tuple((key, value / parameter.scale if key == parameter.theta else old) for key, old in column.theta)
        return replace(column, theta=theta)
    if parameter.kind == "start":
        return replace(column, time_basis=replace(column.time_basis, start=value))
    return replace(column, time_basis=replace(column.time_basis, stop=value))


_ROUNDING = 1e-9


def placed(
    time_basis: TimeBasis, time: FloatArray, half: FloatArray, own: OwnTime | None
) -> tuple[TimeBasis, FloatArray, FloatArray]:
    """A time basis, times and intervals that go together, where time bases are in a time that flights share.

    What jumps does so at the flight's own time; what ramps does so with the common one, whose pace about a knot is
    taken as constant.
    """
    if own is None:
        return time_basis, time, half
    if time_basis.kind == "ramp":
        return time_basis, own.common_at(time), half * own.pace_at(time)
    return replace(time_basis, start=own.own_at(time_basis.start), stop=own.own_at(time_basis.stop)), time, half


def on_grid(time_basis: TimeBasis, time: FloatArray, half: FloatArray) -> FloatArray:
    """The course at `time` (n,) s; `half` (n,) s is half the interval at its midpoints, 0 at nodes."""
    edge = _ramp if time_basis.kind == "ramp" else _step
    value = np.ones_like(time) if np.isneginf(time_basis.start) else edge(time - time_basis.start, half)
    return value if np.isposinf(time_basis.stop) else value - edge(time - time_basis.stop, half)


def averaged(time_basis: TimeBasis, time: FloatArray, width: FloatArray | float) -> FloatArray:
    """Mean of the course over `width` s about `time` (n,) s: what a block of samples sees of it."""
    if time_basis.kind == "ramp":
        return time_basis(time)
    share = np.ones_like(time)
    if np.isfinite(time_basis.start):
        share = np.clip((time - time_basis.start) / width + 0.5, 0.0, 1.0)
    if np.isfinite(time_basis.stop):
        share = share - np.clip((time - time_basis.stop) / width + 0.5, 0.0, 1.0)
    return np.asarray(share)


def kink(time_basis: TimeBasis, time: FloatArray, half: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The weights a (n,) s and b (n,) s^2 in the middle of the interval of a jump; 0 elsewhere."""
    first, second = np.zeros_like(time), np.zeros_like(time)
    if time_basis.kind == "ramp":
        return first, second
    for knot, sign in ((time_basis.start, 1.0), (time_basis.stop, -1.0)):
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
