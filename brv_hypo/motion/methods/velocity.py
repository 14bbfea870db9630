"""Method 1: the velocity equations, propagated from a start (Eq. 3.1, Section 3.2.2)."""

from __future__ import annotations

from brv_hypo.motion.config import ReconstructionConfig
from brv_hypo.motion.inertial import InertialRecord
from brv_hypo.motion.methods.rates import start_sigma_of
from brv_hypo.motion.methods.wind_history import WindHistory, open_loop
from brv_hypo.motion.wind import body_crossflow, gravity_magnitude, start_from_nose, wind_direction


def velocity(record: InertialRecord, config: ReconstructionConfig) -> WindHistory:
    """v and w by Eq. 3.1, speed by the record; gravity found with the start unless `config.gravity` is off.

    The equation is neutrally stable: what the start and the gyros err by stays.
    """
    size = (config.gravity_magnitude or gravity_magnitude(record.flight)) if config.gravity else 0.0
    start = start_from_nose(record, size)
    xi = body_crossflow(record, wind_direction(record, start))
    return open_loop(record, start, start_sigma_of(xi, record), forces=True)
