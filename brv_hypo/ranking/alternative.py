"""What outside the list would explain a flight instead of the leader, rather than beside it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from brv_hypo.constants import ONE_STRETCH, OTHER_FLOOR, OUTSIDE
from brv_hypo.mechanisms.contract import Mechanism
from brv_hypo.model.common_time import at
from brv_hypo.model.term import Regressor
from brv_hypo.regression.fit import HypothesisFit, fit_hypothesis, likeliest
from brv_hypo.regression.problem import Problem
from brv_hypo.regression.unlisted import (
    RATE,
    particular_share,
    plain_columns,
    turning_moment,
    unlisted_moment,
)


@dataclass(frozen=True)
class Alternative:
    """Something outside the list: its criterion where it explains the flight alone, and what it is in words.

    As beside the leader, what it gains has to be more than it does on sound flights: by so much its criterion is above
    that of its `fit`.
    """

    information: float
    words: str
    fit: HypothesisFit

    def repeated(self, information: Mapping[str, float]) -> float:
        """Its criterion in a repetition, from those of fits by name."""
        return information[self.fit.name] + self.information - self.fit.information


def alternatives(
    problem: Problem, hypotheses: Mapping[str, Sequence[Mechanism]], fits: Sequence[HypothesisFit]
) -> tuple[Alternative, ...]:
    """The best moment of shapes that nothing on the list has, and a change that many things bring.

    A leader whose characteristic terms explain next to nothing is such a change, and no likelier than that.
    """
    leader = likeliest(fits)
    found = []
    null = next(fit for fit in fits if not fit.mechanisms)
    if not is_particular(problem, null, leader):
        terms = ", ".join(dict.fromkeys(column.term for column in plain_columns(leader)))
        words = f"a change of {terms} alone, which is not specific to {leader.name}"
        found.append(Alternative(leader.information, words, leader))
    listed = {mechanism.name: mechanism for group in hypotheses.values() for mechanism in group}
    unlisted = unlisted_moment(problem, tuple(listed.values()), OUTSIDE)
    if unlisted is not None:
        found.append(_instead_of(leader, problem, unlisted))
    if (stretch := _many_steps(leader)) is not None:
        turning = turning_moment(problem, tuple(listed.values()), OUTSIDE, *stretch)
        if turning is not None:
            found.append(_instead_of(leader, problem, turning))
    return tuple(found)


def is_particular(problem: Problem, null: HypothesisFit, fit: HypothesisFit) -> bool:
    """Whether what is characteristic of its mechanisms explains more of what a fit does than next to nothing."""
    return particular_share(problem, null, fit) > OUTSIDE**2


def _instead_of(leader: HypothesisFit, problem: Problem, moment: Mechanism) -> Alternative:
    """The best fit of a moment as a mechanism."""
    fit = fit_hypothesis(problem, moment.name, (moment,), leader.information)
    return Alternative(fit.information + OTHER_FLOOR, _described(fit), fit)


def _many_steps(leader: HypothesisFit) -> tuple[float, float] | None:
    """The first and last time at which the leader changes, where it does so more often than one stretch needs."""
    starts = {column.time_basis.start for column in leader.selected if column.time_basis.kind != "constant"}
    return (min(starts), max(starts)) if len(starts) > ONE_STRETCH else None


def _described(fit: HypothesisFit) -> str:
    shapes = " and ".join(dict.fromkeys(_shape(column) for column in fit.selected))
    starts = [column.time_basis.start for column in fit.selected if column.time_basis.kind != "constant"]
    since = f" from {at(fit.frame.common, min(starts))}" if starts else ""
    return f"a moment that no mechanism on the list has ({shapes}{since})"


def _shape(column: Regressor) -> str:
    rate = dict(column.theta).get(RATE)
    return column.term if rate is None else f"turning in the body at {rate:.3g} rad/s"
