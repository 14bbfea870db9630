"""What every method answers: the wind-relative motion, and how well it is known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from brv_hypo.arrays import ComplexArray, FloatArray
from brv_hypo.motion.frames import angle_of_attack
from brv_hypo.motion.inertial import InertialRecord
from brv_hypo.motion.wind import WindStart, body_crossflow, wind_direction


@dataclass(frozen=True)
class WindHistory:
    """Crossflow (v + i w) / V (n,) in body axes, and the standard deviations (n,) of its two parts.

    `radial_sigma` along the crossflow, `tangential_sigma` across it; `gravity` (3,) m/s^2 in body axes at the first
    sample; `normal_force_slope` (n,) 1/rad, NaN where the method does not find it; `accel_sigma` m/s^2 as the fit left it.
    """

    crossflow: ComplexArray
    radial_sigma: FloatArray
    tangential_sigma: FloatArray
    gravity: FloatArray
    normal_force_slope: FloatArray
    accel_sigma: float
    warnings: tuple[str, ...] = ()

    @property
    def alpha_sigma(self) -> FloatArray:
        """Standard deviation of alpha (n,), rad."""
        return np.asarray(self.radial_sigma / np.cos(angle_of_attack(self.crossflow)))

    @property
    def phi_w_sigma(self) -> FloatArray:
        """Standard deviation of the windward meridian (n,), rad; that of an angle not known at all near alpha = 0."""
        size = np.maximum(np.abs(self.crossflow), 1e-12)
        return np.minimum(self.tangential_sigma / size, np.pi / np.sqrt(3.0))


def open_loop(
    record: InertialRecord, start: WindStart, start_sigma: float, *, forces: bool, warnings: tuple[str, ...] = ()
) -> WindHistory:
    """Attitude about a velocity propagated from `start`, untied: gyro noise adds up as a random walk.

    `start_sigma` rad is the standard deviation of each part of the direction at the start.
    """
    speed = record.flight.velocity
    xi = body_crossflow(record, wind_direction(record, start, forces=forces))
    walk = np.concatenate([[0.0], np.cumsum((speed[1:] * record.gyro_sigma * record.flight.step) ** 2)])
    sigma = np.sqrt((start_sigma * speed[0]) ** 2 + walk) / speed
    return WindHistory(
        crossflow=xi, radial_sigma=sigma, tangential_sigma=sigma, gravity=start.gravity,
        normal_force_slope=np.full(xi.size, np.nan), accel_sigma=record.accel_sigma, warnings=warnings,
    )
