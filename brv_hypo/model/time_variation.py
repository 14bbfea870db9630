"""How a coefficient changes in time: linear splines with jumps and ramps (Eq. 3.6 with m = 1)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.mechanisms.contract import TimeVariation


@dataclass(frozen=True)
class TimeFunction:
    """A coefficient's course per unit of its value, from `start` to `stop` (s).

    `constant` and `jump` are 1 in [start, stop); `ramp` is t - start in [start, stop), 0 before and, as
    the truncated power function of Eq. 3.7, stays at its last value after: its coefficient is per second.
    """

    kind: TimeVariation
    start: float = -np.inf
    stop: float = np.inf

    def __call__(self, time: FloatArray) -> FloatArray:
        """The course at `time`, any shape."""
        if self.kind == "ramp":
            return np.asarray(np.clip(time, self.start, self.stop) - self.start, dtype=float)
        return ((time >= self.start) & (time < self.stop)).astype(float)

    def units(self, coefficient_units: str) -> str:
        """Units of the value that multiplies this course."""
        return f"{coefficient_units}/s" if self.kind == "ramp" else coefficient_units
