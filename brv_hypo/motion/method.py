"""The result of a reconstruction method, `WindHistory`, and what open-loop methods share: `open_loop`.

Methods stand in `methods/`, one file each. An open-loop method propagates the velocity from a start, where gyro noise
adds up as a random walk; `nose_start` is the start by the nose's mean direction.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from brv_hypo.arrays import ComplexArray, FloatArray
from brv_hypo.motion.config import ReconstructionConfig
from brv_hypo.motion.inertial import (
    InertialRecord,
    WindStart,
    body_crossflow,
    cycles,
    gravity_size,
    start_from_nose,
    wind_direction,
)
from brv_hypo.motion.kinematics import angle_of_attack
from brv_hypo.motion.responses import EffectFit, Perturbation, as_expected, effect_responses, nonzero_responses

UNKNOWN_ANGLE = float(np.pi / np.sqrt(3.0))  # rad, standard deviation of an angle of which nothing is known
NO_GRAVITY = "gravity is left out: it turns the velocity by about g t / V"


@dataclass(frozen=True)
class WindHistory:
    """The wind relative to the vehicle over a record of n samples, and how well it is known."""

    record: InertialRecord
    """What it was found in: the flight's inertial record, corrected by the errors that were estimated."""
    crossflow: ComplexArray
    """(v + i w) / V (n,) in body axes."""
    radial_sigma: FloatArray
    """Standard deviation (n,) of the crossflow along itself."""
    tangential_sigma: FloatArray
    """Standard deviation (n,) across it."""
    gravity: FloatArray
    """(3,) m/s^2 in body axes at the first sample."""
    normal_force_slope: FloatArray
    """(n,) 1/rad at alpha = 0, NaN where the method does not estimate it."""
    accel_sigma: float
    """White noise of the accelerometers as estimated by the fit, m/s^2."""
    effects: EffectFit
    """The estimated errors of the record."""
    warnings: tuple[str, ...] = ()
    """What limits the result."""
    normal_force_bend: float = 0.0
    """What the slope gains with the square of alpha, 1/rad^3."""

    @property
    def alpha_sigma(self) -> FloatArray:
        """Standard deviation of alpha (n,), rad."""
        return np.asarray(self.radial_sigma / np.cos(angle_of_attack(self.crossflow)))

    @property
    def phi_w_sigma(self) -> FloatArray:
        """Standard deviation of the windward meridian (n,), rad; that of an unknown angle near alpha = 0."""
        size = np.maximum(np.abs(self.crossflow), 1e-12)
        return np.asarray(np.minimum(self.tangential_sigma / size, UNKNOWN_ANGLE))


def nose_start(
    record: InertialRecord, config: ReconstructionConfig, *, forces: bool = True
) -> tuple[WindStart, float, float]:
    """The start by the nose's mean direction; the standard deviations of each part of it, rad, and of gravity, m/s^2.

    The mean errs by what a broken cycle adds, and gravity, which follows from the nose's drift, by that over time.
    Where gravity is left out it is its own standard deviation.
    """
    size = config.gravity_magnitude or gravity_size(record.flight)
    start = start_from_nose(record, size if config.gravity else 0.0, forces=forces)
    xi = body_crossflow(record, wind_direction(record, start, forces=forces))
    sigma = float(np.sqrt(0.5 * np.mean(np.abs(xi) ** 2)) / (np.pi * cycles(record)))
    if not config.gravity:
        return start, sigma, size
    return start, sigma, float(np.sqrt(12.0) * sigma * np.mean(record.flight.velocity) / record.time[-1])


def from_nose(
    record: InertialRecord, config: ReconstructionConfig, perturbations: Sequence[Perturbation], *, forces: bool
) -> WindHistory:
    """`open_loop` from the nose's mean direction, which is best known in the middle of the record."""
    start, sigma, gravity_sigma = nose_start(record, config, forces=forces)
    middle = 0.5 * float(record.time[-1])
    return open_loop(record, config, perturbations, start, (sigma, gravity_sigma), middle, forces=forces)


def open_loop(
    record: InertialRecord,
    config: ReconstructionConfig,
    perturbations: Sequence[Perturbation],
    start: WindStart,
    sigmas: tuple[float, float],
    known_at: float,
    *,
    forces: bool = True,
    warnings: tuple[str, ...] = (),
) -> WindHistory:
    """Attitude about a velocity propagated from `start`: gyro noise adds up as a random walk.

    `sigmas`: those of each part of the direction, rad, which is known best `known_at` s after the first sample, and of
    each part of gravity, m/s^2. Errors of the record are as large as expected: nothing here measures them.
    """
    speed = record.flight.velocity
    xi = body_crossflow(record, wind_direction(record, start, forces=forces))
    elapsed = np.abs(record.time - known_at)
    walk = record.gyro_sigma**2 * record.flight.step * elapsed
    responses = nonzero_responses(effect_responses(record, xi, record.transverse_force, perturbations))
    drift = responses.rows.all_of(responses.drift)
    moved = drift - drift[int(np.argmin(elapsed))]
    errors = np.sum(moved**2, axis=(1, 2)) / (2.0 * speed**2)
    sigma = np.sqrt(sigmas[0] ** 2 + walk + (sigmas[1] * elapsed / speed) ** 2 + errors)
    return WindHistory(
        record=record,
        crossflow=xi,
        radial_sigma=sigma,
        tangential_sigma=sigma,
        gravity=start.gravity,
        normal_force_slope=np.full(xi.size, np.nan),
        accel_sigma=record.accel_sigma,
        effects=as_expected(responses),
        warnings=warnings if config.gravity else (*warnings, NO_GRAVITY),
    )
