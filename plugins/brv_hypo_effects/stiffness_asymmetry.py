"""Unequal pitch and yaw stiffness: the static moment of a body that is not rotationally symmetric."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from brv_hypo.mechanisms import Mechanism, Term, hookimpl
from brv_hypo.motion.motion import Motion


class StiffnessAsymmetry(Mechanism):
    """C_m += d alpha cos(phi_w), C_n += d alpha sin(phi_w): stiffer in pitch by d, softer in yaw by as much.

    In plane axes d alpha (cos 2 phi_w, sin 2 phi_w). The second term has its axes at 45 deg.
    """

    name = "stiffness_asymmetry"
    title = "unequal pitch and yaw stiffness"
    claims = "a moment proportional to alpha that turns in plane axes at twice the windward meridian"
    source = "Nicolaides, On the Free Flight Motion of Missiles Having Slight Asymmetries, BRL 858, 1953"
    kind = "aerodynamic"
    time_variation = ("constant",)
    terms_enter_together = True

    def terms(self, motion: Motion, theta: Mapping[str, float]) -> tuple[Term, ...]:
        """Two terms: half the difference of the slopes, about the body's own axes and at 45 deg."""
        twice = 2.0 * motion.windward_meridian
        cosine, sine = motion.alpha * np.cos(twice), motion.alpha * np.sin(twice)
        return (Term("pitch-yaw", cosine, sine, "1/rad"), Term("diagonal", -sine, cosine, "1/rad"))


@hookimpl
def brv_hypo_mechanisms() -> Sequence[Mechanism]:
    """The effects of this module."""
    return [StiffnessAsymmetry()]
