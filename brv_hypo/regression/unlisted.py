"""A moment of ordinary shapes that no mechanism on the list has: something else *instead of* a listed one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from brv_hypo.arrays import ComplexArray, FloatArray
from brv_hypo.mechanisms.contract import Mechanism, Term
from brv_hypo.mechanisms.isolation import checked_terms
from brv_hypo.motion.motion import Motion
from brv_hypo.regression.free_moment import SHAPES, shape_of
from brv_hypo.regression.problem import Problem


class UnlistedMoment(Mechanism):
    """The shapes of a body's moment in its crossflow (Maple and Synge 1949) by name, acting in stretches of time."""

    name = "unlisted_moment"
    title = "a moment of a shape that no mechanism on the list has"
    claims = "nothing: it stands for whatever else moved the vehicle"
    source = "Maple and Synge 1949"

    shapes: tuple[str, ...]

    def terms(self, motion: Motion, theta: Mapping[str, float]) -> tuple[Term, ...]:
        """Every component of every shape."""
        return tuple(
            Term(name if len(components) == 1 else f"{name} {'sine' if part else 'cosine'}", c.real, c.imag)
            for name in self.shapes
            for components in [shape_of(name, motion)]
            for part, c in enumerate(components)
        )


def unlisted_moment(problem: Problem, listed: Sequence[Mechanism], beyond: float) -> UnlistedMoment | None:
    """The shapes that have more than the share `beyond` of their rms beyond what each listed mechanism reproduces.

    On the first flight; None where there is none. A mechanism with nonlinear parameters has no shape of its own, and
    leaves all of them.
    """
    motion = problem.frame.motions[0]
    known = shapes_of(listed, motion)
    shapes = tuple(
        name for name in SHAPES if all(left_of(shape_of(name, motion), basis) > beyond for basis in known)
    )
    return UnlistedMoment(shapes=shapes) if shapes else None


def shapes_of(listed: Sequence[Mechanism], motion: Motion) -> list[FloatArray]:
    """Orthonormal columns of each mechanism's terms, both components stacked (2 samples, terms)."""
    return [_basis(mechanism, motion) for mechanism in listed if not mechanism.parameters()]


def left_of(components: Sequence[ComplexArray], basis: FloatArray) -> float:
    """The least share of the rms of a shape's components that lies beyond the basis."""
    stacked = np.stack([np.concatenate([each.real, each.imag]) for each in components], axis=1)
    beyond = np.linalg.norm(stacked - basis @ (basis.T @ stacked), axis=0)
    return float(np.min(beyond / np.linalg.norm(stacked, axis=0)))


def _basis(mechanism: Mechanism, motion: Motion) -> FloatArray:
    terms = checked_terms(mechanism, motion, {})
    stacked = np.column_stack([np.concatenate([term.in_plane, term.out_of_plane]) for term in terms])
    return np.asarray(np.linalg.qr(stacked)[0])
