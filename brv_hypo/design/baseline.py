"""The baseline that is always fitted along: static in-plane moment and pitch damping."""

from __future__ import annotations

import numpy as np

from brv_hypo.mechanisms.contract import Term
from brv_hypo.motion.frames import plane_from_body
from brv_hypo.motion.motion import Motion


def static_terms(motion: Motion) -> tuple[Term, Term]:
    """The wind-fixed in-plane moment C_mw = C_N0 + C_Nalpha alpha of Eq. 5.1; out-of-plane zero."""
    nothing = np.zeros_like(motion.alpha)
    return (
        Term("C_N0", np.ones_like(motion.alpha), nothing, "1"),
        Term("C_Nalpha", motion.alpha, nothing, "1/rad"),
    )


def pitch_damping_term(motion: Motion) -> Term:
    """C_mq: C_m += C_mq q d / 2V and C_n += C_mq r d / 2V, turned into the plane of alpha."""
    rate = plane_from_body((motion.q + 1j * motion.r) * motion.rate_factor, motion.windward_meridian)
    return Term("C_mq", rate.real, rate.imag, "1/rad")
