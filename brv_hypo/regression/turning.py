"""A moment that turns in the body at a constant rate: what a body-fixed moment can follow only in many steps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np

from brv_hypo.arrays import ComplexArray, FloatArray
from brv_hypo.constants import TURNING_FASTEST, TURNING_MERIDIAN, TURNING_RATES
from brv_hypo.mechanisms.contract import Mechanism, Parameter, Term
from brv_hypo.model.term import Regressor, TimeBasis
from brv_hypo.motion.motion import Motion
from brv_hypo.regression.problem import Problem
from brv_hypo.regression.reduced import Reduced
from brv_hypo.regression.unlisted import left_of, over, shapes_of

RATE = "rate"


class TurningMoment(Mechanism):
    """A transverse moment of constant size whose direction in body axes turns at `rate` rad/s; `about` s, where both
    components stand along the axes.
    """

    name = "turning_moment"
    title = "a moment that turns in the body"
    claims = "nothing specific: a moment as of separated flow, a wake or loose mass"
    source = "a rotating vector in body axes"
    terms_enter_together = True

    about: float
    rates: tuple[float, ...]
    apart: float

    def parameters(self) -> tuple[Parameter, ...]:
        """The rate of turning; each is refined to half-way to its neighbours."""
        bounds = (min(self.rates) - 0.5 * self.apart, max(self.rates) + 0.5 * self.apart)
        return (Parameter(RATE, "rad/s", self.rates, bounds, "rate of turning in body axes"),)

    def terms(self, motion: Motion, theta: Mapping[str, float]) -> tuple[Term, ...]:
        """The two components."""
        return tuple(
            Term(name, each.real, each.imag)
            for name, each in zip(("turning y", "turning z"), self._components(motion, theta[RATE]), strict=True)
        )

    def _components(self, motion: Motion, rate: float) -> tuple[ComplexArray, ComplexArray]:
        along = np.exp(1j * (motion.windward_meridian - rate * (motion.time - self.about)))
        return along, 1j * along


def turning_moment(
    problem: Problem, listed: Sequence[Mechanism], beyond: float, start: float, stop: float
) -> TurningMoment | None:
    """The moment, acting from `start` to `stop` s, of the rate that explains most of the first fit's residual.

    Rates at which a listed mechanism reproduces all but the share `beyond` of its rms are left out, and what turns by
    less than half a turn meanwhile; None where nothing is left.
    """
    motions = problem.frame.motions
    apart = np.pi / (stop - start)
    known = shapes_of(listed, motions)
    everything = TurningMoment(about=start, rates=_rates(motions, apart), apart=apart)
    rates = tuple(
        rate
        for rate in everything.rates
        for components in [over(motions, partial(everything._components, rate=rate))]
        if all(left_of(components, basis) > beyond for basis in known)
    )
    if not rates:
        return None
    falls = _falls(problem, everything, rates, TimeBasis("jump", start, stop))
    return TurningMoment(about=start, rates=(rates[int(np.argmax(falls))],), apart=2.0 * apart)


def fastest_turning(motion: Motion) -> float:
    """The largest rate, rad/s either way, at which a moment is looked for that turns in the body."""
    fastest = TURNING_FASTEST * (
        float(np.mean(np.abs(motion.p))) + float(np.percentile(np.abs(motion.windward_meridian_rate), TURNING_MERIDIAN))
    )
    return min(fastest, 0.5 * np.pi / float(np.median(np.diff(motion.time))))


def _rates(motions: Sequence[Motion], apart: float) -> tuple[float, ...]:
    """Rates in rad/s, either way, half a turn or more apart."""
    count = min(int(max(map(fastest_turning, motions)) / apart), TURNING_RATES // 2)
    return tuple(apart * k for k in range(-count, count + 1) if k)


def _falls(
    problem: Problem, moment: TurningMoment, rates: Sequence[float], time_basis: TimeBasis
) -> FloatArray:
    """Fall of the residual sum of squares that each rate brings with this course (rates,)."""
    reduced = Reduced(problem, problem.frame.with_mechanisms([moment]))
    columns = [
        Regressor(moment.name, term.name, ((RATE, rate),), time_basis, term.units)
        for rate in rates
        for term in moment.terms(problem.frame.motions[0], {RATE: rate})
    ]
    batch = reduced.batch(columns)
    return np.array([reduced.rss - reduced.fit(batch.of([2 * k, 2 * k + 1])).rss for k in range(len(rates))])
