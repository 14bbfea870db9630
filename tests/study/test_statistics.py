"""Statistics of studies whose answer is known."""

from __future__ import annotations

import numpy as np
import pytest

from brv_hypo.study import StudyConfig, summarise
from brv_hypo.study.statistics import LEAST, calibration, confusion, detection_limits, false_alarms, logistic, share
from tests.study.outcomes import outcome


@pytest.mark.parametrize(
    ("count", "total", "low", "high"),
    [
        (0, 10, 0.0, 0.30849710781876083),  # 1 - 0.025^(1/10): closed form
        (10, 10, 0.69150289218123917, 1.0),
        (7, 20, 0.1539092, 0.5921885),  # R 4, binom.test(7, 20)$conf.int, 7 digits
        (0, 0, 0.0, 1.0),
    ],
)
def test_shares_have_the_exact_interval(count, total, low, high):
    found = share(count, total)
    assert (found.low, found.high) == pytest.approx((low, high), abs=1e-7)
    assert found.value == (count / total if total else None)


def test_confusion_counts_what_ranked_first_and_what_won():
    lag, none = confusion(
        [
            outcome("lag", "lag", winner="lag"),
            outcome("lag", "lag"),
            outcome("lag", "sticking", winner="sticking"),
            outcome("none", "none", winner="none"),
        ],
        ("lag", "sticking", "none"),
    )
    assert (lag.planted, lag.flights, lag.first) == ("lag", 3, {"lag": 2, "sticking": 1})
    assert (lag.winners, lag.undecided) == ({"lag": 1, "sticking": 1}, 1)
    assert (lag.ranked_first.count, lag.won.count) == (2, 1)
    assert none.first == {"none": 1}


def test_a_false_alarm_is_a_named_mechanism_where_nothing_was_planted():
    flights = [outcome("none", "lag", winner="lag"), outcome("none", "lag"), outcome("none", "none", winner="none")]
    found = false_alarms([*flights, outcome("lag", "sticking", winner="sticking")])
    assert (found.count, found.total) == (1, 3)


def test_the_brier_score_and_the_log_loss_by_hand():
    chances = {"none": 0.2, "lag": 0.7, "sticking": 0.1}
    found = calibration([outcome("none", "lag", probability=chances)])
    assert found.brier == pytest.approx(0.8**2 + 0.7**2 + 0.1**2)
    assert found.log_loss == pytest.approx(-np.log(0.2))


def test_what_was_given_no_probability_has_a_finite_loss():
    """It counts as the least probability that any loss does."""
    chances = {"none": 0.0, "lag": 1.0}
    found = calibration([outcome("none", "lag", probability=chances), outcome("lag", "lag", probability=chances)])
    assert found.log_loss == pytest.approx(-0.5 * np.log(LEAST))


def drawn(flights: int, seed: int) -> list:
    """Flights whose truth is drawn from the probabilities."""
    random = np.random.default_rng(seed)
    names = ("none", "lag", "sticking")
    found = []
    for _ in range(flights):
        shares = random.dirichlet((0.3, 0.3, 0.3))
        chances = dict(zip(names, shares.tolist(), strict=True))
        planted = str(random.choice(names, p=shares))
        first = max(chances, key=lambda name: chances[name])
        found.append(outcome(planted, first, probability=chances))
    return found


def test_calibrated_verdicts_fill_the_bins_at_their_own_probability():
    """1500 flights; another probability for the truth loses more."""
    flights = drawn(1500, seed=5)
    found = calibration(flights)
    assert sum(item.right.total for item in found.bins) == found.flights == 1500
    for item in found.bins:
        if item.right.total:
            # 99.9 % limits of the share; the intervals themselves are at 95 %
            sigma = np.sqrt(item.mean_probability * (1 - item.mean_probability) / item.right.total)
            assert abs(item.right.value - item.mean_probability) < 3.3 * sigma + 1e-9
    for power in (0.5, 2.0):
        warped = []
        for each in flights:
            values = {name: chance**power for name, chance in each.probability.items()}
            warped.append(
                each.model_copy(update={"probability": {n: v / sum(values.values()) for n, v in values.items()}})
            )
        assert calibration(warped).log_loss > found.log_loss


def test_a_certain_verdict_is_counted_in_the_last_bin():
    last = calibration([outcome("lag", "lag")]).bins[-1]
    assert (last.right.count, last.right.total) == (1, 1)


def test_a_flight_given_to_something_else_is_no_right_verdict_on_its_leader():
    """The planted mechanism ranks first, but the verdict is that none of the list is at work."""
    chances = {"none": 0.0, "lag": 0.05, "other": 0.95}
    given = outcome("lag", "lag", probability=chances, information={"none": 0.0, "lag": -10.0})
    (found,) = [item for item in calibration([given]).bins if item.right.total]
    assert (found.low, found.mean_probability, found.right.count) == (0.9, 0.95, 0)


def test_calibration_without_flights_says_so():
    found = calibration([])
    assert (found.flights, found.brier, found.log_loss) == (0, None, None)


def flown_at(effects, won) -> list:
    return [
        outcome("lag", "lag", winner="lag" if hit else None, effect=float(effect))
        for effect, hit in zip(effects, won, strict=True)
    ]


def test_the_detection_limit_is_recovered():
    """2000 flights won with probability 1 / (1 + (0.05 / effect)^3): half at 0.05, nine tenths at 0.104."""
    random = np.random.default_rng(1)
    effects = np.exp(random.uniform(np.log(0.005), np.log(0.5), 2000))
    won = random.uniform(size=2000) < 1.0 / (1.0 + (0.05 / effects) ** 3)
    together, alone = detection_limits(flown_at(effects, won))
    assert (together.vehicle, alone.vehicle) == (None, "cone")
    assert together.status == "estimated"
    assert together.half == pytest.approx(0.05, rel=0.08)
    assert together.nine_tenths == pytest.approx(0.05 * 9 ** (1 / 3), rel=0.12)


@pytest.mark.parametrize(
    ("effects", "won", "status"),
    [
        ([0.1, 0.2, 0.3], [1, 1, 1], "all won"),
        ([0.1, 0.2, 0.3], [0, 0, 0], "none won"),
        ([0.1, 0.2, 0.3], [0, 1, 1], "too few"),
        ([0.1, 0.2, 0.3, 0.4, 0.5, 0.6], [1, 1, 1, 0, 0, 0], "no trend"),
        ([0.1, 0.11, 0.12, 0.13, 0.14, 0.15], [0, 1, 0, 1, 0, 1], "extrapolated"),
    ],
)
def test_limits_that_the_flights_do_not_show_are_not_given_as_estimates(effects, won, status):
    assert detection_limits(flown_at(effects, won))[0].status == status


def test_a_logistic_curve_stays_finite_where_won_and_lost_are_parted():
    x = np.arange(10.0)
    level, slope = logistic(x, (x > 4.5).astype(float))
    assert 0.5 < slope < 20.0
    assert -level / slope == pytest.approx(4.5, abs=0.01)


def test_nothing_planted_has_no_detection_limit():
    assert detection_limits([outcome("none", "none", winner="none")]) == ()


def test_the_summary_sets_weak_effects_and_failures_apart():
    study = StudyConfig(vehicles=("cone",), planted=("none", "lag"))
    lost = outcome("lag", "none", effect=0.3, repeat=1).model_copy(
        update={"information": {"none": -12.0, "lag": -10.0}}
    )
    failed = outcome("lag", "lag", repeat=2).model_copy(update={"status": "not simulated", "reason": "it diverges"})
    weak = outcome("lag", "none", effect=0.01)
    found = summarise(study, [outcome("none", "none", winner="none"), weak, lost, failed])
    assert (found.flights, found.compared) == (4, 3)
    assert (found.right_visible.count, found.right_visible.total) == (1, 2)
    assert [(item.draw.key, item.first, item.lead) for item in found.mistakes] == [("cone/lag/1", "none", 2.0)]
    assert [(item.draw.key, item.reason) for item in found.failures] == [("cone/lag/2", "it diverges")]
