"""A moment that may be anything smooth, in shapes that any body has: for the noise, and for what is not in the list.

The shapes are the lowest of the expansion of a body's moment in its crossflow (Maple and Synge, Quart. Appl. Math. 6,
1949): on a body of n-fold symmetry the moment of the flow from the other side turns n times with the meridian. Each
is multiplied by splines in time.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from scipy.interpolate import BSpline

from brv_hypo.arrays import ComplexArray, FloatArray
from brv_hypo.constants import FREE_FEWEST_SPLINES, FREE_MOST_SPLINES, FREE_ROWS_PER_COLUMN
from brv_hypo.inference.problem import Problem
from brv_hypo.linearisation.frame import RateFrame
from brv_hypo.mechanisms.contract import Mechanism, Term
from brv_hypo.model.term import Regressor, TimeBasis
from brv_hypo.motion.motion import Motion

Shape = Callable[[Motion], tuple[ComplexArray, ...]]

# The parameter that tells which shape.
_SHAPE = "shape"


def _power(power: int, factor: complex = 1.0) -> Shape:
    """Of the windward plane: C_N' for a real factor, C_Z' for an imaginary one."""
    return lambda motion: (np.asarray(factor * motion.alpha**power, dtype=complex),)


def _harmonic(power: int, turns: int) -> Shape:
    """Turning with the meridian, in both directions of the body."""

    def shape(motion: Motion) -> tuple[ComplexArray, ...]:
        turned = motion.alpha**power * np.exp(1j * turns * motion.windward_meridian)
        return turned, 1j * turned

    return shape


def _rate(factor: complex) -> Shape:
    """In proportion to the transverse rates, or to them a quarter turn on."""
    return lambda motion: (np.asarray(factor * motion.plane_rates, dtype=complex),)


_ORDINARY: dict[str, Shape] = {
    "offset": _power(0),
    "stiffness": _power(1),
    "side moment": _power(1, 1j),
    "body-fixed": _harmonic(0, 1),
    "pitch damping": _rate(1.0),
}
_UNUSUAL: dict[str, Shape] = {
    "side offset": _power(0, 1j),
    "nonlinear stiffness": _power(2),
    "nonlinear side moment": _power(2, 1j),
    "cross damping": _rate(1j),
    "two-fold": _harmonic(1, 2),
    "three-fold": _harmonic(2, 3),
}
_SHAPES = {**_ORDINARY, **_UNUSUAL}
# What moves most vehicles: the noise is what these leave.
ORDINARY = tuple(_ORDINARY)
SHAPES = tuple(_SHAPES)


def shape_of(name: str, motion: Motion) -> tuple[ComplexArray, ...]:
    """The components C_N' + i C_Z' (n,) of a shape on a motion, per unit of each coefficient."""
    return _SHAPES[name](motion)


class FreeMoment(Mechanism):
    """Some of the shapes, each times splines in time; `theta` tells which one: all at once would be large."""

    name = "free_moment"
    title = "a moment that is free but smooth"
    claims = "nothing specific: any moment that moved the vehicle"
    source = "Maple and Synge 1949; nonparametric regression"
    time_variation = ("constant",)

    start: float
    stop: float
    splines: int
    shapes: tuple[str, ...]

    def terms(self, motion: Motion, theta: Mapping[str, float]) -> tuple[Term, ...]:
        """One shape times each spline."""
        name = self.shapes[int(theta[_SHAPE])]
        splines = self._splines(motion.coefficient_time)
        return tuple(
            Term(f"{name} {part} {k}", values.real * spline, values.imag * spline)
            for part, values in enumerate(shape_of(name, motion))
            for k, spline in enumerate(splines.T)
        )

    def _splines(self, time: FloatArray) -> FloatArray:
        """Cubic B-splines (n, splines) over the span."""
        inner = np.linspace(self.start, self.stop, self.splines - 2)
        knots = np.concatenate([[inner[0]] * 3, inner, [inner[-1]] * 3])
        return np.asarray(BSpline.design_matrix(np.clip(time, self.start, self.stop), knots, 3).toarray())


def free_moment(problem: Problem, shapes: tuple[str, ...] = ORDINARY) -> tuple[RateFrame, tuple[Regressor, ...]]:
    """The problem's frame with a free moment of these shapes, and that moment's columns."""
    time, motion = problem.frame.coefficient_time, problem.frame.motions[0]
    parts = {name: len(shape_of(name, motion)) for name in SHAPES}
    rows = problem.frame.observed.size * 2
    wanted = rows / (FREE_ROWS_PER_COLUMN * sum(parts[name] for name in ORDINARY))
    count = int(np.clip(wanted, FREE_FEWEST_SPLINES, FREE_MOST_SPLINES))
    free = FreeMoment(start=float(time.min()), stop=float(time.max()), splines=count, shapes=shapes)
    always = TimeBasis("constant")
    columns = tuple(
        Regressor(free.name, f"{name} {part} {k}", ((_SHAPE, float(number)),), always, "1")
        for number, name in enumerate(shapes)
        for part in range(parts[name])
        for k in range(count)
    )
    return problem.frame.with_mechanisms([free]), columns
