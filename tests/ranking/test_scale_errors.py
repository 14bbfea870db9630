"""Errors of pressure and inertia are no way for a hypothesis to have a share of what it lacks."""

from __future__ import annotations

import pytest

from brv_hypo import compare
from brv_hypo.ranking import CompareConfig
from tests.flights import flown


@pytest.mark.thorough
@pytest.mark.parametrize("planted", ["bodyfixed", "damping"])
def test_none_keeps_the_static_moment_beside_a_large_mechanism(planted: str) -> None:
    """Linearised about the leader, a scale of its whole moment would stand in for both."""
    flight = flown("research_cone", planted).flight
    found = compare(flight, CompareConfig(mechanisms=(planted,), maximum_likelihood="none"))
    share = {one.mechanism: one.r2 for one in found.ranking}
    assert found.verdict.winner == planted
    assert share[planted] > 0.97
    assert share["none"] > 0.5
