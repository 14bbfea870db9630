"""The normal force that a hypothesis is fitted with."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from brv_hypo.arrays import ComplexArray, FloatArray
from brv_hypo.motion.frames import effective
from brv_hypo.motion.inertial import InertialRecord


@dataclass(frozen=True)
class ForceModel:
    """The normal force: f_y + i f_z = sum of coefficients times columns (CONVENTIONS, normal force).

    The reconstruction's slope, with a parabola in time for what it errs by.
    """

    slope: FloatArray

    def columns(self, record: InertialRecord, xi: ComplexArray) -> ComplexArray:
        """Columns (n, 3) at the crossflow xi (n,)."""
        return self._normal(record, xi)[:, np.newaxis] * self._parabola

    def at(self, record: InertialRecord, xi: ComplexArray, values: FloatArray) -> ComplexArray:
        """The force (n,) m/s^2 with these coefficients (3,) at the crossflow xi (n,)."""
        return np.asarray(self._normal(record, xi) * (self._parabola @ values))

    def _normal(self, record: InertialRecord, xi: ComplexArray) -> ComplexArray:
        return np.asarray(-record.force_scale * self.slope * effective(xi))

    @cached_property
    def _parabola(self) -> FloatArray:
        """Powers of time over the record, from -1 to 1 (n, 3)."""
        return np.vander(np.linspace(-1.0, 1.0, self.slope.size), 3, increasing=True)
