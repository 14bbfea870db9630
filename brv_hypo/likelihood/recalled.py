"""Eliminated states that are not kept."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from brv_hypo.arrays import FloatArray
from brv_hypo.likelihood.quadratic import Eliminated, Quadratic


@dataclass(frozen=True)
class Recalled:
    """States eliminated again whenever they are asked for: many samples with process noise take much memory.

    See `Eliminated`.
    """

    again: Callable[[], Eliminated]

    @property
    def problem(self) -> Quadratic:
        """See `Eliminated`."""
        return self.again().problem

    def states(self, weights: FloatArray) -> FloatArray:
        """See `Eliminated`."""
        return self.again().states(weights)

    def step(self, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
        """See `Eliminated`."""
        return self.again().step(weights)

    def at_start(self) -> FloatArray:
        """See `Eliminated`."""
        return self.again().at_start()

    def rows(self) -> tuple[FloatArray, FloatArray | None]:
        """See `Eliminated`."""
        return self.again().rows()

    def triangle(self) -> FloatArray:
        """See `Eliminated`."""
        return self.again().triangle()
