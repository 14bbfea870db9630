"""Static moment that is not linear in the angle of attack."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from brv_hypo.mechanisms import Mechanism, Term, hookimpl
from brv_hypo.motion.motion import Motion


class CubicStiffness(Mechanism):
    """C_N' += C_Nalpha3 alpha^3: the first power after the linear one that symmetry allows."""

    name = "cubic_stiffness"
    title = "cubic static moment"
    claims = "a static in-plane moment that stiffens or softens with the cube of the angle of attack"
    source = "Murphy, Free Flight Motion of Symmetric Missiles, BRL Report 1216, 1963"
    kind = "aerodynamic"
    time_variation = ("constant",)
    wind_fixed = True

    def terms(self, motion: Motion, theta: Mapping[str, float]) -> tuple[Term, ...]:
        """One term: C_Nalpha3."""
        return (Term("C_Nalpha3", motion.alpha**3, np.zeros_like(motion.alpha), "1/rad^3"),)


@hookimpl
def brv_hypo_mechanisms() -> Sequence[Mechanism]:
    """The effects of this module."""
    return [CubicStiffness()]
