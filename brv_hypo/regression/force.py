"""The normal force that a hypothesis is fitted with."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from brv_hypo.arrays import ComplexArray, FloatArray
from brv_hypo.motion.inertial import InertialRecord
from brv_hypo.motion.kinematics import effective


@dataclass(frozen=True)
class ForceModel:
    """The normal force: f_y + i f_z = sum of coefficients times columns (CONVENTIONS, normal force).

    The reconstruction's `slope` (n,) 1/rad at alpha = 0 and its `bend` 1/rad^3, with a parabola in time for what they
    err by, and a bend of its own.
    """

    slope: FloatArray
    bend: float = 0.0

    def columns(self, record: InertialRecord, xi: ComplexArray) -> ComplexArray:
        """Columns (n, 4) at the crossflow xi (n,)."""
        own = effective(xi)
        flow, square = -record.force_scale * own, np.abs(own) ** 2
        return np.column_stack(
            [(flow * (self.slope + self.bend * square))[:, np.newaxis] * self._parabola, flow * self.slope * square]
        )

    def at(self, record: InertialRecord, xi: ComplexArray, values: FloatArray) -> ComplexArray:
        """The force (n,) m/s^2 with these coefficients (4,) at the crossflow xi (n,)."""
        own = effective(xi)
        slope = self._parabola @ values[:3]
        bend = self.bend * slope + values[3] * self.slope
        return np.asarray(-record.force_scale * own * (self.slope * slope + bend * np.abs(own) ** 2))

    @cached_property
    def _parabola(self) -> FloatArray:
        """Powers of time over the record, from -1 to 1 (n, 3)."""
        return np.vander(np.linspace(-1.0, 1.0, self.slope.size), 3, increasing=True)
