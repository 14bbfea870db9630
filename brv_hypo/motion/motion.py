"""`Motion`: all that a mechanism may know of a vehicle's flight, as arrays."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from brv_hypo.arrays import ComplexArray, FloatArray
from brv_hypo.motion.frames import plane_from_body

SMOOTH = (
    *("alpha_rate", "windward_meridian_rate", "p", "q", "r"),
    *("velocity", "dynamic_pressure", "mach", "reynolds"),
)
"""Quantities of a motion that vary smoothly and are no angles: those may jump or turn."""


@dataclass(frozen=True)
class Motion:
    """Motion of the vehicle; every array has one shape, (n,) over time for a record.

    The simulator evaluates the same mechanisms at the running state: there the shape is (flights,), all at
    one instant. A mechanism therefore works elementwise and asks `delayed` for the past.

    time s; alpha, windward_meridian rad (unwrapped over a record); their rates rad/s; p, q, r rad/s;
    velocity m/s; dynamic_pressure Pa; mach, reynolds (NaN where the record cannot tell);
    in_plane_moment: the wind-fixed in-plane moment coefficient C_mw of Eq. 5.1; reference_length m.
    roll_acceleration rad/s^2 and axial_share, the axial force's coefficient over its median, are None where they are
    not known: at a running state, and in the past.
    common_time s, of flights that share their Mach numbers; None where each has its own time, and in the past.
    """

    time: FloatArray
    alpha: FloatArray
    alpha_rate: FloatArray
    windward_meridian: FloatArray
    windward_meridian_rate: FloatArray
    p: FloatArray
    q: FloatArray
    r: FloatArray
    velocity: FloatArray
    dynamic_pressure: FloatArray
    mach: FloatArray
    reynolds: FloatArray
    in_plane_moment: FloatArray
    reference_length: float
    history: Callable[[float], Motion] | None = None
    roll_acceleration: FloatArray | None = None
    axial_share: FloatArray | None = None
    common_time: FloatArray | None = None

    def __repr__(self) -> str:
        """Short: the arrays are long."""
        return f"<Motion: {self.time.size} samples>"

    def delayed(self, tau: float) -> Motion:
        """The whole motion tau seconds earlier, on the same shape; tau >= 0.

        Before its first instant a motion is taken as steady: constant alpha and constant meridian rate.
        """
        if tau == 0.0:
            return self
        if self.history is None:
            raise ValueError(
                f"a motion without history was asked for its past, {tau} s earlier; build it with "
                "brv_hypo.motion.history.recorded, or let the simulator supply it"
            )
        return self.history(tau)

    def region(self, start: float, stop: float) -> FloatArray:
        """1 where start <= time < stop (s), else 0, on the motion's shape."""
        return ((self.time >= start) & (self.time < stop)).astype(float)

    @property
    def course_time(self) -> FloatArray:
        """The time that courses of coefficients are told in, s: the common time where there is one."""
        return self.time if self.common_time is None else self.common_time

    def to_plane(self, moment: ComplexArray) -> ComplexArray:
        """C_N' + i C_Z' from C_m + i C_n: `frames.plane_from_body`, the turn found once."""
        return np.asarray(moment * self._turn, dtype=complex)

    def to_body(self, in_plane: FloatArray, out_of_plane: FloatArray) -> ComplexArray:
        """C_m + i C_n from C_N' and C_Z': `frames.body_from_plane`, the turn found once."""
        return np.asarray((in_plane + 1j * out_of_plane) * np.conj(self._turn), dtype=complex)

    @cached_property
    def _turn(self) -> ComplexArray:
        return plane_from_body(np.ones((), dtype=complex), self.windward_meridian)

    @property
    def rate_factor(self) -> FloatArray:
        """d / 2V in s: makes an angular rate dimensionless."""
        return np.asarray(self.reference_length / (2.0 * self.velocity), dtype=float)
