"""States and inputs at some instants, and what the coefficients multiply there."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Generic, TypeVar

import numpy as np

from brv_hypo.arrays import ComplexArray, FloatArray
from brv_hypo.identification.knots import averaged, kink, on_grid, placed
from brv_hypo.identification.nodes import ROW, SLOPES, has_knot
from brv_hypo.model.columns import Column
from brv_hypo.model.common_time import OwnTime
from brv_hypo.motion.motion import Motion

_REMEMBERED = 6
T = TypeVar("T")


@dataclass(frozen=True)
class Point:
    """States and inputs at some instants (n,), as complex pairs; `time` s."""

    time: FloatArray
    omega: ComplexArray
    zeta: ComplexArray
    u: FloatArray

    def input(self, name: str) -> FloatArray:
        """One input (n,)."""
        return np.asarray(self.u[ROW[name]])

    @cached_property
    def to_body(self) -> ComplexArray:
        """exp(-i Phi): turns de-rolled pairs into body axes."""
        return np.asarray(np.exp(-1j * self.input("roll")))


def point(x: FloatArray, u: FloatArray, time: FloatArray) -> Point:
    """States (4, n) and inputs as pairs."""
    return Point(time, x[0] + 1j * x[1], x[2] + 1j * x[3], u)


class Memory(Generic[T]):
    """The last few results by key: most parameters leave the columns as they are, and a moved state only one
    motion.
    """

    def __init__(self) -> None:
        self._known: OrderedDict[tuple[object, ...], T] = OrderedDict()

    def __call__(self, key: tuple[object, ...], compute: Callable[[], T]) -> T:
        """The result for `key`, computed where it is not known."""
        if key not in self._known:
            self._known[key] = compute()
            if len(self._known) > _REMEMBERED:
                self._known.popitem(last=False)
        return self._known[key]


@dataclass(frozen=True)
class Shapes:
    """What the coefficients multiply at some instants: angular accelerations in de-rolled axes, (columns, n)
    rad/s^2.
    """

    columns: tuple[Column, ...]
    acceleration: ComplexArray
    in_plane: ComplexArray
    motion: Motion
    past: tuple[Motion, ...]
    here: Point
    own: OwnTime | None = None

    @cached_property
    def on_grid(self) -> tuple[ComplexArray, list[int], ComplexArray]:
        """The accelerations times their courses (columns, n), as `kink` has them where a knot lies between nodes; the
        columns with a knot, and what the angular rate lacks there per unit of each (columns with a knot, n), rad/s.
        """
        time, half, u = self.here.time, self.here.input("half"), self.here.u
        on_grid_too, knotted = self.acceleration.copy(), [j for j, c in enumerate(self.columns) if has_knot(c)]
        lacking = np.empty((len(knotted), time.size), dtype=complex)
        for k, j in enumerate(knotted):
            row, shape = SLOPES + 4 * k, self.acceleration[j]
            here = placed(self.columns[j].course, time, half, self.own)
            first, second = kink(*here)
            slope, curvature = u[row] + 1j * u[row + 1], u[row + 2] + 1j * u[row + 3]
            on_grid_too[j] = on_grid(*here) * shape - first * slope + second * curvature
            lacking[k] = first * shape - 2.0 * second * slope
        return on_grid_too, knotted, lacking

    def averaged(self, block: float) -> ComplexArray:
        """The accelerations (columns, n) times what a block of so many seconds sees of their courses."""
        if block not in self._averaged:
            out = self.acceleration.copy()
            for own, column in zip(out, self.columns, strict=True):
                if has_knot(column):
                    course, time, _ = placed(column.course, self.here.time, self.here.input("half"), self.own)
                    own *= averaged(course, time, block)
            self._averaged[block] = out
        return self._averaged[block]

    @cached_property
    def _averaged(self) -> dict[float, ComplexArray]:
        return {}
