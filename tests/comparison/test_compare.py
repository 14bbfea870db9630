"""Comparisons of records as they come: measured, short, without the channel that a mechanism needs."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from brv_hypo.comparison import CompareConfig, Comparison, compare
from brv_hypo.errors import UnanswerableError, UsageError
from brv_hypo.flight import load_flight
from brv_hypo.io.text import hypothesis
from brv_hypo.mechanisms import Mechanism, Term
from brv_hypo.motion.motion import Motion
from brv_hypo.simulation import simulate
from tests.chains import compared_nominal
from tests.flights import flown, nominal
from tests.shared_data import shared_file

REGRESSION: dict[str, Any] = {"maximum_likelihood": "none"}
"""For what the likelihood has no part in."""


@pytest.fixture(scope="module")
def opportunity() -> Comparison:
    """The measured entry of Opportunity, compared with the defaults."""
    flight = load_flight(shared_file("data/opportunity/opportunity_entry.h5"))
    return compare([flight], CompareConfig(mechanisms=("lag", "bodyfixed")))


@pytest.mark.shared
@pytest.mark.thorough
def test_the_measured_entry_of_opportunity(opportunity: Comparison) -> None:
    """8 Hz, Martian, inertia up to a factor: neither of two explains what processes do, so none is named."""
    comparison = opportunity
    verdict = comparison.verdict
    assert verdict.winner is None
    assert verdict.adequacy is not None
    assert verdict.adequacy.ratio > 1.1
    assert verdict.processes
    assert verdict.explained is not None
    assert verdict.explained.share < 0.1
    assert verdict.explained.interval_95[1] < min(0.105, 0.2 * verdict.explained.processes)
    assert verdict.explained.processes > 0.5
    assert verdict.adequacy.p_value < 1e-3
    assert not verdict.adequacy.adequate
    assert hypothesis(comparison.ranking[0].mechanism) in verdict.reason
    assert f"{verdict.adequacy.ratio:.2f} times" in verdict.reason
    assert any("8 Hz" in warning for warning in comparison.reconstruction.warnings)
    assert comparison.flights[0].samples == 1283


def test_json_has_the_keys_of_the_contract() -> None:
    content = compared_nominal().model_dump(mode="json", by_alias=True)
    assert content["schema"] == "brv-hypo/compare/1"
    assert set(content) >= {"flights", "reconstruction", "baseline", "ranking", "verdict", "seconds"}
    row = content["ranking"][0]
    keys = {
        "rank",
        "mechanism",
        "f_ratio",
        "cp",
        "prediction_error",
        "r2",
        "bic",
        "log_evidence",
        "log_likelihood",
        "n_terms",
        "n_effective",
        "terms",
        "ml",
    }
    assert set(row) >= keys
    term = content["baseline"]["terms"][0]
    assert set(term) == {
        "name",
        "mechanism",
        "channel",
        "value",
        "std_error",
        "f_ratio",
        "units",
        "region_s",
        "delay_s",
    }
    assert set(content["verdict"]) == {
        "winner",
        "outcome",
        "equivalent",
        "probability",
        "adequacy",
        "explained",
        "processes",
        "limits",
        "stability",
        "same_leader",
        "described",
        "reason",
    }
    assert set(content["verdict"]["explained"]) == {"share", "unexplained", "interval_95", "processes", "noise"}
    assert set(content["verdict"]["processes"][0]) == {
        "name",
        "family",
        "size",
        "std_error",
        "units",
        "share_of_moment",
        "tolerance",
        "planted",
    }
    assert set(content["verdict"]["adequacy"]) == {"ratio", "p_value", "adequate"}
    assert set(content["verdict"]["limits"][0]) == {
        "mechanism",
        "share_of_moment_95",
        "share_in_part_95",
        "coefficient_95",
        "coefficients_95",
        "share_of_moment",
        "share_std_error",
    }
    interval = next(row for row in content["ranking"] if row["intervals"])["intervals"][0]
    assert set(interval) == {"start_s", "stop_s", "values", "collinear_groups"}
    assert content["record"] == {"sound": True, "faults": []}
    assert set(content["seconds"]) == {"reconstruct", "select", "ml", "total"}


def test_the_seven_criteria_agree_with_their_definitions() -> None:
    comparison = compared_nominal()
    for row in comparison.ranking:
        criteria = row.criteria
        assert set(criteria) >= {
            "rss",
            "adjusted_rss",
            "prediction_error",
            "cp",
            "f_ratio",
            "expected_variance",
            "press",
        }
        assert criteria["press"] > criteria["rss"]
        assert criteria["adjusted_rss"] > 0.0
    full = next(row for row in comparison.ranking if row.mechanism == "damping")
    assert full.cp == pytest.approx(len(comparison.baseline.terms) + full.n_terms, abs=1.0)


def test_too_short_a_window_cannot_answer() -> None:
    flight = nominal().flight.window(0.0, 0.2)
    with pytest.raises(UnanswerableError, match="--start and --stop"):
        compare([flight])


def test_options_of_what_is_not_compared_are_refused() -> None:
    with pytest.raises(UsageError, match="is 'damping' meant"):
        compare([nominal().flight], CompareConfig(mechanisms=("damping",), options={"dampin": {}}))


def test_an_unknown_mechanism_names_the_nearest() -> None:
    with pytest.raises(UsageError, match="sticking"):
        compare([nominal().flight], CompareConfig(mechanisms=("stiking",)))


class NeedsMach(Mechanism):
    name = "needs_mach"
    title = claims = source = "a mechanism for this test"

    def terms(self, motion: Motion, theta: Mapping[str, float]) -> tuple[Term, ...]:
        return (Term("C", motion.mach * motion.alpha, np.zeros_like(motion.alpha)),)


@pytest.mark.thorough
def test_a_mechanism_without_its_channel_is_left_out_with_a_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    module = importlib.import_module("brv_hypo.comparison.compare")
    known = module.parse_hypothesis

    def parse(name: str, options: object = None) -> tuple[Mechanism, ...]:
        return (NeedsMach(),) if name == "needs_mach" else known(name, options)

    monkeypatch.setattr(module, "parse_hypothesis", parse)
    flight = replace(nominal().flight, mach=None, altitude=None, planet="mars")
    comparison = compare([flight], CompareConfig(mechanisms=("needs_mach", "damping"), **REGRESSION))
    assert [row.mechanism for row in comparison.ranking] == ["none", "damping"]
    assert any("needs_mach is left out" in warning for warning in comparison.warnings)


@pytest.mark.slow
def test_gaps_cost_samples_but_not_the_verdict() -> None:
    flight = simulate("research_cone", seed=66, plant=("sticking",)).flight
    n = flight.samples
    cut = replace(flight, segments=((0, 300), (330, 700), (720, n)))
    comparison = compare([cut], CompareConfig(mechanisms=("sticking", "bodyfixed")))
    assert comparison.ranking[0].mechanism == "sticking"
    assert comparison.ranking[0].n_effective < 2 * n


@pytest.mark.slow
def test_a_credible_hypothesis_is_refined_by_maximum_likelihood() -> None:
    """The block of the contract, and the likelihood's own estimate of a planted step of the slope."""
    flight = simulate("sounding_rocket", seed=67, plant=("damping",)).flight
    comparison = compare([flight], CompareConfig(mechanisms=("damping", "bodyfixed")))
    first = comparison.ranking[0]
    assert first.mechanism == "damping"
    assert first.ml is not None
    assert first.ml.status == "converged"
    jumps = sorted((term for term in first.ml.terms), key=lambda term: term.value)
    for term, planted in zip(jumps, (-350.0, 350.0), strict=True):
        assert abs(term.value - planted) < 4.0 * term.std_error
    assert comparison.seconds.ml > 0.0


@pytest.mark.slow
def test_a_delay_is_refined_by_the_likelihood() -> None:
    flight = simulate("research_cone", seed=68, plant=("sticking",)).flight
    comparison = compare([flight], CompareConfig(mechanisms=("sticking", "damping")))
    first = comparison.ranking[0]
    assert first.mechanism == "sticking"
    assert first.ml is not None
    assert first.ml.status == "converged"
    (delay,) = (each for each in first.ml.derived if each.name == "sticking delay")
    assert delay.value == pytest.approx(0.12, abs=4.0 * delay.std_error)
    assert delay.std_error < 1e-4


@pytest.mark.shared
@pytest.mark.slow
def test_a_record_with_limits_keeps_to_the_regression_and_says_so(opportunity: Comparison) -> None:
    check_regression_alone(opportunity)


@pytest.mark.thorough
def test_a_flight_that_nothing_on_the_list_explains_keeps_to_the_regression_and_says_so() -> None:
    flight = flown("research_cone", "bodyfixed").flight.window(1.0, 4.0)
    found = compare([flight], CompareConfig(mechanisms=("damping",)))
    assert found.verdict.winner is None
    assert found.verdict.adequacy is not None
    assert not found.verdict.adequacy.adequate
    check_regression_alone(found)


def check_regression_alone(found: Comparison) -> None:
    first = found.ranking[0]
    assert first.ml is None
    assert any("maximum_likelihood" in note for note in first.notes)


@pytest.mark.shared
@pytest.mark.slow
def test_a_requested_regression_needs_no_note() -> None:
    flight = load_flight(shared_file("data/opportunity/opportunity_entry.h5"))
    first = compare([flight], CompareConfig(mechanisms=("bodyfixed",), **REGRESSION)).ranking[0]
    assert first.ml is None
    assert not any("maximum_likelihood" in note for note in first.notes)
