"""Method 2, Belknap's angular rate method: attitude about a velocity that hardly turns (Section 3.2.2)."""

from __future__ import annotations

from collections.abc import Sequence

from brv_hypo.motion.config import ReconstructionConfig
from brv_hypo.motion.inertial import InertialRecord
from brv_hypo.motion.method import WindHistory, from_nose
from brv_hypo.motion.responses import Perturbation


def rates(record: InertialRecord, config: ReconstructionConfig, perturbations: Sequence[Perturbation]) -> WindHistory:
    """Eq. 3.2 (erratum E4), started from the mean direction of the nose.

    The velocity keeps its direction, as the report has it, or turns by gravity alone (`config.gravity`).
    """
    return from_nose(record, config, perturbations, forces=False)
