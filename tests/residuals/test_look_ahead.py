"""Candidates are ranked by what they explain together with the best effect beside them."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from brv_hypo.constants import CONFOUNDED_NEAR
from brv_hypo.residuals import candidates_at_step
from brv_hypo.residuals.candidates import Candidate, look_alikes
from brv_hypo.residuals.candidates_at_step import looked_ahead_like
from brv_hypo.residuals.choice import _ranked
from tests.residuals.test_choice import ACROSS, candidate


@pytest.mark.parametrize(
    ("first", "second", "leader"),
    [(None, None, "lag"), (5.0, 50.0, "sticking"), (50.0, 50.0, "lag"), (0.0, 15.0, "lag")],
)
def test_what_leaves_more_for_another_effect_leads(first: float | None, second: float | None, leader: str) -> None:
    found = [replace(candidate("lag", 100.0), ahead=first), replace(candidate("sticking", 80.0), ahead=second)]
    here: Any = SimpleNamespace(candidates=found)
    assert _ranked(here, None)[0].name == leader


@pytest.mark.parametrize(
    ("beside_it", "beside_the_name", "first"),
    [(None, None, "discovered_1"), (0.0, 40.0, "lag"), (30.0, 30.0, "discovered_1"), (None, 40.0, "discovered_1")],
)
def test_a_description_is_judged_with_what_goes_beside_it(
    beside_it: float | None, beside_the_name: float | None, first: str
) -> None:
    named = replace(candidate("lag", 80.0), ahead=beside_the_name)
    described = replace(candidate("discovered_1", 100.0), ahead=beside_it)
    here: Any = SimpleNamespace(candidates=[named])
    discovery: Any = SimpleNamespace(candidate=described)
    assert _ranked(here, discovery)[0].name == first


def test_a_description_is_looked_beyond_where_its_rivals_are(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(candidates_at_step, "_beside", lambda problem, one, mechanisms: 7.0)
    problem: Any = None
    described, rival = candidate("discovered_1", 100.0), candidate("lag", 80.0)
    assert looked_ahead_like(problem, described, [rival], ()).ahead is None
    assert looked_ahead_like(problem, described, [replace(rival, ahead=5.0)], ()).ahead == 7.0
    far_ahead = replace(rival, gain=1000.0, ahead=5.0)
    assert looked_ahead_like(problem, described, [far_ahead], ()).ahead is None


@pytest.mark.parametrize(
    ("ahead", "alike"), [(20.0 - 0.9 * CONFOUNDED_NEAR, True), (20.0 - 1.1 * CONFOUNDED_NEAR, False)]
)
def test_look_alikes_are_judged_with_what_goes_beside_them(ahead: float, alike: bool) -> None:
    leader: Candidate = replace(candidate("lag", 100.0), ahead=0.0)
    other = replace(candidate("sticking", 80.0, ACROSS), ahead=ahead)
    assert (look_alikes(leader, [other]) == ("sticking",)) is alike
    unknown = replace(other, ahead=None)
    assert look_alikes(leader, [unknown]) == ()
