"""Clocks of instruments on vehicles that turn fast while a record lasts few of their cycles."""

from __future__ import annotations

import pytest

from brv_hypo import compare
from brv_hypo.ranking import CompareConfig
from tests.independent.mechanisms import LISTED
from tests.independent.study import MIXED, drawn_flight

FIRST = 121000


@pytest.mark.parametrize(
    ("seed", "truth"), [(121013, "damping"), pytest.param(121041, "sticking", marks=pytest.mark.thorough)]
)
def test_the_ends_of_a_record_tell_no_clock(seed: int, truth: str) -> None:
    """A unit shifted as a whole differs from one that is not at its ends alone, where it has to be continued: they
    asked for 5 to 8 tolerances of gyros and accelerometers late together, and nothing was adequate.
    """
    made = drawn_flight(seed, seed - FIRST, MIXED, 1.0, 5, coloured=True, drawn=True)
    assert made.truth == truth
    assert compare(made.flight, CompareConfig(mechanisms=LISTED, maximum_likelihood="none")).verdict.winner == truth
