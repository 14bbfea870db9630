"""The regression's columns at the estimated motion: moment coefficients per unit of each coefficient."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal

import numpy as np

from brv_hypo.arrays import ComplexArray, FloatArray
from brv_hypo.identification.knots import on_grid, placed
from brv_hypo.identification.shapes import Memory
from brv_hypo.identification.structure import Structure
from brv_hypo.mechanisms.contract import Mechanism, Term
from brv_hypo.model.columns import Column, Theta
from brv_hypo.model.common_time import OwnTime
from brv_hypo.motion.motion import Motion

Values = Mapping[str, float]
RateUse = Literal["unused", "affine", "other"]
Known = dict[tuple[str, Theta], dict[str, Term]]

_ROUNDING = 1e-9


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
    """What the columns of a structure are at any motion; `rates`: how they change with those of alpha and meridian."""

    structure: Structure
    mechanisms: Mapping[str, Mechanism]
    rates: RateUse = "other"
    _known: Memory[tuple[Motion, Known]] = field(default_factory=Memory, compare=False, repr=False)

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
        earlier = {
            delay: self._with_in_plane_moment(motion, theta, columns, half, own) for delay, motion in past.items()
        }
        motion = self._with_in_plane_moment(now, theta, columns, half, own)
        if earlier:
            motion = replace(motion, history=Past(earlier))
        terms = self._terms(columns, motion, dict(self._wind_fixed_terms(now)))
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
    ) -> Motion:
        """C_mw of Eq. 5.1 from the wind-fixed columns."""
        fixed = self._wind_fixed(columns)
        terms = self._terms([column for _, column in fixed], motion, self._wind_fixed_terms(motion))
        moment = np.zeros_like(motion.alpha)
        for (name, column), term in zip(fixed, terms, strict=True):
            here = placed(column.course, motion.time, half, own)
            weight = 1.0 if column.course.kind == "constant" else on_grid(*here)
            moment = moment + theta[name] * weight * term.in_plane
        return replace(motion, in_plane_moment=moment)

    def _wind_fixed_terms(self, motion: Motion) -> Known:
        """Terms of wind-fixed columns that were evaluated on this motion already."""
        return self._known((id(motion),), lambda: (motion, {}))[1]

    def _terms(self, columns: Sequence[Column], motion: Motion, known: Known) -> list[Term]:
        """The term of each column; a mechanism is asked once for each of its thetas."""
        for column in columns:
            key = (column.mechanism, column.theta)
            if key not in known:
                terms = self.mechanisms[column.mechanism].terms(motion, dict(column.theta))
                known[key] = {term.name: term for term in terms}
        return [known[column.mechanism, column.theta][column.term] for column in columns]


def use_of_rates(columns: Sequence[Column], mechanisms: Mapping[str, Mechanism], motion: Motion) -> RateUse:
    """How the columns change with the rates of alpha and of the meridian, tried on a recorded motion."""
    rng, found = np.random.default_rng(0), set()
    changes = {name: rng.standard_normal(motion.time.size) for name in ("alpha_rate", "windward_meridian_rate")}
    motions = [
        replace(motion, **{name: getattr(motion, name) + times * change for name, change in changes.items()})
        for times in (0.0, 1.0, 2.0)
    ]
    for mechanism, theta in {(column.mechanism, column.theta) for column in columns}:
        each = (mechanisms[mechanism].terms(m, dict(theta)) for m in motions)
        now, once, twice = (np.array([(term.in_plane, term.out_of_plane) for term in terms]) for terms in each)
        if not np.array_equal(now, once):
            bent = np.max(np.abs(twice - 2.0 * once + now), initial=0.0)
            # A mechanism with parameters may multiply what C_mw has of the rates by what it has itself.
            straight = bent <= _ROUNDING * np.max(np.abs(once - now)) and not mechanisms[mechanism].parameters()
            found.add("affine" if straight else "other")
    return "other" if "other" in found else "affine" if found else "unused"
