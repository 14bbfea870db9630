"""What is linearised about, and what is done where a record has no motion there."""

from __future__ import annotations

from typing import Any

import pytest

from brv_hypo import compare
from brv_hypo.errors import UnanswerableError, UsageError
from brv_hypo.ranking import CompareConfig, preparation
from tests.flights import flown


def test_a_record_that_has_no_motion_without_its_errors_is_compared_as_it_is(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def runs_away(*_: Any) -> None:
        raise UnanswerableError("the attitude runs away")

    monkeypatch.setattr(preparation, "reconstruct", runs_away)
    config = CompareConfig(mechanisms=("bodyfixed", "damping"), maximum_likelihood="none")
    verdict = compare(flown("research_cone", "bodyfixed").flight, config).verdict
    assert verdict.outcome in ("named", "undecided", "none adequate")
    assert verdict.probability["damping"] < 0.02


@pytest.mark.parametrize("outside", [-1.0, 1e3])
def test_a_knot_outside_the_record_is_refused_by_name(outside: float) -> None:
    """Nothing can change there, and as a parameter it would have bounds that end before they begin."""
    config = CompareConfig(mechanisms=("inplane",), knots=(2.0, outside), maximum_likelihood="none")
    with pytest.raises(UsageError, match=rf"knots at {outside:g} s, expected times between 0 and "):
        compare(flown("research_cone", "bodyfixed").flight, config)


@pytest.mark.thorough
def test_knots_are_taken_in_any_order_and_once() -> None:
    flight = flown("research_cone", "inplane").flight
    ordered, shuffled = (
        compare(flight, CompareConfig(mechanisms=("inplane",), knots=knots, maximum_likelihood="none"))
        for knots in ((1.0, 2.0, 3.0), (3.0, 1.0, 2.0, 1.0))
    )
    assert [each.model_dump_json() for each in ordered.ranking] == [each.model_dump_json() for each in shuffled.ranking]
