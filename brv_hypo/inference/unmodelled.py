"""`UnmodelledMoment`: a smooth or slowly turning moment that no listed mechanism has, tried in a mechanism's place."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial

import numpy as np

from brv_hypo.arrays import ComplexArray, FloatArray
from brv_hypo.constants import TURNING_FASTEST, TURNING_MERIDIAN, TURNING_RATES
from brv_hypo.inference.fit import HypothesisFit
from brv_hypo.inference.free_moment import SHAPES, shape_of
from brv_hypo.inference.problem import Problem
from brv_hypo.mechanisms.checked import checked
from brv_hypo.mechanisms.contract import Mechanism, Parameter, Term
from brv_hypo.model.term import Regressor, theta_grid
from brv_hypo.motion.motion import Motion


class UnmodelledMoment(Mechanism):
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


def unmodelled_moments(problem: Problem, listed: Sequence[Mechanism], beyond: float) -> tuple[UnmodelledMoment, ...]:
    """One of each shape with more than the share `beyond` of its rms beyond what each listed mechanism reproduces.

    Over all flights. A mechanism with nonlinear parameters has no shape of its own, and leaves all of them.
    """
    motions = problem.frame.motions
    known = shapes_of(listed, motions)
    return tuple(
        UnmodelledMoment(shapes=(name,))
        for name in SHAPES
        for components in [over(motions, partial(shape_of, name))]
        if all(left_of(components, basis) > beyond for basis in known)
    )


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
    rate: float
    apart: float

    def parameters(self) -> tuple[Parameter, ...]:
        """The rate, to half-way to its neighbours: not to a moment at rest."""
        reach = (self.rate - 0.5 * self.apart, self.rate + 0.5 * self.apart)
        return (Parameter(RATE, "rad/s", (self.rate,), reach, "rate of turning in body axes"),)

    def terms(self, motion: Motion, theta: Mapping[str, float]) -> tuple[Term, ...]:
        """The two components."""
        along = np.exp(1j * (motion.windward_meridian - theta[RATE] * (motion.time - self.about)))
        components = zip(("turning y", "turning z"), (along, 1j * along), strict=True)
        return tuple(Term(name, each.real, each.imag) for name, each in components)


def turning_moments(
    problem: Problem, listed: Sequence[Mechanism], beyond: float, start: float, stop: float
) -> tuple[TurningMoment, ...]:
    """Of rates that turn by half a turn or more from `start` to `stop` s, half a turn apart, but for those at which a
    listed mechanism reproduces all but the share `beyond` of its rms.
    """
    motions, apart = problem.frame.motions, np.pi / (stop - start)
    known = shapes_of(listed, motions)
    count = min(int(max(map(fastest_turning, motions)) / apart), TURNING_RATES // 2)
    every = (TurningMoment(about=start, rate=apart * k, apart=apart) for k in range(-count, count + 1) if k)
    return tuple(each for each in every if all(left_of(_complex(each, motions), basis) > beyond for basis in known))


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
    return np.asarray(np.linalg.qr(_stacked(_complex(mechanism, motions)))[0])


def _complex(mechanism: Mechanism, motions: Sequence[Motion]) -> list[ComplexArray]:
    """Its terms over all flights, at the first point of its grid."""

    def components(motion: Motion) -> list[ComplexArray]:
        terms = checked(mechanism).terms(motion, dict(theta_grid(mechanism)[0]))
        return [term.in_plane + 1j * term.out_of_plane for term in terms]

    return over(motions, components)


def _stacked(components: Sequence[ComplexArray]) -> FloatArray:
    return np.stack([np.concatenate([each.real, each.imag]) for each in components], axis=1)


def fastest_turning(motion: Motion) -> float:
    """The largest rate, rad/s either way, at which a moment is looked for that turns in the body."""
    fastest = TURNING_FASTEST * (
        float(np.mean(np.abs(motion.p))) + float(np.percentile(np.abs(motion.windward_meridian_rate), TURNING_MERIDIAN))
    )
    return min(fastest, 0.5 * np.pi / float(np.median(np.diff(motion.time))))


def plain_columns(fit: HypothesisFit) -> tuple[Regressor, ...]:
    """The selected columns without those that are characteristic of a mechanism."""
    specific = {(mechanism.name, term) for mechanism in fit.mechanisms for term in mechanism.characteristic}
    return tuple(column for column in fit.selected if (column.mechanism, column.term) not in specific)
