"""`UnlistedMoment`: a smooth or slowly turning moment that no listed mechanism has, tried in a mechanism's place.

`particular_share`: what a fit says of its mechanisms in particular, beyond changes of the coefficients that many
things bring.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial

import numpy as np

from brv_hypo.arrays import ComplexArray, FloatArray
from brv_hypo.constants import TURNING_FASTEST, TURNING_MERIDIAN
from brv_hypo.mechanisms.checked import checked_terms
from brv_hypo.mechanisms.contract import Mechanism, Term
from brv_hypo.model.term import Regressor
from brv_hypo.motion.motion import Motion
from brv_hypo.regression.fit import HypothesisFit, settled
from brv_hypo.regression.free_moment import SHAPES, shape_of
from brv_hypo.regression.problem import Problem


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


def fastest_turning(motion: Motion) -> float:
    """The largest rate, rad/s either way, at which a moment is looked for that turns in the body."""
    fastest = TURNING_FASTEST * (
        float(np.mean(np.abs(motion.p))) + float(np.percentile(np.abs(motion.windward_meridian_rate), TURNING_MERIDIAN))
    )
    return min(fastest, 0.5 * np.pi / float(np.median(np.diff(motion.time))))


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
