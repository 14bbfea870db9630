"""What the static moment bends with the angle of attack, within what bodies do."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import numpy as np

from brv_hypo.constants import BEND_DRIFT, BENT
from brv_hypo.flight.record import Flight
from brv_hypo.mechanisms.contract import Mechanism, Term
from brv_hypo.model.baseline import scaled
from brv_hypo.motion.motion import Motion

Quantity = Literal["time", "mach", "speed"]


class StaticBend(Mechanism):
    """C_N' += (C_Nalpha3 + drift x) alpha^3, the first odd power after the slope; Gaussian priors.

    The bend is `slope` (1/rad) at BENT, 1 sigma. `drift`: what it drifts with, and the ends of that between which x
    runs from -1 to 1; None where it does not drift.
    """

    name = "static_bend"
    title = "bend of the static moment"
    claims = "a static moment that is not in proportion to the angle of attack"
    source = "Murphy, BRL R 1216 (1963): cubic static moment"
    wind_fixed = True
    time_variation = ("constant",)

    slope: float
    drift: tuple[Quantity, float, float] | None = None

    def terms(self, motion: Motion, theta: Mapping[str, float]) -> tuple[Term, ...]:
        """C_Nalpha3, and its drift where it has one."""
        cube, nothing = motion.alpha**3, np.zeros_like(motion.alpha)
        bend = Term("C_Nalpha3", cube, nothing, "1/rad^3")
        if self.drift is None:
            return (bend,)
        by, low, high = self.drift
        along = {"time": motion.time, "mach": motion.mach, "speed": motion.velocity}[by]
        place = scaled(along, low, high)
        return bend, Term("C_Nalpha3 drift 1", cube * place, nothing, "1/rad^3")

    def tolerance(self, flight: Flight) -> tuple[float, ...] | None:
        """Standard deviation (1/rad^3) of each coefficient."""
        bend = abs(self.slope) / BENT**2
        return (bend,) if self.drift is None else (bend, BEND_DRIFT * bend)

    def of_each_flight(self, flight: Flight) -> bool:
        """Never: the bend is the design's."""
        return False
