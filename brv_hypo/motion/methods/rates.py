"""Method 2, the angular rate method of Belknap: attitude about a velocity that hardly turns (Eq. 3.2, Section 3.2.2)."""

from __future__ import annotations

import numpy as np

from brv_hypo.arrays import ComplexArray
from brv_hypo.motion.config import ReconstructionConfig
from brv_hypo.motion.inertial import InertialRecord
from brv_hypo.motion.methods.wind_history import WindHistory, open_loop
from brv_hypo.motion.wind import body_crossflow, cycles, gravity_magnitude, start_from_nose, wind_direction


def rates(record: InertialRecord, config: ReconstructionConfig) -> WindHistory:
    """The velocity keeps its direction, as the report has it, or turns by gravity alone (`config.gravity`).

    The start is the mean direction of the nose.
    """
    size = (config.gravity_magnitude or gravity_magnitude(record.flight)) if config.gravity else 0.0
    start = start_from_nose(record, size, forces=False)
    xi = body_crossflow(record, wind_direction(record, start, forces=False))
    warning = "" if config.gravity else "gravity is neglected: it turns the velocity by about g t / V"
    return open_loop(record, start, start_sigma_of(xi, record), forces=False, warnings=(warning,) if warning else ())


def start_sigma_of(xi: ComplexArray, record: InertialRecord) -> float:
    """Standard deviation (rad) of each part of a mean nose direction as a start: what a broken cycle leaves."""
    return float(np.sqrt(0.5 * np.mean(np.abs(xi) ** 2)) / (np.pi * cycles(record)))
