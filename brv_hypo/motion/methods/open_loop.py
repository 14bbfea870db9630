"""Open-loop methods: the velocity is propagated from a start, where gyro noise adds up as a random walk.

`velocity` is method 1 (Eq. 3.1), `rates` method 2, Belknap's angular rate method (Section 3.2.2); both start by the
nose's mean direction, which is best known in the middle of the record.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from brv_hypo.motion.inertial import InertialRecord, body_crossflow, cycles, start_from_nose, wind_direction
from brv_hypo.motion.methods import ReconstructionConfig
from brv_hypo.motion.reconstruction import WindHistory
from brv_hypo.motion.responses import EffectFit, Perturbation, effect_responses


def velocity(
    record: InertialRecord, config: ReconstructionConfig, perturbations: Sequence[Perturbation]
) -> WindHistory:
    """v and w by Eq. 3.1, speed by the record, gravity with the start; errors of start and gyros stay."""
    return from_nose(record, perturbations, forces=True)


def rates(record: InertialRecord, config: ReconstructionConfig, perturbations: Sequence[Perturbation]) -> WindHistory:
    """Eq. 3.2 (erratum E4): the velocity is turned by gravity alone."""
    return from_nose(record, perturbations, forces=False)


def from_nose(record: InertialRecord, perturbations: Sequence[Perturbation], *, forces: bool) -> WindHistory:
    """Attitude about a velocity propagated from the nose's mean, by gravity and, if `forces`, specific force. The mean
    errs by what a broken cycle adds, and gravity, which follows from the nose's drift, by that over time. Errors of the
    record are as large as expected: nothing here measures them.
    """
    speed = record.flight.velocity
    start = start_from_nose(record, forces=forces)
    xi = body_crossflow(record, wind_direction(record, start, forces=forces))
    start_sigma = float(np.sqrt(0.5 * np.mean(np.abs(xi) ** 2)) / (np.pi * cycles(record)))
    gravity_sigma = float(np.sqrt(12.0) * start_sigma * np.mean(speed) / record.time[-1])
    elapsed = np.abs(record.time - 0.5 * record.time[-1])
    walk = record.gyro_sigma**2 * record.flight.step * elapsed
    responses = effect_responses(record, xi, record.transverse_force, perturbations).nonzero()
    drift = responses.rows.all_of(responses.drift)
    moved = drift - drift[int(np.argmin(elapsed))]
    errors = np.sum(moved**2, axis=(1, 2)) / (2.0 * speed**2)
    none, prior = np.zeros(len(responses.effects)), np.eye(len(responses.effects))
    sigma = np.sqrt(start_sigma**2 + walk + (gravity_sigma * elapsed / speed) ** 2 + errors)
    return WindHistory(
        record=record,
        crossflow=xi,
        radial_sigma=sigma,
        tangential_sigma=sigma,
        gravity=start.gravity,
        normal_force_slope=np.full(xi.size, np.nan),
        accel_sigma=record.accel_sigma,
        effects=EffectFit(responses, none, none, prior),
    )


METHODS = (velocity, rates)
