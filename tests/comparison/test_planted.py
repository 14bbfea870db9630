"""What is planted comes first, on every vehicle; where nothing is, nothing is needed."""

from __future__ import annotations

from pathlib import Path

import pytest

from brv_hypo.comparison import CompareConfig, compare
from brv_hypo.mechanisms import use_plugin_files
from brv_hypo.mechanisms.yaml_mechanism import Factor, MechanismFile, YamlTerm, mechanism_text
from brv_hypo.simulation import load_config, simulate
from tests.flights import flown

VEHICLES = ("research_cone", "blunt_capsule", "sounding_rocket")
MECHANISMS = ("damping", "inplane", "bodyfixed", "lag", "sticking")
PLANTED = [(vehicle, mechanism) for vehicle in VEHICLES for mechanism in MECHANISMS]
"""The one among all mechanisms that is not slow; the rest takes minutes."""


@pytest.mark.thorough
def test_what_is_planted_ranks_before_none_by_regression() -> None:
    settings = CompareConfig(mechanisms=("bodyfixed",), maximum_likelihood="none")
    comparison = compare([flown("research_cone", "bodyfixed").flight], settings)
    first = comparison.ranking[0]
    assert first.mechanism == "bodyfixed"
    assert sum(comparison.verdict.probability.values()) == pytest.approx(1.0)
    assert first.prediction_ratio < 1.0
    assert [row.rank for row in comparison.ranking] == [1, 2]


@pytest.mark.slow
@pytest.mark.parametrize(("vehicle", "mechanism"), PLANTED)
def test_the_planted_mechanism_ranks_first(vehicle: str, mechanism: str) -> None:
    seed = 4000 + 10 * VEHICLES.index(vehicle) + MECHANISMS.index(mechanism)
    comparison = compare([simulate(vehicle, seed=seed, plant=(mechanism,)).flight])
    first = comparison.ranking[0]
    assert first.mechanism == mechanism
    assert sum(comparison.verdict.probability.values()) == pytest.approx(1.0)
    assert first.prediction_ratio < 1.0
    assert [row.rank for row in comparison.ranking] == list(range(1, 7))


@pytest.mark.slow
@pytest.mark.parametrize("vehicle", VEHICLES)
def test_none_is_credible_where_nothing_is_planted(vehicle: str) -> None:
    comparison = compare([simulate(vehicle, seed=4100 + VEHICLES.index(vehicle)).flight])
    assert "none" in comparison.verdict.equivalent
    assert comparison.ranking[0].mechanism == "none"
    assert comparison.ranking[0].f_ratio is None


@pytest.mark.slow
def test_two_flights_are_fitted_jointly() -> None:
    flights = [simulate("research_cone", seed=seed, plant=("bodyfixed",)).flight for seed in (4200, 4201)]
    comparison = compare(flights)
    assert comparison.verdict.winner == "bodyfixed"
    assert len(comparison.flights) == 2
    assert len(comparison.series) == 2
    alone = compare(flights[:1]).ranking[0]
    pairs = zip(comparison.ranking[0].terms, alone.terms, strict=False)
    assert all(joint.std_error < single.std_error for joint, single in pairs)


@pytest.mark.thorough
def test_a_joined_hypothesis_of_which_a_part_does_not_act_is_no_rival() -> None:
    """It had the evidence of the other, and half of its probability: one that is certain was undecided."""
    flight, names = flown("research_cone", "bodyfixed").flight, ("bodyfixed+damping", "bodyfixed")
    found = compare([flight], CompareConfig(mechanisms=names))
    first, joined, _ = found.ranking
    assert first.ml is not None
    assert joined.ml is None
    assert (first.mechanism, joined.mechanism) == ("bodyfixed", "bodyfixed+damping")
    assert {term.mechanism for term in joined.terms} == {"bodyfixed"}
    assert joined.log_evidence == first.log_evidence
    assert found.verdict.equivalent == ("bodyfixed",)
    assert set(found.verdict.probability) == {"none", "bodyfixed", "other"}


C_B = {"C_b cos(phi_b)": 8e-4, "C_b sin(phi_b)": -3e-4}
LATE = MechanismFile(
    name="late_side",
    title="side moment that is late",
    claims="a side moment late by 0.05 s",
    source="this test",
    terms=(
        YamlTerm(name="k", axis="out_of_plane", factors=(Factor(of="alpha", power=2),), units="1/rad^2", delay=0.05),
    ),
)


@pytest.mark.slow
def test_a_mechanism_with_a_fixed_delay_is_named(tmp_path: Path) -> None:
    """Its delay is no parameter: the likelihood takes the motion that long ago, and so does the static moment."""
    path = tmp_path / "late.yaml"
    path.write_text(mechanism_text(LATE), encoding="utf-8")
    use_plugin_files([path])
    try:
        acting = {"mechanism": "late_side", "terms": {"k": 0.08}, "start": 2.0, "stop": 7.0}
        flight = simulate(load_config({"base": "blunt_capsule", "mechanisms": [acting]}), seed=4712).flight
        found = compare(flight, mechanisms=["lag", "late_side"], maximum_likelihood="full")
    finally:
        use_plugin_files(())
    leader = found.ranking[0]
    assert (found.verdict.winner, found.warnings) == ("late_side", ())
    assert leader.ml is not None
    assert leader.ml.status == "converged"
    for term in (leader.terms[0], leader.ml.terms[-1]):  # what begins, and the jump that ends it
        assert abs(abs(term.value) - 0.08) < 3.0 * term.std_error < 0.01


SLOSH = """
import numpy as np
from brv_hypo.mechanisms import MomentProcess, hookimpl


class Slosh(MomentProcess):
    name, family, splines, title = "slosh", "body", 6, "moment of sloshing propellant"

    def shapes(self, motion):
        turn = np.exp(1j * (motion.windward_meridian + 1.5 * motion.time))
        return turn, 1j * turn


@hookimpl
def brv_hypo_mechanisms():
    return [Slosh()]
"""


@pytest.mark.slow
def test_a_second_mechanism_is_advised_only_where_the_sum_raises_the_evidence(tmp_path: Path) -> None:
    """Beside a slosh of ordinary size sticking would gain hundreds of nats; beside it as it is, nothing."""
    path = tmp_path / "slosh.py"
    path.write_text(SLOSH)
    use_plugin_files([path])
    try:
        slosh = {"slosh 0 2": 1.0e-4, "slosh 0 3": 3.0e-4, "slosh 0 4": 6.0e-4, "slosh 0 5": 1.0e-3}
        acting = [
            {"mechanism": "slosh", "terms": slosh},
            {"mechanism": "bodyfixed", "terms": dict(C_B), "start": 2.0, "stop": 4.0},
        ]
        flight = simulate({"base": "research_cone", "mechanisms": acting}, seed=1).flight
        found = compare(flight, mechanisms=["sticking", "bodyfixed"], maximum_likelihood="none")
    finally:
        use_plugin_files(())
    assert found.verdict.winner == "bodyfixed"
    assert "as well" not in found.verdict.reason


@pytest.mark.slow
def test_two_mechanisms_at_two_times_are_named_by_their_sum_and_neither_alone() -> None:
    """Processes made up for the second, by flow of a body-fixed moment: the first was named, too small."""
    acting = [
        {"mechanism": "sticking", "terms": {"eps": 0.6}, "theta": {"delay": 0.12}, "start": 1.0, "stop": 2.6},
        {"mechanism": "bodyfixed", "terms": dict(C_B), "start": 3.6, "stop": 5.0},
    ]
    setup = {"base": "research_cone", "mechanisms": acting, "instruments": {"draw": 1.0}}
    flight = simulate(load_config(setup), seed=6102).flight
    known = {"maximum_likelihood": "none"}
    alone = compare(flight, mechanisms=["sticking", "bodyfixed"], **known).verdict
    assert (alone.winner, alone.outcome) == (None, "undecided")
    assert "list their sum" in alone.reason
    found = compare(flight, mechanisms=["sticking", "bodyfixed", "sticking+bodyfixed"], **known)
    assert found.verdict.winner == "sticking+bodyfixed"
    limits = {each.mechanism: each.share_of_moment_95 for each in found.verdict.limits}
    assert max(limits["sticking"], limits["bodyfixed"]) < limits["sticking+bodyfixed"]
    assert limits["sticking+bodyfixed"] < limits["sticking"] + limits["bodyfixed"]
    first, last = (each for each in found.ranking[0].intervals if each.acts)
    assert (first.start_s, first.stop_s, last.start_s, last.stop_s) == pytest.approx((1.0, 2.6, 3.6, 5.0), abs=0.02)
    true = {"eps": 0.6, **C_B}
    for each in (*first.values[:1], *(value for value in last.values if value.name in C_B)):
        assert abs(each.value - true[each.name]) < 4.0 * each.std_error


@pytest.mark.slow
@pytest.mark.parametrize("seed", [73003, 73005, 74006])
def test_a_lag_of_a_fifth_of_the_moment_is_found_where_it_acts(seed: int) -> None:
    """The search without processes has it from the start of the record on, and its static moment is another then."""
    start = {"alpha": 0.03, "windward_meridian": 2.0, "roll_rate": 10.0, "coning_rate": 5.2}
    lag = {"mechanism": "lag", "theta": {"delay": 0.04}, "terms": {"lag fraction": 0.7}, "start": 2.6, "stop": 4.4}
    flight = simulate("research_cone", seed=seed, start=start, mechanisms=[lag], instruments={"draw": 1.0}).flight
    found = compare([flight], CompareConfig(maximum_likelihood="none"))
    assert found.verdict.winner == "lag"
    begin, end = found.ranking[0].acting[0].start_s, found.ranking[0].acting[-1].stop_s
    assert (begin, end) == pytest.approx((2.6, 4.4), abs=0.01)
