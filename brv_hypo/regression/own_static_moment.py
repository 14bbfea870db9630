"""A fit repeated until its static moment C_mw and what lags behind it agree. Entrance: `converged`.

What lags or sticks follows the static moment C_mw of Eq. 5.1, which the fit itself finds: a fixed point.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.constants import FOLLOWED_APART, FOLLOWED_FALL, FOLLOWED_MIXED, FOLLOWED_ROUNDS, FOLLOWED_STALLS
from brv_hypo.regression.fit import HypothesisFit, follows_static_moment, held, renewed
from brv_hypo.regression.problem import Problem
from brv_hypo.regression.refinement import SETTLED

# A round is one step as it is: whether one lowers what is left is rounding here, and no guide.
_ONE_STEP = (SETTLED[-1]._replace(most=0),)


@dataclass(frozen=True)
class _Place:
    """C_mw (nodes of all flights,), knots and delays (parameters,), and the whitened residual (rows,) there."""

    static_moment: FloatArray
    nonlinear: FloatArray
    residual: FloatArray

    @classmethod
    def of(cls, fit: HypothesisFit) -> _Place:
        """Where a fit's own coefficients lead."""
        made = fit.frame.static_moments(fit.columns, fit.values)
        places = np.array([parameter.value for parameter in fit.nonlinear])
        return cls(np.concatenate(made), places, fit.residual)

    def mixed(self, other: _Place, share: float) -> _Place:
        """A share of the way from another place to this one short of it, or beyond."""
        return _Place(
            self.static_moment - share * (self.static_moment - other.static_moment),
            self.nonlinear - share * (self.nonlinear - other.nonlinear),
            self.residual - share * (self.residual - other.residual),
        )


@dataclass(frozen=True)
class _Round:
    """Where a fit was made to begin, and where it led."""

    begun: _Place
    ended: _Place

    @property
    def moved(self) -> FloatArray:
        """By how much what it leaves differs (rows,)."""
        return self.ended.residual - self.begun.residual


def converged(problem: Problem, fit: HypothesisFit) -> HypothesisFit:
    """The same with knots and delays where their steps end: rounding moves them no more than the data let it.

    C_mw is brought up to date until it and the fit stand, or until what moves is no longer that but a delay that the
    data hardly tell, whose steps come to no rest.
    """
    found = renewed(problem, fit, SETTLED)
    if not problem.refine or not follows_static_moment(found.mechanisms):
        return found
    rounds: list[_Round] = []
    begin = _Place.of(found)
    least, stalled = math.inf, 0
    for _ in range(FOLLOWED_ROUNDS):
        found = _begun_at(problem, found, begin)
        ended = _Place.of(found)
        if ended.nonlinear.size != begin.nonlinear.size:  # knots that came to one place are one from here on
            begin, rounds = ended, []
            continue
        rounds.append(_Round(begin, ended))
        # No estimate moved by more standard errors than what is predicted by standard deviations.
        moved = math.sqrt(problem.samples / found.rss) * float(np.linalg.norm(rounds[-1].moved))
        stalled += moved > FOLLOWED_FALL * least
        least = min(least, moved)
        if moved < FOLLOWED_APART or stalled == FOLLOWED_STALLS:
            break
        begin = _next(rounds[-2:])
    return found


def _next(rounds: list[_Round]) -> _Place:
    """Where to begin next, from the last round and the one before: Anderson's acceleration (J. ACM 12:547, 1965)."""
    before, now = rounds[0], rounds[-1]
    change = now.moved - before.moved
    square = float(change @ change)
    share = float(now.moved @ change) / square if square > 0.0 else 0.0
    low, high = FOLLOWED_MIXED
    return now.ended.mixed(before.ended, share if low <= share <= high else 0.0)


def _begun_at(problem: Problem, fit: HypothesisFit, place: _Place) -> HypothesisFit:
    """The fit refined from these knots and delays, following this C_mw."""
    ends = np.cumsum([motion.time.size for motion in fit.frame.finer])[:-1]
    frame = fit.frame.following(np.split(place.static_moment, ends))
    columns = fit.columns
    for parameter, value in zip(fit.nonlinear, place.nonlinear.tolist(), strict=True):
        columns = parameter.moved(columns, float(np.clip(value, *parameter.bounds)))
    return held(problem, replace(fit, columns=columns), frame, _ONE_STEP)
