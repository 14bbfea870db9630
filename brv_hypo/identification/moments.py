"""The regression's columns at the estimated motion: moment coefficients per unit of each coefficient."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from brv_hypo.arrays import ComplexArray, FloatArray
from brv_hypo.identification.knots import on_grid, placed
from brv_hypo.identification.structure import Structure
from brv_hypo.mechanisms.contract import Mechanism, Term
from brv_hypo.model.columns import Column, Theta
from brv_hypo.model.common_time import OwnTime
from brv_hypo.motion.motion import Motion

Values = Mapping[str, float]
Known = dict[tuple[str, Theta], dict[str, Term]]


@dataclass(frozen=True)
class Past:
    """The past of a motion at the delays that are parameters."""

    motions: Mapping[float, Motion]

    def __call__(self, delay: float) -> Motion:
        """The motion `delay` s earlier; raises UnknownDelayError for a delay that is no parameter."""
        near = min(self.motions, key=lambda known: abs(known - delay), default=None)
        if near is None or abs(near - delay) > 1e-9 * max(abs(delay), 1e-9):
            raise UnknownDelayError(delay, sorted(self.motions))
        return self.motions[near]


class UnknownDelayError(ValueError):
    """A mechanism asked for a delay that is none of its parameters."""

    def __init__(self, delay: float, known: list[float]) -> None:
        super().__init__(
            f"a mechanism asked for the motion {delay:g} s earlier, but the delays that are parameters are {known}. "
            "The likelihood differentiates delays that are parameters with is_delay set: declare it as one"
        )


@dataclass(frozen=True)
class MomentModel:
    """What the columns of a structure are at any motion; `uses_rates`: whether rates of alpha or meridian
    matter to them.
    """

    structure: Structure
    mechanisms: Mapping[str, Mechanism]
    uses_rates: bool = True

    @cached_property
    def shape_parameters(self) -> tuple[str, ...]:
        """The coefficients and nonlinear parameters that change the columns themselves.

        C_mw of Eq. 5.1 changes those of mechanisms with parameters of their own, as in the regression.
        """
        used = {column.mechanism for column in self.structure.columns}
        movers = tuple(mover.name for mover in self.structure.movers)
        if not any(self.mechanisms[name].parameters() for name in used):
            return movers
        return (*movers, *(name for name, _ in self._wind_fixed(self.structure.columns)))

    def planes(
        self, now: Motion, past: Mapping[float, Motion], theta: Values, half: FloatArray, own: OwnTime | None = None
    ) -> tuple[tuple[Column, ...], ComplexArray]:
        """The columns, moved, and (C_N' + i C_Z') per unit of each without its course, (columns, n)."""
        columns = self.structure.at(theta)
        known: Known = {}
        earlier = {
            delay: self._with_in_plane_moment(motion, theta, columns, half, own, {})
            for delay, motion in past.items()
        }
        motion = self._with_in_plane_moment(now, theta, columns, half, own, known)
        if earlier:
            motion = replace(motion, history=Past(earlier))
        terms = self._terms(columns, motion, known)
        return columns, np.array([term.in_plane + 1j * term.out_of_plane for term in terms])

    def _wind_fixed(self, columns: Sequence[Column]) -> list[tuple[str, Column]]:
        named = zip(self.structure.names, columns, strict=True)
        return [(name, column) for name, column in named if self.mechanisms[column.mechanism].wind_fixed]

    def _with_in_plane_moment(
        self,
        motion: Motion,
        theta: Values,
        columns: Sequence[Column],
        half: FloatArray,
        own: OwnTime | None,
        known: Known,
    ) -> Motion:
        """C_mw of Eq. 5.1 from the wind-fixed columns; their terms go into `known`."""
        fixed = self._wind_fixed(columns)
        terms = self._terms([column for _, column in fixed], motion, known)
        moment = np.zeros_like(motion.alpha)
        for (name, column), term in zip(fixed, terms, strict=True):
            here = placed(column.course, motion.time, half, own)
            weight = 1.0 if column.course.kind == "constant" else on_grid(*here)
            moment = moment + theta[name] * weight * term.in_plane
        return replace(motion, in_plane_moment=moment)

    def _terms(self, columns: Sequence[Column], motion: Motion, known: Known) -> list[Term]:
        """The term of each column; a mechanism is asked once for each of its thetas."""
        for column in columns:
            key = (column.mechanism, column.theta)
            if key not in known:
                terms = self.mechanisms[column.mechanism].terms(motion, dict(column.theta))
                known[key] = {term.name: term for term in terms}
        return [known[column.mechanism, column.theta][column.term] for column in columns]


def uses_rates(columns: Sequence[Column], mechanisms: Mapping[str, Mechanism], motion: Motion) -> bool:
    """Whether any column changes with the rates of alpha or of the meridian, tried on a recorded motion."""
    other = replace(
        motion, alpha_rate=motion.alpha_rate + 1.0, windward_meridian_rate=motion.windward_meridian_rate + 1.0
    )
    for mechanism, theta in {(column.mechanism, column.theta) for column in columns}:
        both = (mechanisms[mechanism].terms(m, dict(theta)) for m in (motion, other))
        for term, changed in zip(*both, strict=True):
            same = np.array_equal(term.in_plane, changed.in_plane)
            if not same or not np.array_equal(term.out_of_plane, changed.out_of_plane):
                return True
    return False
