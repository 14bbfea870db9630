"""A smooth change of the static slope with Mach number and angle of attack: a Gaussian process, by its leading terms.

The slope's change over ln(Mach), and that of its bend with alpha, has the covariance of Matern with smoothness 5/2;
cosines over the range flown with the variances of its spectral density stand for it (Solin and Sarkka, Stat. Comput.
30:419, 2020). Over a narrow range the prior leaves next to nothing of it, so that a short flight keeps what it can tell
for other effects.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.polynomial.chebyshev import chebval, chebvander

from brv_hypo.arrays import FloatArray
from brv_hypo.flight.record import Flight
from brv_hypo.mechanisms.contract import Mechanism, Term
from brv_hypo.motion.measurement import BENT
from brv_hypo.motion.motion import Motion

SCHEDULE_LENGTH = 0.7
SCHEDULE_SMALLEST = 3e-3  # of the first term's prior, below which a term says nothing
SCHEDULE_NOTHING = 1e-3  # of the process's own size, the same
SCHEDULE_MOST = 24  # terms


class SlopeSchedule(Mechanism):
    """C_N' += alpha sum_k (c_k + b_k alpha^2) cos(k pi x), x = ln(Mach / low) / ln(high / low), with Gaussian priors.

    `low`, `high` are the Mach numbers between which it runs; beyond it keeps its last value. `size` (1/rad) is the
    standard deviation of the slope's change at a Mach number.
    """

    name = "slope_schedule"
    title = "static slope by Mach number"
    claims = "a slope of the in-plane moment that changes smoothly with Mach number"
    source = "Matern prior over ln(Mach)"
    wind_fixed = True
    time_variation = ("constant",)

    low: float
    high: float
    size: float

    def terms(self, motion: Motion, theta: Mapping[str, float]) -> tuple[Term, ...]:
        """One term for each cosine, times alpha, and one times its cube."""
        count = self.sizes.size
        cosines, nothing = chebvander(self._cosine(motion), count), np.zeros_like(motion.alpha)
        return tuple(
            Term(f"{name} cos {k}", alpha * cosines[:, k], nothing, units)
            for name, alpha, units in (("C_malpha", motion.alpha, "1/rad"), ("C_malpha3", motion.alpha**3, "1/rad^3"))
            for k in range(1, count + 1)
        )

    def tolerance(self, flight: Flight) -> tuple[float, ...] | None:
        """Standard deviation (1/rad, 1/rad^3) of each coefficient."""
        return (*self.sizes.tolist(), *(self.sizes / BENT**2).tolist())

    def of_each_flight(self, flight: Flight) -> bool:
        """Never: the schedule is the design's."""
        return False

    def known_schedule(self, coefficients: Sequence[float]) -> KnownSlopeSchedule:
        """The schedule with these coefficients (terms,), as one term."""
        return KnownSlopeSchedule(low=self.low, high=self.high, size=self.size, coefficients=tuple(coefficients))

    @property
    def sizes(self) -> FloatArray:
        """Prior sigmas (cosines,) of the slope's terms in 1/rad; none where the range is too narrow for any."""
        waves = np.pi * np.arange(1, SCHEDULE_MOST + 1) / self._range
        rate = np.sqrt(5.0) / SCHEDULE_LENGTH
        density = 16.0 / 3.0 * rate**5 / (rate**2 + waves**2) ** 3
        sigmas = self.size * np.sqrt(2.0 / self._range * density)
        least = max(SCHEDULE_SMALLEST * sigmas[0], SCHEDULE_NOTHING * self.size)
        return np.asarray(sigmas[sigmas > least], dtype=float)

    def _cosine(self, motion: Motion) -> FloatArray:
        """cos(pi x) of each sample; the cosines of multiples are Chebyshev polynomials of it."""
        place = np.log(np.clip(motion.mach, self.low, self.high) / self.low) / self._range
        return np.asarray(np.cos(np.pi * place), dtype=float)

    @property
    def _range(self) -> float:
        return float(np.log(self.high / self.low))


class KnownSlopeSchedule(SlopeSchedule):
    """A schedule whose coefficients are known, as one term; its own coefficient is 1 where they are right."""

    name = "slope_course"
    title = "static slope by a known schedule"

    coefficients: tuple[float, ...]

    def terms(self, motion: Motion, theta: Mapping[str, float]) -> tuple[Term, ...]:
        """The sum of the schedule's terms."""
        count = len(self.coefficients) // 2
        halves = self.coefficients[:count], self.coefficients[count:]
        slope, bend = (chebval(self._cosine(motion), (0.0, *half)) for half in halves)
        total = motion.alpha * (slope + motion.alpha**2 * bend)
        return (Term("C_malpha by the schedule", np.asarray(total), np.zeros_like(motion.alpha), "1"),)

    def tolerance(self, flight: Flight) -> tuple[float, ...] | None:
        """None: the schedule is known."""
        return None
