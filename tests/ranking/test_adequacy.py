"""What outside the list would explain a flight instead of the leader."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from brv_hypo.constants import ONE_STRETCH, OUTSIDE
from brv_hypo.mechanisms import find
from brv_hypo.model.term import TimeBasis, candidates, theta_grid
from brv_hypo.ranking.adequacy import Alternative, alternatives
from brv_hypo.regression.fit import HypothesisFit, settled
from brv_hypo.regression.free_moment import ORDINARY
from brv_hypo.regression.problem import Problem
from brv_hypo.regression.unlisted import UnlistedMoment
from tests.chains import prepared
from tests.ranking.pulse import fitted, problem

EVENT = "event"


def of(*fits: HypothesisFit, where: Problem | None = None) -> dict[str, Alternative]:
    """What is found of these fits, by the name of its fit."""
    return {each.fit.name: each for each in alternatives(where or problem(), fits)}


@cache
def beside_the_pulse() -> dict[str, Alternative]:
    return of(fitted("none"), fitted("bodyfixed"))


def with_terms(mechanism: str, *terms: tuple[str, str, float], planted: str = "bodyfixed") -> HypothesisFit:
    """The fit of a mechanism with columns of these terms, courses and times alone, as they are."""
    given = replace(prepared(planted, max_terms=4, exact_terms=4), refine=False)
    own = find(mechanism)
    offered = candidates(own, given.frame.motions[0], given.knots, theta_grid(own))
    of_term = {column.term: column for column in offered}
    columns = [of_term[term].at(of_term[term].theta, TimeBasis(kind, time)) for term, kind, time in terms]  # type: ignore[arg-type]
    frame = given.frame.with_mechanisms([own])
    empty = replace(fitted("none"), name=mechanism, mechanisms=(own,), frame=frame, searched=len(offered))
    chosen = (*given.baseline, *columns)
    return settled(given, empty, chosen, chosen)


# ---- Several coefficients at once ----


def test_an_event_is_the_leader_with_all_other_ordinary_coefficients_changing_when_it_does() -> None:
    leader, event = fitted("bodyfixed"), beside_the_pulse()[EVENT]
    assert event.fit.selected[: len(leader.selected)] == leader.selected
    times = {column.time_basis for column in leader.selected}
    changing = event.fit.selected[len(leader.selected) :]
    assert {column.mechanism for column in changing} == {UnlistedMoment.name}
    assert {column.time_basis for column in changing} == times
    shapes = set(ORDINARY) - {"body-fixed"}  # which is the leader's own
    assert {column.term for column in changing} == shapes
    assert len(changing) == len(shapes) * len(times)
    start = leader.selected[0].time_basis.start
    assert event.words == f"a change of several coefficients at once at {start:.2f} s"


def test_all_that_a_leader_without_characteristic_terms_has_is_specific_to_it() -> None:
    leader, event = fitted("bodyfixed"), beside_the_pulse()[EVENT]
    assert not any(mechanism.characteristic for mechanism in leader.mechanisms)
    assert event.specific == tuple(range(len(leader.selected)))


def test_of_one_that_names_characteristic_terms_they_alone_are_specific() -> None:
    """A step of C_malpha is what many events bring; that of C_m0 with it is the in-plane moment's own."""
    leader = with_terms("inplane", ("C_malpha", "jump", 2.0), ("C_m0", "jump", 2.0))
    null = replace(fitted("none"), bound_cost=1e6)
    event = of(null, leader)[EVENT]
    assert [leader.selected[k].term for k in event.specific] == ["C_m0"]
    assert {column.term for column in event.fit.selected[2:]}.isdisjoint({"offset", "stiffness"})


def test_its_knots_are_where_those_of_the_leader_are() -> None:
    """Its evidence pays for where they are, as the leader's does."""
    leader, event = fitted("bodyfixed"), beside_the_pulse()[EVENT]
    assert {each.kind for each in event.fit.nonlinear} == {"knot"}
    assert {each.value for each in event.fit.nonlinear} == {each.value for each in leader.nonlinear}


def test_more_coefficients_leave_no_more_of_the_record() -> None:
    assert beside_the_pulse()[EVENT].fit.rss <= fitted("bodyfixed").rss * (1.0 + 1e-9)


def test_the_baseline_changes_at_no_time() -> None:
    assert EVENT not in of(replace(fitted("none"), bound_cost=-1e6), fitted("bodyfixed"))


def test_what_changes_too_often_is_no_event() -> None:
    times = (1.5, 2.0, 4.0)
    assert len(times) > ONE_STRETCH
    terms = [(term, "jump", time) for time in times for term in ("C_b cos(phi_b)", "C_b sin(phi_b)")]
    found = of(fitted("none"), with_terms("bodyfixed", *terms))
    assert EVENT not in found


# ---- Leaders of which nothing is specific ----


def test_a_leader_without_its_characteristic_terms_is_no_likelier_than_a_change_that_many_things_bring() -> None:
    leader = with_terms("inplane", ("C_malpha", "jump", 2.0))
    found = of(replace(fitted("none"), bound_cost=1e6), leader)
    assert found["inplane"].fit is leader
    assert found["inplane"].words == "a change of C_malpha alone, which is not specific to inplane"
    assert found["inplane"].specific == ()


@pytest.mark.parametrize("share", [0.5 * OUTSIDE**2, 2.0 * OUTSIDE**2])
def test_characteristic_terms_have_to_explain_more_than_next_to_nothing(
    share: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("brv_hypo.ranking.adequacy.particular_share", lambda *_: share)
    assert ("bodyfixed" in of(fitted("none"), fitted("bodyfixed"))) == (share < OUTSIDE**2)


def test_one_with_them_is_specific() -> None:
    assert "bodyfixed" not in beside_the_pulse()
    assert np.isfinite(beside_the_pulse()[EVENT].fit.information)
