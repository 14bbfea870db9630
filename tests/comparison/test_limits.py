"""How large a mechanism may be beside leader and processes: never less than it was planted."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from brv_hypo import compare, simulate
from brv_hypo.comparison.limits import limits
from brv_hypo.inference.evidence import with_amplitudes
from brv_hypo.mechanisms import find
from brv_hypo.model.term import TimeBasis, term_column
from tests.chains import judged_cone
from tests.flights import flown

MECHANISMS = ("bodyfixed", "damping")


def shares(names: tuple[str, ...], *plant: str) -> dict[str, float]:
    """The limits of these hypotheses beside what leads where that is planted."""
    judged = judged_cone(*plant)
    groups = {"none": (), **{name: tuple(find(part) for part in name.split("+")) for name in names}}
    found = limits(*judged.leading, groups, judged.weight)
    assert len(found) == len({limit.mechanism for limit in found})
    return {limit.mechanism: limit.share_of_moment_95 for limit in found}


@cache
def found() -> dict[str, float]:
    return shares(MECHANISMS, "bodyfixed")


def planted() -> float:
    """The share of the moment's rms that was planted."""
    return float(np.hypot(*flown("research_cone", "bodyfixed").truth.planted_share))


def test_there_is_one_for_every_mechanism_and_none_for_the_null() -> None:
    assert set(found()) == set(MECHANISMS)


def test_they_are_positive_numbers() -> None:
    assert all(0.0 < share < np.inf for share in found().values())


def test_the_planted_amplitude_is_within_and_near() -> None:
    assert planted() < found()["bodyfixed"] < 1.2 * planted()


def test_the_limit_beside_the_leader_is_low() -> None:
    assert found()["damping"] < 0.1


def test_a_mechanism_that_is_not_there_has_little_room() -> None:
    """Far less than is planted where it is there: a flight without information would allow as much.

    Acting always it may be as large as the tolerance of trim leaves it; for a quarter of the record it is far smaller.
    """
    judged = judged_cone()
    groups = {"bodyfixed": (find("bodyfixed"),)}
    (limit,) = limits(*judged.leading, groups, judged.weight)
    assert limit.share_of_moment_95 < 0.4 * planted()
    assert np.hypot(*limit.coefficients_95.values()) < 0.02 * np.hypot(8e-4, 3e-4)  # as it is planted


@pytest.mark.slow
@pytest.mark.parametrize("seed", [88341, 88362])
def test_a_moment_that_acts_always_beside_the_leader_is_within_the_limit(seed: int) -> None:
    """Trim takes it up. The best of many regions in noise excluded it: the limit was a hundredth of it."""
    sticking = {"mechanism": "sticking", "theta": {"delay": 0.1}, "terms": {"eps": 0.5}, "start": 3.0, "stop": 5.5}
    terms = {"C_b cos(phi_b)": 2e-4, "C_b sin(phi_b)": 2e-4}
    always = {"mechanism": "bodyfixed", "kind": "constant", "terms": terms}
    flown = simulate(
        {"base": "blunt_capsule", "mechanisms": [sticking, always], "instruments": {"draw": 1.0}}, seed=seed
    )
    verdict = compare(flown, mechanisms=["sticking", "bodyfixed"], maximum_likelihood="none").verdict
    assert verdict.winner == "sticking"
    limit = next(each for each in verdict.limits if each.mechanism == "bodyfixed")
    assert limit.coefficient_95 > np.hypot(2e-4, 2e-4)


def test_a_joined_hypothesis_has_the_limit_of_its_largest() -> None:
    joined = shares(("bodyfixed+damping", "damping+bodyfixed"), "bodyfixed")
    assert set(joined.values()) == {found()["bodyfixed"]}


def test_what_the_baseline_has_over_the_whole_record_sets_no_limit() -> None:
    """An in-plane moment that lasts is the vehicle's own; parts of the record bound the mechanism."""
    (limit,) = shares(("inplane",), "bodyfixed").values()
    assert 0.0 < limit < 2.0


def test_a_limit_far_beyond_the_moment_is_withheld() -> None:
    """At a nat that counts for next to nothing, a record says nothing of any size."""
    judged = judged_cone("bodyfixed")
    groups = {"damping": (find("damping"),)}
    (limit,) = limits(*judged.leading, groups, 1e-12)
    assert np.isnan(limit.share_of_moment_95)


def test_no_coefficient_is_limited_below_its_fit_on_a_stretch() -> None:
    """The same evidence with the mechanism as a hypothesis: estimate and error, but for the prior of its amplitude."""
    judged = judged_cone()
    null, damping, like = judged.baseline, find("damping"), judged.fits[judged.null]
    (limit,) = limits(like, null, {"damping": (damping,)}, judged.weight)
    frame = like.frame.with_mechanisms([damping])
    (term,), time = damping.terms(frame.motions[0], {}), frame.coefficient_time
    for start in np.linspace(time.min(), time.max(), 9)[:7]:
        stretch = TimeBasis("jump", float(start), float(start) + 0.25 * np.ptp(time))
        fit = replace(
            like, mechanisms=(damping,), frame=frame, columns=(*like.columns, term_column(damping, term, (), stretch))
        )
        own = with_amplitudes(null.rows, null.rows.terms(fit), np.append(null.at, np.log(3.0)))
        assert abs(own.values[-1]) < limit.coefficients_95["C_damping"]
        assert np.sqrt(own.covariance[-1, -1] / judged.weight) < limit.coefficients_95["C_damping"] < 1.0


def test_the_leader_and_what_lags_have_no_limits_of_coefficients() -> None:
    judged = judged_cone("bodyfixed")
    groups = {name: (find(name),) for name in ("bodyfixed", "lag", "inplane", "damping")}
    found = limits(*judged.leading, groups, judged.weight)
    assert [set(each.coefficients_95) for each in found] == [set(), set(), {"C_m0", "C_malpha"}, {"C_damping"}]
