"""The verdict on evidences: who is named, who is as probable, and when nothing on the list is adequate."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from brv_hypo.arrays import FloatArray
from brv_hypo.comparison.result import OTHER, Explained, MechanismLimit, ProcessEstimate, RecordError, Verdict
from brv_hypo.comparison.verdict import (
    NONE,
    Contender,
    Misfit,
    decide,
    judge,
    probabilities,
    with_far_error,
    with_far_processes,
    with_prediction_error,
    without_converged_motion,
    without_power,
)
from brv_hypo.io.text import percent
from brv_hypo.thresholds import NOISE_LEVEL, OTHER_PRIOR, WINNING_PROBABILITY

STRETCHES = 12
ROWS = 1000
GOOD = Misfit(noise=1.0, rows=ROWS, explains=800.0)
SIDE = "a moment that no mechanism on the list has (side moment from 2.00 s)"
NONE_ADEQUATE = "None of the hypotheses is adequate"
NAMES = (NONE, "lag", "sticking", "damping", "bodyfixed", "inplane")
LEVELS = st.floats(-1e4, 1e4)


def candidate(
    name: str, level: float, held_out: float | Sequence[float] | FloatArray | None = None, **others: str
) -> Contender:
    """One that predicts every stretch with its share of the evidence, so that this falls as the rows do, or so."""
    density = level / STRETCHES if held_out is None else held_out
    each = np.full(STRETCHES, density) if np.isscalar(density) else np.array(density, dtype=float)
    return Contender(name, level, each, **others)


NULL = candidate(NONE, 0.0)
LAG = candidate("lag", 40.0)


def side(level: float) -> Contender:
    """Something instead of the leader."""
    return candidate("side", level, words=SIDE)


def explained(share: float) -> Explained:
    rest = {"unexplained": 1.0 - share, "processes": 0.0, "noise": 1.0 - share}
    return Explained(share=share, interval_95=(share - 0.05, share + 0.05), **rest)


def process(share: float, name: str = "density_change", family: str = "air") -> ProcessEstimate:
    return ProcessEstimate(
        name=name, family=family, size=0.02, std_error=0.004, units="1", share_of_moment=share, tolerance=0.002
    )


def said(*listed: Contender, outside: Sequence[Contender] = (), fit: Misfit = GOOD) -> Verdict:
    return judge(listed, outside, fit, explained(0.83), [process(0.012)])


# ---- Probabilities ----


@given(st.lists(LEVELS, min_size=1, max_size=6), st.lists(LEVELS, max_size=3), st.floats(0.01, 0.99))
def test_probabilities_sum_to_one_and_follow_the_evidence(
    levels: list[float], others: list[float], prior: float
) -> None:
    chances = probabilities(dict(zip(NAMES, levels, strict=False)), others, prior)
    assert set(chances) == {*NAMES[: len(levels)], *([OTHER] if others else [])}
    assert sum(chances.values()) == pytest.approx(1.0)
    assert all(chance >= 0.0 for chance in chances.values())
    rivals = dict(zip(NAMES[1:], levels[1:], strict=False))
    if rivals:
        best = max(rivals, key=rivals.__getitem__)
        assert chances[best] == max(chances[name] for name in rivals)


@pytest.mark.parametrize("rivals", [1, 2, 5, 9])
@pytest.mark.parametrize(("level", "baseline"), [(0.0, 0.5), (np.log(3.0), 0.25), (-np.log(3.0), 0.75)])
def test_the_number_of_equal_rivals_does_not_change_the_baseline(rivals: int, level: float, baseline: float) -> None:
    chances = probabilities({NONE: 0.0, **{f"rival {k}": level for k in range(rivals)}})
    assert chances[NONE] == pytest.approx(baseline)


@given(st.lists(st.floats(-20.0, 20.0), min_size=1, max_size=5), st.floats(-30.0, 0.0), st.lists(LEVELS, max_size=2))
def test_a_rival_no_likelier_than_those_listed_takes_nothing_from_the_baseline(
    levels: list[float], below: float, others: list[float]
) -> None:
    short = {NONE: 0.0, **{f"rival {k}": level for k, level in enumerate(levels)}}
    longer = {**short, "one more": min(levels) + below}
    assert probabilities(longer, others)[NONE] >= probabilities(short, others)[NONE] * (1.0 - 1e-12)


@pytest.mark.parametrize("count", [1, 2, 6])
@pytest.mark.parametrize("forms", [1, 2, 3])
@pytest.mark.parametrize("prior", [OTHER_PRIOR, 0.05, 0.6])
def test_other_has_its_prior_where_the_data_say_nothing(count: int, forms: int, prior: float) -> None:
    """The baseline half of the rest, its rivals the other half."""
    chances = probabilities(dict.fromkeys(NAMES[:count], 5.0), [5.0] * forms, prior)
    assert chances[OTHER] == pytest.approx(prior)
    assert chances[NONE] == pytest.approx((1.0 - prior) * (0.5 if count > 1 else 1.0))
    for name in NAMES[1:count]:
        assert chances[name] == pytest.approx(0.5 * (1.0 - prior) / (count - 1))


def test_probabilities_are_posterior_odds() -> None:
    """By hand: 0.4 for the baseline, 0.2 for each of two, 0.2 for two things outside."""
    chances = probabilities({NONE: 0.0, "lag": np.log(6.0), "sticking": np.log(2.0)}, [np.log(3.0), np.log(1.0)])
    assert chances == pytest.approx({NONE: 0.4 / 2.4, "lag": 1.2 / 2.4, "sticking": 0.4 / 2.4, OTHER: 0.4 / 2.4})


def test_without_a_baseline_its_rivals_share_all() -> None:
    assert probabilities({"lag": 3.0, "sticking": 3.0}) == pytest.approx({"lag": 0.5, "sticking": 0.5})


@given(st.floats(-1e6, 1e6))
def test_a_constant_of_all_evidences_is_nothing(constant: float) -> None:
    levels = {NONE: 0.0, "lag": 2.0}
    moved = {name: level + constant for name, level in levels.items()}
    assert probabilities(moved, [1.0 + constant]) == pytest.approx(probabilities(levels, [1.0]), rel=1e-6)


# ---- Names ----


def test_a_clear_leader_is_named() -> None:
    verdict = said(NULL, LAG)
    assert (verdict.winner, verdict.outcome, verdict.equivalent) == ("lag", "named", ("lag",))
    assert verdict.probability["lag"] > 0.99
    assert verdict.probability[OTHER] == 0.0
    assert verdict.stability == 1.0
    assert verdict.adequacy is not None
    assert verdict.adequacy.adequate
    assert (verdict.explained, verdict.processes) == (explained(0.83), (process(0.012),))
    assert verdict.reason == "lag explains the moments best (probability above 0.99)."


def test_what_predicts_held_out_blocks_worse_than_the_baseline_is_not_named() -> None:
    named, null = said(NULL, LAG), said(NULL)
    assert with_prediction_error(named, 0.4) == named
    verdict = with_prediction_error(named, 1.3)
    assert (verdict.winner, verdict.outcome, verdict.described) == (None, "undecided", "lag")
    assert verdict.equivalent == ("lag", NONE)
    assert verdict.probability == named.probability
    reason = verdict.reason
    assert reason.startswith("lag describes the moments best (probability above 0.99)")
    assert "explains" not in reason
    assert "no established cause" in reason
    assert "(130 % of its error)" in reason
    assert "(>1000 % of its error)" in with_prediction_error(named, 520.0).reason
    assert with_prediction_error(null, 1.3) == null


def test_beside_processes_far_beyond_their_ordinary_size_nothing_is_named() -> None:
    """Of the moment, or of instruments if larger than what is named. What is within its error says nothing."""
    large = process(0.012)
    for name, family, size, error, leader, keeps in (
        ("flow", "body", 230.0, 10.0, 0.3, False),
        ("flow", "body", 19.0, 1.0, 0.3, True),
        ("flow", "body", 230.0, 150.0, 0.3, True),
        ("flow", "gyros", 230.0, 10.0, 0.3, True),
        ("flow", "gyros", 230.0, 10.0, 0.003, False),
    ):
        acts = MechanismLimit(mechanism="lag", share_of_moment_95=0.4, share_of_moment=leader)
        named = said(NULL, LAG).model_copy(update={"limits": (acts,)})
        about = {"name": name, "family": family, "size": size * large.tolerance, "std_error": error * large.tolerance}
        found = named.model_copy(update={"processes": (large.model_copy(update=about),)})
        verdict = with_far_processes(found)
        assert (verdict == found) is keeps
        assert with_far_processes(found, [name]) == found
        if not keeps:
            assert (verdict.winner, verdict.outcome, verdict.described) == (None, "undecided", "lag")
            assert "but is no established cause: beside it processes are far beyond" in verdict.reason
            assert "explains the moments best" not in verdict.reason
            assert "(flow 230 times)" in verdict.reason
            assert with_far_processes(with_prediction_error(found, 1.3)).reason.count("no established cause") == 1
    null = said(NULL).model_copy(update={"processes": (large.model_copy(update={"size": 230.0 * large.tolerance}),)})
    assert with_far_processes(null) == null


def test_on_a_motion_that_did_not_converge_nothing_is_named() -> None:
    for verdict in (said(NULL, LAG), said(candidate(NONE, 0.0), candidate("lag", -8.0))):
        found = without_converged_motion(verdict)
        assert (found.outcome, found.winner, found.described) == ("undecided", None, None)
        assert "did not converge" in found.reason


@pytest.mark.parametrize(("shares", "outcome"), [((0.1, 2.0, 0.3), "named"), ((0.1, 2.0, np.nan), "undecided")])
def test_that_nothing_acts_is_not_said_where_most_may_be_the_whole_moment(
    shares: tuple[float, ...], outcome: str
) -> None:
    limits = [MechanismLimit(mechanism=f"m{k}", share_of_moment_95=share) for k, share in enumerate(shares)]
    verdict = said(candidate(NONE, 0.0), candidate("lag", -8.0)).model_copy(update={"limits": tuple(limits)})
    found = without_power(verdict)
    assert found.outcome == outcome
    assert (found.winner is None) == ("m1, m2 may have" in found.reason) == (outcome == "undecided")


def test_the_baseline_may_be_named() -> None:
    verdict = said(candidate(NONE, 0.0), candidate("lag", -8.0))
    assert (verdict.winner, verdict.outcome, verdict.equivalent) == (NONE, "named", (NONE,))
    assert verdict.reason == (
        "No mechanism is needed: baseline and processes explain the moments (probability above 0.99)."
    )


@pytest.mark.parametrize(("share", "words"), [(0.9989, "99.89"), (0.0123, "1"), (1e-6, "<0.01"), (0.0, "0")])
def test_a_share_near_nothing_or_all_is_printed_to_hundredths(share: float, words: str) -> None:
    assert percent(share) == words


def test_close_hypotheses_are_reported_together() -> None:
    verdict = said(NULL, LAG, candidate("sticking", 39.5))
    assert (verdict.winner, verdict.outcome) == (None, "undecided")
    assert verdict.equivalent == ("lag", "sticking")
    assert verdict.reason == "The data do not distinguish these: lag 0.62, sticking 0.38."


@pytest.mark.parametrize(("level", "named"), [(2.1, False), (2.3, True)])
def test_a_name_needs_nine_tenths(level: float, named: bool) -> None:
    """Odds of 9 against the baseline alone are 2.2 nats."""
    verdict = said(NULL, candidate("lag", level))
    assert (verdict.winner == "lag") == named
    assert verdict.outcome == ("named" if named else "undecided")
    assert (verdict.probability["lag"] >= WINNING_PROBABILITY) == named


# ---- Predictions ----


@pytest.mark.parametrize(("held_out", "named"), [(0.1, True), (0.0, False), (-0.1, False)])
def test_a_name_predicts_better_than_the_baseline_only(held_out: float, named: bool) -> None:
    verdict = said(NULL, candidate("lag", 40.0, held_out))
    assert (verdict.winner == "lag") == named
    if not named:
        assert (verdict.outcome, verdict.equivalent) == ("undecided", ("lag", NONE))
        assert verdict.reason == (
            "The data do not name one hypothesis: lag has the largest evidence (probability above 0.99), but it "
            "predicts stretches of the record from the others no better than baseline and processes."
        )


@pytest.mark.parametrize(
    ("fit", "why"),
    [
        (Misfit(1.0, ROWS, 0.0), "explains nothing significant of what the baseline does not."),
        (Misfit(1.0, ROWS, 800.0, significant=False), "explains less than processes do (83 %, these 0 %)."),
        (Misfit(1.0, ROWS, 800.0, regions=3), "acts in 3 separate regions, as a description of something else would."),
    ],
)
def test_what_explains_nothing_significant_is_not_named(fit: Misfit, why: str) -> None:
    """The reason says which it is, and no other."""
    verdict = said(NULL, LAG, fit=fit)
    assert (verdict.outcome, verdict.winner) == ("undecided", None)
    assert verdict.reason.endswith(f"(probability above 0.99), but it {why}")


@pytest.mark.parametrize(("level", "likelier"), [(38.0, False), (41.5, True)])
def test_what_is_likelier_than_the_leader_is_said(level: float, likelier: bool) -> None:
    verdict = said(NULL, LAG, outside=[side(level)], fit=Misfit(1.0, ROWS, 0.0))
    other = verdict.probability[OTHER]
    assert (other > verdict.probability["lag"]) == likelier
    assert verdict.outcome == "undecided"
    words = f" Likelier ({other:.2f}) is something else, such as {SIDE}."
    assert verdict.reason.endswith(words) == likelier
    assert ("Likelier" in verdict.reason) == likelier


def test_all_stretches_count_together() -> None:
    """One that is predicted far worse outweighs many that are predicted a little better."""
    worse = np.array([0.1] * (STRETCHES - 1) + [-5.0])
    assert decide([NULL, replace(LAG, held_out=worse)], [], GOOD).outcome == "undecided"
    assert decide([NULL, replace(LAG, held_out=-worse)], [], GOOD).winner == "lag"


def test_the_baseline_need_not_predict_better_than_itself() -> None:
    assert decide([NULL, candidate("lag", -9.0, 5.0)], [], GOOD).winner == NONE


# ---- What cannot be, and lack of fit ----


def test_a_value_that_no_body_can_have_makes_none_adequate() -> None:
    eps = "eps = 1.7 from 0.00 to 2.00 s, where 0 to 1 is possible"
    verdict = said(NULL, candidate("lag", 40.0, impossible=eps))
    assert (verdict.winner, verdict.outcome, verdict.equivalent) == (None, "none adequate", ())
    assert verdict.probability["lag"] == 0.0
    assert verdict.probability[OTHER] > 0.99
    assert sum(verdict.probability.values()) == pytest.approx(1.0)
    assert verdict.reason == (f"{NONE_ADEQUATE}: lag fits best, but with {eps}. `brv-hypo trace` looks for what it is.")


def test_an_impossible_rival_is_no_matter() -> None:
    verdict = said(NULL, LAG, candidate("sticking", 2.0, impossible="eps = 1.7"))
    assert verdict.winner == "lag"
    assert "eps" not in verdict.reason


@pytest.mark.parametrize(
    ("noise", "explains", "adequate"),
    [
        (0.5, 1.0, True),
        (1.0, 1.0, True),
        (1.40, 1.0, True),  # the residual beyond the noise is less than the noise
        (1.43, 1.0, False),
        (3.0, 7.9 * ROWS, False),
        (3.0, 8.1 * ROWS, True),  # and less than what the leader explains
    ],
)
def test_a_lack_of_fit_is_measured_by_noise_and_by_what_is_explained(
    noise: float, explains: float, adequate: bool
) -> None:
    fit = Misfit(noise, ROWS, explains)
    verdict = said(NULL, LAG, fit=fit)
    assert verdict.adequacy is not None
    assert verdict.adequacy.adequate == fit.adequate == adequate
    assert verdict.adequacy.ratio == noise
    assert (verdict.outcome == "named") == adequate
    if not adequate:
        assert verdict.equivalent == ()
        assert f"its residual is {noise:.2f} times the noise (rms)." in verdict.reason
        assert "--instruments" in verdict.reason


@pytest.mark.parametrize("rows", [50, 100_000])
def test_the_p_value_allows_for_noise_that_is_stated_within_a_tenth(rows: int) -> None:
    """Of as many standard errors as a level has by its rows and by what the record states."""
    spread = float(np.hypot(NOISE_LEVEL[1], np.sqrt(0.5 / rows)))
    for sigmas, expected in ((0.0, 0.5), (1.0, 0.158655), (3.0, 0.00134990)):
        assert Misfit(float(np.exp(sigmas * spread)), rows, 0.0).p_value == pytest.approx(expected, rel=1e-5)


# ---- What is outside the list ----


def test_what_explains_the_flight_better_than_any_on_the_list_makes_none_adequate() -> None:
    verdict = said(NULL, LAG, outside=[side(50.0), candidate("event", 30.0, words="an event")])
    assert (verdict.winner, verdict.outcome, verdict.equivalent) == (None, "none adequate", ())
    assert verdict.probability[OTHER] > 0.99
    assert verdict.adequacy is not None
    assert not verdict.adequacy.adequate
    assert verdict.reason == (
        f"{NONE_ADEQUATE}: lag fits best of them, but {SIDE} fits better (probability of something "
        "else above 0.99). `brv-hypo trace` looks for what it is."
    )


def test_what_explains_the_flight_as_well_as_the_leader_keeps_it_from_being_named() -> None:
    """Prior odds of 0.4 to 0.2."""
    verdict = said(NULL, LAG, outside=[side(LAG.level)])
    assert (verdict.winner, verdict.outcome, verdict.equivalent) == (None, "undecided", ("lag",))
    assert verdict.probability[OTHER] == pytest.approx(1.0 / 3.0)
    assert verdict.reason == f"The data do not distinguish these: lag 0.67, something else, such as {SIDE}, 0.33."


def test_what_is_likelier_than_the_leader_but_not_sure_leaves_it_undecided() -> None:
    """None adequate is a claim, too: it needs the probability of a name."""
    verdict = said(NULL, LAG, outside=[side(LAG.level + 2.0)])
    assert 0.5 < verdict.probability[OTHER] < WINNING_PROBABILITY
    assert (verdict.outcome, verdict.equivalent) == ("undecided", ("lag",))


def test_an_alternative_far_behind_takes_nothing_from_the_leader() -> None:
    assert said(NULL, LAG, outside=[side(0.0)]).winner == "lag"


def test_its_prior_is_that_of_the_configuration() -> None:
    chances = [judge([NULL, LAG], [side(LAG.level)], GOOD, other_prior=prior).probability for prior in (0.01, 0.5)]
    assert chances[0]["lag"] > WINNING_PROBABILITY
    assert chances[1][OTHER] == pytest.approx(2.0 / 3.0)


# ---- Repetitions without a stretch of the record ----


def lag_without(confirmed: float, rival: float = 37.0) -> tuple[Contender, Contender]:
    """`lag`, and the baseline that leads by `rival` without the other stretches than that share."""
    ahead = np.arange(STRETCHES) < round(confirmed * STRETCHES)
    return candidate("lag", 40.0, 40.0 - np.where(ahead, rival, -rival)), candidate(NONE, 0.0)


@pytest.mark.parametrize("stretches", [0, 3, 6, 10, STRETCHES - 1])
def test_a_leader_that_repetitions_do_not_confirm_is_not_named(stretches: int) -> None:
    """Who leads without a stretch is a rival on the list: what the leader loses is theirs, not `other`'s."""
    confirmed = stretches / STRETCHES
    lag, null = lag_without(confirmed)
    outside = [side(LAG.level - 5.0)]
    steady, discounted = judge([NULL, LAG], outside, GOOD), judge([null, lag], outside, GOOD)
    assert steady.winner == "lag"
    assert (discounted.winner, discounted.outcome) == (None, "undecided")
    assert discounted.probability["lag"] == pytest.approx((stretches + 1.0) / (STRETCHES + 2.0))
    assert discounted.probability[OTHER] == steady.probability[OTHER]
    assert discounted.equivalent == ("lag", NONE)
    assert discounted.stability == pytest.approx(confirmed)
    assert sum(discounted.probability.values()) == pytest.approx(1.0)


def test_what_the_leader_loses_is_shared_by_probability() -> None:
    lag, null = lag_without(0.5)
    verdict = judge([null, lag, candidate("sticking", 10.0, 110.0)], [], GOOD)
    assert verdict.probability["sticking"] == pytest.approx(0.5, abs=1e-3)
    assert verdict.probability[NONE] == pytest.approx(0.0, abs=1e-3)


def test_repetitions_do_not_raise_a_leader() -> None:
    """Ahead everywhere, and no more probable for that."""
    verdict = judge([NULL, candidate("lag", 0.5)], [], GOOD)
    assert verdict.stability == 1.0
    assert verdict.probability["lag"] == pytest.approx(1.0 / (1.0 + np.exp(-0.5)))


def test_a_name_near_the_border_keeps_its_leader_and_not_its_outcome() -> None:
    """Undecided in some repetitions: they are no voice for another."""
    verdict = judge([NULL, candidate("lag", 4.0, np.where(np.arange(STRETCHES) < 5, 0.0, 3.0))], [], GOOD)
    assert verdict.winner == "lag"
    assert verdict.stability == pytest.approx(5 / STRETCHES)
    assert verdict.probability["lag"] > WINNING_PROBABILITY


def test_without_stretches_there_is_nothing_to_repeat() -> None:
    """Nor to predict: the baseline alone may be named."""
    verdict = judge([candidate(NONE, 9.0, ()), candidate("lag", 0.0, ())], [], GOOD)
    assert (verdict.winner, verdict.stability) == (NONE, 1.0)
    verdict = judge([candidate(NONE, 0.0, ()), candidate("lag", 9.0, ())], [], GOOD)
    assert (verdict.winner, verdict.equivalent, verdict.stability) == (None, ("lag", NONE), 1.0)


@pytest.mark.parametrize(
    ("levels", "beyond", "outcome", "winner"),
    [
        ((0.0, 40.0, 25.0), 0.0, "named", "lag"),
        ((250.0, 290.0, 275.0), 250.0, "named", "lag"),
        ((0.0, 40.0, 39.5), 0.0, "undecided", None),
        ((0.0, 25.0, 40.0), 0.0, "named", "sticking"),
        ((40.0, 25.0, 25.0), 0.0, "named", NONE),
        ((0.0, 40.0, 25.0), 60.0, "none adequate", None),
    ],
)
def test_a_repetition_is_judged_by_the_same_rules(
    levels: tuple[float, ...], beyond: float, outcome: str, winner: str | None
) -> None:
    """Whatever the whole record and all other repetitions say: there nothing is likelier than the baseline.

    `levels` and `beyond` are the evidences without the first stretch; mechanisms predict the others better.
    """

    def discounted(name: str, level: float, without_first: float, **others: str) -> Contender:
        rest = [0.0 if name == NONE else 100.0] * (STRETCHES - 1)
        return candidate(name, level, [level - without_first, *rest], **others)

    listed = [
        discounted(name, 50.0 if name == NONE else 0.0, without_first)
        for name, without_first in zip(NAMES, levels, strict=False)
    ]
    outside = [discounted("side", 0.0, beyond, words=SIDE)]
    there = [replace(each, level=level) for each, level in zip(listed, levels, strict=True)]
    found = decide(there, [replace(outside[0], level=beyond)], GOOD)
    assert (found.outcome, found.winner) == (outcome, winner)
    baseline_only = (outcome, winner) == ("named", NONE)
    assert judge(listed, outside, GOOD).stability == pytest.approx(1.0 if baseline_only else 1.0 - 1.0 / STRETCHES)


# ---- Whatever the evidences ----


@given(
    st.lists(st.tuples(LEVELS, LEVELS, LEVELS), min_size=1, max_size=6),
    st.lists(LEVELS, max_size=3),
    st.floats(0.05, 20.0),
    st.floats(0.0, 1e6),
    st.integers(0, 2**30),
)
def test_a_verdict_is_whole_whatever_the_evidences(
    rows: list[tuple[float, float, float]], others: list[float], noise: float, explains: float, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    listed = [
        candidate(name, level, held + spread * rng.standard_normal(STRETCHES))
        for name, (level, held, spread) in zip(NAMES, rows, strict=False)
    ]
    outside = [side(level) for level in others]
    verdict = judge(listed, outside, Misfit(noise, ROWS, explains), explained(0.5), [process(0.3)])
    leader = max(listed, key=lambda each: each.level)
    assert set(verdict.probability) == {each.name for each in listed} | {OTHER}
    assert sum(verdict.probability.values()) == pytest.approx(1.0)
    assert all(0.0 <= chance <= 1.0 + 1e-12 for chance in verdict.probability.values())
    assert verdict.stability is not None
    assert 0.0 <= verdict.stability <= 1.0
    assert (verdict.winner is not None) == (verdict.outcome == "named")
    if verdict.winner is not None:
        assert verdict.equivalent == (verdict.winner,) == (leader.name,)
        assert verdict.probability[verdict.winner] >= WINNING_PROBABILITY
        assert leader is listed[0] or leader.held_out.sum() > listed[0].held_out.sum()
    if verdict.outcome == "none adequate":
        assert verdict.equivalent == ()
        assert not Misfit(noise, ROWS, explains).adequate or verdict.probability[OTHER] >= WINNING_PROBABILITY
    if verdict.outcome == "undecided":
        assert verdict.equivalent[0] == leader.name
    assert not re.search(r"\d{7}|e\+|\bnan\b|\binf\b", verdict.reason)


@given(st.permutations(range(4)), st.lists(st.floats(-9.0, 9.0), min_size=4, max_size=4, unique=True))
def test_the_order_of_the_list_is_nothing(order: list[int], levels: list[float]) -> None:
    listed = [candidate(name, level) for name, level in zip(NAMES, levels, strict=False)]
    one, other = judge(listed, [], GOOD), judge([listed[k] for k in order], [], GOOD)
    assert one.probability == pytest.approx(other.probability)
    assert (one.outcome, one.winner, set(one.equivalent)) == (other.outcome, other.winner, set(other.equivalent))


def test_with_an_error_far_beyond_its_tolerance_no_cause_is_established() -> None:
    named = said(candidate("lag", 0.0), candidate(NONE, -30.0))
    near, far = (
        RecordError(name="accel_position x", value=0.01 * times, std_error=0.001, units="m", tolerance=0.01)
        for times in (4.9, 8.8)
    )
    assert with_far_error(named, (near,)) == named
    verdict = with_far_error(named, (far,))
    assert (verdict.winner, verdict.outcome, verdict.described) == (None, "undecided", "lag")
    reason = verdict.reason
    beside = "beside it, accel_position x is 0.088 m, 8.8 times its tolerance: check that first."
    assert reason.endswith(f"but is no established cause: {beside}")
    assert "explains the moments best" not in reason
    assert with_far_error(with_prediction_error(named, 1.3), (far,)).reason.count("no established cause") == 1
    null = said(candidate(NONE, 0.0), candidate("lag", -8.0))
    assert with_far_error(null, (far,)) == null
