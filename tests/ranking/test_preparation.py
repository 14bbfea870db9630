"""What is linearised about, and what is done where a record has no motion there."""

from __future__ import annotations

from typing import Any

import pytest

from brv_hypo import compare
from brv_hypo.errors import UnanswerableError
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
