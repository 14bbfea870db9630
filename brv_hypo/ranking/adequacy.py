"""What outside the list would explain a flight instead of the leader, rather than beside it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

from brv_hypo.constants import ONE_STRETCH, OUTSIDE
from brv_hypo.mechanisms.contract import Mechanism
from brv_hypo.model.common_time import at
from brv_hypo.model.term import Regressor
from brv_hypo.regression.fit import HypothesisFit, fit_hypothesis, likeliest, solved
from brv_hypo.regression.free_moment import ORDINARY, shape_of
from brv_hypo.regression.problem import Problem
from brv_hypo.regression.reduced import Reduced
from brv_hypo.regression.refinement import Nonlinear
from brv_hypo.regression.unlisted import (
    UnlistedMoment,
    left_of,
    over,
    particular_share,
    plain_columns,
    shapes_of,
    unlisted_moment,
)


@dataclass(frozen=True)
class Alternative:
    """Something outside the list, fitted as a hypothesis of its own, and what it is in words."""

    words: str
    fit: HypothesisFit
    specific: tuple[int, ...] = ()
    """Which of its selected columns are specific to the leader: it is no alternative where they explain most of it."""


def alternatives(
    problem: Problem, hypotheses: Mapping[str, Sequence[Mechanism]], fits: Sequence[HypothesisFit]
) -> tuple[Alternative, ...]:
    """The best moment of shapes that nothing on the list has, and a change that many things bring.

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
    listed = {mechanism.name: mechanism for group in hypotheses.values() for mechanism in group}
    unlisted = unlisted_moment(problem, tuple(listed.values()), OUTSIDE)
    if unlisted is not None:
        found.append(_instead_of(leader, problem, unlisted))
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


def _instead_of(leader: HypothesisFit, problem: Problem, moment: Mechanism) -> Alternative:
    """The best fit of a moment as a mechanism."""
    fit = fit_hypothesis(problem, moment.name, (moment,), leader.information)
    return Alternative(_described(fit), fit)


def _described(fit: HypothesisFit) -> str:
    shapes = " and ".join(dict.fromkeys(column.term for column in fit.selected))
    starts = [column.time_basis.start for column in fit.selected if column.time_basis.kind != "constant"]
    since = f" from {at(fit.frame.common, min(starts))}" if starts else ""
    return f"a moment that no mechanism on the list has ({shapes}{since})"
