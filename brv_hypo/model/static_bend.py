"""What the static moment bends with the angle of attack, within what bodies do."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from brv_hypo.flight.record import Flight
from brv_hypo.mechanisms.contract import Mechanism, Term
from brv_hypo.motion.bend import BENT
from brv_hypo.motion.motion import Motion


class StaticBend(Mechanism):
    """C_N' += C_Nalpha3 alpha^3, the first odd power after the slope; Gaussian prior, `slope` (1/rad) at BENT."""

    name = "static_bend"
    title = "bend of the static moment"
    claims = "a static moment that is not in proportion to the angle of attack"
    source = "Murphy, BRL R 1216 (1963): cubic static moment"
    wind_fixed = True
    time_variation = ("constant",)

    slope: float

    def terms(self, motion: Motion, theta: Mapping[str, float]) -> tuple[Term, ...]:
        """One term: C_Nalpha3."""
        return (Term("C_Nalpha3", motion.alpha**3, np.zeros_like(motion.alpha), "1/rad^3"),)

    def tolerance(self, flight: Flight) -> tuple[float, ...] | None:
        """Standard deviation (1/rad^3) of the coefficient."""
        return (abs(self.slope) / BENT**2,)

    def of_each_flight(self, flight: Flight) -> bool:
        """Never: the bend is the design's."""
        return False
