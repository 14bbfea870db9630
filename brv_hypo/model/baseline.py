"""The baseline in every hypothesis: static in-plane moment with its slow drift, its cubic part, and pitch damping.

    C_N' = sum_k (C_m0_k P_k + C_malpha_k P_k alpha) + (C_malpha3 + drift x) alpha^3,   C_mq in both channels

P_k are Legendre polynomials of time or Mach number; the cubic part has Gaussian priors within what bodies do. A
baseline may hold a smooth change of slope and bend with Mach number besides (`SlopeSchedule`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.polynomial import Legendre
from numpy.polynomial.chebyshev import chebvander
from numpy.polynomial.legendre import legvander
from pydantic import Field

from brv_hypo.arrays import FloatArray
from brv_hypo.flight.record import Flight
from brv_hypo.mechanisms.contract import Mechanism, Term
from brv_hypo.motion.motion import Motion
from brv_hypo.motion.smoother import BENT

BEND_DRIFT = 0.5  # what the bend changes by, of itself (1 sigma), between the ends of a flight: about what slopes do
Quantity = Literal["time", "mach", "speed"]


def static_terms(motion: Motion) -> tuple[Term, Term]:
    """The wind-fixed in-plane moment C_mw = C_m0 + C_malpha alpha of Eq. 5.1; out-of-plane zero."""
    nothing = np.zeros_like(motion.alpha)
    return (Term("C_m0", np.ones_like(motion.alpha), nothing, "1"), Term("C_malpha", motion.alpha, nothing, "1/rad"))


def pitch_damping_term(motion: Motion) -> Term:
    """C_mq: C_m += C_mq q d / 2V and C_n += C_mq r d / 2V, turned into the plane of alpha."""
    rate = motion.plane_rates
    return Term("C_mq", rate.real, rate.imag, "1/rad")


class DesignMoment(Mechanism):
    """A static moment in the plane of alpha that belongs to the design: every flight has the same."""

    time_variation = ("constant",)
    wind_fixed = True

    def of_each_flight(self, flight: Flight) -> bool:
        """Never."""
        return False


class StaticMoment(DesignMoment):
    """C_m0 and C_malpha, each with Legendre polynomials over [start, stop] as its slow drift."""

    name, title = "static", "static in-plane moment"
    claims = "the moment of a symmetric vehicle in the plane of the angle of attack"
    source = "report, Section 5.3"

    start: float = Field(description="of `by`")
    stop: float = Field(description="of `by`")
    offset_degree: int = Field(default=1, description="of the polynomial of C_m0")
    slope_degree: int = Field(default=2, description="of that of C_malpha")
    by: Literal["time", "mach"] = Field(default="time", description="what polynomials are of; constant beyond its ends")
    reynolds: tuple[float, float] | None = Field(default=None, description="decades between which C_malpha changes")
    speeds: tuple[float, float] | None = Field(default=None, description="m/s, the same")

    def terms(self, motion: Motion, theta: Mapping[str, float]) -> tuple[Term, ...]:
        """Each static term times each polynomial; the first of each is the mean over the window."""
        along = motion.time if self.by == "time" else motion.mach
        polynomials = legvander(scaled(along, self.start, self.stop), max(self.offset_degree, self.slope_degree))
        offset, slope = static_terms(motion)
        found: list[Term] = []
        for term, degree in ((offset, self.offset_degree), (slope, self.slope_degree)):
            for order in range(degree + 1):
                name = term.name if order == 0 else f"{term.name} drift {order}"
                found.append(replace(term, name=name, in_plane=term.in_plane * polynomials[..., order]))
        if self.reynolds is not None:
            drift = scaled(np.log10(motion.reynolds), *self.reynolds)
            found.append(replace(slope, name="C_malpha drift Re", in_plane=motion.alpha * drift))
        if self.speeds is not None:
            drift = scaled(motion.velocity, *self.speeds)
            found.append(replace(slope, name="C_malpha drift V", in_plane=motion.alpha * drift))
        return tuple(found)

    def mean_slope(self, motion: Motion, values: Mapping[str, float]) -> float:
        """Mean over a motion of the slope (1/rad) that all its terms make together; `values` by term's name."""
        at_one = replace(motion, alpha=np.ones_like(motion.alpha))
        slopes = (values[t.name] * t.in_plane for t in self.terms(at_one, {}) if t.name.startswith("C_malpha"))
        return float(np.mean(np.sum(list(slopes), axis=0)))


# Share of the speed by which it may depart from a polynomial before C_malpha follows it too: stiffness follows Mach
# number about in proportion, and a change of it of a few parts in ten thousand of the moment is not detected.
WAVERING_SPEED = 5e-5


def wavering_speeds(curves: Sequence[tuple[FloatArray, FloatArray]], degree: int) -> tuple[float, float] | None:
    """The ends of the speeds (m/s), where they change otherwise than a polynomial can follow; None where it can.
    `curves`, one a flight, are what the polynomial of that `degree` is of, and the speed (n,). Wind along the track,
    drag that goes with the angle of attack, and a change of temperature do it.
    """
    wavers = False
    for along, speed in curves:
        left = speed - Legendre.fit(along, speed, degree)(along)
        wavers |= bool(np.std(left) > WAVERING_SPEED * np.mean(speed))
    if not wavers:
        return None
    speeds = np.concatenate([speed for _, speed in curves])
    return float(speeds.min()), float(speeds.max())


def scaled(values: FloatArray, low: float, high: float) -> FloatArray:
    """Values from -1 at `low` to 1 at `high`, and no farther."""
    return np.clip((2.0 * values - low - high) / (high - low), -1.0, 1.0)


class PitchDamping(Mechanism):
    """C_mq in both channels, constant."""

    name, title = "pitch damping", "pitch damping"
    claims = "a moment against the transverse rates"
    source = "standard aerodynamics of rotationally symmetric vehicles"
    time_variation = ("constant",)

    def terms(self, motion: Motion, theta: Mapping[str, float]) -> tuple[Term, ...]:
        """One term: C_mq."""
        return (pitch_damping_term(motion),)


class StaticBend(DesignMoment):
    """C_N' += (C_malpha3 + drift x) alpha^3, the first odd power after the slope; Gaussian priors. x runs from -1 to 1
    between the ends of `drift`; the bend is `slope` at BENT, 1 sigma.
    """

    name, title = "static_bend", "bend of the static moment"
    claims = "a static moment that is not in proportion to the angle of attack"
    source = "Murphy, BRL R 1216 (1963): cubic static moment"

    slope: float = Field(description="1 sigma, 1/rad at 0.2 rad")
    drift: tuple[Quantity, float, float] | None = Field(default=None, description="with what it drifts, and its ends")

    def terms(self, motion: Motion, theta: Mapping[str, float]) -> tuple[Term, ...]:
        """C_malpha3, and its drift where it has one."""
        cube, nothing = motion.alpha**3, np.zeros_like(motion.alpha)
        bend = Term("C_malpha3", cube, nothing, "1/rad^3")
        if self.drift is None:
            return (bend,)
        by, low, high = self.drift
        along = {"time": motion.time, "mach": motion.mach, "speed": motion.velocity}[by]
        return bend, Term("C_malpha3 drift 1", cube * scaled(along, low, high), nothing, "1/rad^3")

    def tolerance(self, flight: Flight) -> tuple[float, ...] | None:
        """Standard deviation (1/rad^3) of each coefficient."""
        bend = abs(self.slope) / BENT**2
        return (bend,) if self.drift is None else (bend, BEND_DRIFT * bend)


# The slope's change over ln(Mach), and that of its bend with alpha, has the covariance of Matern with smoothness 5/2;
# cosines over the range flown with the variances of its spectral density are near it (Solin and Sarkka, Stat. Comput.
# 30:419, 2020). Over a narrow range the prior leaves next to nothing of it, for a short flight to tell other effects.
SCHEDULE_LENGTH = 0.7
SCHEDULE_SMALLEST = 3e-3  # of the first term's prior, below which a term says nothing
SCHEDULE_NOTHING = 1e-3  # of the process's own size, the same
SCHEDULE_MOST = 24  # terms


class SlopeSchedule(DesignMoment):
    """C_N' += alpha sum_k (c_k + b_k alpha^2) cos(k pi x), x = ln(Mach / low) / ln(high / low), with Gaussian priors.
    Beyond `low` and `high` it keeps its last value.
    """

    name, title = "slope_schedule", "static slope by Mach number"
    claims = "a slope of the in-plane moment that changes smoothly with Mach number"
    source = "Matern prior over ln(Mach)"

    low: float = Field(description="least Mach number")
    high: float = Field(description="greatest")
    size: float = Field(description="1 sigma of the slope's change, 1/rad")

    def terms(self, motion: Motion, theta: Mapping[str, float]) -> tuple[Term, ...]:
        """One term for each cosine, times alpha, and one times its cube."""
        count = self.sizes.size
        place = np.log(np.clip(motion.mach, self.low, self.high) / self.low) / self._range
        # The cosines of multiples of pi x are Chebyshev polynomials of its cosine.
        cosines, nothing = chebvander(np.cos(np.pi * place), count), np.zeros_like(motion.alpha)
        return tuple(
            Term(f"{name} cos {k}", alpha * cosines[:, k], nothing, units)
            for name, alpha, units in (("C_malpha", motion.alpha, "1/rad"), ("C_malpha3", motion.alpha**3, "1/rad^3"))
            for k in range(1, count + 1)
        )

    def tolerance(self, flight: Flight) -> tuple[float, ...] | None:
        """Standard deviation (1/rad, 1/rad^3) of each coefficient."""
        return (*self.sizes.tolist(), *(self.sizes / BENT**2).tolist())

    @property
    def sizes(self) -> FloatArray:
        """Prior sigmas (cosines,) of the slope's terms in 1/rad; none where the range is too narrow for any."""
        waves = np.pi * np.arange(1, SCHEDULE_MOST + 1) / self._range
        rate = np.sqrt(5.0) / SCHEDULE_LENGTH
        density = 16.0 / 3.0 * rate**5 / (rate**2 + waves**2) ** 3
        sigmas = self.size * np.sqrt(2.0 / self._range * density)
        least = max(SCHEDULE_SMALLEST * sigmas[0], SCHEDULE_NOTHING * self.size)
        return np.asarray(sigmas[sigmas > least], dtype=float)

    @property
    def _range(self) -> float:
        return float(np.log(self.high / self.low))
