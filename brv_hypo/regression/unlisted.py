"""`UnlistedMoment`: a smooth or slowly turning moment that no listed mechanism has, tried in a mechanism's place.

`particular_share`: what a fit says of its mechanisms in particular, beyond changes of the coefficients that many
things bring.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial

import numpy as np

from brv_hypo.arrays import ComplexArray, FloatArray
from brv_hypo.constants import TURNING_FASTEST, TURNING_MERIDIAN, TURNING_RATES
from brv_hypo.mechanisms.checked import checked_terms
from brv_hypo.mechanisms.contract import Mechanism, Parameter, Term
from brv_hypo.model.term import Regressor, TimeBasis
from brv_hypo.motion.motion import Motion
from brv_hypo.regression.fit import HypothesisFit, settled
from brv_hypo.regression.free_moment import SHAPES, shape_of
from brv_hypo.regression.problem import Problem
from brv_hypo.regression.reduced import Reduced


class UnlistedMoment(Mechanism):
    """The shapes of a body's moment in its crossflow (Maple and Synge 1949) by name, acting in stretches of time."""

    name = "unlisted_moment"
    title = "a moment of a shape that no mechanism on the list has"
    claims = "nothing specific: any other moment that moved the vehicle"
    source = "Maple and Synge 1949"

    shapes: tuple[str, ...]

    def terms(self, motion: Motion, theta: Mapping[str, float]) -> tuple[Term, ...]:
        """Every component of every shape; those of one shape are one vector, whatever the body axes are."""
        return tuple(term for name in self.shapes for term in _terms_of(name, motion))


def _terms_of(name: str, motion: Motion) -> tuple[Term, ...]:
    components = shape_of(name, motion)
    if len(components) == 1:
        return (Term(name, components[0].real, components[0].imag),)
    return tuple(
        Term(f"{name} {part}", each.real, each.imag, vector=name)
        for part, each in zip(("cosine", "sine"), components, strict=True)
    )


def unlisted_moment(problem: Problem, listed: Sequence[Mechanism], beyond: float) -> UnlistedMoment | None:
    """The shapes that have more than the share `beyond` of their rms beyond what each listed mechanism reproduces.

    Over all flights; None where there is none. A mechanism with nonlinear parameters has no shape of its own, and
    leaves all of them.
    """
    motions = problem.frame.motions
    known = shapes_of(listed, motions)
    shapes = tuple(
        name
        for name in SHAPES
        for components in [over(motions, partial(shape_of, name))]
        if all(left_of(components, basis) > beyond for basis in known)
    )
    return UnlistedMoment(shapes=shapes) if shapes else None


def shapes_of(listed: Sequence[Mechanism], motions: Sequence[Motion]) -> list[FloatArray]:
    """Orthonormal columns of each mechanism's terms over all flights, real above imaginary (2 samples, terms)."""
    return [_basis(mechanism, motions) for mechanism in listed if not mechanism.parameters()]


def over(motions: Sequence[Motion], shape: Callable[[Motion], Sequence[ComplexArray]]) -> list[ComplexArray]:
    """The components (samples of all flights,) of a shape, flight after flight."""
    return [np.concatenate(each) for each in zip(*map(shape, motions), strict=True)]


def left_of(components: Sequence[ComplexArray], basis: FloatArray) -> float:
    """The least share of the rms of a shape's components that lies beyond the basis."""
    stacked = _stacked(components)
    beyond = np.linalg.norm(stacked - basis @ (basis.T @ stacked), axis=0)
    return float(np.min(beyond / np.linalg.norm(stacked, axis=0)))


def _basis(mechanism: Mechanism, motions: Sequence[Motion]) -> FloatArray:
    def components(motion: Motion) -> list[ComplexArray]:
        return [term.in_plane + 1j * term.out_of_plane for term in checked_terms(mechanism, motion, {})]

    return np.asarray(np.linalg.qr(_stacked(over(motions, components)))[0])


def _stacked(components: Sequence[ComplexArray]) -> FloatArray:
    return np.stack([np.concatenate([each.real, each.imag]) for each in components], axis=1)


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
        """The rate of turning; each is refined to half-way to its neighbours, one alone not to a moment at rest."""
        low, high = min(self.rates) - 0.5 * self.apart, max(self.rates) + 0.5 * self.apart
        if len(self.rates) == 1:
            low, high = (
                (low, min(high, -0.5 * self.apart)) if self.rates[0] < 0.0 else (max(low, 0.5 * self.apart), high)
            )
        return (Parameter(RATE, "rad/s", self.rates, (low, high), "rate of turning in body axes"),)

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


def _falls(problem: Problem, moment: TurningMoment, rates: Sequence[float], time_basis: TimeBasis) -> FloatArray:
    """Fall of the residual sum of squares that each rate brings with this course (rates,)."""
    reduced = Reduced(problem, problem.frame.with_mechanisms([moment]))
    columns = [
        Regressor(moment.name, term.name, ((RATE, rate),), time_basis, term.units)
        for rate in rates
        for term in moment.terms(problem.frame.motions[0], {RATE: rate})
    ]
    batch = reduced.batch(columns)
    return np.array([reduced.rss - reduced.fit(batch.of([2 * k, 2 * k + 1])).rss for k in range(len(rates))])


def plain_columns(fit: HypothesisFit) -> tuple[Regressor, ...]:
    """The selected columns without those that are characteristic of a mechanism."""
    telling = {(mechanism.name, term) for mechanism in fit.mechanisms for term in mechanism.characteristic}
    return tuple(column for column in fit.selected if (column.mechanism, column.term) not in telling)


def particular_share(problem: Problem, null: HypothesisFit, fit: HypothesisFit) -> float:
    """The share of what a fit explains beyond `null` that is lost without its characteristic columns.

    The knots of what is left move to where they fit best then. None where the fit has none of them; all of it where
    every column is, or no mechanism names any.
    """
    plain = plain_columns(fit)
    if not plain or not any(mechanism.characteristic for mechanism in fit.mechanisms):
        return 1.0
    if plain == fit.selected:
        return 0.0
    without = settled(problem, fit, (*problem.baseline, *plain), plain)
    return (without.rss - fit.rss) / max(null.rss - fit.rss, 1e-300)
