"""The air that moves: a step of the environment, and the wind that record effects leave unaccounted for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from brv_hypo.arrays import FloatArray, IntArray


@dataclass(frozen=True)
class WindStep:
    """`EnvironmentConfig.wind_step` for a batch: at time (flights,) s the air begins to move.

    `after` (3, flights) m/s, in the frame, is its velocity from then on.
    """

    time: FloatArray
    after: FloatArray

    def velocity(self, time: FloatArray) -> FloatArray:
        """Velocity of the air in the frame, (3, ...) m/s, at `time` (..., flights) s."""
        shape = (3,) + (1,) * (time.ndim - 1) + self.after.shape[1:]
        return np.asarray(self.after.reshape(shape) * (time >= self.time), dtype=float)


@dataclass(frozen=True)
class WindCourse:
    """A wind along the record: `samples` (n, flights, 3) m/s in the frame, `spacing` s apart from `begin` s on.

    Straight between its samples, and held before the first and after the last.
    """

    begin: float
    spacing: float
    samples: FloatArray

    def velocity(self, time: FloatArray) -> FloatArray:
        """Velocity of the air in the frame, (3, ...) m/s, at `time` (..., flights) s."""
        place, left, flight = self._interval(time)
        part = (np.clip(place, 0.0, self.samples.shape[0] - 1.0) - left)[..., None]
        found = (1.0 - part) * self.samples[left, flight] + part * self.samples[left + 1, flight]
        return np.moveaxis(found, -1, 0)

    def rate(self, time: FloatArray) -> FloatArray:
        """Its change, (3, ...) m/s^2."""
        place, left, flight = self._interval(time)
        inside = (place >= 0.0) & (place <= self.samples.shape[0] - 1.0)
        change = (self.samples[left + 1, flight] - self.samples[left, flight]) / self.spacing
        return np.moveaxis(change * inside[..., None], -1, 0)

    def _interval(self, time: FloatArray) -> tuple[FloatArray, IntArray, IntArray]:
        """Place in samples, the sample before it, and the flight."""
        place = (time - self.begin) / self.spacing
        left = np.clip(np.floor(place).astype(np.intp), 0, self.samples.shape[0] - 2)
        return place, left, np.broadcast_to(np.arange(self.samples.shape[1]), left.shape)
