"""Magnus moment: spin turns the crossflow's moment out of plane."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from brv_hypo.mechanisms import Mechanism, Term, hookimpl
from brv_hypo.motion.motion import Motion


class Magnus(Mechanism):
    """C_Z' += C_npalpha (p d / 2V) alpha; nothing in plane."""

    name = "magnus"
    title = "Magnus moment"
    claims = "an out-of-plane moment proportional to roll rate and angle of attack"
    source = "Vaughn and Reis, AIAA J. 13:872, 1975; standard spinning-body aerodynamics"
    kind = "aerodynamic"
    time_variation = ("constant",)

    def terms(self, motion: Motion, theta: Mapping[str, float]) -> tuple[Term, ...]:
        """One term: C_npalpha."""
        nothing = np.zeros_like(motion.alpha)
        return (Term("C_npalpha", nothing, motion.p * motion.rate_factor * motion.alpha, "1/rad^2"),)


@hookimpl
def brv_hypo_mechanisms() -> Sequence[Mechanism]:
    """The effects of this module."""
    return [Magnus()]
