from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from brv_hypo.ranking.verdict import Score, judge, probabilities

EQUAL = (1.0, 1.1, 0.9, 1.0, 1.05, 0.95)


def test_a_clear_leader_wins() -> None:
    verdict = judge([Score("none", 0.0, 2.0, (2.0,) * 6), Score("lag", -80.0, 1.0, EQUAL)], 2.0)
    assert verdict.winner == "lag"
    assert verdict.equivalent == ("lag",)
    assert "0.50" in verdict.reason


def test_close_hypotheses_stand_together() -> None:
    verdict = judge([Score("lag", -80.0, 1.0, EQUAL), Score("sticking", -79.0, 1.0, EQUAL)], 2.0)
    assert verdict.winner is None
    assert set(verdict.equivalent) == {"lag", "sticking"}


def test_a_leader_that_predicts_worse_does_not_win() -> None:
    worse = tuple(value + 0.5 for value in EQUAL)
    verdict = judge([Score("lag", -80.0, 1.5, worse), Score("none", 0.0, 1.0, EQUAL)], 2.0)
    assert verdict.winner is None
    assert "none" in verdict.equivalent
    assert "held-out" in verdict.reason


@given(st.lists(st.floats(-1e4, 1e4), min_size=1, max_size=7), st.floats(1.0, 50.0))
def test_probabilities_sum_to_one_and_follow_the_criterion(values: list[float], temperature: float) -> None:
    chances = probabilities({str(i): value for i, value in enumerate(values)}, temperature)
    assert sum(chances.values()) == pytest.approx(1.0)
    assert chances[str(int(np.argmin(values)))] == max(chances.values())
