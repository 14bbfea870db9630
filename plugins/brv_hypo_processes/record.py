"""Drifts of instruments and air, beyond the constant errors that a record's tolerances list.

One unit of a spline is the drift of an ordinary instrument or day: a gyro by 0.05 deg/s, an accelerometer by 5 mg, the
air by 2 % of density and 1 m/s of wind.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import ClassVar

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.flight.record import Flight
from brv_hypo.mechanisms import RecordProcess, hookimpl


class _Added(RecordProcess):
    """A history that is added to a channel."""

    def changed(self, flight: Flight, channel: str, history: FloatArray) -> Flight:
        """The record with so much (n,) more in that channel."""
        return replace(flight, **{channel: getattr(flight, channel) + history})


class GyroDrift(_Added):
    """A gyro's bias that wanders."""

    name, family, kind = "gyro_drift", "gyros", "instrument"
    title = "drift of the gyros' bias"
    channels, splines, units, size = ("p", "q", "r"), 8, "rad/s", float(np.radians(0.05))


class AccelDrift(_Added):
    """An accelerometer's bias that wanders, vibration rectified included."""

    name, family, kind = "accel_drift", "accelerometers", "instrument"
    title = "drift of the accelerometers' bias"
    channels, splines, units, size = ("ax", "ay", "az"), 8, "m/s^2", 0.05


class DensityChange(RecordProcess):
    """Air that is denser or thinner than the record's dynamic pressure says, by a share that changes."""

    name, family, kind = "density_change", "air", "environment"
    title = "air density off the record's, by a share that changes"
    channels, splines, units, size = ("dynamic_pressure",), 10, "1", 0.02

    def changed(self, flight: Flight, channel: str, history: FloatArray) -> Flight:
        """The record with its dynamic pressure larger by a share (n,)."""
        return replace(flight, dynamic_pressure=flight.dynamic_pressure * (1.0 + history))


class Turbulence(RecordProcess):
    """Wind across the track that the record does not know, from shear to gusts."""

    name, family, kind = "turbulence", "air", "environment"
    title = "wind across the track that changes"
    channels, splines, units, size = ("y", "z"), 36, "m/s", 1.0
    axes: ClassVar[str] = "xyz"

    def changed(self, flight: Flight, channel: str, history: FloatArray) -> Flight:
        """The record with so much (n,) m/s less of the wind known."""
        wind = np.zeros((flight.samples, 3)) if flight.wind is None else flight.wind.copy()
        wind[:, self.axes.index(channel)] -= history
        return replace(flight, wind=wind)


@hookimpl
def brv_hypo_record_effects() -> Sequence[RecordProcess]:
    """Every process of the record."""
    return [GyroDrift(), AccelDrift(), DensityChange(), Turbulence()]
