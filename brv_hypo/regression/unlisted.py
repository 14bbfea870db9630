"""A moment of ordinary shapes that no mechanism on the list has: something else *instead of* a listed one."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from brv_hypo.arrays import ComplexArray
from brv_hypo.mechanisms.contract import Mechanism, Term
from brv_hypo.mechanisms.isolation import checked_terms
from brv_hypo.motion.motion import Motion
from brv_hypo.regression.free_moment import SHAPES, shape_of
from brv_hypo.regression.problem import Problem

# Share of its rms beyond what a listed mechanism's terms reproduce, from which a shape is not on the list. The studies
# call an effect reproduced from the same share upwards.
_OUTSIDE = 0.1


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


def unlisted_moment(problem: Problem, listed: Sequence[Mechanism]) -> UnlistedMoment | None:
    """The shapes that no listed mechanism reproduces on the first flight; None where each is reproduced.

    A mechanism with nonlinear parameters has no shape of its own, and leaves all of them.
    """
    motion = problem.frame.motions[0]
    known = [_basis(mechanism, motion) for mechanism in listed if not mechanism.parameters()]
    shapes = tuple(
        name for name in SHAPES if all(_outside(shape_of(name, motion), basis) for basis in known)
    )
    return UnlistedMoment(shapes=shapes) if shapes else None


def _basis(mechanism: Mechanism, motion: Motion) -> ComplexArray:
    """Orthonormal columns of a mechanism's terms, both components stacked (2 samples, terms)."""
    terms = checked_terms(mechanism, motion, {})
    stacked = np.column_stack([np.concatenate([term.in_plane, term.out_of_plane]) for term in terms])
    return np.asarray(np.linalg.qr(stacked)[0])


def _outside(components: Sequence[ComplexArray], basis: ComplexArray) -> bool:
    """Whether every component of a shape has more than that share of its rms beyond the basis."""

    def left() -> Iterator[float]:
        for component in components:
            stacked = np.concatenate([component.real, component.imag])
            yield float(np.linalg.norm(stacked - basis @ (basis.T @ stacked)) / np.linalg.norm(stacked))

    return min(left()) > _OUTSIDE
