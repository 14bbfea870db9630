"""What outside the list would explain a flight instead of the leader, rather than beside it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from brv_hypo.constants import ONE_STRETCH, OUTSIDE
from brv_hypo.inference.evidence import Evidence
from brv_hypo.mechanisms.contract import Mechanism
from brv_hypo.model.common_time import at
from brv_hypo.model.term import Regressor
from brv_hypo.ranking.limits import even_edges
from brv_hypo.ranking.with_processes import PLAIN_EDGES, acting
from brv_hypo.regression.fit import HypothesisFit, likeliest, solved
from brv_hypo.regression.frame import RateFrame
from brv_hypo.regression.free_moment import ORDINARY, shape_of
from brv_hypo.regression.problem import Problem
from brv_hypo.regression.reduced import Reduced
from brv_hypo.regression.refinement import Nonlinear
from brv_hypo.regression.unlisted import (
    RATE,
    UnlistedMoment,
    left_of,
    over,
    particular_share,
    plain_columns,
    shapes_of,
    turning_moments,
    unlisted_moments,
)


@dataclass(frozen=True)
class Alternative:
    """Something outside the list, fitted as a hypothesis of its own, and what it is in words."""

    words: str
    fit: HypothesisFit
    specific: tuple[int, ...] = ()
    """Which of its selected columns are specific to the leader: it is no alternative where they explain most of it."""


def alternatives(problem: Problem, fits: Sequence[HypothesisFit]) -> tuple[Alternative, ...]:
    """Changes that many things bring, as hypotheses.

    A leader whose characteristic terms explain next to nothing is such a change, and no likelier than that. What begins
    when the leader does, but with more coefficients than it claims, is another.
    """
    leader = likeliest(fits)
    found = []
    null = next(fit for fit in fits if not fit.mechanisms)
    if not is_particular(problem, null, leader):
        terms = ", ".join(dict.fromkeys(column.term for column in plain_columns(leader)))
        found.append(Alternative(f"a change of {terms} alone, which is not specific to {leader.name}", leader))
    if (event := _event(problem, leader)) is not None:
        found.append(event)
    return tuple(found)


def is_particular(problem: Problem, null: HypothesisFit, fit: HypothesisFit) -> bool:
    """Whether what is characteristic of its mechanisms explains more of what a fit does than next to nothing."""
    return particular_share(problem, null, fit) > OUTSIDE**2


def _event(problem: Problem, leader: HypothesisFit) -> Alternative | None:
    """The leader with all other ordinary coefficients changing when its own do, as a nose tip's loss changes stiffness
    and trim; None where the leader changes at no time, or too often for one event.
    """
    bases = list(dict.fromkeys(c.time_basis for c in leader.selected if c.time_basis.kind != "constant"))
    known = shapes_of(leader.mechanisms, problem.frame.motions)
    shapes = tuple(
        name
        for name in ORDINARY
        if all(left_of(over(problem.frame.motions, partial(shape_of, name)), basis) > OUTSIDE for basis in known)
    )
    if not 0 < len(bases) <= ONE_STRETCH or not known or not shapes:
        return None
    moment = UnlistedMoment(shapes=shapes)
    frame = leader.frame.with_mechanisms([moment])
    terms = moment.terms(frame.motions[0], {})
    changing = [Regressor(moment.name, term.name, (), basis, term.units) for basis in bases for term in terms]
    columns = (*leader.columns, *changing)
    fit = solved(Reduced(problem, frame), "event", (*leader.mechanisms, moment), columns, leader.searched)
    plain = plain_columns(leader) if any(each.characteristic for each in leader.mechanisms) else ()
    specific = tuple(k for k, column in enumerate(leader.selected) if column not in plain)
    words = f"a change of several coefficients at once at {at(frame.common, bases[0].start)}"

    def with_changes(each: Nonlinear) -> Nonlinear:
        """A knot of the leader that moves what changes there too."""
        start, first = leader.columns[each.columns[0]].time_basis.start, len(leader.columns)
        more = (first + j for j, c in enumerate(changing) if each.kind == "knot" and c.time_basis.start == start)
        return replace(each, columns=(*each.columns, *more))

    return Alternative(words, replace(fit, nonlinear=tuple(map(with_changes, leader.nonlinear))), specific)


def unlisted(
    problem: Problem, hypotheses: Mapping[str, Sequence[Mechanism]], fits: Sequence[HypothesisFit], null: Evidence
) -> list[tuple[Alternative, Evidence]]:
    """The best moment of a shape that nothing on the list has, and the best that turns in the body while the leader
    acts, each between two times.
    """
    leader = likeliest(fits)
    listed = tuple({each.name: each for group in hypotheses.values() for each in group}.values())
    frame = null.rows.frame_of(leader)
    like = replace(leader, frame=frame)
    found = [acting(problem, like, unlisted_moments(problem, listed, OUTSIDE), null, even_edges(frame, PLAIN_EDGES))]
    if (stretch := _stretch(leader, frame)) is not None:
        found.append(
            acting(problem, like, turning_moments(problem, listed, OUTSIDE, *stretch), null, np.array(stretch))
        )
    return [(Alternative(_described(pair[0]), pair[0]), pair[1]) for pair in found if pair is not None]


def _stretch(leader: HypothesisFit, frame: RateFrame) -> tuple[float, float] | None:
    """From where to where the leader acts, s; None where it changes at no time."""
    bases = [column.time_basis for column in leader.selected if column.time_basis.kind != "constant"]
    starts = sorted({basis.start for basis in bases})
    return (starts[0], starts[-1] if len(starts) > 1 else float(frame.coefficient_time.max())) if starts else None


def _described(fit: HypothesisFit) -> str:
    rates = {
        f"turning in the body at {value:.3g} rad/s" for c in fit.selected for name, value in c.theta if name == RATE
    }
    shapes = " and ".join(rates or dict.fromkeys(column.term for column in fit.selected))
    starts = [column.time_basis.start for column in fit.selected if column.time_basis.kind != "constant"]
    since = f" from {at(fit.frame.common, min(starts))}" if starts else ""
    return f"a moment that no mechanism on the list has ({shapes}{since})"
