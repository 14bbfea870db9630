"""The verdict on scores: who is named, who stands beside, and when nothing on the list will do."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from brv_hypo.constants import OTHER_PRIOR, WINNING_PROBABILITY
from brv_hypo.ranking.adequacy import Alternative, Misfit
from brv_hypo.ranking.limits import Limit
from brv_hypo.ranking.result import Verdict
from brv_hypo.ranking.verdict import OTHER, Contest, Score, Stability, judge, probabilities
from brv_hypo.regression.fit import HypothesisFit
from brv_hypo.regression.frame import RateFrame

NOISE = Misfit(ratio=1.0, p_value=0.4, gain=-30.0)
SOMETHING_LEFT = Misfit(ratio=1.6, p_value=1e-9, gain=200.0)
EQUAL = (1.0, 1.1, 0.9, 1.0, 1.05, 0.95)
WORSE = tuple(value + 0.5 for value in EQUAL)
NULL = Score("none", 0.0, 2.0, (2.0, 2.1, 1.9, 2.0, 2.05, 1.95))
LAG = Score("lag", -80.0, 1.0, EQUAL)
CRITERIA = st.floats(-1e4, 1e4)
SIDE = "a moment that no mechanism on the list has (side moment from 2.00 s)"


def said(
    scores: Sequence[Score],
    left: Misfit,
    confirmed: float = 1.0,
    limits: Sequence[Limit] = (),
    alternatives: Sequence[Alternative] = (),
) -> Verdict:
    """The verdict where that share of repetitions has the record's leader."""
    return judge(Contest(scores, left, alternatives), Stability(1.0, confirmed), limits)


def side(information: float) -> Alternative:
    """Something instead of the leader; the criterion of its fit is 0."""
    nothing = RateFrame((), (), (), (), {})
    fit = HypothesisFit("side", (), nothing, (), 0, np.zeros(0), np.ones(1), 1, 1.0, 0)
    return Alternative(information, SIDE, fit)


def test_a_clear_leader_wins() -> None:
    verdict = said([NULL, LAG], NOISE, 1.0, [Limit("lag", 0.07)])
    assert (verdict.winner, verdict.outcome, verdict.equivalent) == ("lag", "named", ("lag",))
    assert verdict.probability["lag"] > 0.99
    assert "its prediction error is 0.5 of that of the baseline only" in verdict.reason
    assert verdict.adequacy is not None
    assert verdict.adequacy.adequate
    assert verdict.limits[0].share_of_moment_95 == 0.07


def test_none_may_win_and_tells_what_room_is_left() -> None:
    verdict = said([Score("none", -80.0, 1.0, EQUAL), Score("lag", 0.0, 1.1, WORSE)], NOISE, 1.0, [Limit("lag", 0.07)])
    assert (verdict.winner, verdict.outcome) == ("none", "named")
    assert "no mechanism has more than 7 % of the moment" in verdict.reason


def test_a_limit_that_is_not_known_is_not_told() -> None:
    scores = [Score("none", -80.0, 1.0, EQUAL), Score("lag", 0.0, 1.1, WORSE)]
    verdict = said(scores, NOISE, 1.0, [Limit("lag", float("inf"))])
    assert verdict.winner == "none"
    assert "inf" not in verdict.reason


def test_close_hypotheses_stand_together() -> None:
    verdict = said([NULL, LAG, Score("sticking", -79.0, 1.0, EQUAL)], NOISE)
    assert (verdict.winner, verdict.outcome) == (None, "undecided")
    assert set(verdict.equivalent) == {"lag", "sticking"}
    assert "do not distinguish these" in verdict.reason


def test_something_smooth_that_is_left_makes_none_adequate() -> None:
    verdict = said([NULL, LAG], SOMETHING_LEFT)
    assert (verdict.winner, verdict.outcome, verdict.equivalent) == (None, "none adequate", ())
    assert verdict.probability[OTHER] > 0.99
    assert verdict.adequacy is not None
    assert not verdict.adequacy.adequate
    assert "1.60 times the noise" in verdict.reason


def test_a_value_that_no_body_can_have_makes_none_adequate() -> None:
    impossible = Score("lag", -80.0, 1.0, EQUAL, "eps = 1.7 from 0.00 to 2.00 s, where 0 to 1 is possible")
    verdict = said([NULL, impossible], NOISE)
    assert (verdict.winner, verdict.outcome) == (None, "none adequate")
    assert "eps = 1.7" in verdict.reason
    assert verdict.probability["lag"] == 0.0
    assert verdict.probability[OTHER] > 0.99


def test_errors_beyond_all_tolerance_leave_the_leader_no_probability() -> None:
    """A name that is refused is not quoted with a probability."""
    verdict = said([NULL, LAG], Misfit(ratio=1.0, p_value=0.4, gain=-30.0, errors_p_value=1e-9))
    assert verdict.outcome == "none adequate"
    assert verdict.probability[OTHER] > 0.99
    assert sum(verdict.probability.values()) == pytest.approx(1.0)


@pytest.mark.parametrize("stability", [0.0, 0.3, 0.6, 0.85])
def test_a_leader_that_repetitions_do_not_confirm_is_not_named(stability: float) -> None:
    """Whoever leads without a block is a rival on the list: what the leader loses is theirs, not `other`'s."""
    rivals = [NULL, Score("sticking", -50.0, 1.1, EQUAL)]
    steady, shaken = said([*rivals, LAG], NOISE), said([*rivals, LAG], NOISE, stability)
    assert steady.winner == "lag"
    assert (shaken.winner, shaken.outcome) == (None, "undecided")
    assert shaken.probability["lag"] == pytest.approx(max(stability, 0.02))
    assert shaken.probability[OTHER] == steady.probability[OTHER]
    assert shaken.equivalent == ("lag", "sticking")
    assert sum(shaken.probability.values()) == pytest.approx(1.0)


def test_repetitions_do_not_raise_a_leader() -> None:
    scores = [LAG, Score("sticking", -79.0, 1.0, EQUAL)]
    assert said(scores, NOISE, 0.9).probability == said(scores, NOISE).probability


def test_only_the_baseline_contests_a_leader() -> None:
    """Scores of blocks that one noise moves alike say nothing of a rival that the criterion puts far behind."""
    assert said([NULL, LAG, Score("sticking", -40.0, 0.97, EQUAL)], NOISE).winner == "lag"


@pytest.mark.parametrize("blocks", [NULL.by_block, WORSE])
def test_a_winner_beats_none_on_held_out_blocks(blocks: tuple[float, ...]) -> None:
    null = Score("none", 0.0, 1.0, WORSE)
    verdict = said([null, Score("lag", -80.0, 0.9, blocks)], NOISE)
    assert verdict.winner is None
    assert "none" in verdict.equivalent
    assert "the baseline alone predicts the held-out blocks" in verdict.reason


def test_what_explains_the_flight_better_than_any_on_the_list_makes_none_adequate() -> None:
    verdict = said([NULL, LAG], NOISE, alternatives=[side(-110.0)])
    assert (verdict.winner, verdict.outcome, verdict.equivalent) == (None, "none adequate", ())
    assert verdict.probability[OTHER] > 0.99
    assert "lag fits best of them" in verdict.reason
    assert SIDE in verdict.reason


def test_what_explains_the_flight_as_well_as_the_leader_keeps_it_from_being_named() -> None:
    verdict = said([NULL, LAG], NOISE, alternatives=[side(LAG.information)])
    assert (verdict.winner, verdict.outcome, verdict.equivalent) == (None, "undecided", ("lag",))
    assert verdict.probability[OTHER] > 0.2
    assert SIDE in verdict.reason


def test_what_is_likelier_than_the_leader_but_not_sure_leaves_it_standing() -> None:
    """None adequate is a claim, too: it needs the probability of a name."""
    verdict = said([NULL, LAG], NOISE, alternatives=[side(LAG.information - 8.0)])
    assert 0.5 < verdict.probability[OTHER] < WINNING_PROBABILITY
    assert (verdict.outcome, verdict.equivalent) == ("undecided", ("lag",))


def test_an_alternative_far_behind_takes_nothing_from_the_leader() -> None:
    verdict = said([NULL, LAG], NOISE, alternatives=[side(0.0)])
    assert verdict.winner == "lag"


def test_something_beside_the_leader_is_told_where_it_is_likelier_than_something_instead() -> None:
    verdict = said([NULL, LAG], SOMETHING_LEFT, alternatives=[side(LAG.information)])
    assert verdict.outcome == "none adequate"
    assert "1.60 times the noise" in verdict.reason


@given(
    st.lists(st.tuples(CRITERIA, st.floats(1e-12, 1e12), st.floats(1e-12, 1e12)), min_size=1, max_size=6),
    st.floats(-1e3, 1e5),
    st.floats(0.0, 1.0),
)
def test_a_verdict_is_whole_whatever_the_scores(
    rows: list[tuple[float, float, float]], gain: float, stability: float
) -> None:
    names = ("none", "lag", "sticking", "damping", "bodyfixed", "inplane")
    scores = [
        Score(name, criterion, error, (block,) * 6)
        for name, (criterion, error, block) in zip(names, rows, strict=False)
    ]
    verdict = said(scores, Misfit(1.0, 0.5, gain), stability)
    assert set(verdict.probability) == {score.name for score in scores} | {OTHER}
    assert sum(verdict.probability.values()) == pytest.approx(1.0)
    assert (verdict.winner is not None) == (verdict.outcome == "named")
    if verdict.winner is not None:
        assert verdict.equivalent == (verdict.winner,)
        assert verdict.probability[verdict.winner] >= WINNING_PROBABILITY
    assert not re.search(r"\d{7}|e\+|\bnan\b|\binf\b", verdict.reason)


@given(st.lists(CRITERIA, min_size=1, max_size=7))
def test_probabilities_sum_to_one_and_follow_the_criterion(values: list[float]) -> None:
    chances = probabilities({str(i): value for i, value in enumerate(values)})
    assert sum(chances.values()) == pytest.approx(1.0)
    assert chances[str(min(range(len(values)), key=values.__getitem__))] == max(chances.values())


@pytest.mark.parametrize("count", [1, 2, 6])
@pytest.mark.parametrize("forms", [1, 2, 3])
@pytest.mark.parametrize("prior", [OTHER_PRIOR, 0.05, 0.6])
def test_other_has_its_prior_where_the_data_say_nothing(count: int, forms: int, prior: float) -> None:
    chances = probabilities({str(i): 5.0 for i in range(count)}, [5.0] * forms, prior)
    assert chances[OTHER] == pytest.approx(prior)


CONTEST = Contest([NULL, LAG, Score("sticking", -50.0, 1.1, EQUAL)], NOISE, [side(-20.0)])


@pytest.mark.parametrize(
    ("information", "outcome", "winner"),
    [
        ({"none": 0.0, "lag": -80.0, "sticking": -50.0, "side": 0.0}, "named", "lag"),
        ({"none": -500.0, "lag": -580.0, "sticking": -550.0, "side": -500.0}, "named", "lag"),
        ({"none": 0.0, "lag": -80.0, "sticking": -79.0, "side": 0.0}, "undecided", None),
        ({"none": 0.0, "lag": -50.0, "sticking": -80.0, "side": 0.0}, "named", "sticking"),
        ({"none": -80.0, "lag": -50.0, "sticking": -50.0, "side": 0.0}, "named", "none"),
        ({"none": 0.0, "lag": -80.0, "sticking": -50.0, "side": -120.0}, "none adequate", None),
    ],
)
def test_a_repetition_is_judged_by_the_same_rules(
    information: dict[str, float], outcome: str, winner: str | None
) -> None:
    """An alternative keeps what it has to gain beyond its fit: here 20 less than its fit's criterion."""
    found = CONTEST.repeated(information)
    assert (found.outcome, found.winner) == (outcome, winner)


def test_what_is_held_of_the_leader_is_not_held_against_another_that_leads() -> None:
    """Improbable errors of the record are the leader's own; what lies beside it goes with it."""
    contest = Contest([NULL, LAG], Misfit(ratio=1.0, p_value=0.4, gain=-30.0, errors_p_value=1e-9))
    assert contest.repeated({"none": 0.0, "lag": -80.0}).outcome == "none adequate"
    assert contest.repeated({"none": -80.0, "lag": 0.0}).winner == "none"


def test_the_verdict_tells_the_share_of_outcomes_and_is_lowered_by_that_of_leaders() -> None:
    """A leader near the border is undecided in some repetitions; they do not speak for another."""
    border = judge(Contest([NULL, LAG], NOISE), Stability(0.4, 1.0))
    assert (border.winner, border.stability) == ("lag", 0.4)
    assert "40 % of the repetitions give the same outcome" in border.reason
    shaken = judge(Contest([NULL, LAG], NOISE), Stability(0.4, 0.8))
    assert (shaken.winner, shaken.probability["lag"]) == (None, pytest.approx(0.8))
