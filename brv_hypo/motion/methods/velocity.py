"""Method 1: the velocity equations, propagated from a start (Eq. 3.1, Section 3.2.2)."""

from __future__ import annotations

from collections.abc import Sequence

from brv_hypo.motion.config import ReconstructionConfig
from brv_hypo.motion.inertial import InertialRecord
from brv_hypo.motion.method import WindHistory, from_nose
from brv_hypo.motion.responses import Perturbation


def velocity(
    record: InertialRecord, config: ReconstructionConfig, perturbations: Sequence[Perturbation]
) -> WindHistory:
    """v and w by Eq. 3.1, speed by the record, started from the mean direction of the nose.

    Gravity is found with the start unless `config.gravity` is off. The equation is neutrally stable: what
    the start and the gyros err by stays.
    """
    return from_nose(record, config, perturbations, forces=True)
