"""What the static moment bends with the angle of attack, within what bodies do."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import numpy as np

from brv_hypo.flight.record import Flight
from brv_hypo.mechanisms.contract import Mechanism, Term
from brv_hypo.model.baseline import scaled
from brv_hypo.motion.bend import BENT
from brv_hypo.motion.motion import Motion

# What the bend changes by, of itself (1 sigma), between the ends of what it drifts with: about what slopes do.
_DRIFT = 0.5


class StaticBend(Mechanism):
    """C_N' += (C_Nalpha3 + drift x + drift V y) alpha^3, the first odd power after the slope; Gaussian priors.

    The bend is `slope` (1/rad) at BENT, 1 sigma. `drift`: what it drifts with, and the ends of that between which x
    runs from -1 to 1; None where it does not drift. `speeds`: those relative to the air (m/s) between which y does;
    None where the bend does not follow the speed.
    """

    name = "static_bend"
    title = "bend of the static moment"
    claims = "a static moment that is not in proportion to the angle of attack"
    source = "Murphy, BRL R 1216 (1963): cubic static moment"
    wind_fixed = True
    time_variation = ("constant",)

    slope: float
    drift: tuple[Literal["time", "mach"], float, float] | None = None
    speeds: tuple[float, float] | None = None

    def terms(self, motion: Motion, theta: Mapping[str, float]) -> tuple[Term, ...]:
        """C_Nalpha3, and its drifts where it has some."""
        cube, nothing = motion.alpha**3, np.zeros_like(motion.alpha)
        courses = {"C_Nalpha3": np.ones_like(cube)}
        if self.drift is not None:
            by, low, high = self.drift
            courses["C_Nalpha3 drift 1"] = scaled(motion.time if by == "time" else motion.mach, low, high)
        if self.speeds is not None:
            courses["C_Nalpha3 drift V"] = scaled(motion.velocity, *self.speeds)
        return tuple(Term(name, cube * course, nothing, "1/rad^3") for name, course in courses.items())

    def tolerance(self, flight: Flight) -> tuple[float, ...] | None:
        """Standard deviation (1/rad^3) of each coefficient."""
        bend = abs(self.slope) / BENT**2
        drifts = sum(each is not None for each in (self.drift, self.speeds))
        return (bend, *[_DRIFT * bend] * drifts)

    def of_each_flight(self, flight: Flight) -> bool:
        """Never: the bend is the design's."""
        return False
