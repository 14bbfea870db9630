"""The air that moves: a step of the environment, and the wind that record effects leave unaccounted for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from brv_hypo.arrays import FloatArray


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
    """A wind along the record: `samples` (3, n, flights) m/s in the frame, `spacing` s apart from `begin` s on.

    Straight between its samples, and held before the first and after the last.
    """

    begin: float
    spacing: float
    samples: FloatArray

    def at(self, time: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Velocity of the air in the frame and its change, (3, ...) m/s and m/s^2, at `time` (..., flights) s."""
        last = self.samples.shape[1] - 1
        place = (time - self.begin) / self.spacing
        held = np.minimum(np.maximum(place, 0.0), last)
        left = np.minimum(held.astype(np.intp), last - 1)
        flight = np.arange(self.samples.shape[2])
        before = self.samples[:, left, flight]
        change = self.samples[:, left + 1, flight] - before
        return before + (held - left) * change, change * ((held == place) / self.spacing)
