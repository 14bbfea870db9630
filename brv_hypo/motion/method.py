"""The interface of reconstruction methods: `WindHistory`, the wind-relative motion with its standard deviations.

A method is a function of an inertial record, the options and the errors that the record may have:

    method(record, config, perturbations) -> WindHistory

and stands in a file of its own: joint.py, velocity.py, rates.py, polar.py. `open_loop` is what the last three share:
the velocity propagated from a start, where gyro noise adds up as a random walk.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from brv_hypo.arrays import ComplexArray, FloatArray
from brv_hypo.motion.config import ReconstructionConfig
from brv_hypo.motion.inertial import (
    FREE_GRAVITY,
    InertialRecord,
    WindStart,
    body_crossflow,
    cycles,
    gravity_magnitude,
    start_from_nose,
    wind_direction,
)
from brv_hypo.motion.kinematics import angle_of_attack
from brv_hypo.motion.responses import (
    EffectFit,
    Perturbation,
    as_expected,
    effect_responses,
    nonzero_responses,
)

UNKNOWN_ANGLE = float(np.pi / np.sqrt(3.0))  # rad, standard deviation of an angle of which nothing is known
NO_GRAVITY = "gravity is left out: it turns the velocity by about g t / V"


@dataclass(frozen=True)
class WindHistory:
    """Crossflow (v + i w) / V (n,) in body axes, and the standard deviations (n,) of its two parts.

    `record` is what it was found in: the flight's, less what was found of its errors. `radial_sigma` along
    the crossflow, `tangential_sigma` across it; `gravity` (3,) m/s^2 in body axes at the first sample;
    `normal_force_slope` (n,) 1/rad of `normal_force_terms`, NaN where the method does not find it, to which
    `normal_force_bend` (1/rad^3) adds with the square of alpha; `accel_sigma` m/s^2 as the fit left it; `effects` what
    the record says of its own errors.
    """

    record: InertialRecord
    crossflow: ComplexArray
    radial_sigma: FloatArray
    tangential_sigma: FloatArray
    gravity: FloatArray
    normal_force_slope: FloatArray
    accel_sigma: float
    effects: EffectFit
    warnings: tuple[str, ...] = ()
    normal_force_terms: int = 0
    normal_force_bend: float = 0.0

    @property
    def alpha_sigma(self) -> FloatArray:
        """Standard deviation of alpha (n,), rad."""
        return np.asarray(self.radial_sigma / np.cos(angle_of_attack(self.crossflow)))

    @property
    def phi_w_sigma(self) -> FloatArray:
        """Standard deviation of the windward meridian (n,), rad; that of an angle not known at all near
        alpha = 0."""
        size = np.maximum(np.abs(self.crossflow), 1e-12)
        return np.asarray(np.minimum(self.tangential_sigma / size, UNKNOWN_ANGLE))


def open_loop(
    record: InertialRecord,
    start: WindStart,
    start_sigma: float,
    *,
    forces: bool,
    gravity_sigma: float,
    known_at: float,
    perturbations: Sequence[Perturbation],
    warnings: tuple[str, ...] = (),
) -> WindHistory:
    """Attitude about a velocity propagated from `start`, untied: gyro noise adds up as a random walk.

    `start_sigma` rad is the standard deviation of each part of the direction, known best `known_at` s after
    the first sample; `gravity_sigma` m/s^2 that of each part of gravity, or gravity itself where it is left
    out. Errors of the record are as large as expected: nothing here tells more of them.
    """
    speed = record.flight.velocity
    xi = body_crossflow(record, wind_direction(record, start, forces=forces))
    elapsed = np.abs(record.time - known_at)
    walk = record.gyro_sigma**2 * record.flight.step * elapsed
    responses = nonzero_responses(effect_responses(record, xi, record.transverse_force, perturbations))
    drift = responses.rows.all_of(responses.drift)
    moved = drift - drift[int(np.argmin(elapsed))]
    errors = np.sum(moved**2, axis=(1, 2)) / (2.0 * speed**2)
    sigma = np.sqrt(start_sigma**2 + walk + (gravity_sigma * elapsed / speed) ** 2 + errors)
    return WindHistory(
        record=record,
        crossflow=xi,
        radial_sigma=sigma,
        tangential_sigma=sigma,
        gravity=start.gravity,
        normal_force_slope=np.full(xi.size, np.nan),
        accel_sigma=record.accel_sigma,
        effects=as_expected(responses),
        warnings=warnings,
    )


def from_nose(
    record: InertialRecord,
    config: ReconstructionConfig,
    perturbations: Sequence[Perturbation],
    *,
    forces: bool,
) -> WindHistory:
    """`open_loop` from the nose's mean direction; gravity is found along unless `config.gravity` is off."""
    size = expected_gravity(record, config)
    start = start_from_nose(record, size if config.gravity else 0.0, forces=forces)
    xi = body_crossflow(record, wind_direction(record, start, forces=forces))
    sigma = nose_sigma(record, xi)
    return open_loop(
        record,
        start,
        sigma,
        forces=forces,
        known_at=0.5 * float(record.time[-1]),
        gravity_sigma=nose_gravity_sigma(record, sigma) if config.gravity else size,
        perturbations=perturbations,
        warnings=() if config.gravity else (NO_GRAVITY,),
    )


def expected_gravity(record: InertialRecord, config: ReconstructionConfig) -> float:
    """How large gravity may be, m/s^2."""
    return config.gravity_magnitude or gravity_magnitude(record.flight) or FREE_GRAVITY


def nose_sigma(record: InertialRecord, xi: ComplexArray) -> float:
    """Standard deviation (rad) of each part of the nose's mean direction: what a broken cycle leaves."""
    return float(np.sqrt(0.5 * np.mean(np.abs(xi) ** 2)) / (np.pi * cycles(record)))


def nose_gravity_sigma(record: InertialRecord, sigma: float) -> float:
    """Standard deviation (m/s^2) of gravity from the nose's drift, its mean being known to `sigma` rad."""
    return float(np.sqrt(12.0) * sigma * np.mean(record.flight.velocity) / record.time[-1])
